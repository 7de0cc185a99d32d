"""Dense output of SwitchedRK: the motion between the samples, in flight, in tails and at rest."""

import copy
import pickle
from operator import attrgetter

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import solve_ivp

import event_simulation
import zivi
from closed_form import Ball
from event_simulation import Linear

G = 9.81
BALL = zivi.ImpactSystem(-G, e=0.6)
TABLE = {"gravity": G, "amplitude": 14.715, "omega": 2 * np.pi, "phase": -np.pi / 2}
SPRING = {"stiffness": 3.0, "damping": 0.2, "gravity": 1.0, "amplitude": 2.0, "omega": 1.7}
ORDERS = pytest.mark.parametrize("order", [8, 5])


def simulate(force, e, span, state, tol=1e-9, **more):
    """A run of the Runge-Kutta pair, whose dense output this is about."""
    settings = {name: more.pop(name) for name in ("order", "max_step") if name in more}
    method = zivi.SwitchedRK(rtol=tol, atol=tol, flights="rk", **settings)
    return zivi.simulate(zivi.ImpactSystem(force, e=e), span, state, method=method, **more)


@ORDERS
@pytest.mark.parametrize("tol", [1e-4, 1e-8, 1e-12])
def test_ball_at_any_time(order, tol):
    """A constant force is integrated exactly: what is left is rounding, tails included.

    DOP853 has coefficients up to 50 that cancel: an impact is off by 1e-14 s, and the velocity of
    the next arcs by that times g / e^n.
    """
    rounding = {8: 1e-12, 5: 5e-14}[order]
    sol = simulate(-G, 0.6, (0, 4), (1, 2), tol, order=order)
    ball = Ball(1, 2, e=0.6, g=G)
    times = np.linspace(0, 4, 4001)
    exact = np.array([ball.state(t) for t in times]).T
    impacts = np.array([ball.impact(n)[0] for n in range(60)])
    clear = np.abs(np.subtract.outer(times, impacts)).min(axis=1) > 1e-9
    assert clear.sum() > 3990
    np.testing.assert_allclose(sol(times)[:, clear], exact[:, clear], rtol=0, atol=rounding)
    assert sol.zeno_times[0] == pytest.approx(ball.zeno, abs=rounding)
    assert not sol(times[times > ball.zeno + 1e-12]).any()


