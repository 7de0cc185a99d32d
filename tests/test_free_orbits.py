"""Periodic orbits of systems that nothing excites, whose period is an unknown."""

from __future__ import annotations

import math

import numpy as np
import pytest

import zivi

DONE = zivi.OrbitStatus.COMPLETED
Z, E = 0.05, 0.8


def swinging(z: float = Z, gravity: float = -1.0) -> zivi.ImpactSystem:
    """x'' = -x + 2 z x' - gravity, which the wall keeps from growing."""
    return zivi.ImpactSystem(zivi.LinearForce(stiffness=1.0, damping=-2 * z, gravity=gravity), e=E)


def closed_form(z: float = Z, e: float = E) -> tuple[float, float]:
    """Speed after the impact and period, from x(T) = 0 and u + e x'(T) = 0 by bisection."""
    w = math.sqrt(1 - z * z)

    def speed(T: float) -> float:
        # x = 1 + exp(z t) (-cos w t + (u + z)/w sin w t) vanishes at T
        return w * (math.cos(w * T) - math.exp(-z * T)) / math.sin(w * T) - z

    def misfit(T: float) -> float:
        u = speed(T)
        b = (u + z) / w
        slope = z * (-math.cos(w * T) + b * math.sin(w * T)) + w * (
            math.sin(w * T) + b * math.cos(w * T)
        )
        return u + e * math.exp(z * T) * slope

    low, high = 3.4, 4.5
    assert misfit(low) * misfit(high) < 0
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if misfit(low) * misfit(middle) <= 0 else (middle, high)
    return speed(low), low


@pytest.mark.parametrize("start", ["run", "state", "rows"])
def test_a_swing_against_a_wall_has_its_closed_form(start):
    system, (u, period) = swinging(), closed_form()
    starts = {"state": (0.0, (0.5, 0.0)), "rows": [(0.7, 1.05 * u)]}
    given = starts.get(start) or zivi.simulate(system, (0, 200), (0.5, 0.0))
    orbit = zivi.periodic_orbit(system, given)
    assert (orbit.kind, orbit.status) == ("impacting", DONE)
    assert orbit.stable
    assert orbit.iterations <= 6
    assert orbit.period == pytest.approx(period, rel=1e-10)
    assert orbit.impacts["u"][0] == pytest.approx(u, rel=1e-10)
    # one multiplier is that of a shift in time; both have the determinant e^2 exp(2 z T)
    values = np.sort(orbit.multipliers.real)
    assert values[1] == pytest.approx(1, abs=1e-9)
    assert values[0] == pytest.approx(E**2 * math.exp(2 * Z * period), rel=1e-9)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(orbit.monodromy())), values, atol=1e-8)


def test_a_branch_and_its_derivative():
    orbit = zivi.periodic_orbit(swinging(), (0.0, (0.5, 0.0)))
    branch = zivi.continue_orbit(orbit, "damping", (-0.12, -0.08))
    assert branch.status is zivi.OrbitStatus.RANGE_END
    for value, point in zip(branch.values, branch.orbits, strict=True):
        u, period = closed_form(-value / 2)
        np.testing.assert_allclose([point.period, point.impacts["u"][0]], [period, u], rtol=1e-9)
    h = 1e-6
    ends = np.array([closed_form(Z + side * h)[::-1] for side in (1, -1)])
    slope = -(ends[0] - ends[1]) / (2 * h) / 2
    np.testing.assert_allclose(orbit.derivative("damping"), slope, rtol=1e-6)


def test_a_cycle_of_van_der_pol_grazes_where_it_is_as_wide():
    solve_ivp = pytest.importorskip("scipy.integrate").solve_ivp
    mu = 0.5
    tops = solve_ivp(
        lambda t, y: [y[1], mu * (1 - y[0] ** 2) * y[1] - y[0]],
        (0, 120),
        (2, 0),
        method="DOP853",
        events=lambda t, y: y[1],
        rtol=1e-12,
        atol=1e-13,
    )
    turn = float(np.diff(tops.t_events[0][-3:]).sum())
    width = abs(float(tops.y_events[0][-1][0]))
    force = zivi.ParametricForce(
        lambda t, x, v, c: mu * (1 - (x - c) ** 2) * v - (x - c),
        {"c": 1.9},
        lambda t, x, v, c: (
            0.0,
            -2 * mu * (x - c) * v - 1,
            mu * (1 - (x - c) ** 2),
            2 * mu * (x - c) * v + 1,
        ),
    )
    orbit = zivi.periodic_orbit(zivi.ImpactSystem(force, e=0.7), (0.0, (1.0, 0.0)))
    branch = zivi.continue_orbit(orbit, "c", (1.7, 2.3))
    (grazing,) = branch.of_kind("grazing")
    assert grazing.value == pytest.approx(width, rel=1e-9)
    smooth = branch.switch(grazing)
    assert (smooth.kind, smooth.status) == ("flight", DONE)
    assert smooth.period == pytest.approx(turn, rel=1e-9)
    assert smooth.stable
    other = zivi.continue_orbit(smooth, "c", (1.7, 2.3))
    (begins,) = other.of_kind("interior_impact")
    assert begins.value == pytest.approx(width, rel=1e-9)
    # the orbit begins and ends at its lowest point
    depths = [orbit.depth for orbit in other.orbits]
    assert depths == pytest.approx(np.abs(other.values - width), rel=1e-7, abs=1e-12)
    back = other.switch(begins)
    assert (back.kind, back.status) == ("impacting", DONE)


def test_a_mass_that_rests_and_bad_input():
    rests = zivi.periodic_orbit(swinging(gravity=1.0), (0.0, (0.2, 0.0)))
    assert rests.status is zivi.OrbitStatus.RESTS
    driven = zivi.LinearForce(gravity=1.0, amplitude=1.3)
    with pytest.raises(ValueError, match="cannot be 'free'"):
        zivi.periodic_orbit(zivi.ImpactSystem(driven, e=0.5), [(0.6, 2.1)], period="free")
    with pytest.raises(ValueError, match="or 'free', got 'sometimes'"):
        zivi.periodic_orbit(swinging(), [(0.0, 3.0)], period="sometimes")
    with pytest.raises(ValueError, match="multiple must be None"):
        zivi.periodic_orbit(swinging(), [(0.0, 3.0)], 2)
    timed = zivi.ParametricForce(lambda t, x, v, a: a * math.sin(t) - 1, {"a": 1.3})
    with pytest.raises(ValueError, match="period='free' finds it for an autonomous system"):
        zivi.periodic_orbit(zivi.ImpactSystem(timed, e=0.5), [(0.6, 2.1)])
