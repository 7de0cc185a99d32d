"""A run at other times, and as other libraries want it."""

import pickle

import numpy as np
import pytest

import zivi

G, E = 9.81, 0.5
FALL = np.sqrt(2 / G)


def ball(t):
    """Closed form of the ball dropped from 1 m: x and x'."""
    t = np.asarray(t, float)
    x, xdot = 1 - G * t**2 / 2, -G * t
    start, speed = FALL, E * G * FALL
    for _ in range(60):
        arc = t >= start
        tau = t - start
        x = np.where(arc, speed * tau - G * tau**2 / 2, x)
        xdot = np.where(arc, speed - G * tau, xdot)
        start, speed = start + 2 * speed / G, E * speed
    rest = t >= start
    return np.where(rest, 0.0, x), np.where(rest, 0.0, xdot)


@pytest.fixture(scope="module")
def sol():
    return zivi.simulate(zivi.ImpactSystem(-G, e=E), (0, 2), (1, 0))


def test_samples_at_other_times_are_the_motion(sol):
    times = np.linspace(0, 2, 41)
    for again in (sol.resample(times), sol.resample(n=41)):
        np.testing.assert_array_equal(again.t, times)
        np.testing.assert_allclose((again.x, again.xdot), ball(times), atol=1e-12)
        assert again.resolved_impacts is sol.resolved_impacts
        assert again.rest_time == sol.rest_time
    kappa = (1 - E) / (1 + E)
    side = np.where(again.transformed.lambda_s == 0.0, 1.0, again.transformed.lambda_s)
    np.testing.assert_allclose(side * again.transformed.s, again.x, atol=1e-15)
    factor = 1 - kappa * again.transformed.lambda_s * again.transformed.lambda_v
    np.testing.assert_allclose(
        again.transformed.lambda_s * again.transformed.v * factor, again.xdot, atol=1e-12
    )
    assert np.all(again.transformed.lambda_s[times > sol.rest_time] == 0.0)
    assert again(0.3)[0] == sol(0.3)[0]


def test_multipliers_of_fixed_steps_are_those_of_the_step():
    sol = zivi.simulate(zivi.ImpactSystem(-G, e=E), (0, 1), (1, 0), zivi.ThetaGamma(0.01))
    again = sol.resample([0.0, 0.455, 0.5])
    for k, step in enumerate((0, 46, 50)):
        assert again.transformed.lambda_s[k] == sol.transformed.lambda_s[step]
        assert again.residual[k] == sol.residual[step]
    # what did not keep its steps does not invent them
    assert np.all(np.isnan(again.resample([0.2, 0.7]).transformed.lambda_v))


@pytest.mark.parametrize(
    ("asked", "error", "said"),
    [
        ({}, TypeError, "exactly one of t and n"),
        ({"t": [0.0, 1.0], "n": 3}, TypeError, "exactly one of t and n"),
        ({"n": 1}, ValueError, "n must be >= 2, got 1"),
        ({"n": 2.5}, TypeError, "n must be a whole number"),
        ({"t": [1.0, 0.0]}, ValueError, "t must not decrease"),
        ({"t": [[0.0, 1.0]]}, ValueError, r"t must be one-dimensional, got shape \(1, 2\)"),
        ({"t": [0.0, 3.0]}, ValueError, r"within the computed span \[0\.0, 2\.0\]"),
    ],
)
def test_what_cannot_be_given_is_refused(sol, asked, error, said):
    with pytest.raises(error, match=said):
        sol.resample(**asked)


def test_a_dataset_and_a_table_at_other_times(sol):
    dataset = sol.to_xarray(n=201)
    np.testing.assert_allclose(dataset.x.sel(time=0.5), ball(0.5)[0], atol=1e-12)
    np.testing.assert_allclose(dataset.x.values, ball(dataset.time.values)[0], atol=1e-12)
    assert dataset.attrs["rest_time"] == sol.rest_time
    table = sol.to_pandas([0.1, 0.2])
    np.testing.assert_allclose(table.xdot, [-G * 0.1, -G * 0.2], rtol=1e-13)
    assert table.index.tolist() == [0.1, 0.2]
    assert len(sol.to_pandas()) == len(sol.t)


