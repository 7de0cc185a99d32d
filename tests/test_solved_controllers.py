"""Controllers whose steps a general solver solves: (23) of two signs, (24) of six."""

import copy
import pickle

import numpy as np
import pytest

import zivi
from control_oracle import Tracking

F, F_REF, H, KAPPA = -9.81, -19.81, 1e-3, 0.5
SOLVERS = ["newton", "outer"]


def tracker(solver="exact", **settings):
    given = {"h": H, "kappa": KAPPA, "landing": False} | settings
    return zivi.TwistingTracker(30, 17, solver=solver, **given)


def regulator(solver="exact", **settings):
    given = {"h": H, "kappa": KAPPA, "landing": False} | settings
    return zivi.TwistingRegulator(3, 2, solver=solver, **given)


def near_states(rng, n, speed):
    """Near the wall and near a reference: several signs change within a step."""
    x, x_ref = np.abs(rng.normal(0, H * speed, (2, n)))
    return np.column_stack([x, rng.normal(0, speed, n), x_ref, rng.normal(0, speed, n)])


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("branch", ["positive", "nearest"])
def test_the_trackers_control_is_the_same(solver, branch):
    """Where enumeration finds one solution; signs put back solve all six rows anyway."""
    rng = np.random.default_rng(3)
    same = unsolved = 0
    for speed in (4.0, 1.0, 0.1, 0.01):
        for x, xdot, x_ref, xdot_ref in near_states(rng, 100, speed):
            exact, other = tracker(branch=branch), tracker(solver, branch=branch)
            for it in (exact, other):
                it.reset(x_ref, xdot_ref)
            z_ref = exact.state[:2]
            found = [it.step(x, xdot, F, F_REF) for it in (exact, other)]
            assert exact.state[:3] == other.state[:3]  # the reference's step is always exact
            if other.status == zivi.TickStatus.UNSOLVED:
                unsolved += 1
                assert found[0] == found[1]
                continue
            s, v = zivi.lift(x, xdot, kappa=KAPPA)
            # where s_r+ = 0 = s+ or v_r+ = 0 = v+ there is a continuum of signs
            if (
                np.abs(exact.signs[2:4]).min() < 1
                or exact.signs[0] < 0
                or (branch == "nearest" and _mirrored((s, v), z_ref, exact))
            ):
                continue
            problem = Tracking(H, KAPPA, KAPPA, 30, 17, (float(s), float(v)), z_ref, F, F_REF)
            assert problem.residuals(other.signs).max() <= 1e-11
            lsr, lvr = exact.signs[2:4]
            if len(problem.solutions(problem.reference(lsr, lvr), lvr)) == 1:
                same += 1
                assert found[1] == pytest.approx(found[0], abs=1e-6)
    assert same >= 100
    assert unsolved <= (0 if solver == "newton" else 60)


def _mirrored(z, z_ref, it):
    (s, v), (s_ref, v_ref) = z, z_ref
    energy = [it.mu1 * abs(k * s - s_ref) + (k * v - v_ref) ** 2 / 2 for k in (1, -1)]
    return energy[1] <= energy[0]


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_regulators_control_is_the_same(solver):
    """Under the gain condition its step has one solution."""
    rng = np.random.default_rng(4)
    unsolved = 0
    for k in range(400):
        x, xdot = abs(rng.normal(0, 1e-5 if k % 2 else 1)), rng.normal(0, 1e-2 if k % 2 else 3)
        exact, other = regulator(), regulator(solver)
        found = [it.step(x, xdot, -0.4) for it in (exact, other)]
        unsolved += other.status == zivi.TickStatus.UNSOLVED
        assert found[1] == pytest.approx(found[0], abs=1e-7)
        np.testing.assert_allclose(other.signs, exact.signs, atol=1e-8)
    assert unsolved <= (0 if solver == "newton" else 40)


@pytest.mark.parametrize("solver", SOLVERS)
def test_loops_and_batches_tick_it_as_by_hand(solver):
    """The paper's problem, its plant by the implicit step; and the sampled loop."""
    plant = zivi.ImpactSystem(F, kappa=KAPPA)
    given = {"y_ref0": (3, 3), "force_ref": F_REF}
    it = tracker(solver)
    run = zivi.simulate_closed_loop(plant, it, (0, 0.4), (6, 5), **given)
    it.reset(3, 3)
    by_hand = [it.step(run.x[k], run.xdot[k], F, F_REF) for k in range(len(run.t) - 1)]
    np.testing.assert_array_equal(by_hand, run.u[:-1])
    batch = zivi.simulate_closed_loop_batch(plant, it, (0, 0.4), [(6, 5)], **given, save=1)
    np.testing.assert_array_equal(batch.sample_u[0], run.u)
    exact = zivi.simulate_closed_loop(plant, tracker(), (0, 0.4), (6, 5), **given)
    np.testing.assert_allclose(run.x, exact.x, atol=1e-6)


def test_the_papers_loop_is_that_of_the_vi():
    """Figures 6 to 8 with (24) solved as a VI: the same motion and rest."""
    plant = zivi.ImpactSystem(F, kappa=KAPPA)
    given = {"y_ref0": (3, 3), "force_ref": F_REF, "method": zivi.ThetaGamma(H)}
    runs = [
        zivi.simulate_closed_loop(plant, tracker(solver), (0, 1.6), (6, 5), **given)
        for solver in ("exact", "newton")
    ]
    moving = runs[0].t < 1.1
    np.testing.assert_allclose(runs[1].x[moving], runs[0].x[moving], atol=1e-3)
    assert abs(runs[1].x[-1]) + abs(runs[1].xdot[-1]) < 1e-9


