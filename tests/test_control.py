"""The controllers' ticks against a second solution of their steps, and how they are used."""

import copy
import inspect
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, strategies as st

import zivi
from control_oracle import EPS, Regulation, Tracking, lifted, projected, reference_solution, sgn

PAPER = {"mu1": 30.0, "mu2": 17.0, "h": 1e-3, "kappa": 0.5}
WITH_REFERENCE = [zivi.TwistingTracker, zivi.ExplicitTwisting]
CONTROLLERS = [*WITH_REFERENCE, zivi.TwistingRegulator]
NAN, INF = math.nan, math.inf


def tick(controller, x=1.0, xdot=-0.5, force=-9.81, force_ref=-19.81):
    if isinstance(controller, zivi.TwistingRegulator):
        return controller.step(x, xdot, force)
    return controller.step(x, xdot, force, force_ref)


def log_uniform(rng, low, high):
    return 10 ** rng.uniform(low, high)


def draw(rng, branch, near):
    """A random tracker with its reference somewhere, a measurement, and the oracle's step of both.

    `near` puts the states where the case distinctions are: within a few periods of the wall and
    of each other.
    """
    h, kappa = log_uniform(rng, -4, -1), rng.uniform(0.02, 0.95)
    kappa_ref = kappa if rng.random() < 0.5 else rng.uniform(0.02, 0.95)
    mu1 = rng.uniform(2, 40)
    mu2 = mu1 * rng.uniform(0.1, 0.9)
    f, f_ref = rng.normal(0, 8), -log_uniform(rng, -1, 1.5)
    speed = h * 30 if near else 4.0
    x, x_ref = np.abs(rng.normal(0, h * speed if near else 1.0, 2))
    xdot, xdot_ref = rng.normal(0, speed, 2)
    controller = zivi.TwistingTracker(
        mu1, mu2, h=h, kappa=kappa, kappa_ref=kappa_ref, branch=branch, depth=0.0, landing=False
    )
    controller.reset(x_ref, xdot_ref)
    # the reference through a few periods, so that the branch "nearest" has a side
    for _ in range(rng.integers(0, 4)):
        controller.step(x, xdot, f, f_ref)
    z, z_ref = np.array(lifted(x, xdot, kappa)), np.array(controller.state[:2])
    energy = [mu1 * abs(s - z_ref[0]) + (v - z_ref[1]) ** 2 / 2 for s, v in (z, -z)]
    # the reference at rest has a side, too
    tie, side = not z_ref.any(), controller.state[2]
    if branch == "nearest" and (side < 0 if tie else energy[1] < energy[0]):
        z = -z
    problem = Tracking(h, kappa, kappa_ref, mu1, mu2, tuple(z), tuple(z_ref), f, f_ref)
    return controller, (x, xdot, f, f_ref), problem


@pytest.mark.parametrize("branch", ["positive", "nearest"])
@pytest.mark.parametrize("near", [False, True], ids=["wide", "near"])
def test_signs_put_back_solve_the_step(branch, near):
    """Residuals at rounding level: up to 2e-15 over these draws, relative to the terms."""
    rng = np.random.default_rng(1)
    for _ in range(1500):
        controller, sample, problem = draw(rng, branch, near)
        u = controller.step(*sample)
        *_, u_of_signs = problem.ends(controller.signs)
        scale = (1 + problem.kappa) * (problem.mu1 + problem.mu2) + abs(problem.f)
        scale += 2 * abs(problem.f_ref) / (1 - problem.kappa_ref)
        assert abs(u - u_of_signs) <= 16 * EPS * scale
        assert controller.u == u
        assert problem.residuals(controller.signs).max() <= 1e-13


