"""Bodies that move in space: free bodies, ball joints, and shapes whose contacts are gaps."""

import json
import pathlib
import pickle

import numpy as np
import pytest

import zivi
from example_scripts import example
from zivi.mechanics import Ball, Body, Box, Capsule, Connect, Contact, Plane, PlaneGap

KNOWN = json.loads((pathlib.Path(__file__).parent / "data" / "space.json").read_text("utf-8"))
SLOPES = [it for it in KNOWN if it["name"].startswith("ball_on_slope")]
TOLERANCES = (1e-6, 1e-9, 1e-12)


def known(name):
    return next(it for it in KNOWN if it["name"] == name)


def numbers(values):
    return np.array(values, dtype=float)


def method(tol):
    return zivi.SwitchedRK(rtol=tol, atol=tol)


def rotation(p):
    """Matrix of a unit quaternion (w, x, y, z)."""
    w, v = p[0], np.asarray(p[1:])
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def apart(p, other):
    """Distance of two rotations."""
    return float(np.max(np.abs(rotation(p) - rotation(other))))


def thrown(mu, e, *, radius=0.2, mass=1.3, turned=None, slope=0.0, g=9.81, **more):
    """A homogeneous ball above a slope, in axes of the slope or in turned ones."""
    turned = np.eye(3) if turned is None else turned
    ball = Body("ball", kind="free", mass=mass, inertia=0.4 * mass * radius**2)
    return zivi.Tree(
        [ball],
        contacts=[Contact("ball", "slope", mu=mu, e=e)],
        shapes={"ball": Ball(radius), "slope": Plane(turned @ [0, 0, 1])},
        gravity=g * turned @ [np.sin(slope), 0, -np.cos(slope)],
        **more,
    )


# Kinematics and dynamics.

OFFSET = Body("body", kind="free", mass=1.7, com=[0.1, -0.2, 0.3],
              inertia=[[0.4, 0.05, 0.02], [0.05, 0.5, -0.03], [0.02, -0.03, 0.6]])  # fmt: skip
ARM = Body("arm", "body", position=[0.3, 0, 0.1], axis=[1, 2, 2], mass=0.4, com=[0, 0.2, 0],
           inertia=0.02)  # fmt: skip
TOP = Body("top", kind="ball", position=[0.1, 0.2, 0.3], anchor=[0, 0.1, -0.2], mass=0.9,
           com=[0, 0, 0.4], inertia=[0.02, 0.03, 0.01])  # fmt: skip


def places(body, origin, p, points):
    return origin + np.asarray(points) @ rotation(p).T


@pytest.mark.parametrize("seed", range(4))
def test_energy_and_momentum_of_a_free_body_are_those_of_its_parts(seed):
    rng = np.random.default_rng(seed)
    tree = zivi.Tree([OFFSET], gravity=[0, 0, 0])
    p = rng.normal(size=4)
    p /= np.linalg.norm(p)
    place, v, omega = rng.normal(size=(3, 3))
    q, qdot = tree.state([*place, *p], [*v, *omega])
    np.testing.assert_allclose(tree.qvel(q, qdot), [*v, *omega], atol=1e-13)
    assert apart(tree.qpos(q)[3:], p) < 1e-14
    mass = tree.at(0.0, q, qdot).mass
    turn, com = rotation(p), np.asarray(OFFSET.com)
    of_com = v + turn @ np.cross(omega, com)
    energy = 0.5 * OFFSET.mass * of_com @ of_com + 0.5 * omega @ np.asarray(OFFSET.inertia) @ omega
    assert 0.5 * qdot @ mass @ qdot == pytest.approx(energy, rel=1e-13)
    # momentum: what the slides feel
    np.testing.assert_allclose((mass @ qdot)[:3], OFFSET.mass * of_com, rtol=1e-12, atol=1e-13)


def test_curvatures_and_tangents_are_differences_of_speeds():
    shapes = {
        "foot": Ball(0.2, [0.1, 0, -0.3], body="arm"),
        "box": Box([0.1, 0.2, 0.3], [0, 0.1, 0], body="body"),
        "rod": Capsule(0.05, 0.4, [1, 1, 0], body="body"),
        "slope": Plane([1, -2, 3], point=[0, 0, -3]),
        "bob": Ball(0.3, [0, 0.1, 0.2], body="top"),
        "post": Ball(0.2, [3, 1, 2]),
    }
    contacts = [Contact(name, "slope", mu=0.3) for name in ("foot", "box", "rod")]
    contacts += [Contact("bob", "foot", mu=0.2), Contact("post", "bob", mu=0.2)]
    tree = zivi.Tree([OFFSET, ARM, TOP], contacts=contacts, shapes=shapes)
    assert tree.gap_names[:2] == ("foot-slope", "box-slope.0")
    assert tree.m == 13
    rng = np.random.default_rng(5)
    n = len(tree.coordinate_names(0))
    for _ in range(3):
        q, w = rng.normal(size=n) * ([1] * 3 + [0.4] * 3 + [1] + [0.4] * 3), rng.normal(size=n)
        here, h = tree.at(0.0, q, w), 1e-3

        def at(s, q=q, w=w):
            there = tree.at(0.0, q + s * w, w)
            return np.concatenate([there.gaps, there.gradients @ w, there.tangents @ w])

        steps = [(at(s * h) - at(-s * h)) / (2 * s * h) for s in (1, 2)]
        slopes = (4 * steps[0] - steps[1]) / 3
        m = tree.m
        np.testing.assert_allclose(here.gradients @ w, slopes[:m], atol=1e-8)
        np.testing.assert_allclose(here.curvatures, slopes[m : 2 * m], atol=1e-8)
        np.testing.assert_allclose(here.slip_curvatures, slopes[2 * m :], atol=1e-8)


