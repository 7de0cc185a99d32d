"""Contacts of which one follows from the others: the motion goes on, its forces are flagged."""

import math

import numpy as np
import pytest

import zivi

G = 9.81
METHOD = zivi.SwitchedRK(rtol=1e-9, atol=1e-10)


def bar(feet, e=0.5, force=(-G, 0.0), inertia=0.3):
    """A bar on feet: height and angle, for small angles."""
    gaps = [zivi.LinearGap([1, x], name=f"foot {x}") for x in feet]
    return zivi.MechanicalSystem(mass=np.diag([1.0, inertia]), force=force, gaps=gaps, e=e)


def flagged(sol):
    return "undetermined_forces" in sol.flags["kind"]


def test_a_bar_stands_on_three_feet_with_forces_that_hold_it():
    feet = (-1.0, -0.4, 1.0)
    sol = zivi.simulate(bar(feet), (0, 2), ([0, 0], [0, 0]), METHOD)
    assert sol.success, sol.message
    assert flagged(sol)
    assert np.abs(sol.q).max() < 1e-50
    assert np.all(sol.reactions >= 0)
    assert sol.reactions.sum(axis=1) == pytest.approx(G)
    assert sol.reactions @ feet == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
def test_a_bar_that_falls_flat_bounces_as_a_ball(e):
    """Time of rest: t1 (1 + e)/(1 - e)."""
    sol = zivi.simulate(bar((-1.0, -0.4, 1.0), e), (0, 7), ([0.5, 0], [0, 0]), METHOD)
    assert sol.success, sol.message
    fall = math.sqrt(1 / G)
    assert sol.zeno["t"] == pytest.approx(np.full(3, fall * (1 + e) / (1 - e)), abs=1e-9)
    assert np.abs(sol.q[:, 1]).max() < 1e-14
    assert sol.contacts[-1].all()
    assert abs(sol.q[-1, 0]) < 1e-50  # what is left of rounding depends on the BLAS
    first = sol.resolved_impacts[:3]
    assert np.all(first["impulse"] > 0)
    assert first["impulse"].sum() == pytest.approx((1 + e) * G * fall)


def test_three_feet_leave_the_floor_together_or_turn_about_one():
    """Pulled up by 3 t at -1: the right feet carry until the left one is left: by moments."""
    lifted = bar((-1.0, 0.2, 1.0), force=lambda t, q, w: [4 * t - G, 0.0])
    sol = zivi.simulate(lifted, (0, 3), ([0, 0], [0, 0]), METHOD)
    assert sol.success, sol.message
    assert sol.liftoffs["t"] == pytest.approx(np.full(3, G / 4), abs=1e-9)
    s = 3 - G / 4
    assert sol.q[-1] == pytest.approx([4 * s**3 / 6, 0], abs=1e-9)
    turned = bar((-1.0, 0.2, 1.0), force=lambda t, q, w: [3 * t - G, -3 * t])
    sol = zivi.simulate(turned, (0, 2), ([0, 0], [0, 0]), METHOD)
    assert sol.success, sol.message
    # the moment about the last foot: G - 3 t - 3 t
    assert sorted(sol.liftoffs["t"][:2]) == pytest.approx([G / 6, G / 6], abs=1e-9)
    two = bar((-1.0, 1.0), force=lambda t, q, w: [3 * t - G, -3 * t])
    other = zivi.simulate(two, (0, 2), ([0, 0], [0, 0]), METHOD)
    assert sol.q[-1] == pytest.approx(other.q[-1], abs=1e-9)


def test_two_gaps_of_one_gradient_are_one():
    """A mass with drag and a spring on the same floor twice, the second time as ``exp(g) - 1``."""
    again = zivi.Gap(
        lambda t, q: math.expm1(0.3 * q[0] + q[1]),
        lambda t, q: math.exp(0.3 * q[0] + q[1]) * np.array([0.3, 1.0]),
        lambda t, q, w: math.exp(0.3 * q[0] + q[1]) * (0.3 * w[0] + w[1]) ** 2,
    )

    def run(count):
        gaps = [zivi.LinearGap([0.3, 1.0], name="floor"), again][:count]
        force = lambda t, q, w: [-q[0] - 0.1 * w[0], -G + 12 * math.sin(3 * t)]  # noqa: E731
        mass = [[1.0, 0.2], [0.2, 2.0]]
        system = zivi.MechanicalSystem(mass=mass, force=force, gaps=gaps, e=0.6)
        return zivi.simulate(system, (0, 6), ([0.2, 0.4], [1, 0]), METHOD)

    one, two = run(1), run(2)
    assert two.success, two.message
    assert flagged(two)
    assert two.q[-1] == pytest.approx(one.q[-1], abs=1e-8)
    assert two.zeno["t"][::2] == pytest.approx(one.zeno["t"], abs=1e-8)
    assert two.liftoffs["t"][::2] == pytest.approx(one.liftoffs["t"], abs=1e-8)
    late = two.reactions[-1]
    assert late.sum() == pytest.approx(one.reactions[-1, 0], abs=1e-7)
    assert late[0] == pytest.approx(late[1], abs=1e-12)


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_bar_that_rocks_rests_on_three_feet(e):
    sol = zivi.simulate(bar((-1.0, 0.1, 1.0), e), (0, 6), ([0.5, 0.2], [0, 0.1]), METHOD)
    assert sol.success, sol.message
    two = zivi.simulate(bar((-1.0, 1.0), e), (0, 6), ([0.5, 0.2], [0, 0.1]), METHOD)
    assert np.abs(sol.q[-1]).max() < 1e-9
    assert sol.contacts[-1].all()
    # the foot between is never ahead of both others
    assert sol(0.6)[0] == pytest.approx(two(0.6)[0], abs=1e-9)
    assert sol.reactions[-1].sum() == pytest.approx(G)


def test_a_linear_system_goes_on_as_well():
    gaps = [zivi.LinearGap([1, x], name=f"foot {x}") for x in (-1.0, 0.0, 1.0)]
    stiff = np.diag([4.0, 3.0])
    system = zivi.LinearSystem(
        np.diag([1.0, 0.3]), None, stiff, excitation=[-G, 0.0], gaps=gaps, e=0.5
    )
    sol = zivi.simulate(system, (0, 3), ([0.5, 0], [0, 0]), METHOD)
    assert sol.success, sol.message
    assert sol.contacts[-1].all()
    assert sol.reactions[-1].sum() == pytest.approx(G)


def test_derivatives_end_where_it_begins():
    found = zivi.sensitivity(bar((-1.0, 0.0, 1.0)), (0, 1), ([0.1, 0], [0, 0]))
    assert found.trajectory.status is zivi.Status.REDUNDANT_CONTACTS


@pytest.mark.parametrize("count", [4, 9, 40])
def test_many_feet_bear_the_weight_as_springs_do(count):
    """Beside the middle by b: the forces of equal springs, a + c x, while none of them pulls."""
    feet = np.linspace(-1.0, 1.0, count)
    load = bar(feet, force=(-G, -0.2 * G))
    sol = zivi.simulate(load, (0, 1), ([0, 0], [0, 0]), METHOD)
    assert sol.success, sol.message
    springs = G / count + 0.2 * G * feet / (feet @ feet)
    assert sol.reactions[-1] == pytest.approx(springs, rel=1e-12)
    assert sol.resample([0.5]).reactions[0] == pytest.approx(springs, rel=1e-12)
