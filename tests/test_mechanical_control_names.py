"""Every name, argument and attribute with which loops of mechanisms and designs are called."""

import pickle

import numpy as np
import pytest

import zivi
import zivi.mechanics
from mechanical_arms import PADDLE, START, two_links

H = 1e-3
LIMITS = [(-40, 40), (-20, 20)]
STILL = np.zeros(2)


def tracker(**more):
    settings = {
        "h": H,
        "gains": {"floor": (40, 22)},
        "posture": (400, 40),
        "force": {"floor": 10.0},
        "u_limits": LIMITS,
        "horizon": 1,
        "shift": False,
        "latch": (1e-4, 1e-2),
        "delay": 0,
    }
    return zivi.GapTracker(two_links().replace(m2=0.9), **settings | more)


@pytest.mark.parametrize(
    "inputs",
    [
        {"ta": [1, 0], "tb": [0, 1]},
        np.eye(2),
        lambda q: np.eye(2),
        {"ta": ["cos(a)**2 + sin(a)**2", 0], "tb": [0, "1"]},
        [["1", "0"], ["0", "1"]],
    ],
    ids=["columns", "array", "function", "expressions", "matrix of expressions"],
)
def test_inputs_may_be_columns_an_array_a_function_or_expressions(inputs):
    arm = zivi.symbolic.system(
        "a b",
        T="(adot**2 + bdot**2)/2",
        V="k*a",
        gaps={"floor": "a"},
        parameters={"k": 9.81},
        e=0.6,
        inputs=inputs,
    )
    ctl = zivi.GapTracker(arm, h=H, gains={"floor": (40, 22)})
    run = zivi.simulate_closed_loop(arm, ctl, (0, 0.7), ([0.1, 0.0], STILL), reference="rest")
    assert run.contacts[-1].all()
    assert run.u.shape == (len(run.t), 2)


@pytest.fixture(scope="module")
def loop():
    """A loop with everything that a loop takes."""
    arm = two_links()
    reference = zivi.reference_run(
        arm, (0, 1), (START, STILL), virtual={"floor": -9.81}, posture=lambda t: START
    )
    return zivi.simulate_closed_loop(
        arm,
        tracker(delay=2),
        (0, 0.8),
        (START, STILL),
        reference=reference,
        noise=(1e-6, 1e-4),
        quantization=1e-6,
        delay=2,
        seed=1,
        observer=zivi.JointObserver(arm, noise=1e-6),
        method=zivi.SwitchedRK(rtol=1e-9, atol=1e-12),
        disturbance=[0.1, 0.0],
    )


def test_a_loop_has_what_it_is_asked_for(loop):
    k = 801
    shapes = {
        "t": (k,),
        "q": (k, 2),
        "qdot": (k, 2),
        "gaps": (k, 1),
        "u": (k, 2),
        "reactions": (k, 1),
        "contacts": (k, 1),
        "error_gaps": (k, 1),
        "latched": (k, 1),
        "tick_status": (k,),
        "q_est": (k, 2),
        "qdot_est": (k, 2),
        "q_ref": (k, 2),
    }
    assert {name: getattr(loop, name).shape for name in shapes} == shapes
    assert {"t", "gap", "speed_before", "speed_after"} <= set(loop.impacts.dtype.names)
    assert {"t", "gap"} <= set(loop.zeno.dtype.names)
    assert len(loop.impacts) > 3
    assert loop(0.4).shape == (2, 2)
    assert loop(np.array([0.1, 0.2])).shape == (2, 2, 2)
    np.testing.assert_array_equal(loop(loop.t[400])[0], loop.q[400])


@pytest.mark.filterwarnings("ignore:.*control updates:zivi.ModelWarning")
@pytest.mark.parametrize("method", [zivi.RKPeriod(), zivi.SwitchedRK(), None])
def test_a_plant_moves_by_tolerance_or_by_a_step_a_period(method):
    arm, end = two_links(), 0.4
    run = zivi.simulate_closed_loop(
        arm, tracker(), (0, end), (START, STILL), reference="rest", method=method
    )
    assert run.status == zivi.Status.COMPLETED
    assert run.t[-1] == end


@pytest.mark.filterwarnings("ignore:.*control updates:zivi.ModelWarning")
def test_a_batch_takes_noise_seeds_and_parameters():
    arm, masses = two_links(), np.array([0.7, 0.9])
    starts = np.array([START, START + 0.01]), np.zeros((2, 2))
    asked = {"noise": (1e-5, 1e-3), "reference": "rest", "method": zivi.RKPeriod()}
    many = zivi.simulate_closed_loop_batch(
        arm, tracker(), (0, 0.3), starts, seed=[3, 4], parameters={"m2": masses}, **asked
    )
    for i in range(2):
        one = zivi.simulate_closed_loop(
            arm.replace(m2=masses[i]),
            tracker(),
            (0, 0.3),
            (starts[0][i], starts[1][i]),
            seed=3 + i,
            **asked,
        )
        assert np.array_equal(many.q[i], one.q[-1])
        assert np.array_equal(many.u[i], one.u[-1])