@pytest.mark.parametrize("branch", ["positive", "nearest"])
@pytest.mark.parametrize("near", [False, True], ids=["wide", "near"])
def test_ticks_agree_with_enumeration(branch, near):
    """Of all solutions the tick takes the one that the rule names; several do occur.

    Without the references that end on the wall: plant and reference both on it is a continuum of
    signs.
    """
    rng = np.random.default_rng(2)
    several = walls = free = 0
    for _ in range(1000):
        controller, sample, problem = draw(rng, branch, near)
        u = controller.step(*sample)
        s, v, sr, vr, _ = problem.ends(controller.signs)
        _, _, lsr, lvr, _, _ = controller.signs
        if abs(lsr) < 1:
            continue
        _, _, a = problem.reference(lsr, lvr)
        target = sr, vr if abs(lvr) == 1 else 0.0, a
        found = problem.solutions(target, lvr)
        place, s_found, v_found, u_found = problem.selected(target, lvr)
        free += v_found == 0 and place != 0
        several += len(found) > 1
        walls += place == 0
        # the cubic's roots lose half the digits where two of them meet, and u divides by h
        size_v = abs(problem.z[1]) + problem.h * (problem.mu1 + problem.mu2 + abs(a))
        assert abs(v - v_found) <= 1e-6 * size_v
        assert abs(s - s_found) <= 1e-6 * (abs(problem.z[0]) + problem.h * size_v)
        assert abs(u - u_found) <= 1e-5 * (problem.mu1 + problem.mu2 + abs(a) + abs(problem.f))
    assert several >= (30 if near else 2)
    assert walls >= (30 if near else 2)
    assert free >= (3 if near else 0)


@pytest.mark.parametrize("near", [False, True], ids=["wide", "near"])
def test_the_reference_solves_its_step(near):
    """For a force onto the wall it has one solution, and the tracker advances to it."""
    rng = np.random.default_rng(3)
    for _ in range(400):
        controller, sample, problem = draw(rng, "nearest", near)
        controller.step(*sample)
        if problem.z_ref[0] == 0:
            continue
        problem_ref = problem.z_ref, problem.f_ref, problem.h, problem.kappa_ref
        ends = np.array(reference_solution(*problem_ref))
        size = np.abs(problem.z_ref) + problem.h * abs(problem.f_ref)
        assert len(ends) >= 1
        assert np.all(np.ptp(ends, axis=0) <= 1e-12 * size)  # one, perhaps found twice
        end = np.array(controller.state[:2])
        np.testing.assert_array_less(np.abs(end - ends[0]), 1e-11 * size + 1e-300)
        x, xdot = projected(*end, problem.kappa_ref)
        assert math.isclose(controller.x_ref, x, rel_tol=1e-14)
        assert math.isclose(controller.xdot_ref, xdot, rel_tol=1e-14, abs_tol=1e-300)


@pytest.mark.parametrize("kind", WITH_REFERENCE)
@pytest.mark.parametrize("force_ref", [-19.81, 2.0, 0.0])
def test_the_reference_takes_the_steps_of_simulate(kind, force_ref):
    """Bit by bit those of `ThetaGamma(h)`, through its impacts and its Zeno point."""
    h, n = 2.0**-9, 900
    system = zivi.ImpactSystem(force_ref, kappa=0.5)
    sol = zivi.simulate(system, (0, n * h), (3, 3), method=zivi.ThetaGamma(h=h))
    settings = {"branch": "nearest"} if kind is zivi.TwistingTracker else {}
    controller = kind(**PAPER | {"h": h}, **settings)
    controller.reset(3, 3)
    states = [(controller.x_ref, controller.xdot_ref)]
    for _ in range(n):
        controller.step(1.0, 0.0, -9.81, force_ref)
        states.append((controller.x_ref, controller.xdot_ref))
    x, xdot = np.transpose(states)
    if kind is zivi.TwistingTracker:
        np.testing.assert_array_equal(x, sol.x)
        np.testing.assert_array_equal(xdot, sol.xdot)
    else:  # folded every period: the same up to signs of rounding
        np.testing.assert_allclose(x, sol.x, rtol=0, atol=1e-12)
    if force_ref < -1:
        assert len(sol.resolved_impacts) > 1
        assert x[-1] == xdot[-1] == 0


