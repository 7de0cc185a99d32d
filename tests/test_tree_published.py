"""Trees read models as they are published: one small model for each feature, against MuJoCo."""

import numpy as np
import pytest

import zivi
import zivi.interop.mujoco
from test_tree_mujoco import Reference, check, close, states
from tree_models import ARM, HOPPER, URDF

mujoco = pytest.importorskip("mujoco")

WALKER = """
<mujoco model="walker">
  <compiler angle="radian" autolimits="true"/>
  <size nstack="300000" njmax="500"/>
  <default>
    <joint armature=".1" damping=".2"/>
    <geom condim="3" contype="1" conaffinity="0" friction=".4 .1 .1"/>
    <motor ctrlrange="-1 1" ctrllimited="true"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="40 40 40" conaffinity="1" friction=".9 .1 .1"/>
    <body name="torso" pos="0 0 .9">
      <joint name="rootx" type="slide" axis="1 0 0" armature="0" damping="0"/>
      <joint name="rootz" type="slide" axis="0 0 1" armature="0" damping="0"/>
      <joint name="rooty" axis="0 1 0" armature="0" damping="0"/>
      <geom name="back" type="capsule" fromto="-.3 0 0 .3 0 0" size=".05"/>
      <geom name="badge" type="sphere" size=".02" mass="0" contype="0"/>
      <body name="leg" pos="-.3 0 0">
        <joint name="hip" axis="0 1 0" range="-1 1" margin=".01" frictionloss=".3"/>
        <geom name="shin" type="capsule" fromto="0 0 0 .1 0 -.5" size=".04"/>
        <body name="foot" pos=".1 0 -.5">
          <joint name="ankle" axis="0 1 0" range="-.6 .6"/>
          <geom name="sole" type="box" size=".1 .05 .02" pos=".05 0 -.05"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="thigh" joint="hip" gear="90"/>
    <position joint="ankle" kp="40" kv="2"/>
  </actuator>
</mujoco>
"""


def walker(**more):
    return zivi.Tree.from_mjcf(WALKER, **more)


# Which gaps there are.


def test_all_gaps_are_limits_and_what_may_touch_a_plane():
    tree = walker(gaps="all")
    assert tree.gap_names == (
        *("hip.lower", "hip.upper", "ankle.lower", "ankle.upper"),
        *("back-floor.0", "back-floor.1", "shin-floor.0", "shin-floor.1"),
        *("sole-floor.0", "sole-floor.1", "sole-floor.4", "sole-floor.5"),
    )
    assert walker().gap_names == tree.gap_names[:4]
    named = walker(gaps=["hip", "ankle", *[(it, "floor") for it in ("back", "shin", "sole")]])
    assert named.gap_names == tree.gap_names
    smooth = walker(gaps="all", friction="ignore")
    assert smooth.gap_names == tree.gap_names
    assert smooth.channel_names == ()
    # a pair without friction has all corners
    smooth = walker(gaps=[("sole", "floor")], friction="ignore")
    assert smooth.gap_names == tuple(f"sole-floor.{k}" for k in range(8))


def test_flags_take_constraints_away():
    flag = "<option><flag {}/></option><default>"
    for switched_off, limits, pairs, joints in (
        ('limit="disable"', 0, 8, 1),
        ('contact="disable"', 4, 0, 1),
        ('frictionloss="disable"', 4, 8, 0),
        ('constraint="disable"', 0, 0, 0),
    ):
        text = WALKER.replace("<default>", flag.format(switched_off), 1)
        tree = zivi.Tree.from_mjcf(text, gaps="all")
        assert len(tree.gap_names) == limits + pairs
        assert len(tree.channel_names) == pairs + joints


def test_points_that_are_always_one_are_one_gap():
    # the upper ends of both legs are the end of the trunk
    leg = """<body name="{0}" pos="-.3 0 0"><joint name="{0}" axis="0 1 0"/>
      <geom name="{0}" type="capsule" fromto="0 0 0 0 0 -.4" size=".05"/></body>"""
    text = f"""<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
      <body name="trunk" pos="0 0 1"><joint type="slide" axis="1 0 0"/><joint type="slide"/>
      <joint axis="0 1 0"/><geom name="trunk" type="capsule" fromto="-.3 0 0 .3 0 0" size=".05"/>
      {leg.format("left")}{leg.format("right")}</body></worldbody></mujoco>"""
    tree = zivi.Tree.from_mjcf(text, gaps="all")
    ends = ["trunk-floor.0", "trunk-floor.1", "left-floor.0", "right-floor.0"]
    assert sorted(tree.gap_names) == sorted(ends)


