"""Constraints of trees: connected, welded, driven and coupled joints, and those of MuJoCo."""

import pickle

import numpy as np
import pytest

import zivi
from example_scripts import example
from zivi.mechanics import Body, Connect, Couple, Drive, LinearGap, PlaneGap, Weld

assert LinearGap is zivi.LinearGap
PLACE = (0.40629933532052935, 2.4507255973128107)
"""Angle of the rod and place of the slider at a crank of 30 rad."""


def slider_crank(*constraints, **more):
    """A crank of 1 m, a rod of 2.5 m, a slider along x: the rod turns relative to the crank."""
    bodies = [
        Body("crank", mass=1.0, com=[0.5, 0, 0], inertia=0.1),
        Body("rod", "crank", position=[1, 0, 0], mass=2.0, com=[1.25, 0, 0], inertia=1.0),
        Body("slider", kind="slide", axis=[1, 0, 0], mass=0.5),
    ]
    pin = Connect("rod", "slider", point=[2.5, 0, 0], other_point=[0, 0, 0], name="pin")
    return zivi.Tree(bodies, constraints=[pin, *constraints], gravity=[0, -9.81, 0], **more)


@pytest.mark.parametrize("turns", ["3*t", zivi.HarmonicWall(0.5, 2.0, 0.0, 0.1)])
def test_a_driven_crank_moves_the_slider_exactly(turns):
    system = slider_crank(Drive("crank", turns))
    assert system.equality_names == ("pin.x", "pin.y", "pin.z", "crank.drive")
    q, qdot = zivi.consistent(system, [0.0, 0.0, 3.5])
    for tol in (1e-6, 1e-12):
        sol = zivi.simulate(system, (0, 10), (q, qdot), zivi.SwitchedRK(rtol=tol, atol=tol))
        th = 30.0 if turns == "3*t" else turns._at(10.0)[0]
        ph = -np.arcsin(np.sin(th) / 2.5)
        place = np.cos(th) + 2.5 * np.cos(ph)
        assert abs(sol.q[-1, 0] - th) <= 1e-14
        assert abs(sol.q[-1, 2] - place) < 1e-14
        assert turns != "3*t" or abs(sol.q[-1, 2] - PLACE[1]) < 1e-14
    # rows without a gradient act on nothing: no force is undetermined
    assert len(sol.flags) == 0
    assert not sol.constraint_forces[:, 2].any()


def test_a_table_drives_a_joint_and_its_torque_is_that_of_newton():
    t = np.linspace(0.0, 2.0, 41)
    table = zivi.Table(t, np.sin(3.0 * t), "cubic")
    arm = Body("arm", mass=2.0, com=[0.5, 0, 0], inertia=0.3)
    system = zivi.Tree([arm], constraints=[Drive("arm", table)], gravity=[0, -9.81, 0])
    sol = zivi.simulate(system, (0, 2), zivi.consistent(system, [0.0]), t_eval=t[:-1] + 0.01)
    motion = np.array([table._at(time) for time in sol.t])
    assert np.abs(sol.q[:, 0] - motion[:, 0]).max() < 1e-7
    torque = 0.8 * motion[:, 2] + 2.0 * 9.81 * 0.5 * np.cos(motion[:, 0])
    assert np.abs(sol.constraint_forces[:, 0] - torque).max() < 1e-5


def test_a_free_slider_crank_keeps_its_energy_and_the_pin():
    system = slider_crank()
    start = zivi.consistent(system, [1.0, -1.3, 2.9], [2.0, 0.0, 0.0])
    sol = zivi.simulate(system, (0, 5), start, zivi.SwitchedRK(rtol=1e-11, atol=1e-11))

    def energy(q, w):
        here = system.at(0.0, q, w)
        ph = q[0] + q[1]
        height = 0.5 * np.sin(q[0]) + 2.0 * (np.sin(q[0]) + 1.25 * np.sin(ph))
        return 0.5 * w @ here.mass @ w + 9.81 * height

    energies = [energy(q, w) for q, w in zip(sol.q, sol.qdot, strict=True)]
    assert np.ptp(energies) < 1e-8
    ends = np.cos(sol.q[:, 0]) + 2.5 * np.cos(sol.q[:, 0] + sol.q[:, 1]) - sol.q[:, 2]
    assert np.abs(ends).max() <= 1e-14


def spatial(*constraints):
    """Three bodies whose axes are skew."""
    return zivi.Tree(
        [
            Body("a", axis=[0, 0, 1], mass=1.0, com=[0.3, 0.1, 0], inertia=[0.1, 0.2, 0.3]),
            Body(
                *("b", "a"),
                position=[1, 0, 0.2],
                axis=[0, 1, 0.3],
                anchor=[0.1, 0, 0.05],
                mass=2.0,
                com=[0.4, 0, 0.1],
                inertia=[0.3, 0.1, 0.2],
            ),
            Body("c", "b", position=[0.8, 0.1, 0], axis=[1, 0.2, 0], mass=0.7, inertia=0.1),
        ],
        constraints=constraints,
    )


