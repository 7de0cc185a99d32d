"""Orbits have their least period, also near period doublings and with plastic impacts."""

from __future__ import annotations

import itertools
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import zivi

DONE = zivi.OrbitStatus.COMPLETED
FOLD = math.pi / 3
DOUBLING = math.hypot(FOLD, 10 / 9)
PLASTIC_END = math.hypot(1, math.pi)
PLASTIC_DOUBLING = math.hypot(2, math.pi)


def table(amplitude: float, e: float = 0.5) -> zivi.ImpactSystem:
    """A ball on a table, in the frame of the table."""
    force = zivi.LinearForce(gravity=1.0, amplitude=amplitude, phase=-math.pi / 2)
    return zivi.ImpactSystem(force, e=e)


def single(amplitude: float, e: float = 0.5) -> tuple[float, float]:
    """Time and speed of its orbit with one impact in one period."""
    return math.acos(math.pi * (1 - e) / ((1 + e) * amplitude)), 2 * math.pi * e / (1 + e)


@pytest.mark.parametrize("off", [-0.0045, -1e-3, -1e-5])
def test_a_run_that_has_not_settled_before_a_doubling_shows_the_single_orbit(off):
    amplitude = DOUBLING * (1 + off)
    orbit = zivi.periodic_orbit(table(amplitude), (0, (2, 2)))
    assert (orbit.status, orbit.multiple, len(orbit.impacts)) == (DONE, 1, 1)
    np.testing.assert_allclose(list(orbit.impacts[0])[:2], single(amplitude), rtol=1e-9)
    (found,) = zivi.continue_orbit(orbit, "amplitude", (1.4, 1.6)).of_kind("period_doubling")
    assert abs(found.value / DOUBLING - 1) < 1e-10


@pytest.mark.parametrize("multiple", [2, 3, 4, 6])
def test_an_orbit_written_several_times_is_given_once(multiple):
    t, u = single(1.52)
    rows = [(t + 1e-5 * (-1) ** k + 2 * math.pi * k, u) for k in range(multiple)]
    orbit = zivi.periodic_orbit(table(1.52), rows, multiple)
    assert (orbit.multiple, len(orbit.impacts), orbit.status) == (1, 1, DONE)
    assert abs(orbit.multipliers.prod() - 0.5**2) < 1e-9
    # of two periods only the double one is there at 1.6
    doubled = zivi.periodic_orbit(table(1.6), zivi.simulate(table(1.6), (0, 800), (0.1, 2)), 4)
    assert (doubled.multiple, len(doubled.impacts), doubled.status) == (2, 2, DONE)


def test_a_flight_written_several_times_is_given_once():
    # x = 2 + F cos(w t)/(1 - w^2) never meets the wall
    force = zivi.LinearForce(stiffness=1.0, damping=0.1, gravity=-2.0, amplitude=0.3, omega=0.7)
    orbit = zivi.periodic_orbit(zivi.ImpactSystem(force, e=0.5), (0.0, (2.5, 0.0)), 6)
    assert (orbit.kind, orbit.multiple, orbit.status) == ("flight", 1, DONE)


def test_a_free_orbit_written_twice_is_given_once():
    swing = zivi.ImpactSystem(zivi.LinearForce(stiffness=1, damping=-0.1, gravity=-1), e=0.8)
    once = zivi.periodic_orbit(swing, (0.0, (0.5, 0.0)))
    u = once.impacts["u"][0]
    twice = zivi.periodic_orbit(swing, [(0.0, u), (once.period * (1 + 1e-7), u)])
    assert len(twice.impacts) == 1
    assert twice.period == pytest.approx(once.period, rel=1e-10)


def test_a_doubled_branch_begins_at_the_doubling_of_the_single_one():
    branch = zivi.continue_orbit(
        zivi.periodic_orbit(table(1.5), [single(1.5)]), "amplitude", (1.4, 1.6)
    )
    doubled = branch.switch(branch.of_kind("period_doubling")[0])
    away = zivi.continue_orbit(doubled, "amplitude", (1.4, 1.56))
    assert away.status is zivi.OrbitStatus.RANGE_END
    orbit = zivi.periodic_orbit(away.orbits[-1].system, away.orbits[-1])
    assert (orbit.multiple, len(orbit.impacts)) == (2, 2)
    back = zivi.continue_orbit(orbit, "amplitude", (1.4, 1.7))
    first, second = back.of_kind("period_doubling")
    assert abs(first.value / DOUBLING - 1) < 1e-10
    assert abs(second.value - 1.667130660) < 1e-8
    # no point of the branch is the single orbit written twice, and none lies before its beginning
    assert min(np.ptp(it.impacts["u"]) for it in back.orbits) > 1e-4
    assert back.values.min() > DOUBLING
    # the event names the single orbit, which meets this branch there
    met = back.switch(first)
    assert (met.multiple, len(met.impacts)) == (1, 1)
    np.testing.assert_allclose(list(met.impacts[0])[:2], single(first.value), rtol=1e-8)
    assert back.switch(second).multiple == 4


