"""Runs of fixed steps that are reported at other times, or end at an event."""

import numpy as np
import pytest

import zivi

METHOD = zivi.ThetaGamma(h=1e-2)


def lifted_at_two(t, x, xdot):
    return 5.0 if t > 2.0 else -9.81


def ends_at(time):
    def event(t, x, xdot):
        return t - time

    event.terminal = True
    return event


@pytest.fixture(scope="module")
def sol():
    return zivi.simulate(zivi.ImpactSystem(lifted_at_two, e=0.5), (0, 3), (1, 0), method=METHOD)


def test_multipliers_are_those_of_the_step_that_contains_the_time(sol):
    middle = 0.5 * (sol.t[:-1] + sol.t[1:])
    for times, first in ((middle, 1), (sol.t, 0)):
        some = zivi.simulate(
            zivi.ImpactSystem(lifted_at_two, e=0.5), (0, 3), (1, 0), method=METHOD, t_eval=times
        )
        for name in ("lambda_s", "lambda_v", "residual"):
            np.testing.assert_array_equal(getattr(some, name), getattr(sol, name)[first:])
    assert np.count_nonzero(np.diff(sol.lambda_s)) > 4


def test_a_rest_that_would_have_ended_later_is_one(sol):
    assert sol.rest_time is None
    assert len(sol.liftoff_times) == 1
    system = zivi.ImpactSystem(lifted_at_two, e=0.5)
    for time, rests in ((1.0, False), (1.7, True), (2.5, False)):
        cut = zivi.simulate(system, (0, 3), (1, 0), method=METHOD, events=ends_at(time))
        assert cut.t[-1] == pytest.approx(time, abs=1e-12)
        assert cut.rest_time == (sol.zeno_times[0] if rests else None)
        np.testing.assert_array_equal(cut.impacts, sol.impacts[sol.impacts["t"] <= time])


def test_failed_steps_end_with_the_run():
    system = zivi.ImpactSystem(-9.81, kappa=0.41)
    method = zivi.ThetaGamma(1e-3, solver="outer", linearisations=1)
    whole = zivi.simulate(system, (0, 4), (1, 6), method=method)
    failed = whole.failed_steps
    assert len(failed) > 1
    time = 0.5 * (whole.t[failed[0]] + whole.t[failed[-1] - 1])
    cut = zivi.simulate(system, (0, 4), (1, 6), method=method, events=ends_at(time))
    np.testing.assert_array_equal(cut.failed_steps, failed[failed <= cut.n_steps])
    assert 0 < len(cut.failed_steps) < len(failed)
