"""The bouncing ball: exact rest behind the Zeno point, its events, and lift-off."""

import ctypes

import numpy as np
import pytest

import zivi
from closed_form import Ball, bouncing_oscillator, rest_then_lift

KAPPA, START = 0.41, (1.0, 6.0)
EXACT = Ball.of_kappa(*START, kappa=KAPPA)


def drop(h, *, kappa=KAPPA, start=START, t1=4.0, **settings):
    ball = zivi.ImpactSystem(-9.81, kappa=kappa)
    return zivi.simulate(ball, (0, t1), start, method=zivi.ThetaGamma(h=h, **settings))


def at_rest_exactly(sol):
    """Everything is zero, to the last bit, from the rest time to the end of the run."""
    if sol.rest_time is None:
        return False
    resting = sol.t >= sol.rest_time
    return not any(
        np.any(a[resting]) for a in (sol.x, sol.xdot, sol.transformed.s, sol.transformed.v)
    )


@pytest.mark.parametrize(("h", "rest"), [(1e-2, 2.34), (1e-3, 2.444), (1e-4, 2.4626)])
def test_rest_of_the_papers_ball(h, rest):
    sol = drop(h)
    assert sol.success
    assert sol.rest_time == pytest.approx(rest, abs=1e-9)
    assert at_rest_exactly(sol)
    resting = sol.t >= sol.rest_time
    assert np.count_nonzero(resting) == pytest.approx((4.0 - rest) / h + 1, abs=1.5)
    assert np.all(np.abs(sol.transformed.lambda_s[resting]) < 1)
    assert sol.x[~resting].min() >= 0
    assert sol.x[np.flatnonzero(resting)[0] - 1] >= 0
    assert sol.transformed.v[np.flatnonzero(resting)[0] - 1] != 0, (
        "rest is reported one sample late"
    )


def test_rest_for_random_step_sizes():
    rng = np.random.default_rng(1)
    steps = 10 ** rng.uniform(-4, np.log10(0.2), 200)
    sols = [drop(h) for h in steps]
    assert all(at_rest_exactly(sol) for sol in sols)
    assert all(np.all(np.abs(sol.transformed.lambda_s[sol.t >= sol.rest_time]) < 1) for sol in sols)


def test_rest_for_random_balls():
    rng = np.random.default_rng(2)
    for _ in range(200):
        kappa, x0, xdot0 = rng.uniform(0.05, 0.95), rng.uniform(0, 5), rng.uniform(-10, 10)
        ball = Ball.of_kappa(x0, xdot0, kappa=kappa)
        h = ball.zeno * 10 ** rng.uniform(-4, -1)
        sol = drop(h, kappa=kappa, start=(x0, xdot0), t1=1.5 * ball.zeno)
        assert at_rest_exactly(sol), (kappa, x0, xdot0, h)
        assert np.all(np.abs(sol.transformed.lambda_s[sol.t >= sol.rest_time]) < 1)


def test_the_midpoint_member_never_rests():
    """Negative control: with theta = 1/2 the same ball chatters and is never at rest."""
    sol = drop(1e-3, theta=0.5, gamma=0.5)
    assert sol.success
    assert sol.rest_time is None
    assert not np.any((sol.transformed.s[1:] == 0) & (sol.transformed.v[1:] == 0))


def test_the_explicit_scheme_chatters():
    ball = zivi.ImpactSystem(-9.81, kappa=KAPPA)
    sol = zivi.simulate(ball, (0, 4), START, method=zivi.ExplicitEuler(h=1e-3))
    late = sol.t > 3.5
    assert sol.success
    assert sol.rest_time is None
    assert 1e-4 < np.abs(sol.transformed.v[late]).max() < 1


@pytest.mark.parametrize("h", [1e-2, 1e-3, 1e-4])
def test_impacts_obey_restitution_and_the_closed_form(h):
    """First order: the first three differ by at most 8 h and 50 h (measured) from the exact."""
    sol = drop(h)
    before, after = sol.resolved_impacts["xdot_before"], sol.resolved_impacts["xdot_after"]
    assert np.all(before < 0)
    np.testing.assert_allclose(after, -EXACT.e * before, rtol=1e-14)
    assert np.all(np.diff(sol.resolved_impacts["t"]) > 0)
    for n, t in enumerate(sol.resolved_impacts["t"][:3]):
        exact_t, exact_speed = EXACT.impact(n)
        assert abs(t - exact_t) < 10 * h
        assert abs(before[n] + exact_speed) < 60 * h


def test_zeno_rest_and_lift_off_times_agree():
    sol = drop(1e-3)
    assert sol.zeno_times.tolist() == [sol.rest_time]
    assert sol.liftoff_times.size == 0
    assert sol.resolved_impacts["t"].max() <= sol.rest_time


def test_rest_from_the_start_is_no_zeno_point():
    sol = drop(1e-3, start=(0, 0), t1=1.0)
    assert sol.rest_time == 0.0
    assert (sol.zeno_times.size, len(sol.resolved_impacts)) == (0, 0)
    assert at_rest_exactly(sol)


def test_a_run_that_ends_in_flight_is_not_at_rest():
    sol = drop(1e-3, t1=2.0)
    assert sol.rest_time is None
    assert sol.zeno_times.size == 0
    assert len(sol.resolved_impacts) == 1


