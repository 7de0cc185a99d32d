"""What controllers and closed loops refuse, and the gain conditions against simulated masses."""

import inspect
import math
import re
from pathlib import Path

import numpy as np
import pytest

import zivi
from control_loops import PAPER, PLANT, Scripted
from inside import CONTROLLERS, Shared, _zivi, files_file_keys as file_keys

WITH_REFERENCE = [zivi.TwistingTracker, zivi.ExplicitTwisting]


def at_rest(mu1, mu2, e, d, **more):
    """Track a reference at rest for 20 s, with `d` unknown."""
    tracker = zivi.TwistingTracker(mu1, mu2, h=1e-3, e=e, **more)
    plant = zivi.ImpactSystem(-9.81 + d, e=e)
    return zivi.simulate_closed_loop(
        plant, tracker, (0, 20), (1, 0), force_model=-9.81, y_ref0=(0, 0), force_ref=-9.81
    )


def rising(mu1, mu2, e, d, **more):
    """Error of a rising reference after 1.4 s, with `d` unknown."""
    tracker = zivi.TwistingTracker(mu1, mu2, h=1e-3, e=e, **more)
    plant, start = zivi.ImpactSystem(-9.81 + d, e=e), {"y_ref0": (0.5, 6), "force_ref": -4}
    run = zivi.simulate_closed_loop(
        plant, tracker, (0, 1.4), (0.3, 5.5), force_model=-9.81, **start
    )
    return abs(run.error[-1])


def test_the_trackers_bound_keeps_the_mass():
    """What was accepted once flew away: 300 m with half the force that the gains were to hold."""
    assert at_rest(30, 17, 0.05, 6).x[-1] == pytest.approx(301, abs=1)  # as in results/loops.md
    with pytest.raises(ValueError, match=r"mu2 must be greater than .* = 6[23]\..* bound = 6\.0"):
        zivi.TwistingTracker(30, 17, h=1e-3, e=0.05, bound=6)
    for d in (-6, 6):
        assert at_rest(140, 70, 0.05, d, bound=6).x[-1] < 1e-4


def test_the_trackers_bound_catches_a_rising_reference():
    assert rising(30, 17, 0.2, 8) == pytest.approx(0.34, abs=5e-3)  # as in results/loops.md
    with pytest.raises(ValueError, match=r"mu2 must be greater than bound \(1 \+ e\)/\(2 e\)"):
        zivi.TwistingTracker(30, 17, h=1e-3, e=0.2, bound=8)
    for d in (-3, 3):
        assert rising(30, 17, 0.2, d, bound=3) < 1e-5
    for d in (-8, 8):
        assert rising(60, 30, 0.2, d, bound=8) < 2e-5


@pytest.mark.parametrize("kind", WITH_REFERENCE)
@pytest.mark.parametrize("e", [0.05, 1 / 3, 0.8, 1.0])
def test_where_the_trackers_condition_ends(kind, e):
    """M (1 + e)/(2 e) < mu2 < mu1 - M (1 + e)/(2 e), with the numbers in the message."""
    share = 2 * e / (1 + e)
    for mu1, mu2, name in ((30, 17, "mu1"), (40, 17, "mu2")):
        most = share * min(mu2, mu1 - mu2)
        kind(mu1, mu2, h=1e-3, e=e, bound=most * (1 - 1e-9))
        with pytest.raises(ValueError, match=f"{name} must be greater than") as caught:
            kind(mu1, mu2, h=1e-3, e=e, bound=most * (1 + 1e-9))
        least = float(str(caught.value).partition(" = ")[2].split()[0])
        assert math.isclose(least, mu1 if name == "mu1" else mu2, rel_tol=1e-6)
        assert f"got {float(mu1 if name == 'mu1' else mu2)}" in str(caught.value)


@pytest.mark.parametrize(("bound", "holds"), [(2.2, True), (2.4, False)])
def test_the_regulators_bound_is_where_bounces_begin_to_grow(bound, holds):
    """Against the worst force, bound sgn x': e^2 (D + M)/(U - M) is the ratio of their energies."""
    settings = {"h": 1e-4, "e": 0.5}
    if holds:
        zivi.TwistingRegulator(3, 0.5, bound=bound, **settings)
    else:
        with pytest.raises(ValueError, match=r"mu2 must be greater than bound - mu1 \(1 - e\^2\)"):
            zivi.TwistingRegulator(3, 0.5, bound=bound, **settings)
    plant = zivi.ImpactSystem(lambda t, x, v: math.copysign(bound, v), e=0.5)
    regulator = zivi.TwistingRegulator(3, 0.5, **settings)
    run = zivi.simulate_closed_loop(plant, regulator, (0, 8), (1, 0), force_model=0.0)
    speeds = run.resolved_impacts["xdot_before"][:4]
    ratio = 0.5 * math.sqrt((2.5 + bound) / (3.5 - bound))
    assert (ratio < 1) == holds
    np.testing.assert_allclose(speeds[1:] / speeds[:-1], ratio, rtol=1e-3)


