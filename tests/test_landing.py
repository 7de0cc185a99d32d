"""The regulator's landing: exact rest in the sampled loop at every e, with delay and with noise."""

import copy
import pickle

import numpy as np
import pytest

import zivi
from control_oracle import settling_time

pytestmark = pytest.mark.filterwarnings("ignore:a landing may never rest")

F = -9.81


def starts(n, seed=1):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(0, 2, n), rng.uniform(-4, 4, n)])


def share_at_rest(mu1, mu2, h, e, *, n, delay=0, loop="sampled", t_end=None, **settings):
    """Count the starts from which the mass is at exact rest in time.

    In time: the settling time of continuous control, and 3 N h (1 + 1/kappa) for what sampling and
    delay add (U > D), and ten periods.
    """
    y0, law = starts(n), {"mu1": mu1, "mu2": mu2, "e": e, "f": F}
    slow = max(settling_time(*y, **law) for y in y0)
    kappa, periods = (1 - e) / (1 + e), 1 + delay
    if t_end is None:
        t_end = slow + 3 * periods * h * (1 + 1 / kappa) + (10 + delay) * h
    batch = zivi.simulate_closed_loop_batch(
        zivi.ImpactSystem(F, e=e),
        zivi.TwistingRegulator(mu1, mu2, h=h, e=e, **settings),
        (0, t_end),
        y0,
        delay=delay,
        method=zivi.ThetaGamma(h) if loop == "paper's" else None,
    )
    at_rest = (batch.x == 0) & (batch.xdot == 0) & (batch.rest_time <= batch.t - h)
    return np.count_nonzero(at_rest) / n


@pytest.mark.parametrize("e", [0.05, 0.38, 0.8, 0.95, 0.99])
@pytest.mark.parametrize("gains", [(30, 17), (30, 25)])
def test_every_start_ends_in_exact_rest(e, gains):
    for h in (1e-2, 1e-3):
        assert share_at_rest(*gains, h, e, n=20) == 1
        assert share_at_rest(*gains, h, e, n=20, loop="paper's") == 1


@pytest.mark.parametrize("e", [0.3, 0.8, 0.95])
@pytest.mark.parametrize("delay", [1, 2, 7])
def test_with_delay_the_horizon_is_one_period_more(e, delay):
    assert share_at_rest(30, 17, 1e-3, e, n=8, delay=delay, ahead=1 + delay) == 1


def test_what_does_not_rest():
    """The paper's tick near e = 1; and with delay either tick that does not look ahead."""
    assert share_at_rest(30, 25, 1e-3, 0.96, n=12, t_end=10, landing=False) < 1
    for settings in ({"landing": False}, {"ahead": 1}):
        assert share_at_rest(30, 17, 1e-3, 0.8, n=8, delay=2, t_end=10, **settings) == 0


def test_noise_does_not_end_rest():
    """Pressed down with D at least, whatever is measured."""
    plant = zivi.ImpactSystem(F, e=0.9)
    regulator = zivi.TwistingRegulator(30, 17, h=1e-3, e=0.9)
    run = zivi.simulate_closed_loop(plant, regulator, (0, 4), (1, 0), noise=(1e-3, 0.1), seed=3)
    assert run.rest_time < 2
    assert (run.x[-1], run.xdot[-1], len(run.liftoff_times)) == (0, 0, 0)
    assert np.all(run.u <= -30 + 17)


def test_unknown_forces_within_the_gains_do_not_end_it_either():
    regulator = zivi.TwistingRegulator(30, 17, h=1e-3, e=0.8)
    for force in (-12.0, 12.0):
        plant = zivi.ImpactSystem(force, e=0.8)
        run = zivi.simulate_closed_loop(plant, regulator, (0, 20), (1, 0), force_model=0.0)
        assert run.rest_time is not None


def test_settings_survive_copies_pickles_and_a_restored_state():
    regulator = zivi.TwistingRegulator(30, 17, h=1e-3, e=0.8, ahead=3)
    assert (regulator.landing, regulator.ahead) == (True, 3)
    u = regulator.step(0.5, 0.1, F)
    twins = [regulator.copy(), copy.deepcopy(regulator), pickle.loads(pickle.dumps(regulator))]
    for twin in twins:
        assert (twin.settings, twin.state, twin.u) == (regulator.settings, regulator.state, u)
        assert twin.step(0.4, 0.05, F) == regulator.copy().step(0.4, 0.05, F)
    # and the horizon is what makes the difference
    assert u != zivi.TwistingRegulator(30, 17, h=1e-3, e=0.8).step(0.5, 0.1, F)
    assert zivi.TwistingRegulator(**regulator.settings).settings == regulator.settings


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"ahead": 0}, ValueError, "ahead must be >= 1"),
        ({"ahead": 10**10}, ValueError, "ahead must be >= 1 .* at most 1e"),
        ({"ahead": 1.5}, TypeError, "ahead must be a whole number, got 1.5"),
        ({"ahead": True}, TypeError, "ahead must be a whole number"),
        ({"landing": 1}, TypeError, "landing must be True or False, got 1"),
        ({"landing": False, "ahead": 2}, ValueError, "must be 1 with landing=False, got 2"),
    ],
)
def test_bad_settings_are_named(settings, error, message):
    with pytest.raises(error, match=message):
        zivi.TwistingRegulator(3, 2, h=1e-3, e=0.5, **settings)