def test_the_first_impact_is_counted_when_it_is_the_start():
    sol = drop(1e-3, start=(0.0, -2.0), t1=0.1)
    first = sol.resolved_impacts[0]
    assert first["t"] == 0.0
    assert first["xdot_before"] == pytest.approx(-2.0, rel=1e-15)
    assert sol.xdot[0] == pytest.approx(first["xdot_after"], rel=1e-15)
    assert first["xdot_after"] == pytest.approx(2.0 * EXACT.e, rel=1e-15)


def lifting(kind, g, c):
    """The law f = -g + c t (for one slow cosine: its value up to c t^3 / 10^6)."""
    if kind == "callable":
        return lambda t, x, xdot: -g + c * t
    if kind == "compiled":
        signature = ctypes.CFUNCTYPE(ctypes.c_double, *[ctypes.c_double] * 3)
        return signature(lambda t, x, xdot: -g + c * t)
    slow = 1e-3
    return zivi.LinearForce(gravity=g, amplitude=c / slow, omega=slow, phase=-np.pi / 2)


@pytest.mark.parametrize("kind", ["callable", "compiled", "linear"])
@pytest.mark.parametrize("h", [3e-2, 1e-2, 1e-3, 7e-5])
def test_lift_off_from_rest(kind, h):
    g, c = 2.0, 4.0
    system = zivi.ImpactSystem(lifting(kind, g, c), kappa=KAPPA)
    sol = zivi.simulate(system, (0, 1.5), (0, 0), method=zivi.ThetaGamma(h=h))
    assert sol.liftoff_times.size == 1
    assert abs(sol.liftoff_times[0] - g / c) <= h
    assert sol.rest_time is None
    assert len(sol.resolved_impacts) == 0
    # implicit Euler leads by h/2 and the lift-off by at most one step
    exact = np.array([rest_then_lift(t, g=g, c=c) for t in sol.t])
    slope = c / 2 * np.maximum(sol.t - g / c + 2 * h, 0) ** 2
    assert np.all(np.abs(sol.x - exact) <= 2 * h * slope + 1e-6)
    assert sol.x[-1] > 0.5


def test_the_mass_never_sticks_under_a_force_away_from_the_wall():
    rng = np.random.default_rng(3)
    for _ in range(100):
        pull, kappa, h = 10 ** rng.uniform(-6, 6), rng.uniform(0.02, 0.98), 10 ** rng.uniform(-4, 0)
        system = zivi.ImpactSystem(pull, kappa=kappa)
        sol = zivi.simulate(system, (0, 20 * h), (0, 0), method=zivi.ThetaGamma(h=h))
        assert sol.liftoff_times.tolist() == [0.0]
        assert np.all(sol.x[1:] > 0)
        exact = 0.5 * pull * sol.t**2
        np.testing.assert_allclose(sol.x, exact + 0.5 * pull * h * sol.t, rtol=1e-12)


def test_rest_then_lift_off_then_rest():
    table = zivi.LinearForce(gravity=9.81, amplitude=14.715, omega=2 * np.pi, phase=-np.pi / 2)
    system = zivi.ImpactSystem(table, e=0.5)
    sol = zivi.simulate(system, (0, 5), (0.2, 0), method=zivi.ThetaGamma(h=1e-3))
    assert sol.zeno_times.size == 5
    assert sol.liftoff_times.size == 4
    order = np.sort(np.concatenate([sol.zeno_times, sol.liftoff_times]))
    np.testing.assert_array_equal(order[0::2], sol.zeno_times)
    assert sol.rest_time == sol.zeno_times[-1]
    for rest, lift in zip(sol.zeno_times, sol.liftoff_times, strict=False):
        still = (sol.t >= rest) & (sol.t <= lift)
        assert not np.any(sol.x[still])
        assert np.any(sol.x[~still & (sol.t > lift)])


@pytest.mark.parametrize("e", [0.3, 0.7, 0.9])
@pytest.mark.parametrize("z", [0.0, 0.05])
@pytest.mark.parametrize("h", [3e-2, 1e-2, 1e-3])
def test_an_oscillator_on_its_wall_has_no_zeno_point(h, z, e):
    """Flights of equal length for ever: impacts are counted and timed, and rest is never reported.

    The peaks fall to e^13 or 1e-7, far above what is lost to the tolerance 1e-12 of the force.
    """
    spring = zivi.LinearForce(stiffness=1.0, damping=2 * z)
    system = zivi.ImpactSystem(spring, e=e)
    sol = zivi.simulate(system, (0, 40), (1, 0), method=zivi.ThetaGamma(h=h))
    flight = np.pi / np.sqrt(1 - z * z)
    first = np.pi / 2 if z == 0 else (np.pi - np.arccos(z)) / np.sqrt(1 - z * z)
    assert sol.rest_time is None
    assert sol.zeno_times.size == 0
    assert not np.any((sol.transformed.s == 0) & (sol.transformed.v == 0))
    assert len(sol.resolved_impacts) == 1 + (40 - first) // flight
    np.testing.assert_allclose(np.diff(sol.resolved_impacts["t"]), flight, atol=2 * h)
    exact = np.array([bouncing_oscillator(t, e=e, x0=1.0, damping_ratio=z) for t in sol.t])
    assert np.abs(sol.x - exact).max() < 6 * h
