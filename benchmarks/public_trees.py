"""Trees read from public MJCF and URDF files against MuJoCo: mass matrix, forces, points.

``python benchmarks/public_trees.py FOLDER ...`` reads all ``.xml`` and ``.urdf`` files below the
folders (as DeepMind's `dm_control/suite`, Gymnasium's `envs/mujoco/assets` or example-robot-data),
which are not part of this repository. Of a model that is refused the table names why; ``--strip``
takes what a tree has not out of such models first (constraints, actuators, tendons, friction of
joints, fluids; free and ball joints become slides and hinges). Meshes are left out: what has no
inertia without them is not compared.

``--outcomes`` reads the files as `zivi.Tree.from_mjcf` and `zivi.Tree.from_urdf` read them, with
their meshes, and prints how many are read and how many are rejected for what; ``--files`` lists
them.
"""

from __future__ import annotations

import argparse
import re
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import zivi
from zivi.interop.mujoco import scalar_joints
from zivi.interop.mujoco.read import read_parts
from zivi.mechanics import PlaneGap

STATES = 20
NORMALS = np.eye(3)


def without_meshes(path: Path) -> str:
    """Give the text of a URDF file whose links have their inertia only."""
    text = path.read_text()
    for tag in ("visual", "collision"):
        text = re.sub(rf"<{tag}\b.*?</{tag}>|<{tag}\b[^>]*/>", "", text, flags=re.S)
    return re.sub(r"<(transmission|gazebo|mujoco)\b.*?</\1>", "", text, flags=re.S)


def spec_of(path: Path) -> Any:
    """Read a model; bodies stay as they are written."""
    if path.suffix == ".urdf":
        spec = mujoco.MjSpec.from_string(without_meshes(path))
    else:
        spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.fusestatic = False
    return spec


def stripped(spec: Any) -> Any:
    """Take out what a tree has not."""
    for kind in ("equalities", "actuators", "tendons", "sensors", "keys", "excludes"):
        for it in list(getattr(spec, kind, ())):
            spec.delete(it)
    for joint in spec.joints:
        joint.frictionloss = 0.0
    spec.option.density = spec.option.viscosity = 0.0
    return scalar_joints(spec)


class Reference:
    """What MuJoCo says without contacts and limits."""

    def __init__(self, model: Any) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        off = mujoco.mjtDisableBit
        model.opt.disableflags |= int(off.mjDSBL_CONSTRAINT | off.mjDSBL_CONTACT)

    def at(self, q: Any, w: Any, points: list[tuple[int, Any]]) -> list[Any]:
        """Give mass, force, and of each point the height, gradient and curvature along the axes."""
        m, d = self.model, self.data
        d.qpos[:], d.qvel[:] = q, w
        mujoco.mj_forward(m, d)
        mass = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, d, mass)
        force = d.qfrc_passive - d.qfrc_bias + d.qfrc_actuator
        heights, gradients, curvatures = [], [], []
        for body, local in points:
            at = d.xpos[body] + d.xmat[body].reshape(3, 3) @ local
            jac, dot = np.zeros((3, m.nv)), np.zeros((3, m.nv))
            mujoco.mj_jac(m, d, jac, None, at, body)
            mujoco.mj_jacDot(m, d, dot, None, at, body)
            heights.extend(at)
            gradients.extend(jac)
            curvatures.extend(dot @ w)
        return [mass, force, np.array(heights), np.array(gradients), np.array(curvatures)]


def apart(found: Any, exact: Any, scale: float) -> float:
    """Give the largest difference, relative to the largest number, which `scale` is at least."""
    scale = max(float(np.max(np.abs(exact), initial=0.0)), scale, 1e-300)
    return float(np.max(np.abs(found - exact), initial=0.0)) / scale