def test_masks_pairs_and_exclusions_decide_what_may_touch():
    text = """<mujoco><worldbody>
      <geom name="floor" type="plane" size="1 1 1" contype="2" conaffinity="4"/>
      <geom name="wall" type="plane" size="1 1 1" pos="3 0 0" euler="0 -90 0" contype="0"
        conaffinity="0"/>
      <body name="cart"><joint name="x" type="slide" axis="1 0 0"/>
        <geom name="none" size=".1"/>
        <geom name="one" size=".1" contype="4"/><geom name="two" size=".2" conaffinity="2"/>
        <geom name="both" size=".1" contype="3" conaffinity="5"/></body>
      <body name="lift"><joint name="z" type="slide"/>
        <geom name="bob" size=".1" contype="4"/></body>
      <body name="fixed"><geom name="stone" size=".1" contype="4"/></body>
      </worldbody><contact><pair geom1="wall" geom2="both" friction=".2 .2 .1 .1 .1"/>
      <exclude body1="world" body2="lift"/></contact></mujoco>"""
    tree = zivi.Tree.from_mjcf(text, gaps="all")
    assert tree.gap_names == ("one-floor", "two-floor", "both-wall")
    assert tree.channel_names == ("one-floor", "two-floor")  # along the wall the cart has no motion
    assert tree.parameters["one-floor.mu"] == 1.0


# Dry friction.


def test_friction_of_pairs_is_the_greater_one():
    tree = walker(gaps="all")
    feet = [name for name in tree.gap_names if "-floor" in name]
    assert tree.channel_names == (*feet, "hip")
    assert {tree.parameters[f"{name}.mu"] for name in feet} == {0.9}
    assert tree.parameters["hip.friction"] == 0.3
    with pytest.raises(
        NotImplementedError, match=r"friction of pairs is not supported: 'back-floor'; friction='ig"
    ):
        walker(gaps="all", friction="refuse")
    with pytest.raises(NotImplementedError, match=r"not supported: joint 'hip'; friction='read'"):
        walker(friction="refuse")


@pytest.mark.parametrize(
    ("floor", "geom", "mu"),
    [
        ('friction=".2"', 'friction=".7"', 0.7),
        ('friction=".2" priority="1"', 'friction=".7"', 0.2),
        ('friction=".2" condim="1" priority="2"', 'friction=".7" priority="1"', None),
        ('friction=".2" condim="1"', 'friction=".3" condim="3"', 0.3),
        ('condim="1"', 'condim="1"', None),
        ('friction="0"', 'friction="0"', None),
    ],
)
def test_the_coefficient_is_that_of_mujoco(floor, geom, mu):
    text = f"""<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1" {floor}/>
      <body name="b" pos="0 0 .05"><joint type="slide" axis="1 0 0"/><joint type="slide"/>
      <geom name="g" size=".1" mass="1" {geom}/></body></worldbody></mujoco>"""
    tree = zivi.Tree.from_mjcf(text, gaps="all")
    assert tree.parameters.get("g-floor.mu") == mu
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert (data.contact[0].dim > 1 and data.contact[0].friction[0] > 1e-4) == (mu is not None)
    if mu is not None:
        assert data.contact[0].friction[0] == mu


def test_a_pair_has_its_own_friction():
    of = '<contact><pair geom1="floor" geom2="g" condim="3" friction="{} .1 .1 .1"/></contact>'
    text = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1" contype="0"/>
      <body name="b"><joint type="slide" axis="1 0 0"/><joint type="slide"/>
      <geom name="g" size=".1" mass="1" contype="0"/></body></worldbody>{}</mujoco>"""
    tree = zivi.Tree.from_mjcf(text.format(of.format(".3 .3")), gaps="all")
    assert tree.parameters["g-floor.mu"] == 0.3
    with pytest.raises(
        NotImplementedError, match="differs by direction is not supported: pair 'g-floor'"
    ):
        zivi.Tree.from_mjcf(text.format(of.format(".3 .4")), gaps="all")


def test_geoms_that_move_in_space_slip_in_two_directions():
    text = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><body name="b">
      <joint name="yaw" axis="0 0 1"/><joint name="pitch" axis="0 1 0"/>
      <geom name="g" size=".1" pos=".5 0 0"/></body></worldbody></mujoco>"""
    tree = zivi.Tree.from_mjcf(text, gaps="all")
    assert tree.channel_names == ("g-floor[0]", "g-floor[1]")
    twisted = text.replace('name="g"', 'name="g" condim="4"')
    with pytest.raises(NotImplementedError, match=r"torsional .* 'g-floor'; condim='3'"):
        zivi.Tree.from_mjcf(twisted, gaps="all")
    smooth = zivi.Tree.from_mjcf(twisted, gaps="all", friction="ignore")
    assert smooth.gap_names == ("g-floor",)
    assert smooth.channel_names == ()


