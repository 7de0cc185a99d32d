"""Forces that jump, end at the wall, or have declared breaks."""

import math

import numpy as np
import pytest

import zivi

METHODS = [zivi.SwitchedRK(rtol=1e-9, atol=1e-12, order=order) for order in (5, 8)]


def zeno_time_under_two_pulls(low, high, c, e, x0):
    """From rest at ``x0 > c``, under the pull `high` above `c` and `low` below, by its arcs."""
    fall = math.sqrt(2 * (x0 - c) / high)
    through = high * fall
    impact = math.hypot(through, math.sqrt(2 * low * c))
    t, u = fall + (impact - through) / low, e * impact
    while u * u > 2 * low * c:
        through = math.sqrt(u * u - 2 * low * c)
        t += 2 * (u - through) / low + 2 * through / high
        u *= e
    return t + 2 * u / (low * (1 - e))


@pytest.mark.parametrize("method", METHODS, ids=["5", "8"])
@pytest.mark.parametrize(
    "case",
    [
        (1.0, 9.81, 0.1, 0.8, 1.0),  # the step after an impact was the whole arc
        # an apex 0.2 % and 0.8 % above the jump, in the second step of an arc
        (0.675053143006, 7.567264624990, 0.233464033855, 0.778722586401, 0.632375605155),
        (1.590242916730, 4.324276372072, 1.640081601898, 0.684961999814, 3.797546186755),
    ],
)
def test_a_force_that_jumps_in_the_position_is_not_overlooked(method, case):
    low, high, c, e, x0 = case
    system = zivi.ImpactSystem(lambda t, x, v: -high if x > c else -low, e=e)
    exact = zeno_time_under_two_pulls(*case)
    sol = zivi.simulate(system, (0, 2 * exact), (x0, 0), method)
    # each passage of the jump costs some tolerances; an apex that is overlooked, millions
    assert sol.rest_time == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("method", METHODS, ids=["5", "8"])
@pytest.mark.parametrize("offset", [0.0, 1e5, 1e7])
def test_a_force_that_jumps_far_from_the_origin_of_time(method, offset):
    jump = offset + 0.30001
    system = zivi.ImpactSystem(lambda t, x, v: -1.0 if t < jump else 3.0, e=0.5)
    sol = zivi.simulate(system, (offset, offset + 1), (2, 0), method)
    d = jump - offset
    exact = 2 - d * d / 2 - d * (1 - d) + 1.5 * (1 - d) ** 2
    assert sol.success
    assert sol.x[-1] == pytest.approx(exact, abs=2e-8 + 4 * np.spacing(offset))


def below_root(t, x, xdot):
    return -9.81 - math.sqrt(x)  # ValueError behind the wall


def below_power(t, x, xdot):
    return -9.81 - x**1.5  # complex behind the wall: a TypeError


def below_nan(t, x, xdot):
    return -9.81 - float(np.sqrt(x)) if x >= 0 else math.nan


@pytest.mark.parametrize("force", [below_root, below_power, below_nan])
def test_a_force_that_ends_at_the_wall_is_asked_there(force):
    system = zivi.ImpactSystem(force, e=0.5)
    extended = zivi.ImpactSystem(lambda t, x, v: force(t, max(x, 0.0), v), e=0.5)
    sol = zivi.simulate(system, (0, 2), (1, 0))
    exact = zivi.simulate(extended, (0, 2), (1, 0), zivi.SwitchedRK(rtol=1e-12, atol=1e-15))
    assert sol.rest_time == pytest.approx(exact.rest_time, abs=2e-6)
    # a scheme that penetrates
    assert zivi.simulate(system, (0, 2), (1, 0), zivi.MoreauJean(1e-2)).success


def test_an_error_at_the_wall_and_an_interruption_behind_it_end_the_run():
    def broken(t, x, xdot):
        return -9.81 / (0.0 if x <= 0.0 else 1.0)

    with pytest.raises(ZeroDivisionError):
        zivi.simulate(zivi.ImpactSystem(broken, e=0.5), (0, 2), (1, 0))

    def interrupted(t, x, xdot):
        if x < 0.0:
            raise KeyboardInterrupt
        return -9.81

    with pytest.raises(KeyboardInterrupt):
        zivi.simulate(zivi.ImpactSystem(interrupted, e=0.5), (0, 2), (1, 0))


