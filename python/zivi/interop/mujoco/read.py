"""Models of MuJoCo (MJCF, URDF) as trees."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, real_array
from zivi.base.extras import needed
from zivi.base.status import ModelWarning
from zivi.interop.mujoco.contacts import read_gaps, rotation_of
from zivi.interop.mujoco.refusals import (
    BALL,
    CONNECT,
    FREE,
    JOINT,
    element_name,
    is_off,
    refuse_for_tree,
)
from zivi.interop.mujoco.texts import compiled, compiled_urdf
from zivi.system.gap import DryFriction
from zivi.system.impact_law import GivenRestitutions
from zivi.system.tree import Structure, Tree
from zivi.system.tree_bodies import Body, Connect, Couple, TreeConstraint, Weld


def tree(
    model: Any,
    gaps: Sequence[Any] | str | None = None,
    e: GivenRestitutions = 0.0,
    ctrl: ArrayLike | None = None,
    friction: str = "read",
) -> Tree:
    """Return a model of MuJoCo as a `zivi.Tree`.

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
        For what a tree does not have, by its name.
    """
    mujoco = needed("mujoco", "models of MuJoCo")
    if not isinstance(model, mujoco.MjModel):
        raise TypeError(f"model must be a mujoco.MjModel, got {model!r}")
    return Tree(**read_parts(model, gaps, ctrl, friction), e=e)


def read_mjcf(given: Any, *, gaps: Any, ctrl: Any, friction: str) -> dict[str, Any]:
    """Read the arguments of a tree from MJCF."""
    return read_parts(compiled(given, "from_mjcf"), gaps, ctrl, friction)


LEAST, RAISED = 1e-14, 1e-6
"""Masses (kg) and inertias (kg m^2) that stand for zero, and that replace zeros if they must."""


def read_urdf(given: Any, *, gaps: Any, friction: str) -> dict[str, Any]:
    """Read the arguments of a tree from URDF; links keep their names.

    Masses and inertias of zero stay zero if the mass matrix is positive definite nevertheless.
    """
    parts = read_parts(compiled_urdf(given, LEAST), gaps, None, friction)
    parts["bodies"] = [_without_least(body) for body in parts["bodies"]]
    try:
        Tree(parts["bodies"])
    except ValueError:
        carriers = Structure(tuple(parts["bodies"]), ()).carriers
        moving = [body for body in parts["bodies"] if carriers[body.name] >= 0]
        empty = [body.name for body in moving if not np.all(np.diag(body.inertia))]
        parts = read_parts(compiled_urdf(given, RAISED), gaps, None, friction)
        warnings.warn(
            f"from_urdf: the mass matrix is singular; masses and inertias of zero are {RAISED:g}: "
            f"links {', '.join(map(repr, empty))}",
            ModelWarning,
            stacklevel=3,
        )
    return parts


def _without_least(body: Body) -> Body:
    """Return a body whose mass and inertia are zero where they stand for it."""
    mass = 0.0 if body.mass <= LEAST else body.mass
    inertia = np.where(np.abs(body.inertia) <= 2 * LEAST, 0.0, body.inertia)
    return dataclasses.replace(body, mass=mass, inertia=inertia)


def read_parts(model: Any, gaps: Any, ctrl: Any, friction: str) -> dict[str, Any]:
    """Return the arguments of a tree but for its restitution."""
    import mujoco

    refuse_for_tree(model)
    driven = drives(model, ctrl)
    bodies = [part for body in range(1, model.nbody) for part in _bodies(model, body, driven)]
    off = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    return {
        "bodies": bodies,
        "gaps": read_gaps(model, gaps, friction, bodies),
        "gravity": np.zeros(3) if off else np.array(model.opt.gravity),
        "friction": _friction(model, friction),
        "inputs": inputs_of(model),
        "constraints": _constraints(model),
    }


def _constraints(model: Any) -> list[TreeConstraint]:
    """Read the equality constraints that are active at the start."""
    if is_off(model, "EQUALITY"):
        return []
    return [_constraint(model, int(i)) for i in np.flatnonzero(model.eq_active0)]


def _constraint(model: Any, index: int) -> TreeConstraint:
    """Read an equality constraint: connect, weld or joint."""
    name, kind = element_name(model, "equality", index), int(model.eq_type[index])
    first, second = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
    data = np.array(model.eq_data[index])
    if kind == JOINT:
        places = np.asarray(model.jnt_qposadr)
        return Couple(
            element_name(model, "joint", first),
            None if second < 0 else element_name(model, "joint", second),
            coefficients=data[:5].tolist(),
            reference=float(model.qpos0[places[first]]),
            other_reference=0.0 if second < 0 else float(model.qpos0[places[second]]),
            name=name,
        )
    turned = np.eye(3)
    if int(model.eq_objtype[index]) == SITE:
        points = np.array(model.site_pos[first]), np.array(model.site_pos[second])
        turned = rotation_of(model.site_quat[second]) @ rotation_of(model.site_quat[first]).T
        first, second = int(model.site_bodyid[first]), int(model.site_bodyid[second])
    elif kind == CONNECT:
        points = data[:3], data[3:6]
    else:
        points = data[3:6], data[:3]
        turned = rotation_of(data[6:10]).T
    if first == 0:
        first, second, points, turned = second, first, points[::-1], turned.T
    body, other = (element_name(model, "body", it) for it in (first, second))
    ends: dict[str, Any] = {"point": points[0], "other_point": points[1], "name": name}
    if second == 0:
        other = None  # type: ignore[assignment]
    if kind == CONNECT:
        return Connect(body, other, **ends)
    return Weld(body, other, rotation=turned, **ends)


SITE = 6
"""The kind of objects that are sites (mjOBJ_SITE)."""


def _friction(model: Any, friction: str) -> list[DryFriction]:
    """Read the dry friction of joints."""
    limits = np.asarray(model.dof_frictionloss)[np.asarray(model.jnt_dofadr)]
    rough = [
        (element_name(model, "joint", int(i)), float(limits[i])) for i in np.flatnonzero(limits)
    ]
    if rough and friction == "refuse":
        raise NotImplementedError(
            f"friction in joints (frictionloss) is not supported: joint {rough[0][0]!r}; "
            "friction='read' reads it, friction='ignore' leaves it out"
        )
    if friction == "ignore" or is_off(model, "FRICTIONLOSS"):
        return []
    return [DryFriction(name, limit=limit) for name, limit in rough]


def _bodies(model: Any, body: int, driven: dict[int, Actuation]) -> list[Body]:
    """Return a body, preceded by a massless body for each joint but its last."""
    name = element_name(model, "body", body)
    parent = int(model.body_parentid[body])
    carrier = None if parent == 0 else element_name(model, "body", parent)
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
    if int(model.jnt_type[first]) == FREE:
        return [Body(name, kind="free", coordinate=element_name(model, "joint", first), **own)]
    for joint in range(first, first + count):
        last = joint == first + count - 1
        coordinate = element_name(model, "joint", joint)
        called = name if last else f"{name}:{coordinate}"
        more = _joint(model, joint, driven[joint]) | (own if last else {})
        parts.append(Body(called, carrier, coordinate=coordinate, **placed, **more))
        carrier, placed = called, {}
    return parts


def _joint(model: Any, joint: int, drive: Actuation) -> dict[str, Any]:
    if model.jnt_type[joint] == BALL:
        return {"kind": "ball", "anchor": np.array(model.jnt_pos[joint])}
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


# Actuators at joints: springs, dampers and forces, and the inputs of closed loops.


@dataclasses.dataclass
class Actuation:
    r"""Force of the actuators at a joint, :math:`\tau - k q - c \dot q`."""

    torque: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0


def read_ctrl(model: Any, ctrl: Any) -> Array:
    """Read the controls."""
    if ctrl is None:
        return np.zeros(model.nu)
    given = np.atleast_1d(real_array("ctrl", ctrl))
    if given.shape != (model.nu,) or not np.all(np.isfinite(given)):
        raise ValueError(f"ctrl must be {model.nu} finite numbers, got {given.tolist()}")
    return given


def drives(model: Any, ctrl: Any) -> dict[int, Actuation]:
    """Return the force of the actuators by joint."""
    import mujoco

    given, found = read_ctrl(model, ctrl), {i: Actuation() for i in range(model.njnt)}
    affine = int(mujoco.mjtBias.mjBIAS_AFFINE)
    for i in range(model.nactuator):
        called = f"actuator {element_name(model, 'actuator', i)!r}"
        _reject(model, i, called)
        control = float(given[model.actuator_ctrladr[i]])
        if model.actuator_ctrllimited[i]:
            control = float(np.clip(control, *model.actuator_ctrlrange[i]))
        bias = np.zeros(3)
        if model.actuator_biastype[i] == affine:
            bias = np.array(model.actuator_biasprm[i][:3])
        force = float(model.actuator_gainprm[i][0]) * control + float(bias[0])
        if model.actuator_forcelimited[i]:
            if bias[1] != 0 or bias[2] != 0:
                raise NotImplementedError(
                    "zivi.Tree does not support limits of forces that depend on the state "
                    f"(forcerange): {called}; use zivi.interop.mujoco.system"
                )
            force = float(np.clip(force, *model.actuator_forcerange[i]))
        gear, drive = float(model.actuator_gear[i][0]), found[int(model.actuator_trnid[i][0])]
        drive.torque += gear * force
        drive.stiffness -= gear**2 * float(bias[1])
        drive.damping -= gear**2 * float(bias[2])
    return found


def _reject(model: Any, i: int, called: str) -> None:
    """Reject actuators that are not at joints, or whose force is not linear."""
    import mujoco

    joints = [int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)]
    known = [int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)]
    fixed = int(mujoco.mjtGain.mjGAIN_FIXED)
    one = (model.actuator_ctrlnum[i], model.actuator_outnum[i]) == (1, 1)
    if model.actuator_trntype[i] not in joints or not one:
        raise NotImplementedError(
            f"zivi.Tree supports only actuators at joints: {called}; use zivi.interop.mujoco.system"
        )
    if model.actuator_gaintype[i] != fixed or model.actuator_biastype[i] not in known:
        raise NotImplementedError(
            f"zivi.Tree supports only constant and affine gains and biases of actuators: {called}; "
            "use zivi.interop.mujoco.system"
        )


def inputs_of(model: Any) -> dict[str, Array] | None:
    """Return the force of each actuator on the coordinates for a control of 1, by its name.

    An actuator without a name has that of its joint.
    """
    columns: dict[str, Array] = {}
    for i in range(model.nactuator):
        joint, column = int(model.actuator_trnid[i][0]), np.zeros(model.nv)
        gain = model.actuator_gear[i][0] * model.actuator_gainprm[i][0]
        column[model.jnt_dofadr[joint]] = gain
        name = model.actuator(i).name or element_name(model, "joint", joint)
        columns[f"actuator{i}" if name in columns else name] = column
    return columns or None
