"""The observer: interface, recorded data, and its place in the closed loop."""

import copy
import pickle

import numpy as np
import pytest

import zivi

F, H = -9.81, 1e-3
PLANT = zivi.ImpactSystem(F, e=0.5)


def observer(e=0.5, **settings):
    return zivi.ImpactObserver(e, H, **{"noise": (1e-4, 1e-2)} | settings)


def tracker(**settings):
    return zivi.TwistingTracker(30, 17, h=H, e=0.5, **settings)


def follow(it, true=F + 1.5, **settings):
    given = {"noise": (1e-4, 1e-2), "seed": 2, "force_model": F, "force_ref": -9.81}
    given |= {"y_ref0": (1, 0), "observer": it} | settings
    return zivi.simulate_closed_loop(
        zivi.ImpactSystem(true, e=0.5), tracker(), (0, 1.5), (1.2, 0), **given
    )


def bouncing(e=0.6, d=0.0, end=1.5, sigma=1e-4, seed=1):
    """A mass that bounces, seen with noise: times, states, measured positions."""
    sol = zivi.simulate(
        zivi.ImpactSystem(F + d, e=e), (0, end), (1, 0), t_eval=np.arange(0, end, H)
    )
    noise = sigma * np.random.default_rng(seed).standard_normal(len(sol.t))
    return sol, sol.x + noise


def test_a_bouncing_mass_is_seen_from_positions_alone():
    """Velocity within 0.05 m/s for good after 0.06 s, and the force within 0.3 m/s^2."""
    for d in (-3.0, 0.0, 2.0):
        sol, x = bouncing(d=d)
        it = observer(0.6, noise=1e-4, position_only=True, q_d=1e-5, dmax=5.0)
        seen = it.observe(sol.t, x, force=F)
        moving = (sol.t > 0.1) & (sol.t < 1.2)
        rms = np.sqrt(np.mean((seen.xdot - sol.xdot)[moving] ** 2))
        assert rms < 0.02
        assert np.abs(seen.d[moving] - d).max() < 0.6
        assert np.sqrt(np.mean((seen.d[moving] - d) ** 2)) < 0.2
        assert np.all(seen.x >= 0)
        assert seen.std.shape == (len(sol.t), 3)
        assert np.count_nonzero(seen.refused) < 30
        assert "measurements" in repr(seen)


@pytest.mark.parametrize(
    ("e", "believed", "xdot", "force"), [(0.6, 0.6, 2.1e-3, 0.07), (0.9, 0.9, 2.2e-3, 0.07)]
)
def test_errors_are_those_of_the_documentation(e, believed, xdot, force):
    """Positions alone, 1e-4 m, an unknown constant force: rms in the second half of a run."""
    found = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        d, start = rng.uniform(-3, 3), (rng.uniform(1, 5), rng.uniform(-3, 3))
        plant = zivi.ImpactSystem(F + d, e=e)
        end = min(4.0, 0.8 * zivi.simulate(plant, (0, 60), start).rest_time)
        sol = zivi.simulate(plant, (0, end), start, t_eval=np.arange(0, end, H))
        x = sol.x + 1e-4 * rng.standard_normal(len(sol.t))
        it = observer(believed, noise=1e-4, q_d=1e-3, dmax=5.0, position_only=True)
        seen, late = it.observe(sol.t, x, force=F), sol.t > sol.t[-1] / 2
        errors = (seen.xdot - sol.xdot)[late], (seen.d - d)[late]
        found.append([np.sqrt(np.mean(error**2)) for error in errors])
    assert np.median(found, axis=0) == pytest.approx([xdot, force], rel=0.2)


def test_a_known_control_is_as_good_as_a_known_force():
    sol, x = bouncing()
    it = observer(0.6)
    one = it.observe(sol.t, x, sol.xdot, force=F)
    other = it.observe(sol.t, x, sol.xdot, force=np.full(len(x), F - 4), u=np.full(len(x), 4.0))
    np.testing.assert_allclose(one.d, other.d, atol=1e-9)
    # without either the force is what is seen of it
    blind = it.observe(sol.t, x, sol.xdot)
    flight = (sol.t > 0.1) & (sol.t < 0.4)
    assert abs(blind.d[flight].mean() - F) < 0.1
    assert it.state == observer(0.6).state


