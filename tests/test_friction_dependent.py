"""Channels of friction that depend on each other, and several of which one must slip."""

import numpy as np
import pytest

import zivi

G = 9.81
METHOD = zivi.SwitchedRK(rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("lower", "upper", "slips"), [((0.2, 0.6), (0.25, 0.3), 1), ((0.25, 0.3), (0.2, 0.6), 0)]
)
def test_the_block_whose_limit_is_reached_slips(lower, upper, slips):
    """Two stacked blocks of 1 kg on a floor with the acceleration 2t: one lets go at 2t = 0.3 g."""
    floor = zivi.Gap(
        lambda t, q: q[1],
        [0, 1, 0, 0],
        tangent=[1, 0, 0, 0],
        tangent_velocity=lambda t, q: -(t**2),
        tangent_curvature=lambda t, q, qdot: -2 * t,
        mu=lower[0],
        mu_static=lower[1],
    )
    between = zivi.LinearGap([0, -1, 0, 1], tangent=[-1, 0, 1, 0], mu=upper[0], mu_static=upper[1])
    blocks = zivi.MechanicalSystem(
        mass=np.eye(4), force=[0, -G, 0, -G], gaps=[floor, between], e=0.0
    )
    sol = zivi.simulate(blocks, (0, 1.8), (np.zeros(4), np.zeros(4)), METHOD)
    assert sol.success
    left = sol.transitions[sol.transitions["t"] > 0]
    assert left["channel"].tolist() == [slips]
    assert left["t"][0] == pytest.approx(0.15 * G, abs=1e-12)
    # below the slip the acceleration is the floor's, above it that of the kinetic friction
    t, began = 1.8, 0.15 * G
    slow = began**2 + (lower, upper)[slips][0] * G * (t - began)
    assert sol.qdot[-1, [0, 2]] == pytest.approx([t**2, slow] if slips else [slow, slow], abs=1e-9)


def test_a_disc_that_the_floor_throws_up_slips_along_the_wall():
    """Stick at floor and wall would leave it no speed upwards, but the floor's law says 0.3 m/s."""
    r, e, rise = 0.25, 0.5, -0.6
    floor = zivi.LinearGap([0, 1, 0], offset=-r, tangent=[1, 0, r], mu=0.3)
    wall = zivi.LinearGap([1, 0, 0], offset=-r, tangent=[0, 1, -r], mu=0.2)
    disc = zivi.MechanicalSystem(
        mass=np.diag([1, 1, r**2 / 2]), force=[-3, -G, 0], gaps=[floor, wall], e=[e, 0]
    )
    drop = 0.002
    speed = -np.sqrt(rise**2 - 2 * G * drop)
    spin = 0.25 / r
    sol = zivi.simulate(disc, (0, 0.06), ([r, r + drop, 0], [0, speed, spin]), METHOD)
    assert sol.success
    assert "impact_not_unique" not in sol.flags["kind"]
    rows = sol.resolved_impacts
    hit, pressed = rows[rows["gap"] == 0][0], rows[rows["gap"] == 1][0]
    assert hit["speed_after"] == pytest.approx(-e * hit["speed_before"])
    # rolling on the floor, it rises along the wall
    assert hit["slip_after"] == 0
    assert pressed["slip_after"] == pytest.approx(hit["speed_after"], abs=1e-12)
    assert pressed["tangential_impulse"] == pytest.approx(-0.2 * pressed["impulse"])


def arm(limit):
    """Two links of 1 m with 1 kg at elbow and tip; the tip is on a floor, the shoulder rubs."""
    depth = 1.3

    def mass(t, q):
        c = np.cos(q[0] - q[1])
        return [[2, c], [c, 1]]

    def force(t, q, v):
        s = np.sin(q[0] - q[1])
        return [-s * v[1] ** 2 - 2 * G * np.sin(q[0]), s * v[0] ** 2 - G * np.sin(q[1])]

    tip = zivi.Gap(
        lambda t, q: depth - np.cos(q[0]) - np.cos(q[1]),
        lambda t, q: np.sin(q),
        lambda t, q, v: np.cos(q) @ v**2,
        tangent=lambda t, q: np.cos(q),
        tangent_curvature=lambda t, q, v: -np.sin(q) @ v**2,
        mu=0.2,
    )
    shoulder = zivi.DryFriction([1, 0], limit=limit)
    return zivi.MechanicalSystem(mass=mass, force=force, gaps=[tip], friction=[shoulder])