def test_friction_of_a_joint_stops_a_pendulum():
    # Coulomb's decrement: each half turn takes 2 L/k off the amplitude
    text = """<mujoco><option gravity="0 0 0"/><worldbody><body name="wheel">
      <inertial pos="0 0 0" mass="1" diaginertia=".3 .3 .3"/>
      <joint name="j" axis="0 1 0" stiffness="2" frictionloss=".17"/></body></worldbody></mujoco>"""
    sol = zivi.simulate(
        zivi.Tree.from_mjcf(text),
        (0, 20),
        ([1.0], [0.0]),
        method=zivi.SwitchedRK(rtol=1e-12, atol=1e-13),
    )
    assert sol.q[-1, 0] == pytest.approx(1 - 6 * 0.17, abs=1e-10)
    assert sol.transitions["t"][-1] == pytest.approx(6 * np.pi * np.sqrt(0.3 / 2), abs=1e-10)


def test_the_walker_is_that_of_mujoco_and_stands():
    tree = walker(gaps="all")
    reference = Reference(WALKER)
    for q, w in states(reference.m):
        here, (mass, force) = tree.at(0.0, q, w), reference.at(q, w)
        close(here.mass, mass)
        close(here.force, force)
        # the slip of the ends of the shin, from MuJoCo's Jacobians of the point of contact
        for k, z in enumerate((-1, 1)):
            place = tree.gap_names.index(f"shin-floor.{k}")
            half = reference.m.geom("shin").size[1]
            at, *_ = reference.point("shin", (0, 0, z * half))
            jac = np.zeros((3, 6 - 1))
            body = int(reference.m.geom_bodyid[reference.m.geom("shin").id])
            mujoco.mj_jac(reference.m, reference.d, jac, None, at - [0, 0, 0.04], body)
            close(here.tangents[tree.channel_names.index(tree.gap_names[place])], jac[0])
    start = np.zeros(5)
    sol = zivi.simulate(tree, (0, 0.5), (start, start))
    assert sol.success
    assert len(sol.impacts) > 3
    assert np.all(sol.slips[sol.modes == 0] == 0.0)


# Margins, sizes, and the forms in which a model may be given.


def test_margins_of_limits_are_not_read():
    assert np.allclose(walker().at(0, np.zeros(5), np.zeros(5)).gaps, [1, 1, 0.6, 0.6], atol=1e-15)


def test_margins_of_geoms_are_left_out_with_a_warning():
    text = WALKER.replace('size="40 40 40"', 'size="40 40 40" margin=".01" gap=".002"')
    with pytest.warns(zivi.ModelWarning, match=r"margin of 'shin-floor', 0\.01 m, is left out"):
        tree = zivi.Tree.from_mjcf(text, gaps=[("shin", "floor")])
    known, zeros = walker(gaps=[("shin", "floor")]), np.zeros(5)
    assert np.array_equal(tree.at(0, zeros, zeros).gaps, known.at(0, zeros, zeros).gaps)


WHEEL = """
<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><body name="cart" pos="0 0 .3">
  <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide"/>
  <inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/>
  <body name="wheel"><joint name="spin" axis="0 1 0"/>
    <geom name="tyre" type="cylinder" size=".1 .02" pos=".03 0 0" euler="90 0 0" condim="3"
      friction=".5"/></body>
</body></worldbody></mujoco>
"""


