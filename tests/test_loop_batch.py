"""Batches of closed loops: each as alone, to the last bit; what is saved; what is refused."""

import json

import numpy as np
import pytest

import zivi

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
    assert batch.rest_time[0] == pytest.approx(1.767, abs=1e-9)  # another program's, at this h
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


def test_what_is_not_ours_is_refused():
    class Mine(zivi.TwistingTracker):
        def step(self, *sample):
            return 0.0

    mine = Mine(30, 17, h=1e-3, kappa=0.5)
    with pytest.raises(TypeError, match="zivi's own, got Mine"):
        zivi.simulate_closed_loop_batch(PLANT, mine, SPAN, START, **PAPER)
    regulator = zivi.TwistingRegulator(3, 2, h=1e-3, kappa=0.5)
    with pytest.raises(TypeError, match="follows no reference"):
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