def test_a_weld_makes_two_bodies_one():
    welded = spatial(Weld("b", "a"))
    held = spatial(Couple("b", None, coefficients=[0.0]))
    start = ([0.4, 0.0, -0.3], [1.0, 0.0, 2.0])
    one = zivi.simulate(welded, (0, 2), start, zivi.SwitchedRK(rtol=1e-11, atol=1e-11))
    two = zivi.simulate(held, (0, 2), start, zivi.SwitchedRK(rtol=1e-11, atol=1e-11))
    assert welded.equality_names == tuple(f"b-a.{it}" for it in ("x", "y", "z", "rx", "ry", "rz"))
    assert np.abs(one.q[-1] - two.q[-1]).max() < 1e-9
    assert np.abs(one.q[:, 1]).max() < 1e-14
    # six rows hold one coordinate
    assert list(one.flags["kind"]) == ["undetermined_forces"]
    # at another angle, by the rotation between the frames
    turned = Body("b", axis=[0, 1, 0.3]).axis / np.linalg.norm([0, 1, 0.3])
    c, s = np.cos(0.5), np.sin(0.5)
    x, y, z = turned
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + s * cross + (1 - c) * cross @ cross
    other = spatial(Weld("b", "a", rotation=rotation, point=[0.1, 0, 0.05], name="weld"))
    q, _ = zivi.consistent(other, [0.4, 0.45, -0.3])
    assert abs(q[1] - 0.5) < 1e-12


def test_curvatures_of_connections_are_derivatives_along_the_motion():
    system = spatial(Connect("c", None, point=[0.3, 0.2, 0.1]), Weld("c", "a"), Couple("c", "b"))
    rng = np.random.default_rng(2)
    q, w, a = rng.normal(size=(3, 3))
    h = 1e-4

    def rates(s):
        here = system.at(0.0, q + s * w + 0.5 * s**2 * a, w + s * a)
        return here.equality_gradients @ (w + s * a)

    found = (8 * (rates(h) - rates(-h)) - (rates(2 * h) - rates(-2 * h))) / (12 * h)
    here = system.at(0.0, q, w)
    assert np.abs(here.equality_gradients @ a + here.equality_curvatures - found).max() < 1e-8


def test_a_gear_is_that_of_the_reduced_inertia():
    discs = [
        Body("pinion", inertia=0.1, torque=1.0, mass=1.0),
        Body("wheel", inertia=0.8, mass=1.0),
    ]
    gear = zivi.Tree(discs, constraints=[Couple("wheel", "pinion", coefficients=[0.0, -0.5])])
    sol = zivi.simulate(gear, (0, 2), ([0, 0], [0, 0]))
    rate = 1.0 / (0.1 + 0.25 * 0.8)
    assert np.abs(sol.q[-1] - [2.0 * rate, -rate]).max() < 1e-12
    assert np.abs(sol.constraint_forces + 0.8 * 0.5 * rate).max() < 1e-12


def test_a_closed_chain_falls_on_the_floor_and_rests():
    bar = {"axis": [0, 1, 0], "mass": 1.0, "com": [0, 0, -0.5], "inertia": 0.08}
    bodies = [Body("left", **bar), Body("right", position=[1, 0, 0], **bar)]
    bodies.insert(
        1, Body("rod", "left", position=[0, 0, -1], axis=[0, 1, 0], mass=1.0, inertia=0.1)
    )
    pin = Connect("rod", "right", point=[1, 0, 0], other_point=[0, 0, -1])
    floor = PlaneGap("rod", point=[1, 0, 0], offset=-0.8, name="floor")
    system = zivi.Tree(bodies, gaps=[floor], constraints=[pin], e=0.5)
    start = zivi.consistent(system, [1.3, -1.3, 1.3])
    sol = zivi.simulate(system, (0, 9), start)
    assert sol.rest_time is not None
    assert np.abs(np.abs(sol.q[-1, 0]) - np.arccos(0.8)) < 1e-10
    assert len(sol.zeno) == 1


def test_trees_with_constraints_are_copied_and_changed():
    system = slider_crank(Drive("crank", "3*t"))
    assert "equalities=(pin.x, pin.y, pin.z, crank.drive)" in repr(system)
    for other in (pickle.loads(pickle.dumps(system)), system.replace(**{"slider.mass": 2.0})):
        start = zivi.consistent(other, [0.0, 0.0, 3.5])
        assert abs(zivi.simulate(other, (0, 10), start).q[-1, 2] - PLACE[1]) < 1e-14
    assert len(system.constraints) == 2
    with pytest.raises(NotImplementedError, match="constraints are not supported"):
        zivi.files.tree_text(system, (0, 1), (np.zeros(3), np.zeros(3)))
    with pytest.raises(NotImplementedError, match="equality rows are not supported"):
        zivi.export_fmu("crank.fmu", system, y0=zivi.consistent(system, [0.0, 0.0, 3.5]))