def test_mirrored_states_give_the_same_control():
    """(s, v, s_r, v_r, signs) -> -(...): the same physical states, the same control."""
    rng = np.random.default_rng(4)
    for near in (False, True):
        for _ in range(300):
            controller, sample, _ = draw(rng, "nearest", near)
            twin = controller.copy()
            s, v, side, *rest = controller.state
            if s == v == 0:
                continue  # no side is nearer
            twin.state = (-s, -v, -side, *rest)
            assert (twin.x_ref, twin.xdot_ref) == (controller.x_ref, controller.xdot_ref)
            u, mirrored = controller.step(*sample), twin.step(*sample)
            assert u == mirrored
            np.testing.assert_array_equal(twin.signs, -controller.signs)
            assert (twin.x_ref, twin.xdot_ref) == (controller.x_ref, controller.xdot_ref)


def test_the_branches_differ_only_by_the_side():
    """With everything on the positive side both branches are the same controller."""
    one, other = (zivi.TwistingTracker(**PAPER, branch=b) for b in ("positive", "nearest"))
    for controller in (one, other):
        controller.reset(3, 3)
    for k in range(200):
        sample = (3 + 0.01 * k, 3.0 - 0.1 * k, -9.81, -19.81)
        assert one.step(*sample) == other.step(*sample)
    # falling plant, rising reference: the nearest preimage is the other one
    for controller in (one, other):
        controller.reset(0.1, 5.0)
    sample = (0.1, -5.0, -9.81, -19.81)
    assert one.step(*sample) != other.step(*sample)
    assert one.signs[0] == 1
    assert other.signs[0] == -1


def test_the_regulator_solves_its_step():
    rng = np.random.default_rng(5)
    cases = set()
    for k in range(3000):
        near = k % 2
        h, kappa = log_uniform(rng, -4, -1), rng.uniform(0.02, 0.95)
        bound = rng.uniform(0.1, 10)
        mu2 = bound * rng.uniform(1.05, 3)
        mu1 = (mu2 + bound) * rng.uniform(1.05, 2)
        f = rng.uniform(-bound, bound)
        x = abs(rng.normal(0, h * h * mu1 if near else 1))
        xdot = rng.normal(0, 5 * h * mu1 if near else 4)
        settings = {"kappa": kappa, "bound": bound, "landing": False}
        controller = zivi.TwistingRegulator(mu1, mu2, h=h, **settings)
        u = controller.step(x, xdot, f)
        problem = Regulation(h, kappa, mu1, mu2, lifted(x, xdot, kappa), f)
        assert problem.residuals(controller.signs).max() <= 1e-13
        assert abs(u - problem.ends(*controller.signs)[2]) <= 4 * EPS * (mu1 + mu2)
        # within the gain condition there is one solution
        found = np.array(list(problem.solutions()))
        assert len(found) >= 1
        ends = np.array([problem.ends(*signs)[:2] for signs in found])
        size = abs(problem.z[1]) + h * mu1 / (1 - kappa)
        assert np.ptp(ends[:, 1]) <= 1e-9 * size
        assert abs(ends[0, 1] - problem.ends(*controller.signs)[1]) <= 1e-9 * size
        cases.add(tuple(np.sign(controller.signs) * (np.abs(controller.signs) == 1)))
    assert len(cases) >= 5  # both sides, both velocities, the wall, a stop


def test_the_regulator_brakes_without_chattering_at_rest():
    controller = zivi.TwistingRegulator(3, 2, h=1e-3, kappa=0.5, landing=False)
    assert controller.step(0, 0, 0.0) == -3
    np.testing.assert_array_equal(controller.signs, [0, 0])


