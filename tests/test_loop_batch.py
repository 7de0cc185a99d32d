"""Batches of closed loops: each as alone, to the last bit; what is saved; what is refused."""

import dataclasses
import json

import numpy as np
import pytest

import zivi
from control_loops import Foreign
from inside import LOOP_NUMBERS as NUMBERS, control_loop_batch as loop_batch

pytestmark = pytest.mark.filterwarnings("ignore:a landing may never rest")

PLANT = zivi.ImpactSystem(-9.81, kappa=0.5)
SPAN, START, REFERENCE = (0, 2), (6, 5), (3, 3)
PAPER = {"y_ref0": REFERENCE, "force_ref": -19.81}


def tracker(mu1=30.0, mu2=17.0, **settings):
    return zivi.TwistingTracker(mu1, mu2, h=settings.pop("h", 1e-3), kappa=0.5, **settings)


def controllers():
    explicit = zivi.ExplicitTwisting(30, 17, h=1e-3, kappa=0.5)
    return [tracker(), tracker(branch="nearest"), tracker(60, 34), tracker(h=2e-3), explicit]


def alone(controller, plant=PLANT, **settings):
    return zivi.simulate_closed_loop(plant, controller, SPAN, START, **(PAPER | settings))


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"delay": 2},
        {"quantization": (1e-5, 1e-3)},
        {"force_model": -11.0},
        {"method": zivi.SwitchedRK(1e-8, 1e-10)},
        {"force_model": zivi.LinearForce(gravity=9.81, damping=0.1)},
    ],
)
def test_each_loop_is_what_it_is_alone(settings):
    several = controllers()
    batch = zivi.simulate_closed_loop_batch(
        PLANT, several, SPAN, START, save=7, within=0.01, **(PAPER | settings)
    )
    for i, controller in enumerate(several):
        run = alone(controller, **settings)
        samples = len(run.x[::7])
        for name in ("x", "x_ref", "u"):
            saved = getattr(batch, f"sample_{name}")[i]
            np.testing.assert_array_equal(saved[:samples], getattr(run, name)[::7])
            assert np.all(np.isnan(saved[samples:]))
        error, held = np.abs(run.error), run.u[:-1]
        settled = run.t[np.flatnonzero(error > 0.01)[-1] + 1]
        expected = {
            "t": run.t[-1],
            "x": run.x[-1],
            "xdot": run.xdot[-1],
            "x_ref": run.x_ref[-1],
            "xdot_ref": run.xdot_ref[-1],
            "settling_time": settled,
            "error_max": error.max(),
            "rest_time": np.nan if run.rest_time is None else run.rest_time,
            "n_impacts": len(run.impacts),
            "u_max": np.abs(held).max(),
        }
        for name, value in expected.items():
            np.testing.assert_equal(float(getattr(batch, name)[i]), float(value), err_msg=name)
        # sums in another order
        assert batch.error_rms[i] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
        assert batch.u_rms[i] == pytest.approx(np.sqrt(np.mean(held**2)), rel=1e-12)
        assert batch.u_variation[i] == pytest.approx(np.abs(np.diff(held)).sum(), rel=1e-12)


def test_plants_starts_and_references_may_differ():
    plants = [zivi.ImpactSystem(-9.81, kappa=0.5), zivi.ImpactSystem(-8.0, kappa=0.5)]
    starts, references = [(6, 5), (1, 0)], [(3, 3), (2, 0)]
    batch = zivi.simulate_closed_loop_batch(
        plants, tracker(), SPAN, starts, y_ref0=references, force_ref=-19.81
    )
    for i in range(2):
        run = zivi.simulate_closed_loop(
            plants[i], tracker(), SPAN, starts[i], y_ref0=references[i], force_ref=-19.81
        )
        assert (batch.x[i], batch.xdot[i]) == (run.x[-1], run.xdot[-1])
        assert batch.error_max[i] == np.abs(run.error).max()


