"""The problems of `space_numbers` in Siconos or MuJoCo, by an interpreter that has it; prints JSON.

Usage: python3 space_peers.py siconos|mujoco PROBLEM STEP [IMPRATIO]

Siconos takes Moreau's and Jean's steps with its solver of contact with friction in space. A ball
has equal moments of inertia: its angular velocity obeys linear equations. Contacts of MuJoCo are
soft and take no restitution. Needs nothing of zivi.
"""

import json
import math
import sys
import time

from space_numbers import MASS, PROBLEMS, G, R

INERTIA = 0.4 * MASS * R * R
MODEL = """
<mujoco>
  <option timestep="{step}" gravity="{x} 0 {z}" cone="elliptic" impratio="{ratio}"/>
  <worldbody>
    <geom type="plane" size="50 50 1" friction="{mu} 0 0"/>
    <body pos="0 0 {r}">
      {joint}
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>
      <geom type="sphere" size="{r}" friction="{mu} 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""
JOINTS = {
    True: "<freejoint/>",
    False: "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1")),
}


def by_siconos(given, step):
    """Simulate to the end; gives the state, the seconds and the steps."""
    import numpy as np
    import siconos.kernel as sk

    from friction_siconos import stepped

    n = 6 if given["turns"] else 3
    rows = np.zeros((3, n))
    rows[0, 2] = rows[1, 0] = rows[2, 1] = 1.0
    if given["turns"]:
        rows[1, 4], rows[2, 3] = -R, R
    q = np.array([0.0, 0.0, given["height"], 0.0, 0.0, 0.0][:n])
    v = np.array([*given["v"], *given["omega"]][:n], dtype=float)
    zero = np.zeros((n, n))
    mass = np.diag(([MASS] * 3 + [INERTIA] * 3)[:n])
    system = sk.LagrangianLinearTIDS(q, v, mass, zero, zero)
    slope = given["slope"]
    pull = np.zeros(n)
    pull[0], pull[2] = MASS * G * math.sin(slope), -MASS * G * math.cos(slope)
    system.setFExtPtr(pull)
    model = sk.NonSmoothDynamicalSystem(0.0, given["end"])
    model.insertDynamicalSystem(system)
    relation = sk.LagrangianLinearTIR(rows, np.zeros(3))
    law = sk.NewtonImpactFrictionNSL(given["e"], 0.0, given["mu"], 3)
    model.link(sk.Interaction(law, relation), system)
    took, steps = stepped(model, 3, step, given["end"])
    return [*system.q()[:2], *system.velocity()[:2]], took, steps


def by_mujoco(given, step, ratio="1"):
    """Simulate to the end; gives the state, the seconds and the steps."""
    import mujoco

    slope = given["slope"]
    text = MODEL.format(
        step=step, x=G * math.sin(slope), z=-G * math.cos(slope), mu=given["mu"], ratio=ratio,
        r=R, mass=MASS, inertia=INERTIA, joint=JOINTS[given["turns"]],
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[:] = [*given["v"], *given["omega"]][: model.nv]
    steps = round(given["end"] / step)
    begun = time.process_time()
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return [*data.qpos[:2], *data.qvel[:2]], time.process_time() - begun, steps


def main():
    """Run one problem with one step."""
    tool, problem, step, *ratio = sys.argv[1:]
    given = PROBLEMS[problem]
    run = {"siconos": by_siconos, "mujoco": by_mujoco}[tool]
    state, took, steps = run(given, float(step), *ratio)
    error = max(abs(a - b) for a, b in zip(state, given["truth"]))  # noqa: B905
    print("FIGURES " + json.dumps({"error": float(error), "seconds": took, "work": steps}))


if __name__ == "__main__":
    main()