@pytest.mark.parametrize("x", [0.5, 2.0])
@pytest.mark.parametrize("xdot", [-1.0, 0.0, 1.0])
def test_the_explicit_law(x, xdot):
    """u = R [ -mu1 sgn(s - sr) - mu2 sgn(v - vr) + Fr/Rr ] - F with the signs of the sample."""
    controller = zivi.ExplicitTwisting(**PAPER)
    controller.reset(1.0, -2.0)
    (s, v), (sr, vr) = lifted(x, xdot, 0.5), lifted(1.0, -2.0, 0.5)
    r, r_ref = 1 - 0.5 * sgn(v), 1 + 0.5
    u = r * (-30 * sgn(s - sr) - 17 * sgn(v - vr) - 19.81 / r_ref) + 9.81
    assert math.isclose(controller.step(x, xdot, -9.81, -19.81), u, rel_tol=1e-14)
    np.testing.assert_array_equal(controller.signs, [1, sgn(v), 1, -1, sgn(s - sr), sgn(v - vr)])


MAGNITUDES = st.floats(0, 1e3)
SIGNED = st.floats(-1e3, 1e3)


@given(
    x=MAGNITUDES,
    xdot=SIGNED,
    x_ref=MAGNITUDES,
    xdot_ref=SIGNED,
    force=SIGNED,
    force_ref=SIGNED,
    h=st.floats(1e-6, 1),
    kappa=st.floats(0, 0.99),
    kappa_ref=st.floats(0, 0.99),
    mu1=st.floats(1e-3, 1e3),
    ratio=st.floats(0.01, 0.99),
    branch=st.sampled_from(["positive", "nearest"]),
)
def test_the_control_is_bounded_by_the_gains(
    x, xdot, x_ref, xdot_ref, force, force_ref, h, kappa, kappa_ref, mu1, ratio, branch
):
    """|R ls| <= 1 + kappa, |A| <= |Fr|/(1 - kappa_r), ls^2 <= 1; the signs lie in [-1, 1]."""
    walls = {"h": h, "kappa": kappa, "kappa_ref": kappa_ref}
    tracker = zivi.TwistingTracker(mu1, ratio * mu1, **walls, branch=branch)
    explicit = zivi.ExplicitTwisting(mu1, ratio * mu1, **walls)
    pull = mu1 * (1 + ratio) + abs(force_ref) / (1 - kappa_ref)
    bound = ((1 + kappa) * pull + abs(force)) * (1 + 8 * EPS)
    for controller in (tracker, explicit):
        controller.reset(x_ref, xdot_ref)
        assert abs(controller.step(x, xdot, force, force_ref)) <= bound
        assert np.all(np.abs(controller.signs) <= 1)
    regulator = zivi.TwistingRegulator(mu1, ratio * mu1, h=h, kappa=kappa)
    # -mu1 - mu2 ls lv: always onto the wall
    u = regulator.step(x, xdot, force)
    slack = 4 * EPS * mu1
    assert -mu1 * (1 + ratio) - slack <= u <= -mu1 * (1 - ratio) + slack
    assert np.all(np.abs(regulator.signs) <= 1)


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_saturation_cuts_and_says_so(kind):
    free = kind(**PAPER)
    cut = kind(**PAPER, u_limits=(-10, 5))
    for x, xdot in [(1.0, 0.5), (1.0, -2.0), (0.0, 0.0), (1e-6, -1e-3)]:
        u, limited = tick(free, x, xdot), tick(cut, x, xdot)
        assert limited == min(max(u, -10), 5)
        assert (cut.status == zivi.TickStatus.SATURATED) == (limited != u)
        np.testing.assert_array_equal(cut.signs, free.signs)
    assert tick(cut, 1.0, 0.5) == -10
    assert cut.status is zivi.TickStatus.SATURATED


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_slightly_negative_positions_are_noise(kind):
    at_wall, below = kind(**PAPER), kind(**PAPER, depth=0.01)
    assert tick(below, -0.01, 0.2) == tick(at_wall, 0.0, 0.2)
    assert below.status is zivi.TickStatus.CLAMPED
    tick(below, 0.0, 0.2)
    assert below.status == 0
    assert kind(**PAPER).settings["depth"] == 0.1


