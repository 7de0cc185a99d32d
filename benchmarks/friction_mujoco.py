"""The block that slides down a slope in MuJoCo, run by an interpreter that has it; prints JSON.

Usage: python3 friction_mujoco.py STEP [IMPRATIO]

Its contacts are soft and take no restitution, so that the two other problems are none for it. Needs
nothing of zivi.
"""

import json
import sys
import time

import mujoco
import numpy as np

from friction_numbers import MU, PROBLEMS

MODEL = """
<mujoco>
  <option timestep="{step}" gravity="{x} 0 {z}" cone="elliptic" impratio="{ratio}"/>
  <worldbody>
    <geom type="plane" size="10 10 1" friction="{mu} 0 0" solref="0.02 1"/>
    <body pos="0 0 0.1">
      <joint type="slide" axis="1 0 0"/>
      <joint type="slide" axis="0 0 1"/>
      <geom type="box" size="0.1 0.1 0.1" mass="1" friction="{mu} 0 0" solref="0.02 1"/>
    </body>
  </worldbody>
</mujoco>
"""


def main():
    """Run with one step."""
    given, step = PROBLEMS["slide"], float(sys.argv[1])
    ratio = sys.argv[2] if len(sys.argv) > 2 else "1"
    x, z = given["force"]
    text = MODEL.format(step=step, x=x, z=z, mu=MU, ratio=ratio)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = given["start"]
    steps = round(given["end"] / step)
    begun = time.process_time()
    for _ in range(steps):
        mujoco.mj_step(model, data)
    took = time.process_time() - begun
    errors = np.abs(np.array([*data.qpos, *data.qvel]) - given["truth"])
    # it sinks into the floor by what its softness is: along the slope only
    figures = {"error": errors[[0, 2]].max(), "seconds": took, "work": steps}
    print("FIGURES " + json.dumps(figures | {"creeps": float(data.qvel[0])}))


if __name__ == "__main__":
    main()