def test_gaps_of_shapes_are_distances_and_slips_are_speeds_of_touching_points():
    unit = np.array([2.0, -1.0, 2.0]) / 3
    shapes = {"hull": Capsule(0.05, 0.4, [1, 1, 0], [0, 0, 0.1], body="body"),
              "wall": Plane(5 * unit, offset=-1.5)}  # fmt: skip
    tree = zivi.Tree([OFFSET], contacts=[Contact("wall", "hull", mu=0.1, name="c")], shapes=shapes)
    p, place, omega = np.array([0.5, -0.5, 0.1, 0.7]), np.array([0.3, 0.2, -0.1]), [1.0, -2.0, 0.5]
    p /= np.linalg.norm(p)
    v = np.array([0.4, 0.3, -0.2])
    q, w = tree.state([*place, *p], [*v, *omega])
    here = tree.at(0.0, q, w)
    along = 0.4 * np.array([1, 1, 0]) / np.sqrt(2)
    for k, end in enumerate([-along, along]):
        arm = rotation(p) @ (end + np.array([0, 0, 0.1]))
        assert here.gaps[k] == pytest.approx(unit @ (place + arm) + 1.5 - 0.05, abs=1e-14)
        speed = v + np.cross(rotation(p) @ omega, arm - 0.05 * unit)
        assert here.gradients[k] @ w == pytest.approx(unit @ speed, abs=1e-14)
        slips = here.tangents[2 * k : 2 * k + 2] @ w
        assert np.hypot(*slips) == pytest.approx(np.linalg.norm(speed - unit * (unit @ speed)))
    assert tree.channel_names == ("c.0[0]", "c.0[1]", "c.1[0]", "c.1[1]")


# Rotations over whole turns.


def test_a_free_top_turns_as_it_must():
    it = known("euler_top")
    tree = zivi.Tree([Body("top", kind="free", mass=1.0, inertia=[1, 2, 3])], gravity=[0, 0, 0])
    start = [1.0, -2.0, 0.5, 1, 0, 0, 0], [0.1, 0.2, -0.3, 0.8, 0.1, 1.2]
    for tol in TOLERANCES:
        sol = zivi.simulate(tree, (0, 5), start, method(tol))
        assert apart(sol.qpos[-1, 3:], numbers(it["quaternion"])) < 20 * tol
        np.testing.assert_allclose(sol.qvel[-1, 3:], numbers(it["rates"]), atol=20 * tol)
        np.testing.assert_allclose(sol.qpos[-1, :3], [1.5, -1.0, -1.0], atol=1e-14)


def test_steps_of_order_eight_through_changes_of_the_chart():
    tree = zivi.Tree([Body("top", kind="free", mass=1.0, inertia=[1, 2, 3])], gravity=[0, 0, 0])
    start = tree.state([0, 0, 0, 1, 0, 0, 0], [0, 0, 0, 0.8, 0.1, 1.2])
    exact = zivi.simulate(tree, (0, 20), start, method(1e-13)).qpos[-1, 3:]
    errors = []
    for steps in (20, 160):
        h = 20 / steps
        fixed = zivi.SwitchedRK(rtol=0.9, atol=1e3, max_step=h, first_step=h)
        sol = zivi.simulate(tree, (0, 20), start, fixed, samples="steps")
        assert sol.n_steps == steps
        # between charts the coordinates jump
        jumps = np.abs(np.diff(sol.q[:, 3:], axis=0)).max()
        assert jumps > 0.5
        errors.append(apart(sol.qpos[-1, 3:], exact))
    assert np.log(errors[0] / errors[1]) / np.log(8) > 7.5
    assert errors[0] < 1e-4
    assert errors[1] < 5e-12


