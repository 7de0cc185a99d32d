r"""A hopper whose foot touches down on a frictional floor, and stands or slides.

Torso, thigh, shin and foot in a plane, a model of MuJoCo: servos hold the joints, the friction of
the floor is that of its geoms. The hopper is dropped while it drifts forwards. The joints are at
their targets, so it falls like a rigid body (in brackets: ``sqrt(2 h/g)``). On a rough floor the
foot sticks: its slip is 0, not small. On ice it slides, until friction has taken the speed. Where
it stands, heel and toe share the weight as the centre of mass says (in brackets, by MuJoCo).

Run as ``python examples/mujoco_standing_hopper.py [out.png]``; it needs MuJoCo (``zivi[mujoco]``).
"""

import importlib
import importlib.util
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np

import zivi

MODEL = """
<mujoco><compiler angle="radian"/>
  <default><geom size=".04" density="900"/><joint axis="0 1 0" damping="25"/>
    <position kp="1500"/></default>
  <worldbody>
  <geom name="floor" type="plane" size="9 9 .1" friction=".01"/>
  <body name="torso" pos="0 0 1.2">
    <joint name="x" type="slide" axis="1 0 0" damping="0"/>
    <joint name="z" type="slide" axis="0 0 1" damping="0"/>
    <joint name="pitch" damping="0"/>
    <geom type="capsule" fromto="0 0 -.1 0 0 .3" size=".06"/>
    <body name="thigh" pos="0 0 -.1"><joint name="hip"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.4"/>
      <body name="shin" pos="0 0 -.4"><joint name="knee"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03"/>
        <body name="foot" pos="0 0 -.4"><joint name="ankle"/>
          <geom name="foot" type="capsule" fromto="-.1 0 -.04 .2 0 -.04" size=".03"
                friction="{mu}"/>
  </body></body></body></body></worldbody>
  <actuator><position joint="hip"/><position joint="knee"/><position joint="ankle"/></actuator>
</mujoco>
"""
CROUCH = [-0.6, 1.2, -0.6]
"""Angles of hip, knee and ankle (rad)."""
HEIGHT, DRIFT, G = 0.05, 0.3, 9.81


def hopper(mu: float) -> zivi.Tree:
    """Read the hopper; the greater coefficient of both geoms counts."""
    text = MODEL.format(mu=mu)
    return zivi.Tree.from_mjcf(text, gaps=[("foot", "floor")], ctrl=CROUCH)


def run(mu: float, end: float = 8.0) -> zivi.MechanicalTrajectory:
    """Drop the hopper, with its foot level and some way above the floor."""
    tree = hopper(mu)
    q, w = np.array([0.0, 0.0, 0.0, *CROUCH]), np.array([DRIFT, 0.0, 0.0, 0.0, 0.0, 0.0])
    q[1] = HEIGHT - tree.at(0.0, q, w).gaps.min()
    return zivi.simulate(tree, (0, end), (q, w))


def shares(q: np.ndarray) -> tuple[float, float]:
    """Return the loads of heel and toe by the centre of mass, as MuJoCo has it."""
    mujoco: Any = importlib.import_module("mujoco")
    model = mujoco.MjModel.from_xml_string(MODEL.format(mu=1.0))
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    foot = model.geom("foot").id
    half = data.geom_xmat[foot].reshape(3, 3)[0, 2] * model.geom_size[foot][1]
    back, front = sorted(data.geom_xpos[foot][0] + np.array([-half, half]))
    weight, at = G * np.sum(model.body_mass), data.subtree_com[0][0]
    toe = weight * (at - back) / (front - back)
    return weight - toe, toe


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    if importlib.util.find_spec("mujoco") is None:
        print("MuJoCo is not installed: pip install 'zivi[mujoco]'")
        if path is not None:
            kept = Path(__file__).parents[1] / "docs" / "figures" / "mujoco_standing_hopper.png"
            shutil.copy(kept, path)
        return
    runs = {mu: run(mu) for mu in (2.0, 0.05)}
    for mu, sol in runs.items():
        print(f"mu = {mu}: {sol!r}")
        touch, foot = sol.impacts["t"][0], sol.slip_distances
        print(f"the foot touches at {touch:.9f} s ({np.sqrt(2 * HEIGHT / G):.9f})")
        print(f"largest slip while it sticks {np.abs(sol.slips[sol.modes == 0]).max()} m/s (0)")
        print(f"toe and heel slide {foot[-1, 0]:.3f} m and {foot[-1, 1]:.3f} m")
    last = runs[2.0]
    known = shares(last.q[-1])
    # the first end of MuJoCo's capsule is the one that fromto names last
    for name, load, expected in zip(("toe", "heel"), last.reactions[-1], known[::-1], strict=True):
        print(f"load of the {name} at the end {load:.4f} N ({expected:.4f})")
    if path is not None:
        draw(path, runs)


def draw(path: str, runs: dict[float, zivi.MechanicalTrajectory]) -> None:
    """Draw slip and loads of both runs."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(
        2, 2, layout="constrained", figsize=(9.6, 5.2), sharex=True, sharey="row"
    )
    for column, (mu, sol) in zip(axes.T, runs.items(), strict=True):
        zivi.plot.slips(sol, column[0]).set(
            title=rf"$\mu = {mu}$", ylabel="slip speeds $w_c$ (m/s)"
        )
        zivi.plot.reactions(sol, column[1])
        column[1].set_xlim(0, 2)
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