def test_a_doubled_branch_that_only_begins_says_so():
    run = zivi.simulate(table(1.6), (0, 800), (0.1, 2))
    orbit = zivi.periodic_orbit(table(1.6), run)
    assert orbit.multiple == 2
    branch = zivi.continue_orbit(orbit, "amplitude", (1.5, 1.6))
    assert branch.status is zivi.OrbitStatus.RANGE_END
    assert [event.kind for event in branch.events] == ["period_doubling"]
    assert branch.values[-1] == 1.6


def test_what_runs_settle_on_near_a_doubling_has_its_least_period():
    # the run alternates still, by less than it is told to repeat: a slow multiplier of -0.9997
    values = DOUBLING * (1 + np.array([-1e-4, -3e-5]))
    found = zivi.bifurcation_diagram(
        table(1.5), "amplitude", values, starts=np.array([[0.05, 1.9]]), transient=3000, keep=16
    )
    kinds = [(it.kind, it.multiple, len(it.impacts)) for it in found.attractors]
    assert kinds == [("impacting", 1, 1)] * 2


def test_random_starts_near_doublings():
    # few draws of benchmarks/orbit_doublings.py, which makes 500
    sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
    import orbit_doublings

    counts = orbit_doublings.sweep(16, seed=3)
    assert counts["single"] + counts["double"] >= 8
    assert counts["unreduced"] == counts["doubling missed"] == 0
    assert counts["branch with a repeated orbit"] == 0


def test_the_resting_orbit_of_a_plastic_ball_ends_at_its_closed_form():
    # it lands at the phase at which it lifted off: F sin t = 1, F cos t = pi
    orbit = zivi.periodic_orbit(table(1.5, 0.0), (0, (0.5, 0)))
    branch = zivi.continue_orbit(orbit, "amplitude", (0.9, 4.0))
    begin, end = branch.events
    assert (begin.kind, end.kind) == ("end_of_liftoff", "end_of_rest")
    assert abs(begin.value - 1) < 1e-10
    assert abs(end.value / PLASTIC_END - 1) < 1e-10
    beyond = branch.switch(end)
    assert (beyond.kind, beyond.status, len(beyond.impacts)) == ("impacting", DONE, 1)
    assert beyond.system.force.amplitude > PLASTIC_END


@pytest.mark.parametrize("amplitude", [3.35, 3.5, 3.7, 3.72])
def test_a_plastic_ball_beyond_the_end_of_rest(amplitude):
    # x(2 pi) = 0 from rest at t: F cos t = pi; the multiplier 1 - F sin t
    orbit = zivi.periodic_orbit(table(amplitude, 0.0), (0, (0.5, 0)))
    assert (orbit.kind, orbit.multiple, orbit.status) == ("impacting", 1, DONE)
    t = math.acos(math.pi / amplitude)
    assert abs(orbit.impacts["t"][0] - t) < 1e-10
    assert orbit.impacts["u"][0] == pytest.approx(0, abs=1e-15)
    assert abs(orbit.impacts["xdot_before"][0] + 2 * math.pi) < 1e-10
    exact = [1 - amplitude * math.sin(t), 0]
    np.testing.assert_allclose(orbit.multipliers, exact, atol=1e-9)
    assert orbit.trajectory.success


def test_a_plastic_branch_from_its_rest_to_its_doubling():
    orbit = zivi.periodic_orbit(table(3.5, 0.0), (0, (0.5, 0)))
    branch = zivi.continue_orbit(orbit, "amplitude", (3.0, 4.0))
    rest, doubling = branch.events
    assert (rest.kind, doubling.kind) == ("rest_appears", "period_doubling")
    assert abs(rest.value / PLASTIC_END - 1) < 1e-10
    assert abs(doubling.value / PLASTIC_DOUBLING - 1) < 1e-10
    outside = [it for it in branch.orbits if it.system.force.amplitude < PLASTIC_END]
    assert outside
    assert not any(it.admissible for it in outside)
    assert "holds the mass" in outside[0].message
    resting = branch.switch(rest)
    assert (resting.kind, resting.status) == ("resting", DONE)
    doubled = branch.switch(doubling)
    assert (doubled.multiple, doubled.status) == (2, DONE)
    for amplitude in (3.75, 3.8):
        orbit = zivi.periodic_orbit(table(amplitude, 0.0), (0, (0.5, 0)))
        assert (orbit.multiple, orbit.status, orbit.stable) == (2, DONE, True)
        # both flights from rest at t1 to t2, by the equation of the flight
        t = [*orbit.impacts["t"], orbit.impacts["t"][0] + 4 * math.pi]
        for a, b in itertools.pairwise(t):
            thrown = math.cos(a) * (b - a) - math.sin(b) + math.sin(a)
            assert abs(amplitude * thrown - (b - a) ** 2 / 2) < 1e-9


def test_the_exponent_of_a_plastic_end_is_one():
    from inside import chatter_exponent

    assert chatter_exponent(0.0) == 1.0
    margins = []
    for off in (1e-3, 1e-4):
        rests = zivi.periodic_orbit(table(PLASTIC_END - off, 0.0), (0, (0.5, 0)))
        margins.append(rests.margin)
    assert margins[0] / margins[1] == pytest.approx(10, rel=2e-3)
