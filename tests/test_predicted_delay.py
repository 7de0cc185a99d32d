"""Controllers that know that their controls act late."""

import copy
import pickle
import warnings

import numpy as np
import pytest

import zivi

F = -9.81
H = 1e-3
GAINS = (30.0, 17.0)


def tracker(delay, e=0.5, **settings):
    return zivi.TwistingTracker(*GAINS, h=H, e=e, delay=delay, **settings)


def orbit(t):
    """A mass that rises for 0.4 s, falls for 0.2 s and loses half of its speed, in closed form."""
    tau = (round(t / H) % 600) * H
    if tau < 0.4 - H / 2:
        return 2.0 * tau - 2.5 * tau**2, 2.0 - 5.0 * tau, -5.0
    tau -= 0.4
    return max(0.4 - 10.0 * tau**2, 0.0), -20.0 * tau, -20.0


def on_the_orbit(delay, controller, t=6.0):
    return zivi.simulate_closed_loop(
        zivi.ImpactSystem(F, e=0.5),
        controller,
        (0, t),
        (0, 2),
        reference=orbit,
        delay=delay,
    )


def test_a_late_loop_that_is_predicted_is_one_without_delay():
    """Of the state that the mass has when its first control acts."""
    plant = zivi.ImpactSystem(F, e=0.5)
    for delay in (1, 3, 64):
        late = zivi.simulate_closed_loop(
            plant, tracker(delay), (0, 3), (0.4, 1), y_ref0=(1, 0.5), force_ref=-7.0, delay=delay
        )
        start = [float(it[delay]) for it in (late.x, late.xdot)]
        own = [float(it[delay]) for it in (late.x_ref, late.xdot_ref)]
        there = zivi.simulate_closed_loop(
            plant, tracker(0), (0, 3 - delay * H), start, y_ref0=own, force_ref=-7.0
        )
        for name in ("x", "xdot", "u", "x_ref"):
            found = getattr(late, name)[delay:-1]
            assert np.allclose(found, getattr(there, name)[:-1], rtol=0, atol=2e-6), (delay, name)
        assert late.rest_time == pytest.approx(there.rest_time + delay * H, abs=2e-6)
        assert not late.u[:delay].any()


def test_the_reference_is_where_it_is_without_delay():
    """Also one that a force of time moves: it is asked for when it acts."""
    plant = zivi.ImpactSystem(F, e=0.5)
    moved = {"y_ref0": (0.5, 0.3), "force_ref": zivi.LinearForce(gravity=9, amplitude=3, omega=5)}
    runs = [
        zivi.simulate_closed_loop(plant, tracker(delay), (0, 2), (0.4, 1), delay=delay, **moved)
        for delay in (0, 7)
    ]
    assert np.array_equal(runs[0].x_ref, runs[1].x_ref)
    assert np.array_equal(runs[0].xdot_ref, runs[1].xdot_ref)


@pytest.mark.parametrize("delay", [1, 2, 5, 10, 20])
def test_an_orbit_is_followed_as_without_delay(delay):
    settings = {"branch": "nearest", "shift": True}
    at_once = on_the_orbit(0, tracker(0, **settings))
    late = on_the_orbit(delay, tracker(delay, **settings))
    cautious = on_the_orbit(delay, tracker(0, ahead=1 + delay, **settings))
    rms = [np.sqrt(np.mean(run.error[run.t > 2] ** 2)) for run in (at_once, late, cautious)]
    assert rms[1] == pytest.approx(rms[0], rel=0.05)
    assert rms[1] < 3e-6
    assert rms[2] > 20 * rms[1]
    assert np.array_equal(late.x_ref, at_once.x_ref)


@pytest.mark.parametrize("e", [0.5, 0.8, 0.95, 0.98])
def test_landings_rest(e):
    """Of 20 starts each, in 10 s: also with 0.1 m/s of noise, by a dead zone of 4 deviations."""
    rng = np.random.default_rng(round(100 * e))
    starts = np.column_stack([rng.uniform(0, 2, 20), rng.uniform(-4, 4, 20)])
    plant = zivi.ImpactSystem(F, e=e)
    for delay in (1, 2, 5, 10):
        for sigma in (0.0, 0.1):
            found = zivi.simulate_closed_loop_batch(
                plant,
                tracker(delay, e, quiet=4 * sigma),
                (0, 10),
                starts,
                reference=np.zeros((2, 10_001)),
                delay=delay,
                noise=(0, sigma),
                seed=delay,
            )
            assert np.isfinite(found.rest_time).all(), (delay, sigma)


def test_a_regulator_rests_at_once_too():
    plant = zivi.ImpactSystem(1.0, e=0.9)
    law = {"h": 1e-2, "e": 0.9}
    ended = []
    for controller in (
        zivi.TwistingRegulator(5, 2, delay=6, **law),
        zivi.TwistingRegulator(5, 2, ahead=7, **law),
    ):
        run = zivi.simulate_closed_loop(plant, controller, (0, 20), (1, 0), delay=6)
        ended.append(run.rest_time)
    assert ended[0] < 0.8 * ended[1]


