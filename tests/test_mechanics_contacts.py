"""Contacts that impacts elsewhere press or open, and contacts without a force."""

import math

import numpy as np
import pytest

import zivi
from continued_runs import differences


def tilting_floor(level, rate):
    """A floor that turns about the origin and is level at a given time."""

    def cos_sin(t):
        return math.cos(rate * (t - level)), math.sin(rate * (t - level))

    def value(t, q):
        c, s = cos_sin(t)
        return q[1] * c - q[0] * s

    def gradient(t, _):
        c, s = cos_sin(t)
        return [-s, c]

    def by_time(t, q):
        c, s = cos_sin(t)
        return -rate * (q[1] * s + q[0] * c)

    def curvature(t, q, w):
        c, s = cos_sin(t)
        return -2 * rate * (w[0] * c + w[1] * s) - rate**2 * value(t, q)

    return zivi.Gap(value, gradient, curvature, by_time, name="floor")


def test_a_contact_that_impacts_begin_to_open_is_not_jumped_over():
    # a ball slides on the floor and bounces at a wall; while the floor falls towards the wall an
    # impact there presses it on the floor (c < 0), later it lifts it off (c > 0)
    level, rate, x = 1.9, 0.2, -0.3
    wall = zivi.LinearGap([-1, 0], name="wall")
    system = zivi.MechanicalSystem(
        mass=np.eye(2), force=[4, -9.81], gaps=[tilting_floor(level, rate), wall], e=[0.1, 0.7]
    )
    slope = -math.tan(rate * level)
    start = ([x, x * slope], [0.0, x * rate / math.cos(rate * level) ** 2])
    sol = zivi.simulate(system, (0, 3), start, zivi.SwitchedRK(rtol=1e-4, atol=1e-4))
    assert sol.success
    at_wall = sol.resolved_impacts["t"][sol.resolved_impacts["gap"] == 1]
    assert sol.openings["t"][0] == at_wall[at_wall > level][0]
    assert set(sol.openings["gap"]) == set(sol.zeno["gap"]) == {0}
    assert len(sol.corners) == 1


@pytest.mark.parametrize("mass", [0.7, 1.3])
def test_a_plastic_wall_holds_what_nothing_pulls_off(mass):
    # the drag at the speed that rounding leaves is no force
    system = zivi.MechanicalSystem(
        mass=mass * np.eye(2),
        force=lambda _t, _q, w: [-0.3 * w[0], -9.81 - 0.3 * w[1]],
        gaps=[zivi.LinearGap([-1, 0], 0.5, name="wall")],
        e=0.0,
    )
    for speed in np.linspace(0.6, 3, 12):
        sol = zivi.simulate(system, (0, 2), ([0, 0], [speed, 0.3]))
        assert (len(sol.zeno), len(sol.liftoffs)) == (1, 0)
        assert sol.contacts[-1, 0]


@pytest.mark.parametrize("first", range(0, 100, 25))
def test_continued_runs_have_the_lists_of_the_whole(first):
    for seed in range(first, first + 25):
        assert not differences(seed), seed


def test_a_contact_that_the_force_opens_at_once_is_listed_of_mass_and_mechanism():
    gap = zivi.LinearGap([1.0])
    still = zivi.Harmonic([1.0], 2.0)
    systems = [
        (zivi.ImpactSystem(1.0, e=0.5), (0.0, 0.0)),
        (zivi.MechanicalSystem(mass=1.0, force=[1.0], gaps=[gap], e=0.5), ([0.0], [0.0])),
        (
            zivi.LinearSystem([[1.0]], None, [[0.0]], excitation=still, gaps=[gap], e=0.5),
            ([0.0], [0.0]),
        ),
    ]
    for system, start in systems:
        sol = zivi.simulate(system, (0.5, 0.6), start)
        assert sol.liftoffs["t"].tolist() == [0.5]
        assert len(sol.zeno) == 0
    q = zivi.sensitivity(systems[1][0], (0.5, 0.6), ([0.0], [0.0]), wrt=("t0", "q0"))
    assert q.liftoff_times.tolist() == [[1.0, 0.0]]


@pytest.mark.parametrize(
    ("apart", "speeds", "flags"),
    [(0.0, (-1 / 3, 2 / 3, 2 / 3), [0.5]), (1e-6, (0, 0, 1), [])],
)
def test_an_impact_that_balls_share_which_touch_is_flagged(apart, speeds, flags):
    gaps = [zivi.LinearGap([-1, 1, 0]), zivi.LinearGap([0, -1, 1])]
    cradle = zivi.MechanicalSystem(mass=np.eye(3), force=[0, 0, 0], gaps=gaps, e=1.0)
    sol = zivi.simulate(cradle, (0, 2), ([-1, 0, apart], [1, 0, 0]))
    assert sol.qdot[-1] == pytest.approx(speeds, abs=1e-12)
    assert [row["kind"] for row in sol.flags] == ["simultaneous"] * len(flags)
    assert sol.flags["size"] == pytest.approx(flags)
    assert sol.flags["gaps"].all()
