r"""A hopper and an arm from MuJoCo's files, beside MuJoCo's own runs.

A planar hopper (torso, leg with a spring and a stop, a ball as foot) is dropped on a floor, an arm
of two links on a table. zivi reads the models with MuJoCo and runs them alone: impacts, bounces
that accumulate, rest. MuJoCo's contacts are soft: they are penetrated, and rest is approached. In
brackets: when the foot and the tip first touch, by MuJoCo's own dynamics without contacts (RK4, a
step of 0.1 ms); and the height of the rest, by the balance of spring and weight.

Run as ``python examples/mujoco_hopper_arm.py [out.png]``; it needs MuJoCo (``zivi[mujoco]``).
"""

import importlib
import importlib.util
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np

import zivi

HOPPER = """
<mujoco><compiler angle="radian"/><default><geom condim="1"/></default><worldbody>
  <geom name="floor" type="plane" size="9 9 .1"/>
  <body name="torso"><inertial pos="0 0 0" mass="5" diaginertia=".2 .3 .1"/>
    <joint name="x" type="slide" axis="1 0 0"/> <joint name="z" type="slide" axis="0 0 1"/>
    <body name="leg" pos="0 0 -.5"><inertial pos="0 0 .1" mass=".8" diaginertia=".01 .01 .001"/>
      <joint name="piston" type="slide" axis="0 0 1" range="-.12 .12" limited="true"
             stiffness="900" damping="14"/>
      <geom name="foot" type="sphere" size=".05" mass="0"/>
</body></body></worldbody></mujoco>
"""
ARM = """
<mujoco><compiler angle="radian"/><default><geom condim="1"/></default><worldbody>
  <geom name="table" type="plane" size="2 2 .1" pos="0 0 -.7"/>
  <body name="upper"><joint name="shoulder" axis="0 1 0" damping=".15"/>
    <inertial pos=".3 0 0" mass="1.2" diaginertia=".01 .04 .04"/>
    <body name="fore" pos=".6 0 0"><inertial pos=".25 0 0" mass=".8" diaginertia=".005 .02 .02"/>
      <joint name="elbow" axis="0 1 0" damping=".15" range="-2 2" limited="true"/>
      <geom name="tip" type="sphere" pos=".5 0 0" size=".05" mass="0"/>
</body></body></worldbody></mujoco>
"""
MODELS: dict[str, tuple[str, tuple[str, str], list[float], float]] = {
    "hopper": (HOPPER, ("foot", "floor"), [0.0, 1.0, 0.0], 4.0),
    "arm": (ARM, ("tip", "table"), [-0.4, 0.3], 6.0),
}
E = 0.5


def tree(name: str) -> zivi.Tree:
    """Read a model; the limits of its joints are gaps, too."""
    text, pair, *_ = MODELS[name]
    limits = {"hopper": "piston", "arm": "elbow"}
    return zivi.Tree.from_mjcf(text, gaps=[pair, limits[name]], e=E)


def run(name: str, **more: Any) -> zivi.MechanicalTrajectory:
    """Let it fall from rest."""
    _, _, q, end = MODELS[name]
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-12)
    return zivi.simulate(tree(name), (0, end), (q, np.zeros(len(q))), method, **more)


class Steps:
    """MuJoCo's own run: times, and the distance of the pair."""

    def __init__(self, name: str, step: float, end: float, *, contacts: bool = True) -> None:
        mujoco: Any = importlib.import_module("mujoco")
        text, pair, q, _ = MODELS[name]
        model = mujoco.MjModel.from_xml_string(text)
        model.opt.timestep = step
        if not contacts:
            model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
            off = mujoco.mjtDisableBit
            model.opt.disableflags |= int(off.mjDSBL_CONTACT | off.mjDSBL_CONSTRAINT)
        data = mujoco.MjData(model)
        data.qpos[:] = q
        ball, plane = (model.geom(it).id for it in pair)
        rows = []
        while data.time < end:
            mujoco.mj_step(model, data)
            mujoco.mj_kinematics(model, data)
            height = data.geom_xpos[ball][2] - data.geom_xpos[plane][2] - model.geom_size[ball][0]
            rows.append([data.time, height])
        self.t, self.distance = np.array(rows).T


def first_touch(name: str) -> float:
    """Give when the pair touches first, by MuJoCo without contacts."""
    steps = Steps(name, 1e-4, 1.0, contacts=False)
    k = int(np.argmax(steps.distance < 0))
    # a cubic through four steps
    near = slice(k - 2, k + 2)
    cubic = np.polynomial.Polynomial.fit(steps.t[near], steps.distance[near], 3)
    roots = cubic.roots()
    real = roots[np.abs(roots.imag) < 1e-9].real
    return float(real[np.argmin(np.abs(real - steps.t[k]))])


def rest_of_hopper() -> float:
    """Give the height of the torso at rest: 5 kg on the spring of the leg."""
    return 0.5 + 0.05 - 5 * 9.81 / 900


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    if importlib.util.find_spec("mujoco") is None:
        print("MuJoCo is not installed: pip install 'zivi[mujoco]'")
        if path is not None:
            kept = Path(__file__).parents[1] / "docs" / "figures" / "mujoco_hopper_arm.png"
            shutil.copy(kept, path)
        return
    for name, (_, pair, _, end) in MODELS.items():
        sol = run(name)
        print(f"{name}: {sol!r}")
        touch = sol.impacts["t"][sol.impacts["gap"] == 0][0]
        print(f"the {pair[0]} first touches at {touch:.9f} s ({first_touch(name):.9f})")
        soft = Steps(name, 2e-3, end)
        rests = sol.zeno["t"][-1] if len(sol.zeno) else np.inf
        print(f"it stays on the {pair[1]} from {rests:.6f} s on; least distance 0")
        moves = np.abs(np.diff(soft.distance)) / np.diff(soft.t) > 1e-3
        print(
            f"MuJoCo: least distance {1e3 * soft.distance.min():.2f} mm; "
            f"it moves by more than 1 mm/s until {soft.t[1:][moves][-1]:.3f} s"
        )
    settled = zivi.simulate(tree("hopper"), (0, 20), ([0.0, 1.0, 0.0], np.zeros(3)))
    print(f"the torso rests at {settled.q[-1, 1]:.9f} m ({rest_of_hopper():.9f})")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the distances of both pairs, by both programs."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.6))
    for ax, (name, (_, pair, _, end)) in zip(axes, MODELS.items(), strict=True):
        t = np.linspace(0, end / 2, 3001)
        sol, soft = run(name, t_eval=np.append(t, end)), Steps(name, 2e-3, end / 2)
        ax.plot(soft.t, 1e3 * soft.distance, color="0.6", label="MuJoCo, 2 ms")
        ax.plot(t, 1e3 * sol.gaps[:-1, 0], color=zivi.plot.BLUE, label="zivi")
        ax.set(xlabel="time (s)", ylabel=f"{pair[0]} above {pair[1]} (mm)", title=name)
        ax.set_ylim(-15, 120)
        ax.legend()
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
