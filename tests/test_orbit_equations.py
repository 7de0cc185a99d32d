"""The equations of orbits: residuals, Jacobians by differences, Newton's iteration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

import zivi
from inside import (
    PRECISE,
    FlightError,
    Margins,
    MassFlow,
    SequenceFrame as Frame,
    by_parameter,
    canonical,
    evaluate,
    exponentials,
    frame_of,
    impact_maps,
    moved_frame,
    multipliers_of,
    newton,
    period_of,
    row_sizes,
    sizes_of,
)
from orbit_tables import MODES, TURN, as_rows, as_word, equations, frame, single, table


def test_periods_and_lengths():
    assert period_of(table(omega=2.0), None) == pytest.approx(math.pi)
    assert as_word(table(), Frame(1, 3.0, PRECISE), single())[0].length == 3.0
    assert as_word(table(), frame(3), single())[0].length == pytest.approx(3 * TURN)
    assert period_of(table(omega=4.0), None) == pytest.approx(TURN / 4)
    assert period_of(table(), 2.5) == 2.5
    for bad in (0.0, -1.0, math.inf):
        with pytest.raises(ValueError, match="period must be"):
            period_of(table(), bad)
    ball = zivi.ImpactSystem(-1.0, e=0.5)
    with pytest.raises(ValueError, match=r"^period must be given \(s\): .* known period$"):
        period_of(ball, None)
    with pytest.raises(ValueError, match="period='free' finds it"):
        period_of(ball, None, or_free=True)


def test_exponentials_of_many_matrices_at_once():
    w, times = 3.0, np.array([0.0, 1e-9, 0.3, 40.0])
    found = exponentials(np.array([[0.0, 1.0], [-w * w, 0.0]]) * times[:, None, None])
    c, s = np.cos(w * times), np.sin(w * times)
    exact = np.array([[c, s / w], [-w * s, c]]).transpose(2, 0, 1)
    assert np.max(np.abs(found - exact)) < 1e-12
    # masses that nothing holds, under waves
    sizes = np.random.default_rng(2).standard_normal((20, 7, 7))
    sizes[:, :2, 3:] = 0.0
    for size in (1e-3, 1.0, 10.0):
        for one, other in zip(exponentials(size * sizes), map(expm, size * sizes), strict=True):
            assert np.max(np.abs(one - other)) < 1e-12 * np.max(np.abs(other)) * max(1.0, size)


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
    system, own, rows = CASES[name]
    word, y = as_word(system, own, rows)
    terms, h, columns = evaluate(word, y), 1e-5, []
    for step in h * np.eye(len(y)):
        ends = [evaluate(word, y + side * step).residual for side in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * h))
    np.testing.assert_allclose(terms.matrix(), np.array(columns).T, rtol=1e-6, atol=1e-7)
    names = {"wall": ["wall.omega", "wall.amplitude", "e"]}.get(name, ["damping", "e", "gravity"])
    if "free" not in name and name != "wall":
        names += ["omega", "phase", "amplitude"]
    from inside import parameter

    for q in names:
        value = parameter(system, q)
        frames = [moved_frame(word, {q: value + side * h}) for side in (1, -1)]
        ends = [evaluate(it, y).residual for it in frames]
        by = by_parameter(word, y, q)
        np.testing.assert_allclose(by, (ends[0] - ends[1]) / (2 * h), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("factor", [1.0, -1.0])
def test_curvatures_are_those_of_differences(name, factor):
    system, own, rows = CASES[name]
    word, y = as_word(system, own, rows)
    (w, v), h, found = np.random.default_rng(3).normal(size=(2, len(y))), 1e-5, []
    for step in h * np.eye(len(y)):
        ends = [evaluate(word, y + side * step).matrix(factor) for side in (1, -1)]
        found.append(w @ (ends[0] - ends[1]) @ v / (2 * h))
    exact = evaluate(word, y).curvature(factor, w, v)
    np.testing.assert_allclose(exact, found, rtol=1e-5, atol=1e-5)


def test_a_word_is_the_sequence_that_it_was_made_of():
    for name, (system, own, rows) in CASES.items():
        terms = equations(system, own, rows)
        again = as_rows(terms)
        if name == "free flight":
            again[0] = terms.x[0, 1]
        np.testing.assert_allclose(again, rows, rtol=1e-12, err_msg=name)


@pytest.mark.parametrize("name", ["amplitude", "e", "omega", "damping"])
@pytest.mark.parametrize("kind", ["impacts", "flight"])
def test_the_derivative_of_an_orbit_is_that_of_differences(name, kind):
    from inside import parameter, with_value

    amplitude = MODES.orbit(0.4)[1] if kind == "impacts" else 0.1
    system = MODES.system(amplitude)
    start = [(MODES.orbit(0.4)[0], 0.4)] if kind == "impacts" else (0.4, (1.2, 0.1))
    orbit, h = zivi.periodic_orbit(system, start, 1), 1e-4
    ends = []
    for side in (1, -1):
        moved = with_value(system, name, parameter(system, name) + side * h)
        word, y = frame_of(orbit._frame, moved), orbit._y
        ends.append(as_rows(newton(word, y).terms).ravel())
    slope = (ends[0] - ends[1]) / (2 * h)
    np.testing.assert_allclose(orbit.derivative(name), slope, rtol=2e-6, atol=1e-9)


def test_residuals_of_the_equations():
    # two flights of a ball under gravity alone: x = u t - t^2/2
    force = zivi.LinearForce(gravity=1.0, amplitude=1e-12)
    ball = zivi.ImpactSystem(force, e=0.5)
    own, rows = Frame(2, 4.0, PRECISE), np.array([[1.0, 2.0], [4.0, 3.0]])
    terms = equations(ball, own, rows)
    # 5 s from 3 m/s to the first: x = 2.5, v = -2; 3 s from 2 m/s: x = 1.5, v = -1; P = 3 u
    np.testing.assert_allclose(terms.residual, [2.5, 6 - 3.0, 1.5, 9 - 1.5], atol=1e-10)
    np.testing.assert_allclose(terms.rates, [-2, -1], atol=1e-10)
    assert np.all(terms.flights.lows[:, 1] == np.inf)
    flight = equations(ball, Frame(1, 4.0, PRECISE), np.array([1.0, 2]))
    # from x = 1, v = 2 at 0 for 4 s: x = 1, v = -2
    np.testing.assert_allclose(flight.residual, [0, 0, 0, 4], atol=1e-10)
    for bad in ([[4.0, 2.0], [1.0, 3.0]], [[math.nan, 1.0]]):
        with pytest.raises(FlightError):
            equations(table(), frame(2), np.array(bad))


def test_how_near_a_grazing_is():
    # impacts that the force pulls off: v^2/(2 a)
    t, u = single(1.6)[0]
    terms = equations(table(1.6), frame(), single(1.6))
    a, v = -1 + 1.6 * math.sin(t), -u / 0.5
    assert a > 0
    assert Margins(terms).depth == pytest.approx(v * v / (2 * a))
    pressed = equations(table(), frame(), np.array([[3.5, 2.0]]))
    assert pressed.flights.last[0, 1] < 0
    assert Margins(pressed).depth == np.inf
    t, amplitude = MODES.orbit(0.3)
    terms = equations(MODES.system(amplitude), frame(), np.array([[t, 0.3]]))
    times = np.linspace(t, t + MODES.period, 4001)[1:-1]
    x = zivi.simulate(MODES.system(amplitude), (t, t + MODES.period), (0, 0.3), PRECISE)(times)[0]
    inside = np.flatnonzero((x[1:-1] < x[:-2]) & (x[1:-1] < x[2:])) + 1
    if len(inside):
        assert terms.flights.lows[0, 1] == pytest.approx(x[inside].min(), abs=1e-5)
    flight = equations(MODES.system(0.1), frame(), np.array([1.2, 0.1]))
    assert Margins(flight).depth == abs(flight.flights.lows[0, 1])


def test_multipliers_at_a_grazing_are_infinite():
    terms = equations(table(), frame(), single())
    terms.flights.z[:, 1] = 0.0
    assert np.all(np.isinf(multipliers_of(terms)))
    # of several impacts: the product of their maps, that of the first flight first
    two = equations(table(), frame(2), np.array([[0.7, 2.0], [6.9, 2.3]]))
    first, second = impact_maps(two.flights, 0.5)
    np.testing.assert_allclose(two.return_map(), second @ first)
    np.testing.assert_allclose(two.return_map(1), first @ second)
    # of the same motion in segments
    np.testing.assert_allclose(two.return_map(), two.segments.return_map(), rtol=1e-9, atol=1e-9)


def test_the_map_of_an_impact():
    # of (t, u) by differences of the flight to the wall
    system, t, u, h = table(), 0.6, 2.0, 1e-5
    end = zivi.simulate(system, (t, t + 8), (0, u), PRECISE).impacts["t"][0]
    flow = MassFlow(system, PRECISE)
    flights = flow.fly((), np.array([t]), np.array([[0.0, u]]), np.array([end]))
    columns = []
    for dt, du in ((h, 0.0), (0.0, h)):
        ends = []
        for side in (1, -1):
            t0 = t + side * dt
            run = zivi.simulate(system, (t0, t0 + 8), (0, u + side * du), PRECISE)
            ends.append([run.impacts["t"][0], run.impacts["xdot_after"][0]])
        columns.append((np.array(ends[0]) - ends[1]) / (2 * h))
    (found,) = impact_maps(flights, 0.5)[:, ::2, ::2]
    np.testing.assert_allclose(found, np.array(columns).T, rtol=1e-6)


def turned(rows: list[list[float]], multiple: int) -> np.ndarray:
    """The rows of the same orbit from that of the smallest phase on, of a period of 4."""
    force = zivi.LinearForce(gravity=1.0, amplitude=0.1, omega=TURN / 4)
    terms = equations(zivi.ImpactSystem(force, e=0.5), frame(multiple), np.array(rows))
    found = canonical(terms, multiple)
    if np.array_equal(as_rows(found)[:, 0], as_rows(terms)[:, 0]):
        assert found is terms
    return as_rows(found)[:, 0]


def test_orbits_begin_at_the_smallest_phase():
    assert turned([[0.5, 1.0], [3.0, 2.0]], 1) == pytest.approx([0.5, 3])
    assert turned([[3.0, 2.0], [4.5, 1.0]], 1) == pytest.approx([0.5, 3])
    assert turned([[7.0, 2.0], [8.5, 1.0]], 1) == pytest.approx([0.5, 3])
    # of two periods: the phase within one
    assert turned([[1.0, 2.0], [4.5, 1.0]], 2) == pytest.approx([0.5, 5])


def test_sizes_of_residuals():
    terms = equations(table(), frame(), single())
    # a distance in a part 1/(2 pi) of the flight
    speed = abs(terms.rates[0])
    np.testing.assert_allclose(row_sizes(terms), [TURN, speed, speed, TURN])
    # impulses (1 + e)/e times the speeds
    np.testing.assert_allclose(sizes_of(terms)[0], [3 * speed, TURN])
    np.testing.assert_allclose(sizes_of(terms)[1], [speed, speed])
    two = equations(table(), frame(2), np.array([[0.7, 2.0], [6.9, 2.3]]))
    assert row_sizes(two)[2] == max(2.3, *abs(two.rates))
    # slow impacts: what the force gives in a part of the period
    slow = equations(table(omega=0.5), frame(), np.array([[1.0, 1e-9]]))
    slow.flights.z[:, 1] = 1e-9
    pull = max(abs(slow.flights.first[0, 1]), abs(slow.flights.last[0, 1]))
    assert row_sizes(slow)[2] == pytest.approx(0.1 * 2 * pull)


def test_newtons_iteration():
    word, y = as_word(table(), frame(), single() * 1.03)
    found = newton(word, y)
    assert found.converged
    assert found.iterations == len(found.trace) - 1 <= 6
    assert found.residual == found.trace[-1] < 2e-11
    np.testing.assert_allclose(as_rows(found.terms), single(), rtol=1e-11)
    # it converges quadratically
    assert found.trace[3] < 10 * found.trace[2] ** 2 + 1e-13
    short = newton(word, y, 1)
    assert (short.converged, short.iterations) == (False, 1)
    assert newton(*as_word(table(), frame(), single())).iterations == 0
    none = newton(*as_word(table(0.9), frame(), single()))
    assert not none.converged
    assert none.residual > 1e-6
