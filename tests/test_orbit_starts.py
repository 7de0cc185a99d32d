"""What runs, states and arrays show of an orbit, and periods that are not known."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import zivi
from inside import (
    PRECISE,
    is_free,
    orbits_attractor as attractor,
    orbits_free as free,
    orbits_start as start,
    unknowns_of,
)
from orbit_tables import THREE, TURN, frame, table


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


def test_impacts_that_repeat_nowhere():
    rows = np.column_stack([TURN * np.arange(30) + 0.3, np.arange(1.0, 31) ** 2])
    assert start._repeats(rows, rows[-1, 0] + 3, TURN) is None
    assert start._repeats(rows[:0], 9.0, TURN) is None
    shown = from_run(run_like(rows, rows[-1, 0] + 3), None)
    assert shown.multiple == 1
    assert shown.shown == (
        "The last period of the run holds 1 impact, and nothing repeats to a hundredth; "
        "give multiple=, or a longer run."
    )
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


def from_run(run: Any, multiple: int | None) -> start.Guess:
    return start.from_run(table(), run, multiple, TURN, PRECISE)


def test_what_the_end_of_a_run_shows():
    times = TURN * np.arange(40) + 0.3
    rows = np.column_stack([times, 1.0 + np.arange(40) % 2])
    end = times[-1] + 3.0
    guess = from_run(run_like(rows, end), None)
    assert (guess.multiple, guess.rest, len(guess.y)) == (2, None, 2)
    assert guess.shown.startswith("The last 2 periods of the run hold 2 impacts; give multiple=")
    # the last flight ends with the run and is not a whole one: seen from the one before it
    np.testing.assert_array_equal(guess.y, rows[-3:-1])
    assert len(from_run(run_like(rows, end), 3).y) == 3
    # a Zeno point within 64 periods may be of a motion that rests again, an older one is not
    for zeno, rests in (
        (end - 1.9 * TURN, True),
        (end - 63.9 * TURN, True),
        (end - 65 * TURN, False),
    ):
        guess = from_run(run_like(rows, end, [-999.0, zeno]), None)
        assert guess.rest == (zeno if rests else None)
        assert (guess.multiple, guess.end) == (2, end)
        np.testing.assert_array_equal(guess.y, rows[-3:-1])
    guess = from_run(run_like(rows, end, rest_time=4.0), 7)
    assert (guess.rest, guess.multiple, guess.y.shape) == (end, 1, (0, 2))


def test_a_run_without_recent_impacts_is_a_flight():
    # the state at the end, at its phase
    for impacts in ([], [(1.0, 2.0)]):
        guess = from_run(run_like(impacts, 5 * TURN + 0.7), 1)
        assert (guess.rest, guess.multiple) == (None, 1)
        np.testing.assert_array_equal(guess.y, [0.25, -0.5])
        assert abs(guess.start - 0.7) < 1e-12
        assert guess.shown.startswith("The last period of the run holds no impacts;")
    # four periods are looked at, or as many as are asked for; a long flight takes several
    guess = from_run(run_like([(1.5 * TURN, 2.0)], 5 * TURN), None)
    assert (guess.y.shape, guess.multiple) == ((1, 2), 2)
    guess = from_run(run_like([(1.5 * TURN, 2.0)], 5 * TURN), 3)
    assert (guess.y.shape, guess.multiple) == ((2,), 3)
    assert from_run(run_like([(1.5 * TURN, 2.0)], 5 * TURN), 4).y.shape == (1, 2)
    # a further run has impacts, and rests at its end
    guess = from_run(run_like([(0.9 * TURN, 2.0)], 5 * TURN), None)
    assert guess.rest == pytest.approx((5 + 128) * TURN)


@pytest.mark.parametrize("multiple", [None, 3])
def test_a_motion_that_rests_once_in_three_periods_is_found_wherever_the_run_ends(multiple):
    system, period, state = THREE
    for periods in (40, 41, 42, 40.3, 40.6, 41.1):
        run = zivi.simulate(system, (0, periods * period), state)
        orbit = zivi.periodic_orbit(system, run, multiple)
        assert (orbit.success, orbit.kind, orbit.multiple) == (True, "resting", 3)
        lifts = run.liftoffs["t"]
        np.testing.assert_allclose(np.diff(lifts[-3:]), 3 * period, rtol=1e-12)
        turns = (orbit.liftoff_time - lifts[-1]) / period
        assert abs(turns - round(turns)) < 1e-9


def test_an_orbit_with_two_rests_begins_with_one_of_them_wherever_the_run_ends():
    # the wall lifts the ball off twice in a period of the force
    force = zivi.LinearForce(gravity=1.0, amplitude=0.1)
    system = zivi.ImpactSystem(force, e=0.05, wall=zivi.HarmonicWall(1.15 / 4, 2.0))
    for turns in (4, 4.25, 4.5, 4.9):
        run = zivi.simulate(system, (0, turns * TURN), (0.5, 0))
        orbit = zivi.periodic_orbit(system, run, period=TURN)
        assert (orbit.kind, orbit.multiple) == ("resting", 1)
        first, second = np.sort(run.liftoffs["t"][-2:] % TURN)
        assert abs(orbit.liftoff_time - first) < 1e-9 < second - first
        again = zivi.simulate(system, (first, first + TURN), (0.0, 0.0)).impacts["xdot_after"]
        np.testing.assert_allclose(orbit.impacts["u"][0], again[0])
        np.testing.assert_allclose(np.max(orbit.impacts["u"]), np.max(again))


def test_a_run_that_rested_and_left_for_another_motion_shows_that():
    # the table that rests at e = 0.5 is one where the ball bounces from a fast start
    fast = zivi.simulate(table(), (0, 20 * TURN), (0.05, 2.0))
    rested = zivi.simulate(table(), (0, 3 * TURN), (0.5, 0.0))
    both = run_like(
        np.column_stack([fast.impacts["t"], fast.impacts["xdot_after"]]), fast.t[-1],
        rested.zeno["t"][:1],
    )  # fmt: skip
    guess = from_run(both, None)
    assert guess.rest == rested.zeno["t"][0]
    assert guess.rest + TURN < guess.end
    assert guess.multiple == 1 == len(guess.y)


def test_flights_of_many_periods_and_between_impacts():
    force = zivi.LinearForce(gravity=-0.2, stiffness=0.04, damping=0.2, amplitude=1.0)
    swing = zivi.ImpactSystem(force, e=0.5)
    run = zivi.simulate(swing, (0, 30 * TURN), (9, 0))
    flight = zivi.periodic_orbit(swing, run, period=TURN / 3)
    assert (flight.success, flight.kind, flight.multiple) == (True, "flight", 3)
    for part in range(6):
        run = zivi.simulate(table(), (0, (90 + part / 6) * TURN), (0.05, 2.0))
        orbit = zivi.periodic_orbit(table(), run, period=TURN / 6)
        assert (orbit.success, orbit.kind, orbit.multiple) == (True, "impacting", 6)
        assert len(orbit.impacts) == 1


def test_an_orbit_that_a_run_does_not_show_says_what_it_shows():
    run = zivi.simulate(table(2.9, 0.8), (0, 50.3 * TURN), (0.1, 1.0))
    orbit = zivi.periodic_orbit(table(2.9, 0.8), run, 1)
    assert not orbit.success
    assert "The last period of the run holds " in orbit.message
    assert orbit.message.endswith("; give multiple=, or a longer run.")


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
    assert (guess.rest, guess.multiple) == (resting.liftoff_time - 0.5 * resting.margin, 1)
    assert not len(guess.y)
    impacting = zivi.periodic_orbit(table(), [(0.6, 2.1)])
    guess = start.guess_of(table(), impacting, None, TURN, PRECISE)
    assert (guess.rest, guess.multiple, guess.start) == (None, 1, 0.0)
    np.testing.assert_array_equal(guess.y, impacting._y)
    assert start.guess_of(table(), impacting, 4, TURN, PRECISE).multiple == 4
    # a state with a multiple: the impacts of one period of the motion
    guess = start.guess_of(table(), (0.5, (0.05, 2.0)), 2, TURN, PRECISE)
    run = zivi.simulate(table(), (0.5, 0.5 + 2 * TURN), (0.05, 2.0), PRECISE)
    np.testing.assert_array_equal(guess.y[:, 0], run.impacts["t"])
    np.testing.assert_array_equal(guess.y[:, 1], run.impacts["xdot_after"])
    assert (guess.multiple, guess.rest) == (2, None)
    rests = start.guess_of(table(), (0.0, (0.5, 0.0)), 1, TURN, PRECISE)
    assert (rests.multiple, rests.y.shape) == (1, (0, 2))
    assert 0 < rests.rest < TURN
    high = start.guess_of(table(), (0.25, (900.0, 0.0)), 3, TURN, PRECISE)
    assert (high.start, high.multiple, high.rest) == (0.25, 3, None)
    np.testing.assert_array_equal(high.y, [900.0, 0.0])


# orbits without a period


@pytest.mark.parametrize("k", [1, 2, 3])
def test_after_how_many_impacts_free_motions_repeat(k):
    steps = np.tile(np.arange(1.0, k + 1), 12)[: 7 * k]
    rows = np.column_stack([np.cumsum(steps), 10 + steps])
    assert free._free_repeats(rows) == k
    assert free._free_repeats(rows[-k - 1 :]) == 1 or k == 1
    for size in (1e-5, 1e-3):
        noise = size * np.random.default_rng(4).normal(size=(7 * k, 2))
        assert free._free_repeats(rows + noise) == k
    assert free._free_repeats(np.column_stack([np.arange(9.0) ** 3, np.arange(9.0) ** 2])) == 1


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
    assert (guess.multiple, guess.rest) == (1, None)
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
    assert (rests.rest, rests.multiple) == (10.0, 1)
    assert rests.y.shape == (0, 2)
    assert free._flight(drop, -3.0) == pytest.approx(6.0)
    assert free._flight(drop, 200.0) == pytest.approx(400.0)
    away = zivi.ImpactSystem(zivi.LinearForce(gravity=-1.0), e=0.5)
    with pytest.raises(ValueError, match="followed by no other within 10000 s"):
        free._flight(away, 1.0)
