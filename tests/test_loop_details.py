"""Closed loops in detail: what designs need, what is warned of, and what results tell."""

import ctypes

import numpy as np
import pytest

import zivi
from inside import FLATTEST, STEEPEST, ControlLaw, _gap_branches, check_ahead

FORCE = ctypes.CFUNCTYPE(*[ctypes.c_double] * 4)


def test_a_regulator_has_the_least_gain_whose_ratio_is_in_range():
    low, high = ((1.0 - it) / (1.0 + it) for it in (FLATTEST, STEEPEST))
    ratio = np.geomspace(1e-4, 1e4, 41)
    for force in (-3.0, -0.2, 0.0, 0.7, 5.0):
        least = ControlLaw("regulator", 0.5, force, None)._ordered(ratio)
        for per, found in zip(ratio, least, strict=True):
            # mu2/mu1 of the net accelerations U and D = per U
            given = np.geomspace(1e-6, 1e6, 2000)
            given = given[given + force > 0.0]
            share = (per * given + force) / (given + force)
            holds = (share >= low) & (share <= high)
            enough = given >= found * (1.0 + 1e-9) if np.isfinite(found) else given < 0.0
            assert holds[enough & (given > found)].all(), (force, per)
            below = given < found * (1.0 - 1e-9)
            assert not holds[below].all() or not below.any(), (force, per)
            # just below it the range is left
            if 0.0 < found < np.inf and found * 0.999 + force > 0.0:
                just = found * 0.999
                share = (per * just + force) / (just + force)
                assert not low <= share <= high, (force, per)


def test_a_landing_that_looks_less_far_ahead_than_its_delay_is_warned_of():
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=0.5, ahead=1)
    assert tracker.landing
    with pytest.warns(match="a landing may never rest: ahead = 1, but 1 . delay = 4"):
        check_ahead(tracker, 3)


def test_results_and_errors_name_their_parts():
    law = zivi.TwistingRegulator(3, 2, h=1e-2, kappa=0.5)
    loop = zivi.simulate_closed_loop(zivi.ImpactSystem(0.0, kappa=0.5), law, (0, 0.1), (1, 0))
    assert loop._facts()["controller"] == "TwistingRegulator"
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=0.5)
    plant = zivi.ImpactSystem(-9.81, e=0.5)
    with pytest.raises((TypeError, ValueError), match=r"y_ref0 .*\(x_ref0, xdot_ref0\)"):
        zivi.simulate_closed_loop(plant, tracker, (0, 1), (1, 0), y_ref0=3.0, force_ref=-9.81)


def test_the_branch_of_a_gap_changes_at_each_of_its_impacts():
    ball = zivi.MechanicalSystem(mass=[[1.0]], force=[-9.81], gaps=[zivi.LinearGap([1.0])], e=0.5)
    run = zivi.simulate(ball, (0, 1.3), ([1.0], [0.0]))
    first = np.sqrt(2.0 / 9.81)
    impacts = first + first * np.cumsum([0.0, 1.0, 0.5, 0.25])  # closed form
    times = np.concatenate([[0.0], impacts - 1e-3, impacts + 1e-3])
    sides = _gap_branches(run, times, 1)[:, 0]
    assert sides.tolist() == [1, 1, -1, 1, -1, -1, 1, -1, 1]


def test_errors_of_compiled_forces_are_heard_from_every_thread():
    def force(t, x, xdot):
        if t > 0.05:
            raise ArithmeticError("no value")
        return -9.81

    plant = zivi.ImpactSystem(FORCE(force), e=0.5)
    law = zivi.TwistingRegulator(3, 2, h=1e-2, e=0.5)
    with pytest.warns(RuntimeWarning, match=r"raised ArithmeticError\('no value'\)"):
        zivi.simulate_closed_loop_batch(plant, law, (0, 0.2), [(1, 0), (2, 0)], threads=2)
