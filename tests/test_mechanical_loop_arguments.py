"""Wrong arguments, models and samples of loops of mechanical systems are told before any run."""

import math

import numpy as np
import pytest

import zivi
from mechanical_arms import PADDLE, START, tapping, tracker, two_links

START_STATE = (START, np.zeros(2))


def loop(controller=None, **asked):
    asked = {"reference": "rest"} | asked
    own = tracker() if controller is None else controller
    return zivi.simulate_closed_loop(two_links(), own, (0, 0.05), START_STATE, **asked)


def ball(n=1, name="floor", inputs=None):
    return zivi.MechanicalSystem(
        mass=np.eye(n),
        force=[0.0] * (n - 1) + [-9.81],
        gaps=[zivi.LinearGap([0] * (n - 1) + [1], name=name)],
        e=0.5,
        inputs=np.eye(n) if inputs is None else inputs,
    )


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"gains": [(40, 22)]}, "gains must be a dict by names, got list"),
        ({"gains": None}, "gains must be a dict by names"),
        ({"force": 5.0}, "force must be a dict by names, got float 5.0"),
        ({"tasks": ["x"]}, "tasks must be a dict by names"),
    ],
)
def test_what_is_given_by_names_must_be_a_dict(settings, words):
    with pytest.raises(TypeError, match=words):
        tracker(**settings)


@pytest.mark.parametrize("force", [math.nan, -5.0, 0.0, math.inf])
def test_a_force_that_a_function_gives_is_checked_when_it_is_asked(force):
    ctl = tracker(force={"floor": lambda t: force})
    with pytest.raises(ValueError, match=r"force\['floor'\]\([0-9.e-]+\) must be finite and > 0"):
        zivi.simulate_closed_loop(
            two_links(), ctl, (0, 1.5), START_STATE, reference=tapping(), method=zivi.RKPeriod()
        )


@pytest.mark.parametrize(
    ("system", "words"),
    [
        (ball(1), "2 coordinates like the plant, got 1"),
        (ball(3), "2 coordinates like the plant, got 3"),
        (ball(2, name="wall"), r"the gaps of the plant, \('floor',\), got \('wall',\)"),
        (ball(2, inputs=[[0.0], [1.0]]), "2 controls like the plant, got 1"),
    ],
)
def test_a_model_of_another_system_is_refused(system, words):
    ctl = zivi.GapTracker(system, h=1e-3, gains=dict.fromkeys(system.gap_names, (40, 22)))
    with pytest.raises(ValueError, match=f"controller must have {words}"):
        loop(ctl)
    with pytest.raises(ValueError, match=f"observer must have {words}"):
        loop(observer=zivi.JointObserver(system))


def test_a_controller_of_one_mass_is_refused():
    with pytest.raises(TypeError, match="TwistingTracker is of one mass"):
        loop(zivi.TwistingTracker(40, 22, h=1e-3, e=0.5), reference=None)


@pytest.mark.parametrize(
    ("disturbance", "words"),
    [
        ([1.0], r"disturbance must be finite and of shape \(2,\)"),
        ([math.nan, 0.0], r"disturbance must be finite and of shape \(2,\)"),
        (lambda t, q, qdot: [1.0], r"disturbance must give shape \(2,\), got \(1,\)"),
    ],
)
def test_disturbances_are_a_force_on_each_coordinate(disturbance, words):
    with pytest.raises(ValueError, match=words):
        loop(disturbance=disturbance)


def outcome(ctl, state):
    """What is told of a state, and None where it can be used."""
    try:
        ctl.state = state
        ctl.step(1e-3, [math.nan, 0.0], np.zeros(2))
        u = ctl.step(1e-3, START, np.zeros(2))
    except ValueError as error:
        return str(error)
    return None if np.all(np.isfinite(u)) else "not finite"


def test_a_state_of_another_tracker_is_refused_not_used():
    ctl = tracker(delay=2)
    ctl.step(0.0, START, np.zeros(2))
    good = ctl.state
    for k in range(len(good)):
        for wrong in (None, "a", (1.0, 2.0, 3.0), (math.nan, math.nan), -1):
            bad = tuple(wrong if i == k else it for i, it in enumerate(good))
            twin = ctl.copy()
            words = outcome(twin, bad)
            assert words is None or "state" in words, (k, wrong, words)
    for wrong in (None, (), 5, good[:-1]):
        with pytest.raises(ValueError, match="state must be what a GapTracker of these gaps gave"):
            ctl.state = wrong


@pytest.mark.parametrize("kind", ["tracker", "striker"])
def test_measurements_that_no_control_answers_hold_the_last_one(kind):
    ctl = (
        tracker()
        if kind == "tracker"
        else zivi.Striker(PADDLE, gap="racket", body="ball", apex=0.5)
    )
    at = np.array([0.4, 0.1]) if kind == "striker" else START
    first = ctl.step(0.0, at, np.zeros(2))
    assert np.array_equal(ctl.step(1e-3, at, [1e308, -1e308]), first)
    assert ctl.status & zivi.TickStatus.REFUSED
    assert np.all(np.isfinite(ctl.step(2e-3, at, np.zeros(2))))
    with pytest.raises(ValueError, match="t must be finite"):
        ctl.step(math.nan, at, np.zeros(2))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"place": math.nan}, "place must be finite, got nan"),
        ({"posture": -1.0}, "posture must be finite and >= 0, got -1.0"),
        ({"interval": math.inf}, "interval must be finite, got inf"),
        ({"h": math.nan}, "h must be finite, got nan"),
    ],
)
def test_settings_of_a_striker_are_in_range(settings, words):
    with pytest.raises(ValueError, match=words):
        zivi.Striker(PADDLE, gap="racket", body="ball", apex=0.5, **settings)


