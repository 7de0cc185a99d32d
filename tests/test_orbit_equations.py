"""The equations of orbits: residuals, Jacobians by differences, Newton's iteration."""

from __future__ import annotations

import math

import numpy as np
import pytest

import zivi
from orbit_tables import MODES, TURN, frame, residual, single, table
from zivi.orbits.flights import PRECISE, FlightError, fly, period_of
from zivi.orbits.sequence import Frame, canonical, equations, newton, size_of


def test_periods_and_lengths():
    assert frame().period_of(table(omega=2.0)) == pytest.approx(math.pi)
    assert Frame(1, 3.0, PRECISE).period_of(table()) == 3.0
    assert frame(3).length(table(), single()) == pytest.approx(3 * TURN)
    assert frame().period_by(table(omega=2.0), "omega") == pytest.approx(-TURN / 4)
    for own, name in (
        (frame(), "amplitude"),
        (frame(), None),
        (frame(free=True), "omega"),
        (Frame(1, 3.0, PRECISE), "omega"),
    ):
        assert own.period_by(table(omega=2.0), name) == 0.0
    assert period_of(table(omega=4.0), None) == pytest.approx(TURN / 4)
    assert period_of(table(), 2.5) == 2.5
    for bad in (0.0, -1.0, math.inf):
        with pytest.raises(ValueError, match="period must be"):
            period_of(table(), bad)
    ball = zivi.ImpactSystem(-1.0, e=0.5)
    with pytest.raises(ValueError, match=r"give period=\.\.\. \(s\)$"):
        period_of(ball, None)
    with pytest.raises(ValueError, match="or period='free'"):
        period_of(ball, None, or_free=True)
    with pytest.raises(ValueError, match="no single period"):
        frame().period_of(ball)


