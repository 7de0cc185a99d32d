"""Models of MuJoCo as trees."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.extras import needed
from zivi.base.warnings import ModelWarning
from zivi.interop.mujoco.actuators import Drive, drives
from zivi.interop.mujoco.geoms import gaps_of, rotation_of
from zivi.interop.mujoco.refuse import name_of, refuse_for_tree
from zivi.interop.mujoco.sizes import check_sizes, read_text
from zivi.system.impact_law import GivenRestitutions
from zivi.system.tree.body import Body
from zivi.system.tree.system import Tree

__all__ = ["read_mjcf", "read_urdf", "tree"]


def tree(
    model: Any,
    gaps: Sequence[Any] | None = None,
    e: GivenRestitutions = 0.0,
    ctrl: ArrayLike | None = None,
    friction: str = "refuse",
) -> Tree:
    """Give a model of MuJoCo as a `zivi.Tree`.

    Parameters
    ----------
    model : mujoco.MjModel
        The model.
    gaps, e, ctrl, friction
        As for `zivi.Tree.from_mjcf`.

    Returns
    -------
    Tree
        The same bodies, with their names; nothing of MuJoCo is needed any more.

    Raises
    ------
    NotImplementedError
        For what a tree has not, by its name.
    """
    return Tree._of(parts_of(model, gaps, ctrl, friction), e)


def read_mjcf(path: Any, *, gaps: Any, ctrl: Any, friction: str) -> dict[str, Any]:
    """Read the parts of a tree from MJCF."""
    return parts_of(_compiled(path, "from_mjcf"), gaps, ctrl, friction)


def read_urdf(path: Any, *, gaps: Any, friction: str) -> dict[str, Any]:
    """Read the parts of a tree from URDF; links keep their names."""
    return parts_of(_compiled(path, "from_urdf"), gaps, None, friction)


def _compiled(path: Any, caller: str) -> Any:
    """Read a file or its text, with bodies as they are written."""
    mujoco = needed("mujoco", "models in MJCF and URDF")
    text = os.fspath(path)
    if not isinstance(text, str):
        raise TypeError(f"path of {caller} must be a path or a text, got {path!r}")
    is_text = text.lstrip().startswith("<")
    if not is_text and not os.path.exists(text):
        raise FileNotFoundError(f"{caller}: there is no file {text!r}")
    check_sizes(text if is_text else read_text(text), "" if is_text else os.path.dirname(text))
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)  # else MuJoCo leaves a file MUJOCO_LOG.TXT
    try:
        read = mujoco.MjSpec.from_string if is_text else mujoco.MjSpec.from_file
        spec = read(text)
        spec.compiler.fusestatic = False
        model = spec.compile()
    finally:
        mujoco.set_mju_user_warning(before)
    for words in dict.fromkeys(said):
        warnings.warn(f"{caller}: MuJoCo warns: {words.strip()}", ModelWarning, stacklevel=2)
    return model


def parts_of(model: Any, gaps: Any, ctrl: Any, friction: str) -> dict[str, Any]:
    """Give bodies, gaps and gravity of a model."""
    mujoco = needed("mujoco", "models of MuJoCo")
    if not isinstance(model, mujoco.MjModel):
        raise TypeError(f"model must be a mujoco.MjModel, got {model!r}")
    refuse_for_tree(model)
    driven = drives(model, ctrl)
    bodies = [part for body in range(1, model.nbody) for part in _bodies(model, body, driven)]
    off = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    gravity = np.zeros(3) if off else np.array(model.opt.gravity)
    return {"bodies": bodies, "gaps": gaps_of(model, gaps, friction), "gravity": gravity}


def _bodies(model: Any, body: int, driven: dict[int, Drive]) -> list[Body]:
    """Give a body, behind one without mass for each joint but its last."""
    name = name_of(model, "body", body)
    parent = int(model.body_parentid[body])
    carrier = None if parent == 0 else name_of(model, "body", parent)
    inertial = rotation_of(model.body_iquat[body])
    own: dict[str, Any] = {
        "mass": float(model.body_mass[body]),
        "com": np.array(model.body_ipos[body]),
        "inertia": _symmetric(inertial * model.body_inertia[body] @ inertial.T),
    }
    placed: dict[str, Any] = {
        "position": np.array(model.body_pos[body]),
        "rotation": rotation_of(model.body_quat[body]),
    }
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    if count == 0:
        return [Body(name, carrier, "fixed", **placed, **own)]
    parts = []
    for joint in range(first, first + count):
        last = joint == first + count - 1
        coordinate = name_of(model, "joint", joint)
        called = name if last else f"{name}:{coordinate}"
        more = _joint(model, joint, driven[joint]) | (own if last else {})
        parts.append(Body(called, carrier, coordinate=coordinate, **placed, **more))
        carrier, placed = called, {}
    return parts


def _joint(model: Any, joint: int, drive: Drive) -> dict[str, Any]:
    dof, at = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
    stiffness, spring = float(model.jnt_stiffness[joint]), float(model.qpos_spring[at])
    # -k (q - s) + tau - k' q = -(k + k') (q - s) + tau - k' s
    return {
        "kind": "slide" if model.jnt_type[joint] == 2 else "hinge",
        "axis": np.array(model.jnt_axis[joint]),
        "anchor": np.array(model.jnt_pos[joint]),
        "stiffness": stiffness + drive.stiffness,
        "spring": spring,
        "damping": float(model.dof_damping[dof]) + drive.damping,
        "armature": float(model.dof_armature[dof]),
        "torque": drive.torque - drive.stiffness * spring,
        "reference": float(model.qpos0[at]),
    }


def _symmetric(matrix: Any) -> Any:
    return (matrix + matrix.T) / 2