BAD_SAMPLES = {
    "x": [NAN, INF, -INF, -0.1000001],
    "xdot": [NAN, INF, -INF],
    "force": [NAN, INF, -INF],
    "force_ref": [NAN, INF, -INF],
}


@pytest.mark.parametrize("kind", CONTROLLERS)
@pytest.mark.parametrize("name", BAD_SAMPLES)
def test_bad_samples_raise_and_change_nothing(kind, name):
    if name == "force_ref" and kind is zivi.TwistingRegulator:
        pytest.skip("the regulator has no reference")
    controller = kind(**PAPER)
    if kind in WITH_REFERENCE:
        controller.reset(1, 2)
    tick(controller)
    before = controller.state
    for value in BAD_SAMPLES[name]:
        with pytest.raises(ValueError, match=rf"(?<![\w.]){name}(?!\w)"):
            tick(controller, **{name: value})
        assert controller.state == before
    for value in ("a", 1j, [1.0]):
        with pytest.raises(TypeError):
            tick(controller, **{name: value})
        assert controller.state == before
    if name != "x":  # which may be missing
        with pytest.raises((TypeError, ValueError)):
            tick(controller, **{name: None})
        assert controller.state == before


def test_overflow_is_refused_not_returned():
    controller = zivi.TwistingTracker(**PAPER)
    before = controller.state
    with pytest.raises(ValueError, match="u must be finite"):
        controller.step(1, 1, 1e308, 1e308)
    assert controller.state == before


BAD_SETTINGS = {
    "mu1": [0, -1, NAN, INF],
    "mu2": [0, -1, 30, 31, NAN, INF],
    "h": [0, -1, NAN, INF],
    "kappa": [-0.1, 1.1, NAN, INF],
    "depth": [-1, NAN],
    "bound": [-1, NAN, INF],
    "u_max": [(2, 1), (1, 1), (0, NAN)],
    "u_min": [(NAN, 1)],
    "kappa_ref": [-0.1, 1.1, NAN],
    "e_ref": [-0.1, 1.1, NAN, 0],
    "branch": ["Positive", "", None, 3, ["positive"], np.array(["positive"])],
}
ARGUMENT = {"u_max": "u_limits", "u_min": "u_limits"}


def takes(kind, name):
    return name in inspect.signature(kind.__new__).parameters


@pytest.mark.parametrize("kind", CONTROLLERS)
@pytest.mark.parametrize("name", BAD_SETTINGS)
def test_settings_out_of_range_are_named(kind, name):
    argument = ARGUMENT.get(name, name)
    if not takes(kind, argument):
        pytest.skip("has no such setting")
    for value in BAD_SETTINGS[name]:
        with pytest.raises(ValueError, match=rf"(?<![\w.]){name}(?!\w).*(must|between)"):
            kind(**PAPER | {argument: value})
    if name not in ("branch", "u_min", "u_max"):
        for value in ("a", 1j, [1.0], {}):
            with pytest.raises(TypeError, match=rf"(?<![\w.]){name}(?!\w)"):
                kind(**PAPER | {argument: value})


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_settings_that_contradict_each_other(kind):
    common = {"mu1": 30, "mu2": 17, "h": 1e-3}
    with pytest.raises(ValueError, match="exactly one of e and kappa"):
        kind(**common, e=0.5, kappa=1 / 3)
    with pytest.raises(ValueError, match="e must be > 0"):
        kind(**common, e=0)
    with pytest.raises(TypeError, match="u_limits"):
        kind(**PAPER, u_limits=(1, 2, 3))
    with pytest.raises(TypeError):
        kind(**PAPER, gain=3)
    with pytest.raises(TypeError):
        kind(30, 17, 1e-3, 0.5)
    if kind in WITH_REFERENCE:
        with pytest.raises(ValueError, match="exactly one of e_ref and kappa_ref"):
            kind(**PAPER, e_ref=0.5, kappa_ref=0.3)


