"""What is reported of a run of fixed steps: between its steps, up to an event, at given times."""

from operator import attrgetter

import numpy as np
import pytest

import zivi

FREE = zivi.ImpactSystem(0.0, e=0.5)
TABLE = zivi.ImpactSystem(
    zivi.LinearForce(gravity=9.81, amplitude=14.715, omega=2 * np.pi, phase=-np.pi / 2), e=0.5
)
METHODS = [zivi.SwitchedRK(), zivi.ThetaGamma(0.3), zivi.ExplicitEuler(0.3), zivi.MoreauJean(0.3)]
IDS = ["SwitchedRK", "ThetaGamma", "ExplicitEuler", "MoreauJean"]


def event(function, direction=0, terminal=False):
    def g(t, x, xdot):
        return function(t, x, xdot)

    g.direction, g.terminal = direction, terminal
    return g


@pytest.mark.parametrize("method", METHODS, ids=IDS)
@pytest.mark.parametrize(("sign", "direction"), [(1, 1), (1, 0), (-1, -1), (-1, 0)])
def test_a_function_that_reaches_zero_and_stays_there_is_an_event(method, sign, direction):
    reaches = event(lambda t, x, xdot: sign * min(t - 1.1, 0.0), direction)
    other_way = event(lambda t, x, xdot: sign * min(t - 1.1, 0.0), -sign)
    sol = zivi.simulate(FREE, (0, 2), (5, 0.5), method, events=[reaches, other_way])
    assert sol.t_events[0] == pytest.approx([1.1], abs=1e-12)
    assert len(sol.t_events[1]) == 0


@pytest.mark.parametrize("method", METHODS[:3], ids=IDS[:3])
def test_the_time_of_a_crossing_within_a_step_is_that_of_the_motion(method):
    sol = zivi.simulate(
        FREE, (0, 2), (1, -1), method, events=[event(lambda t, x, v: v), event(lambda t, x, v: x)]
    )
    # no force: the wall is reached at 1 s; implicit Euler has the speed after the impact in the
    # whole of its step
    exact = 1.1 if isinstance(method, zivi.ThetaGamma) else 1.0
    assert sol.resolved_impacts["t"] == pytest.approx([exact], abs=1e-14)
    assert sol.t_events[0] == pytest.approx([exact], abs=1e-12)
    assert sol.t_events[1] == pytest.approx([exact], abs=1e-12)


def test_a_rest_is_one_until_it_ends():
    whole = zivi.simulate(TABLE, (0, 3), (0.2, 0), zivi.ThetaGamma(1e-3))
    came, left = whole.zeno_times[0], whole.liftoff_times[0]
    for end, rests in [((came + left) / 2, True), (left + 0.01, False), (came - 0.01, False)]:
        stop = event(lambda t, x, v, end=end: t - end, terminal=True)
        sol = zivi.simulate(TABLE, (0, 3), (0.2, 0), zivi.ThetaGamma(1e-3), events=stop)
        assert sol.t[-1] == pytest.approx(end, abs=1e-12)
        assert sol.rest_time == (came if rests else None)
        assert len(sol.liftoff_times) == (end > left)


def test_multipliers_at_given_times_are_those_of_the_step_that_contains_them():
    h = 1e-2
    whole = zivi.simulate(TABLE, (0, 2), (0.2, 0), zivi.ThetaGamma(h))
    k = np.arange(len(whole.t) - 1)
    for part in (0.1, 0.9, 1.0):
        times = whole.t[:-1] + part * np.diff(whole.t)
        sol = zivi.simulate(TABLE, (0, 2), (0.2, 0), zivi.ThetaGamma(h), t_eval=times)
        assert np.array_equal(sol.transformed.lambda_s, whole.transformed.lambda_s[k + 1])
        assert np.array_equal(sol.transformed.lambda_v, whole.transformed.lambda_v[k + 1])
    assert len(set(whole.transformed.lambda_s)) > 2


def test_failed_steps_after_the_end_are_not_told():
    method = zivi.ThetaGamma(1e-2, solver="outer", linearisations=1)
    whole = zivi.simulate(TABLE, (0, 2), (0.2, 0), method)
    assert len(whole.failed_steps) > 1
    middle = int(np.mean(whole.failed_steps[:2]))
    stop = event(lambda t, x, v: t - whole.t[middle] - 1e-3, terminal=True)
    sol = zivi.simulate(TABLE, (0, 2), (0.2, 0), method, events=stop)
    kept = whole.failed_steps[whole.failed_steps <= middle]
    assert 0 < len(kept) < len(whole.failed_steps)
    assert np.array_equal(sol.failed_steps, kept)


def test_penetration_is_shown_between_the_steps_too():
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    sol = zivi.simulate(ball, (0, 1.5), (1, 0), zivi.MoreauJean(1e-2))
    deepest = int(np.argmin(sol.x))
    assert sol.x[deepest] < -1e-4
    x, _ = sol(sol.t[deepest])
    assert x == sol.x[deepest]
    t = sol.t[deepest] + 0.3 * (sol.t[deepest + 1] - sol.t[deepest])
    assert sol(t)[0] == pytest.approx(0.7 * sol.x[deepest] + 0.3 * sol.x[deepest + 1], rel=1e-9)
    at = zivi.simulate(ball, (0, 1.5), (1, 0), zivi.MoreauJean(1e-2), t_eval=[t])
    assert at.x[0] == sol(t)[0] < 0