def test_the_papers_own_loop_and_a_regulator():
    batch = zivi.simulate_closed_loop_batch(
        zivi.ImpactSystem(0.0, kappa=0.5),
        [zivi.TwistingRegulator(3, 2, h=1e-3, kappa=0.5, landing=False)],
        (0, 3),
        [(1, 0), (2, 1)],
        method=zivi.ThetaGamma(1e-3),
    )
    assert batch.rest_time[0] == pytest.approx(1.766, abs=1e-9)  # another program's, at this h
    assert np.all(np.isnan(batch.error_max))
    assert np.all(np.isnan(batch.settling_time))
    assert np.all(batch.u_max <= 5.0)


def test_threads_change_nothing_and_controllers_stay_as_they_were():
    several = [tracker(mu1) for mu1 in np.linspace(28, 60, 30)]
    states = [controller.state for controller in several]
    one, many = (
        zivi.simulate_closed_loop_batch(PLANT, several, SPAN, START, threads=n, **PAPER)
        for n in (1, 5)
    )
    for name in ("x", "settling_time", "u_variation", "rest_time", "error_rms"):
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name))
    assert [controller.state for controller in several] == states


def test_what_has_not_settled_is_nan_and_what_was_never_off_settled_at_the_start():
    batch = zivi.simulate_closed_loop_batch(
        PLANT, tracker(), (1, 1.1), [(6, 5), (3, 3)], y_ref0=REFERENCE, force_ref=-19.81
    )
    np.testing.assert_array_equal(batch.settling_time, [np.nan, 1.0])


def test_settling_means_what_it_means_in_the_experiment():
    starts = [(6.0, 5.0), (3.0, 3.0), (3.005, 3.0)]
    batch = zivi.simulate_closed_loop_batch(
        zivi.ImpactSystem(-9.81, e=1 / 3),
        zivi.TwistingTracker(30, 17, h=1e-3, e=1 / 3),
        SPAN,
        starts,
        within=1e-3,
        force_model=-9.81,
        **PAPER,
    )
    experiment = zivi.study.EXPERIMENTS["tracker_gains"]
    for (x0, v0), settled in zip(starts, batch.settling_time, strict=True):
        found = experiment(x0=x0, v0=v0, t_end=SPAN[1], tolerance=1e-3)
        assert found["settling_time"] == settled


def test_without_a_new_reference_each_goes_on_from_where_it_is():
    controller = tracker()
    controller.reset(1.0, 0.0)
    batch = zivi.simulate_closed_loop_batch(PLANT, controller, SPAN, START, force_ref=-9.81)
    assert batch.x_ref[0] == alone(controller, y_ref0=(1.0, 0.0), force_ref=-9.81).x_ref[-1]


def test_it_converts_and_shows_itself():
    batch = zivi.simulate_closed_loop_batch(PLANT, controllers(), SPAN, START, save=100, **PAPER)
    data = batch.to_xarray()
    assert data.sizes == {"run": 5, "sample": 21}
    assert data.settling_time.attrs["units"] == "s"
    assert json.loads(data.attrs["config"])["controllers"][2]["mu1"] == 60.0
    assert repr(batch).startswith("<ClosedLoopBatch of 5 loops: 5 completed")
    assert np.all(batch.success)
    assert len(batch) == 5


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"within": 0.0}, ValueError, "within must be > 0"),
        ({"within": np.nan}, ValueError, "within must be finite"),
        ({"save": 0}, ValueError, "save must be a number of samples >= 1"),
        ({"save": "all"}, ValueError, "save must be 'final'"),
        ({"threads": 0}, ValueError, "threads must be from 1"),
        ({"delay": -1}, ValueError, "delay must be"),
        ({"y_ref0": [(1, 2)] * 3}, ValueError, "must have 1 or"),
        ({"y_ref0": (-1, 0)}, ValueError, "x_ref must be"),
        ({"force_ref": lambda t, x, v: 0.0}, ValueError, "needs the interpreter"),
        ({"method": zivi.ThetaGamma(2e-3)}, ValueError, "method.h must be"),
        ({"quantization": (-1, 0)}, ValueError, "quantization must be"),
    ],
)
def test_bad_input_is_refused_by_name(change, error, message):
    with pytest.raises(error, match=message):
        zivi.simulate_closed_loop_batch(
            PLANT, [tracker(), tracker()], SPAN, START, **(PAPER | change)
        )


