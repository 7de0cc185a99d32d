"""The tracker of gaps: one mass, an arm that taps a table, contact forces, limits, what is lost."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

import zivi
import zivi.mechanics
from gap_tracker_loops import LOOPS
from inside import reference_of
from mechanical_arms import H, bouncing_error, follow, is_pressed, tapping, tracker, two_links

FORMER = json.loads(
    (Path(__file__).parent / "data" / "gap_tracker_loops.json").read_text(encoding="utf-8")
)

MASS = zivi.MechanicalSystem(
    mass=1.0, force=[0.0], gaps=[zivi.LinearGap([1], name="floor")], e=0.5, inputs=[[1.0]]
)


@pytest.mark.parametrize("settings", [{}, {"horizon": 3.0}, {"shift": True}])
def test_one_mass_is_controlled_as_by_the_tracker_of_a_mass(settings):
    reference = zivi.reference_run(MASS, (0, 2.0), ([1.0], [0.5]), virtual={"floor": -9.81})
    ctl = zivi.GapTracker(MASS, h=1e-3, gains={"floor": (30, 17)}, **settings)
    run = zivi.simulate_closed_loop(MASS, ctl, (0, 2.0), ([0.9], [0.3]), reference=reference)
    given = reference_of(reference, run.t, ("floor",), np.array([1.0]))
    one = zivi.TwistingTracker(30, 17, h=1e-3, e=0.5, **settings)
    for k in range(len(run.t) - 1):
        now, after = given.sample(k), given.sample(k + 1)
        ends = [(it.gaps[0], it.gap_rates[0], it.sides[0]) for it in (now, after)]
        state = (0.0, 0.0) if run.latched[k, 0] else (run.q[k, 0], run.qdot[k, 0])
        assert one.step_to(*state, 0.0, *ends, now.accelerations[0]) == run.u[k, 0], run.t[k]
    assert run.contacts[-1, 0]
    assert run.gaps[-1, 0] == 0.0


def test_an_arm_taps_a_table_as_its_reference_does_and_presses_it():
    run = follow(tracker())
    assert len(run.zeno) == 1
    assert len(run.resolved_impacts) > 10
    assert bouncing_error(run) < 3e-6
    assert is_pressed(run, 10.0, 1e-3)
    posture = np.abs(run.q - run.q_ref)[-300:].max()
    assert posture < 1e-4


class OwnLaw:
    """The law in gap coordinates by NumPy, on one gap, in flight."""

    h = 1e-3

    def __init__(self, at_right_angles):
        self.tracker = zivi.TwistingTracker(40, 22, h=self.h, e=0.6)
        self.at_right_angles = at_right_angles

    def step_to(self, t, q, qdot, now, after):
        split, here = (
            zivi.mechanics.gap_coordinates(two_links(), q, qdot),
            two_links().at(t, q, qdot),
        )
        ends = [(it.gaps[0], it.gap_rates[0], it.sides[0]) for it in (now, after)]
        gap = max(split.g[0], 0.0), split.gdot[0]
        a = self.tracker.step_to(*gap, 0.0, *ends, now.accelerations[0])
        wanted = now.qddot - 400.0 * (q - now.q) - 40.0 * (qdot - now.qdot)
        # N q'' = a - h, and Z q'' = Z b or, in the plain null space, T^T q'' = T^T b
        across = split.Z if self.at_right_angles else np.linalg.pinv(split.T)
        rows = np.concatenate([split.N, across])
        right = np.append(a - here.curvatures, across @ wanted)
        return here.mass @ np.linalg.solve(rows, right) - here.force

    step = step_to


def test_the_law_is_that_of_gap_coordinates_and_the_plain_null_space_is_far_worse():
    ours = follow(zivi.GapTracker(two_links(), h=1e-3, gains={"floor": (40, 22)}))
    same, plain = (follow(OwnLaw(it)) for it in (True, False))
    flight = int(np.argmax(ours.latched[:, 0]))
    assert flight > 800
    np.testing.assert_allclose(same.u[:flight], ours.u[:flight], atol=1e-6)
    part = (ours.t > 0.4) & (ours.t < 1.0)
    errors = [np.sqrt(np.mean((run.q - run.q_ref)[part] ** 2)) for run in (ours, plain)]
    assert errors[1] > 5 * errors[0]


@pytest.mark.filterwarnings("ignore:.*control updates:zivi.ModelWarning")
@pytest.mark.parametrize("name", LOOPS)
def test_loops_are_those_of_the_law_as_it_once_was_in_numpy(name):
    """The numbers are those of version 0.2.0, whose law was NumPy."""
    former, run = FORMER[name], LOOPS[name]()
    # where torques are limited the gaps outweigh the rest by 1e8
    np.testing.assert_allclose(run.u[::15], former["u"], atol=2e-4 if name == "limits" else 1e-7)
    assert run.latched.sum() == former["latched"]
    assert run.tick_status.astype(int).sum() == former["status"]


@pytest.mark.parametrize(
    ("settings", "asked", "gap", "force"),
    [
        ({"system": {"m1": 1.2, "m2": 0.96}}, {}, 3.3e-6, 4.5),
        ({"system": {"e": 0.55}}, {}, 3e-6, 1e-3),
        ({"horizon": 3.0}, {"noise": (1e-5, 1e-3), "seed": 1}, 2.5e-5, 2e-3),
        ({}, {"quantization": 1e-5}, 6e-6, 1e-3),
        ({"delay": 2}, {"delay": 2}, 3e-6, 1e-3),
    ],
    ids=["masses", "e", "noise", "encoder", "predictor"],
)
def test_an_arm_rests_in_contact_with_errors_of(settings, asked, gap, force):
    if "system" in settings:
        settings = {"system": two_links().replace(**settings["system"])}
    run = follow(tracker(**settings), **asked)
    assert bouncing_error(run) < gap
    assert is_pressed(run, 10.0, force)


def test_positions_are_enough_with_an_observer():
    run = follow(
        tracker(horizon=3.0),
        noise=(1e-5, 0.0),
        seed=2,
        observer=zivi.JointObserver(two_links(), noise=1e-5),
    )
    assert bouncing_error(run) < 4e-5
    assert is_pressed(run, 10.0, 2e-3)


def test_the_arm_lifts_off_on_command_and_at_once():
    arm = two_links()
    pull = {"floor": lambda t: -9.81 if t < 1.3 else 5.0}
    reference = zivi.reference_run(
        arm, (0, 1.6), (np.array([0.5, -1.2]), np.zeros(2)), virtual=pull, tstops=[1.3]
    )
    run = follow(tracker(), reference=reference)
    assert run.contacts[1299, 0]
    assert not run.contacts[1302, 0]
    late = run.t > 1.35
    assert np.abs(run.error_gaps[late]).max() < 1e-6


def test_a_contact_that_is_pressed_too_little_is_told_lost():
    pull = np.array([0.0, 6.0])  # lifts the tip by more than the force that was asked for
    run = follow(tracker(force={"floor": 0.5}), disturbance=pull)
    assert np.any(run.tick_status & zivi.TickStatus.LATCH_LOST)
    firm = follow(tracker(), disturbance=0.01 * pull)
    assert not np.any(firm.tick_status & zivi.TickStatus.LATCH_LOST)


def test_limits_of_the_torques_are_kept_and_the_arm_still_rests():
    limits = np.array([[-14.0, 14.0], [-5.0, 5.0]])
    with pytest.warns(zivi.ModelWarning, match="control updates of GapTracker were saturated"):
        run = follow(tracker(u_limits=limits))
    assert run.n_saturated == np.count_nonzero(run.tick_status & zivi.TickStatus.SATURATED)
    assert f"0 of {run.n_updates} control updates rejected, {run.n_saturated} saturated" in repr(
        run
    )
    assert np.all((run.u >= limits[:, 0]) & (run.u <= limits[:, 1]))
    assert np.any(run.tick_status & zivi.TickStatus.SATURATED)
    assert is_pressed(run, 10.0, 1e-2)


def test_gaps_that_no_control_reaches_are_refused():
    floor = zivi.LinearGap([0, 1], name="floor")
    system = zivi.MechanicalSystem(
        mass=np.eye(2), force=[0, -9.81], gaps=[floor], e=0.5, inputs=[[1.0], [0.0]]
    )
    ctl = zivi.GapTracker(system, h=1e-3, gains={"floor": (30, 17)})
    with pytest.raises(ValueError, match="must reach all 1 gaps"):
        ctl.step(0.0, [0, 1], [0, 0])


def test_directions_without_an_actuator_are_counted():
    floor = zivi.LinearGap([1, -1], name="floor")
    system = zivi.MechanicalSystem(
        mass=np.diag([1.0, 2.0]), force=[-9.81, 0], gaps=[floor], e=0.5, inputs=[[0.0], [1.0]]
    )
    ctl = zivi.GapTracker(system, h=1e-3, gains={"floor": (30, 17)})
    ctl.step(0.0, [1, 0], [0, 0])
    assert ctl.zero_dynamics == 1
    # S = -1/m_p and D = 1/m_b + 1/m_p
    assert ctl.least_singular_value == pytest.approx(0.5 / np.sqrt(1.5))


def test_states_copies_and_pickles_go_on_alike():
    arm, reference = two_links(), tapping()
    times = np.arange(0, 1.4, 1e-3)
    given = reference_of(reference, times, ("floor",), np.zeros(2))
    one = tracker(delay=1)
    for k in range(40):
        sample = given.sample(k)
        one.step_to(times[k], sample.q, sample.qdot, sample, given.sample(k + 1))
    others = [one.copy(), pickle.loads(pickle.dumps(one)), tracker(delay=1)]
    others[2].state = one.state
    sample, after = given.sample(40), given.sample(41)
    u = one.step_to(0.04, sample.q, sample.qdot, sample, after)
    for other in others:
        assert np.array_equal(other.step_to(0.04, sample.q, sample.qdot, sample, after), u)
    assert np.array_equal(arm.e, one.system.e)


def test_a_measurement_that_is_no_number_is_refused():
    ctl = tracker()
    u = ctl.step(0.0, [0.5, -1.0], [0, 0])
    assert np.array_equal(ctl.step(1e-3, [np.nan, 0], [0, 0]), u)
    assert ctl.status is zivi.TickStatus.REFUSED


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"gains": {}}, "gains must have an entry for each gap"),
        ({"gains": {"floor": (40, 22), "roof": (1, 1)}}, "unknown gap"),
        ({"force": {"floor": 0.0}}, "force"),
        ({"u_limits": [(1, -1), (0, 1)]}, "u_limits"),
        ({"delay": 65}, "delay"),
        ({"latch": (-1, 1)}, "latch"),
    ],
)
def test_settings_out_of_range_are_named(settings, message):
    with pytest.raises(ValueError, match=message):
        tracker(**settings)


def test_gaps_that_kick_each_other_need_a_motion_of_the_system():
    gaps = [zivi.LinearGap([1, 0], name="left"), zivi.LinearGap([0.6, 0.8], name="right")]
    system = zivi.MechanicalSystem(mass=np.eye(2), force=[0, 0], gaps=gaps, e=0.5)
    drop = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (0.3, 0))
    ctl = zivi.GapTracker(system, h=1e-3, gains={"left": (30, 17), "right": (30, 17)})
    with pytest.raises(ValueError, match=r"reference_run"):
        zivi.simulate_closed_loop(
            system, ctl, (0, 1), ([1, 1], [0, 0]), reference={"left": drop, "right": drop}
        )
    run = zivi.simulate_closed_loop(system, ctl, (0, 1.5), ([0.3, 0.2], [0, 0]), reference="rest")
    assert run.contacts[-1].all()


@pytest.mark.parametrize("cosine", [-0.6, 0.5])
def test_coupled_gaps_land_and_are_pressed_with_forces_of_their_own(cosine):
    sine = np.sqrt(1.0 - cosine**2)
    gaps = [zivi.LinearGap([1, 0], name="left"), zivi.LinearGap([cosine, sine], name="right")]
    system = zivi.MechanicalSystem(mass=np.eye(2), force=[0, 0], gaps=gaps, e=[0.6, 0.5])
    both = {"left": (40, 22), "right": (40, 22)}
    ctl = zivi.GapTracker(system, h=1e-3, gains=both, force={"left": 10.0, "right": 5.0})
    start = np.linalg.solve([[1, 0], [cosine, sine]], [0.15, 0.1])
    run = zivi.simulate_closed_loop(
        system, ctl, (0, 1.0), (start, [0, 0]), reference="rest", method=zivi.RKPeriod()
    )
    assert run.contacts[-1].all()
    np.testing.assert_allclose(run.reactions[-100:], [[10.0, 5.0]] * 100, atol=1e-9)


def test_a_gap_that_another_contact_pushes_open_lands():
    """One that is pressed as its landing would push it harder than it falls."""
    gaps = [zivi.LinearGap([1, 0], name="left"), zivi.LinearGap([0.3, 0.4], name="right")]
    system = zivi.MechanicalSystem(mass=np.eye(2), force=[0, 0], gaps=gaps, e=[0.84, 0.29])
    start = np.linalg.solve([[1, 0], [0.3, 0.4]], [0.05, 0.01])
    both = {"left": (40, 22), "right": (40, 22)}
    ctl = zivi.GapTracker(system, h=1e-3, gains=both)
    run = zivi.simulate_closed_loop(
        system, ctl, (0, 1.5), (start, [0, 0]), reference="rest", method=zivi.RKPeriod()
    )
    assert run.contacts[-1].all()


def test_forces_are_asked_for_when_the_control_acts():
    """Of a mass that rests on the floor, three periods after each measurement."""
    asked = []

    def force(t):
        asked.append(t)
        return 5.0 + t

    floor = zivi.LinearGap([1.0], name="floor")
    block = zivi.MechanicalSystem(mass=[[2.0]], force=[-19.62], gaps=[floor], e=0.5)
    law = zivi.GapTracker(block, h=0.01, gains={"floor": (30, 17)}, force={"floor": force}, delay=3)
    run = zivi.simulate_closed_loop(block, law, (0, 0.5), ([0], [0]), reference="rest", delay=3)
    assert asked == pytest.approx(0.01 * (3 + np.arange(50)), rel=1e-12)
    assert run.reactions[3:-1, 0] == pytest.approx(5.0 + run.t[3:-1], rel=1e-9)


@pytest.mark.parametrize(
    ("noise", "alpha", "horizon"), [(1e-6, 0.3, 1.0), (1e-5, 0.3, 3.0), (1e-4, 0.15, 5.0)]
)
def test_velocities_from_positions_are_as_uncertain_as_those_of_an_alpha_beta_filter(
    noise, alpha, horizon
):
    """Between impacts; at one model and plant may hit on either side of a sample."""
    observer = zivi.JointObserver(two_links(), noise=noise, alpha=alpha)
    run = follow(tracker(horizon=horizon), noise=(noise, 0.0), seed=1, observer=observer)
    hit = np.zeros(len(run.t), dtype=bool)
    for k in (run.impacts["t"] / H).astype(int):
        hit[k : k + 2] = True
    error = (run.qdot_est - run.qdot)[400:1000][~hit[400:1000]]
    beta = alpha**2 / (2 - alpha)
    closed = noise / H * np.sqrt(2 * beta**2 / (alpha * (4 - 2 * alpha - beta)))
    assert np.sqrt(np.mean(error**2)) == pytest.approx(closed, rel=0.15)
