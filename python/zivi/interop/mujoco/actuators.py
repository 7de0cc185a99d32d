"""Actuators at joints with constant controls: springs, dampers and forces."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from zivi.base.check import Array, real_array
from zivi.interop.mujoco.refuse import name_of

__all__ = ["Drive", "controls", "drives"]


@dataclasses.dataclass
class Drive:
    r"""What the actuators do to a joint, :math:`\tau - k q - c \dot q`."""

    torque: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0


def controls(model: Any, ctrl: Any) -> Array:
    """Read the controls."""
    if ctrl is None:
        return np.zeros(model.nu)
    given = np.atleast_1d(real_array("ctrl", ctrl))
    if given.shape != (model.nu,) or not np.all(np.isfinite(given)):
        raise ValueError(f"ctrl must be {model.nu} finite numbers, got {given.tolist()}")
    return given


def drives(model: Any, ctrl: Any) -> dict[int, Drive]:
    """Give what acts on each joint."""
    import mujoco

    given, found = controls(model, ctrl), {i: Drive() for i in range(model.njnt)}
    joints = [int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)]
    none, affine = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)
    fixed = int(mujoco.mjtGain.mjGAIN_FIXED)
    for i in range(model.nactuator):
        called = f"actuator {name_of(model, 'actuator', i)!r}"
        one = (model.actuator_ctrlnum[i], model.actuator_outnum[i]) == (1, 1)
        if model.actuator_trntype[i] not in joints or not one:
            raise NotImplementedError(
                f"zivi.Tree takes no actuators but at joints: {called}; "
                "zivi.interop.mujoco.system does"
            )
        if model.actuator_gaintype[i] != fixed or model.actuator_biastype[i] not in (none, affine):
            raise NotImplementedError(
                f"zivi.Tree takes no gains and biases of actuators but constant and affine ones: "
                f"{called}; zivi.interop.mujoco.system does"
            )
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
