"""What runs, states and arrays show of an orbit, and periods that are not known."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

import zivi
from inside import (
    PRECISE,
    is_free,
    orbits_attractor as attractor,
    orbits_start as find,
    recent,
    repeating,
    word_of_rows,
)
from orbit_tables import THREE, TURN, table

DONE = zivi.OrbitStatus.COMPLETED


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


@pytest.mark.parametrize("m", [1, 2, 3, 5])
def test_after_how_many_periods_states_repeat(m):
    states = np.tile(np.column_stack([np.arange(1.0, m + 1), np.ones(m)]), (8, 1))
    assert repeating(states) == m
    random = np.random.default_rng(4).normal(size=states.shape)
    for size in (1e-5, 1e-3):
        assert repeating(states + size * random) == m
    assert repeating(np.random.default_rng(5).normal(size=(30, 2))) is None


def shown_by(amplitude: float, periods: float, multiple: int | None = None) -> Any:
    run = zivi.simulate(table(amplitude), (0, periods * TURN), (0.1, 2.0))
    frame, x, count, told = recent(table(amplitude), run, multiple, TURN, False, PRECISE)
    return frame, x, count, told, run


@pytest.mark.parametrize("part", [0.0, 0.2, 0.5, 0.9])
def test_what_the_end_of_a_run_shows(part):
    # two impacts in two periods, wherever the run ends: its times and speeds
    frame, x, count, told, run = shown_by(1.6, 120 + part)
    assert (count, [it.kind for it in frame.word]) == (2, ["I", "I"])
    assert told == "The last 2 periods of the run hold 2 impacts; give multiple=, or a longer run."
    late = run.resolved_impacts[-6:]
    for t, u in zip(x[:, -1], np.roll(x[:, 2], -1), strict=True):
        off = np.abs((late["t"] - t + 0.5) % (2 * TURN) - 0.5) + np.abs(late["xdot_after"] - u)
        assert off.min() < 1e-6
    np.testing.assert_allclose(x[1, 0], x[0, -1])
    assert 0 <= x[0, -1] < 2 * TURN
    # as many periods as are asked for
    frame, _, count, told, _ = shown_by(1.6, 120 + part, 4)
    assert (count, len(frame.word)) == (4, 4)
    assert told.startswith("The last 4 periods of the run hold 4 impacts; give multiple=")


def test_a_run_that_repeats_nowhere_says_so():
    run = zivi.simulate(table(2.9, 0.8), (0, 320), (0.1, 1))
    _, _, count, told = recent(table(2.9, 0.8), run, None, TURN, False, PRECISE)
    assert told.startswith("The last ")
    assert told.endswith(", and nothing repeats to a hundredth; give multiple=, or a longer run.")
    assert count <= 4


def test_a_run_without_recent_impacts_is_a_flight():
    force = zivi.LinearForce(stiffness=1.0, damping=0.1, gravity=-2.0, amplitude=0.3, omega=0.7)
    swing, period = zivi.ImpactSystem(force, e=0.5), TURN / 0.7
    # x = 2 + (F/D) cos(w t - phase)
    gain = 1.0 / complex(1 - 0.7**2, 0.1 * 0.7)
    for end in (200.0, 203.1, 207.9):
        orbit = zivi.periodic_orbit(swing, zivi.simulate(swing, (0, end), (9, 0)))
        assert (orbit.kind, orbit.multiple, orbit.status) == ("flight", 1, DONE)
        run = orbit.trajectory
        exact = 2 + 0.3 * (gain * np.exp(0.7j * run.t[0])).real
        assert run.x[0] == pytest.approx(exact, abs=1e-9)
        assert 0 <= run.t[0] < period
    # a short run goes on, here to a motion that rests in each period
    short = zivi.simulate(table(), (0, 0.9 * TURN), (0.5, 0.0))
    assert zivi.periodic_orbit(table(), short).kind == "resting"
    # without its dense output, too
    states = zivi.simulate(table(1.6), (0, 800), (0.1, 2.0), dense_output=False)
    orbit = zivi.periodic_orbit(table(1.6), states)
    assert (orbit.kind, orbit.multiple, orbit.status) == ("impacting", 2, DONE)


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
    # a wall that stays, from a time on, lets the ball of the table bounce as fast as it does
    fast = zivi.periodic_orbit(table(), [(0.6, 2.1)])
    rested = zivi.simulate(table(), (0, 20 * TURN), (0.5, 0.0))
    t, u = fast.impacts[0][["t", "u"]]
    after = zivi.simulate(table(), (20 * TURN + t, 60 * TURN), (0.0, u))
    both = dataclasses.replace(
        after, zeno_times=np.append(rested.zeno_times, after.zeno_times),
        liftoff_times=np.append(rested.liftoff_times, after.liftoff_times),
    )  # fmt: skip
    orbit = zivi.periodic_orbit(table(), both)
    assert (orbit.kind, orbit.multiple) == ("impacting", 1)
    assert orbit.impacts["u"][0] == pytest.approx(u, abs=1e-9)


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
    np.testing.assert_array_equal(find.rows_of(made), [[1, 3], [2, 4]])
    assert find.rows_of(made).dtype == float
    np.testing.assert_array_equal(find.rows_of(made[["t", "xdot_after"]]), [[1, 5], [2, 6]])
    np.testing.assert_array_equal(find.rows_of([(1, 2), (3, 4)]), [[1.0, 2], [3, 4]])
    for bad in ([1.0, 2.0], [[1.0, 2.0, 3.0]], np.empty((0, 2))):
        with pytest.raises(ValueError, match=r"start must have rows \(t, u\), got an array"):
            find.rows_of(bad)
    for bad in ([(1, 2), (1, 3)], [(2, 2), (1, 3)], [(math.nan, 2)], [(1, math.inf)]):
        with pytest.raises(ValueError, match=r"finite rows .* at increasing times"):
            find.rows_of(bad)


def test_rows_count_periods():
    for times, multiple in (
        ([0.1], 1),
        ([0.1, 0.1 + 0.9 * TURN], 1),
        ([0.1, 0.1 + 1.1 * TURN], 2),
        ([0.1, 3, 0.1 + 2.5 * TURN], 3),
        ([0.1, 0.1 + TURN], 1),
    ):
        rows = [(t, 1.0) for t in times]
        assert zivi.periodic_orbit(table(), rows, max_iter=1).multiple == multiple
        assert zivi.periodic_orbit(table(), rows, 7, max_iter=1).multiple == 7


def test_starts_from_orbits_and_states():
    resting = zivi.periodic_orbit(table(), (0.0, (0.5, 0.0)))
    moved = zivi.periodic_orbit(table(1.35), resting)
    assert (moved.kind, moved.status) == ("resting", DONE)
    assert moved.liftoff_time == pytest.approx(math.asin(1 / 1.35), abs=1e-12)
    impacting = zivi.periodic_orbit(table(), [(0.6, 2.1)])
    moved = zivi.periodic_orbit(table(1.31), impacting)
    assert (moved.status, moved.iterations <= 4) == (DONE, True)
    # a state with a multiple: the impacts of these periods, of a motion that never settles
    single_one = impacting.trajectory
    state = (float(single_one.t[0]) + 1.0, single_one(single_one.t[0] + 1.0))
    orbit = zivi.periodic_orbit(table(), state, 1)
    assert (orbit.status, orbit.iterations) == (DONE, 0)
    np.testing.assert_allclose(orbit.impacts["t"], impacting.impacts["t"], rtol=1e-10)
    rests = zivi.periodic_orbit(table(), (0.0, (0.5, 0.0)), 1)
    assert (rests.kind, rests.multiple) == ("resting", 1)


# orbits without a period


def test_unknowns_of_free_orbits():
    rows = np.array([[3.0, 1.0], [5.0, 2.0]])
    word, y = word_of_rows(SWING, PRECISE, rows, 4.5, free=True)
    np.testing.assert_array_equal(y, [4.5, 0, 1, 2, 2, 0, 2, 4.5])
    np.testing.assert_array_equal(rows, [[3.0, 1.0], [5.0, 2.0]])
    x, length = word.split(y)
    np.testing.assert_array_equal(x, [[0, 0, 1, 2], [2, 0, 2, 4.5]])
    assert length == 4.5
    word, y = word_of_rows(SWING, PRECISE, np.array([1.0, 0.0]), 7.0, free=True)
    x, length = word.split(y)
    np.testing.assert_array_equal(x, [[0, 1, 0, 7]])
    assert length == 7.0


SWING = zivi.ImpactSystem(zivi.LinearForce(stiffness=1, damping=-0.1, gravity=-1), e=0.8)


def test_the_last_turn_of_a_motion_without_impacts():
    cycle = zivi.ImpactSystem(lambda t, x, v: 0.5 * (1 - (x - 4) ** 2) * v - (x - 4), e=0.5)
    run = zivi.simulate(cycle, (0, 90), (4.5, 0.0))
    orbit = zivi.periodic_orbit(cycle, run)
    assert (orbit.kind, orbit.status, orbit.multiple) == ("flight", DONE, 1)
    highest = orbit.trajectory
    assert highest.xdot[0] == pytest.approx(0, abs=1e-9)
    t = np.linspace(90 - orbit.period, 90, 4001)
    assert highest.x[0] == pytest.approx(run(t)[0].max(), abs=1e-5)
    np.testing.assert_allclose(run(90.0), run(90 - orbit.period), atol=1e-5)
    with pytest.raises(ValueError, match="does not show two equal events or two equal maxima"):
        zivi.periodic_orbit(cycle, zivi.simulate(cycle, (0, 5), (4.5, 0.0)))


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
        assert find.is_autonomous(system) is alone
        assert is_free(system, None, None) is alone
        assert is_free(system, 2.0, None) is False
    assert is_free(zivi.ImpactSystem(drag, e=0.5), "free", 1)
    for period, multiple, match in (
        ("sometimes", None, "or 'free', got 'sometimes'"),
        ("free", 2, "multiple must be None"),
    ):
        with pytest.raises(ValueError, match=match):
            is_free(zivi.ImpactSystem(drag, e=0.5), period, multiple)
    with pytest.raises(ValueError, match="cannot be 'free'"):
        is_free(table(), "free", None)


def test_starts_of_free_motions():
    orbit = zivi.periodic_orbit(SWING, (0.0, (0.5, 0.0)))
    again = zivi.periodic_orbit(SWING, orbit)
    assert (again.status, again.iterations) == (DONE, 0)
    u = orbit.impacts["u"][0]
    run = zivi.simulate(SWING, (0, 800), (0.5, 0.0))
    for start in ([(7.0, u)], run, (3.0, (0.5, 0.0))):
        other = zivi.periodic_orbit(SWING, start)
        assert (other.status, other.multiple) == (DONE, 1)
        assert other.period == pytest.approx(orbit.period, rel=1e-9)
    drop = zivi.ImpactSystem(zivi.LinearForce(gravity=1.0), e=0.5)
    rests = zivi.periodic_orbit(drop, (0.0, (0.5, 0.0)))
    assert (rests.status, rests.multiple) == (zivi.OrbitStatus.RESTS, 1)
    assert find._flight(drop, -3.0) == pytest.approx(6.0)
    assert find._flight(drop, 200.0) == pytest.approx(400.0)
    away = zivi.ImpactSystem(zivi.LinearForce(gravity=-1.0), e=0.5)
    with pytest.raises(ValueError, match="no impact follows the last one within 10000 s"):
        find._flight(away, 1.0)
