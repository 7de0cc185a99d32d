"""Events of branches of mechanical systems at which contacts open, begin, or impacts coincide."""

import numpy as np
import pytest

import zivi
from orbit_systems import REFERENCES, rest2, shaker
from zivi.orbits.mechanical.find import weaker_reason

LIFTS = "L road Z road"


@pytest.fixture(scope="module")
def reopened():
    orbit = zivi.periodic_orbit(rest2(), zivi.simulate(rest2(), (0, 200), ([2, 2], [0, 0])))
    return zivi.continue_orbit(orbit, "road.amplitude", (1.2, 1.68), step=0.1)


def test_a_contact_whose_force_vanishes_opens_for_a_short_time(reopened):
    assert reopened.words == [LIFTS, f"{LIFTS} {LIFTS}"]
    assert reopened.status is zivi.OrbitStatus.RANGE_END
    (end,) = reopened.of_kind("contact_ends")
    # all points are motions: a simulation has the same impacts, contacts and lift-offs
    for orbit, value in zip(reopened.orbits, reopened.values, strict=True):
        assert value == end.value or weaker_reason(orbit) is None
    # the contact opens for a time that goes like the root of the distance
    beyond = reopened.arcs[1]
    flights = [np.min(it.segments["t1"] - it.segments["t0"]) for it in beyond.orbits]
    ratios = np.array(flights) ** 2 / (beyond.values - end.value)
    assert np.ptp(ratios[:6]) < 0.005 * ratios[0]


def test_the_gap_that_opens_is_hit_after_four_parts_of_the_time_that_the_force_pulls(reopened):
    """Of g'' ~ r^2 - s^2 from s = -r the solution (s + r)^3 (3 r - s) vanishes at 3 r."""
    end, beyond = reopened.of_kind("contact_ends")[0], reopened.arcs[1]
    orbit, before = beyond.orbits[0], reopened.arcs[0].orbits[-1]
    # on the word without the flight, at the same parameter, the force is negative for 2 r
    same = zivi.periodic_orbit(orbit.system, before)
    assert not same.admissible
    s = next(k for k, it in enumerate(same._word) if it.contacts)
    flow, t0, t1 = same._frame.flow, *same.segments[["t0", "t1"]][s]
    times = np.linspace(t0, t1, 20_001)
    force = flow.reactions((0,), times, flow.path((0,), t0, same._starts[s, 1:], times))[:, 0]
    pulls = times[1:-1][force[1:-1] < 0.0]
    flight = np.min(orbit.segments["t1"] - orbit.segments["t0"])
    # the force bends a little over the flight
    assert abs(flight / (0.5 * np.ptp(pulls)) - 4.0) < 0.2
    assert end.value < beyond.values[0] < end.value + 0.01


@pytest.mark.slow
def test_rest_appears_where_a_chain_of_impacts_is_no_longer_thrown_off():
    critical = float(REFERENCES["end_of_rest"]["points"]["0.5"].split()[0])
    rests = zivi.periodic_orbit(shaker(1.5), zivi.simulate(shaker(1.5), (0, 60), ([0.5], [0.0])))
    branch = zivi.continue_orbit(rests, "road.amplitude", (1.5, 1.7), step=0.1)
    (end,) = branch.of_kind("end_of_rest")
    thrown = branch.switch(end)
    assert (thrown.kind, thrown.success) == ("impacting", True)
    assert end.value < zivi.orbits.mechanical.family.value_of(thrown.system, "road.amplitude")
    span = (1.55, 1.61)
    back = zivi.continue_orbit(thrown, "road.amplitude", span, step=0.1, max_points=60)
    (appears,) = back.of_kind("rest_appears")
    assert abs(appears.value - critical) < 2e-11
    # and goes on with the orbit that rests
    assert back.words[-2:] == ["8I road", "Z road L road"]
    assert all(orbit.admissible for orbit in back.arcs[-1].orbits)
    assert np.all(np.diff(back.arcs[-1].values) < 0.0)


def pair(stiffness=1.0, coupling=0.0, far=0.5):
    spring = [[1 + coupling, -coupling], [-coupling, stiffness + coupling]]
    gaps = [zivi.LinearGap([-1, 0], 0.5, name="a"), zivi.LinearGap([0, -1], far, name="b")]
    load = zivi.Harmonic([1.0, 1.0], 0.8)
    return zivi.LinearSystem(np.eye(2), 0.1 * np.eye(2), spring, excitation=load, gaps=gaps, e=0.6)