def test_a_cylinder_that_rolls_is_a_disc():
    tree = zivi.Tree.from_mjcf(WHEEL, gaps="all")
    assert tree.gap_names == tree.channel_names == ("tyre-floor",)
    model = mujoco.MjModel.from_xml_string(WHEEL)
    data, ends = mujoco.MjData(model), np.zeros(6)
    for q in np.random.default_rng(1).uniform(-1, 1, (20, 3)):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        distance = mujoco.mj_geomDistance(model, data, 0, 1, 9.0, ends)
        if distance > 0.0:
            assert tree.at(0.0, q, np.zeros(3)).gaps[0] == pytest.approx(distance, abs=1e-9)
    # it slides on the floor until it rolls
    cart = zivi.simulate(tree, (0, 2), ([0.0, -0.2, -np.pi / 2], [1.0, 0.0, 0.0]))
    assert cart.success
    assert cart.transitions["after"][-1] == 0


def test_a_cylinder_that_tilts_is_refused_by_name():
    with pytest.raises(
        NotImplementedError, match="cylinder that tilts are not supported: 'tyre-floor', whose rim"
    ):
        zivi.Tree.from_mjcf(WHEEL.replace('axis="0 1 0"', 'axis="1 0 0"'), gaps="all")


@pytest.mark.parametrize("form", ["text", "path", "spec", "model"])
def test_files_texts_specifications_and_models_are_the_same(form, tmp_path):
    path = tmp_path / "hopper.xml"
    path.write_text(HOPPER)
    spec = mujoco.MjSpec.from_string(HOPPER)
    given = {"text": HOPPER, "path": path, "spec": spec, "model": spec.copy().compile()}[form]
    tree = zivi.Tree.from_mjcf(given, gaps="all", ctrl=[3.0, 0.1])
    known = zivi.Tree.from_mjcf(HOPPER, gaps="all", ctrl=[3.0, 0.1])
    assert dict(tree.parameters) == dict(known.parameters)
    assert tree.gap_names == known.gap_names
    assert spec.compiler.fusestatic == mujoco.MjSpec.from_string(HOPPER).compiler.fusestatic


def test_other_things_than_models_are_rejected():
    with pytest.raises(TypeError, match=r"path of from_mjcf must be .*, a mujoco\.MjSpec"):
        zivi.Tree.from_mjcf(3)
    with pytest.raises(TypeError, match="path of from_urdf must be"):
        zivi.Tree.from_urdf(b"<robot/>")


def test_urdf_may_be_a_specification():
    spec = mujoco.MjSpec.from_string(URDF)
    given = [dict(zivi.Tree.from_urdf(it).parameters) for it in (URDF, spec)]
    assert given[0] == given[1]
    spec.compiler.fusestatic = False
    model = zivi.Tree.from_urdf(spec.compile())
    assert model.parameters["tool.mass"] == 0.4


# URDF whose inertias MuJoCo does not take.