def test_gap_coordinates_are_a_tuple_with_names():
    split = zivi.mechanics.gap_coordinates(two_links(), START, [0.3, -0.2])
    g, gdot, D, N, T, Z, w, c = split
    assert split._fields == ("g", "gdot", "D", "N", "T", "Z", "w", "c")
    assert [it.shape for it in (g, gdot, D, N, T, Z, w, c)] == [
        (1,),
        (1,),
        (1, 1),
        (1, 2),
        (2, 1),
        (1, 2),
        (1,),
        (1, 1),
    ]


def as_high(k):
    return 0.5


def striker():
    return zivi.Striker(PADDLE, gap="racket", body="ball", apex=as_high, h=H)


@pytest.mark.parametrize(
    ("make", "q"), [(tracker, START), (striker, np.array([0.4, 0.0]))], ids=["tracker", "striker"]
)
def test_a_controller_steps_resets_copies_and_travels(make, q):
    ctl, qdot = make(), STILL
    assert ctl.h == H
    first = ctl.step(0.0, q, qdot)
    assert first.ndim == 1
    twins = [ctl.copy(), pickle.loads(pickle.dumps(ctl))]
    state = ctl.state
    then = ctl.step(H, q, qdot)
    assert all(np.array_equal(twin.step(H, q, qdot), then) for twin in twins)
    ctl.state = state
    assert np.array_equal(ctl.step(H, q, qdot), then)
    ctl.reset()
    assert np.array_equal(ctl.step(0.0, q, qdot), first)
    assert ctl.step(H, [np.nan, 0.0], qdot).shape == first.shape
    assert ctl.status == zivi.TickStatus.REFUSED


def test_a_tracker_of_gaps_follows_samples_of_a_reference():
    sample = zivi.ReferenceSample(
        q=START, qdot=STILL, sides=np.ones(1), contacts=np.zeros(1, dtype=bool)
    )
    assert tracker().step_to(0.0, START, STILL, sample, sample).shape == (2,)


def test_a_class_of_a_users_own_runs_and_what_it_gives_is_checked():
    class Own:
        h = H

        def __init__(self):
            self.calls = 0

        def step(self, t, q, qdot):
            self.calls += 1
            if self.calls == 3:
                return [np.nan, 0.0]
            return [float(self.calls), 0.0]

    with pytest.warns(zivi.ModelWarning, match="1 of 5 control updates of Own were rejected"):
        run = zivi.simulate_closed_loop(two_links(), Own(), (0, 5 * H), (START, STILL))
    assert run.u[:5, 0].tolist() == [1.0, 2.0, 2.0, 4.0, 5.0]
    refused = run.tick_status & zivi.TickStatus.REFUSED
    assert np.flatnonzero(refused).tolist() == [2]


def test_too_small_a_force_is_told_by_the_status():
    run = zivi.simulate_closed_loop(
        two_links(),
        tracker(force={"floor": 0.1}, latch=None),
        (0, 1.5),
        (START, STILL),
        reference="rest",
        disturbance=lambda t, q, qdot: np.array([4.0, 0.0]) if t > 0.9 else STILL,
    )
    assert run.tick_status.max() & zivi.TickStatus.LATCH_LOST


@pytest.mark.parametrize(
    ("design", "kind"), [(zivi.design_tracker, "tracker"), (zivi.design_regulator, "regulator")]
)
def test_a_design_says_its_range_and_in_which_sense_it_rests(design, kind):
    found = design(2.0, e=0.5, bound=0.2)
    assert isinstance(found, zivi.GainDesign)
    assert (found.kind, found.rest, found.within) == (kind, "exact", 0.0)
    assert found.u_min <= found.u_max
    assert found.peak == max(-found.u_min, found.u_max)
    assert 0.0 < found.settling_time <= 2.0
    loose = design(6.0, e=0.95, bound=1.0, rest="practical")
    assert loose.rest == "practical"
    assert loose.within > 0.0


def test_limits_of_one_side_ask_for_more_gain_and_what_none_does_says_what_would():
    # |u| <= 9 under gravity: more gain towards the wall, not less
    slow = zivi.design_tracker(6.0, e=0.5, u_limits=9.0)
    assert 8.9 < slow.u_min <= slow.u_max <= 9.0
    with pytest.raises(zivi.InfeasibleError) as raised:
        zivi.design_tracker(0.1, e=0.5, u_limits=9.0)
    assert raised.value.settling_time > 0.1
    assert raised.value.peak > 9.0
    again = zivi.design_tracker(raised.value.settling_time, e=0.5, u_limits=9.0)
    assert again.settling_time <= raised.value.settling_time
    assert zivi.design_tracker(0.1, e=0.5, u_limits=raised.value.peak * 1.001).peak > 9.0
