"""The yardsticks themselves: the closed forms satisfy what they claim to solve."""

import math

import pytest

from closed_form import Ball, bouncing_oscillator, rest_then_lift


def second_difference(x, t, d=1e-4):
    return (x(t + d) - 2 * x(t) + x(t - d)) / d**2


def test_ball_flies_bounces_and_rests():
    ball = Ball.of_kappa(1.0, 6.0, kappa=0.41)
    assert ball.zeno == pytest.approx(2.4658466315590443, abs=1e-15)
    for t in (0.3, 1.6, 2.15, 2.35):
        assert second_difference(lambda t: ball.state(t)[0], t) == pytest.approx(-9.81, rel=1e-4)
    for n in range(4):
        t, speed = ball.impact(n)
        assert ball.state(t - 1e-9) == pytest.approx((0.0, -speed), abs=1e-7)
        assert ball.state(t + 1e-9) == pytest.approx((0.0, ball.e * speed), abs=1e-7)
    assert ball.state(3.0) == (0.0, 0.0)
    assert ball.impact(60)[0] == pytest.approx(ball.zeno, abs=1e-15)


def test_lift_off_solves_its_equation():
    def x(t):
        return rest_then_lift(t, g=2.0, c=4.0)

    assert x(0.5) == 0.0
    assert second_difference(x, 1.5) == pytest.approx(-2.0 + 4.0 * 1.5, rel=1e-5)


@pytest.mark.parametrize("z", [0.0, 0.1])
def test_oscillator_solves_its_equation_and_bounces(z):
    def x(t):
        return bouncing_oscillator(t, e=0.5, x0=1.0, damping_ratio=z)

    assert x(0.0) == 1.0
    for t in (0.5, 3.0, 6.0):
        slope = (x(t + 1e-5) - x(t - 1e-5)) / 2e-5
        assert second_difference(x, t) == pytest.approx(-x(t) - 2 * z * slope, abs=1e-4)
    first = (math.pi - math.acos(z)) / math.sqrt(1 - z * z)
    before, after = x(first - 1e-6) / 1e-6, x(first + 1e-6) / 1e-6
    assert after == pytest.approx(0.5 * before, rel=1e-4)
