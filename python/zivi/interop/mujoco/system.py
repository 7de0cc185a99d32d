"""Systems that MuJoCo computes, for what a tree has not."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.extras import needed
from zivi.base.machine_code import compiled
from zivi.interop.mujoco.actuators import controls
from zivi.interop.mujoco.geoms import gaps_of
from zivi.interop.mujoco.glue import SOURCE, Glue
from zivi.interop.mujoco.refuse import name_of, refuse_for_all
from zivi.system.impact_law import GivenRestitutions, restitutions, written
from zivi.system.layout import Layout
from zivi.system.mechanism import MAX_SIZE, MechanicalSystem, Model
from zivi.system.mechanism_checks import names_of

__all__ = ["MujocoSystem", "scalar_joints", "system"]


class MujocoSystem(MechanicalSystem):
    """What `system` makes: a `zivi.MechanicalSystem` that MuJoCo computes.

    Parameters
    ----------
    model : mujoco.MjModel
        The model; it is copied.
    gaps, e, ctrl, friction
        As for `system`.
    """

    derived = True

    def __init__(
        self,
        model: Any,
        gaps: Sequence[Any] | None = None,
        e: GivenRestitutions = 0.0,
        ctrl: ArrayLike | None = None,
        friction: str = "refuse",
    ) -> None:
        mujoco = needed("mujoco", "models of MuJoCo")
        if not isinstance(model, mujoco.MjModel):
            raise TypeError(f"model must be a mujoco.MjModel, got {model!r}")
        refuse_for_all(model)
        if not 1 <= model.nv <= MAX_SIZE:
            raise ValueError(f"model must have from 1 to {MAX_SIZE} coordinates, got {model.nv}")
        self._state = {"model": model, "gaps": gaps, "ctrl": ctrl, "friction": friction}
        own, flags = copy.copy(model), mujoco.mjtDisableBit
        own.opt.disableflags |= int(flags.mjDSBL_CONTACT) | int(flags.mjDSBL_CONSTRAINT)
        self._glue = Glue(own, gaps_of(model, gaps, friction), controls(model, ctrl))
        self._native = compiled({"c": SOURCE}, "c")
        self._gaps = ()
        self._gap_names = names_of("gaps", self._glue.names)
        if len(self._gap_names) > MAX_SIZE:
            raise ValueError(f"gaps must be at most {MAX_SIZE}, got {len(self._gap_names)}")
        self._n = int(model.nv)
        self._coordinates = tuple(name_of(model, "joint", i) for i in range(model.njnt))
        self._e = restitutions(e, len(self._gap_names))

    def model(self, n: int) -> Model:
        """Give what the extension integrates; `n` must be the number of joints."""
        if n != self._n:
            raise ValueError(f"q0 must have {self._n} entries, got {n}")
        return Model.of_code(Layout(n, self.m), self._native, self._glue.address, self._glue)

    def __repr__(self) -> str:
        told = f"joints=({', '.join(self._coordinates or ())}), gaps=({', '.join(self._gap_names)})"
        return f"MujocoSystem({told}, e={written(self._e)})"

    def __getstate__(self) -> dict[str, Any]:
        return {**self._state, "e": self._e}

    def __setstate__(self, state: dict[str, Any]) -> None:
        MujocoSystem.__init__(self, **state)


def system(
    model: Any,
    gaps: Sequence[Any] | None = None,
    e: GivenRestitutions = 0.0,
    ctrl: ArrayLike | None = None,
    friction: str = "refuse",
) -> MujocoSystem:
    """Give a model of MuJoCo as a system that MuJoCo computes, at every evaluation.

    For what a `zivi.Tree` has not: tendons, fluids, `gravcomp`, nonlinear springs and dampers,
    actuators with other transmissions. A tree needs less time, no MuJoCo and no C compiler.
    Mass and forces are MuJoCo's, contacts and limits are the gaps of zivi: ``solref`` and
    ``solimp`` are not read. Each evaluation works with an ``mjData`` of its own: batches may have
    any number of threads.

    Parameters
    ----------
    model : mujoco.MjModel
        The model; it is copied.
    gaps, e, ctrl, friction
        As for `zivi.Tree.from_mjcf`.

    Returns
    -------
    MujocoSystem
        A `zivi.MechanicalSystem`.

    Raises
    ------
    NotImplementedError
        For free and ball joints, constraints, dry friction, activations, plugins, flexes, mocap
        bodies and callbacks, by name.
    ImportError, RuntimeError
        Without MuJoCo, or without a C compiler.
    """
    return MujocoSystem(model, gaps, e, ctrl, friction)


def scalar_joints(spec: Any) -> Any:
    """Give a model whose free and ball joints are slides and hinges.

    A free joint becomes three slides and three hinges about x, y and z in this order, a ball joint
    three hinges, named ``name.x``, ..., ``name.roll``, ``name.pitch``, ``name.yaw``. At a pitch of
    +-90 degrees the mass matrix is singular.

    Parameters
    ----------
    spec : mujoco.MjSpec
        The model; it is left as it is.

    Returns
    -------
    mujoco.MjSpec
        A copy, to be compiled.

    Raises
    ------
    NotImplementedError
        For a free or ball joint with armature, damping, friction or stiffness, by its name.
    """
    mujoco = needed("mujoco", "models of MuJoCo")
    new, kinds = spec.copy(), mujoco.mjtJoint
    for body in list(new.bodies):
        for i, joint in enumerate(list(body.joints)):
            if joint.type not in (kinds.mjJNT_FREE, kinds.mjJNT_BALL):
                continue
            name, at = joint.name or f"{body.name}.joint{i}", np.array(joint.pos)
            _refuse_forces(joint, name)
            free = joint.type == kinds.mjJNT_FREE
            new.delete(joint)
            parts = [(kinds.mjJNT_SLIDE, k) for k in "xyz"] if free else []
            parts += [(kinds.mjJNT_HINGE, k) for k in ("roll", "pitch", "yaw")]
            for k, (kind, part) in enumerate(parts):
                axis = np.eye(3)[k % 3]
                added = body.add_joint(
                    name=f"{name}.{part}", type=kind, axis=axis, pos=at * (not free)
                )
                # nothing of the defaults of other joints
                added.limited = mujoco.mjtLimited.mjLIMITED_FALSE
                added.armature = added.frictionloss = 0.0
                added.stiffness, added.damping = (
                    np.zeros_like(added.stiffness),
                    np.zeros_like(added.damping),
                )
    return new


def _refuse_forces(joint: Any, name: str) -> None:
    """Refuse what acts along the axes of a joint that turns with it."""
    for what in ("armature", "damping", "frictionloss", "stiffness"):
        if np.any(getattr(joint, what)):
            raise NotImplementedError(
                f"scalar_joints takes no {what} of free and ball joints: joint {name!r}"
            )