@pytest.mark.parametrize("kind", WITH_REFERENCE)
@pytest.mark.parametrize(
    ("state", "name"),
    [((-1, 0), "x_ref"), ((NAN, 0), "x_ref"), ((INF, 0), "x_ref"), ((0, NAN), "xdot_ref")],
)
def test_a_bad_reference_is_refused(kind, state, name):
    controller = kind(**PAPER)
    controller.reset(1, 2)
    before = controller.state
    with pytest.raises(ValueError, match=rf"(?<![\w.]){name}(?!\w)"):
        controller.reset(*state)
    assert controller.state == before


def test_names_and_defaults_of_the_contract():
    def parameters(function):
        return {
            name: (parameter.kind.name == "KEYWORD_ONLY", parameter.default)
            for name, parameter in inspect.signature(function).parameters.items()
        }

    required = inspect.Parameter.empty
    shared = {
        "mu1": (False, required),
        "mu2": (False, required),
        "h": (True, required),
        "e": (True, None),
        "kappa": (True, None),
        "bound": (True, None),
        "depth": (True, 0.1),
        "u_limits": (True, None),
    }
    reference = {"e_ref": (True, None), "kappa_ref": (True, None)}
    landing = {"landing": (True, True), "ahead": (True, 1), "quiet": (True, 0.0)}
    landing |= {"delay": (True, 0)}
    landing |= {"solver": (True, "exact"), "linearisations": (True, 20)}
    assert parameters(zivi.TwistingRegulator) == shared | landing
    assert parameters(zivi.ExplicitTwisting) == shared | reference
    quiet = {"press": (True, None), "horizon": (True, 1), "shift": (True, False)}
    tracking = shared | reference | landing | quiet | {"branch": (True, "positive")}
    assert parameters(zivi.TwistingTracker) == tracking
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=0.25)
    assert (tracker.x_ref, tracker.xdot_ref, tracker.u) == (0, 0, 0)
    assert math.isclose(tracker.kappa, 0.6)
    assert math.isclose(tracker.e, 0.25)
    assert tracker.kappa_ref == tracker.kappa
    assert (tracker.mu1, tracker.mu2, tracker.h, tracker.branch) == (30, 17, 1e-3, "positive")
    assert tracker.signs.shape == (6,)
    assert zivi.TwistingRegulator(3, 2, h=1e-3, e=0.5).signs.shape == (2,)
    assert zivi.TwistingTracker(30, 17, h=1e-3, e=0.5, e_ref=0.25).e_ref == pytest.approx(0.25)
    # positional or by name
    assert tracker.step(1, 0, force=-9.81, force_ref=0) == tracker.u
    assert type(tracker.u) is float


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_a_tick_is_one_call_into_the_extension(kind):
    """No Python code between the caller and the compiled tick."""
    compiled = next(base for base in kind.__mro__ if base.__module__ == "zivi._zivi")
    assert "step" not in vars(kind)
    assert inspect.ismethoddescriptor(vars(compiled)["step"])
    assert kind.step is compiled.step


def with_history(kind):
    options = {"branch": "nearest"} if kind is zivi.TwistingTracker else {}
    if kind in WITH_REFERENCE:
        options["e_ref"] = 0.3
    controller = kind(**PAPER, bound=5.0, u_limits=(-50.0, 50.0), **options)
    if kind in WITH_REFERENCE:
        controller.reset(0.02, -3.0)
    for k in range(40):
        tick(controller, 0.05 - 0.001 * k, -3.0 + 0.01 * k)
    return controller


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_the_representation_shows_the_settings_and_evaluates_back(kind):
    controller = with_history(kind)
    text = repr(controller)
    again = eval(text, {kind.__name__: kind})
    assert again.settings == controller.settings
    assert repr(again) == text
    for name in ("mu1=30.0", "mu2=17.0", "h=0.001", "kappa=0.5", "u_limits=(-50.0, 50.0)"):
        assert name in text


