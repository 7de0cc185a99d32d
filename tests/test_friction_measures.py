"""Measures of runs with dry friction: exponents of accumulations, thresholds, work."""

import math

import numpy as np
import pytest

import zivi
from friction_problems import CASES, reference

RATIO = 0.6


def bowl(mu):
    """Impacts of a particle in a parabola that end at rest on it, sliding or sticking."""
    gap = zivi.Gap(
        lambda t, q: q[1] - q[0] ** 2 / 2,
        lambda t, q: [-q[0], 1.0],
        lambda t, q, w: -(w[0] ** 2),
        tangent=lambda t, q: [1.0, q[0]],
        tangent_curvature=lambda t, q, w: w[0] * w[1],
        mu=mu,
    )
    force = lambda t, q, w: [-0.4 * w[0] - 2 * q[0], -9.81 - 0.3 * w[1]]  # noqa: E731
    system = zivi.MechanicalSystem(mass=np.diag([1.0, 1.5]), force=force, gaps=[gap], e=RATIO)
    start = ([0.5, 0.125], [0.9, 1.2]) if mu < 0.5 else ([0.5, 0.125], [-0.5, 1.0])
    method = zivi.SwitchedRK(rtol=1e-13, atol=1e-13)
    return zivi.simulate(system, (0, 1.0), start, method)


@pytest.mark.parametrize("mu", [0.3, 0.9])
def test_times_and_states_of_impacts_have_powers_of_the_restitution(mu):
    """``t_n = t + sum C_k e^(kn)``, and so the states: eliminated, each power is the next."""
    sol = bowl(mu)
    assert sol.success, sol.message
    end = float(sol.zeno["t"][0])
    times = sol.resolved_impacts["t"][:15]
    after = np.array([sol(t)[1] for t in times + 1e-13])
    columns = np.column_stack([times - end, after - sol(end)[1]])
    for k in (1, 2, 3):
        for part in (columns[:, :1], columns[:, 1:]):
            size = np.abs(part).max(axis=1)
            order = math.log(size[-1] / size[-3]) / (2 * math.log(RATIO))
            assert order == pytest.approx(k, abs=0.02)
        columns = (columns[1:] - RATIO**k * columns[:-1]) / (1 - RATIO**k)


@pytest.mark.parametrize(("mu", "wall"), [(0.5, 0.3), (0.4, 0.0), (0.3, 0.6), (0.7, 0.5)])
def test_a_ladder_stands_from_its_angle_on(mu, wall):
    """``tan th = (1 - mu mu_w)/(2 mu)``, and 1e-9 more or less."""
    pytest.importorskip("sympy")
    ladder = zivi.symbolic.system(
        "x y th",
        T="(xdot**2 + ydot**2)/2 + thdot**2/6",
        V="9.81*y",
        gaps={"floor": "y - sin(th)", "wall": "-x - cos(th)"},
        slips={"floor": "xdot + sin(th)*thdot", "wall": "ydot + cos(th)*thdot"},
        mu={"floor": "mu", "wall": "mu_wall"},
        parameters={"mu": mu, "mu_wall": wall},
    )
    least = math.atan((1 - mu * wall) / (2 * mu))
    for angle, stands in ((least + 1e-9, True), (least - 1e-9, False)):
        start = [-math.cos(angle), math.sin(angle), angle]
        sol = zivi.simulate(ladder, (0, 0.2), (start, [0, 0, 0]))
        assert sol.success, sol.message
        assert bool(sol.modes[0, 0] == 0) is stands
        assert bool(np.abs(sol.qdot[-1]).max() < 1e-50) is stands


def test_the_woodpecker_costs_little():
    """What other programs need a million steps for."""
    system, span, state = reference("woodpecker")
    sol = zivi.simulate(system, span, state, zivi.SwitchedRK(rtol=1e-6, atol=1e-6))
    assert sol.success, sol.message
    assert sol.nfev <= 2800
    exact = CASES["woodpecker"]["end"]["state"]
    assert sol(span[1]).ravel() == pytest.approx(np.array(exact, dtype=float), abs=1e-5)


@pytest.mark.parametrize("order", [5, 8])
@pytest.mark.parametrize("tol", [1e-6, 1e-9])
def test_a_mass_that_almost_stops_is_followed(order, tol):
    """Its largest speed is that of the belt, and a little more or less."""
    belt = zivi.DryFriction(limit=1.0, velocity=1.0)
    mass = zivi.MechanicalSystem(mass=1.0, force=lambda t, q, w: -q, friction=[belt])
    method = zivi.SwitchedRK(order=order, rtol=tol, atol=tol)
    for d in [*(s * 10.0**-k for k in (3, 5, 7, 9, 11) for s in (1, -1)), 0.0]:
        # about x = 1, where friction holds the spring, with the amplitude 1 + d; the belt takes d
        sol = zivi.simulate(mass, (0, 20), ([1.0], [-1.0 - d]), method)
        assert sol.success, sol.message
        late = sol.resample(np.linspace(15, 20, 301))
        size = np.hypot(late.q - 1, late.qdot)
        assert size.max() == pytest.approx(min(1, 1 + d), abs=100 * tol), d