def test_missing_velocities_are_those_of_a_sensor_of_positions():
    sol, x = bouncing(end=0.6)
    nothing = np.full(len(x), np.nan)
    one = observer(0.6).observe(sol.t, x, nothing, force=F)
    other = observer(0.6, position_only=True).observe(sol.t, x, sol.xdot, force=F)
    for name in ("x", "xdot", "d", "std"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_positions_that_are_nan_are_missing_samples():
    """The same by `step(None)`, by `step` of NaN and in recorded data; nothing before the first."""
    sol, x = bouncing(end=0.7)
    missing = np.random.default_rng(3).random(len(x)) < 0.3
    missing[:3], missing[3] = True, False
    none, nan = observer(0.6), observer(0.6)
    by_hand = []
    for k in range(len(x)):
        xdot = sol.xdot[k] if k % 2 else None
        by_hand.append(none.step(None if missing[k] else x[k], xdot, F))
        not_a_number = np.nan if xdot is None else xdot
        again = nan.step(np.nan if missing[k] else x[k], not_a_number, F)
        np.testing.assert_array_equal(again, by_hand[-1])
    assert none.state == nan.state
    assert np.isnan(by_hand[:3]).all()
    assert np.isfinite(by_hand[3:]).all()
    recorded = np.where(missing, np.nan, x)
    xdots = np.where(np.arange(len(x)) % 2, sol.xdot, np.nan)
    seen = observer(0.6).observe(sol.t, recorded, xdots, force=F)
    np.testing.assert_allclose(np.transpose(by_hand), (seen.x, seen.xdot, seen.d), atol=1e-9)
    np.testing.assert_array_equal(seen.missing, missing)
    assert np.isnan(seen.std[:3]).all()
    assert f"{missing.sum()} missing" in repr(seen)
    # the motion goes on meanwhile: a flight of 0.1 s without measurements
    late = observer(0.6)
    for k in range(200):
        late.step(x[k], sol.xdot[k], F)
    spread = late.covariance[0, 0]
    for _ in range(100):
        found = late.step(np.nan, None, F)
    assert abs(found[0] - sol.x[299]) < 2e-3
    assert late.covariance[0, 0] > spread


def test_ticks_are_those_of_observe():
    sol, x = bouncing(end=0.7)
    it = observer(0.6)
    by_hand = [it.step(x[k], sol.xdot[k], F, 0.0) for k in range(len(x))]
    seen = observer(0.6).observe(sol.t, x, sol.xdot, force=F)
    np.testing.assert_allclose(np.transpose(by_hand), (seen.x, seen.xdot, seen.d), atol=1e-9)
    assert it.estimate == by_hand[-1]
    assert it.covariance.shape == (3, 3)
    assert np.linalg.eigvalsh(it.covariance).min() > 0


def test_copies_pickles_and_restored_states_go_on_alike():
    it = observer(se=0.03, q_d=1e-2)
    for k in range(40):
        it.step(0.1 - 0.005 * k, None if k % 2 else -1.0, F, 0.3)
    restored = observer(se=0.03, q_d=1e-2)
    restored.state = it.state
    twins = [it.copy(), copy.copy(it), copy.deepcopy(it), pickle.loads(pickle.dumps(it)), restored]
    after = it.step(0.05, 1.0, F, 0.0)
    for twin in twins:
        assert type(twin) is zivi.ImpactObserver
        assert twin.settings == it.settings
        assert twin.step(0.05, 1.0, F, 0.0) == after
        assert twin.state == it.state
    it.reset()
    assert it.state == observer().state
    assert zivi.ImpactObserver(**it.settings).settings == it.settings
    assert repr(it).startswith("ImpactObserver(e=0.5, h=0.001, noise=(0.0001, 0.01)")
    for bad in ((), (True, -1.0, *it.state[2:]), (*it.state[:4], [1.0] * 5, 0, 0)):
        with pytest.raises(ValueError, match="what an observer's state gave"):
            it.state = bad


def test_the_loop_is_quieter_with_an_observer():
    """Unknown force: a smaller error, a fraction of the control's variation, exact rest."""
    plain, seen = follow(None), follow(observer(q_d=1e-4, dmax=5))
    assert plain.d_est is None
    flight = (seen.t > 0.8) & (seen.t < 1.2)
    variation = [np.abs(np.diff(run.u[flight])).sum() for run in (plain, seen)]
    assert variation[1] < 0.6 * variation[0]
    rms = [np.sqrt(np.mean(run.error[flight] ** 2)) for run in (plain, seen)]
    assert rms[1] < 0.9 * rms[0]
    assert np.sqrt(np.mean((seen.d_est[flight] - 1.5) ** 2)) < 0.15
    assert np.abs(seen.x_est - seen.x).max() < 1e-3
    assert len(seen.xdot_est) == len(seen.t)
    long = zivi.simulate_closed_loop(
        zivi.ImpactSystem(F + 1.5, e=0.5), tracker(), (0, 3), (1.2, 0),
        **{"noise": (1e-4, 1e-2), "seed": 2, "force_model": F, "force_ref": F, "y_ref0": (1, 0)},
        observer=observer(q_d=1e-4, dmax=5),
    )  # fmt: skip
    assert long.rest_time is not None


@pytest.mark.filterwarnings("ignore:.*control updates:zivi.ModelWarning")
@pytest.mark.parametrize("delay", [0, 2])
def test_the_loop_ticks_the_observer_as_by_hand(delay):
    """With the control that acted, after limits and delay; the model's force and d at its state."""
    it = observer(q_d=1e-3)
    controller = tracker(u_limits=(-30, 30), ahead=1 + delay)
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(F + 1, e=0.5), controller, (0, 0.5), (1.2, 0.1),
        y_ref0=(1, 0), force_ref=F, force_model=F, observer=it, delay=delay,
    )  # fmt: skip
    assert it.state == observer(q_d=1e-3).state  # a copy ran
    controller.reset(1, 0)
    controls, acting = [0.0] * delay, 0.0
    for k in range(len(run.t) - 1):
        x, xdot, d = it.step(run.x[k], run.xdot[k], F, acting)
        assert (x, xdot, d) == (run.x_est[k], run.xdot_est[k], run.d_est[k])
        controls.append(controller.step(x, xdot, F + d, F))
        acting = controls[k]
        assert acting == run.u[k]