def test_the_regulators_bound_leaves_room_to_fall():
    zivi.TwistingRegulator(3, 2, h=1e-3, e=0.5, bound=0.99)
    with pytest.raises(ValueError, match=r"mu1 must be greater than mu2 \+ bound = 3\.0"):
        zivi.TwistingRegulator(3, 2, h=1e-3, e=0.5, bound=1.0)


@pytest.mark.parametrize("kind", [*WITH_REFERENCE, zivi.TwistingRegulator])
def test_gains_bounds_and_depths_that_cannot_be(kind):
    for settings, name in (
        ({"mu1": 1.1e150}, "mu1"),
        ({"mu1": 1e300, "mu2": 1e299}, "mu1"),
        ({"bound": -1.0}, "bound"),
        ({"bound": math.inf}, "bound"),
        ({"depth": math.inf}, "depth"),
        ({"depth": math.nan}, "depth"),
    ):
        with pytest.raises(ValueError, match=f"^{name} must be "):
            kind(**PAPER | settings)
    kind(**PAPER | {"mu1": 1e150})


@pytest.mark.parametrize("branch", ["positive", "nearest"])
def test_the_largest_gains_scale_like_small_ones(branch):
    """The step is homogeneous in gains, forces and states; a power of 2 loses no digit."""
    rng, c = np.random.default_rng(8), 2.0**480
    for _ in range(200):
        x, xr = rng.uniform(0, 2, 2) * 10 ** rng.uniform(-6, 0)
        v, vr = rng.uniform(-4, 4, 2)
        controls = []
        for scale in (1.0, c):
            gains = (30 * scale, 17 * scale)
            tracker = zivi.TwistingTracker(*gains, h=1e-2, e=0.5, branch=branch)
            tracker.reset(xr * scale, vr * scale)
            force = (-9.81 * scale, -19.81 * scale)
            controls.append(tracker.step(x * scale, v * scale, *force) / scale)
        assert controls[0] == controls[1]


@pytest.mark.parametrize("kind", [*WITH_REFERENCE, zivi.TwistingRegulator])
def test_a_state_has_signs_of_signs(kind):
    controller = kind(**PAPER)
    *head, signs, bits = controller.state
    controller.state = (*head, [1.0, -1.0, *signs[2:]], bits)
    for sign in (1.0000001, -200.0, math.nan):
        before = controller.state
        with pytest.raises(ValueError, match="state must be what a controller's state gave"):
            controller.state = (*head, [sign, *signs[1:]], bits)
        assert controller.state == before


@pytest.mark.parametrize("kind", WITH_REFERENCE)
def test_a_reference_reset_into_the_wall_has_left_it(kind):
    """A reset to an incoming state at the wall and to the one after its impact are the same."""
    e = 0.4
    incoming, after = (kind(30, 17, h=1e-3, e=e) for _ in range(2))
    incoming.reset(0.0, -3.0)
    after.reset(0.0, e * 3.0)
    assert incoming.state[2] == 1.0  # on its branch, from the first tick on
    assert (incoming.x_ref, incoming.xdot_ref) == pytest.approx((0.0, 1.2), rel=1e-15)
    for x, xdot in ((0.3, 0.0), (0.01, -2.0), (0.0, 1.0)):
        one, other = incoming.copy(), after.copy()
        u = one.step(x, xdot, -9.81, -9.81)
        assert u == pytest.approx(other.step(x, xdot, -9.81, -9.81), rel=1e-12)
        assert one.x_ref == pytest.approx(other.x_ref, rel=1e-12)


class Answering:
    """A controller of someone else's, whose step returns this."""

    h = 0.1

    def __init__(self, answer):
        self.answer = answer

    def step(self, x, xdot, force):
        return self.answer


@pytest.mark.parametrize("answer", [None, np.array([1.0]), [1.0], "1", 1j])
def test_what_a_step_must_return(answer):
    with pytest.raises(TypeError, match=r"^controller\.step must return a number") as caught:
        zivi.simulate_closed_loop(PLANT, Answering(answer), (0, 1), (1, 0))
    assert type(answer).__name__ in str(caught.value)
    assert caught.value.trajectory.status is zivi.Status.RAISED


@pytest.mark.parametrize("answer", [2, 2.0, np.float32(2), np.array(2.0), np.int64(2)])
def test_every_number_is_a_control(answer):
    run = zivi.simulate_closed_loop(PLANT, Answering(answer), (0, 1), (1, 0))
    assert np.all(run.u == 2)


@pytest.mark.parametrize("name", ["force_ref", "y_ref0"])
def test_nothing_of_a_reference_is_taken_without_one(name):
    given = {name: -9.81 if name == "force_ref" else (1, 0)}
    regulator = zivi.TwistingRegulator(**PAPER)
    for controller in (regulator, Scripted([1.0])):
        message = f"{name} must be None: {type(controller).__name__} does not follow a reference"
        with pytest.raises(TypeError, match=message):
            zivi.simulate_closed_loop(PLANT, controller, (0, 1), (1, 0), **given)
    several = [zivi.TwistingTracker(**PAPER), regulator]
    with pytest.raises(TypeError, match=f"{name} must be None: TwistingRegulator does not follow"):
        zivi.simulate_closed_loop_batch(PLANT, several, (0, 1), (1, 0), **given)