class Marked(zivi.TwistingTracker):
    """A subclass with a constructor of its own."""

    def __new__(cls, label):
        self = super().__new__(cls, **PAPER)
        self.label = label
        return self


COPIES = {
    "copy method": lambda controller: controller.copy(),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda controller: pickle.loads(pickle.dumps(controller)),
    "old pickle": lambda controller: pickle.loads(pickle.dumps(controller, protocol=2)),
}


@pytest.mark.parametrize("kind", CONTROLLERS)
@pytest.mark.parametrize("way", [*COPIES, "state"])
def test_copies_go_on_bit_by_bit(kind, way):
    controller = with_history(kind)
    if way == "state":
        twin = kind(**controller.settings)
        twin.state = controller.state
    else:
        twin = COPIES[way](controller)
    assert type(twin) is kind
    assert twin.settings == controller.settings
    assert twin.state == controller.state
    rng = np.random.default_rng(6)
    for x, xdot, f, f_ref in rng.normal(0, 1, (200, 4)):
        sample = (abs(x) * 0.01, xdot, 8 * f, 8 * f_ref)
        assert tick(controller, *sample) == tick(twin, *sample)
        assert controller.state == twin.state
    tick(twin, 1.0, 1.0)
    assert controller.state != twin.state  # they share nothing


@pytest.mark.parametrize("way", COPIES)
def test_a_subclass_is_copied_with_its_attributes(way):
    marked = Marked(["a"])
    marked.reset(1, 2)
    twin = COPIES[way](marked)
    assert type(twin) is Marked
    assert twin.label == ["a"]
    assert (twin.label is marked.label) == (way in ("copy", "copy method"))
    assert twin.state == marked.state


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_a_state_that_no_controller_has_is_refused(kind):
    controller = with_history(kind)
    before = controller.state
    s, v, side, u, signs, bits = before
    for state in [
        None,
        (),
        (s, v, side, u, signs),
        (NAN, v, side, u, signs, bits),
        (s, INF, side, u, signs, bits),
        (s, v, 0.0, u, signs, bits),
        (1.0, v, -1.0, u, signs, bits),
        (s, v, side, NAN, signs, bits),
        (s, v, side, u, signs[:-1], bits),
        (s, v, side, u, signs, 256),
        (s, v, side, u, signs, -1),
        (s, v, side, u, "abcdef", bits),
    ]:
        with pytest.raises(ValueError, match="state must be"):
            controller.state = state
        assert controller.state == before


def test_two_interleaved_controllers_do_not_meet():
    def samples(seed):
        rng = np.random.default_rng(seed)
        return [(abs(x), v, -9.81, -19.81) for x, v in rng.normal(0, 1, (300, 2))]

    def fresh():
        one = zivi.TwistingTracker(**PAPER)
        other = zivi.TwistingTracker(25, 11, h=2e-3, e=0.7, branch="nearest")
        one.reset(3, 3)
        other.reset(1, -1)
        return one, other

    one, other = fresh()
    alone = [one.step(*y) for y in samples(1)], [other.step(*y) for y in samples(2)]
    one, other = fresh()
    both = [(one.step(*a), other.step(*b)) for a, b in zip(samples(1), samples(2), strict=True)]
    assert [u for u, _ in both] == alone[0]
    assert [u for _, u in both] == alone[1]


def test_what_is_handed_out_is_a_copy():
    controller = with_history(zivi.TwistingTracker)
    before = controller.state
    controller.signs[:] = 7
    controller.settings["mu1"] = 1
    assert controller.state == before
    assert controller.mu1 == 30
    with pytest.raises(AttributeError):
        controller.mu1 = 3


def test_reset_forgets_everything():
    controller = with_history(zivi.TwistingTracker)
    controller.reset(3, 3)
    fresh = zivi.TwistingTracker(**controller.settings)
    fresh.reset(3, 3)
    assert controller.state == fresh.state
    regulator = with_history(zivi.TwistingRegulator)
    regulator.reset()
    assert regulator.state == zivi.TwistingRegulator(**PAPER).state
