"""Fitted order of implicit Euler in flight, through impacts and (less than one) at Zeno points."""

import numpy as np
import pytest

import zivi
from closed_form import Ball
from scheme import fitted_order, jittered

STEPS = (1e-2, 1e-3, 1e-4, 1e-5)
BALL = Ball.of_kappa(1.0, 6.0, kappa=0.41)


def distance_error(t, h):
    """Root mean square error of the distance at `t`; every run ends exactly there."""
    system = zivi.ImpactSystem(-9.81, kappa=0.41)
    exact, _ = BALL.state(t)
    ends = [
        zivi.simulate(system, (0, t), (1, 6), method=zivi.ThetaGamma(h=step)).x[-1]
        for step in jittered(h)
    ]
    return np.sqrt(np.mean((np.array(ends) - exact) ** 2))


@pytest.mark.parametrize(
    ("t", "impacts", "slack"),
    [(0.5, 0, 0.01), (1.0, 0, 0.05), (1.5, 1, 0.1), (2.1, 2, 0.15)],
    ids=["before the apex", "after the apex", "after one impact", "after two impacts"],
)
def test_first_order_in_flight(t, impacts, slack):
    """The slack is the scatter of 7 runs, which grows with every switch passed."""
    assert BALL.impacts_until(t) == impacts
    errors = [distance_error(t, h) for h in STEPS]
    assert fitted_order(STEPS, errors) == pytest.approx(1.0, abs=slack)


def test_midpoint_in_flight_is_exact_and_the_apex_makes_it_first_order():
    """theta = 1/2 integrates a constant force exactly until v changes sign."""
    system = zivi.ImpactSystem(-9.81, kappa=0.41)

    def end_error(t, h):
        method = zivi.ThetaGamma(h=h, theta=0.5)
        return abs(zivi.simulate(system, (0, t), (1, 6), method=method).x[-1] - BALL.state(t)[0])

    assert max(end_error(0.5, h) for h in (1e-2, 1e-3)) < 1e-13
    means = [np.mean([end_error(1.0, step) for step in jittered(h)]) for h in (1e-2, 1e-3, 1e-4)]
    assert fitted_order((1e-2, 1e-3, 1e-4), means) == pytest.approx(1.0, abs=0.15)


def test_midpoint_is_second_order_where_no_sign_switches():
    """A spring that is held away from the wall, up to its first turning point."""
    spring = zivi.LinearForce(stiffness=4.0, gravity=-8.0, damping=0.2)  # equilibrium at x = 2
    system = zivi.ImpactSystem(spring, e=0.5)
    reference = zivi.simulate(system, (0, 1), (1, 0.5), method=zivi.ThetaGamma(h=1e-5, theta=0.5))
    steps = (2e-2, 1e-2, 5e-3, 2.5e-3)

    def errors(theta):
        methods = [zivi.ThetaGamma(h=h, theta=theta) for h in steps]
        ends = [zivi.simulate(system, (0, 1), (1, 0.5), method=m).x[-1] for m in methods]
        return np.abs(np.array(ends) - reference.x[-1])

    assert fitted_order(steps, errors(0.5)) == pytest.approx(2.0, abs=0.05)
    assert fitted_order(steps, errors(1.0)) == pytest.approx(1.0, abs=0.05)


class ZenoError:
    """Mean over step sizes about h of (reported - exact Zeno time)/h, and its standard error.

    A ball dropped from 1 m. The error behaves like -h (a + b log10(1/h)).
    """

    def __init__(self, e, steps, runs=15):
        self.steps = np.array(steps)
        ball = Ball(1.0, 0.0, e=e)
        system = zivi.ImpactSystem(-9.81, e=e)
        scaled = [
            [(self.reported(system, ball, step) - ball.zeno) / step for step in jittered(h, runs)]
            for h in steps
        ]
        self.mean = np.mean(scaled, axis=1)
        self.sampling = np.std(scaled, axis=1) / np.sqrt(runs)

    @staticmethod
    def reported(system, ball, h):
        span = (0, 1.01 * ball.zeno + 30 * h)
        sol = zivi.simulate(system, span, (1, 0), method=zivi.ThetaGamma(h=h))
        assert sol.zeno_times.tolist() == [sol.rest_time]
        return sol.rest_time

    def per_decade(self):
        """The slope b: by how much error/h grows in each decade of h."""
        return -np.polyfit(np.log10(1 / self.steps), self.mean, 1)[0]

    def order(self):
        return fitted_order(self.steps, -self.mean * self.steps)


# e: (step sizes, mean error/h measured by an independent implementation, b)
MEASURED = {
    0.2: ((1e-2, 1e-3, 1e-4, 1e-5), (-1.5, -4.4, -6.3, -7.5), 2),
    0.418: ((1e-2, 1e-3, 1e-4, 1e-5), (-9.9, -20.2, -27.3, -37.0), 9),
    0.7: ((1e-3, 1e-4, 1e-5), (-120.5, -187.9, -251.3), 65),
    0.9: ((1e-3, 1e-4, 1e-5), (-1078, -1834, -2654), 790),
}


@pytest.mark.parametrize("e", MEASURED)
def test_the_zeno_time_is_reached_like_h_log_h(e):
    """error/h grows by a constant in every decade: the error is not O(h).

    The measured means scatter as ours do: about four standard errors are allowed, and 5 %.
    """
    steps, expected, b = MEASURED[e]
    error = ZenoError(e, steps)
    tolerance = 4 * error.sampling + 0.05 * np.abs(expected)
    assert np.all(np.abs(error.mean - expected) < tolerance), (error.mean, error.sampling)
    assert error.per_decade() == pytest.approx(b, rel=0.15)
    growth = -np.diff(error.mean)
    assert np.all(growth > 0.5 * b), "error/h stopped growing"
    assert 0.75 < error.order() < 0.9


def test_the_apparent_order_at_the_zeno_point():
    assert ZenoError(0.418, STEPS).order() == pytest.approx(0.84, abs=0.04)
