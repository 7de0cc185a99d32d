"""What an evaluation of a model costs, all in: trees of bodies, constant mass matrices, a pile.

    python benchmarks/evaluation_cost.py [arm | mujoco | chain | pile ...]

Runs by the embedded pair, without dense output: the time of the processor over the evaluations, the
best of some. The arm has two links above a table, and is computed by MuJoCo's functions, too, from
MJCF (where that is installed); the chain is that of `linear_gain.py` with 20
masses; the pile has 50 discs in the plane between two walls, neighbours of which may touch.
"""

import importlib.util
import sys
import time
from collections.abc import Callable

import numpy as np

import zivi
from linear_gain import chain
from zivi.interop import mujoco as by_mujoco
from zivi.mechanics import BallGap, Body, JointLimit, PlaneGap

COLUMNS, ROWS, RADIUS = 10, 5, 0.1


def arm() -> zivi.Tree:
    """Return two links above a table, with a limit of the elbow."""
    links = [
        Body("upper", axis=[0, 1, 0], mass=1.0, com=[0, 0, -0.5], inertia=0.083, damping=0.05),
        Body(
            "fore", "upper", position=[0, 0, -1], axis=[0, 1, 0], mass=0.7, com=[0, 0, -0.4],
            inertia=0.037, damping=0.05,
        ),
    ]  # fmt: skip
    tip = PlaneGap("fore", point=[0, 0, -0.8], offset=-1.5, radius=0.05, name="table")
    return zivi.Tree(links, gaps=[tip, JointLimit("fore", lower=-2.0)], e=0.5)


ARM = """
<mujoco>
  <worldbody>
    <geom name="table" type="plane" size="3 3 .1" pos="0 0 -1.5" condim="1"/>
    <body name="upper">
      <joint name="upper" axis="0 1 0" damping=".05"/>
      <inertial pos="0 0 -.5" mass="1" diaginertia=".083 .083 .083"/>
      <body name="fore" pos="0 0 -1">
        <joint name="fore" axis="0 1 0" damping=".05" range="-115 180" limited="true"/>
        <inertial pos="0 0 -.4" mass=".7" diaginertia=".037 .037 .037"/>
        <geom name="tip" type="sphere" size=".05" pos="0 0 -.8" mass="0" condim="1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def pile() -> tuple[zivi.Tree, np.ndarray]:
    """Return discs above one another, and where they start."""
    bodies, gaps, start = [], [], []
    pitch = 2.1 * RADIUS
    for row in range(ROWS):
        for column in range(COLUMNS):
            name = f"{row}.{column}"
            bodies.append(Body(f"x{name}", kind="slide", axis=[1, 0, 0]))
            bodies.append(Body(name, f"x{name}", "slide", axis=[0, 0, 1], mass=1.0))
            start += [pitch * (column + 0.5 + 0.25 * (row % 2)), RADIUS + 0.02 + 0.95 * pitch * row]
            near = [(row, column - 1), *((row - 1, column + k) for k in (-1, 0, 1))]
            for i, j in near:
                if i >= 0 and 0 <= j < COLUMNS:
                    other = f"{i}.{j}"
                    called = f"{name}-{other}"
                    gaps.append(BallGap(name, other=other, radius=2 * RADIUS, name=called))
            if row == 0:
                gaps.append(PlaneGap(name, radius=RADIUS, name=f"floor{column}"))
        left, right = f"{row}.0", f"{row}.{COLUMNS - 1}"
        gaps.append(PlaneGap(left, normal=[1, 0, 0], radius=RADIUS, name=f"left{row}"))
        width = pitch * (COLUMNS + 0.5)
        gaps.append(
            PlaneGap(right, normal=[-1, 0, 0], offset=-width, radius=RADIUS, name=f"right{row}")
        )
    return zivi.Tree(bodies, gaps=gaps, e=0.3), np.array(start)


def told(name: str, run: Callable[[], zivi.MechanicalTrajectory], runs: int) -> None:
    """Print what a run takes."""
    best = np.inf
    for _ in range(runs):
        began = time.process_time()
        sol = run()
        best = min(best, time.process_time() - began)
    print(
        f"{name}: {1e6 * best / sol.nfev:.2f} us an evaluation, {sol.nfev} of them, "
        f"{len(sol.resolved_impacts)} impacts, {len(sol.zeno)} Zeno points, {best:.3g} s; "
        f"{sol.status}",
        flush=True,
    )


def main(names: list[str]) -> None:
    """Print the costs."""
    pair = zivi.SwitchedRK(flights="rk", rtol=1e-9, atol=1e-9)
    ends = {"dense_output": False}
    if not names or "arm" in names:
        links, start = arm(), ([0.9, 0.4], [0.0, 0.0])
        told("arm", lambda: zivi.simulate(links, (0, 8), start, pair, t_eval=[8.0], **ends), 20)
    if "mujoco" in names or (not names and importlib.util.find_spec("mujoco")):
        import mujoco

        model = mujoco.MjModel.from_xml_string(ARM)
        for name, make in (("MuJoCo", by_mujoco.system), ("tree of MJCF", by_mujoco.tree)):
            links, start = make(model, [("tip", "table"), "fore"], 0.5), ([0.9, 0.4], [0.0, 0.0])
            told(
                f"arm, {name}",
                lambda links=links, start=start: zivi.simulate(
                    links, (0, 8), start, pair, t_eval=[8.0], **ends
                ),
                20,
            )
    if not names or "chain" in names:
        still = np.zeros(20)
        told(
            "chain of 20",
            lambda: zivi.simulate(
                chain(20, 3.1), (0, 5), (still, still), pair, t_eval=[5.0], **ends
            ),
            5,
        )
    if not names or "pile" in names:
        discs, q = pile()
        print(f"pile: {len(q)} coordinates, {len(discs.gap_names)} gaps")
        loose = zivi.SwitchedRK(rtol=1e-6, atol=1e-6)
        for end in (0.1, 0.13, 0.15):
            told(
                f"pile, {end} s",
                lambda end=end: zivi.simulate(
                    discs, (0, end), (q, 0 * q), loose, t_eval=[end], **ends
                ),
                1,
            )


if __name__ == "__main__":
    main(sys.argv[1:])