def numbers(run, within=0.01):
    """What a batch says of a loop."""
    error, held = np.abs(run.error), run.u[:-1]
    outside = np.flatnonzero(error > within)
    return {
        "t": run.t[-1],
        "x": run.x[-1],
        "xdot": run.xdot[-1],
        "x_ref": run.x_ref[-1],
        "xdot_ref": run.xdot_ref[-1],
        "settling_time": run.t[outside[-1] + 1] if outside[-1] + 1 < len(run.t) else np.nan,
        "error_max": error.max(),
        "u_max": np.abs(held).max(),
        "rest_time": np.nan if run.rest_time is None else run.rest_time,
        "n_impacts": len(run.impacts),
        "n_refused": run.n_refused,
        "status": int(run.status),
    }


def same(batch, i, run):
    for name, value in numbers(run).items():
        np.testing.assert_array_equal(getattr(batch, name)[i], value, err_msg=name)
    error, held = run.error, run.u[:-1]
    assert batch.error_rms[i] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
    assert batch.u_rms[i] == pytest.approx(np.sqrt(np.mean(held**2)), rel=1e-12)
    assert batch.u_variation[i] == pytest.approx(np.abs(np.diff(held)).sum(), rel=1e-12)


@pytest.mark.parametrize("threads", [1, 2])
def test_loops_with_noise_are_what_they_are_alone(threads):
    several, seeds = controllers(), [3, 1, 4, 1, 5]
    noise = [(1e-4, 1e-2), (0.0, 0.0), (1e-3, 0.0), (1e-4, 1e-2), (1e-5, 1e-3)]
    settings = {"delay": 1, "quantization": (1e-6, 0.0)}
    observer = zivi.ImpactObserver(1 / 3, 1e-3)
    for more in ({}, {"observer": observer}):
        chosen = [it for it in several if it.h == 1e-3] if more else several
        batch = zivi.simulate_closed_loop_batch(
            PLANT,
            chosen,
            SPAN,
            START,
            noise=noise[: len(chosen)],
            seed=seeds[: len(chosen)],
            save=7,
            threads=threads,
            **(PAPER | settings | more),
        )
        for i, controller in enumerate(chosen):
            alone_with = settings | more | {"noise": noise[i], "seed": seeds[i]}
            run = alone(controller, **alone_with)
            same(batch, i, run)
            samples = len(run.x[::7])
            np.testing.assert_array_equal(batch.sample_u[i, :samples], run.u[::7])
            if batch.sample_t is not None:
                np.testing.assert_array_equal(batch.sample_t[:samples], run.t[::7])
            assert (batch.sample_t is None) == (len({it.h for it in chosen}) > 1)
            assert np.all(np.isnan(batch.sample_x[i, samples:]))
        assert batch.config["seed"] == seeds[: len(chosen)]


def test_a_reference_that_nobody_placed_and_that_flies_off_is_warned_of():
    """Its force is that on the plant, unless another is given."""
    tracker = zivi.TwistingTracker(30, 17, h=1e-2, e=0.5)
    outward = [(1.0, {}), (-9.81, {"force_ref": 2.0}), (-9.81, {"force_model": 2.0})]
    outward += [(zivi.LinearForce(gravity=-2.0, amplitude=1.0, omega=3.0), {})]
    stays = [(-1.0, {}), (1.0, {"force_ref": -1.0}), (1.0, {"y_ref0": (1, 0)})]
    stays += [(zivi.LinearForce(gravity=-2.0, stiffness=1.0), {})]
    stays += [
        (zivi.LinearForce(gravity=-2.0, amplitude=3.0), {}),
        (1.0, {"reference": np.ones((2, 11))}),
    ]
    for loop in (zivi.simulate_closed_loop, zivi.simulate_closed_loop_batch):
        for force, more in outward:
            with pytest.warns(zivi.ModelWarning, match="flies off.*y_ref0= and force_ref=") as told:
                loop(zivi.ImpactSystem(force, e=0.5), tracker, (0, 0.1), (0.1, 0), **more)
            assert told[0].filename == __file__
        for force, more in stays:
            loop(zivi.ImpactSystem(force, e=0.5), tracker, (0, 0.1), (0.1, 0), **more)


