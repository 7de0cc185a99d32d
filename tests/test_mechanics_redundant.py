"""Contacts of which several follow from the others; what contradicts itself ends a run."""

import math

import numpy as np
import pytest

import zivi

METHOD = zivi.SwitchedRK(rtol=1e-9, atol=1e-10)
G = 9.81
FEET = [zivi.LinearGap([1, x], name=f"foot {x}") for x in (-1.0, -0.4, 0.4, 1.0)]
FALL = math.sqrt(2 * 0.5 / G)
"""From a height of 0.5."""


def table(e):
    """A table on four legs in the plane: height and angle."""
    return zivi.MechanicalSystem(mass=np.diag([1.0, 0.3]), force=[-G, 0], gaps=FEET, e=e)


def ball(e, force=(0.0, -G)):
    """A ball in a corner of three walls that is symmetric."""
    s, c = math.sin(1), math.cos(1)
    walls = [("floor", [0, 1]), ("left", [s, c]), ("right", [-s, c])]
    gaps = [zivi.LinearGap(normal, name=name) for name, normal in walls]
    return zivi.MechanicalSystem(mass=np.eye(2), force=force, gaps=gaps, e=e)


def ramp():
    """A mass slides along a floor to where a ramp and a wall begin."""
    gaps = [
        zivi.LinearGap([0, 1], name="floor"),
        zivi.LinearGap([-1, 1], 1.0, name="ramp"),
        zivi.LinearGap([-1, 0], 1.0, name="wall"),
    ]
    return zivi.MechanicalSystem(mass=np.eye(2), force=[0, -G], gaps=gaps, e=0.5)


def press():
    """A mass on the ground, and a press that comes down on it: nowhere to go."""
    gaps = [
        zivi.LinearGap([1], name="ground"),
        zivi.Gap(lambda t, q: 1 - t - q[0], [-1.0], rate=-1.0, name="press"),
    ]
    return zivi.MechanicalSystem(mass=1.0, force=[-G], gaps=gaps, e=0.5)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(
    "start", [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, -1.0), (0.5, 0.1, 0.0)]
)
def test_a_table_on_four_legs_moves_as_one_on_two(e, start):
    """Legs between others take no part in the motion."""
    height, angle, speed = start
    state = ([height, angle], [speed, 0.0])
    four = zivi.simulate(table(e), (0, 1.5), state, METHOD)
    outer = zivi.MechanicalSystem(mass=np.diag([1.0, 0.3]), force=[-G, 0], gaps=FEET[::3], e=e)
    two = zivi.simulate(outer, (0, 1.5), state, METHOD)
    assert four.success, four.message
    times = np.linspace(0, 1.5, 61)
    assert np.abs(four(times) - two(times)).max() < 1e-7
    resting = four.contacts.all(axis=1)
    assert resting[-1] == (e < 1 or not any(start))
    # the least forces that hold it: those of equal springs
    assert four.reactions[resting] == pytest.approx(np.full((resting.sum(), 4), G / 4))
    assert not resting.any() or "undetermined_forces" in four.flags["kind"]


def test_gaps_that_leave_no_room_end_the_run_and_lose_nothing():
    system = press()
    sol = zivi.simulate(system, (0, 3), ([0.0], [0.0]), METHOD)
    assert sol.status is zivi.Status.REDUNDANT_CONTACTS
    assert not sol.success
    assert "no forces keep all gaps closed" in sol.message
    assert sol.message.endswith("touch: 'ground', 'press'.")
    assert sol.t[-1] == pytest.approx(1.0, abs=1e-9)
    # the trajectory holds up to there, and can be evaluated
    assert sol.t[0] == 0
    assert np.all(np.isfinite(sol.q))
    assert sol(sol.t[-1])[0] == pytest.approx(sol.q[-1], abs=1e-12)
    there = system.at(sol.t[-1], sol.q[-1], sol.qdot[-1])
    assert there.gaps == pytest.approx(np.zeros(system.m), abs=1e-9)


def test_a_table_may_bounce_on_two_legs_or_leave():
    # no more than two feet touch at a time
    up = zivi.simulate(table(0.5), (0, 0.3), ([0, 0], [3.0, 0]), METHOD)
    assert up.success
    assert up.q[-1, 0] == pytest.approx(3 * 0.3 - G * 0.045, abs=1e-9)
    elastic = zivi.simulate(table(1.0), (0, 1.5), ([0.5, 0.1], [0, 0]), METHOD)
    assert elastic.success
    energy = elastic.qdot**2 @ [0.5, 0.15] + G * elastic.q[:, 0]
    assert np.ptp(energy) < 1e-9


@pytest.mark.parametrize("start", [([0, 0.5], [0, 0]), ([0, 0], [0, 0]), ([0.05, 0.5], [0.1, 0])])
def test_one_wall_too_many_leaves_the_motion_determined(start):
    sol = zivi.simulate(ball(0.5), (0, 3), start, METHOD)
    assert sol.success, sol.message
    assert np.abs(sol.q[-1]).max() < 1e-50
    assert sol.contacts[-1].all()
    normals = np.array([[0, 1], [math.sin(1), math.cos(1)], [-math.sin(1), math.cos(1)]])
    assert sol.reactions[-1] @ normals == pytest.approx([0, G], abs=1e-12)
    assert np.all(sol.reactions[-1] > 0)
    assert "undetermined_forces" in sol.flags["kind"]
    if start == ([0, 0.5], [0, 0]):
        assert sol.zeno["t"] == pytest.approx(np.full(3, 3 * FALL), abs=1e-9)


def test_a_wall_behind_a_ramp_changes_nothing():
    """The wall is hit with 1 m/s and gives back a half; the ramp wants no more."""
    sol = zivi.simulate(ramp(), (0, 3), ([0, 0], [1, 0]), METHOD)
    assert sol.success, sol.message
    assert sol.q[-1] == pytest.approx([0, 0], abs=1e-12)
    assert sol.qdot[-1] == pytest.approx([-0.5, 0], abs=1e-12)


def test_a_corner_of_two_of_the_walls_is_none():
    # without the floor the ball rests
    walls = ball(0.5).gaps[1:]
    free = zivi.MechanicalSystem(mass=np.eye(2), force=[0, -G], gaps=walls, e=0.5)
    sol = zivi.simulate(free, (0, 3), ([0.05, 0.5], [0.1, 0]), METHOD)
    assert sol.success
    assert sol.contacts[-1].all()
    assert sol.reactions[-1] == pytest.approx(np.full(2, G / (2 * math.cos(1))), rel=1e-9)
