"""Own small models with the joints and elements of 41 published ones, which trees read.

The names are those of files without free joints in Farama-Foundation/Gymnasium (``assets``),
google-deepmind/dm_control (``suite``) and bulletphysics/bullet3 (``data``, ``data/mjcf``);
``python benchmarks/public_trees.py --outcomes --files`` reads the files themselves.
"""

import re

import numpy as np
import pytest

import zivi
from test_tree_mujoco import Reference, check

mujoco = pytest.importorskip("mujoco")

# joints (s: slide, h: hinge, h7: seven of them), how many have limits and dry friction, what else
# the file has
READ = {
    "assets/half_cheetah.xml": "s2h7 limits=6 armature damping stiffness motors=6 plane capsule",
    "assets/hopper.xml": "sshhhh limits=3 armature damping motors=3 plane capsule",
    "assets/inverted_double_pendulum.xml": "shh limits=1 damping margin motors=1 plane capsule",
    "assets/inverted_pendulum.xml": "sh limits=2 damping motors=1 capsule",
    "assets/point.xml": "ssh motors=2 plane box sphere",
    "assets/pusher.xml": "h7s4 limits=11 armature damping motors=7 plane capsule sphere cylinder",
    "assets/pusher_v5.xml": "h7s4 limits=11 armature damping motors=7 plane"
    " capsule sphere cylinder",
    "assets/reacher.xml": "hhss limits=3 armature damping motors=2 plane capsule sphere cylinder",
    "assets/walker2d.xml": "s2h7 limits=6 armature damping motors=6 plane capsule",
    "assets/walker2d_v5.xml": "s2h7 limits=6 armature damping motors=6 plane capsule",
    "suite/acrobot.xml": "hh damping motors=1 plane capsule cylinder",
    "suite/cartpole.xml": "sh limits=1 damping motors=1 plane box capsule",
    "suite/cheetah.xml": "s2h7 limits=6 armature damping stiffness motors=6 plane capsule",
    "suite/finger.xml": "hhh limits=2 frictionloss=1 damping motors=2 plane capsule cylinder",
    "suite/hopper.xml": "sshhhhh limits=4 armature damping motors=4 plane capsule",
    "suite/pendulum.xml": "h damping motors=1 plane capsule sphere cylinder",
    "suite/reacher.xml": "hh limits=1 damping motors=2 plane capsule sphere cylinder",
    "suite/walker.xml": "s2h7 limits=6 armature damping motors=6 plane capsule",
    "data/Base_1.urdf": "h",
    "data/Base_2.urdf": "h15",
    "data/Pendulum_Tendon_1_Cart_Rail.urdf": "sh15 limits=1",
    "data/TwoJointRobot_w_fixedJoints.urdf": "hh limits=2",
    "data/TwoJointRobot_wo_fixedJoints.urdf": "hh limits=2",
    "data/cartpole.urdf": "sh limits=1",
    "data/cube_gripper_left.urdf": "s limits=1",
    "data/cube_gripper_right.urdf": "s limits=1",
    "data/door.urdf": "h frictionloss=1 damping",
    "data/humanoid.urdf": "h21 frictionloss=21 damping",
    "data/pantilt.urdf": "hh limits=2 frictionloss=1 damping",
    "data/pole.urdf": "shh limits=1",
    "data/pr2_gripper.urdf": "hh limits=2",
    "data/prismatic.urdf": "s limits=1",
    "data/r2d2.urdf": "hhhhshhh limits=3",
    "data/test_joints_MB.urdf": "hh limits=2",
    "data/wheel.urdf": "h",
    "mjcf/ant.xml": "h8 limits=8 armature damping motors=8 capsule sphere",
    "mjcf/humanoid.xml": "h21 limits=21 armature damping stiffness motors=21 plane capsule sphere",
    "mjcf/inverted_double_pendulum.xml": "shh limits=1 damping margin motors=1 plane capsule",
    "mjcf/inverted_pendulum.xml": "sh limits=1 damping motors=1 capsule",
    "mjcf/pusher.xml": "h7s4 limits=11 armature motors=7 plane capsule sphere cylinder",
    "mjcf/reacher.xml": "hhss limits=3 armature damping motors=2 plane capsule sphere cylinder",
}

GEOMS = {
    "capsule": 'type="capsule" size=".05" fromto="0 0 0 {x} .1 -.3"',
    "sphere": 'type="sphere" size=".06"',
    "box": 'type="box" size=".05 .1 .08"',
    "cylinder": 'type="cylinder" size=".05 .1"',
}