def compared(model: Any) -> tuple[int, list[float]]:
    """Compare the tree of a model with it at random states: degrees of freedom, differences."""
    rng = np.random.default_rng(0)
    parts = read_parts(model, [], None, "refuse")
    bodies = [body for body in range(1, model.nbody) if model.body_weldid[body] != 0]
    chosen = rng.permutation(bodies)[:8]
    points = [(int(body), rng.normal(size=3) * 0.2) for body in chosen]
    gaps = [
        PlaneGap(model.body(body).name or f"body{body}", local, normal, 0.0, 0.0, name=f"g{i}{k}")
        for i, (body, local) in enumerate(points)
        for k, normal in enumerate(NORMALS)
    ]
    tree, reference = zivi.Tree(**(parts | {"gaps": gaps})), Reference(model)
    worst = [0.0] * 5
    for _ in range(STATES):
        q, w = rng.normal(size=model.nq), 2 * rng.normal(size=model.nv)
        here, exact = tree.at(0.0, q, w), reference.at(q, w, points)
        found = [here.mass, here.force, here.gaps, here.gradients, here.curvatures]
        # forces that cancel, beside inertia times squares of speeds of one
        scales = [0.0, float(np.max(np.abs(exact[0]))), 0.0, 0.0, 1.0]
        each = zip(found, exact, scales, strict=True)
        worst = [max(a, apart(*b)) for a, b in zip(worst, each, strict=True)]
    return model.nv, worst


# What becomes of the files.

BY_MUJOCO = (
    ("a mesh or another file is missing", r"opening file|resource|does not exist"),
    ("a mesh is flat", r"coplanar"),
    ("a mass or an inertia is missing or impossible", r"^Error: .*(inertia|mass)"),
)
"""Reasons of MuJoCo, by words of its errors."""


def outcome(path: Path) -> tuple[str, str]:
    """Give what becomes of a file, and the name of what stops it."""
    read = zivi.Tree.from_urdf if path.suffix == ".urdf" else zivi.Tree.from_mjcf
    try:
        tree = read(path)
    except NotImplementedError as error:
        what, _, rest = str(error).partition(":")
        return re.sub(r"zivi(\.Tree)? does not support |( of MuJoCo)$", "", what), rest.strip()
    except Exception as error:
        told = " ".join(str(error).split())
        kinds = (kind for kind, words in BY_MUJOCO if re.search(words, told))
        return f"MuJoCo: {next(kinds, 'not valid in this version')}", told[:80]
    return "read", f"{len(tree.coordinate_names(0))} coordinates, {tree.m} limits"


def print_outcomes(paths: list[Path], files: bool) -> None:
    """Print the table of outcomes."""
    found = [(path, *outcome(path)) for path in paths if "<mujocoinclude" not in plain_text(path)]
    counts = Counter(kind for _, kind, _ in found)
    print(f"| outcome of {len(found)} files | files |\n|---|---|")
    for kind, count in sorted(counts.items(), key=lambda it: (it[0] != "read", -it[1], it[0])):
        print(f"| {kind} | {count} |")
    for path, kind, which in found if files else ():
        print(f"| {'/'.join(path.parts[-2:])} | {kind} | {which} |")


def plain_text(path: Path) -> str:
    """Read a file, whatever its encoding."""
    return path.read_text(errors="replace")


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    for option in ("--strip", "--outcomes", "--files"):
        parser.add_argument(option, action="store_true")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    if given.outcomes:
        below = [it for folder in given.folders for it in sorted(folder.glob("*"))]
        print_outcomes([it for it in below if it.suffix in (".xml", ".urdf")], given.files)
        return
    print("| model | joints | M | F | gap | gradient | curvature |\n|---|---|---|---|---|---|---|")
    for path in sorted(it for folder in given.folders for it in folder.rglob("*")):
        if path.suffix not in (".xml", ".urdf"):
            continue
        name = "/".join(path.parts[-2:])
        try:
            spec = spec_of(path)
            model = (stripped(spec) if given.strip else spec).compile()
            joints, worst = compared(model)
        except (ValueError, NotImplementedError) as error:
            print(f"| {name} | | {str(error).splitlines()[0][:90]} | | | | |")
            continue
        print(f"| {name} | {joints} | " + " | ".join(f"{it:.1e}" for it in worst) + " |")


if __name__ == "__main__":
    main()
