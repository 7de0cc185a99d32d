"""A mass at a spring on a belt: its runs, their lines, their numbers, their motion."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.lab.settings import Belt
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import ExplicitEuler, SwitchedRK, ThetaGamma
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.friction import DryFriction
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem

__all__ = ["FAR", "BeltRun", "SignedSlip", "belt_runs"]

FAR = 1000.0
"""How far the wall is from the mass with the explicit sign, which never meets it (m)."""


class SignedSlip:
    """The spring, the damper and the sign of the slip speed as it is, FAR above a wall."""

    def __init__(self, stiffness: float, damping: float, limit: float, speed: float) -> None:
        self.stiffness, self.damping = stiffness, damping
        self.limit, self.speed = limit, speed

    def __call__(self, t: float, x: float, xdot: float) -> float:
        """Give the acceleration of the unit mass."""
        smooth = -self.stiffness * (x - FAR) - self.damping * xdot
        return float(smooth + self.friction(xdot))

    def friction(self, xdot: Any) -> Any:
        """Give the force of the belt."""
        return -self.limit * np.sign(xdot - self.speed)


@dataclasses.dataclass(frozen=True)
class BeltRun:
    """One run, with what is drawn of it.

    Parameters
    ----------
    run : MechanicalTrajectory or Trajectory
        The run.
    x, xdot : ndarray
        Position (m) and velocity (m/s) at its samples.
    slip : ndarray
        Speed relative to the belt (m/s).
    friction : ndarray
        Force of the belt (N).
    sticks : ndarray of bool
        Where the mass sticks.
    speed : float
        Speed of the belt (m/s).
    """

    run: MechanicalTrajectory | Trajectory
    x: Array
    xdot: Array
    slip: Array
    friction: Array
    sticks: NDArray[np.bool_]
    speed: float

    @property
    def t(self) -> Array:
        """Times of the samples (s)."""
        return self.run.t

    @property
    def success(self) -> bool:
        """Whether the end was reached."""
        return self.run.success

    @property
    def message(self) -> str:
        """What happened."""
        return self.run.message

    @property
    def stuck(self) -> float:
        """The part of the time in which the mass sticks."""
        if isinstance(self.run, Trajectory):
            return 0.0
        lengths = self.run.stick["t_end"] - self.run.stick["t_start"]
        return float(lengths.sum() / (self.t[-1] - self.t[0])) if len(self.t) > 1 else 0.0

    @property
    def catches(self) -> int:
        """How often the belt catches the mass."""
        return 0 if isinstance(self.run, Trajectory) else len(self.run.stick)


def belt_runs(given: Belt) -> dict[str, BeltRun]:
    """Simulate a mass on a belt: with the implicit sign, the explicit one, and to a tolerance."""
    belt = DryFriction(limit=given.limit, static=given.limit + given.extra, velocity=given.speed)
    system = MechanicalSystem(
        mass=1.0,
        force=lambda t, q, qdot: -given.stiffness * q - given.damping * qdot,
        friction=[belt],
    )
    span, start = (0.0, given.t_end), ([given.x0], [given.xdot0])
    times = np.linspace(0.0, given.t_end, round(given.t_end / given.h) + 1)
    implicit = simulate(system, span, start, ThetaGamma(given.h), progress=False)
    switched = simulate(system, span, start, SwitchedRK(), t_eval=times, progress=False)
    signed = SignedSlip(given.stiffness, given.damping, given.limit, given.speed)
    explicit = simulate(
        ImpactSystem(signed, e=1.0),
        span,
        (FAR + given.x0, given.xdot0),
        ExplicitEuler(given.h),
        progress=False,
    )
    return {
        "implicit": _stuck(implicit, given.speed),
        "explicit": BeltRun(
            explicit,
            explicit.x - FAR,
            explicit.xdot,
            explicit.xdot - given.speed,
            signed.friction(explicit.xdot),
            np.zeros(len(explicit.t), dtype=bool),
            given.speed,
        ),
        "high_order": _stuck(switched, given.speed),
    }


def _stuck(run: MechanicalTrajectory, speed: float) -> BeltRun:
    forces, modes = run.friction_forces[:, 0], run.modes[:, 0]
    return BeltRun(run, run.q[:, 0], run.qdot[:, 0], run.slips[:, 0], forces, modes == 0, speed)
