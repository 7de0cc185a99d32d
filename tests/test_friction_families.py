"""Random systems with dry friction: the balance of energy, and two orders that share no steps."""

import math

import numpy as np
import pytest

import zivi
from friction_problems import Families, mechanism
from test_friction_references import told

pytestmark = pytest.mark.slow

G, FAMILIES = 9.81, Families()
TOL = 1e-9


def rod(draw):
    """A rod that falls on both ends."""
    angle = draw(-0.6, 0.6)
    start = [0, abs(math.sin(angle)) + draw(0, 0.3), angle], [draw(-1, 1), draw(-0.5, 0.5), 0.3]
    problem = FAMILIES.rod(draw(0.05, 0.9), draw(0, 0.6), two=True)
    return problem, start, 1.5, [1, 1, 1 / 3]


def disc(draw):
    """A disc that is dropped with spin."""
    start = [0, 0.1 + draw(0.02, 0.5), 0], [draw(-2, 2), draw(-1, 1), draw(-30, 30)]
    return FAMILIES.disc(draw(0.05, 0.8), draw(0, 0.8), draw(0, 0.5)), start, 2.0, [1, 1, 0.005]


def bowl(draw):
    """A particle that bounces and slides in a parabola."""
    start = [draw(-1, 1), 1.5], [draw(-1, 1), draw(-1, 1)]
    return FAMILIES.bowl(draw(0.05, 0.9), draw(0, 0.8), 0), start, 4.0, [1, 1]


@pytest.mark.parametrize("family", [rod, disc, bowl], ids=lambda it: it.__name__)
def test_the_energy_is_lost_to_friction_and_to_impacts(family):
    """The loss of an impact along the normal is -P (g- + g+)/2; the rest is in ``dissipated``."""
    rng = np.random.default_rng(7)
    for _ in range(4):
        problem, start, end, mass = family(rng.uniform)
        method = zivi.SwitchedRK(rtol=TOL, atol=TOL)
        sol = zivi.simulate(mechanism(problem), (0, end), start, method)
        assert sol.success, sol.message
        energy = (sol.qdot**2 @ mass) / 2 + G * sol.q[:, 1]
        rows = sol.impacts_down_to(1e-9, limit=500)
        normal = -np.sum(rows["impulse"] * (rows["speed_before"] + rows["speed_after"])) / 2
        begun = np.array(start[1]) ** 2 @ mass / 2 + G * start[0][1]
        lost = begun - energy[-1] - sol.dissipated[-1] - normal
        assert abs(lost) <= 20 * TOL * begun


def feeder(draw):
    """A part on a plane that shakes."""
    numbers = [draw(-0.2, 0.3), draw(0.1, 0.6), draw(0, 0.7), draw(0.01, 0.12), draw(5, 14)]
    start = [0, draw(0, 0.2)], [draw(-0.5, 0.5), draw(-0.5, 0.5)]
    return FAMILIES.feeder(*numbers, draw(0.2, 1.2)), start, 2.0


def belt2(draw):
    """Two blocks on a belt, with friction that falls with the speed."""
    springs, speed = [1, draw(0.5, 2), draw(0.2, 2)], draw(0.05, 0.8)
    limits = [draw(0.3, 1), draw(0.3, 1), draw(1, 1.5), draw(1, 1.5)]
    start = [draw(-1, 1), draw(-1, 1)], [draw(-1, 1), draw(-1, 1)]
    return FAMILIES.belt2(*springs, speed, *limits, draw(0, 3)), start, 8.0


@pytest.mark.parametrize("family", [feeder, belt2], ids=lambda it: it.__name__)
def test_both_orders_find_the_same_events(family):
    rng = np.random.default_rng(3)
    for _ in range(4):
        problem, start, end = family(rng.uniform)
        system = mechanism(problem)
        sols = [
            zivi.simulate(system, (0, end), start, zivi.SwitchedRK(order=order, rtol=tol, atol=tol))
            for order, tol in ((5, 1e-8), (8, 1e-11))
        ]
        near, exact = (told(sol) for sol in sols)
        assert [it[1:] for it in near] == [it[1:] for it in exact]
        assert sols[0].q[-1] == pytest.approx(sols[1].q[-1], abs=1e-6)
        assert [it[0] for it in near] == pytest.approx([it[0] for it in exact], abs=1e-6)
