"""Small models of bodies and joints in MJCF and URDF, and random ones."""

import numpy as np

ARM = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <geom name="table" type="plane" size="2 2 .1" pos="0 0 -.9" condim="1"/>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping=".05"/>
      <geom type="capsule" fromto="0 0 0 .6 0 0" size=".04" mass="1.2" condim="1"/>
      <body name="fore" pos=".6 0 0">
        <joint name="elbow" axis="0 1 0" damping=".05" range="-2 2" limited="true"/>
        <geom type="capsule" fromto="0 0 0 .5 0 0" size=".03" mass=".8" condim="1"/>
        <body name="hand" pos=".5 0 0">
          <geom name="tip" type="sphere" size=".05" mass=".3" condim="1"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""

HOPPER = """
<mujoco model="hopper">
  <compiler angle="radian"/>
  <default><geom condim="1"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 .1"/>
    <body name="torso" pos="0 0 1">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1" ref="1"/>
      <joint name="pitch" axis="0 1 0" stiffness="40" damping="1" springref=".1"/>
      <inertial pos=".02 0 .1" mass="5" diaginertia=".2 .3 .1"/>
      <body name="leg" pos="0 0 -.2">
        <joint name="piston" type="slide" axis="0 0 -1" range="0 .3" limited="true" stiffness="900"
               springref=".15" damping="4" armature=".05"/>
        <geom name="shin" type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass=".7"/>
        <geom name="foot" type="sphere" pos="0 0 -.45" size=".05" mass=".2"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="pitch" gear="3" ctrlrange="-1 1"/>
    <position joint="piston" kp="50" kv="2"/>
  </actuator>
</mujoco>
"""

BALLS = """
<mujoco model="balls">
  <compiler autolimits="true"/>
  <default><geom condim="1"/></default>
  <worldbody>
    <body name="tilted" euler="20 30 0" pos=".1 .2 -1">
      <geom name="slope" type="plane" size="5 5 .1" pos="0 .1 .05"/>
    </body>
    <geom name="post" type="sphere" size=".1" pos="1 .2 .3"/>
    <body name="a" pos="0 0 .5" quat=".9 .1 -.3 .2">
      <joint name="ax" type="slide" axis="1 .2 0"/>
      <joint name="ay" type="hinge" axis=".1 1 .3" pos=".1 0 .2"/>
      <geom name="ball" type="sphere" size=".2" mass="1" pos=".1 .1 0"/>
      <geom name="box" type="box" size=".1 .2 .3" mass="2" pos="-.2 0 .1" euler="10 0 40"/>
      <body name="b" pos=".3 0 .6" euler="0 50 10">
        <joint name="b" axis="0 .3 1" pos="0 .1 0" range="-90 60" ref="20" springref="-10"
               stiffness="3"/>
        <geom name="rod" type="capsule" size=".1 .3" mass="1.5" pos="0 0 .3" euler="70 0 0"/>
        <geom name="end" type="sphere" size=".15" mass=".4" pos="0 .2 .7"/>
      </body>
    </body>
    <body name="c" pos="1.5 0 .5">
      <joint name="c" axis="0 1 0" armature=".1"/>
      <geom name="other" type="sphere" size=".25" mass="2" pos=".2 0 .1"/>
    </body>
  </worldbody>
</mujoco>
"""

URDF = """
<robot name="two">
  <link name="base"/>
  <link name="one"><inertial><origin xyz=".1 0 .2" rpy=".1 .2 .3"/><mass value="2"/>
    <inertia ixx=".02" iyy=".03" izz=".04" ixy=".001" ixz=".002" iyz="-.003"/></inertial></link>
  <link name="two"><inertial><origin xyz="0 0 .3"/><mass value="1"/>
    <inertia ixx=".02" iyy=".02" izz=".005" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tool"><inertial><origin xyz="0 .05 0"/><mass value=".4"/>
    <inertia ixx=".001" iyy=".001" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="first" type="revolute"><parent link="base"/><child link="one"/>
    <origin xyz="0 0 .5" rpy="0 .3 0"/><axis xyz="0 1 0"/><dynamics damping=".2"/>
    <limit lower="-1" upper="2" effort="10" velocity="5"/></joint>
  <joint name="second" type="prismatic"><parent link="one"/><child link="two"/>
    <origin xyz=".2 .1 0" rpy=".2 0 .1"/><axis xyz="0 .6 .8"/>
    <limit lower="0" upper=".5" effort="10" velocity="5"/></joint>
  <joint name="grip" type="fixed"><parent link="two"/><child link="tool"/>
    <origin xyz="0 0 .6" rpy="0 0 .7"/></joint>
</robot>
"""


def random_mjcf(seed):
    """A tree of random shape: joints of both kinds, several of a body, welded bodies, actuators."""
    rng = np.random.default_rng(seed)

    def numbers(size, scale=1.0):
        return " ".join(f"{x:.4f}" for x in scale * rng.normal(size=size))

    count, joints, names = int(rng.integers(2, 9)), [], []
    children = {i: [] for i in range(-1, count)}
    for i in range(count):
        children[int(rng.integers(-1, i)) if i else -1].append(i)

    def body(i):
        lines = [f'<body name="body{i}" pos="{numbers(3, 0.4)}" quat="{numbers(4)}">']
        for k in range(int(rng.integers(0 if i else 1, 3))):
            name, kind = f"joint{i}_{k}", rng.choice(["hinge", "slide"])
            lines.append(
                f'<joint name="{name}" type="{kind}" axis="{numbers(3)}" pos="{numbers(3, 0.2)}" '
                f'ref="{rng.normal():.3f}" springref="{rng.normal():.3f}" '
                f'stiffness="{rng.uniform(0, 9):.3f}" damping="{rng.uniform():.3f}" '
                f'armature="{rng.uniform(0.01, 0.1):.3f}"/>'
            )
            joints.append(name)
        lines.append(
            f'<geom name="geom{i}" type="sphere" size="{rng.uniform(0.02, 0.1):.3f}" '
            f'pos="{numbers(3, 0.3)}" condim="1" mass="{rng.uniform(0.2, 3):.3f}"/>'
        )
        lines.append(
            f'<geom type="box" size=".1 .2 .05" pos="{numbers(3, 0.2)}" quat="{numbers(4)}" '
            f'condim="1" mass="{rng.uniform(0.2, 3):.3f}"/>'
        )
        names.append(f"geom{i}")
        return "\n".join([*lines, *(body(child) for child in children[i]), "</body>"])

    trees = "\n".join(body(i) for i in children[-1])
    motors = "\n".join(
        f'<motor joint="{name}" gear="{rng.normal():.3f}"/>' for name in joints[: len(joints) // 2]
    )
    text = f"""
    <mujoco><compiler angle="radian"/><option gravity="{numbers(3, 9)}"/><worldbody>
    <geom name="plane" type="plane" size="1 1 .1" condim="1" pos="{numbers(3)}"
      quat="{numbers(4)}"/>
    {trees}</worldbody><actuator>{motors}</actuator></mujoco>"""
    return text, joints, names
