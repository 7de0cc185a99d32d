"""Walls that are not where a tracker of gaps thinks they are: learnt in contact."""

import functools
import pickle

import numpy as np
import pytest

import zivi
from mechanical_arms import START, swinging, tracker, two_links

DEPTH = two_links().parameters["d"]


@functools.cache
def twice():
    """A run of the arm that lands, lifts off, and lands again."""
    return zivi.reference_run(
        two_links(),
        (0, 2.9),
        (START, np.zeros(2)),
        virtual={"floor": lambda t: 20.0 if 1.3 < t < 1.4 else -9.81},
        posture=swinging,
        tstops=[1.3, 1.4],
    )


def tap(offset, noise=(0.0, 0.0), delay=0, **settings):
    """A loop whose floor is so much higher than thought."""
    believed = two_links().replace(d=DEPTH + offset)
    ctl = tracker(system=believed, delay=delay, **settings)
    return zivi.simulate_closed_loop(
        two_links(),
        ctl,
        (0, 2.8),
        (START, np.zeros(2)),
        reference=twice(),
        method=zivi.RKPeriod(),
        noise=noise,
        seed=1,
        delay=delay,
    )


def errors(run):
    """Root mean squares of the error of the gap, before the first contact and after lift-off."""
    parts = (run.t > 0.3) & (run.t < 0.85), (run.t > 1.5) & (run.t < 2.5)
    return [float(np.sqrt(np.mean(run.error_gaps[part] ** 2))) for part in parts]


@pytest.mark.parametrize("offset", [-3e-3, -1e-4, 1e-4, 3e-3])
@pytest.mark.parametrize(
    ("noise", "horizon", "within"),
    [((0, 0), 1.0, 1e-6), ((1e-5, 1e-3), 1.0, 1.5e-5), ((1e-4, 1e-2), 5.0, 8e-5)],
)
def test_contact_tells_where_a_wall_is(offset, noise, horizon, within):
    run = tap(offset, noise, horizon=horizon, learn_offset=True)
    before, after = errors(run)
    assert 0.8 * abs(offset) < before < 1.3 * abs(offset) + within
    assert after < within
    assert run.contacts[-1].all()
    np.testing.assert_allclose(run.reactions[-100:], 10.0, rtol=1e-3)
    assert not (run.tick_status & zivi.TickStatus.LATCH_LOST).any()
    closed = run.t[run.latched[:, 0]]
    assert 0.9 < closed[0] < 1.0
    assert not ((closed > 1.301) & (closed < 2.59)).any()  # open from the sample after lift-off on


def test_without_learning_the_error_stays():
    _, after = errors(tap(3e-3))
    assert 2e-3 < after < 4e-3


def test_a_wall_is_found_with_delay():
    run = tap(1e-3, delay=3, learn_offset=True)
    assert errors(run)[1] < 1e-6
    np.testing.assert_allclose(run.reactions[-100:], 10.0, rtol=1e-3)


def test_walls_farther_than_the_limit_are_not_learnt():
    run = tap(7e-3, learn_offset=True)
    assert not run.latched.any()
    assert run.contacts[-1].all()


def test_what_is_learnt_is_the_mean_of_the_gap_in_contact():
    """Tick by tick, from noise that is known."""
    ball = zivi.MechanicalSystem(
        mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1])], e=0.5, inputs=[[1.0]]
    )
    ctl = zivi.GapTracker(
        ball, h=1e-3, gains={"gap0": (30, 17)}, latch=(1e-4, 1e-3), learn_offset=True
    )
    draws = 2e-3 + 1e-4 * np.random.default_rng(3).standard_normal(700)
    held = []
    for k, x in enumerate(draws):
        ctl.step(k * 1e-3, [x], [0.0])
        held += [x] if ctl.latched[0] else []
        if len(held) in (1, 100, 500):
            np.testing.assert_allclose(ctl.offsets, [np.mean(held)], rtol=1e-9)
    assert len(held) > 690
    assert abs(ctl.offsets[0] - np.mean(draws[-500:])) < 2e-5
    twin = pickle.loads(pickle.dumps(ctl))
    assert np.array_equal(twin.offsets, ctl.offsets)
    assert twin.state == ctl.state
    u = ctl.step(0.7, [2.1e-3], [0.01])
    assert np.array_equal(u, twin.step(0.7, [2.1e-3], [0.01]))
    for _ in range(5):
        ctl.step(0.8, [5e-3], [0.5])
    assert ctl.status & zivi.TickStatus.LATCH_LOST or not ctl.latched[0]
    ctl.reset()
    assert ctl.offsets[0] == 0.0
