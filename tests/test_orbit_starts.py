"""What runs, states and arrays show of an orbit, and periods that are not known."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import zivi
from orbit_tables import TURN, frame, table
from zivi.orbits import attractor, free, start
from zivi.orbits.find import is_free
from zivi.orbits.flights import PRECISE
from zivi.orbits.sequence import unknowns_of


def test_the_middle_of_the_last_long_flight():
    rows = np.array([[0.0, 1], [4.0, 1], [5.0, 1], [9.0, 1], [9.5, 1]])
    # flights 4, 1, 4, .5 and 1.5 to the end: the last of at least half of the longest is 5 to 9
    assert attractor.quiet(rows, 11.0) == 7.0
    assert attractor.quiet(rows, 13.0) == 9.5 + 0.5 * 3.5
    # exactly half is long enough, and impacts before the last eight do not count
    assert attractor.quiet(rows, 11.5) == 10.5
    many = np.column_stack([[-50.0, *range(9)], np.ones(10)])
    assert attractor.quiet(many, 8.5) == 8.25
    assert attractor.quiet(np.vstack([[-9.0, 1], many[2:]]), 8.5) == 8.25


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
        resolved_impacts=record,
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
        with pytest.raises(ValueError, match=r"finite rows .* at increasing times"):
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
    assert rests.y.shape == (0, 2)
    assert free._flight(drop, -3.0) == pytest.approx(6.0)
    assert free._flight(drop, 200.0) == pytest.approx(400.0)
    away = zivi.ImpactSystem(zivi.LinearForce(gravity=-1.0), e=0.5)
    with pytest.raises(ValueError, match="followed by no other within 10000 s"):
        free._flight(away, 1.0)