@pytest.mark.parametrize("method", [None, zivi.SwitchedRK()])
def test_a_rest_lasts_a_period(method):
    """A mass lifted in every other period rests at the end of each: not until the end."""

    def rung(periods, controls):
        plant = zivi.ImpactSystem(0.0, e=0.1)
        span = (0, 0.1 * periods)
        return zivi.simulate_closed_loop(plant, Scripted(controls), span, (0, 0), method=method)

    ringing = rung(8, [5.0, -60.0])
    assert (ringing.x[-1], ringing.xdot[-1]) == (0, 0)
    assert len(ringing.zeno_times) == len(ringing.liftoff_times) == 4
    assert ringing.rest_time is None
    # a whole period of it, wherever it begins and ends
    controls = [5.0, -60.0] * 4 + [-60.0, -60.0]
    last = ringing.zeno_times[-1]
    for periods in (9, 9.5, 10 * last + 1 + 1e-3):
        assert rung(periods, controls).rest_time == last
    assert rung(10 * last + 1 - 1e-3, controls).rest_time is None
    batch = zivi.simulate_closed_loop_batch(
        zivi.ImpactSystem(-9.81, kappa=0.5), zivi.TwistingRegulator(**PAPER), (0, 1e-3), (0, 0)
    )
    assert batch.rest_time[0] == 0.0  # from the start to the end, a whole period


def test_ranges_and_defaults_are_those_of_the_core():
    shared = {"h": 1e-3, "kappa": 0.5}
    makes = {
        "TwistingRegulator": lambda **it: zivi.TwistingRegulator(3.0, 2.0, **shared, **it),
        "TwistingTracker": lambda **it: zivi.TwistingTracker(30.0, 17.0, **shared, **it),
        "ExplicitTwisting": lambda **it: zivi.ExplicitTwisting(30.0, 17.0, **shared, **it),
        "ImpactObserver": lambda **it: zivi.ImpactObserver(0.5, 1e-3, **it),
    }
    assert set(makes) == set(_zivi.CONTROL_SETTINGS)
    for kind, make in makes.items():
        given = {it.name: it for it in _zivi.CONTROL_SETTINGS[kind] if it.name != "noise"}
        settings = make().settings
        assert {name: settings[name] for name in given} == {
            n: it.default for n, it in given.items()
        }
        for name, it in given.items():
            assert make(**{name: it.least}).settings[name] == it.least
            for wrong in (it.least - 1e-9, math.inf, math.nan):
                with pytest.raises(ValueError, match=f"^{name} must be {re.escape(it.range)}, got"):
                    make(**{name: wrong})
    noise = [it.default for it in _zivi.CONTROL_SETTINGS["ImpactObserver"] if it.name == "noise"]
    assert makes["ImpactObserver"]().settings["noise"] == tuple(noise)


def test_every_controller_is_in_the_list_and_files_have_all_its_settings():
    public = {getattr(zivi, name) for name in zivi.__all__}
    assert set(CONTROLLERS) == {
        it for it in public if isinstance(it, type) and issubclass(it, Shared)
    }
    for kind in CONTROLLERS:
        parameters = inspect.signature(kind).parameters
        assert {key.name for key in file_keys.CONTROLLERS[kind.__name__]} == set(parameters)


def test_a_controller_is_named_only_where_it_is_made_and_handed_on():
    """Its tick, its place in a loop, its binding, its class; who uses one of them is above."""
    root = Path(__file__).parents[1]
    users = ("python/zivi/lab", "python/zivi/paper", "crates/zivi-wasm")
    files = [*root.glob("crates/*/src/**/*.rs"), *root.glob("python/zivi/**/*.py*")]
    naming = {
        path.relative_to(root).as_posix()
        for path in files
        if path.suffix != ".pyc" and re.search(r"\bExplicitTwisting\b", path.read_text("utf-8"))
    }
    tick = {f"crates/zivi-core/src/control/{name}.rs" for name in ("regulator", "reference", "mod")}
    loop = {"crates/zivi/src/drive/closed_loop/controller.rs"}
    assert {it for it in naming if not it.startswith(users)} == {
        *tick,
        *loop,
        "python/zivi/__init__.py",
        "crates/zivi-py/src/control/mass.rs",
        "crates/zivi-py/src/control/mod.rs",
        "python/zivi/control/twisting.py",
    }
    binding = {
        path.name
        for path in root.glob("crates/zivi-py/src/**/*.rs")
        if re.search(r"\bcontrol::[{(]?.*\b(Explicit|Regulator|Tracker)\b", path.read_text("utf-8"))
    }
    assert not binding