def urdf(*inertias, joint="revolute"):
    """A chain of links with these masses, centres of mass and inertias; the last has 1 kg."""
    links = [*inertias, (1.0, "0 0 .2", ".01 .01 .01")]
    text = '<link name="base"/>'
    for i, (mass, at, inertia) in enumerate(links):
        values = dict(zip(("ixx", "iyy", "izz"), inertia.split(), strict=True))
        values |= {"ixy": 0, "ixz": 0, "iyz": 0}
        told = " ".join(f'{name}="{value}"' for name, value in values.items())
        text += f"""<link name="link{i}"><visual><geometry><mesh filename="nowhere{i}.stl"/>
          </geometry></visual><inertial><origin xyz="{at}"/><mass value="{mass}"/>
          <inertia {told}/></inertial></link>
          <joint name="joint{i}" type="{joint}"><parent link="{f"link{i - 1}" if i else "base"}"/>
          <child link="link{i}"/><origin xyz="0 0 .1"/><axis xyz="{["0 1 0", "1 0 0"][i % 2]}"/>
          <dynamics friction=".2" damping=".1"/>
          <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""
    return f'<robot name="chain">{text}</robot>'


def with_compiler(text, settings):
    return text.replace(
        '<robot name="chain">', f'<robot name="chain"><mujoco><compiler {settings}/></mujoco>'
    )


def test_links_without_mass_keep_none():
    text = urdf((0.0, "0 0 0", "0 0 0"))
    tree = zivi.Tree.from_urdf(text)
    assert tree.parameters["link0.mass"] == tree.parameters["link0.inertia.yy"] == 0.0
    assert tree.parameters["joint0.friction"] == 0.2
    check(
        tree, Reference(with_compiler(text, 'boundmass="1e-14" boundinertia="1e-14"')), lambda _: []
    )


def test_inertias_that_no_body_has_become_their_mean():
    text = urdf((2.0, "0 0 .1", ".01 .02 .09"))
    with pytest.warns(zivi.ModelWarning, match="inertia of link 'link0' violates the triangle"):
        tree = zivi.Tree.from_urdf(text)
    assert tree.parameters["link0.inertia.zz"] == pytest.approx(0.04, abs=1e-14)
    check(tree, Reference(with_compiler(text, 'balanceinertia="true"')), lambda _: [])


def test_inertias_of_zero_are_replaced_where_nothing_else_has_one():
    text = urdf().replace('value="1.0"', 'value="2.0"').replace('".01"', '"0"')
    text = text.replace('xyz="0 0 .2"', 'xyz="0 0 0"')
    with pytest.warns(zivi.ModelWarning, match="singular; .* of zero are 1e-06: links 'link0'"):
        tree = zivi.Tree.from_urdf(text)
    check(tree, Reference(with_compiler(text, 'boundinertia="1e-6"')), lambda _: [])


# Actuators as inputs.


class Constant:
    h = 1e-2

    def __init__(self, *u):
        self.u = list(u)

    def step(self, t, q, qdot):
        return self.u


def test_actuators_are_named_inputs_of_closed_loops():
    tree = walker()
    inputs = tree.control_inputs(np.zeros(5))
    assert inputs.names == ("thigh", "ankle")
    np.testing.assert_array_equal(
        inputs.at(np.zeros(5)), np.array([[0, 0]] * 3 + [[90, 0], [0, 40]])
    )
    # a constant control is one of the file
    start = np.array([0, 0, 0, 0.1, 0]), np.zeros(5)
    loop = zivi.simulate_closed_loop(tree, Constant(0.1, -0.2), (0, 0.1), start)
    assert loop.control_names == ("thigh", "ankle")
    held = zivi.simulate(walker(ctrl=[0.1, -0.2]), (0, 0.1), start)
    np.testing.assert_allclose(loop.q[-1], held.q[-1], rtol=0, atol=1e-8)


def test_other_inputs_than_the_actuators_may_be_given():
    columns = {"thigh": [0, 0, 0, 1, 0], "both": {"hip": 1.0, "ankle": -2.0}, "toe": "ankle"}
    tree = walker(inputs=columns)
    inputs = tree.control_inputs(np.zeros(5))
    assert inputs.names == ("thigh", "both", "toe")
    np.testing.assert_array_equal(inputs.at(np.zeros(5))[3:], [[1, 1, 0], [0, -2, 1]])
    with pytest.raises(ValueError, match=r"inputs\['toe'\] names 'knee': there are ankle, hip"):
        walker(inputs={"toe": "knee"})
    with pytest.raises(ValueError, match="inputs must have 5 rows, one for each joint, got 2"):
        walker(inputs={"toe": [1.0, 0.0]})
    # without actuators there is a force on each coordinate
    assert zivi.Tree.from_mjcf(ARM).control_inputs([0, 0]).names == ("u0", "u1")


# What is rejected names its element and what would work.

REMEDIES = {
    "damping of free and ball joints: joint 'root'; set damping='0'": (
        '<body><joint type="free" name="root" damping="1"/><geom size="1"/></body>',
        "",
    ),
    "actuator 'slow'; set dyntype='none'": (
        '<body><joint name="j"/><geom size="1" pos="1 0 0"/></body>',
        '<actuator><general name="slow" joint="j" dyntype="integrator"/></actuator>',
    ),
    "models without joints of MuJoCo: nv = 0; give a body a joint": (
        '<body><geom size="1"/></body>',
        "",
    ),
}


@pytest.mark.parametrize("words", sorted(REMEDIES))
def test_a_rejection_names_the_element_and_what_works(words):
    inside, more = REMEDIES[words]
    with pytest.raises(NotImplementedError, match=words):
        zivi.Tree.from_mjcf(f"<mujoco><worldbody>{inside}</worldbody>{more}</mujoco>")


def test_mujoco_computes_no_dry_friction():
    model = mujoco.MjModel.from_xml_string(WALKER)
    with pytest.raises(NotImplementedError, match=r"joint 'hip'; zivi\.Tree\.from_mjcf reads"):
        zivi.interop.mujoco.system(model)
    with pytest.raises(ValueError, match="friction must be one of 'refuse', 'ignore'"):
        zivi.interop.mujoco.system(model, friction="read")