def test_the_fixed_frame_at_any_time_and_in_datasets():
    wall = zivi.HarmonicWall(amplitude=0.05, omega=20.0, offset=0.2)
    sol = zivi.simulate(zivi.ImpactSystem(-G, e=0.6, wall=wall), (0, 1), (0.3, 0))
    times = np.linspace(0, 1, 33)
    w, wdot = 0.2 + 0.05 * np.cos(20 * times), -np.sin(20 * times)
    x, xdot = sol(times)
    np.testing.assert_allclose(sol.fixed(times), (x + w, xdot + wdot), atol=1e-14)
    dataset = sol.to_xarray(times)
    np.testing.assert_allclose(dataset.x_fixed, x + w, atol=1e-14)
    np.testing.assert_allclose(dataset.xdot_fixed, xdot + wdot, atol=1e-14)
    np.testing.assert_allclose(dataset.wall, w, atol=1e-14)
    assert dataset.x_fixed.attrs["units"] == "m"


def test_a_notebook_shows_a_table(sol):
    page = sol._repr_html_()
    assert f"from {sol.rest_time:.9g} s" in page
    assert page.count("<tr>") == 6
    short = zivi.simulate(zivi.ImpactSystem(0.0, e=E), (0, 1), (1, 0))
    assert "<td style='text-align:left'>no</td>" in short._repr_html_()


def test_the_configuration_is_made_when_it_is_asked_for(monkeypatch):
    import zivi.simulation.trajectory as module

    calls = []
    real = module.configuration_of
    monkeypatch.setattr(module, "configuration_of", lambda *a: calls.append(a) or real(*a))
    sol = zivi.simulate(zivi.ImpactSystem(lambda t, x, v: -G, e=E), (0, 1), (1, 0))
    assert not calls
    assert sol.config is sol.config
    assert len(calls) == 1
    assert pickle.loads(pickle.dumps(sol)).config == sol.config


TABLE = zivi.LinearForce(gravity=G, amplitude=14.7, omega=6.28)


def polyline_error(sol):
    """How far lines through the samples are from the motion, as a part of the largest distance."""
    times = np.linspace(sol.t[0], sol.t[-1], 20011)
    return np.max(np.abs(np.interp(times, sol.t, sol.x) - sol(times)[0])) / np.max(sol.x)


@pytest.mark.parametrize(("order", "flights"), [(5, "rk"), (8, "rk"), (8, "series")])
@pytest.mark.parametrize("force", [-G, TABLE, zivi.LinearForce(stiffness=40.0, damping=0.1)])
def test_lines_through_the_samples_draw_the_motion(force, order, flights):
    system = zivi.ImpactSystem(force, e=0.7)
    sol = zivi.simulate(system, (0, 6), (0.5, 0), zivi.SwitchedRK(order=order, flights=flights))
    assert polyline_error(sol) < 0.005
    # what is sampled is the motion, in the order of time, each time once
    assert np.all(np.diff(sol.t) > 0)
    np.testing.assert_array_equal(sol(sol.t), (sol.x, sol.xdot))
    # at each impact the last moment before, and the state after
    after = np.searchsorted(sol.t, sol.resolved_impacts["t"])
    np.testing.assert_array_equal(sol.xdot[after], sol.resolved_impacts["xdot_after"])
    before = sol.resolved_impacts["xdot_before"]
    np.testing.assert_allclose(sol.xdot[after - 1], before, atol=1e-9 * np.max(np.abs(before)))
    assert np.all(sol.x[after - 1] < 1e-12)
    # apexes: at most a touch of velocity between a rise and a fall
    rises = (sol.xdot[:-1] > 1e-9) & (sol.xdot[1:] < -1e-9) & (sol.x[1:] > 1e-12)
    assert not np.any(rises)


def test_steps_only_where_that_is_asked_for():
    ball = zivi.ImpactSystem(-G, e=E)
    drawn = zivi.simulate(ball, (0, 2), (1, 0))
    steps = zivi.simulate(ball, (0, 2), (1, 0), samples="steps")
    assert polyline_error(steps) > 0.1
    assert len(steps.t) < 15 < 30 < len(drawn.t) < 100
    assert set(steps.t) <= set(drawn.t)
    assert (steps.nfev, steps.n_steps) == (drawn.nfev, drawn.n_steps)
    with pytest.raises(ValueError, match="samples must be 'motion' or 'steps', got 'all'"):
        zivi.simulate(ball, (0, 2), (1, 0), samples="all")


def test_a_long_run_is_not_drowned_in_samples():
    force = zivi.LinearForce(stiffness=1, damping=0.1, gravity=-1, amplitude=0.6, omega=0.9)
    oscillator = zivi.ImpactSystem(force, e=0.8)
    sol = zivi.simulate(oscillator, (0, 2e5), (1, 0), zivi.SwitchedRK(rtol=1e-4))
    assert sol.n_steps > 1e5
    assert len(sol.t) < 4 * sol.n_steps