def test_the_numbers_of_both_kinds_of_batch_are_the_same():
    """Without noise: by the loops one by one, and in Rust."""

    class Mine(zivi.TwistingTracker):
        pass

    settings = {"mu2": 17.0, "h": 1e-3, "kappa": 0.5}
    both = [
        zivi.simulate_closed_loop_batch(
            PLANT, [kind(mu1, **settings) for mu1 in (20, 30, 47)], SPAN, START, save=10, **PAPER
        )
        for kind in (zivi.TwistingTracker, Mine)
    ]
    names = [field.name for field in dataclasses.fields(both[0]) if field.name != "config"]
    for name in names:
        first, second = (getattr(it, name) for it in both)
        np.testing.assert_array_equal(first, second, err_msg=name)
        assert first is None or first.dtype == second.dtype
    assert both[1].config["controllers"][0]["name"] == "Mine"


def test_seeds_are_one_for_all_or_one_for_each_or_drawn():
    noisy = {"noise": (1e-4, 1e-2), **PAPER}
    starts = [START, START, (3, 1)]
    one = zivi.simulate_closed_loop_batch(PLANT, tracker(), SPAN, starts, seed=7, **noisy)
    assert one.u_rms[0] == one.u_rms[1] != one.u_rms[2]
    same(one, 0, alone(tracker(), noise=(1e-4, 1e-2), seed=7))
    each = zivi.simulate_closed_loop_batch(PLANT, tracker(), SPAN, starts, seed=range(3), **noisy)
    assert each.u_rms[0] != each.u_rms[1]
    drawn = zivi.simulate_closed_loop_batch(PLANT, tracker(), SPAN, starts, **noisy)
    seeds = drawn.config["seed"]
    assert len(set(seeds)) == 3
    same(drawn, 1, alone(tracker(), noise=(1e-4, 1e-2), seed=seeds[1]))
    times = [0.0, 0.5, 1.1]
    at = zivi.simulate_closed_loop_batch(
        PLANT, tracker(), SPAN, starts, seed=range(3), t_eval=times, **noisy
    )
    run = alone(tracker(), noise=(1e-4, 1e-2), seed=1, t_eval=times)
    np.testing.assert_array_equal(at.sample_u[1], run.u)
    np.testing.assert_array_equal(at.sample_x[1], run.x)


class Proportional:
    """A controller of the user, with a memory."""

    h = 1e-3

    def __init__(self, gain):
        self.gain, self.sum = gain, 0.0

    def step(self, x, xdot, force, x_ref, xdot_ref):
        self.sum += self.h * (x_ref - x)
        return self.gain * (x_ref - x) + 20.0 * (xdot_ref - xdot) + self.sum - force


def test_controllers_of_the_user_run_in_batches():
    reference = np.array([np.full(2001, 0.5), np.zeros(2001)])
    starts = [(1.0, 0.0), (0.2, -1.0), (0.7, 2.0)]
    gains = [50.0, 100.0, 200.0]
    noise = {"noise": (1e-5, 1e-4), "seed": 2}
    for own, of in (([Proportional(it) for it in gains], gains), (Proportional(70.0), [70.0] * 3)):
        batch = zivi.simulate_closed_loop_batch(
            PLANT, own, SPAN, starts, reference=reference, threads=2, **noise
        )
        for i, (gain, start) in enumerate(zip(of, starts, strict=True)):
            run = zivi.simulate_closed_loop(
                PLANT, Proportional(gain), SPAN, start, reference=reference, **noise
            )
            same(batch, i, run)
        first = own[0] if isinstance(own, list) else own
        assert first.sum == 0.0  # copies ran


