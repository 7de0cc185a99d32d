"""What a run reports: lengths, dense output, times asked for, the end of the span."""

import copy
import ctypes
import dataclasses
import gc
import pickle
import weakref
from operator import attrgetter

import numpy as np
import pytest

import zivi
from closed_form import Ball

BALL = zivi.ImpactSystem(-9.81, e=0.5)
METHOD = zivi.ThetaGamma(h=1e-3)
COLUMNS = (
    "t",
    "x",
    "xdot",
    "transformed.s",
    "transformed.v",
    "transformed.lambda_s",
    "transformed.lambda_v",
    "residual",
)


@pytest.fixture(scope="module")
def sol():
    return zivi.simulate(BALL, (0, 3), (1, 0), method=METHOD)


def test_all_columns_have_one_length_and_type(sol):
    for name in COLUMNS:
        column = attrgetter(name)(sol)
        assert column.shape == (3001,), name
        assert column.dtype == np.float64
    assert sol.n_steps == 3000
    assert sol.resolved_impacts.dtype.names == ("t", "xdot_before", "xdot_after")


def test_a_completed_run_says_so(sol):
    assert sol.success is True
    assert sol.status == zivi.Status.COMPLETED == 0
    assert "end of t_span" in sol.message
    assert (sol.t[0], sol.t[-1]) == (0.0, 3.0)


def test_initial_sample_is_the_initial_state():
    sol = zivi.simulate(BALL, (2.5, 3), (1, -4), method=METHOD)
    assert (sol.t[0], sol.x[0]) == (2.5, 1.0)
    assert sol.xdot[0] == pytest.approx(-4.0, rel=1e-15)
    assert (sol.transformed.lambda_s[0], sol.transformed.lambda_v[0]) == (1.0, -1.0)


def test_the_end_of_the_span_is_met_exactly():
    for h, t1 in [(0.1, 1.0), (0.3, 1.0), (1e-3, np.pi), (7.0, 0.2), (0.1, 0.30000000000000004)]:
        sol = zivi.simulate(BALL, (0, t1), (1, 0), method=zivi.ThetaGamma(h=h))
        assert sol.t[-1] == t1
        assert sol.n_steps == len(sol.t) - 1
        assert np.all(np.diff(sol.t) <= h * (1 + 1e-9))


def test_dense_output_hits_the_samples_and_is_linear_in_s_and_v_between(sol):
    np.testing.assert_array_equal(sol(sol.t), (sol.x, sol.xdot))
    k = 200
    middle = 0.5 * (sol.t[k] + sol.t[k + 1])
    x, xdot = sol(middle)
    assert x == pytest.approx(0.5 * (sol.x[k] + sol.x[k + 1]), rel=1e-12)
    assert xdot == pytest.approx(0.5 * (sol.xdot[k] + sol.xdot[k + 1]), rel=1e-12)


def test_dense_output_shapes(sol):
    assert sol(0.5).shape == (2,)
    assert sol(np.float64(0.5)).shape == (2,)
    assert sol([0.5]).shape == (2, 1)
    assert sol(np.linspace(0, 3, 7)).shape == (2, 7)
    assert sol([]).shape == (2, 0)
    np.testing.assert_array_equal(sol([0.5, 0.25])[:, 0], sol(0.5))


def test_dense_output_is_first_order_and_jumps_at_the_impact(sol):
    """Within a few h of the closed form, and on both sides of the impact that it reports."""
    ball = Ball(1.0, 0.0, e=0.5)
    times = np.linspace(0, 1.0, 400)
    exact = np.array([ball.state(t)[0] for t in times])
    assert np.abs(sol(times)[0] - exact).max() < 10 * METHOD.h
    t, before, after = sol.resolved_impacts[0]
    assert sol(t - 1e-9)[1] == pytest.approx(before, rel=1e-6)
    assert sol(t + 1e-9)[1] == pytest.approx(after, rel=1e-6)


def test_reported_times_are_interpolated(sol):
    times = [0.0, 0.1234567, 0.5, 0.5, 2.9999999, 3.0]
    some = zivi.simulate(BALL, (0, 3), (1, 0), method=METHOD, t_eval=times)
    np.testing.assert_array_equal(some.t, times)
    np.testing.assert_array_equal((some.x, some.xdot), sol(times))
    for name in COLUMNS:
        assert attrgetter(name)(some).shape == (6,)
    np.testing.assert_array_equal(some.resolved_impacts, sol.resolved_impacts)
    assert some.rest_time == sol.rest_time
    assert some.n_steps == sol.n_steps
    np.testing.assert_array_equal(some(1.0), sol(1.0))


def test_reported_times_end_with_a_run_that_ends_early():
    def force(t, x, xdot):
        return np.nan if t > 1.0 else -9.81

    system = zivi.ImpactSystem(force, e=0.5)
    sol = zivi.simulate(system, (0, 3), (1, 0), method=METHOD, t_eval=[0.5, 0.9, 1.5, 3])
    assert sol.t.tolist() == [0.5, 0.9]
    assert not sol.success
    with pytest.raises(ValueError, match=r"within the computed span \[0"):
        sol(1.5)