def test_energy_and_angular_momentum_are_conserved():
    tree = zivi.Tree([OFFSET, ARM], gravity=[0, 0, 0])
    start = tree.state([0, 0, 0, 1, 0, 0, 0, 0.3], [1.0, 0, -0.5, 3.0, -4.0, 5.0, 2.0])
    sol = zivi.simulate(tree, (0, 3), start, method(1e-11))

    def of(q, w):
        turn, momentum = rotation(tree.qpos(q)[3:7]), tree.at(0.0, q, w).mass @ w
        # what the rotation has for unit angular velocities in axes of the world
        rates = np.linalg.inv([tree.qvel(q, unit) for unit in np.eye(7)])[3:6]
        unit = turn @ rates
        spin = np.array([it @ momentum for it in unit]) + np.cross(q[:3], momentum[:3])
        return np.array([0.5 * w @ momentum, *momentum[:3], *spin])

    values = np.array([of(q, w) for q, w in zip(sol.q, sol.qdot, strict=True)])
    assert np.ptp(values, axis=0).max() < 2e-9
    assert np.linalg.norm(sol.qvel[:, 3:6], axis=1).max() * 3 > 4 * np.pi  # whole turns


def test_a_conical_pendulum_on_a_ball_joint():
    angle, length = 0.7, 1.3
    bob = Body("bob", kind="ball", position=[0, 0, 2.0], mass=0.8, com=[0, 0, -length],
               inertia=0.01)  # fmt: skip
    tree = zivi.Tree([bob])
    rate = np.sqrt(9.81 / (length * np.cos(angle)))
    tilt = np.array([np.cos(angle / 2), 0, np.sin(angle / 2), 0])
    start = tree.state(tilt, rotation(tilt).T @ [0, 0, rate])
    end = 3.3
    sol = zivi.simulate(tree, (0, end), start, method(1e-11))
    half = rate * end / 2
    turned = rotation([np.cos(half), 0, 0, np.sin(half)]) @ rotation(tilt)
    np.testing.assert_allclose(rotation(sol.qpos[-1]), turned, atol=1e-9)


def test_dense_output_and_poses_have_no_jumps():
    tree = zivi.Tree([OFFSET])
    start = [0, 0, 5, 1, 0, 0, 0], [0, 0, 0, 9.0, -4.0, 7.0]
    sol = zivi.simulate(tree, (0, 2), start, method(1e-10))
    times = np.linspace(0, 2, 41)
    q, qdot = sol(times)
    for t, q_t, v_t in zip(times[1::8], q[1::8], qdot[1::8], strict=True):
        other = zivi.simulate(tree, (0, t), start, method(1e-10))
        assert apart(tree.qpos(q_t)[3:], other.qpos[-1, 3:]) < 1e-8
        np.testing.assert_allclose(tree.qvel(q_t, v_t), other.qvel[-1], atol=1e-7)
    fine = sol.resample(np.linspace(0, 2, 2001))
    place, quaternion = fine.pose("body")
    assert np.abs(np.diff(quaternion, axis=0)).max() < 0.02
    assert np.abs(np.diff(place, axis=0)).max() < 0.05
    assert sol.trusted_until == 2.0
    # an event is none where only the coordinates change
    seen = zivi.simulate(tree, (0, 2), start, events=lambda t, q, qdot: tree.qpos(q)[4:] @ q[3:])
    assert len(seen.t_events[0]) < 12


# Balls above planes, against closed forms.


@pytest.mark.parametrize("it", SLOPES, ids=lambda it: it["name"])
@pytest.mark.parametrize("tol", TOLERANCES, ids="{:g}".format)
def test_a_ball_is_thrown_on_a_slope(it, tol):
    tree = thrown(it["mu"], it["e"], slope=it["al"])
    start = [0, 0, it["h"] + 0.2, 1, 0, 0, 0], [*it["v0"], *it["omega0"]]
    sol = zivi.simulate(tree, (0, it["T"]), start, method(tol))
    first = [float(t) for t, _ in it["first_impacts"]]
    np.testing.assert_allclose(sol.impacts["t"][:6], first, atol=1e-14)
    assert sol.zeno["t"] == pytest.approx([float(it["t_zeno"])], abs=1e-13)
    np.testing.assert_allclose(sol.qpos[-1, :2], numbers(it["xy"]), atol=20 * tol)
    np.testing.assert_allclose(sol.qvel[-1, :2], numbers(it["vxy"]), atol=20 * tol)
    sticks = [how == "stick" for _, how in it["first_impacts"]]
    assert sol.resolved_impacts["sticks"][:4].tolist() == sticks[:4]
    if it["t_stop"] is not None:
        assert sol.transitions["t"][-1] == pytest.approx(float(it["t_stop"]), abs=20 * tol)
    assert not sol.slips[sol.modes == 0].any()
    assert sol.modes[-1].tolist() == [0, 0]


@pytest.mark.parametrize("tol", TOLERANCES, ids="{:g}".format)
def test_a_ball_slides_and_then_rolls(tol):
    it = known("ball_rolls")
    tree = thrown(it["mu"], 0.0)
    start = [0, 0, 0.2, 1, 0, 0, 0], [*it["v0"], 0.0, *it["omega0"]]
    sol = zivi.simulate(tree, (0, 1), start, method(tol))
    assert sol.transitions["t"][-1] == pytest.approx(float(it["t_stop"]), abs=1e-15)
    np.testing.assert_allclose(sol.qvel[-1, :2], numbers(it["v_rolling"]), atol=tol)
    assert not sol.slips[-1].any()
    turned = rotation(sol.qpos[-1, 3:]) @ sol.qvel[-1, 3:]
    np.testing.assert_allclose(turned[2], it["omega0"][2], atol=20 * tol)  # it goes on spinning


