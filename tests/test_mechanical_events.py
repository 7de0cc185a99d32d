"""Events of branches of mechanical systems at which contacts open, begin, or impacts coincide."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import zivi
from inside import value_of, weaker_reason
from orbit_systems import REFERENCES, rest2, shaker

LIFTS = "L road Z road"


@pytest.fixture(scope="module")
def reopened():
    orbit = zivi.periodic_orbit(rest2(), zivi.simulate(rest2(), (0, 200), ([2, 2], [0, 0])))
    return zivi.continue_orbit(orbit, "road.amplitude", (1.2, 1.68), step=0.1)


def test_a_contact_whose_force_vanishes_opens_for_a_short_time(reopened):
    assert reopened.words == [LIFTS, f"{LIFTS} {LIFTS}"]
    assert reopened.status is zivi.OrbitStatus.RANGE_END
    (end,) = reopened.of_kind("contact_ends")
    # of a computation with 20 digits, impact by impact; the reference has another value, 1.64693,
    # where this force is negative
    assert abs(end.value - 1.646465182462063986) < 1e-12
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


def test_an_opened_contact_closes_again_on_the_way_back(reopened):
    last = reopened.arcs[1].orbits[-1]
    back = zivi.continue_orbit(last, "road.amplitude", (1.55, 1.68), step=0.1)
    assert back.words == [LIFTS, f"{LIFTS} {LIFTS}"]
    assert back.status is zivi.OrbitStatus.RANGE_END
    there, again = reopened.of_kind("contact_ends")[0], back.of_kind("contact_ends")[0]
    assert abs(again.value - there.value) < 1e-11
    for orbit, value in zip(back.orbits, back.values, strict=True):
        assert value == again.value or weaker_reason(orbit) is None


@pytest.mark.slow
def test_rest_appears_where_a_chain_of_impacts_is_no_longer_thrown_off():
    critical = float(REFERENCES["end_of_rest"]["points"]["0.5"].split()[0])
    rests = zivi.periodic_orbit(shaker(1.5), zivi.simulate(shaker(1.5), (0, 60), ([0.5], [0.0])))
    branch = zivi.continue_orbit(rests, "road.amplitude", (1.5, 1.7), step=0.1)
    (end,) = branch.of_kind("end_of_rest")
    thrown = branch.switch(end)
    assert (thrown.kind, thrown.success) == ("impacting", True)
    assert end.value < value_of(thrown.system, "road.amplitude")
    span = (1.55, 1.61)
    back = zivi.continue_orbit(thrown, "road.amplitude", span, step=0.1, max_points=60)
    (appears,) = back.of_kind("rest_appears")
    assert abs(appears.value - critical) < 2e-11
    # and goes on with the orbit that rests
    assert back.words[-2:] == ["8I road", "Z road L road"]
    assert all(orbit.admissible for orbit in back.arcs[-1].orbits)
    assert np.all(np.diff(back.arcs[-1].values) < 0.0)


def pressed(c, floor=0.0):
    """A body on a floor, coupled by inertia to another one that hits a stop."""
    return zivi.LinearSystem(
        [[1.0, c], [c, 1.0]],
        np.diag([0.1, 0.1]),
        np.diag([0.5, 1.0]),
        excitation=[np.array([-1.0, 0.0]), zivi.Harmonic([0.0, 0.5], 1.3)],
        gaps=[
            zivi.LinearGap([1, 0], 0.0, name="floor"),
            zivi.LinearGap([0, -1], 0.3, name="stop"),
        ],
        e=[floor, 0.5],
    )


def own_pressed(c, periods=60):
    """Integrate it, with a plastic floor: phases of the impact at the stop, and of the landing.

    An impulse P of the stop moves the body by (1 + e) c v, and the floor takes that back.
    """
    inertia = np.array([[1.0, c], [c, 1.0]])

    def free(t, z):
        push = np.array([-1.0, 0.5 * np.cos(1.3 * t)]) - 0.1 * z[2:] - [0.5, 1.0] * z[:2]
        return np.append(z[2:], np.linalg.solve(inertia, push))

    def held(t, z):
        return [0.0, z[3], 0.0, 0.5 * np.cos(1.3 * t) - 0.1 * z[3] - z[1]]

    def stop(t, z):
        return 0.3 - z[1]

    def floor(t, z):
        return z[0] if t > since + 1e-7 else 1.0  # not at its start

    stop.terminal = floor.terminal = True
    stop.direction = floor.direction = -1
    t, since, z, closed, hits, lands = 0.0, 0.0, np.zeros(4), True, [], []
    end = periods * 2 * np.pi / 1.3
    while t < end:
        events = [stop] if closed else [stop, floor]
        found = solve_ivp(
            held if closed else free, (t, end), z, "DOP853", events=events, rtol=1e-12, atol=1e-13
        )
        t, z = float(found.t[-1]), found.y[:, -1].copy()
        if len(found.t_events[0]):
            hits.append(t)
            since, v = t, z[3]
            z[1:] = [0.3, max(0.0, c * 1.5 * v), -0.5 * v]
            closed = c <= 0.0
        elif not closed and len(found.t_events[1]):
            lands.append(t)
            z = np.array([0.0, z[1], 0.0, z[3] + c * z[2]])
            closed = True
    return hits[-1], lands[-1] if lands else None


@pytest.mark.parametrize("floor", [0.0, pytest.param(0.4, marks=pytest.mark.slow)])
def test_an_impact_opens_a_contact_where_its_impulse_there_vanishes(floor):
    """The coupling alone decides it, at c = 0, from both sides."""
    branches = []
    for start in (-0.2, 0.2):
        system = zivi.ParametricSystem(lambda c: pressed(c, floor), {"c": start})
        run = zivi.simulate(system, (0, 500), ([0, 0], [0, 0]))
        orbit = zivi.periodic_orbit(system, run)
        branches.append(zivi.continue_orbit(orbit, "c", (-0.25, 0.25)))
    back = "S floor" if floor == 0.0 else "Z floor"
    for branch in branches:
        assert branch.words == ["I stop", f"I stop {back}"]
        assert branch.status is zivi.OrbitStatus.RANGE_END
        (event,) = branch.events
        assert (event.kind, event.gap) == ("opening", "floor")
        assert abs(event.value) < 1e-12
        for orbit in branch.orbits:
            assert weaker_reason(orbit) is None
    # the flight begins with the speed 1.5 c v, and the floor pulls back with 1: a parabola
    orbit = branches[0].arcs[1].orbits[0]
    c = branches[0].arcs[1].values[0]
    s = next(k for k, it in enumerate(orbit._word) if it.gap == 0)
    flight = np.ptp([orbit.segments["t0"][s], orbit.segments["t1"][s]])
    speed = orbit._starts[s, 3]
    assert speed == pytest.approx(1.5 * c * -orbit._starts[s, 4] / 0.5, rel=1e-9)
    assert flight == pytest.approx(2 * speed, rel=0.1)


@pytest.mark.parametrize("place", [0, -1])
def test_orbits_beyond_an_opening_are_those_of_an_own_integration(place):
    system = zivi.ParametricSystem(pressed, {"c": -0.2})
    orbit = zivi.periodic_orbit(system, zivi.simulate(system, (0, 500), ([0, 0], [0, 0])))
    branch = zivi.continue_orbit(orbit, "c", (-0.2, 0.2))
    for arc in branch.arcs:
        orbit, c = arc.orbits[1 if place == 0 else place], arc.values[1 if place == 0 else place]
        hit, land = own_pressed(c)
        known = [hit] if land is None else [hit, land]
        ends = orbit.segments["t1"]
        turns = (np.array(known) - ends) / orbit.period
        assert np.max(np.abs(turns - np.round(turns))) < 1e-9


GEARS = {"J": np.array([1.0, 1.5]), "C": np.array([0.2, 0.3]), "k": 4.0, "load": 0.5}


def wheels(force=0.3, omega=2.0):
    """Two wheels with a backlash: the first one is driven on a shaft, the second one braked."""
    return zivi.LinearSystem(
        np.diag(GEARS["J"]),
        np.diag(GEARS["C"]),
        np.diag([GEARS["k"], 0.0]),
        excitation=[np.array([0.0, -GEARS["load"]]), zivi.Harmonic([force, 0.0], omega)],
        gaps=[
            zivi.LinearGap([-1, 1], 0.0, name="front"),
            zivi.LinearGap([1, -1], 0.2, name="back"),
        ],
        e=0.5,
    )


def settled_wheels(**given):
    run = zivi.simulate(wheels(**given), (0, 400), ([-0.125, -0.125], [0.1, 0.0]))
    return zivi.periodic_orbit(wheels(**given), run)


def between_events(branch):
    """Give the orbits that are not at an event, where rounding decides what a run does."""
    at = {event.value for event in branch.events}
    return [it for it, p in zip(branch.orbits, branch.values, strict=True) if p not in at]


@pytest.mark.slow
def test_wheels_go_from_contact_to_rattling_and_back():
    """In contact, on one side of the teeth, on both: one branch, from either end."""
    words = ["P", "L front Z front", "L front I back Z front"]
    ahead = zivi.continue_orbit(settled_wheels(), "F", (0.2, 1.2), step=0.1)
    back = zivi.continue_orbit(settled_wheels(force=1.1), "F", (0.2, 1.2), step=0.1)
    for branch in (ahead, back):
        assert branch.words == words
        assert branch.status is zivi.OrbitStatus.RANGE_END
        assert all(weaker_reason(orbit) is None for orbit in between_events(branch)[::4])
    ends = [it.of_kind("contact_ends")[0].value for it in (ahead, back)]
    # the force between the teeth is 0.5 + Re(Z F e^(2 i t))
    Z = (-4 * 1.5 + 2j * 0.3) / (4.0 - 4 * 2.5 + 2j * 0.5)
    assert ends == pytest.approx([0.5 / abs(Z)] * 2, abs=1e-11)
    touches = [ahead.of_kind("interior_impact")[0], back.of_kind("grazing")[0]]
    assert {it.gap for it in touches} == {"back"}
    assert abs(touches[0].value - touches[1].value) < 1e-11
    # and runs settle on it where it is stable
    for force, word in ((0.78, words[1]), (1.0, words[2])):
        assert " ".join(settled_wheels(force=force).word) == word
    for kind in ("period_doubling", "neimark_sacker"):
        values = [it.of_kind(kind)[0].value for it in (ahead, back)]
        assert abs(values[0] - values[1]) < 1e-9


@pytest.mark.slow
def test_rattling_wheels_come_to_rest_on_the_back_of_the_teeth():
    """Ever more impacts of the back, until they accumulate; those of the front always do."""
    branch = zivi.continue_orbit(
        settled_wheels(force=1.0, omega=1.5), "omega", (1.4, 1.51), step=0.1
    )
    (appears,) = branch.of_kind("rest_appears")
    assert appears.gap == "back"
    rests = "L front Z back L back Z front"
    assert {rests, "L front 8I back Z front"} <= set(branch.words)
    assert branch.status is zivi.OrbitStatus.RANGE_END
    assert all(weaker_reason(orbit) is None for orbit in between_events(branch)[::4])
    for part, word in ((1 - 3e-5, True), (1 + 3e-5, False)):
        found = settled_wheels(force=1.0, omega=part * appears.value)
        assert (" ".join(found.word) == rests) == word


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


@pytest.mark.parametrize("force", [-1.3, -1.6])
def test_a_plastic_impact_beside_a_closed_gap_is_no_corner(force):
    """Its gap is pulled away at once; two bodies that know nothing of each other move as alone."""
    push, load = zivi.Harmonic([1.0, force], 2.0), np.array([0.0, -1.0])
    gaps = [zivi.LinearGap([-1, 0], 0.2, name="a"), zivi.LinearGap([0, 1], 0.0, name="b")]
    same, e = np.eye(2), np.array([0.0, 0.3])
    both = zivi.LinearSystem(same, 0.2 * same, same, excitation=[push, load], gaps=gaps, e=e)
    run = zivi.simulate(both, (0, 400), ([0, 0.2], [0, 0]))
    assert len(run.corners) > 100
    pair = zivi.periodic_orbit(both, run)
    assert pair.success
    assert pair.word == ("I a", "L b", "Z b")
    for i, name in enumerate("ab"):
        one = zivi.LinearSystem(
            [[1.0]],
            [[0.2]],
            [[1.0]],
            excitation=[zivi.Harmonic(push.amplitude[i : i + 1], 2.0), load[i : i + 1]],
            gaps=[zivi.LinearGap([gaps[i].normal[i]], gaps[i].offset, name=name)],
            e=float(e[i]),
        )
        alone = zivi.periodic_orbit(one, zivi.simulate(one, (0, 400), ([0.2 * i], [0])))
        assert alone.success
        for letter, t in zip(alone.word, alone.segments["t1"], strict=True):
            apart = (t - pair.segments["t1"][pair.word.index(letter)]) / pair.period
            assert abs(apart - round(apart)) < 1e-11
        for value in alone.multipliers:
            assert np.min(np.abs(pair.multipliers - value)) < 1e-9


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