def test_tip_and_shoulder_of_an_arm_on_the_floor_stop_together():
    """With the contact closed one speed is left: where that ends both channels stick."""
    first, speed = 0.5, -2.5
    second = -np.arccos(1.3 - np.cos(first))
    rate = -np.sin(first) / np.sin(second) * speed
    sol = zivi.simulate(arm(10.0), (0, 0.8), ([first, second], [speed, rate]), METHOD)
    assert sol.success
    stuck = sol.transitions[sol.transitions["after"] == 0]
    assert stuck["channel"].tolist() == [0, 1]
    assert stuck["t"][0] == stuck["t"][1]
    assert np.abs(sol.qdot[-1]).max() < 1e-15
    assert sol.modes[-1].tolist() == [0, 0]


def test_the_tip_of_an_arm_turns_back_at_its_full_reach():
    """There its slip is zero for an instant, but no force holds the arm: the shoulder goes on."""
    start = 0.6
    second = np.arccos(1.3 - np.cos(start))
    reach = np.arccos(0.65)
    speed = 2.0
    rate = -np.sin(start) / np.sin(second) * speed
    sol = zivi.simulate(arm(0.5), (0, 0.25), ([start, second], [speed, rate]), METHOD)
    assert sol.success
    turned = sol.transitions[(sol.transitions["channel"] == 0) & (sol.transitions["t"] > 0)]
    assert turned["after"].tolist() == [-turned["before"][0]]
    assert abs(turned["before"][0]) == 1
    assert sol(turned["t"][0]).ravel()[:2] == pytest.approx([reach, reach], abs=1e-9)


def test_the_slip_of_a_block_on_a_shaking_floor_has_the_accuracy_of_the_method():
    """The block moves in a parabola, exact at every step: its slip says what steps are good."""
    a, omega, mu = 0.19, 6.2, 0.3
    floor = zivi.Gap(
        lambda t, q: q[1],
        [0, 1],
        tangent=[1, 0],
        tangent_velocity=lambda t, q: -a * omega * np.cos(omega * t),
        tangent_curvature=lambda t, q, v: a * omega**2 * np.sin(omega * t),
        mu=mu,
    )
    block = zivi.MechanicalSystem(mass=np.eye(2), force=[0, -G], gaps=[floor])
    for order in (5, 8):
        method = zivi.SwitchedRK(order=order, rtol=1e-9, atol=1e-9)
        sol = zivi.simulate(block, (0, 0.2), ([0, 0], [0, 0]), method)
        # w < 0: x'' = mu g; dissipated: mu g (slid distance)
        t = sol.transitions["t"][1] if len(sol.transitions) > 1 else 0.2
        t = min(t, 0.2)
        slid = a * np.sin(omega * t) - mu * G * t**2 / 2
        assert sol.modes[0, 0] == -1
        at = np.searchsorted(sol.t, t)
        assert sol.dissipated[at] == pytest.approx(mu * G * slid, abs=1e-8)
        assert a * omega * np.cos(omega * t) == pytest.approx(mu * G * t, abs=1e-8) or t == 0.2


def corner(mu, force):
    """A mass of 1 kg between a floor and a wall with friction."""
    floor = zivi.LinearGap([0, 1], tangent=[1, 0], mu=mu)
    wall = zivi.LinearGap([-1, 0], offset=1, tangent=[0, 1], mu=mu)
    return zivi.MechanicalSystem(mass=np.eye(2), force=force, gaps=[floor, wall], e=0.0)


