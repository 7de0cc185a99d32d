"""Forces that the equations do not determine, and what they do determine, against references.

``tests/data/element_references.json`` has the systems in words, and values of another program.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import zivi
from metamorphic import Foot

CASES = json.loads((Path(__file__).parent / "data" / "element_references.json").read_text())
G, TIGHT = 9.81, zivi.SwitchedRK(rtol=1e-11, atol=1e-12)


def value(case, name):
    return float(CASES[case][name])


def box(k, half, height, mu, inertia=0.35):
    """A box of 1 kg on k feet that is pulled at its centre with a force of t."""
    rows = [
        zivi.LinearGap([0, 1, x], tangent=[1, 0, height], mu=mu, name=f"foot{i}")
        for i, x in enumerate(np.linspace(-half, half, k))
    ]
    force = lambda t, q, v: np.array([t, -G, 0.0])  # noqa: E731
    return zivi.MechanicalSystem(mass=np.diag([1, 1, inertia]), force=force, gaps=rows, e=0.0)


def flags(sol):
    return set(sol.flags["kind"])


def first_slip(sol):
    rows = sol.transitions
    return rows["t"][(rows["before"] == 0) & (np.abs(rows["after"]) == 1)][0]


def test_three_brakes_hold_until_all_are_at_their_limits():
    limits = [0.2, 0.3, 0.5]
    brakes = [zivi.DryFriction(limit=it, name=f"brake{it}") for it in limits]
    mass = zivi.MechanicalSystem(mass=1.0, force=lambda t, q, v: [t], friction=brakes)
    sol = zivi.simulate(mass, (0, 3), ([0.0], [0.0]), TIGHT)
    assert sol.success, sol.message
    assert "undetermined_forces" in flags(sol)
    assert first_slip(sol) == pytest.approx(value("brakes3", "t_break"), abs=1e-12)
    assert sol.q[-1, 0] == pytest.approx(value("brakes3", "x_at_3"), abs=1e-10)
    held = sol.resample([0.3, 0.5, 0.7, 0.9]).friction_forces
    # least norm within the limits: t/3 each, but for what is at its limit
    least = [[0.1, 0.1, 0.1], [1 / 6] * 3, [0.2, 0.25, 0.25], [0.2, 0.3, 0.4]]
    np.testing.assert_allclose(held, -np.array(least), atol=1e-9)


def test_three_brakes_stop_a_mass():
    brakes = [zivi.DryFriction(limit=1.0, name=it) for it in "abc"]
    mass = zivi.MechanicalSystem(mass=1.0, force=[0.0], friction=brakes)
    sol = zivi.simulate(mass, (0, 3), ([0.0], [3.0]))
    assert sol.success, sol.message
    assert sol.q[-1, 0] == pytest.approx(1.5, abs=1e-12)
    assert sol.qdot[-1, 0] == 0
    assert "undetermined_forces" in flags(sol)


@pytest.mark.parametrize("k", [2, 3, 4, 8, 30])
def test_a_box_slides_alike_on_any_number_of_feet(k):
    sol = zivi.simulate(box(k, 1.0, 0.2, 0.3), (0, 4), (np.zeros(3), np.zeros(3)), TIGHT)
    assert sol.success, sol.message
    assert first_slip(sol) == pytest.approx(value("box_k_feet", "t_break"), abs=1e-12)
    assert sol.qdot[-1, 0] == pytest.approx(value("box_k_feet", "vx_at_4"), abs=1e-12)
    assert np.abs(sol.qdot[-1, 1:]).max() < 1e-12
    assert np.all(sol.reactions >= 0)


@pytest.mark.parametrize("k", [2, 3, 4, 30])
def test_a_box_that_slides_from_the_start_comes_to_rest(k):
    pushed = zivi.MechanicalSystem(
        mass=np.diag([1, 1, 0.35]), force=[0, -G, 0], gaps=box(k, 1.0, 0.2, 0.3).gaps, e=0.0
    )
    sol = zivi.simulate(pushed, (0, 1), (np.zeros(3), [1.2, 0, 0]), TIGHT)
    assert sol.success, sol.message
    stop = 1.2 / (0.3 * G)
    assert sol.stick["t_start"][0] == pytest.approx(stop, abs=1e-12)
    assert sol.q[-1] == pytest.approx([0.6 * stop, 0, 0], abs=1e-12)


@pytest.mark.parametrize("k", [2, 3, 8])
def test_a_high_box_tips_about_its_foremost_foot(k):
    sol = zivi.simulate(box(k, 0.3, 1.2, 0.8), (0, 2.6), (np.zeros(3), np.zeros(3)), TIGHT)
    assert sol.success, sol.message
    tip = value("box_tip", "t_tip")
    assert sol.liftoffs["gap"].tolist() == list(range(k - 1))
    assert sol.liftoffs["t"] == pytest.approx(np.full(k - 1, tip), abs=1e-9)


def test_a_bar_on_supports_of_different_friction_sticks_while_forces_exist():
    gaps = [
        zivi.LinearGap([0, 1, x], tangent=[1, 0, 0], mu=mu, name=f"at{x}")
        for x, mu in zip((-1.0, 0.0, 1.0), (0.2, 0.3, 0.8), strict=True)
    ]
    force = lambda t, q, v: np.array([t, -1.0, 0.0])  # noqa: E731
    bar = zivi.MechanicalSystem(mass=np.diag([1, 1, 0.3]), force=force, gaps=gaps, e=0.0)
    sol = zivi.simulate(bar, (0, 0.6), (np.zeros(3), np.zeros(3)), TIGHT)
    assert sol.success, sol.message
    until = value("bar_3_mu", "stick_while_possible_until")
    assert first_slip(sol) == pytest.approx(until, abs=1e-12)
    assert "undetermined_motion" in flags(sol)


def test_rods_between_opposite_gaps_rest_for_good():
    rows = [[1, 0], [-1, 0], [0, 1], [0, -1]]
    rods = zivi.MechanicalSystem(
        mass=np.eye(2),
        force=lambda t, q, v: np.array([math.sin(t), math.cos(t)]),
        gaps=[zivi.LinearGap(row, name=f"gap{i}") for i, row in enumerate(rows)],
    )
    sol = zivi.simulate(rods, (0, 10), (np.zeros(2), np.zeros(2)))
    assert sol.success, sol.message
    assert not sol.qdot.any()
    assert not sol.q.any()
    times = np.linspace(0.1, 9.9, 50)
    push = np.column_stack([np.sin(times), np.cos(times)])
    least = np.column_stack([f for c in push.T for f in (np.maximum(-c, 0), np.maximum(c, 0))])
    np.testing.assert_allclose(sol.resample(times).reactions, least, atol=1e-9)


def guide(T, mu):
    """The system of the reference in coordinates ``q = T q'``."""
    m, w0 = 0.2689757733542497, 1.2
    floor = zivi.LinearGap(T[1], tangent=T[0], mu=mu, mu_static=0.485)
    joint = zivi.DryFriction(T[1], limit=0.295)
    force = T.T @ (m * np.array([-2.5876541485475997, -9.46]))
    system = zivi.MechanicalSystem(
        mass=m * T.T @ T, force=force, gaps=[floor], friction=[joint], e=0.0
    )
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-10, max_steps=3000)
    sol = zivi.simulate(system, (0, 0.4), (np.zeros(2), np.linalg.solve(T, [w0, 0])), method)
    return sol, m