@pytest.mark.parametrize("velocity", [(1.4, 0.0), (0.0, -2.0), (-1.4, 0.0)])
def test_a_slip_along_a_tangent_ends(velocity):
    # the speed along the other tangent is exactly zero
    tangents = [[1, 0, 0], [0, 1, 0]]
    gap = zivi.LinearGap([0, 0, 1], tangent=tangents, mu=0.3)
    puck = zivi.MechanicalSystem(mass=np.eye(3), force=[0, 0, -9.81], gaps=[gap])
    sol = zivi.simulate(puck, (0, 1), (np.zeros(3), [*velocity, 0.0]))
    assert sol.transitions["t"][-1] == pytest.approx(np.linalg.norm(velocity) / 2.943, abs=1e-14)
    assert not sol.qdot[-1].any()


def axes(seed):
    p = np.random.default_rng(seed).normal(size=4)
    return rotation(p / np.linalg.norm(p))


@pytest.mark.parametrize("seed", range(3))
def test_the_world_may_be_turned_and_measured_in_other_units(seed):
    it, turn = SLOPES[1], axes(seed)
    place, v = np.array([0.1, -0.2, it["h"] + 0.2]), numbers(it["v0"])
    omega, end = numbers(it["omega0"]), 1.5
    plain = zivi.simulate(
        thrown(it["mu"], it["e"], slope=it["al"]),
        (0, end), ([*place, 1, 0, 0, 0], [*v, *omega]), method(1e-10),
    )  # fmt: skip
    one, two = plain.qpos[-1], plain.qvel[-1]
    length, time = [1.0, 1000.0, 0.02][seed], [1.0, 1.0, 1000.0][seed]
    tree = thrown(it["mu"], it["e"], slope=it["al"], turned=turn, radius=0.2 * length,
                  g=9.81 * length / time**2)  # fmt: skip
    start = [*(length * turn @ place), 1, 0, 0, 0], [*(length / time * turn @ v),
                                                     *(turn @ omega / time)]  # fmt: skip
    other = zivi.simulate(tree, (0, end * time), start,
                          zivi.SwitchedRK(rtol=1e-10, atol=1e-10 * min(length, 1.0)))  # fmt: skip
    np.testing.assert_allclose(other.qpos[-1, :3] / length, turn @ one[:3], atol=2e-8)
    np.testing.assert_allclose(other.qvel[-1, :3] * time / length, turn @ two[:3], atol=2e-8)
    turned = turn @ rotation(one[3:]) @ turn.T
    np.testing.assert_allclose(rotation(other.qpos[-1, 3:]), turned, atol=1e-7)
    np.testing.assert_allclose(other.zeno["t"] / time, plain.zeno["t"], atol=1e-12)


def test_two_balls_collide_and_a_body_is_held_at_a_point():
    one, two = (Body(name, kind="free", mass=m, inertia=0.1) for name, m in (("a", 1), ("b", 3)))
    shapes = {"a": Ball(0.2), "b": Ball(0.3)}
    tree = zivi.Tree(
        [one, two], contacts=[Contact("a", "b", e=0.5)], shapes=shapes, gravity=[0] * 3
    )
    start = tree.state([0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 1, 0, 0, 0], [1, 0, 0, 0, 0, 9, *[0] * 6])
    sol = zivi.simulate(tree, (0, 3), start, method(1e-11))
    assert sol.impacts["t"] == pytest.approx([1.5])
    np.testing.assert_allclose(sol.qvel[-1], [-0.125, 0, 0, 0, 0, 9, 0.375, *[0] * 5], atol=1e-9)
    # a free body that is connected to the world is one on a ball joint
    bob = {"mass": 0.8, "com": [0, 0, -1.0], "inertia": [0.02, 0.03, 0.01]}
    held = zivi.Tree([Body("bob", kind="free", **bob)], constraints=[Connect("bob")])
    joint = zivi.Tree([Body("bob", kind="ball", **bob)])
    spin = [0.5, -1.0, 2.0]
    free = zivi.simulate(held, (0, 2), ([0, 0, 0, 1, 0, 0, 0], [0, 0, 0, *spin]), method(1e-10))
    hung = zivi.simulate(joint, (0, 2), ([1, 0, 0, 0], spin), method(1e-10))
    assert apart(free.qpos[-1, 3:], hung.qpos[-1]) < 1e-8


