"""SwitchedRK against the stored trajectories of 25 digits, at every tolerance and both orders."""

import functools
import itertools

import numpy as np
import pytest

import event_simulation
import zivi
from references import REFERENCES

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
CASES = [
    pytest.param(*case, id=f"{case[0]}-{case[1]}-{case[2]:g}")
    for case in itertools.product(REFERENCES, (8, 5), TOLERANCES)
]
# rounding of times up to 65 s and of the references' own 17 digits
ROUNDING = 3e-14
# largest errors over the tolerance that were measured: 2.1 and 6.4. Local errors are below the
# tolerance and pile up over some ten steps of the flight that is looked at
STATES = {8: 5.0, 5: 16.0}
# largest errors of times over tolerance and amplification that were measured: 0.3 and 5.1
TIMES = {8: 1.0, 5: 12.0}


def system_of(case):
    return zivi.ImpactSystem(zivi.LinearForce(**case["force"]), e=case["e"])


@functools.cache
def run(name, order, tol):
    case = REFERENCES[name]
    # flights by power series have a test of their own
    method = zivi.SwitchedRK(rtol=tol, atol=tol, order=order, flights="rk")
    span, state = (case["t0"], case["t_end"]), (case["x0"], case["xdot0"])
    return zivi.simulate(system_of(case), span, state, method=method)


def amplification(case):
    r"""How an error of the velocity becomes one of the time of a Zeno point.

    An impact is late by the error over the speed; the rest of the chain takes
    :math:`2 u / (g (1 - e))` after an impact with speed `u`.
    """
    force, e = zivi.LinearForce(**case["force"]), case["e"]
    pulls = [-force(t, 0.0, 0.0) for t in case["zeno"]]
    slowest = min((u for _, u in case["impacts"][:1]), default=1.0) / e
    return 1.0 / slowest + max((2.0 * e / (g * (1.0 - e)) for g in pulls), default=0.0)


def distance(times, others):
    """Largest distance of one of `others` from the nearest of `times`."""
    if not len(others):
        return 0.0
    return np.abs(np.subtract.outer(times, others)).min(axis=0).max()


@pytest.mark.parametrize(("name", "order", "tol"), CASES)
def test_states(name, order, tol):
    sol, case = run(name, order, tol), REFERENCES[name]
    assert sol.success
    states = {float(t): state for t, state in case["samples"].items()}
    states[case["t_end"]] = (case["x_end"], case["xdot_end"])
    bound = STATES[order] * tol + ROUNDING
    for t, state in states.items():
        error = np.abs(sol(t) - state).max()
        assert error < bound, (t, error / tol)
        assert any(state) or not sol(t).any(), "rest is exact"
    assert (sol.x[-1], sol.xdot[-1]) == tuple(sol(case["t_end"]))


@pytest.mark.parametrize(("name", "order", "tol"), CASES)
def test_times_of_events(name, order, tol):
    sol, case = run(name, order, tol), REFERENCES[name]
    assert (len(sol.zeno_times), len(sol.liftoff_times)) == (len(case["zeno"]), len(case["lift"]))
    bound = TIMES[order] * amplification(case) * tol + ROUNDING
    assert distance(sol.zeno_times, case["zeno"]) < bound
    # at rest the past is forgotten: lift-off depends on the force at the wall alone
    assert distance(sol.liftoff_times, case["lift"]) < ROUNDING
    assert (sol.rest_time is not None) == case["at_rest_at_end"]
    assert sol.rest_time is None or sol.rest_time == sol.zeno_times[-1]


@pytest.mark.parametrize(("name", "order", "tol"), CASES)
def test_impacts(name, order, tol):
    """All that the reference lists, extrapolated ones too, and as many as there are."""
    sol, case = run(name, order, tol), REFERENCES[name]
    force = event_simulation.Linear(**case["force"], e=case["e"])
    story = event_simulation.simulate(
        force, (case["t0"], case["t_end"]), (case["x0"], case["xdot0"]), slow=1e-13
    )
    for speed in (1e-1, 1e-4, 1e-12):
        expected = sum(before >= speed for _, before, _ in story.impacts)
        assert len(sol.impacts_down_to(speed)) == expected, speed
    if not case["zeno"]:
        assert len(sol.resolved_impacts) == case["n_impacts"]
    impacts = sol.impacts_down_to(1e-12)
    bound = TIMES[order] * amplification(case) * tol + ROUNDING
    for t, after in case["impacts"]:
        nearest = impacts[np.argmin(np.abs(impacts["t"] - t))]
        assert abs(nearest["t"] - t) < bound
        assert abs(nearest["xdot_after"] - after) < STATES[order] * tol + ROUNDING
        assert nearest["xdot_after"] == pytest.approx(-case["e"] * nearest["xdot_before"], 1e-15)


@pytest.mark.parametrize("name", REFERENCES)
def test_work_grows_slowly_with_the_digits(name):
    """From 4 to 12 digits: order 8 at most 10^(8/8) = 10 times the steps, order 5 10^(8/5) = 40."""
    for order, most in ((8, 10), (5, 40)):
        loose, tight = (run(name, order, tol).n_steps for tol in (1e-4, 1e-12))
        assert loose <= tight <= most * loose


def test_a_wrong_restitution_would_be_seen():
    """Negative control: with e off by 1e-7 the Zeno time is off by far more than the bound."""
    case = REFERENCES["O1_osc_zeno"]
    system = zivi.ImpactSystem(zivi.LinearForce(**case["force"]), e=case["e"] + 1e-7)
    method = zivi.SwitchedRK(rtol=1e-8, atol=1e-8)
    sol = zivi.simulate(system, (0, 20), (1, 0), method=method)
    assert distance(sol.zeno_times, case["zeno"]) > 5 * amplification(case) * 1e-8