CASES = {
    "one": (table(), frame(), single() * [1.02, 0.97]),
    "two": (table(), frame(2), np.array([[0.7, 2.0], [6.9, 2.3]])),
    "wall": (
        zivi.ImpactSystem(-9.81, e=0.6, wall=zivi.HarmonicWall(0.1, 12.0)),
        frame(),
        np.array([[0.1, 2.0]]),
    ),
    "oscillator": (MODES.system(0.5), frame(), np.array([[1.0, 0.3]])),
    "flight": (MODES.system(0.15), frame(start=0.4), np.array([1.3, 0.2])),
    "free": (
        zivi.ImpactSystem(zivi.LinearForce(stiffness=1, damping=-0.1, gravity=-1), e=0.8),
        frame(free=True),
        np.array([[7.5, 2.2], [3.6, 2.0]]),
    ),
    "free flight": (
        zivi.ImpactSystem(zivi.LinearForce(stiffness=1, damping=-0.1, gravity=-1), e=0.8),
        frame(free=True),
        np.array([1.5, 6.1]),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_jacobians_are_those_of_differences(name):
    system, own, y = CASES[name]
    at, h = equations(system, own, y), 1e-5
    columns = []
    for i in range(y.size):
        step = (np.arange(y.size) == i).reshape(y.shape) * h
        columns.append(
            (residual(system, own, y + step) - residual(system, own, y - step)) / (2 * h)
        )
    np.testing.assert_allclose(at.jacobian, np.array(columns).T, rtol=1e-6, atol=1e-7)
    assert not at.by.any()
    names = {"wall": ["wall.omega", "wall.amplitude", "e"]}.get(name, ["damping", "e", "gravity"])
    if "free" not in name and name != "wall":
        names += ["omega", "phase", "amplitude"]
    from zivi.system.parameters import parameter, with_value

    for q in names:
        value = parameter(system, q)
        ends = [residual(with_value(system, q, value + s * h), own, y) for s in (1, -1)]
        by = equations(system, own, y, q).by
        np.testing.assert_allclose(by, (ends[0] - ends[1]) / (2 * h), rtol=1e-5, atol=1e-6)


def test_residuals_of_the_equations():
    # two flights of a ball under gravity alone: x = u t - t^2/2
    force = zivi.LinearForce(gravity=1.0, amplitude=1e-12)
    own, y = Frame(2, 4.0, PRECISE), np.array([[1.0, 2.0], [4.0, 3.0]])
    at = equations(zivi.ImpactSystem(force, e=0.5), own, y)
    # 3 s from 2 m/s: x = 1.5, v = -1; then 5 s from 3 m/s: x = 2.5, v = -2
    np.testing.assert_allclose(at.residual, [1.5, 3 - 0.5, 2.5, 2 - 1.0], atol=1e-10)
    np.testing.assert_allclose(at.legs.v, [-1, -2], atol=1e-10)
    assert at.lowest[0] == np.inf
    flight = equations(zivi.ImpactSystem(force, e=0.5), Frame(1, 4.0, PRECISE), np.array([1.0, 2]))
    np.testing.assert_allclose(flight.residual, [0, -4], atol=1e-10)
    for bad in ([[4.0, 2.0], [1.0, 3.0]], [[math.nan, 1.0]]):
        with pytest.raises(FlightError):
            equations(table(), frame(2), np.array(bad))


def test_how_near_a_grazing_is():
    # impacts that the force pulls off: v^2/(2 a)
    t, u = single(1.6)[0]
    at = equations(table(1.6), frame(), single(1.6))
    a, v = -1 + 1.6 * math.sin(t), -u / 0.5
    assert a > 0
    assert at.depth == pytest.approx(v * v / (2 * a))
    pressed = equations(table(), frame(), np.array([[3.5, 2.0]]))
    assert pressed.legs.last[0] < 0
    assert pressed.depth == np.inf
    t, amplitude = MODES.orbit(0.3)
    at = equations(MODES.system(amplitude), frame(), np.array([[t, 0.3]]), minima=True)
    times = np.linspace(t, t + MODES.period, 4001)[1:-1]
    x = zivi.simulate(MODES.system(amplitude), (t, t + MODES.period), (0, 0.3), PRECISE)(times)[0]
    inside = np.flatnonzero((x[1:-1] < x[:-2]) & (x[1:-1] < x[2:])) + 1
    if len(inside):
        assert at.lowest[0] == pytest.approx(x[inside].min(), abs=1e-5)
    flight = equations(MODES.system(0.1), frame(), np.array([1.2, 0.1]), minima=True)
    assert flight.depth == abs(flight.lowest[0])


def test_multipliers_at_a_grazing_are_infinite():
    at = equations(table(), frame(), np.array([[single()[0, 0], 2.0]]))
    at.legs.v[:] = 0.0
    grazes = equations(table(), frame(), single())
    object.__setattr__(grazes, "maps", [at.legs.map(0, 2.0, 0.5)])
    np.testing.assert_array_equal(grazes.multipliers, [np.inf, 0])
    # the product is from the first map on
    a, b = np.array([[1.0, 2], [0, 1]]), np.array([[1.0, 0], [3, 1]])
    object.__setattr__(grazes, "maps", [a, b])
    np.testing.assert_array_equal(grazes.monodromy, b @ a)


def test_the_map_of_an_impact():
    # of (t, u) by differences of the flight to the wall
    system, t, u, h = table(), 0.6, 2.0, 1e-5
    end = zivi.simulate(system, (t, t + 8), (0, u), PRECISE).impacts["t"][0]
    legs = fly(system, np.array([[t, 0.0, u, end]]))
    columns = []
    for dt, du in ((h, 0.0), (0.0, h)):
        ends = []
        for side in (1, -1):
            t0 = t + side * dt
            run = zivi.simulate(system, (t0, t0 + 8), (0, u + side * du), PRECISE)
            ends.append([run.impacts["t"][0], run.impacts["xdot_after"][0]])
        columns.append((np.array(ends[0]) - ends[1]) / (2 * h))
    np.testing.assert_allclose(legs.map(0, u, 0.5), np.array(columns).T, rtol=1e-6)


def test_orbits_begin_at_the_smallest_phase():
    y = np.array([[0.5, 1.0], [3.0, 2.0]])
    assert canonical(y, 4.0, 4.0) is y
    np.testing.assert_array_equal(
        canonical(np.array([[3.0, 2.0], [4.5, 1.0]]), 4.0, 4.0), [[0.5, 1], [3, 2]]
    )
    np.testing.assert_array_equal(
        canonical(np.array([[7.0, 2.0], [8.5, 1.0]]), 4.0, 4.0), [[0.5, 1], [3, 2]]
    )
    # of two periods: the phase within one
    np.testing.assert_array_equal(
        canonical(np.array([[1.0, 2.0], [4.5, 1.0]]), 4.0, 8.0), [[0.5, 1], [5, 2]]
    )
    flight = np.array([9.0, 1.0])
    assert canonical(flight, 4.0, 4.0) is flight


def test_sizes_of_residuals():
    own, system = frame(), table()
    at = equations(system, own, single())
    time, speed = TURN / TURN, abs(at.legs.v[0])
    np.testing.assert_allclose(size_of(system, own, at), [speed * time, speed])
    two = equations(system, frame(2), np.array([[0.7, 2.0], [6.9, 2.3]]))
    assert size_of(system, frame(2), two).shape == (4,)
    assert size_of(system, frame(2), two)[1] == max(2.3, *abs(two.legs.v))
    # slow impacts: what the force gives in a part of the period
    slow = equations(table(omega=0.5), own, np.array([[1.0, 1e-9]]))
    object.__setattr__(slow.legs, "v", np.array([1e-9]))
    pull = max(abs(slow.legs.first[0]), abs(slow.legs.last[0]))
    np.testing.assert_allclose(size_of(table(omega=0.5), own, slow)[1], 0.1 * 2 * pull)
    flight = equations(MODES.system(0.1), own, np.array([1.2, 0.1]))
    time = 1 / 0.9
    np.testing.assert_allclose(
        size_of(MODES.system(0.1), own, flight), [1.2, 1.2 / time], rtol=1e-12
    )
    fast = equations(MODES.system(0.1), own, np.array([1.2, -50.0]))
    assert size_of(MODES.system(0.1), own, fast)[1] == 50.0


def test_newtons_iteration():
    found = newton(table(), frame(), single() * 1.03)
    assert found.converged
    assert found.iterations == len(found.trace) - 1 <= 6
    assert found.residual == found.trace[-1] < 2e-11
    np.testing.assert_allclose(found.equations.y, single(), rtol=1e-11)
    # it converges quadratically
    assert found.trace[3] < 10 * found.trace[2] ** 2 + 1e-13
    short = newton(table(), frame(), single() * 1.03, 1)
    assert (short.converged, short.iterations) == (False, 1)
    assert newton(table(), frame(), single()).iterations == 0
    none = newton(table(0.9), frame(), single())
    assert not none.converged
    assert none.residual > 1e-6