def test_a_batch_is_its_loops():
    starts = np.array([[1.2, 0], [0.4, 1], [0, 0]])
    observers = [observer(q_d=q_d) for q_d in (1e-4, 1e-3, 1e-2)]
    given = {"y_ref0": (1, 0), "force_ref": F, "force_model": F}
    plant = zivi.ImpactSystem(F + 1, e=0.5)
    batch = zivi.simulate_closed_loop_batch(
        plant, tracker(), (0, 0.4), starts, **given, observer=observers, save=1
    )
    for k, it in enumerate(observers):
        run = zivi.simulate_closed_loop(plant, tracker(), (0, 0.4), starts[k], **given, observer=it)
        np.testing.assert_array_equal(batch.sample_u[k], run.u)
    with pytest.raises(ValueError, match="observer must have 1 or 3 entries, got 2"):
        zivi.simulate_closed_loop_batch(
            plant, tracker(), (0, 0.4), starts, **given, observer=observers[:2]
        )


def test_a_run_of_user_times_tells_the_estimates_of_the_sample_before():
    run = follow(observer(), t_eval=[0.0105, 0.02, 1.0])
    every = follow(observer())
    np.testing.assert_array_equal(run.d_est, every.d_est[[10, 20, 1000]])


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"e": 1.1}, ValueError, r"e must lie in \[0, 1\], got 1.1"),
        ({"h": 0.0}, ValueError, "h must be a finite sampling period > 0, got 0.0"),
        ({"noise": (0.0, 1)}, ValueError, "noise must be a standard deviation > 0"),
        ({"noise": 1e-3}, TypeError, "noise must be two numbers"),
        ({"q_d": -1.0}, ValueError, "q_d must be a finite variance >= 0"),
        ({"se": 2.0}, ValueError, r"se must be a standard deviation of e, in \[0, 1\], got 2.0"),
        ({"dmax": np.nan}, ValueError, "dmax must be a bound from 0 to 1e150"),
        ({"position_only": 1}, TypeError, "position_only must be True or False, got 1"),
    ],
)
def test_bad_settings_are_named(settings, error, message):
    with pytest.raises(error, match=message):
        zivi.ImpactObserver(**{"e": 0.5, "h": H} | settings)


def test_bad_use_is_refused():
    it = observer()
    it.step(1.0, 0.0, F, 0.0)
    before = it.state
    for arguments, name in (
        ((np.inf, 0, F, 0), "x"),
        ((1, np.inf, F, 0), "xdot"),
        ((1, 0, np.nan, 0), "force"),
        ((1, 0, F, np.nan), "u"),
    ):
        with pytest.raises(ValueError, match=f"{name} must be"):
            it.step(*arguments)
        assert it.state == before
    with pytest.raises(ValueError, match="t must be finite and increasing"):
        it.observe([0, 0], [1, 1])
    with pytest.raises(ValueError, match="x_measured must have the shape of t"):
        it.observe([0, 1], [1])
    with pytest.raises(ValueError, match="force must be a number or have shape"):
        it.observe([0, 1], [1, 1], force=[1, 2, 3])
    with pytest.raises(ValueError, match="measurement 1: x must be"):
        it.observe([0, 1], [1, np.inf])
    with pytest.raises(TypeError, match=r"observer must be a zivi.ImpactObserver, got"):
        follow(3)
    with pytest.raises(ValueError, match=r"observer\.h must be the controller's h = 0\.001"):
        follow(zivi.ImpactObserver(0.5, 1e-2))


def test_senseless_measurements_leave_numbers():
    run = follow(observer(), noise=(1e300, 0), true=F)
    assert run.success
    assert np.isfinite(run.u).all()
    assert np.isfinite(run.x_est).all()