@pytest.mark.parametrize(
    ("constraint", "error", "told"),
    [
        (Connect("rod", "crane"), ValueError, "names 'crane': there are crank, rod, slider"),
        (Drive("wheel", "t"), ValueError, "names 'wheel': there are crank, rod, slider"),
        (Drive("crank", "omega*t"), ValueError, "motion of joint 'crank' has omega"),
        (3.0, TypeError, "must be a Connect, Weld, Drive or Couple"),
    ],
)
def test_wrong_constraints_are_named(constraint, error, told):
    with pytest.raises(error, match=told):
        slider_crank(constraint)


def test_wrong_arguments_of_constraints_are_named():
    with pytest.raises(ValueError, match="must be three finite numbers"):
        Connect("rod", point=[1.0, 2.0])
    with pytest.raises(ValueError, match="other of the constraint of body 'rod'"):
        Weld("rod", "rod")
    with pytest.raises(ValueError, match=r"must be a rotation of shape \(3, 3\)"):
        Weld("rod", rotation=2 * np.eye(3))
    with pytest.raises(TypeError, match="formula in t"):
        Drive("crank", 3.0)
    with pytest.raises(ValueError, match="of kind 'cubic' or 'monotone'"):
        Drive("crank", zivi.Table([0.0, 1.0], [0.0, 1.0], "linear"))
    with pytest.raises(ValueError, match="one to five finite numbers"):
        Couple("crank", coefficients=[0.0] * 6)


MJCF = """
<mujoco><option gravity="0 -9.81 0"/><compiler angle="radian"/>
<worldbody>
 <body name="crank"><joint name="crank" axis="0 0 1"/>
  <inertial pos=".5 0 0" mass="1" diaginertia=".1 .1 .1"/>
  <body name="rod" pos="1 0 0"><joint name="rod" axis="0 0 1"/>
   <inertial pos="1.25 0 0" mass="2" diaginertia="1 1 1"/></body></body>
 <body name="slider" pos="3.5 0 0"><joint name="slider" type="slide" axis="1 0 0"/>
  <inertial pos="0 0 0" mass=".5" diaginertia="1 1 1"/></body>
 <body name="a" pos="0 5 0"><joint name="a" axis="0 0 1"/>
  <inertial pos=".3 0 0" mass="1" diaginertia=".1 .1 .1"/>
  <body name="b" pos="1 0 0" quat=".8 0 0 .6"><joint name="b" axis="0 0 1"/>
   <inertial pos=".4 0 0" mass="1" diaginertia=".1 .1 .1"/></body></body>
 <body name="gear" pos="0 9 0"><joint name="gear" axis="0 0 1"/>
  <inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/></body>
</worldbody>
<equality>
 <connect name="pin" body1="rod" body2="slider" anchor="2.5 0 0"/>
 <weld name="weld" body1="a" body2="b"/>
 <joint name="gear" joint1="gear" joint2="crank" polycoef="0 -2 0 0 0"/>
 <connect name="off" body1="gear" anchor="1 0 0" active="false"/>
</equality></mujoco>
"""


def test_equality_constraints_of_mujoco_are_read():
    mujoco = pytest.importorskip("mujoco")
    tree = zivi.Tree.from_mjcf(MJCF)
    kinds = [type(it).__name__ for it in tree.constraints]
    assert kinds == ["Connect", "Weld", "Couple"]
    assert tree.equality_names[:3] == ("pin.x", "pin.y", "pin.z")
    q = np.zeros(6)
    assert np.abs(tree.at(0.0, q, q).equalities).max() < 1e-14
    start = zivi.consistent(tree, [0.7, -1.0, -0.5, 0.4, 0.1, -1.0], np.ones(6))
    assert abs(start[0][5] + 2 * start[0][0]) < 1e-14
    # accelerations without constraint forces are those of MuJoCo, whose rows vanish there too
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = start
    mujoco.mj_forward(model, data)
    rows = np.array(data.efc_pos)[: data.ne]
    assert data.ne >= 10
    assert np.abs(rows).max() < 1e-10
    # the slider-crank of the file is that of its numbers
    other = slider_crank()
    moved = zivi.simulate(tree, (0, 1), start, zivi.SwitchedRK(rtol=1e-10, atol=1e-10))
    assert moved.status is zivi.Status.COMPLETED
    ends = np.cos(moved.q[:, 0]) + 2.5 * np.cos(moved.q[:, 0] + moved.q[:, 1])
    assert np.abs(ends - 3.5 - moved.q[:, 2]).max() <= 1e-13
    assert other.equality_names == ("pin.x", "pin.y", "pin.z")


def test_the_example_is_its_closed_form():
    slider = example("mechanics_slider_crank")
    driven, free = slider.run()
    assert abs(driven.q[-1, 2] - slider.place(15.0)) < 1e-15
    tree = slider.system()
    energies = [slider.energy(tree, q, w) for q, w in zip(free.q, free.qdot, strict=True)]
    assert np.ptp(energies) < 1e-9
    assert max(abs(slider.place(q[0]) - q[2]) for q in free.q) < 1e-15