class Features:
    def __init__(self, name):
        kinds, *words = READ[name].split()
        self.joints = re.sub(r"(.)(\d+)", lambda it: it[1] * int(it[2]), kinds)
        pairs = (word.partition("=") for word in words)
        self.counts = {key: int(value or 1) for key, _, value in pairs}
        # slides before hinges, as slides of URDF always have limits
        order = sorted(range(len(self.joints)), key=lambda i: (self.joints[i] != "s", i))
        self.limited = {*order[: self.number("limits")]}
        self.rng = np.random.default_rng([*name.encode()])

    def number(self, key):
        return self.counts.get(key, 0)

    def axis(self):
        return self.rng.normal(size=3).round(2)


def words(numbers):
    return " ".join(map(str, numbers))


def mjcf(given):
    """A chain: a body for each hinge, slides at the body of the joint behind them."""
    settings = {"armature": "armature='.02'", "damping": "damping='.3'"}
    settings |= {"stiffness": "stiffness='4'", "margin": "margin='.01'"}
    common = " ".join(text for key, text in settings.items() if given.number(key))
    shapes = [GEOMS[key] for key in GEOMS if given.number(key)]
    count = len(given.joints)
    body, open_bodies = "", 0
    for i, kind in enumerate(given.joints):
        if i == 0 or given.joints[i - 1] == "h":
            body += f'<body pos="{words(given.axis())}">'
            open_bodies += 1
        more = ' range="-.5 .7"' if i in given.limited else ""
        more += f' frictionloss=".{i % 3 + 1}"' if i < given.number("frictionloss") else ""
        type_ = "slide" if kind == "s" else "hinge"
        body += f'<joint name="j{i}" type="{type_}" axis="{words(given.axis())}"{more}/>'
        if kind == "h" or i == count - 1:
            body += f'<geom name="g{i}" {shapes[i % len(shapes)].format(x=i / 10)}/>'
    motors = "".join(
        f'<motor name="m{i}" joint="j{count - 1 - i}" gear="{i + 2}"/>'
        for i in range(given.number("motors"))
    )
    plane = '<geom name="floor" type="plane" size="1 1 1" pos="0 0 -9"/>'
    return f"""<mujoco><compiler angle="radian" autolimits="true"/>
        <default><joint {common}/></default>
        <worldbody>{plane * given.number("plane")}{body}{"</body>" * open_bodies}</worldbody>
        <actuator>{motors}</actuator></mujoco>"""


def urdf(given):
    inertia = '<inertia ixx=".02" iyy=".03" izz=".04" ixy=".001" ixz="0" iyz="0"/>'
    text = '<link name="l0"/>'
    for i, kind in enumerate(given.joints):
        limited = i in given.limited
        name = "prismatic" if kind == "s" else "revolute" if limited else "continuous"
        bounds = ' lower="-.5" upper=".7"' if limited else ' lower="-1e9" upper="1e9"'
        rough = f' friction=".{i % 3 + 1}"' if i < given.number("frictionloss") else ""
        dynamics = f'<dynamics damping="{0.3 * given.number("damping")}"{rough}/>'
        text += f"""<link name="l{i + 1}"><inertial><origin xyz="{words(given.axis())}"/>
            <mass value="{i + 1}"/>{inertia}</inertial></link>
            <joint name="j{i}" type="{name}"><parent link="l{i}"/><child link="l{i + 1}"/>
            <origin xyz="{words(given.axis())}" rpy="{words(given.axis())}"/>{dynamics}
            <axis xyz="{words(given.axis())}"/><limit effort="9" velocity="9"{bounds}/></joint>"""
    return f'<robot name="own">{text}</robot>'


@pytest.mark.parametrize("name", READ)
def test_a_model_like_the_published_one_is_read(name):
    given = Features(name)
    written, read = (urdf, zivi.Tree.from_urdf) if "urdf" in name else (mjcf, zivi.Tree.from_mjcf)
    text = written(given)
    tree = read(text)
    names = [f"j{i}" for i in range(len(given.joints))]
    assert [*tree.coordinate_names(len(names))] == names
    limits = [it for i, it in enumerate(names) if i in given.limited]
    assert [*tree.gap_names] == [f"{it}.{end}" for it in limits for end in ("lower", "upper")]
    assert len(tree.channel_names) == given.number("frictionloss")
    motors = [f"m{i}" for i in range(given.number("motors"))]
    assert not motors or [*tree.control_inputs(np.zeros(len(names))).names] == motors
    # mass matrix and forces are those of MuJoCo
    tree = read(text, gaps=[])
    check(tree, Reference(text), lambda _: [])
