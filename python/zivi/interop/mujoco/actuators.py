"""Actuators at joints: springs, dampers and forces, and the inputs of closed loops."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from zivi.base.check import Array, real_array
from zivi.interop.mujoco.refusals import element_name

__all__ = ["Drive", "drives", "inputs_of", "read_ctrl"]


@dataclasses.dataclass
class Drive:
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


def drives(model: Any, ctrl: Any) -> dict[int, Drive]:
    """Return the force of the actuators by joint."""
    import mujoco

    given, found = read_ctrl(model, ctrl), {i: Drive() for i in range(model.njnt)}
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
                    f"zivi.Tree takes no limits of forces that depend on the state (forcerange): "
                    f"{called}; zivi.interop.mujoco.system does"
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
            f"zivi.Tree takes no actuators but at joints: {called}; zivi.interop.mujoco.system does"
        )
    if model.actuator_gaintype[i] != fixed or model.actuator_biastype[i] not in known:
        raise NotImplementedError(
            f"zivi.Tree takes no gains and biases of actuators but constant and affine ones: "
            f"{called}; zivi.interop.mujoco.system does"
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