def test_a_controller_of_the_user_that_follows_a_reference_of_its_own():
    class Follows(zivi.TwistingTracker):
        def step(self, x, xdot, force, force_ref):
            return super().step(x, xdot, force, force_ref)

    own = Follows(30, 17, h=1e-3, kappa=0.5)
    batch = zivi.simulate_closed_loop_batch(
        PLANT, own, SPAN, START, y_ref0=[REFERENCE, (2, 1)], force_ref=-19.81
    )
    for i, start in enumerate((REFERENCE, (2, 1))):
        same(batch, i, alone(tracker(), y_ref0=start))


@pytest.mark.parametrize(
    "settings",
    [
        PAPER | {"delay": 1, "quantization": (1e-5, 1e-3)},
        PAPER | {"noise": (1e-4, 1e-2), "seed": [5, 6]},
        PAPER
        | {
            "noise": (1e-4, 1e-2),
            "seed": 3,
            "observer": zivi.ImpactObserver(1 / 3, 1e-3, noise=(1e-4, 1e-2)),
        },
        {"reference": zivi.simulate(zivi.ImpactSystem(-19.81, kappa=0.5), (0, 2), (3, 3))},
        {"reference": lambda t: (1 + 0.3 * np.sin(3 * t), 0.9 * np.cos(3 * t))},
        PAPER | {"save": 100},
        PAPER | {"t_eval": np.linspace(0, 2, 31)},
    ],
    ids=["late", "noisy", "observed", "run", "function", "saved", "times"],
)
def test_the_tracker_behind_an_interface_of_the_users_is_the_tracker(settings):
    starts = [START, (3, 1)]
    ours, theirs = (
        zivi.simulate_closed_loop_batch(PLANT, controller, SPAN, starts, **settings)
        for controller in (tracker(), Foreign(tracker()))
    )
    for field in dataclasses.fields(ours):
        if field.name != "config":
            first, second = (getattr(batch, field.name) for batch in (ours, theirs))
            np.testing.assert_array_equal(first, second, err_msg=field.name)
    assert theirs.to_xarray().sizes == ours.to_xarray().sizes
    assert theirs.config["controllers"] == [{"name": "Foreign"}]


def test_what_a_batch_of_single_loops_refuses():
    class Locked(Proportional):
        def __deepcopy__(self, memo):
            raise RuntimeError("there is one of me")

    class Breaks(Proportional):
        def step(self, x, xdot, force):
            raise RuntimeError("broken")

    fine = {"systems": PLANT, "controllers": tracker(), "t_span": SPAN, "y0": START}
    for change, error, message in (
        ({"controllers": Locked(1.0)}, TypeError, "Locked .number 0. cannot be copied"),
        ({"controllers": Breaks(1.0)}, RuntimeError, "broken"),
        ({"controllers": object()}, TypeError, "controller must have a sampling period"),
        ({"noise": (1e-3, 1e-3, 1e-3)}, ValueError, r"noise must have shape \(n, 2\)"),
        ({"noise": (-1e-3, 0.0)}, ValueError, "noise must be two finite numbers >= 0"),
        ({"noise": (1e-3, 0.0), "seed": -1}, ValueError, "seed must be"),
        ({"noise": (1e-3, 0.0), "seed": 1.5}, TypeError, "seed must be"),
        ({"noise": (1e-3, 0.0), "seed": [1, 2], "y0": [START] * 3}, ValueError, "seed must have 1"),
        ({"noise": (1e-3, 0.0), "y0": [START, (-1, 0)]}, ValueError, "y0 must be .* .run 1."),
    ):
        with pytest.raises(error, match=message):
            zivi.simulate_closed_loop_batch(**(fine | change))


def test_what_does_not_follow_is_refused():
    regulator = zivi.TwistingRegulator(3, 2, h=1e-3, kappa=0.5)
    with pytest.raises(TypeError, match="does not follow a reference"):
        zivi.simulate_closed_loop_batch(PLANT, regulator, SPAN, START, y_ref0=REFERENCE)
    with pytest.raises(ValueError, match="run 1 of the batch"):
        zivi.simulate_closed_loop_batch(PLANT, tracker(), SPAN, [(1, 0), (-1, 0)], **PAPER)