def test_given_references_and_horizons_take_it_too():
    for settings in ({}, {"horizon": 3.0, "shift": True}):
        exact, other = tracker(**settings), tracker("newton", **settings)
        for k in range(50):
            t = k * H
            now, after = ((1 + 0.3 * np.sin(3 * s), 0.9 * np.cos(3 * s), 1.0) for s in (t, t + H))
            sample = (1.05, 0.8 - 0.01 * k, F)
            u = exact.step_to(*sample, now, after)
            assert other.step_to(*sample, now, after) == pytest.approx(u, abs=1e-6)


def test_settings_copies_and_bad_ones():
    it = tracker("outer", linearisations=7)
    assert (it.solver, it.settings["linearisations"]) == ("outer", 7)
    it.step(0.1, -1.0, F, F_REF)
    for twin in (it.copy(), copy.deepcopy(it), pickle.loads(pickle.dumps(it))):
        assert twin.settings == it.settings
        assert twin.copy().step(0.1, -0.9, F, F_REF) == it.copy().step(0.1, -0.9, F, F_REF)
    assert tracker().solver == regulator().solver == "exact"
    for make in (tracker, regulator):
        with pytest.raises(
            ValueError, match="solver must be one of exact, newton, outer, got 'path'"
        ):
            make("path")
        with pytest.raises(ValueError, match="linearisations must be from 1 to 1000, got 0"):
            make("outer", linearisations=0)


def test_no_tick_knows_what_comes():
    """Corollary 1: loops whose forces differ from 0.3 s on have the same controls until then."""

    def loop(later):
        force = lambda t, x, v: F if t < 0.3 else later  # noqa: E731
        return zivi.simulate_closed_loop(
            zivi.ImpactSystem(force, kappa=KAPPA), tracker(), (0, 0.5), (6, 5),
            y_ref0=(3, 3), force_ref=lambda t, x, v: F_REF if t < 0.3 else 2 * later,
        )  # fmt: skip

    one, other = loop(F), loop(3 * F)
    before = one.t < 0.3 - H / 2
    np.testing.assert_array_equal(one.u[before], other.u[before])
    assert not np.array_equal(one.u, other.u)


@pytest.mark.parametrize("kind", ["tracker", "explicit"])
def test_a_missing_sample_holds_the_control_and_moves_the_reference(kind):
    make = {"tracker": tracker, "explicit": lambda: zivi.ExplicitTwisting(30, 17, h=H, kappa=KAPPA)}
    it, other = make[kind](), make[kind]()
    for controller in (it, other):
        controller.reset(1.0, 0.5)
        controller.step(1.0, 0.4, F, F_REF)
    u = it.u
    assert it.step(None, force_ref=F_REF) == u == it.u
    other.step(1.0, 0.3, F, F_REF)
    assert (it.x_ref, it.xdot_ref) == (other.x_ref, other.xdot_ref)
    assert it.status == 0
    with pytest.raises(ValueError, match="xdot must be a velocity"):
        it.step(1.0, None, F, F_REF)


def test_a_missing_sample_of_a_given_reference_and_of_a_regulator():
    it = tracker()
    it.step_to(1.0, 0.4, F, (1.0, 0.5, 1), (1.0005, 0.49, 1))
    u = it.u
    assert it.step_to(None, None, F, (1.0005, 0.49, 1), (1.001, 0.48, -1)) == u
    assert it.x_ref == 1.001
    lands = zivi.TwistingRegulator(3, 2, h=H, kappa=KAPPA)
    u = lands.step(1.0, 0.5, -1.0)
    assert lands.step(None) == u == lands.u


@pytest.mark.parametrize(
    "settings",
    [
        {"landing": True},
        {"landing": True, "ahead": 3, "quiet": 0.01},
        {"landing": False},
        {"horizon": 3, "shift": True},
    ],
)
def test_a_period_of_another_length_is_that_of_another_controller(settings):
    """A tick of dt is that of the controller with that period, from the same state: all bits."""
    rng = np.random.default_rng(6)
    shared = {name: it for name, it in settings.items() if name not in ("horizon", "shift")}
    for k in range(200):
        x, xdot, x_ref, xdot_ref = near_states(rng, 1, 0.05)[0]
        if k % 3 == 0:
            x_ref = xdot_ref = 0.0  # at rest: the landing
        long = H * rng.uniform(0.1, 9.0)
        one, other = tracker(**settings), tracker(**settings, h=long)
        for it in (one, other):
            it.reset(x_ref, xdot_ref)
        assert one.step(x, xdot, F, F_REF, dt=long) == other.step(x, xdot, F, F_REF)
        assert one.state == other.state
        one, other = regulator(**shared), regulator(**shared, h=long)
        assert one.step(x, xdot, -0.4, dt=long) == other.step(x, xdot, -0.4)
        assert one.state == other.state
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="dt must be a finite time > 0"):
            one.step(1.0, 0.0, 0.0, dt=bad)
        with pytest.raises(ValueError, match="dt must be a finite time > 0"):
            one.step(None, dt=bad)