@pytest.mark.parametrize("mu", [0.44, lambda w: 0.44 + 0.0 * w], ids=["number", "function"])
def test_the_gap_carries_what_a_joint_along_its_normal_could(mu):
    """In 40 random coordinates."""
    rng = np.random.default_rng(5)
    for _ in range(40):
        sol, m = guide(rng.normal(size=(2, 2)), mu)
        assert sol.success, sol.message
        assert "undetermined_motion" in flags(sol)
        stop = sol.transitions["t"][sol.transitions["after"] == 0]
        stop = [it for it in stop if it > 0]
        assert stop[0] == pytest.approx(value("guide_share", "stop_time_all_on_gap"), abs=1e-9)
        early = sol.resample([0.05])
        assert early.reactions[0, 0] == pytest.approx(9.46 * m, rel=1e-9)
        assert early.friction_forces[0, 1] == pytest.approx(0, abs=1e-9)


def test_forces_of_a_wedge_with_one_contact_that_slips_balance():
    """The belt drags the floor contact, the side sticks: two forces of four are left open."""
    normal = np.array([math.sin(1.2), math.cos(1.2)])
    side = zivi.LinearGap(normal, tangent=[normal[1], -normal[0]], mu=0.4, name="side")
    floor = zivi.LinearGap([0, 1], tangent=[1, 0], mu=0.3, belt=-0.3, name="floor")
    load = np.array([-6.0, -10.0])
    system = zivi.MechanicalSystem(mass=np.eye(2), force=load, gaps=[floor, side], e=0.0)
    sol = zivi.simulate(system, (0, 1), ([0, 0], [0, 0]), TIGHT)
    assert sol.success, sol.message
    for press, rub in zip(sol.reactions, sol.friction_forces, strict=True):
        left = load + press[0] * np.array([0, 1]) + press[1] * normal
        left += rub[0] * np.array([1, 0]) + rub[1] * np.array([normal[1], -normal[0]])
        assert np.abs(left).max() < 1e-12 * 10
        assert (np.abs(rub) <= [0.3, 0.4] * press * (1 + 1e-12)).all()
        assert rub[0] == pytest.approx(-0.3 * press[0], rel=1e-12)


@pytest.mark.parametrize("k", [3, 4])
def test_a_curved_box_is_that_of_small_angles_while_it_slides(k):
    feet = [
        Foot(np.zeros(3), 0.2, 0.0, mu=0.3, point=(x, -0.2)).gap(f"foot{i}")
        for i, x in enumerate(np.linspace(-1, 1, k))
    ]
    system = zivi.MechanicalSystem(mass=np.diag([1, 1, 0.35]), force=[0, -G, 0], gaps=feet, e=0.0)
    sol = zivi.simulate(system, (0, 1), (np.zeros(3), [1.2, 0, 0]), TIGHT)
    assert sol.success, sol.message
    assert sol.q[-1] == pytest.approx([1.2**2 / (0.6 * G), 0, 0], abs=1e-11)


def test_a_block_that_hits_a_rough_wall_with_both_feet_down_stays_upright():
    """Its feet take part in the impact though no force of theirs is undetermined."""
    gaps = [
        zivi.LinearGap([0, 1, x], tangent=[1, 0, 0.3], mu=0.117, name=f"foot{x}")
        for x in (-0.3, 0.3)
    ]
    gaps.append(zivi.LinearGap([-1, 0, 0], 0.1, tangent=[0, -1, 0.3], mu=0.117, name="wall"))
    block = zivi.MechanicalSystem(mass=np.diag([1, 1, 0.05]), force=[2, -G, 0], gaps=gaps, e=0.0)
    sol = zivi.simulate(block, (0, 1), (np.zeros(3), [1.28, 0, 0]), TIGHT)
    assert sol.success, sol.message
    push = 2 - 0.117 * G
    speed = math.sqrt(1.28**2 + 2 * push * 0.1)
    assert sol.impacts["t"][-1] == pytest.approx((speed - 1.28) / push, abs=1e-12)
    assert sol.q[-1] == pytest.approx([0.1, 0, 0], abs=1e-12)