def test_state_copies_and_pickles_have_what_is_under_way():
    ours, steps = tracker(3), [(0.4 - 0.01 * k, -1.0, F, -8.0) for k in range(12)]
    ours.reset(0.3, 0.1)
    for step in steps[:5]:
        ours.step(*step)
    others = [copy.copy(ours), copy.deepcopy(ours), pickle.loads(pickle.dumps(ours)), tracker(3)]
    others[-1].state = ours.state
    for step in steps[5:]:
        assert {it.step(*step) for it in others} == {ours.step(*step)}
    ours.reset(0.3, 0.1)
    fresh = tracker(3)
    fresh.reset(0.3, 0.1)
    assert ours.state == fresh.state
    assert fresh.state[6] == ([0.0] * 3, [(0.0, 0.0)] * 3, 3)
    with pytest.raises(ValueError, match="state must be"):
        tracker(3).state = tracker(2).state
    with pytest.raises(ValueError, match="state must be"):
        tracker(3).state = tracker(0).state
    assert len(tracker(0).state) == 6


def test_what_is_sent_again_is_under_way_again():
    """A sample that is refused or missing holds the last control, and that acts later too."""
    ours = tracker(3)
    sent = [ours.step(0.4, 0.5, F, -8.0)]
    with pytest.raises(ValueError, match="x must be"):
        ours.step(-1.0, 0.0, F, -8.0)
    sent += [ours.u, ours.step(None, force_ref=-8.0)]
    assert ours.state[6][0] == sent
    assert len(set(sent)) == 1


def test_the_prediction_is_that_of_the_controls_under_way():
    """The tick without delay, of where the mass will be, which the plant itself tells."""
    ours, plain = tracker(2), tracker(0)
    state, waiting = np.array([0.05, -0.9]), [0.0, 0.0]
    for _ in range(200):
        ahead = state
        for u in waiting:
            flight = zivi.simulate(zivi.ImpactSystem(F + u, e=0.5), (0, H), ahead)
            ahead = np.array([flight.x[-1], flight.xdot[-1]])
        rest = (0.0, 0.0, 1.0)
        u = ours.step_to(*state, F, rest, rest)
        assert u == pytest.approx(plain.step_to(*ahead, F, rest, rest), abs=1e-6)
        flight = zivi.simulate(zivi.ImpactSystem(F + waiting.pop(0), e=0.5), (0, H), state)
        state, waiting = np.array([flight.x[-1], flight.xdot[-1]]), [*waiting, u]
    assert not state.any()


def test_a_batch_is_single_loops_bit_for_bit():
    plant, starts = zivi.ImpactSystem(F, e=0.5), [[1, 0], [0.4, 1], [0, 0]]
    asked = {"force_ref": -7.0, "y_ref0": (0.6, 0), "delay": 4}
    batch = zivi.simulate_closed_loop_batch(plant, tracker(4), (0, 2), starts, **asked)
    for i, start in enumerate(starts):
        one = zivi.simulate_closed_loop(plant, tracker(4), (0, 2), start, **asked)
        assert batch.x[i] == one.x[-1]
        assert batch.rest_time[i] == one.rest_time


def test_a_general_solver_predicts_too():
    """It differs from the exact solution, where a step has several, as it does without delay.

    Steps that end with `v+ = v_r+ = 0`, at apexes of the orbit, have several or not by a rounding.
    """
    apart = []
    for delay in (0, 3):
        exact, newton = (
            on_the_orbit(delay, tracker(delay, solver=solver), 2.0)
            for solver in ("exact", "newton")
        )
        apart.append(np.abs(exact.x - newton.x).max())
    assert apart[1] == pytest.approx(apart[0], abs=1e-9)
    assert apart[0] < 1e-5


def test_bad_input():
    for delay in (-1, 65):
        with pytest.raises(ValueError, match="delay must be from 0 to 64"):
            tracker(delay)
    with pytest.raises(TypeError, match="delay"):
        tracker(1.5)
    with pytest.raises(ValueError, match="ahead must not be set with delay"):
        tracker(2, ahead=3)
    with pytest.raises(ValueError, match="dt must be None with a delay"):
        tracker(2).step(1.0, 0.0, F, F, dt=2e-3)


def test_a_loop_with_another_delay_is_told():
    plant = zivi.ImpactSystem(F, e=0.5)
    for own, delay in ((2, 3), (2, 0)):
        with pytest.warns(zivi.ModelWarning, match=f"delay = {own}, the loop has delay = {delay}"):
            zivi.simulate_closed_loop(plant, tracker(own), (0, 0.1), (1, 0), delay=delay)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        zivi.simulate_closed_loop(plant, tracker(3), (0, 0.1), (1, 0), delay=3)
