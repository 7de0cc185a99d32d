"""The parts of orbits, each alone: on made numbers, closed forms and differences."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import zivi
from oscillator import Oscillator
from zivi.methods import SwitchedRK
from zivi.orbits import attractor, cells, free, least_period, lyapunov, rest, rest_branch, start
from zivi.orbits.attractor import Attractor, Settled
from zivi.orbits.branch import _weight
from zivi.orbits.curve import Curve, _secant, locate, locate_near
from zivi.orbits.find import is_free, why_not
from zivi.orbits.flights import PRECISE, FlightError, fly, period_of
from zivi.orbits.rest_appears import _is_chain
from zivi.orbits.sequence import Frame, canonical, equations, newton, size_of, unknowns_of

TURN = 2 * math.pi
STATUS = zivi.OrbitStatus
MODES = Oscillator(0.05, 0.9, 0.8)


def table(amplitude: float = 1.3, e: float = 0.5, omega: float = 1.0) -> zivi.ImpactSystem:
    force = zivi.LinearForce(gravity=1.0, amplitude=amplitude, phase=-math.pi / 2, omega=omega)
    return zivi.ImpactSystem(force, e=e)


def frame(multiple: int = 1, **other: Any) -> Frame:
    return Frame(multiple, None, PRECISE, **other)


def single(amplitude: float = 1.3, e: float = 0.5) -> np.ndarray:
    """The orbit of one impact in one period, rows (t, u)."""
    cosine = math.pi * (1 - e) / ((1 + e) * amplitude)
    return np.array([[math.acos(cosine), TURN * e / (1 + e)]])


# what runs show


def test_the_middle_of_the_last_long_flight():
    rows = np.array([[0.0, 1], [4.0, 1], [5.0, 1], [9.0, 1], [9.5, 1]])
    # flights 4, 1, 4, .5 and 1.5 to the end: the last of at least half of the longest is 5 to 9
    assert start._quiet(rows, 11.0) == attractor._quiet(rows, 11.0) == 7.0
    assert start._quiet(rows, 13.0) == attractor._quiet(rows, 13.0) == 9.5 + 0.5 * 3.5
    # exactly half is long enough, and impacts before the last eight do not count
    assert start._quiet(rows, 11.5) == attractor._quiet(rows, 11.5) == 10.5
    many = np.column_stack([[-50.0, *range(9)], np.ones(10)])
    assert start._quiet(many, 8.5) == attractor._quiet(many, 8.5) == 8.25
    assert start._quiet(np.vstack([[-9.0, 1], many[2:]]), 8.5) == 8.25


def test_the_impacts_of_the_last_period():
    rows = np.column_stack([[0.5, 1.5, 2.5, 3.5, 4.5], [1, 2, 3, 4, 5]])
    # seen from 4 s, the middle of the last flight of at least half of the longest
    window = start._window(rows, 4.6, 2.0)
    np.testing.assert_array_equal(window, rows[2:4])
    np.testing.assert_array_equal(start._window(rows, 4.6, 2.0, 2.0), rows[:2])
    # the later end belongs to it, the earlier one does not
    np.testing.assert_array_equal(start._window(rows, 4.6, 2.5), rows[2:4])
    np.testing.assert_array_equal(start._window(rows, 4.6, 2.5, 0.5), rows[1:4])


@pytest.mark.parametrize("m", [1, 2, 3, 5])
def test_after_how_many_periods_impacts_repeat(m):
    speeds = np.tile(np.arange(1.0, m + 1), 20)[: 8 * m]
    rows = np.column_stack([TURN * np.arange(8 * m) + 0.3, speeds])
    assert start._repeats(rows, rows[-1, 0] + 3, TURN) == m
    random = np.random.default_rng(4).normal(size=(8 * m, 2))
    noisy = rows + 1e-5 * random
    assert start._repeats(noisy, rows[-1, 0] + 3, TURN) == m
    coarse = rows + 1e-3 * random
    assert start._repeats(coarse, rows[-1, 0] + 3, TURN) == m


def test_impacts_that_repeat_nowhere_count_as_one_period():
    rows = np.column_stack([TURN * np.arange(30) + 0.3, np.arange(1.0, 31) ** 2])
    assert start._repeats(rows, rows[-1, 0] + 3, TURN) == 1
    # speeds relative to the fastest, also where there are none
    still = np.column_stack([TURN * np.arange(6.0), np.zeros(6)])
    assert start._repeats(still, 5 * TURN + 3, TURN) == 1
    two = np.column_stack([TURN * np.arange(8) + 0.5 * (np.arange(8) % 2), np.zeros(8)])
    assert start._repeats(two, 7 * TURN + 3, TURN) == 2


def run_like(impacts: Any, end: float, zeno: Any = (), rest_time: float | None = None) -> Any:
    rows = np.array(impacts, float).reshape(-1, 2)
    record = np.zeros(len(rows), [("t", "f8"), ("xdot_after", "f8")])
    record["t"], record["xdot_after"] = rows.T if len(rows) else ((), ())
    return SimpleNamespace(
        t=np.array([0.0, end]),
        x=np.array([9.0, 0.25]),
        xdot=np.array([9.0, -0.5]),
        impacts=record,
        zeno_times=np.array(zeno, float),
        rest_time=rest_time,
    )


def test_what_the_end_of_a_run_shows():
    times = TURN * np.arange(40) + 0.3
    rows = np.column_stack([times, 1.0 + np.arange(40) % 2])
    end = times[-1] + 3.0
    guess = start.from_run(run_like(rows, end), None, TURN)
    assert (guess.multiple, guess.resting, len(guess.y)) == (2, False, 2)
    # the last flight ends with the run and is not a whole one: seen from the one before it
    np.testing.assert_array_equal(guess.y, rows[-3:-1])
    assert len(start.from_run(run_like(rows, end), 3, TURN).y) == 3
    # a Zeno point within the last two periods (of the motion) is a rest, an older one is not
    for zeno, multiple, rests in (
        (end - 1.9 * TURN, None, True),
        (end - 2.1 * TURN, None, False),
        (end - 2.1 * TURN, 2, True),
    ):
        guess = start.from_run(run_like(rows, end, [3.0, zeno]), multiple, TURN)
        assert guess.resting is rests
        if rests:
            assert (guess.phase, guess.multiple, guess.y.shape) == (zeno, multiple or 1, (0, 2))
    guess = start.from_run(run_like(rows, end, rest_time=4.0), 7, TURN)
    assert (guess.resting, guess.phase, guess.multiple) == (True, end, 1)


def test_a_run_without_recent_impacts_is_a_flight():
    # the state at the end, at its phase
    for impacts in ([], [(1.0, 2.0)]):
        guess = start.from_run(run_like(impacts, 5 * TURN + 0.7), None, TURN)
        assert (guess.resting, guess.multiple) == (False, 1)
        np.testing.assert_array_equal(guess.y, [0.25, -0.5])
        assert abs(guess.start - 0.7) < 1e-12
    # four periods are looked at, or as many as are asked for; a long flight takes several
    guess = start.from_run(run_like([(1.5 * TURN, 2.0)], 5 * TURN), None, TURN)
    assert (guess.y.shape, guess.multiple) == ((1, 2), 2)
    assert start.from_run(run_like([(0.9 * TURN, 2.0)], 5 * TURN), None, TURN).y.shape == (2,)
    guess = start.from_run(run_like([(1.5 * TURN, 2.0)], 5 * TURN), 3, TURN)
    assert (guess.y.shape, guess.multiple) == ((2,), 3)
    assert start.from_run(run_like([(1.5 * TURN, 2.0)], 5 * TURN), 4, TURN).y.shape == (1, 2)


def test_rows_of_arrays():
    made = np.zeros(2, [("t", "f8"), ("u", "f4"), ("xdot_after", "f8")])
    made["t"], made["u"], made["xdot_after"] = (1, 2), (3, 4), (5, 6)
    np.testing.assert_array_equal(start.rows_of(made), [[1, 3], [2, 4]])
    assert start.rows_of(made).dtype == float
    np.testing.assert_array_equal(start.rows_of(made[["t", "xdot_after"]]), [[1, 5], [2, 6]])
    np.testing.assert_array_equal(start.rows_of([(1, 2), (3, 4)]), [[1.0, 2], [3, 4]])
    for bad in ([1.0, 2.0], [[1.0, 2.0, 3.0]], np.empty((0, 2))):
        with pytest.raises(ValueError, match=r"start must have rows \(t, u\), got an array"):
            start.rows_of(bad)
    for bad in ([(1, 2), (1, 3)], [(2, 2), (1, 3)], [(math.nan, 2)], [(1, math.inf)]):
        with pytest.raises(ValueError, match=r"finite rows .* at ascending times"):
            start.rows_of(bad)


def test_guesses_of_rows_count_periods():
    for times, multiple in (
        ([0.1], 1),
        ([0.1, 0.1 + 0.9 * TURN], 1),
        ([0.1, 0.1 + 1.1 * TURN], 2),
        ([0.1, 3, 0.1 + 2.5 * TURN], 3),
        ([0.1, 0.1 + TURN], 1),
    ):
        guess = start.guess_of(table(), [(t, 1.0) for t in times], None, TURN, PRECISE)
        assert guess.multiple == multiple
        assert start.guess_of(table(), [(t, 1.0) for t in times], 5, TURN, PRECISE).multiple == 5


def test_guesses_of_orbits_and_states():
    resting = zivi.periodic_orbit(table(), (0.0, (0.5, 0.0)))
    guess = start.guess_of(table(), resting, None, TURN, PRECISE)
    assert (guess.resting, guess.multiple) == (True, 1)
    assert guess.phase == resting.liftoff_time - 0.5 * resting.margin
    impacting = zivi.periodic_orbit(table(), [(0.6, 2.1)])
    guess = start.guess_of(table(), impacting, None, TURN, PRECISE)
    assert (guess.resting, guess.multiple, guess.start) == (False, 1, 0.0)
    np.testing.assert_array_equal(guess.y, impacting._y)
    assert start.guess_of(table(), impacting, 4, TURN, PRECISE).multiple == 4
    # a state with a multiple: the impacts of one period of the motion
    guess = start.guess_of(table(), (0.5, (0.05, 2.0)), 2, TURN, PRECISE)
    run = zivi.simulate(table(), (0.5, 0.5 + 2 * TURN), (0.05, 2.0), PRECISE)
    np.testing.assert_array_equal(guess.y[:, 0], run.impacts["t"])
    np.testing.assert_array_equal(guess.y[:, 1], run.impacts["xdot_after"])
    assert (guess.multiple, guess.resting) == (2, False)
    rests = start.guess_of(table(), (0.0, (0.5, 0.0)), 1, TURN, PRECISE)
    assert (rests.resting, rests.multiple, rests.y.shape) == (True, 1, (0, 2))
    assert 0 < rests.phase < TURN
    high = start.guess_of(table(), (0.25, (900.0, 0.0)), 3, TURN, PRECISE)
    assert (high.start, high.multiple, high.resting) == (0.25, 3, False)
    np.testing.assert_array_equal(high.y, [900.0, 0.0])


# orbits without a period


@pytest.mark.parametrize("k", [1, 2, 3])
def test_after_how_many_impacts_free_motions_repeat(k):
    steps = np.tile(np.arange(1.0, k + 1), 12)[: 7 * k]
    rows = np.column_stack([np.cumsum(steps), 10 + steps])
    assert free._repeats(rows) == k
    assert free._repeats(rows[-k - 1 :]) == 1 or k == 1
    for size in (1e-5, 1e-3):
        noise = size * np.random.default_rng(4).normal(size=(7 * k, 2))
        assert free._repeats(rows + noise) == k
    assert free._repeats(np.column_stack([np.arange(9.0) ** 3, np.arange(9.0) ** 2])) == 1


def test_unknowns_of_free_orbits():
    rows = np.array([[3.0, 1.0], [5.0, 2.0]])
    np.testing.assert_array_equal(unknowns_of(rows, 4.5), [[4.5, 1], [2, 2]])
    np.testing.assert_array_equal(rows, [[3.0, 1.0], [5.0, 2.0]])
    own = frame(free=True)
    np.testing.assert_array_equal(own.unknowns(rows, 4.5), [[4.5, 1], [2, 2]])
    assert frame().unknowns(rows, 4.5) is rows
    y = own.unknowns(rows, 4.5)
    np.testing.assert_array_equal(own.listed(y), [[0, 1], [2, 2]])
    np.testing.assert_array_equal(own.rows(table(), y), [[0, 0, 1, 2], [2, 0, 2, 4.5]])
    assert own.length(table(), y) == 4.5
    assert own.length(table(), np.array([1.0, 7.0])) == 7.0
    np.testing.assert_array_equal(own.rows(table(), np.array([1.0, 7.0])), [[0, 1, 0, 7]])


def test_the_last_turn_of_a_motion_without_impacts():
    class Swing:
        t = np.array([0.0, 40.0])

        def __call__(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return 3 + np.cos(1.7 * t - 0.4), -1.7 * np.sin(1.7 * t - 0.4)

    high, period = free._cycle(Swing())  # type: ignore[arg-type]
    assert abs(high - 4) < 1e-4
    assert abs(period - TURN / 1.7) < 1e-6
    Swing.t = np.array([0.0, 3.0])
    with pytest.raises(ValueError, match="neither impacts nor two highest points"):
        free._cycle(Swing())  # type: ignore[arg-type]


def test_which_systems_nothing_excites():
    def drag(t: float, x: float, v: float) -> float:
        return -1.0 - 0.1 * v

    def early(t: float, x: float, v: float) -> float:
        return -1.0 - (0.1 if t > 50.0 else 0.0)

    still, moving = zivi.HarmonicWall(0.0, 2.0), zivi.HarmonicWall(0.1, 2.0)
    linear = zivi.LinearForce(gravity=1.0)
    for force, wall, alone in (
        (-9.81, None, False),
        (linear, None, True),
        (linear, still, True),
        (linear, moving, False),
        (zivi.LinearForce(gravity=1.0, amplitude=0.1), None, False),
        (drag, None, True),
        (drag, moving, False),
        (early, None, False),
    ):
        system = zivi.ImpactSystem(force, e=0.5, wall=wall)
        assert free.is_autonomous(system) is alone
        assert is_free(system, None, None) is alone
        assert is_free(system, 2.0, None) is False
    assert is_free(zivi.ImpactSystem(drag, e=0.5), "free", 1)
    for period, multiple, match in (
        ("sometimes", None, "or 'free', got 'sometimes'"),
        ("free", 2, "multiple counts periods"),
    ):
        with pytest.raises(ValueError, match=match):
            is_free(zivi.ImpactSystem(drag, e=0.5), period, multiple)
    with pytest.raises(ValueError, match="cannot be 'free'"):
        is_free(table(), "free", None)


def test_the_highest_point_of_a_flight():
    # x = u t - t^2/2
    ball = zivi.ImpactSystem(zivi.LinearForce(gravity=1.0), e=0.5)
    t, x = free.apex(ball, np.array([0.0, 0.0, 2.0, 4.0]), PRECISE)
    assert abs(t - 2) < 1e-12
    assert abs(x - 2) < 1e-12
    t, x = free.apex(ball, np.array([1.0, 0.5, 2.0, 5.0]), PRECISE)
    assert abs(t - 3) < 1e-12
    assert abs(x - 2.5) < 1e-12


def test_guesses_of_free_motions():
    swing = zivi.ImpactSystem(zivi.LinearForce(stiffness=1, damping=-0.1, gravity=-1), e=0.8)
    orbit = zivi.periodic_orbit(swing, (0.0, (0.5, 0.0)))
    guess = free.free_guess(swing, orbit, PRECISE)
    assert (guess.multiple, guess.resting) == (1, False)
    np.testing.assert_array_equal(guess.y, orbit._y)
    u = orbit.impacts["u"][0]
    guess = free.free_guess(swing, [(7.0, u)], PRECISE)
    np.testing.assert_allclose(guess.y, [[orbit.period, u]], rtol=1e-6)
    run = zivi.simulate(swing, (0, 800), (0.5, 0.0))
    np.testing.assert_allclose(free.free_guess(swing, run, PRECISE).y, guess.y, rtol=1e-4)
    np.testing.assert_allclose(
        free.free_guess(swing, (3.0, (0.5, 0.0)), PRECISE).y, guess.y, rtol=1e-4
    )
    drop = zivi.ImpactSystem(zivi.LinearForce(gravity=1.0), e=0.5)
    rests = free.free_guess(drop, (0.0, (0.5, 0.0)), PRECISE)
    assert (rests.resting, rests.multiple, rests.phase) == (True, 1, 10.0)
    assert free._flight(drop, -3.0) == pytest.approx(6.0)
    assert free._flight(drop, 200.0) == pytest.approx(400.0)
    away = zivi.ImpactSystem(zivi.LinearForce(gravity=-1.0), e=0.5)
    with pytest.raises(ValueError, match="followed by no other within 10000 s"):
        free._flight(away, 1.0)


# the equations


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


def residual(system: zivi.ImpactSystem, own: Frame, y: np.ndarray) -> np.ndarray:
    return equations(system, own, y).residual


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
    from zivi._parameters import parameter, with_value

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


# branches


def curve(name: str = "amplitude", y: np.ndarray | None = None, system: Any = None) -> Curve:
    return Curve(system or table(), frame(), name, single() if y is None else y, 0.7)


def test_points_of_a_curve():
    own = curve()
    here = own.start(single(), 1.3)
    assert here is not None
    np.testing.assert_allclose(here.z * own.scale, [*single()[0], 1.3])
    assert (here.value, here.corrections) == (1.3, 0)
    assert here.tangent[-1] > 0
    assert np.linalg.norm(here.tangent) == pytest.approx(1)
    assert own.flights == 1
    # the tangent is that of the closed form
    by = (single(1.3 + 1e-6) - single(1.3 - 1e-6))[0] / 2e-6
    ratio = here.tangent * own.scale
    np.testing.assert_allclose(ratio[:2] / ratio[2], by, rtol=1e-6, atol=1e-9)
    assert here.least_speed == pytest.approx(single()[0, 1] / 0.5)
    assert here.least_push == pytest.approx(-1 + 1.3 * math.sin(single()[0, 0]))
    m = here.at.monodromy
    assert here.doubling == pytest.approx(1 + np.trace(m) + np.linalg.det(m))
    assert own.scale[-1] == 0.7
    assert own.scale[0] == pytest.approx(TURN)


def test_the_derivative_of_a_curve():
    own = curve()
    z = own.scaled(single() * 1.01, 1.31)
    _, value, matrix = own.evaluate(z)
    h, columns = 1e-6, []
    for i in range(3):
        step = h * (np.arange(3) == i)
        columns.append((own.evaluate(z + step)[1] - own.evaluate(z - step)[1]) / (2 * h))
    np.testing.assert_allclose(matrix, np.array(columns).T, rtol=1e-5, atol=1e-7)
    raw = residual(table(1.31), frame(), single() * 1.01)
    np.testing.assert_allclose(value, raw / own.sizes)


def test_corrections_stay_in_their_plane():
    own = curve()
    here = own.start(single(), 1.3)
    guess = here.z + 0.05 * here.tangent
    found = own.correct(guess, here.tangent)
    assert found is not None
    assert abs(here.tangent @ (found.z - guess)) < 1e-12
    amplitude = found.value
    np.testing.assert_allclose(found.at.y, single(amplitude), rtol=1e-9)
    assert np.linalg.norm(found.tangent) == pytest.approx(1)
    assert 1 <= found.corrections <= 4
    assert own.correct(here.z - 2.0 * here.tangent, here.tangent) is None
    assert own.correct(np.array([math.nan, 1.0, 1.0]), here.tangent) is None


def test_events_are_located_to_rounding():
    own = curve()
    one = own.start(single(), 1.3)
    other = own.correct(own.scaled(single(1.6), 1.6), np.array([0, 0, 1.0]))
    doubling = math.hypot(math.pi / 3, 10 / 9)
    for found in (
        locate(own, one, other, lambda point: point.doubling),
        locate(own, other, one, lambda point: point.doubling),
        locate_near(own, one, lambda point: point.doubling),
    ):
        assert found is not None
        assert abs(found.value / doubling - 1) < 1e-12
    assert locate(own, one, one_like(own, 1.4), lambda point: point.doubling) is None


def one_like(own: Curve, amplitude: float) -> Any:
    return own.correct(own.scaled(single(amplitude), amplitude), np.array([0, 0, 1.0]))


def test_secants_within_a_bracket():
    assert _secant((1.0, 2.0), (0.0, -2.0), 0.0, 1.0) == 0.5
    assert _secant((0.75, 1.0), (0.25, -2.0), 0.2, 0.9) == pytest.approx(0.25 + 1 / 3)
    # without a slope, or outside: the middle
    assert _secant((1.0, 2.0), (0.0, 2.0), 0.2, 0.6) == pytest.approx(0.4)
    assert _secant((1.0, 2.0), (0.0, 1.0), 0.2, 0.6) == pytest.approx(0.4)
    assert _secant((1.0, math.inf), (0.0, 1.0), 0.2, 0.6) == pytest.approx(0.4)
    assert _secant((1.0, 2.0), (0.0, -2.0), 0.5, 0.9) == pytest.approx(0.7)


def test_the_end_that_needs_attention_is_the_status():
    order = ["COMPLETED", "RANGE_END", "LEFT_ADMISSIBLE", "MAX_POINTS", "NOT_CONVERGED"]
    assert [_weight(STATUS[name]) for name in order] == [0, 1, 2, 3, 4]


def test_why_an_orbit_is_no_motion():
    assert why_not(table(), equations(table(), frame(), single(), minima=True)) is None
    behind = equations(table(), frame(), np.array([[0.6, -0.3]]), minima=True)
    assert "t = 0.6 s would leave the wall at -0.3 m/s" in str(why_not(table(), behind))
    low = equations(MODES.system(0.9), frame(), np.array([0.5, 0.0]), minima=True)
    assert low.lowest[0] < 0
    assert f"to {low.lowest[0]:.3g} m at t = {low.lowest[1]:.9g} s" in str(
        why_not(MODES.system(0.9), low)
    )
    held = equations(table(e=0.0), frame(), np.array([[4.0, 0.0]]), minima=True)
    assert "t = 4 s the force holds the mass" in str(why_not(table(e=0.0), held))
    # by rounding it is one
    object.__setattr__(behind, "y", np.array([[0.6, -1e-13]]))
    assert "leave the wall" not in str(why_not(table(), behind))


# the least period


def test_parts_of_orbits():
    assert least_period._prime_factors(1) == least_period._prime_factors(0) == []
    assert least_period._prime_factors(12) == [2, 3]
    assert least_period._prime_factors(49) == [7]
    rows = np.tile(single(), (4, 1))
    rows += np.array([[0.0, 0.0], [TURN, 0.1], [2 * TURN, 0.0], [3 * TURN, 0.1]])
    assert least_period._most_parts(frame(4), rows) == 4
    assert least_period._most_parts(frame(6), rows) == 2
    assert least_period._most_parts(frame(3), rows) == 1
    assert least_period._most_parts(frame(free=True), rows) == 4
    assert least_period._most_parts(frame(6), np.zeros(2)) == 6
    half = least_period.half_difference(table(), frame(4), rows)
    np.testing.assert_allclose(half, 0, atol=1e-14)
    rows[:, 0] += [0.0, 0.0, 0.2, 0.2]
    half = least_period.half_difference(table(), frame(4), rows)
    np.testing.assert_allclose(half, [[0.1, 0], [0.1, 0]], atol=1e-14)
    mean = least_period.mean_half(table(), frame(4), rows)
    np.testing.assert_allclose(mean, rows[:2] + np.array([0.1, 0.0]), atol=1e-14)
    assert least_period.half_difference(table(), frame(4), np.zeros(2)) is None
    assert least_period.half_difference(table(), frame(4), rows[:3]) is None
    assert least_period.half_frame(frame(4)).multiple == 2
    assert least_period.half_frame(frame(free=True)).multiple == 1
    assert least_period._apart(table(), frame(4), rows, 2.0, 2) == pytest.approx(0.2 / TURN)
    rows[:, 1] += [0.0, 0.0, 0.6, 0.0]
    assert least_period._apart(table(), frame(4), rows, 2.0, 2) == pytest.approx(0.3)


def test_rows_of_a_run_that_alternates_still():
    rows = np.vstack([single(), single() + np.array([TURN, 0.0])])
    alternating = rows + np.array([[1e-3, 1e-3], [-1e-3, -1e-3]])
    multiple, least = least_period.least_rows(table(), TURN, alternating, 2)
    assert multiple == 1
    np.testing.assert_allclose(least, single(), rtol=1e-9)
    # far from it, nothing is solved
    apart = rows + np.array([[0.2, 0.3], [-0.2, -0.3]])
    assert least_period.least_rows(table(), TURN, apart, 2)[1] is apart
    once = least_period.least_rows(table(), TURN, single() * 1.01, 1)
    np.testing.assert_array_equal(once[1], single() * 1.01)


# what many runs settle on


def settled(rows: Any, **other: Any) -> Settled:
    values: dict[str, Any] = {"zeno_times": np.empty(0), "liftoff_times": np.empty(0)}
    values |= {"rests": False, "end": np.zeros(2), "success": True}
    return Settled(np.array(rows, float).reshape(-1, 2), **(values | other))


def classed(it: Settled, keep: int = 8) -> Attractor:
    return attractor.classify(table(), it, TURN, keep)


def test_kinds_of_what_runs_settle_on():
    assert classed(settled([], success=False)).kind == "failed"
    assert classed(settled([])).kind == "flight"
    assert classed(settled([])).multiple == 1
    rest_ = classed(settled([(1, 2)], rests=True))
    assert (rest_.kind, rest_.multiple, rest_.impacts.shape) == ("rest", 0, (0, 2))
    times = TURN * np.arange(8)
    for speeds, m in (([3.0], 1), ([3.0, 2.0], 2), ([3.0, 2.0, 5.0, 1.0], 4)):
        rows = np.column_stack([times + 0.5, np.tile(speeds, 8)[:8]])
        found = classed(settled(rows))
        assert (found.kind, found.multiple) == ("impacting", m)
        np.testing.assert_allclose(found.impacts[:, 0], 0.5 / TURN)
        assert sorted(found.impacts[:, 1]) == sorted(speeds)
    irregular = classed(settled(np.column_stack([times, np.arange(8.0) ** 2])))
    assert (irregular.kind, irregular.multiple, len(irregular.impacts)) == ("irregular", 0, 0)
    # a motion must be seen twice
    three = np.column_stack([times + 0.5, np.tile([3.0, 2.0, 5.0], 8)[:8]])
    assert classed(settled(three)).multiple == 3
    assert classed(settled(three[:5]), 5).kind == "irregular"
    # two impacts in a period, in the order of their phases
    two = np.column_stack([np.sort(np.concatenate([times + 5.0, times + 6.5])), [2.0, 3.0] * 8])
    found = classed(settled(two))
    np.testing.assert_allclose(found.impacts[:, 0], [(6.5 - TURN) / TURN, 5.0 / TURN])
    off = settled(np.column_stack([times + 0.5 + 3e-5 * TURN * np.arange(8) ** 2, 0 * times + 3]))
    assert classed(off).kind == "irregular"
    assert attractor.classify(table(), off, TURN, 8, 1e-2).kind == "impacting"


def test_motions_that_rest_again_and_again():
    rows = [(0.5, 2.0), (1.0, 1.0), (7.0, 2.0), (7.5, 1.0)]
    lifts = np.array([0.2, 0.2 + TURN])
    found = classed(settled(rows, zeno_times=np.array([1.5, 8.0]), liftoff_times=lifts))
    assert (found.kind, found.multiple) == ("resting", 1)
    np.testing.assert_allclose(found.impacts, [[(7.0 / TURN) % 1, 2.0]])
    # lift-offs two periods apart; after the last no impact was seen
    lifts = np.array([0.2, 0.2 + 2 * TURN])
    found = classed(settled(rows, zeno_times=np.array([8.0]), liftoff_times=lifts))
    assert found.multiple == 2
    np.testing.assert_allclose(found.impacts, [[0.5 / TURN, 2.0]])
    once = classed(settled(rows, zeno_times=np.array([8.0]), liftoff_times=lifts[:1]))
    assert once.multiple == 1
    np.testing.assert_allclose(once.impacts, [[0.5 / TURN, 2.0]])
    close = classed(settled(rows, rests=True, liftoff_times=np.array([0.2, 0.3])))
    assert close.multiple == 1


def test_which_motions_are_the_same():
    rows = np.array([[0.1, 2.0], [0.6, 1.0]])
    one = Attractor("impacting", 2, rows)
    for other, same in (
        (Attractor("impacting", 2, rows + np.array([[1e-4, 0], [0, 0]])), True),
        (Attractor("impacting", 2, rows + np.array([[0, 1.9e-3], [0, 0]])), True),
        (Attractor("impacting", 2, rows + np.array([[0, 2.1e-3], [0, 0]])), False),
        (Attractor("impacting", 2, rows + np.array([[2e-3, 0], [0, 0]])), False),
        (Attractor("impacting", 1, rows), False),
        (Attractor("resting", 2, rows), False),
        (Attractor("impacting", 2, rows[:1]), False),
        (Attractor("impacting", 2, rows + np.array([[1.0, 0], [0, 0]])), True),
        (Attractor("impacting", 2, rows[::-1]), True),
    ):
        assert one.is_same(other, 1e-3) is same
        assert other.is_same(one, 1e-3) is same
    edge = Attractor("impacting", 1, np.array([[0.9999, 1.0]]))
    assert edge.is_same(Attractor("impacting", 1, np.array([[0.0001, 1.0]])), 1e-3)
    none = Attractor("rest", 0, np.empty((0, 2)))
    assert none.is_same(Attractor("rest", 0, np.empty((0, 2))), 1e-3)
    wild = Attractor("irregular", 0, rows)
    assert wild.is_same(Attractor("irregular", 0, rows + 0.3), 1e-3)
    still = Attractor("impacting", 1, np.array([[0.2, 0.0]]))
    assert still.is_same(Attractor("impacting", 1, np.array([[0.2, 0.0005]])), 1e-3)
    # rows between times: the later end belongs
    np.testing.assert_array_equal(attractor._between(rows, 0.1, 0.6), rows[1:])


def test_states_that_merge():
    states = np.array([[1.0, 2.0], [3.0, 4.0], [1.0 + 1e-9, 2.0], [math.nan] * 2, [math.nan] * 2])
    now, which = cells._merged(states, SwitchedRK(rtol=1e-6, atol=1e-9))
    assert which[0] == which[2] != which[1]
    assert which[3] == which[4]
    assert len(now) == 3
    for i, k in enumerate(which):
        np.testing.assert_allclose(now[k], states[i], rtol=1e-8)
    # apart by more than the tolerance, relative to the largest; each component with its own
    apart = np.array([[1.0, 0.0], [1.00001, 0.0], [100.0, 1e-3]])
    assert len(set(cells._merged(apart, SwitchedRK(rtol=1e-9, atol=1e-12))[1])) == 3
    assert len(set(cells._merged(apart, SwitchedRK(rtol=1e-6, atol=1e-12))[1])) == 2
    loose = SwitchedRK(rtol=1e-14, atol=(1e-3, 1e-12))
    assert len(set(cells._merged(apart, loose)[1])) == 2


def test_shares_and_borders_of_basins():
    kinds = [Attractor("rest", 0, np.empty((0, 2))), Attractor("impacting", 2, np.ones((1, 2)))]
    label = np.array([[0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 0]])
    grazing = np.zeros((3, 4), dtype=bool)
    grazing[2, 0] = True
    found = zivi.Basins(np.arange(4.0), np.arange(3.0), label, kinds, grazing)
    border = np.array([[0, 0, 1, 1], [0, 0, 1, 1], [1, 0, 0, 1]], bool)
    np.testing.assert_array_equal(found.border, border)
    np.testing.assert_array_equal(found.grazing, grazing)
    np.testing.assert_allclose(found.shares, [10 / 12, 2 / 12])
    assert repr(found) == "<Basins of 12 cells: rest x0: 83.3%, impacting x2: 16.7%>"
    data = found.to_xarray()
    assert data.label.dims == data.border.dims == data.grazing.dims == ("xdot0", "x0")
    np.testing.assert_array_equal(data.label, label)
    np.testing.assert_array_equal(data.border, border)
    assert list(data.kind.values) == ["rest", "impacting"]
    assert list(data.multiple.values) == [0, 2]
    np.testing.assert_array_equal(data.x0, np.arange(4.0))
    np.testing.assert_array_equal(data.xdot0, np.arange(3.0))
    assert data.attrs["title"] == "Basins of attraction"
    assert data.attrs["source"] == f"zivi {zivi.__version__}"
    assert zivi.Basins(
        np.zeros(1), np.zeros(1), label[:1, :1], [*kinds, kinds[0]], grazing[:1, :1]
    ).shares.tolist() == [1, 0, 0]


def test_diagrams_as_datasets():
    kinds = [Attractor("rest", 0, np.empty((0, 2))), Attractor("impacting", 1, np.ones((1, 2)))]
    values = np.array([1.0, 2.0])
    for section, names in (("impacts", ("phase", "u")), ("strobe", ("x", "xdot"))):
        found = zivi.Diagram(
            "amplitude", section, values[[1, 1]], np.array([0.1, 0.2]), np.array([3.0, 4.0]),
            np.array([1, 1]), values, np.array([0, 1]), kinds,
        )  # fmt: skip
        data = found.to_xarray()
        np.testing.assert_array_equal(data[names[0]], [0.1, 0.2])
        np.testing.assert_array_equal(data[names[1]], [3.0, 4.0])
        np.testing.assert_array_equal(data.amplitude, [2.0, 2.0])
        np.testing.assert_array_equal(data.run_of_point, [1, 1])
        np.testing.assert_array_equal(data.run_value, values)
        np.testing.assert_array_equal(data.start, [0, 1])
        assert list(data.kind.values) == ["rest", "impacting"]
        assert list(data.multiple.values) == [0, 1]
        assert data.amplitude.dims == data[names[0]].dims == data.run_of_point.dims == ("point",)
        assert data.run_value.dims == data.kind.dims == data.start.dims == ("run",)
        assert data.attrs["title"] == "Bifurcation diagram"
        assert data.attrs["source"] == f"zivi {zivi.__version__}"
        np.testing.assert_array_equal(found.resting, [True, False])
        assert repr(found) == "<Diagram over amplitude: 2 runs, 1 at rest, 2 points>"


def test_means_of_exponents():
    # a constant map diag(2, 1/4) each 0.5 s: ln 2/.5 and -ln 4/.5
    maps, times = [np.diag([2.0, 0.25])] * 60, 0.5 * np.arange(61)
    np.testing.assert_allclose(
        lyapunov._means(maps, times), [2 * math.log(2), -2 * math.log(4)], rtol=1e-12
    )
    np.testing.assert_allclose(
        lyapunov._means([np.diag([0.25, 2.0])] * 60, times + 7), [2 * math.log(2), -2 * math.log(4)]
    )
    # rotations: the mean of both
    angle = 1.0
    turn = 0.5 * np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    np.testing.assert_allclose(lyapunov._means([turn] * 60, times), [-2 * math.log(2)] * 2)


# rest


def test_when_a_resting_mass_lifts_off():
    # -1 + 1.3 sin t > 0 from arcsin(1/1.3) on; the looks are a 256th of a period apart
    (found,) = rest.rises(table(), TURN)
    exact = math.asin(1 / 1.3)
    assert exact - TURN / 256 <= found <= exact
    (later,) = rest.rises(table(), TURN, 1.0)
    assert exact + TURN * (1 - 1 / 256) <= later <= exact + TURN
    assert rest.rises(table(0.9), TURN) == []
    (short,) = rest.rises(table(1 + 1e-9), TURN)  # positive for less than a look
    assert abs(short - math.pi / 2) < 0.05
    assert short < math.pi / 2
    assert rest.rises(table(5.0), TURN, 1.0) == rest.rises(table(5.0), TURN, 1.0)
    assert len(rest.rises(table(5.0), 3 * TURN)) == 3
    up = zivi.ImpactSystem(zivi.LinearForce(gravity=-1.0, amplitude=0.1), e=0.5)
    assert rest.rises(up, TURN) == []
    assert rest.highest_pull(table(0.9), TURN) == pytest.approx(-0.1, abs=1e-13)
    assert rest.highest_pull(table(1.3), TURN) == pytest.approx(0.3, abs=1e-13)


def test_the_force_on_a_mass_at_rest():
    assert rest.force_at_rest(table(), 0.7) == pytest.approx(-1 + 1.3 * math.sin(0.7))
    wall = zivi.HarmonicWall(0.1, 2.0, 0.3)
    moving = zivi.ImpactSystem(
        zivi.LinearForce(stiffness=3, damping=0.5, gravity=1), e=0.5, wall=wall
    )
    w, wdot, wddot = (float(it) for it in wall(0.7))
    assert rest.force_at_rest(moving, 0.7) == pytest.approx(-3 * w - 0.5 * wdot - 1 - wddot)
    assert rest.force_at_rest(zivi.ImpactSystem(-9.81, e=0.5), 0.7) == -9.81
    for force in (lambda t, x, v: t + x + v - 2, lambda t, y: t + y[0] + y[1] - 2):
        assert rest.force_at_rest(zivi.ImpactSystem(force, e=0.5), 0.5) == -1.5


def test_exponents_at_the_end_of_a_rest():
    for e, lam, mu, beta in (
        (0.5, 0.660442, 1.989600, 0.603031),
        (0.3, 0.488144, 3.247151, 0.608896),
    ):
        assert rest.chatter_exponent(e) == pytest.approx(beta, abs=1e-6)
        assert math.log(1 / lam) / math.log(mu) == pytest.approx(beta, abs=2e-6)
    # lam at any e by bisection of its equation, with the printed mu
    for e in (0.05, 0.7, 0.95):
        low, high = 0.0, 1.0
        for _ in range(80):
            lam = 0.5 * (low + high)
            low, high = (lam, high) if lam**3 + 2 * lam**2 < e * (1 + 2 * lam) else (low, lam)
        tau = 1 - lam
        top = (0.5 - 2 * tau / 3) * (1 - tau) + 2 * (tau / 2 - tau**2 / 3)
        mu = e * top / ((1 - tau) ** 3 * (0.5 - tau / 3))
        assert rest.chatter_exponent(e) == pytest.approx(math.log(1 / lam) / math.log(mu))


def test_secants_of_the_margin():
    orbits = [SimpleNamespace(margin=m) for m in (0.09, 0.04)]
    points: Any = [(1.0, orbits[0]), (1.1, orbits[1])]
    # margin^(1/0.5): .0081 and .0016, a line that vanishes at 1.1 + .1 .0016/.0065
    assert rest_branch._root(points, 0.5) == pytest.approx(1.1 + 0.1 * 0.0016 / 0.0065)
    assert math.isnan(rest_branch._root(points[:1], 0.5))
    assert math.isnan(rest_branch._root([points[0], points[0]], 0.5))
    assert rest_branch._short_of(1.5, 1.0, 2.0) == pytest.approx(1.495)
    assert rest_branch._short_of(1.5, 2.0, 1.0) == pytest.approx(1.505)
    for root in (0.9, 2.1, math.nan):
        assert rest_branch._short_of(root, 1.0, 2.0) == 1.5


def test_chains_of_impacts():
    assert _is_chain(np.array([3.0, 2.0, 1.0, 0.5]))
    assert _is_chain(np.array([1.0, 0.5, 3.0, 2.0]))  # in any turn
    assert not _is_chain(np.array([3.0, 2.0, 1.0]))
    assert not _is_chain(np.array([3.0, 2.0, 2.5, 1.0]))
    assert _is_chain(np.array([3.0, 2.0, 1.0, 0.5, 0.7]))
