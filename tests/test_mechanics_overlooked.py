"""Features of forces and surfaces that lie between the stages of a step."""

import math

import numpy as np
import pytest

import zivi
from test_rough_forces import zeno_time_under_two_pulls

ORDERS = [5, 8]


@pytest.mark.parametrize("order", ORDERS)
def test_a_force_that_jumps_in_a_coordinate_is_not_overlooked(order):
    # the second arc has its apex little above the jump, and is one step
    low, high, c, e, x0 = 1.0, 9.81, 0.31, 0.8, 1.0
    system = zivi.MechanicalSystem(
        mass=1.0,
        force=lambda _t, q, _w: [-high if q[0] > c else -low],
        gaps=[zivi.LinearGap([1])],
        e=e,
    )
    exact = zeno_time_under_two_pulls(low, high, c, e, x0)
    method = zivi.SwitchedRK(rtol=1e-9, atol=1e-9, order=order)
    sol = zivi.simulate(system, (0, 2 * exact), ([x0], [0.0]), method)
    assert sol.zeno["t"] == pytest.approx([exact], rel=1e-5)


@pytest.mark.parametrize("order", ORDERS)
def test_a_step_of_the_floor_is_not_overlooked(order):
    # a ball of constant speed falls on a floor that has a step, as wide as 1/400 of a flight
    height, k, at = 0.2, 1000.0, 0.5

    def floor(x):
        return height * (1 + math.tanh(k * (x - at))) / 2

    def slope(x):
        return height * k * (1 - math.tanh(k * (x - at)) ** 2) / 2

    def value(_t, q):
        return q[1] - floor(q[0])

    def gradient(_t, q):
        return [-slope(q[0]), 1.0]

    def curvature(_t, q, w):
        return 2 * k * math.tanh(k * (q[0] - at)) * slope(q[0]) * w[0] ** 2

    system = zivi.MechanicalSystem(
        mass=np.eye(2),
        force=[0, -9.81],
        gaps=[zivi.Gap(value, gradient, curvature, name="floor")],
        e=0.5,
    )
    method = zivi.SwitchedRK(rtol=1e-6, atol=1e-6, order=order)
    for speed in (1.7, 2.3):
        sol = zivi.simulate(system, (0, 2), ([0.0, 0.5], [speed, 0.0]), method)
        assert sol.success
        q = sol(np.linspace(0, 2, 101))[0]
        assert all(value(0, point) > -1e-6 for point in q)
        assert max(abs(value(0, a) - b) for a, b in zip(sol.q, sol.gaps[:, 0], strict=True)) < 1e-4