@pytest.mark.parametrize("mu", [0.05, 0.3])
@pytest.mark.parametrize("start", [(1, 0), (1, 0.5), (0.5, 0)])
def test_a_mass_that_sticks_in_a_corner_rests_with_forces_that_hold_it(mu, start):
    """Four forces, two equations: the least of all that obey both laws of friction."""
    sol = zivi.simulate(corner(mu, [4, -G]), (0, 3), (start, (0, 0)), METHOD)
    assert sol.success, sol.message
    assert sol.nfev < 900
    run, fall = 4 - mu * G, G - mu * 4
    closes = np.sqrt(1 / run) if start == (0.5, 0) else np.sqrt(2 * start[1] / fall)
    rests = sol.t >= closes + 1e-12
    assert sol.q[rests] == pytest.approx(np.tile([1.0, 0.0], (rests.sum(), 1)), abs=1e-12)
    assert "undetermined_forces" in sol.flags["kind"]
    (floor, wall), (along, up) = sol.reactions[-1], sol.friction_forces[-1]
    assert [4 - wall + along, floor + up - G] == pytest.approx([0, 0], abs=1e-12)
    assert abs(along) <= mu * floor * (1 + 1e-9)
    assert abs(up) <= mu * wall * (1 + 1e-9)
    # the least squares within the limits, on a grid of what two forces leave of the others
    x, y = np.meshgrid(np.linspace(-4, 0, 401), np.linspace(0, G, 401))
    held = (abs(x) <= mu * (G - y)) & (y <= mu * (4 + x))
    sizes = np.where(held, x**2 + y**2 + (4 + x) ** 2 + (G - y) ** 2, np.inf)
    assert along**2 + up**2 + wall**2 + floor**2 == pytest.approx(sizes.min(), rel=2e-2)
    assert along**2 + up**2 + wall**2 + floor**2 <= sizes.min() * (1 + 1e-12)


def test_a_contact_without_an_impulse_has_no_row_of_impacts():
    """A mass that slides into a wall: the floor takes no part, whatever friction would hold."""
    sol = zivi.simulate(corner(0.05, [1, -G]), (0, 2), ((0.5, 0.5), (0, 0)), METHOD)
    slide = 1 - 0.05 * G
    fall = np.sqrt(2 * 0.5 / G)
    kick = 0.05 * G * fall  # of the floor's impulse, by friction
    speed = fall - kick
    way = 0.5 - fall**2 / 2
    end = np.sqrt(speed**2 + 2 * slide * way)
    rows = sol.impacts
    assert rows["gap"].tolist() == [0, 1]
    assert rows["t"][1] == pytest.approx(fall + (end - speed) / slide, abs=1e-12)
    assert rows["speed_before"][1] == pytest.approx(-end, abs=1e-12)


@pytest.mark.parametrize("size", [2.0**20, 2.0**-20])
@pytest.mark.parametrize("law", ["newton", "poisson"])
def test_a_motion_does_not_hang_on_the_unit_of_mass(size, law):
    """Masses and forces times a power of two: the same motion."""
    r = 0.25

    def disc(unit):
        floor = zivi.LinearGap([0, 1, 0], offset=-r, tangent=[1, 0, r], mu=0.3)
        wall = zivi.LinearGap([-1, 0, 0], offset=1 - r, tangent=[0, 1, r], mu=0.2)
        return zivi.MechanicalSystem(
            mass=unit * np.diag([1, 1, r**2 / 2]),
            force=unit * np.array([2.0, -G, 0.0]),
            gaps=[floor, wall],
            e=[0.6, 0.4],
            friction=[zivi.DryFriction(direction=[0, 0, 1], limit=0.02 * unit)],
            impact_law=law,
        )

    start = ([0.4, 0.7, 0], [1.0, 0.3, -3.0])
    sol = zivi.simulate(disc(1.0), (0, 0.9), start, METHOD)
    other = zivi.simulate(disc(size), (0, 0.9), start, METHOD)
    assert sol.success
    assert other.success
    assert len(sol.impacts) >= 4
    assert {0, 1} == set(sol.impacts["gap"])
    assert other.q[-1] == pytest.approx(sol.q[-1], abs=1e-8)
    assert other.impacts["gap"].tolist() == sol.impacts["gap"].tolist()
    for name, unit in (("t", 1.0), ("slip_after", 1.0), ("tangential_impulse", size)):
        np.testing.assert_allclose(
            other.impacts[name], unit * sol.impacts[name], rtol=1e-7, atol=1e-9 * unit
        )
    assert other.transitions["after"].tolist() == sol.transitions["after"].tolist()
