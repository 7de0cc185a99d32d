"""Parts of MuJoCo's models that zivi does not have, rejected by their names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


def element_name(model: Any, kind: str, index: int) -> str:
    """Return the name of an element, or its kind and number if it has none."""
    return str(getattr(model, kind)(index).name) or f"{kind}{index}"


Search = Callable[[Any], str | None]
"""Names the first element that is not supported, None if there is none."""


def _which(kind: str, condition: Callable[[Any], Any]) -> Search:
    """Find the first element for which a condition holds."""

    def found(model: Any) -> str | None:
        wrong = np.flatnonzero(np.asarray(condition(model)))
        return None if not len(wrong) else f"{kind} {element_name(model, kind, int(wrong[0]))!r}"

    return found


def _every(kind: str, count: str) -> Search:
    """Find the first element of a kind."""
    return _which(kind, lambda model: np.ones(getattr(model, count), bool))


def _some(what: str, condition: Callable[[Any], Any]) -> Search:
    return lambda model: what if condition(model) else None


def _joints(field: str) -> Callable[[Any], Any]:
    """Look at a field of degrees of freedom by joint."""

    def by_joint(model: Any) -> Any:
        wrong = np.zeros(model.njnt, bool)
        rows = np.asarray(getattr(model, field)).reshape(model.nv, -1)
        np.logical_or.at(wrong, model.dof_jntid, np.any(rows != 0, axis=1))
        return wrong

    return by_joint


def _activated(model: Any) -> Any:
    return np.asarray(model.actuator_actnum) > 0


def _limited_drives(model: Any) -> Any:
    """Find the joints that have actuators and a limit of their force."""
    driven = np.zeros(model.njnt, bool)
    at_joints = model.actuator_trntype <= 1
    driven[model.actuator_trnid[at_joints, 0]] = True
    return driven & (model.jnt_actfrclimited != 0)


def _other_equalities(model: Any) -> Any:
    """Find equality constraints other than connect, weld and joint."""
    return np.asarray(model.eq_type) > JOINT


FREE, BALL = 0, 1
CONNECT, WELD, JOINT = 0, 1, 2
"""Kinds of equality constraints of MuJoCo."""


def _rotating(condition: Callable[[Any], Any]) -> Search:
    """Find the first free or ball joint for which a condition holds."""
    return _which("joint", lambda model: (model.jnt_type <= BALL) & np.asarray(condition(model)))


def _with_actuator(model: Any) -> Any:
    found = np.zeros(model.njnt, bool)
    found[model.actuator_trnid[model.actuator_trntype <= 1, 0]] = True
    return found


def _callbacks(_: Any) -> bool:
    import mujoco

    names = ("control", "passive", "act_gain", "act_bias", "act_dyn")
    return any(getattr(mujoco, f"get_mjcb_{name}")() is not None for name in names)


def is_off(model: Any, flag: str) -> bool:
    """Whether a flag disables a part of a model, or CONSTRAINT all its constraints."""
    import mujoco

    bits = [getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}") for name in (flag, "CONSTRAINT")]
    return any(model.opt.disableflags & bit for bit in bits)


def _disabled(flag: str) -> Callable[[Any], bool]:
    def off(model: Any) -> bool:
        import mujoco

        return bool(model.opt.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))

    return off


SCALAR = "zivi.interop.mujoco.scalar_joints(spec) replaces it by slides and hinges"
Refusal = tuple[str, Search, str]
"""What is not supported, the search for it, and what would work."""
FOR_ALL: tuple[Refusal, ...] = (
    (
        "models without joints",
        _some("nv = 0", lambda model: model.nv == 0),
        "give a body a joint",
    ),
    (
        "friction in tendons (frictionloss)",
        _which("tendon", lambda m: m.tendon_frictionloss != 0),
        "set it to 0, or use frictionloss of a joint",
    ),
    (
        "limits of tendons",
        _which("tendon", lambda model: model.tendon_limited != 0),
        "set limited='false' and write the limit as a zivi.Gap of a zivi.MechanicalSystem",
    ),
    (
        "activations of actuators",
        _which("actuator", _activated),
        "set dyntype='none'",
    ),
    ("delays", _some("nhistory > 0", lambda model: model.nhistory > 0), "remove them"),
    ("plugins", _some("nplugin > 0", lambda model: model.nplugin > 0), "remove them"),
    ("flexes", _some("nflex > 0", lambda model: model.nflex > 0), "remove them"),
    (
        "springs that yield",
        _some("nplastic > 0", lambda model: model.nplastic > 0),
        "use springs with a constant rest length",
    ),
    (
        "mocap bodies",
        _which("body", lambda model: model.body_mocapid >= 0),
        "set mocap='false'",
    ),
    (
        "callbacks of the user",
        _some("mjcb", _callbacks),
        "remove them, e.g. mujoco.set_mjcb_control(None)",
    ),
)
"""Neither a tree nor `system` has these: they are no forces of a smooth mechanism in scalar
coordinates."""

FOR_SYSTEM: tuple[Refusal, ...] = (
    ("free joints", _which("joint", lambda model: model.jnt_type == FREE), SCALAR),
    ("ball joints", _which("joint", lambda model: model.jnt_type == BALL), SCALAR),
    (
        "equality constraints",
        _every("equality", "neq"),
        "zivi.Tree.from_mjcf reads connect, weld and joint; or delete it",
    ),
    (
        "friction in joints (frictionloss)",
        _which("joint", _joints("dof_frictionloss")),
        "zivi.Tree.from_mjcf reads it, or set it to 0",
    ),
)
"""What `system` does not have."""

BY_MUJOCO = "use zivi.interop.mujoco.system"
UNSUPPORTED = "zivi does not support {what} of MuJoCo: {which}; {remedy}"
FOR_TREE: tuple[Refusal, ...] = tuple(
    (what, search, BY_MUJOCO)
    for what, search in (
        ("equality constraints of this kind", _which("equality", _other_equalities)),
        ("tendons", _every("tendon", "ntendon")),
        (
            "compensation of gravity (gravcomp)",
            _which("body", lambda model: model.body_gravcomp != 0),
        ),
        (
            "springs that are not linear",
            _which("joint", lambda m: np.any(m.jnt_stiffnesspoly, axis=1)),
        ),
        ("dampers that are not linear", _which("joint", _joints("dof_dampingpoly"))),
        (
            "fluids",
            _some("density or viscosity", lambda m: m.opt.density != 0 or m.opt.viscosity != 0),
        ),
        ("limits of the forces at joints (actuatorfrcrange)", _which("joint", _limited_drives)),
        ("inertia of actuators", _which("actuator", lambda model: model.actuator_armature != 0)),
        ("damping of actuators", _which("actuator", lambda model: model.actuator_damping != 0)),
        (
            "groups of actuators that are off",
            _some("actuatorgroupdisable", lambda model: model.opt.disableactuator != 0),
        ),
        ("springs that are off", _some("the flag spring", _disabled("SPRING"))),
        ("dampers that are off", _some("the flag damper", _disabled("DAMPER"))),
        ("actuators that are off", _some("the flag actuation", _disabled("ACTUATION"))),
        ("controls without their range", _some("the flag clampctrl", _disabled("CLAMPCTRL"))),
    )
)
"""What a tree does not have, but `system` has."""

OF_ROTATIONS: tuple[Refusal, ...] = (
    ("damping of free and ball joints", _rotating(_joints("dof_damping")), "set damping='0'"),
    ("armature of free and ball joints", _rotating(_joints("dof_armature")), "set armature='0'"),
    (
        "friction in free and ball joints (frictionloss)",
        _rotating(_joints("dof_frictionloss")),
        "set frictionloss='0'",
    ),
    (
        "springs of free and ball joints",
        _rotating(lambda model: model.jnt_stiffness != 0),
        "set stiffness='0'",
    ),
    (
        "limits of ball joints",
        _rotating(lambda model: model.jnt_limited != 0),
        "set limited='false'",
    ),
    ("actuators at free and ball joints", _rotating(_with_actuator), "use hinges and slides"),
)
"""What a tree does not have at joints that rotate in space."""


def refuse_for_system(model: Any) -> None:
    """Reject what `system` does not have."""
    _reject(model, FOR_ALL + FOR_SYSTEM, UNSUPPORTED)


def refuse_for_tree(model: Any) -> None:
    """Reject what a tree does not have."""
    _reject(model, FOR_ALL, UNSUPPORTED)
    _reject(model, FOR_TREE, "zivi.Tree does not support {what}: {which}; {remedy}")
    _reject(model, OF_ROTATIONS, "zivi.Tree does not support {what}: {which}; {remedy}")


def _reject(model: Any, table: tuple[Refusal, ...], told: str) -> None:
    for what, search, remedy in table:
        if (which := search(model)) is not None:
            raise NotImplementedError(told.format(what=what, which=which, remedy=remedy))
