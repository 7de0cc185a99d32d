"""Closed loops between their samples: motion, transformed state, events, times, files."""

import copy
import pickle

import numpy as np
import pytest

import zivi

H, F, E = 1e-2, -9.81, 0.5
PLANT = zivi.ImpactSystem(F, e=E)
METHODS = {
    "exact": None,
    "switched": zivi.SwitchedRK(rtol=1e-10, atol=1e-13),
    "scheme": zivi.ThetaGamma(h=H),
}


def tracker(**more):
    return zivi.TwistingTracker(30, 17, **{"h": H, "e": E} | more)


def tracked(system=PLANT, t_span=(0, 1.5), **more):
    start = {"y_ref0": (0.5, 0.0), "force_ref": -15.0}
    return zivi.simulate_closed_loop(system, tracker(), t_span, (1, 0), **start | more)


def held(run, k):
    """The motion of one period, by the switched method under the force and the control."""
    force = F + float(run.u[k])
    system = zivi.ImpactSystem(force, e=E)
    return zivi.simulate(system, (run.t[k], run.t[k + 1]), (run.x[k], run.xdot[k]))


@pytest.mark.parametrize("name", ["exact", "switched"])
def test_the_motion_between_the_samples_is_that_of_the_held_control(name):
    run = tracked(method=METHODS[name])
    moving = np.flatnonzero(np.hypot(run.x, run.xdot)[:-1] > 1e-6)
    for k in moving[:: len(moving) // 12]:
        times = np.linspace(run.t[k], run.t[k + 1], 23)[1:-1]
        np.testing.assert_allclose(run(times), held(run, k)(times), atol=1e-8)
    np.testing.assert_array_equal(run(run.t), [run.x, run.xdot])
    x, _ = run(np.linspace(0, 1.5, 5000))
    assert np.all(x >= 0)


@pytest.mark.parametrize("name", METHODS)
def test_the_transformed_state_projects_to_the_state_and_goes_through_the_wall(name):
    run = tracked(method=METHODS[name])
    x, xdot = zivi.project(run.transformed.s, run.transformed.v, e=E)
    np.testing.assert_allclose([x, xdot], [run.x, run.xdot], rtol=1e-12, atol=1e-12)
    first = run.resolved_impacts["t"][0]
    assert np.all(run.transformed.s[run.t < first] > 0)
    after = run.t[(run.t > first) & (run.t < run.resolved_impacts["t"][1])]
    assert np.all(run.transformed.s[np.isin(run.t, after)] < 0)
    # s is continuous across impacts: no step larger than the fastest motion allows
    times = np.linspace(0, 1.5, 20001)
    s, _ = run._path.lifted(times)
    fastest = np.max(np.abs(run(times)[1])) + 1
    assert np.max(np.abs(np.diff(s))) < fastest * (times[1] - times[0])


def test_a_scheme_is_linear_between_the_samples():
    run = tracked(method=METHODS["scheme"])
    s, v = np.interp(0.123, run.t, run.transformed.s), np.interp(0.123, run.t, run.transformed.v)
    x, xdot = zivi.project(s, v, e=E)
    np.testing.assert_allclose(run(0.123), [float(x), float(xdot)], rtol=1e-12)


def test_the_reference_between_the_samples_is_that_of_its_implicit_steps():
    run = tracked()
    np.testing.assert_allclose(run.reference(run.t), [run.x_ref, run.xdot_ref], atol=1e-13)
    ball = zivi.ImpactSystem(-15.0, e=E)
    own = zivi.simulate(ball, (0, 1.5), (0.5, 0), method=zivi.ThetaGamma(h=H))
    times = np.linspace(0, 1.5, 999)
    np.testing.assert_allclose(run.reference(times), own(times), atol=1e-10)


def test_without_a_reference_or_a_path_it_says_so():
    regulator = zivi.TwistingRegulator(30, 17, h=H, e=E)
    run = zivi.simulate_closed_loop(PLANT, regulator, (0, 1), (1, 0), dense_output=False)
    with pytest.raises(ValueError, match="dense_output=True"):
        run(0.5)
    with pytest.raises(ValueError, match="follows a reference"):
        run.reference(0.5)
    dense = zivi.simulate_closed_loop(PLANT, regulator, (0, 1), (1, 0))
    np.testing.assert_array_equal(dense.transformed.s, run.transformed.s)
    for t in (-0.1, 1.1, np.nan):
        with pytest.raises(ValueError, match="computed span"):
            dense(t)
    with pytest.raises(TypeError, match="dense_output"):
        zivi.simulate_closed_loop(PLANT, regulator, (0, 1), (1, 0), dense_output=1)


@pytest.mark.parametrize("name", METHODS)
def test_events_lie_on_the_motion_and_none_is_lost(name):
    run = tracked(method=METHODS[name], events=[lambda t, x, xdot: x - 0.2, _impact])
    (times, hits), (states, at_wall) = run.t_events, run.y_events
    np.testing.assert_allclose(states[:, 0], 0.2, atol=1e-9)
    np.testing.assert_allclose(states.T, run(times), atol=1e-6)
    fine = np.linspace(0, 1.5, 100_001)
    assert len(times) == np.count_nonzero(np.diff(np.sign(run(fine)[0] - 0.2)))
    # the velocity changes its sign in the impact: the state after it
    fast = run.resolved_impacts[run.resolved_impacts["xdot_after"] > 1e-2]
    np.testing.assert_allclose(hits[: len(fast)], fast["t"], rtol=1e-12)
    if name != "scheme":
        np.testing.assert_allclose(at_wall[: len(fast), 1], fast["xdot_after"], rtol=1e-12)


def _impact(t, x, xdot):
    return xdot


_impact.direction = 1


@pytest.mark.parametrize("name", METHODS)
def test_a_terminal_event_ends_the_run_within_its_period(name):
    def low(t, x, xdot):
        return x - 0.2

    low.terminal = True
    whole = tracked(method=METHODS[name])
    run = tracked(method=METHODS[name], events=low)
    assert run.success
    assert run.status is zivi.Status.TERMINATED_BY_EVENT
    end = run.t_events[0][-1]
    assert run.t[-1] == end
    assert run.x[-1] == pytest.approx(0.2, abs=1e-9)
    np.testing.assert_array_equal(run.x[:-1], whole.x[: len(run.x) - 1])
    np.testing.assert_array_equal(
        run.resolved_impacts, whole.resolved_impacts[whole.resolved_impacts["t"] <= end]
    )
    with pytest.raises(ValueError, match="computed span"):
        run(end + 1e-6)
    assert run.rest_time is None


def test_times_that_are_asked_for():
    whole = tracked()
    times = [0.0, 0.005, 0.3, 1.4999, 1.5]
    run = tracked(t_eval=times)
    np.testing.assert_array_equal(run.t, times)
    np.testing.assert_array_equal([run.x, run.xdot], whole(times))
    np.testing.assert_array_equal([run.x_ref, run.xdot_ref], whole.reference(times))
    np.testing.assert_array_equal(run.u[[1, 3]], whole.u[[0, 149]])
    np.testing.assert_array_equal(run(whole.t), whole(whole.t))
    assert len(run.resolved_impacts) == len(whole.resolved_impacts)
    with pytest.raises(ValueError, match="t_eval must be increasing"):
        tracked(t_eval=[0.2, 0.1])


def test_impacts_beyond_those_that_a_period_lists():
    e, h = 0.999, 0.5
    plant = zivi.ImpactSystem(-9.81, e=e)

    class Nothing:
        def __init__(self):
            self.h = h

        def step(self, x, xdot, force):
            return 0.0

    run = zivi.simulate_closed_loop(plant, Nothing(), (0, 2), (1e-7, 0))
    assert len(run.resolved_impacts) >= 1000
    all_of_them = run.impacts_down_to(1e-6)
    speed = np.sqrt(2 * 9.81 * 1e-7)
    # the n-th is e^n as fast, and the flights are a geometric series
    n = np.arange(1, len(all_of_them) + 1)
    np.testing.assert_allclose(all_of_them["xdot_after"], speed * e**n, rtol=1e-9)
    times = speed / 9.81 * (1 + 2 * e * (1 - e ** (n - 1)) / (1 - e))
    np.testing.assert_allclose(all_of_them["t"], times, rtol=1e-9)
    assert len(all_of_them) == np.count_nonzero(speed * e ** np.arange(20_000) >= 1e-6)


@pytest.mark.parametrize("name", METHODS)
def test_what_is_saved_or_sent_is_all_of_it(name, tmp_path):
    pytest.importorskip("h5netcdf")
    import zivi.files

    run = tracked(method=METHODS[name], events=lambda t, x, xdot: x - 0.2)
    file = tmp_path / "loop.nc"
    zivi.files.save(run, file)
    times = np.linspace(0, 1.5, 77)
    for twin in (zivi.files.load(file), pickle.loads(pickle.dumps(run)), copy.deepcopy(run)):
        np.testing.assert_array_equal(twin(times), run(times))
        np.testing.assert_array_equal(twin.reference(times), run.reference(times))
        np.testing.assert_array_equal(twin.transformed.s, run.transformed.s)
        np.testing.assert_array_equal(twin.t_events[0], run.t_events[0])
        np.testing.assert_array_equal(twin.impacts_down_to(1e-9), run.impacts_down_to(1e-9))


def test_a_force_that_depends_on_time_keeps_its_motion():
    force = zivi.LinearForce(gravity=9.81, amplitude=2.0, omega=11.0)
    system = zivi.ImpactSystem(force, e=E)
    run = tracked(system, force_model=F)
    # against the embedded pair
    pair = zivi.SwitchedRK(rtol=1e-12, atol=1e-15, flights="rk")
    finer = tracked(system, force_model=F, method=pair)
    times = np.linspace(0, 0.3, 301)
    np.testing.assert_allclose(run(times), finer(times), atol=1e-10)
    np.testing.assert_allclose(run(run.t), [run.x, run.xdot], atol=1e-12)


def test_the_plot_of_a_run_and_poincare_of_a_loop():
    pytest.importorskip("matplotlib").use("Agg")
    run = tracked()
    assert len(run.plot().axes) == 4
    assert len(zivi.simulate(PLANT, (0, 1), (1, 0)).plot().axes) == 4
    ax = zivi.plot.poincare(run, 0.1)
    np.testing.assert_array_equal(
        ax.lines[0].get_xdata(), run(np.clip(0.1 * np.arange(16), 0, 1.5))[0]
    )


def test_a_configuration_with_infinity_is_plain_json():
    pytest.importorskip("xarray")
    import json

    def refuse(name):
        raise AssertionError(name)

    sol = zivi.simulate(PLANT, (0, 1), (1, 0), method=zivi.SwitchedRK())
    loop = tracked(method=zivi.SwitchedRK(rtol=1e-9))
    batch = zivi.simulate_batch(PLANT, (0, 1), (1, 0), method=zivi.SwitchedRK())
    for run in (sol, loop, batch):
        config = json.loads(run.to_xarray().attrs["config"], parse_constant=refuse)
        assert config["method"]["max_step"] is None


def test_a_reference_with_a_wall_of_its_own_moves_by_that_wall():
    """Its s and v are linear in a period with an impact, lifted by its own kappa."""
    tracker = zivi.TwistingTracker(30, 17, h=1e-2, e=0.8, e_ref=0.3)
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(-9.81, e=0.8), tracker, (0, 1), (1, 0), y_ref0=(1, 0)
    )
    k = int(np.flatnonzero((run.xdot_ref[:-1] < -1) & (run.xdot_ref[1:] > 0))[0])
    kappa = 0.7 / 1.3
    # x = |s|, x' = (1 - kappa sgn(s v)) sgn(s) v: down on the positive side, up on the other
    v = run.xdot_ref[k] / (1 + kappa), -run.xdot_ref[k + 1] / (1 - kappa)
    s = run.x_ref[k], -run.x_ref[k + 1]
    for part in (0.1, 0.35, 0.6, 0.9):
        s_t, v_t = (a + part * (b - a) for a, b in (s, v))
        x, xdot = run.reference(run.t[k] + part * (run.t[k + 1] - run.t[k]))
        assert x == pytest.approx(abs(s_t), rel=1e-9)
        wanted = (1 - kappa * np.sign(s_t * v_t)) * np.sign(s_t) * v_t
        assert xdot == pytest.approx(wanted, rel=1e-9)


def test_rest_before_an_event_is_rest_for_a_period_at_least():
    plant, h = zivi.ImpactSystem(-9.81, e=0.5), 1e-2
    tracker = zivi.TwistingTracker(30, 17, h=h, e=0.5)

    def until(time, y0=(0.1, 0)):
        def due(t, x, xdot):
            return t - time

        due.terminal = True
        return zivi.simulate_closed_loop(plant, tracker, (0, 1), y0, y_ref0=(0, 0), events=due)

    zeno = until(0.9).zeno_times[-1]
    assert until(zeno + 0.5 * h).rest_time is None
    assert until(zeno + 0.97 * h).rest_time is None
    assert until(zeno + 1.03 * h).rest_time == zeno
    assert until(0.9).rest_time == zeno
    assert until(0.9 * zeno).rest_time is None
    # from the start on, if that is less than a period
    assert until(0.4 * h, (0, 0)).rest_time == 0.0
    assert until(1.4 * h, (0, 0)).rest_time == 0.0