def test_states_at_given_times_are_those_of_the_loops():
    times = np.array([0.0, 0.0105, 0.7, 0.7005, 1.23456, 2.0])
    plants = [zivi.ImpactSystem(force, e=0.5) for force in (-9.81, zivi.LinearForce(gravity=9.0))]
    trackers = [zivi.TwistingTracker(30, 17, h=1e-3, e=0.5) for _ in plants]
    settings = {"force_ref": -19.81, "delay": 1}
    starts, references = [(6, 5), (2, -1)], [(3, 3), (1, 0)]
    batch = zivi.simulate_closed_loop_batch(
        plants, trackers, (0, 2), starts, y_ref0=references, t_eval=times, threads=2, **settings
    )
    assert batch.config["t_eval"] == times.tolist()
    np.testing.assert_array_equal(batch.sample_t, times)
    for i, plant in enumerate(plants):
        run = zivi.simulate_closed_loop(
            plant, trackers[i], (0, 2), starts[i], y_ref0=references[i], t_eval=times, **settings
        )
        for name in ("x", "xdot", "x_ref", "u"):
            values = getattr(batch, f"sample_{name}")[i]
            np.testing.assert_array_equal(values, getattr(run, name))
        assert batch.sample_x[i, -1] == batch.x[i]
    data = batch.to_xarray()
    assert data.sample_xdot.dims == ("run", "sample")
    assert data.sample_t.attrs["units"] == "s"


@pytest.mark.parametrize("method", [None, zivi.ThetaGamma(h=1e-2), zivi.SwitchedRK()])
def test_times_change_none_of_the_numbers_and_each_loop_runs_once(method, monkeypatch):
    plant = zivi.ImpactSystem(-9.81, e=0.5)
    trackers = [zivi.TwistingTracker(mu1, 17, h=1e-2, e=0.5) for mu1 in (24, 30)]
    settings = {"y_ref0": (3, 3), "force_ref": -19.81, "method": method, "quantization": (1e-4, 0)}
    given = (plant, trackers, (0, 1.5), [(6, 5), (2, -1)])
    plain = zivi.simulate_closed_loop_batch(*given, **settings)
    runs = []
    loop = loop_batch.simulate_mass

    def counted(*given, **named):
        runs.append(given)
        return loop(*given, **named)

    monkeypatch.setattr(loop_batch, "simulate_mass", counted)
    timed = zivi.simulate_closed_loop_batch(*given, t_eval=[0.0, 0.55, 1.5], **settings)
    assert len(runs) == 2
    for name in NUMBERS:
        np.testing.assert_array_equal(getattr(timed, name), getattr(plain, name), strict=True)


def test_loops_that_end_early_have_no_states_after_it():
    def overflow(t, x, xdot):
        return 1e300 * x

    numba = pytest.importorskip("numba")
    force = numba.cfunc("float64(float64, float64, float64)")(overflow)
    plants = [zivi.ImpactSystem(force, e=0.5), zivi.ImpactSystem(-9.81, e=0.5)]
    regulator = zivi.TwistingRegulator(30, 17, h=1e-2, e=0.5)
    times = [0.0, 0.5, 1.0]
    batch = zivi.simulate_closed_loop_batch(
        plants, regulator, (0, 1), (1, 0), force_model=-9.81, t_eval=times
    )
    assert batch.status[0] not in (0, 9)
    assert np.isnan(batch.sample_x[0, 1:]).all()
    assert np.isfinite(batch.sample_x[1]).all()


def test_times_that_are_none_are_refused_beforehand():
    plant, regulator = (
        zivi.ImpactSystem(-9.81, e=0.5),
        zivi.TwistingRegulator(30, 17, h=1e-3, e=0.5),
    )
    for given, told in (
        ({"t_eval": [0.5, 2.0]}, "t_eval"),
        ({"t_eval": [0.5], "save": 10}, "save='final'"),
    ):
        with pytest.raises(ValueError, match=told):
            zivi.simulate_closed_loop_batch(plant, regulator, (0, 1), (1, 0), **given)