@pytest.mark.parametrize("method", [zivi.ThetaGamma(1e-2), zivi.MoreauJean(1e-2)])
def test_what_the_force_does_after_a_terminal_event_does_not_matter(method):
    def force(t, x, xdot):
        if t > 0.8:
            raise RuntimeError("after the event")
        return -9.81

    system, stop = zivi.ImpactSystem(force, e=0.5), event(lambda t, x, v: v, terminal=True)
    sol = zivi.simulate(system, (0, 2), (1, 0.5), method, events=stop)
    assert sol.status is zivi.Status.TERMINATED_BY_EVENT
    assert sol.t[-1] == pytest.approx(0.5 / 9.81, abs=1e-2)
    never = event(lambda t, x, v: 1.0, terminal=True)
    with pytest.raises(RuntimeError, match="after the event"):
        zivi.simulate(system, (0, 2), (1, 0.5), method, events=never)


FIXED = pytest.mark.parametrize(
    "method", [zivi.ThetaGamma(1e-2), zivi.ExplicitEuler(1e-2), zivi.MoreauJean(1e-2)], ids=IDS[1:]
)


@FIXED
@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("direction", [0, 1, -1])
@pytest.mark.parametrize("constant", [False, True])
def test_no_step_is_computed_after_that_of_a_terminal_event(method, count, direction, constant):
    asked, looked = [], []

    def force(t, x, xdot):
        asked.append(t)
        return -9.81 - 0.1 * xdot

    def companion(t, x, xdot):
        looked.append(t)
        return 1.0

    def run(terminal, span):
        asked.clear()
        looked.clear()
        stop = event(lambda t, x, v: v, direction, terminal)
        system = zivi.ImpactSystem(-9.81 if constant else force, e=0.8)
        return zivi.simulate(system, span, (0.1, 1), method, events=[stop, companion])

    whole = run(False, (0, 4))
    sol = run(count, (0, 1000))
    end, n = sol.t[-1], len(sol.t) - 1
    assert sol.status is zivi.Status.TERMINATED_BY_EVENT
    assert end == whole.t_events[0][count - 1] < 2
    assert np.array_equal(sol.t_events[0], whole.t_events[0][:count])
    assert np.array_equal(sol.y_events[0], whole.y_events[0][:count])
    for name in (
        "t",
        "x",
        "xdot",
        "transformed.s",
        "transformed.v",
        "transformed.lambda_s",
        "transformed.lambda_v",
    ):
        assert np.array_equal(attrgetter(name)(sol)[:n], attrgetter(name)(whole)[:n])
    assert np.array_equal(
        sol.resolved_impacts, whole.resolved_impacts[whole.resolved_impacts["t"] <= end]
    )
    assert sol.n_steps == n
    # a constant force is known after one evaluation: the looks tell how far the run went
    last = whole.t[np.searchsorted(whole.t, end)]
    assert looked[-1] == max(looked) == last
    if not constant:
        assert len(asked) == sol.nfev < whole.nfev
        assert max(asked) <= last


@FIXED
def test_given_times_up_to_a_terminal_event(method):
    times = np.linspace(0, 3, 61)
    ball, falls = zivi.ImpactSystem(-9.81, e=0.8), event(lambda t, x, v: v, -1, terminal=2)
    whole = zivi.simulate(ball, (0, 3), (0.1, 1), method, times)
    sol = zivi.simulate(ball, (0, 3), (0.1, 1), method, times, events=falls)
    kept = times <= sol.t_events[0][-1]
    assert sol.status is zivi.Status.TERMINATED_BY_EVENT
    assert 5 < np.count_nonzero(kept) < 30
    assert np.array_equal(sol.t, times[kept])
    np.testing.assert_allclose(sol.x, whole.x[kept], rtol=0, atol=1e-13)
    np.testing.assert_allclose(sol.xdot, whole.xdot[kept], rtol=0, atol=1e-13)


def test_a_touchdown_that_rounds_to_the_start_of_its_step():
    sol = zivi.simulate(
        zivi.ImpactSystem(-9.81, e=0.5),
        (0, 0.5),
        (0, 0),
        zivi.ExplicitEuler(1e-2),
        events=event(lambda t, x, v: x, -1),
    )
    rounded = np.isin(sol.resolved_impacts["t"], sol.t) & np.isin(
        sol.resolved_impacts["t"], sol.t[sol.x > 0]
    )
    assert np.any(rounded)
    np.testing.assert_allclose(sol.t_events[0], sol.resolved_impacts["t"], rtol=0, atol=1e-14)


@FIXED
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_event_that_raises_ends_the_run_with_its_step(method, error):
    def raises(t, x, xdot):
        if t > 0.6:
            raise error("late")
        return 1.0

    apex = event(lambda t, x, v: v, -1)
    with pytest.raises(error, match="late") as raised:
        zivi.simulate(
            zivi.ImpactSystem(-9.81, e=0.8), (0, 1000), (0.1, 1), method, events=[apex, raises]
        )
    sol = raised.value.trajectory
    assert sol.status is zivi.Status.RAISED
    assert 0.6 < sol.t[-1] < 0.62
    assert len(sol.t_events[0]) == 2  # those before are kept