def test_a_striker_takes_only_its_own_state_and_its_own_coordinates():
    ctl = zivi.Striker(PADDLE, gap="racket", body="ball", apex=0.5)
    ctl.step(0.0, [0.4, 0.0], np.zeros(2))
    for wrong in (None, (), 5, ctl.state[:-1]):
        with pytest.raises(ValueError, match="state must be what a Striker gave"):
            ctl.state = wrong
    with pytest.raises(ValueError, match=r"q must have shape \(2,\), got \(3,\)"):
        ctl.step(0.0, np.zeros(3), np.zeros(3))
    with pytest.raises(TypeError, match="learn must be True or False"):
        zivi.Striker(PADDLE, gap="racket", body="ball", apex=0.5, learn=2)


def test_missed_samples_of_joints_are_bridged_by_the_model():
    rng = np.random.default_rng(3)
    arm, h = two_links(), 1e-3
    run = zivi.simulate(arm, (0, 0.15), (START, [1.0, -2.0]), zivi.SwitchedRK(rtol=1e-10))
    times = h * np.arange(151)
    q, qdot = run(times)
    watch = zivi.JointObserver(arm, noise=1e-6).begun(h, 2)
    # nothing is known before the first sample
    assert np.isnan(watch.step(0.0, [math.nan, 0.0], np.zeros(2))).all()
    missed = rng.random(151) < 0.5
    missed[[1, 3]], missed[[2, 4]] = False, True
    errors = []
    for k in range(1, 151):
        seen = np.full(2, math.nan) if missed[k] else q[k]
        _, speed = watch.step(float(times[k]), seen, np.zeros(2))
        errors.append(np.abs(speed - qdot[k]).max())
    assert errors[2] < 0.05  # the second sample gives the speed, over the missed one
    assert max(errors[100:]) < 1e-3


@pytest.mark.parametrize(
    ("q", "u", "words"),
    [
        ([0.5, -1.2], [0.0], "u must be 2 finite controls"),
        ([0.5, -1.2], [0.0, math.nan], "u must be 2 finite controls"),
        ([0.5], [0.0, 0.0], r"q must have shape \(2,\), got \(1,\)"),
    ],
)
def test_an_observer_says_what_is_wrong_with_a_sample(q, u, words):
    watch = zivi.JointObserver(two_links()).begun(1e-3, 2)
    watch.step(0.0, START, np.zeros(2))
    with pytest.raises(ValueError, match=words):
        watch.step(1e-3, q, u)


@pytest.mark.parametrize(
    ("asked", "error", "words"),
    [
        ({"virtual": 5}, TypeError, "virtual must be a dict by names"),
        ({"virtual": {"floor": math.nan}}, ValueError, r"virtual\['floor'\] must be finite"),
        ({"virtual": {"floor": lambda t: "a"}}, TypeError, r"virtual\['floor'\] must be a real"),
        ({"gains": (-1, 1)}, ValueError, "gains must be finite and >= 0, got -1.0"),
        ({"y0": None}, TypeError, r"y0 must be \(q0, qdot0\)"),
        ({"system": 5}, TypeError, "system must be a zivi.MechanicalSystem, got int"),
    ],
)
def test_arguments_of_a_reference_run(asked, error, words):
    asked = {"system": two_links(), "y0": START_STATE, "virtual": {"floor": -9.81}} | asked
    with pytest.raises(error, match=words):
        zivi.reference_run(asked.pop("system"), (0, 0.1), asked.pop("y0"), **asked)


@pytest.mark.parametrize(
    ("asked", "error", "words"),
    [
        ({"parameters": 5}, TypeError, "parameters must be a dict by names"),
        ({"parameters": {"m2": []}}, ValueError, r"parameters\['m2'\] must be a number or one"),
        ({"starts": np.zeros((0, 2, 2))}, ValueError, r"shape \(N, 2, n\), got \(0, 2, 2\)"),
        ({"y_ref0": (1, 0)}, TypeError, "y_ref0 is for a zivi.ImpactSystem"),
        ({"t_eval": [0.0]}, TypeError, "t_eval is for a zivi.ImpactSystem"),
    ],
)
def test_arguments_of_a_batch(asked, error, words):
    starts = asked.pop("starts", START_STATE)
    with pytest.raises(error, match=words):
        zivi.simulate_closed_loop_batch(
            two_links(), tracker(), (0, 0.1), starts, reference="rest", **asked
        )


def test_gap_coordinates_say_what_is_wrong():
    with pytest.raises(TypeError, match=r"system must be a zivi\.MechanicalSystem, got int"):
        zivi.mechanics.gap_coordinates(5, [0.0], [0.0])
    with pytest.raises(ValueError, match="qdot must be finite"):
        zivi.mechanics.gap_coordinates(two_links(), START, [math.nan, 0.0])
