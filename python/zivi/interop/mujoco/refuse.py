"""What a tree has not, refused by its name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

__all__ = ["name_of", "refuse_for_all", "refuse_for_tree"]


def name_of(model: Any, kind: str, index: int) -> str:
    """Give the name of an element, or one by its number."""
    return str(getattr(model, kind)(index).name) or f"{kind}{index}"


def _which(kind: str, condition: Callable[[Any], Any]) -> Callable[[Any], str | None]:
    """Find the first element for which a condition holds."""

    def found(model: Any) -> str | None:
        wrong = np.flatnonzero(np.asarray(condition(model)))
        return None if not len(wrong) else f"{kind} {name_of(model, kind, int(wrong[0]))!r}"

    return found


def _some(what: str, condition: Callable[[Any], Any]) -> Callable[[Any], str | None]:
    return lambda model: what if condition(model) else None


def _joints(field: str) -> Callable[[Any], Any]:
    """Look at a field of degrees of freedom by joint."""

    def by_joint(model: Any) -> Any:
        wrong = np.zeros(model.njnt, bool)
        rows = np.asarray(getattr(model, field)).reshape(model.nv, -1)
        np.logical_or.at(wrong, model.dof_jntid, np.any(rows != 0, axis=1))
        return wrong

    return by_joint


def _limited_drives(model: Any) -> Any:
    """Find the joints that have actuators and a limit of their force."""
    driven = np.zeros(model.njnt, bool)
    at_joints = model.actuator_trntype <= 1
    driven[model.actuator_trnid[at_joints, 0]] = True
    return driven & (model.jnt_actfrclimited != 0)


def _callbacks(_: Any) -> bool:
    import mujoco

    names = ("control", "passive", "act_gain", "act_bias", "act_dyn")
    return any(getattr(mujoco, f"get_mjcb_{name}")() is not None for name in names)


def _disabled(flag: str) -> Callable[[Any], bool]:
    def off(model: Any) -> bool:
        import mujoco

        return bool(model.opt.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))

    return off


FREE, BALL = 0, 1
FOR_ALL: dict[str, Callable[[Any], str | None]] = {
    "models without joints": _some("nv = 0", lambda model: model.nv == 0),
    "free joints (see zivi.interop.mujoco.scalar_joints)": _which(
        "joint", lambda model: model.jnt_type == FREE
    ),
    "ball joints (see zivi.interop.mujoco.scalar_joints)": _which(
        "joint", lambda model: model.jnt_type == BALL
    ),
    "equality constraints": _some("equality", lambda model: model.neq > 0),
    "friction in joints (frictionloss)": _which("joint", _joints("dof_frictionloss")),
    "friction in tendons (frictionloss)": _which("tendon", lambda m: m.tendon_frictionloss != 0),
    "limits of tendons": _which("tendon", lambda model: model.tendon_limited != 0),
    "activations of actuators": _some("na > 0", lambda model: model.na > 0),
    "delays": _some("nhistory > 0", lambda model: model.nhistory > 0),
    "plugins": _some("nplugin > 0", lambda model: model.nplugin > 0),
    "flexes": _some("nflex > 0", lambda model: model.nflex > 0),
    "springs that yield": _some("nplastic > 0", lambda model: model.nplastic > 0),
    "mocap bodies": _which("body", lambda model: model.body_mocapid >= 0),
    "callbacks of the user": _some("mjcb", _callbacks),
}
"""What neither a tree nor `system` takes: no force of a smooth mechanism in scalar coordinates."""

FOR_TREE: dict[str, Callable[[Any], str | None]] = {
    "tendons": _which("tendon", lambda model: np.ones(model.ntendon, bool)),
    "compensation of gravity (gravcomp)": _which("body", lambda model: model.body_gravcomp != 0),
    "springs that are not linear": _which("joint", lambda m: np.any(m.jnt_stiffnesspoly, axis=1)),
    "dampers that are not linear": _which("joint", _joints("dof_dampingpoly")),
    "fluids": _some("density or viscosity", lambda m: m.opt.density != 0 or m.opt.viscosity != 0),
    "limits of the forces at joints (actuatorfrcrange)": _which("joint", _limited_drives),
    "inertia of actuators": _which("actuator", lambda model: model.actuator_armature != 0),
    "damping of actuators": _which("actuator", lambda model: model.actuator_damping != 0),
    "groups of actuators that are off": _some(
        "actuatorgroupdisable", lambda model: model.opt.disableactuator != 0
    ),
    "springs that are off": _some("the flag spring", _disabled("SPRING")),
    "dampers that are off": _some("the flag damper", _disabled("DAMPER")),
    "actuators that are off": _some("the flag actuation", _disabled("ACTUATION")),
    "controls without their range": _some("the flag clampctrl", _disabled("CLAMPCTRL")),
}
"""What a tree has not, but `system` takes."""


def refuse_for_all(model: Any) -> None:
    """Refuse what is not a smooth mechanism in scalar coordinates."""
    _refuse(model, FOR_ALL, "zivi takes no {what} of MuJoCo: {which}")


def refuse_for_tree(model: Any) -> None:
    """Refuse what a tree has not."""
    refuse_for_all(model)
    _refuse(model, FOR_TREE, "zivi.Tree takes no {what}: {which}; zivi.interop.mujoco.system does")


def _refuse(model: Any, table: dict[str, Callable[[Any], str | None]], told: str) -> None:
    for what, look in table.items():
        if (which := look(model)) is not None:
            raise NotImplementedError(told.format(what=what, which=which))