def held(controls, h, x, v):
    """Return the end of the elastic motion under controls held for `h` each, by its parabolas."""
    for a in controls:
        left = h
        while left > 0.0:
            root = v * v - 2 * a * x
            # the first positive root of x + v t + a t^2/2
            tau = -2 * x / (v - math.sqrt(root)) if root > 0 and v - math.sqrt(root) < 0 else left
            if x == 0.0 and v > 0:
                tau = -2 * v / a if a < 0 else left
            tau = min(tau, left)
            x, v, left = max(x + v * tau + a * tau * tau / 2, 0.0), v + a * tau, left - tau
            if left > 0.0:
                x, v = 0.0, -v
    return x, v


@pytest.mark.parametrize("method", METHODS, ids=["5", "8"])
def test_declared_breaks_make_a_held_input_cheap_and_exact(method):
    h, n = 0.1, 60
    controls = np.random.default_rng(5).uniform(-15, 5, n)
    asked = []

    def force(t, x, v):
        asked.append(t)
        return controls[min(int(t / h), n - 1)]

    system = zivi.ImpactSystem(force, e=1.0)
    stops = np.arange(n + 1) * h
    sol = zivi.simulate(system, (0, n * h), (1, 0), method, tstops=stops)
    x, v = held(controls, h, 1.0, 0.0)
    assert sol.success
    assert len(sol.resolved_impacts) > 3
    assert sol.x[-1] == pytest.approx(x, abs=1e-9)
    assert sol.xdot[-1] == pytest.approx(v, abs=1e-9)
    assert sol.nfev == len(asked) < 45 * n  # about 370 a jump without
    assert set(stops[1:-1]) <= set(sol.t)
    assert not set(stops[1:]) & set(asked)  # on either side, never between


def test_declared_breaks_are_seen_at_rest_and_in_an_accumulation():
    pulse = zivi.ImpactSystem(lambda t, x, v: 40.0 if 5 <= t < 5.1 else -9.81, e=0.5)
    sol = zivi.simulate(pulse, (0, 12), (1, 0), tstops=[5.1, 5.0, 77.0])
    # pushed up to .2 m and 4 m/s; from there a ball
    v = math.sqrt(16 + 2 * 9.81 * 0.2)
    landing = 5.1 + (4 + v) / 9.81
    assert sol.liftoff_times == pytest.approx([5.0], abs=1e-14)
    assert sol.rest_time == pytest.approx(landing + 2 * 0.5 * v / 9.81 / 0.5, abs=1e-6)
    # the pull grows while the ball accumulates towards 8.58 s: each part by its arcs
    step = zivi.ImpactSystem(lambda t, x, v: -9.81 if t < 3 else -30.0, e=0.9)
    sol = zivi.simulate(step, (0, 12), (1, 0), tstops=[3])
    t, u = math.sqrt(2 / 9.81), 0.9 * math.sqrt(2 * 9.81)
    while t + 2 * u / 9.81 < 3:
        t, u = t + 2 * u / 9.81, 0.9 * u
    x, v = u * (3 - t) - 9.81 * (3 - t) ** 2 / 2, u - 9.81 * (3 - t)
    w = math.sqrt(v * v + 60 * x)
    assert sol.rest_time == pytest.approx(3 + (v + w) / 30 + 2 * 0.9 * w / 30 / 0.1, abs=4e-6)


def test_declared_breaks_need_error_control_and_finite_times():
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    for method in (zivi.ThetaGamma(0.1), zivi.MoreauJean(0.1), zivi.ExplicitEuler(0.1)):
        with pytest.raises(ValueError, match="tstops is not supported by"):
            zivi.simulate(ball, (0, 1), (1, 0), method, tstops=[0.5])
    for bad in ([math.nan], [math.inf], [[0.5]], ["a"]):
        with pytest.raises((ValueError, TypeError), match="tstops must"):
            zivi.simulate(ball, (0, 1), (1, 0), tstops=bad)
    assert zivi.simulate(ball, (0, 1), (1, 0), tstops=[0.5, 0.5, -1.0, 0.0, 1.0, 2.0]).success