def test_impacts_at_once_of_gaps_that_do_not_feel_each_other_are_two_letters():
    run = zivi.simulate(pair(), (0, 800), ([0, 0], [0, 0]))
    both = zivi.periodic_orbit(pair(), run)
    assert both.success
    assert sorted(both.impacts["gap"]) == [0, 0, 1, 1]
    # each alone
    one = zivi.LinearSystem(
        [[1.0]],
        [[0.1]],
        [[1.0]],
        excitation=zivi.Harmonic([1.0], 0.8),
        gaps=[zivi.LinearGap([-1], 0.5, name="a")],
        e=0.6,
    )
    alone = zivi.periodic_orbit(one, zivi.simulate(one, (0, 800), ([0], [0])))
    times = np.sort(both.impacts["t"][both.impacts["gap"] == 1] % both.period)
    assert np.max(np.abs(times - np.sort(alone.impacts["t"] % alone.period))) < 1e-11
    for value in alone.multipliers:
        assert np.sum(np.abs(both.multipliers - value) < 1e-9) == 2


def test_a_branch_passes_impacts_that_change_places():
    system = pair(1.3)
    orbit = zivi.periodic_orbit(system, zivi.simulate(system, (0, 800), ([0, 0], [0, 0])))
    branch = zivi.continue_orbit(orbit, "b.offset", (0.4, 1.6))
    swaps = branch.of_kind("simultaneous")
    assert swaps
    assert branch.status is not zivi.OrbitStatus.SIMULTANEOUS
    assert all(orbit.admissible for orbit in branch.orbits)
    # the other gap does not notice: its impacts are where they were
    (before, *_), (*_, after) = (
        [it.orbits[0], it.orbits[-1]] for it in (branch.arcs[0], branch.arcs[-1])
    )
    times = [np.sort(it.impacts["t"][it.impacts["gap"] == 0] % it.period) for it in (before, after)]
    assert np.max(np.abs(times[0] - times[1])) < 1e-10


def test_an_impact_that_grazes_is_not_taken_for_a_new_one():
    """Where it would open the gap is below zero before it, which is the same event."""
    system = pair(1.3, 0.05)
    orbit = zivi.periodic_orbit(system, zivi.simulate(system, (0, 800), ([0.1, 0], [0, 0])))
    branch = zivi.continue_orbit(orbit, "b.offset", (0.4, 1.6))
    assert branch.status is zivi.OrbitStatus.RANGE_END
    last = branch.events[-1]
    assert (last.kind, last.gap) == ("grazing", "b")
    assert branch.words[-2:] == ["2I a I b", "2I a"]
    # beyond it a run hits the other gap only
    far = pair(1.3, 0.05, 1.02 * last.value)
    beyond = zivi.periodic_orbit(far, zivi.simulate(far, (0, 800), ([0.1, 0], [0, 0])))
    assert set(beyond.impacts["gap"]) == {0}
    assert all(orbit.admissible for orbit in branch.orbits)


def test_a_corner_in_an_orbit_has_no_derivatives():
    # a block on two feet falls flat: both gaps come to rest at once, in every period
    gaps = [
        zivi.LinearGap([1, 0.5], 0.0, name="left"),
        zivi.LinearGap([1, -0.5], 0.0, name="right"),
    ]
    load = [zivi.Harmonic([2.5, 0.0], 1.0), np.array([-1.0, 0.0])]
    block = zivi.LinearSystem(
        np.diag([1.0, 0.1]), None, np.zeros((2, 2)), excitation=load, gaps=gaps, e=0.3
    )
    run = zivi.simulate(block, (0, 60), ([0.2, 0.0], [0.0, 0.0]))
    orbit = zivi.periodic_orbit(block, run)
    assert orbit.status is zivi.OrbitStatus.NOT_DIFFERENTIABLE
    assert not orbit.success
    assert "at once" in orbit.message
    with pytest.raises(ValueError, match="not found"):
        zivi.continue_orbit(orbit, "omega", (0.9, 1.1))
    with pytest.raises(ValueError, match="no orbit"):
        orbit.derivative("omega")


def coupled():
    gaps = [zivi.LinearGap([-1, 0.2], 0.5, name="a"), zivi.LinearGap([0.2, -1], 0.5, name="b")]
    load = zivi.Harmonic([1.0, 0.6], 0.8)
    return zivi.LinearSystem(
        np.eye(2), 0.1 * np.eye(2), np.eye(2), excitation=load, gaps=gaps, e=0.6
    )


def test_what_happened_at_once_in_the_transient_does_not_matter():
    system = coupled()
    run = zivi.simulate(system, (0, 800), ([0.625, 0.625], [1, 1]))
    assert list(run.impacts["gap"][:2]) == [0, 1]
    assert np.ptp(run.impacts["t"][:2]) == 0.0
    assert zivi.periodic_orbit(system, run).success