def test_configuration_tells_the_run_again():
    force = zivi.LinearForce(gravity=9.81, damping=0.1)
    system = zivi.ImpactSystem(force, kappa=0.41)
    sol = zivi.simulate(system, (0, 1), (1, 6), method=zivi.ThetaGamma(h=0.01, theta=0.75))
    config = sol.config
    assert config["kappa"] == 0.41
    assert config["e"] == pytest.approx(0.59 / 1.41)
    assert (config["t_span"], config["y0"]) == ([0.0, 1.0], [1.0, 6.0])
    law = dict(config["force"])
    assert law.pop("name") == "LinearForce"
    assert zivi.LinearForce(**law) == force
    settings = dict(config["method"])
    method = getattr(zivi, settings.pop("name"))(**settings)
    again = zivi.simulate(
        zivi.ImpactSystem(zivi.LinearForce(**law), kappa=config["kappa"]),
        config["t_span"],
        config["y0"],
        method=method,
    )
    np.testing.assert_array_equal(again.transformed.s, sol.transformed.s)


def test_a_callable_is_named_in_the_configuration():
    def my_law(t, x, xdot):
        return -1.0

    system = zivi.ImpactSystem(my_law, e=0.5)
    sol = zivi.simulate(system, (0, 1), (1, 0), method=METHOD)
    assert "my_law" in sol.config["force"]
    number = zivi.simulate(BALL, (0, 1), (1, 0), method=METHOD)
    assert number.config["force"] == -9.81


def test_a_trajectory_is_frozen_and_prints_on_one_line(sol):
    with pytest.raises(dataclasses.FrozenInstanceError):
        sol.status = 3
    text = repr(sol)
    assert "\n" not in text
    assert "3000 steps" in text
    assert "at rest from" in text


def test_two_runs_are_equal_to_the_last_bit(sol):
    again = zivi.simulate(BALL, (0, 3), (1, 0), method=METHOD)
    for name in COLUMNS:
        np.testing.assert_array_equal(attrgetter(name)(again), attrgetter(name)(sol))


def test_overflow_ends_the_run_and_keeps_it():
    system = zivi.ImpactSystem(lambda t, x, xdot: 10.0 * xdot, e=0.5)
    sol = zivi.simulate(system, (0, 100), (1, 1), method=zivi.ThetaGamma(h=0.05, theta=0.5))
    assert not sol.success
    assert sol.status in (zivi.Status.STATE_NOT_FINITE, zivi.Status.FORCE_NOT_FINITE)
    assert sol.x[-1] > 1e100
    assert all(np.all(np.isfinite(attrgetter(name)(sol))) for name in COLUMNS)


@pytest.mark.parametrize("name", ["s", "v", "lambda_s", "lambda_v"])
def test_transformed_samples_have_names_that_say_so(name, sol):
    loop = zivi.simulate_closed_loop(
        BALL, zivi.TwistingTracker(30, 17, h=1e-2, e=0.5), (0, 1), (0.2, 0), y_ref0=(0.2, 0)
    )
    np.testing.assert_array_equal(loop.transformed.lambda_v, loop.signs[:, 1])
    for run in (sol, loop):
        if run is loop and name not in ("s", "v"):
            assert not hasattr(run, name)
            continue
        with pytest.warns(DeprecationWarning, match=f"use transformed.{name}") as caught:
            found = getattr(run, name)
        assert caught[0].filename == __file__
        assert ("velocity of the mass is xdot" in str(caught[0].message)) == (name == "v")
        np.testing.assert_array_equal(found, getattr(run.transformed, name))


def test_nothing_but_the_former_names_warns(sol, tmp_path):
    """Nor does what reads all of a run (warnings are errors here)."""
    for way in (copy.copy, copy.deepcopy, lambda it: pickle.loads(pickle.dumps(it))):
        np.testing.assert_array_equal(way(sol).transformed.v, sol.transformed.v)
    # the state of a pickle has the names of former versions, which read it
    assert {"s", "v", "lambda_s", "lambda_v"} <= sol.__getstate__().keys()
    assert {"s", "v"} <= {*sol.to_pandas().columns} & {*sol.to_xarray()}
    assert {"s", "v"} <= {*dir(sol)}
    assert sol._repr_html_()


def test_impacts_down_to_a_speed_before_them(sol):
    """Each impact halves the speed: 1.5 times the third speed before is below the second."""
    before = -sol.resolved_impacts["xdot_before"]
    for speed, number in ((before[2], 3), (1.5 * before[2], 2), (2 * before[0], 0)):
        found = sol.impacts_down_to(speed)
        np.testing.assert_array_equal(found["t"], sol.resolved_impacts["t"][:number])
    part = sol.slowest * before.max()
    np.testing.assert_array_equal(sol.impacts_down_to(part), sol.impacts)
    plastic = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.0), (0, 1), (1, 0))
    assert len(plastic.impacts_down_to(1e-14)) == 1
    for speed in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="speed must be"):
            sol.impacts_down_to(speed)
    for limit in (0, -1):
        with pytest.raises(ValueError, match=f"limit must be >= 1, got {limit}"):
            sol.impacts_down_to(1.0, limit=limit)