@ORDERS
@pytest.mark.parametrize("tol", [1e-4, 1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("force", [TABLE, SPRING], ids=["table", "spring"])
def test_every_phase_of_a_motion(force, tol, order):
    """Flights, tails, rest and flights after lift-off, within 60 tolerances of the closed form.

    Measured: 2 for x, 27 for x'. In a tail the velocity is looked at away from impacts: there it
    jumps within the time error.
    """
    e = 0.5
    span, state = (0.0, 12.0), (0.2, 0.0)
    sol = simulate(zivi.LinearForce(**force), e, span, state, tol, order=order)
    story = event_simulation.simulate(Linear(**force, e=e), span, state, slow=1e-9)
    assert len(sol.zeno_times) == len(story.zeno) >= 2
    events = np.array([t for t, *_ in story.impacts] + story.zeno)
    times = np.unique(np.linspace(*span, 3001))
    tails = np.concatenate([z - np.geomspace(1e-3, 0.3, 300) for z in story.zeno])
    times = np.concatenate([times, tails])
    distances = np.abs(np.subtract.outer(times, events)).min(axis=1)
    times = times[distances > 30 * tol]
    exact = [story.state(t) for t in times]
    known = np.array([state is not None for state in exact])
    assert known.sum() > 2000
    exact = np.array([state for state in exact if state is not None]).T
    errors = np.abs(sol(times[known]) - exact).max(axis=1)
    assert np.all(errors < 60 * tol), errors / tol
    resting = (exact == 0.0).all(axis=0)
    assert resting.sum() > 100
    inside = resting & (distances[distances > 30 * tol][known] > 30 * tol)
    assert not sol(times[known][inside]).any(), "rest is exact"


def test_tails_reach_the_wall_at_every_impact():
    """Also where impacts were extrapolated: x is 0 there, and x' the velocity after it."""
    sol = simulate(zivi.LinearForce(**TABLE), 0.5, (0, 9), (1, 0), 1e-6)
    impacts = sol.impacts_down_to(1e-6)
    assert len(impacts) > len(sol.resolved_impacts) + 10
    x, xdot = sol(impacts["t"])
    assert np.all(x <= 1e-9)
    # the time of an impact is rounded: the arc is that much older
    np.testing.assert_allclose(xdot, impacts["xdot_after"], rtol=1e-6, atol=1e-13)
    before = np.nextafter(impacts["t"], -np.inf)
    listed = np.isin(impacts["t"], sol.resolved_impacts["t"])
    np.testing.assert_allclose(
        sol(before[listed])[1], impacts["xdot_before"][listed], rtol=1e-7, atol=1e-9
    )


@ORDERS
def test_right_continuous_at_impacts(order):
    sol = simulate(-G, 0.6, (0, 4), (1, 2), order=order)
    x, xdot = sol(sol.resolved_impacts["t"])
    np.testing.assert_array_equal(x, 0.0)
    np.testing.assert_array_equal(xdot, sol.resolved_impacts["xdot_after"])
    _, before = sol(np.nextafter(sol.resolved_impacts["t"], -np.inf))
    np.testing.assert_allclose(before, sol.resolved_impacts["xdot_before"], rtol=1e-12)
    for t in (sol.zeno_times[0], 4.0):
        np.testing.assert_array_equal(sol(t), (0.0, 0.0))


@ORDERS
@pytest.mark.parametrize("force", [-G, zivi.LinearForce(**TABLE), zivi.LinearForce(**SPRING)])
def test_samples_and_dense_output_agree(force, order):
    sol = simulate(force, 0.5, (0, 9), (0.4, 1), order=order)
    np.testing.assert_allclose(sol(sol.t)[0], sol.x, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(sol(sol.t)[1], sol.xdot, rtol=1e-12, atol=1e-13)


@given(
    times=st.lists(st.floats(0, 9), min_size=1, max_size=30, unique=True).map(sorted),
    order=st.sampled_from([8, 5]),
    dense=st.booleans(),
)
def test_reported_times(times, order, dense):
    """t_eval is kept to the last bit, the states are those of sol(t), the run is the same."""
    force = zivi.LinearForce(**TABLE)
    full = simulate(force, 0.5, (0, 9), (0.4, 1), order=order)
    some = simulate(force, 0.5, (0, 9), (0.4, 1), order=order, t_eval=times, dense_output=dense)
    np.testing.assert_array_equal(some.t, times)
    np.testing.assert_array_equal((some.x, some.xdot), full(times))
    for name in ("impacts", "zeno_times", "liftoff_times"):
        np.testing.assert_array_equal(getattr(some, name), getattr(full, name))
    assert (some.n_steps, some.rest_time, some.status) == (full.n_steps, full.rest_time, 0)
    np.testing.assert_allclose(np.abs(some.transformed.s), some.x, rtol=1e-14)
    x, xdot = zivi.project(some.transformed.s, some.transformed.v, e=0.5)
    np.testing.assert_allclose(x, some.x, rtol=1e-14)
    np.testing.assert_allclose(xdot, some.xdot, rtol=1e-13, atol=1e-300)


@ORDERS
@pytest.mark.parametrize("tol", [1e-5, 1e-9])
def test_as_scipy_where_nothing_is_hit(tol, order):
    """Both within a few tolerances of a run of SciPy that is far more accurate."""

    def force(t, x, xdot):
        return -4.0 * (x - 5.0) - 0.3 * xdot**3 + np.sin(2 * t)

    def slope(t, y):
        return y[1], force(t, *y)

    sol = simulate(force, 0.5, (0, 8), (6, 0), tol, order=order)
    assert len(sol.resolved_impacts) == 0
    times = np.linspace(0, 8, 500)
    exact = solve_ivp(
        slope, (0, 8), (6, 0), method="DOP853", rtol=1e-13, atol=1e-13, dense_output=True
    )
    scipy = solve_ivp(
        slope,
        (0, 8),
        (6, 0),
        method={8: "DOP853", 5: "RK45"}[order],
        rtol=tol,
        atol=tol,
        dense_output=True,
    )
    ours = np.abs(sol(times) - exact.sol(times)).max()
    theirs = np.abs(scipy.sol(times) - exact.sol(times)).max()
    assert ours < 30 * tol
    assert ours < 10 * theirs
    # their error norm is a mean, ours a maximum, and they evaluate for dense output step by step
    assert sol.nfev < 2 * scipy.nfev


def test_shapes():
    sol = zivi.simulate(BALL, (0, 3), (1, 0))
    assert sol(0.1).shape == (2,)
    assert sol(np.float32(0.1)).shape == (2,)
    assert sol([]).shape == (2, 0)
    assert sol([0.1, 0.2, 0.3]).shape == (2, 3)
    assert sol(np.full((4, 5), 0.1)).shape == (2, 4, 5)
    # in any order
    np.testing.assert_array_equal(sol([0.3, 0.1]), sol([0.1, 0.3])[:, ::-1])


@pytest.mark.parametrize("t", [-1e-9, 3.0000001, np.nan, np.inf, [0.1, 4.0]])
def test_outside_of_the_span(t):
    sol = zivi.simulate(BALL, (0, 3), (1, 0))
    with pytest.raises(ValueError, match=r"\bt must lie within the computed span"):
        sol(t)


def test_only_as_far_as_the_run_came():
    sol = zivi.simulate(BALL, (0, 3), (1, 0), method=zivi.SwitchedRK(max_steps=1, flights="rk"))
    assert sol.status == zivi.Status.STEP_BUDGET
    assert 0 < sol.t[-1] < 0.4
    assert sol(sol.t[-1])[0] == pytest.approx(sol.x[-1], abs=1e-14)
    with pytest.raises(ValueError, match="computed span"):
        sol(sol.t[-1] + 1e-3)


@ORDERS
def test_without_dense_output(order):
    """The same samples and events with fewer evaluations; impacts can still be listed."""
    force, span, state = zivi.LinearForce(**TABLE), (0, 9), (0.4, 1)
    full = simulate(force, 0.5, span, state, order=order, samples="steps")
    bare = simulate(force, 0.5, span, state, order=order, dense_output=False)
    for name in (
        "t",
        "x",
        "xdot",
        "transformed.s",
        "transformed.v",
        "impacts",
        "zeno_times",
        "liftoff_times",
    ):
        np.testing.assert_array_equal(attrgetter(name)(bare), attrgetter(name)(full))
    assert bare.nfev < full.nfev if order == 8 else bare.nfev <= full.nfev
    np.testing.assert_array_equal(bare.impacts_down_to(1e-6), full.impacts_down_to(1e-6))
    with pytest.raises(ValueError, match="dense_output=True"):
        bare(0.5)


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda sol: pickle.loads(pickle.dumps(sol))]
)
@pytest.mark.parametrize("dense", [True, False])
def test_a_copy_is_the_run(copied, dense):
    """Samples, events, tails and the motion between the samples."""
    force = zivi.LinearForce(**TABLE)
    watch = lambda t, x, xdot: xdot  # noqa: E731
    sol = simulate(force, 0.5, (0, 9), (0.4, 1), dense_output=dense, events=[watch])
    other = copied(sol)
    for name in (
        "t",
        "x",
        "xdot",
        "transformed.s",
        "transformed.v",
        "impacts",
        "zeno_times",
        "liftoff_times",
    ):
        np.testing.assert_array_equal(attrgetter(name)(other), attrgetter(name)(sol))
    np.testing.assert_array_equal(other.t_events[0], sol.t_events[0])
    assert (other.config, other.status, repr(other)) == (sol.config, sol.status, repr(sol))
    np.testing.assert_array_equal(other.impacts_down_to(1e-8), sol.impacts_down_to(1e-8))
    if dense:
        times = np.linspace(0, 9, 301)
        np.testing.assert_array_equal(other(times), sol(times))
    else:
        with pytest.raises(ValueError, match="dense_output=True"):
            other(0.5)


def test_a_span_that_ends_in_a_tail():
    """The state there is that of the arc, not of the rest that follows."""
    ball = Ball(1, 0, e=0.6, g=G)
    for n in (5, 12, 20):
        (t, _), (later, _) = ball.impact(n), ball.impact(n + 1)
        end = t + 0.3 * (later - t)
        sol = zivi.simulate(BALL, (0, end), (1, 0))
        assert sol.rest_time is None
        assert len(sol.zeno_times) == 0
        assert (sol.x[-1], sol.xdot[-1]) == pytest.approx(ball.state(end), abs=1e-12)
        assert len(sol.impacts_down_to(1e-9)) == n + 1


@pytest.mark.parametrize("flights", ["series", "rk"])
def test_an_apex_is_one_sample(flights):
    # flights that a sample halves: the apex is that sample but for rounding
    for k in range(20):
        g, v, e = 1 + k / 8, 1 + k / 16, 0.5
        ball = zivi.ImpactSystem(-g, e=e)
        sol = zivi.simulate(ball, (0, 3.9 * v / g), (0, v), method=zivi.SwitchedRK(flights=flights))
        speeds = v * e ** np.arange(4)
        apexes = 2 / g * (np.cumsum(speeds) - speeds) + speeds / g
        near = np.abs(np.subtract.outer(apexes, sol.t)) < 1e-12
        assert near.sum(axis=1).tolist() == [1] * 4, k