@pytest.mark.parametrize("mu", [0.1, 0.9])
def test_balls_that_collide_obliquely_rub(mu):
    radii, masses, e, turn = np.array([0.2, 0.3]), np.array([1.0, 1.7]), 0.6, axes(3)
    one, two = (
        Body(name, kind="free", mass=m, inertia=0.4 * m * r**2)
        for name, m, r in zip("ab", masses, radii, strict=True)
    )
    tree = zivi.Tree(
        [one, two],
        contacts=[Contact("a", "b", mu=mu, e=e)],
        shapes={"a": Ball(0.2), "b": Ball(0.3)},
        gravity=[0, 0, 0],
    )
    normal, velocity, spin = turn @ [1, 0, 0], turn @ [-2.0, 0.7, 0.4], turn @ [3.0, -5.0, 4.0]
    apart = 0.5 + 0.5
    place = apart * normal - velocity * 0.25
    start = [*place, 1, 0, 0, 0, *[0] * 3, 1, 0, 0, 0], [*velocity, *spin, *[0] * 6]
    first = zivi.simulate(tree, (0, 0.6), start, method(1e-11))
    hit = first.impacts[0]
    at = float(hit["t"])
    u = place + velocity * at
    u /= np.linalg.norm(u)
    slip = velocity - u * (u @ velocity) + np.cross(spin, -0.2 * u)
    p_n = -(1 + e) * (velocity @ u) / np.sum(1 / masses)
    stick = np.linalg.norm(slip) / (3.5 * np.sum(1 / masses))
    impulse = p_n * u - min(mu * p_n, stick) * slip / np.linalg.norm(slip)
    assert bool(hit["sticks"]) == (stick <= mu * p_n) == (mu == 0.9)
    end = first.qvel[-1]
    np.testing.assert_allclose(end[:3], velocity + impulse / masses[0], atol=1e-9)
    np.testing.assert_allclose(end[6:9], -impulse / masses[1], atol=1e-9)
    kicks = [
        np.cross(-r * u, impulse) / (0.4 * m * r**2) for m, r in zip(masses, radii, strict=True)
    ]
    for k, rate in enumerate([spin + kicks[0], kicks[1]]):
        found = rotation(first.qpos[-1][7 * k + 3 : 7 * k + 7]) @ end[6 * k + 3 : 6 * k + 6]
        np.testing.assert_allclose(found, rate, atol=1e-8)


def test_a_ball_rolls_on_a_ball_until_it_slips():
    # v^2 = 10/7 g l (cos a_0 - cos a), normal force m (g cos a - v^2/l), friction 2/7 m g sin a
    mu, angle = 0.9, 0.1
    ball = Body("ball", kind="free", mass=0.7, inertia=0.4 * 0.7 * 0.1**2)
    tree = zivi.Tree(
        [ball],
        contacts=[Contact("ball", "dome", mu=mu)],
        shapes={"ball": Ball(0.1), "dome": Ball(0.5)},
    )
    across = np.array([0.6, 0.8, 0.0])
    up = np.cos(angle) * np.array([0, 0, 1]) + np.sin(angle) * across
    sol = zivi.simulate(tree, (0, 1.5), ([*(0.6 * up), 1, 0, 0, 0], [0] * 6), method(1e-10))
    slips = float(sol.transitions["t"][sol.transitions["after"] == 1][0])
    place = sol(slips)[0][:3] / 0.6
    sine = np.sqrt(1 - place[2] ** 2)
    assert 17 * place[2] - 10 * np.cos(angle) == pytest.approx(2 * sine / mu, abs=1e-8)
    np.testing.assert_allclose(place[:2], sine * across[:2], atol=1e-9)
    assert float(sol.liftoffs["t"][0]) > slips
    assert not sol.slips[sol.t < slips].any()


# Examples.


def test_the_ball_with_backspin_rolls_as_its_start_says(tmp_path, capsys):
    thrown_back = example("mechanics_backspin")
    thrown_back.main(str(tmp_path / "out.png"))
    sol = thrown_back.throw()
    np.testing.assert_allclose(sol.qvel[-1, :2], thrown_back.ROLLING[:2], atol=2e-8)
    spin = thrown_back.axes_of(sol)[-1] @ sol.qvel[-1, 3:]
    assert spin[2] == pytest.approx(20.0, abs=1e-7)
    assert "0.257142857" in capsys.readouterr().out


def test_the_top_rises_and_keeps_jelletts_integral(tmp_path):
    top = example("mechanics_rising_top")
    sol = top.spin()
    known = top.jellett(sol)
    assert np.ptp(known) < 1e-9 * known[0]
    tilt = np.degrees(np.arccos(top.axis_of(sol)[:, 2]))
    assert tilt[0] > 20
    assert tilt[-1] < 5
    assert len(sol.liftoffs) == 6
    top.draw(str(tmp_path / "out.png"), sol)


# What else a tree does.


