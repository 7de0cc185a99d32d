"""The control of a mass at rest is still, by a dead zone or behind an observer."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import zivi

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from control_rest import KINDS, changes, run, until_rest


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sigma", [0.01, 0.1])
def test_a_dead_zone_of_five_deviations_keeps_the_control(kind, sigma):
    """100000 ticks; a million: benchmarks/control_rest.py."""
    assert changes(run(kind, 0.0, sigma, 20_000))[0] > 300
    still = run(kind, 5.0, sigma, 100_000)
    assert changes(still)[0] == 0
    # and is that of a mass that rests, with the bits of a run without noise
    assert still.u[-1] == run(kind, 0.0, 0.0, 100).u[-1]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("position_only", [False, True])
def test_behind_an_observer_the_control_is_still_without_one(kind, position_only):
    """Its estimates of a mass at rest are exactly 0; quiet of the controller is left as it is."""
    found = run(kind, position_only or None, 0.1, 60_000)
    total, late = changes(found)
    assert total < 20
    assert late == 0
    assert not found.x_est[2000:].any()
    assert not found.xdot_est[2000:].any()


def test_near_e_1_an_observer_rests_sooner_than_a_dead_zone():
    """The times of benchmarks/results/loops.md."""
    root = Path(__file__).parents[1]
    page = " ".join((root / "benchmarks" / "results" / "loops.md").read_text().split())
    told = re.search(
        r"rest takes (.*) s from 0.5 m, (.*) s with `quiet`, (\d.\d) s with both", page
    )
    found = [
        until_rest(0.98, None, 0.1),
        until_rest(0.98, 5.0, 0.1),
        until_rest(0.98, None, 0.1, zone=5.0),
    ]
    assert found == pytest.approx([float(it) for it in told.groups()], abs=0.06)


def test_the_loop_leaves_the_dead_zone_as_it_is():
    noise, plant = (1e-4, 1e-2), zivi.ImpactSystem(-9.81, e=0.5)
    observer = zivi.ImpactObserver(0.5, 1e-3, noise=noise)
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=0.5)
    found = zivi.simulate_closed_loop(
        plant, tracker, (0, 1), (0.3, 0), noise=noise, seed=3, force_model=-9.81, observer=observer
    )
    twin, last = zivi.TwistingTracker(30, 17, h=1e-3, e=0.5), 0.0
    assert tracker.quiet == 0.0
    for k in range(len(found.t) - 1):
        last = twin.step(found.x_est[k], found.xdot_est[k], -9.81 + found.d_est[k], 0.0)
        assert last == found.u[k]


@pytest.mark.parametrize("position_only", [False, True])
def test_behind_an_observer_a_mass_at_rest_is_pressed_as_asked(position_only):
    noise, plant = (1e-4, 0.1), zivi.ImpactSystem(-9.81, e=0.5)
    observer = zivi.ImpactObserver(0.5, 1e-3, noise=noise, position_only=position_only, dmax=5)
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=0.5, press=22.0)
    found = zivi.simulate_closed_loop(
        plant, tracker, (0, 20), (0, 0), noise=noise, seed=1, force_model=-9.81, observer=observer
    )
    pressed = -9.81 + found.d_est[:-1] + found.u[:-1]
    np.testing.assert_allclose(pressed[1000:], -22.0, rtol=1e-12)
    assert changes(found)[1] == 0
