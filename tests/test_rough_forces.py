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
    assert sol.rest_time == pytest.approx(exact, rel=5e-7)


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