def test_batches_files_pickles_and_other_parameters(tmp_path):
    tree, start = thrown(0.2, 0.5), ([0, 0, 0.5, 1, 0, 0, 0], [1.0, 0.5, 0, 0, 3.0, 9.0])
    sol = zivi.simulate(tree, (0, 1), start)
    again = zivi.simulate(pickle.loads(pickle.dumps(tree)), (0, 1), start)
    np.testing.assert_array_equal(again.q, sol.q)
    zivi.files.save(sol, tmp_path / "run.nc")
    loaded = zivi.files.load(tmp_path / "run.nc")
    np.testing.assert_array_equal(loaded.qpos, sol.qpos)
    np.testing.assert_array_equal(loaded.pose("ball")[1], sol.pose("ball")[1])
    rough = tree.replace(**{"ball-slope.mu": 0.4}, e=0.0)
    assert rough.parameters["ball-slope.mu"] == 0.4
    assert rough.e.tolist() == [0.0]
    q, qdot = tree.state(*start)
    batch = zivi.simulate_batch(tree, (0, 1), ([q, q], [qdot, qdot]))
    np.testing.assert_allclose(batch.q[1], sol.q[-1], atol=1e-12)
    assert not {"ball.position.x", "ball.x.mass"} & set(tree.parameters)
    assert [body.name for body in tree.bodies] == ["ball"]


TOP_START = [1, 0, 0, 0], [0.1, 0.2, 3.0]
REFUSED = {
    "damping of body 'a' is not supported for kind='ball'": lambda: Body(
        "a", kind="ball", damping=1.0
    ),
    "parent of body 'a' .* moves in the world": lambda: Body("a", "b", kind="free"),
    "position of body 'a' .* initial state": lambda: Body("a", kind="free", position=[1, 0, 0]),
    "contact 'a-b' is between Box and Ball": lambda: zivi.Tree(
        [OFFSET], contacts=[Contact("a", "b")], shapes={"a": Box([1, 1, 1]), "b": Ball(1)}
    ),
    "plane on a body": lambda: zivi.Tree(
        [OFFSET], contacts=[Contact("body", "b")], shapes={"body": Plane(), "b": Ball(1)}
    ),
    "inputs that turn": lambda: zivi.Tree([OFFSET], inputs={"u": "body.rx"}),
    "MoreauJean cannot be used with body 'body', which rotates in space": lambda: zivi.simulate(
        zivi.Tree([OFFSET]), (0, 1), ([0] * 6, [0] * 6), zivi.MoreauJean(1e-2)
    ),
    "derivatives cannot be used with body 'body'": lambda: zivi.sensitivity(
        zivi.Tree([OFFSET]), (0, 1), ([0] * 6, [0] * 6), wrt=["body.mass"]
    ),
    "derivatives cannot be used with body 'body', .* use differences": lambda: zivi.sensitivity(
        zivi.Tree([OFFSET]), (0, 1), ([0, 0, 0, 1, 0, 0, 0], [0] * 6)
    ),
    "derivatives cannot be used with body 'top'": lambda: zivi.periodic_orbit(
        zivi.Tree([TOP]), TOP_START, period=1.0
    ),
}


@pytest.mark.parametrize("words", sorted(REFUSED))
def test_what_is_not_supported_is_told(words):
    with pytest.raises(NotImplementedError, match=words):
        REFUSED[words]()


BAD = {
    "radius of a ball must be finite and > 0": lambda: Ball(0.0),
    "half_extents of a box must be > 0": lambda: Box([1, 1, 0]),
    "normal of a plane must not be zero": lambda: Plane([0, 0, 0]),
    "must not be given both": lambda: Plane(offset=1.0, point=[0, 0, 0]),
    "between two shapes": lambda: Contact("a", "a"),
    "names the shape 'b'; shapes has 'a'": lambda: zivi.Tree(
        [OFFSET], contacts=[Contact("a", "b")], shapes={"a": Ball(1)}
    ),
    "shapes of the world": lambda: zivi.Tree(
        [OFFSET], contacts=[Contact("a", "b")], shapes={"a": Ball(1), "b": Plane()}
    ),
    "names the body 'c'": lambda: zivi.Tree(
        [OFFSET], contacts=[Contact("a", "b")], shapes={"a": Ball(1, body="c"), "b": Plane()}
    ),
    "must have length 1, got 2": lambda: zivi.Tree([OFFSET]).state([0, 0, 0, 2, 0, 0, 0]),
    "qpos must be 7 finite numbers": lambda: zivi.Tree([OFFSET]).state([0, 0, 0]),
    "mu of the gap of body 'body' must be >= 0": lambda: zivi.Tree(
        [OFFSET], contacts=[Contact("body", "b", mu=-1)], shapes={"body": Ball(1), "b": Plane()}
    ),
    "gaps\\[0\\] must be|names 'body.rx'": lambda: zivi.Tree(
        [OFFSET], gaps=[zivi.mechanics.JointLimit("body.rx", 0.0)]
    ),
}


@pytest.mark.parametrize("words", sorted(BAD))
def test_bad_input_is_named(words):
    with pytest.raises(ValueError, match=words):
        BAD[words]()