def test_impacts_of_two_accumulations_are_in_the_order_of_time():
    def law(t, x, xdot):
        return 20.0 if 2.0 <= t < 2.3 else -9.81

    method = zivi.SwitchedRK(max_step=0.05)
    sol = zivi.simulate(zivi.ImpactSystem(law, e=0.5), (0, 9), (1, 0), method)
    assert len(sol.zeno_times) == 2
    found = sol.impacts_down_to(1e-3)["t"]
    assert np.all(np.diff(found) > 0)
    of_the_first = np.count_nonzero(found < sol.zeno_times[0])
    assert 0 < of_the_first < len(found)
    assert len(found) > len(sol.resolved_impacts)


def test_the_dataset_tells_what_the_run_cost():
    sol = zivi.simulate(
        zivi.ImpactSystem(lambda t, x, xdot: -9.81 * (1 + (t > 0.2)), e=0.5), (0, 0.4), (1, 0)
    )
    told = sol.to_xarray().attrs
    for name in ("nfev", "n_steps", "n_rejected"):
        assert told[name] == attrgetter(name)(sol) > 0
    assert told["nfev"] > told["n_steps"]


def test_the_dataset_tells_how_the_run_ended():
    system = zivi.ImpactSystem(lambda t, x, xdot: np.nan if t > 0.1 else -9.81, e=0.5)
    sol = zivi.simulate(system, (0, 1), (1, 0), method=METHOD)
    told = sol.to_xarray().attrs
    assert told["status"] == sol.status == zivi.Status.FORCE_NOT_FINITE
    assert told["message"] == sol.message


def test_the_configuration_has_the_wall():
    table = zivi.HarmonicWall(amplitude=0.1, omega=10.0, phase=0.3)
    sol = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5, wall=table), (0, 0.1), (1, 0))
    law = dict(sol.config["wall"])
    assert law.pop("name") == "HarmonicWall"
    assert zivi.HarmonicWall(**law) == table


def test_what_is_not_read_yet_is_the_same_later_and_elsewhere():
    """Samples and events are made when they are asked for: after a pickle, a copy, in any order."""
    force = zivi.LinearForce(gravity=9.81, damping=0.1)
    system = zivi.ImpactSystem(force, e=0.5)

    def run():
        return zivi.simulate(system, (0, 3), (1, 0), events=lambda t, x, v: v)

    read = run()
    names = (*COLUMNS, "resolved_impacts", "zeno_times", "failed_steps")
    expected = {name: attrgetter(name)(read) for name in names}
    assert len(expected["t"]) > 20 > len(zivi.simulate(system, (0, 3), (1, 0), samples="steps").t)
    ways = {
        "pickle": lambda it: pickle.loads(pickle.dumps(it)),
        "copy": copy.copy,
        "deepcopy": copy.deepcopy,
        "replace": dataclasses.replace,
    }
    for name, way in ways.items():
        other = way(run())
        for quantity in names:
            found = attrgetter(quantity)(other)
            np.testing.assert_array_equal(found, expected[quantity], err_msg=f"{name} {quantity}")
        assert (other.message, other.nfev, other.rest_time) == (
            read.message,
            read.nfev,
            read.rest_time,
        )
        np.testing.assert_array_equal(other.y_events[0], read.y_events[0])
        assert other.config == read.config
        np.testing.assert_array_equal(other(1.0), read(1.0))
    with pytest.raises(AttributeError, match="no attribute 'y0'"):
        _ = run().y0


def test_an_exception_and_its_run_do_not_keep_each_other():
    """The run knows its record until it is read, and that knows the exception."""

    def fails(t, x, v):
        if t > 0.2:
            raise Exceptional
        return -9.81

    with pytest.raises(Exceptional) as raised:
        zivi.simulate(zivi.ImpactSystem(fails, e=0.5), (0, 1), (1, 0))
    assert raised.value.trajectory.status == zivi.Status.RAISED
    assert len(raised.value.trajectory.t) > 1
    known = weakref.ref(raised.value)
    del raised
    gc.collect()
    assert known() is None


@pytest.mark.parametrize("method", [zivi.SwitchedRK(), zivi.ThetaGamma(1e-2)], ids=repr)
def test_a_run_that_raised_is_read_when_it_is_requested(method):
    """After Ctrl-C nothing is made of the samples: a long run would take longer than itself."""

    def fails(t, x, v):
        if t > 0.2:
            raise Exceptional
        return -9.81

    for force in (fails, ctypes.CFUNCTYPE(*4 * [ctypes.c_double])(fails)):
        with pytest.raises(Exceptional) as raised:
            zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 1), (1, 0), method)
        sol = raised.value.trajectory
        read = set(vars(sol)) - {"_record", "_drawn", "_asked"}
        assert read <= {"status", "message", "n_rejected"}
        assert f"at t = {sol.t[-1]:.9g} s" in raised.value.__notes__[0]
        assert sol.status is zivi.Status.RAISED
        assert len(sol.x) == len(sol.residual) == len(sol.t) > 1


class Exceptional(Exception):  # noqa: N818 - the name of an exception of a user
    """What a force raises."""