def test_a_body_in_space_slips_in_two_directions_and_one_in_a_plane_in_one():
    yaw = Body("yaw", axis=[0, 0, 1], mass=1.0, inertia=0.1, com=[1, 0, 0])
    pitch = Body("pitch", "yaw", axis=[0, 1, 0], mass=1.0, inertia=0.1, com=[1, 0, 0])
    slides = [Body("x", kind="slide", axis=[1, 0, 0]),
              Body("y", "x", "slide", axis=[0, 1, 0]),
              Body("z", "y", "slide", mass=1.0)]  # fmt: skip
    tip = {"point": [1, 0, 0], "mu": 0.3, "name": "tip"}
    assert zivi.Tree([yaw, pitch], gaps=[PlaneGap("pitch", **tip)]).channel_names == (
        "tip[0]",
        "tip[1]",
    )
    puck = zivi.Tree(slides, gaps=[PlaneGap("z", mu=0.3)])
    sol = zivi.simulate(puck, (0, 1), ([0, 0, 0], [0.6, 0.8, 0.0]))
    assert sol.transitions["t"][-1] == pytest.approx(1 / 2.943, abs=1e-14)
    bodies = [slides[0], Body("z", "x", "slide", mass=1.0)]
    cart = zivi.Tree(bodies, gaps=[PlaneGap("z", mu=0.3)])
    assert cart.channel_names == ("z",)


# Files of the command line.

FILE = f"""
t_span = [0.0, 3.0]
y0 = [[0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0, -30.0, 0.0]]
[[system.bodies]]
name = "ball"
kind = "free"
mass = 1.3
inertia = {0.4 * 1.3 * 0.2**2!r}
[system.shapes]
ball = {{ kind = "ball", radius = 0.2 }}
floor = {{ kind = "plane" }}
[[system.contacts]]
first = "ball"
second = "floor"
mu = 0.3
e = 0.5
[method]
rtol = 1e-9
atol = 1e-9
"""


def test_a_file_has_shapes_and_contacts(tmp_path):
    path = tmp_path / "ball.toml"
    path.write_text(FILE)
    sol = zivi.files.prepare_simulate(path).run()
    start = [0, 0, 1, 1, 0, 0, 0], [2, 0, 0, 0, -30, 0]
    true = zivi.simulate(thrown(0.3, 0.5), (0, 3), start, method(1e-9))
    # it rolls with the momentum about the point of contact
    assert sol.qvel[-1, 0] == pytest.approx((5 * 2.0 - 2 * 0.2 * 30.0) / 7, abs=1e-9)
    assert np.array_equal(sol.q, true.q)
    zivi.files.save(sol, tmp_path / "ball.nc")
    again = zivi.files.load(tmp_path / "ball.nc")
    assert np.array_equal(again.qpos, sol.qpos)
    assert np.array_equal(again.pose("ball")[1], sol.pose("ball")[1])
    assert np.array_equal(again(1.3), sol(1.3))


def test_all_shapes_of_a_file_are_those_of_python(tmp_path):
    shapes = {
        "bob": Ball(0.3, [0, 0.1, 0.2], body="body"),
        "post": Ball(0.2, [3, 1, 2]),
        "box": Box([0.1, 0.2, 0.3], [0, 0.1, 0], body="body"),
        "rod": Capsule(0.05, 0.4, [1, 1, 0], body="body"),
        "slope": Plane([1, -2, 3], point=[0, 0, -3]),
    }
    contacts = [
        Contact("box", "slope", mu=0.3, mu_static=0.4, e=0.2),
        Contact("rod", "slope", name="hull"),
        Contact("post", "bob", mu=0.2),
    ]
    tree = zivi.Tree([OFFSET, TOP], contacts=contacts, shapes=shapes, e=0.4)
    start = [0.1, 0.2, 0.3, 0.6, 0, 0.8, 0, 1, 0, 0, 0], np.linspace(-1, 1, 9)
    written = zivi.files.tree_text(tree, (0, 0.2), start)  # contacts as gaps
    given = written[: written.index("[[system.gaps]]")]
    laws = next(line for line in given.splitlines() if line.startswith("e ="))
    given = given.replace(laws, "e = 0.4")
    given += """
    [system.shapes]
    bob = { kind = "ball", radius = 0.3, center = [0, 0.1, 0.2], body = "body" }
    post = { kind = "ball", radius = 0.2, center = [3, 1, 2] }
    box = { kind = "box", half_extents = [0.1, 0.2, 0.3], center = [0, 0.1, 0], body = "body" }
    rod = { kind = "capsule", radius = 0.05, half_length = 0.4, axis = [1, 1, 0], body = "body" }
    slope = { kind = "plane", normal = [1, -2, 3], point = [0, 0, -3] }
    [[system.contacts]]
    first = "box"
    second = "slope"
    mu = 0.3
    mu_static = 0.4
    e = { law = "NewtonImpact", e = 0.2 }
    [[system.contacts]]
    first = "rod"
    second = "slope"
    name = "hull"
    [[system.contacts]]
    first = "post"
    second = "bob"
    mu = 0.2
    """
    true = zivi.simulate(tree, (0, 0.2), start)
    for text in (written, given):
        path = tmp_path / "tree.toml"
        path.write_text(text)
        again = zivi.files.prepare_simulate(path).run()
        for name in ("gap_names", "channel_names", "coordinate_names", "config"):
            assert getattr(again, name) == getattr(true, name)
        assert np.array_equal(again.q, true.q)
    states = tree.state(*start)  # a state in coordinates of a run is one, too
    assert "y0" in zivi.files.tree_text(tree, (0, 0.2), states)
    with pytest.raises(ValueError, match="y0 must have lists of 11 and 9 or two of 9, got"):
        zivi.files.tree_text(tree, (0, 0.2), ([0.0], [0.0]))


def test_what_a_file_of_a_tree_does_not_have_is_refused():
    slide = Body("a", kind="slide", axis=[0, 0, 1], mass=1.0)
    driven = zivi.Tree([slide], inputs={"push": "a"})
    with pytest.raises(NotImplementedError, match="inputs are not supported"):
        zivi.files.tree_text(driven, (0, 1), ([0.0], [0.0]))
    soft = zivi.Tree([slide], gaps=[PlaneGap("a", contact=zivi.Hertz(1e5))])
    with pytest.raises(NotImplementedError, match=r"compliant gaps \(a\) are not supported"):
        zivi.files.tree_text(soft, (0, 1), ([0.0], [0.0]))


@pytest.mark.parametrize(
    ("line", "wrong", "told"),
    [
        ('"plane"', '"plane", normal = [0, 0, 0]', r"system.shapes.floor.normal .* not be zero"),
        ('"plane"', '"plane", radius = 1', "system.shapes.floor.radius is not a setting of plane"),
        ("radius = 0.2", "radius = 0", "system.shapes.ball.radius must be a finite number > 0"),
        ("radius = 0.2", 'radius = 1, body = "x"', "system.shapes.ball names the body 'x'"),
        ('kind = "ball"', 'kind = "cone"', 'shapes.ball.kind must be one of "ball", "box", "caps'),
        ('"plane"', '"box", half_extents = [1, 1, 1]', "is between Ball and Box, which is not"),
        ('second = "floor"', 'second = "flor"', "names the shape 'flor'; shapes has 'ball', 'floo"),
        ('second = "floor"', 'second = "ball"', r"system.contacts\[0\]: a contact must be between"),
        ('second = "floor"', "", r"system.contacts\[0\].second is missing: another shape"),
        ("e = 0.5", "e = 2", r"system.contacts\[0\].e must be a finite number >= 0 and <= 1"),
        ('kind = "free"', 'kind = "free"\nstiffness = 1', "stiffness of body 'ball' is not supp"),
        ("1.0, 1.0, 0.0", "1.0, 2.0, 0.0", "y0 of body 'ball' must have length 1, got 2"),
        ("[[0.0, 0.0, 1.0", "[[1.0", r"y0 must be \(qpos, qvel\) with 7 and 6 numbers"),
    ],
)
def test_wrong_shapes_of_a_file_name_their_key(tmp_path, line, wrong, told):
    path = tmp_path / "ball.toml"
    assert FILE.count(line) == 1
    path.write_text(FILE.replace(line, wrong))
    with pytest.raises(zivi.files.FileError, match=told):
        zivi.files.prepare_simulate(path).run()


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9])
@pytest.mark.parametrize(
    ("mass", "inertia"),
    [(5.0, [0.02, 0.05, 0.06]), (10.0, [0.1, 0.3, 0.35]), (10.0, [0.12, 0.2, 0.25])],
)
def test_a_trunk_that_rocks_on_pairs_of_feet_lands_them_together(mass, inertia, tolerance):
    """It stays in its plane of symmetry although rounding has one foot of a pair arrive first."""
    feet = [(x, y) for x in (0.2, -0.2) for y in (0.1, -0.1)]
    tree = zivi.Tree(
        [Body("trunk", kind="free", mass=mass, inertia=inertia)],
        shapes={
            "floor": Plane((0, 0, 1)),
            **{f"foot{i}": Ball(0.02, (*feet[i], -0.3), "trunk") for i in range(4)},
        },
        contacts=[Contact(f"foot{i}", "floor", mu=1.0, e=0.0) for i in range(4)],
    )
    method = zivi.SwitchedRK(rtol=tolerance, atol=1e-3 * tolerance)
    start = [0, 0, 0.5, 1, 0, 0, 0], [0, 0, 0, 0, 0.5, 0]
    sol = zivi.simulate(tree, (0, 1.5), start, method)
    assert sol.success, sol.message
    assert np.abs(sol.qvel[:, [1, 3, 5]]).max() < 1e-10
    assert np.abs(sol.qvel[-1]).max() < 1e-12
    assert sol.contacts[-1].all()
    groups = np.unique(sol.impacts["group"], return_counts=True)[1]
    assert (groups == 2).all()
