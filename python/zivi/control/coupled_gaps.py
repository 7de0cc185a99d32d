"""Whether references that are given gap by gap can be followed: the guard for coupled gaps."""

from __future__ import annotations

import numpy as np

from zivi.base.check import Array
from zivi.control.mechanical_reference import MechanicalReference
from zivi.system.gap_coordinates import GapKinetics, kinetic_cosines
from zivi.system.mechanism import Model

__all__ = ["check_coupling"]

COUPLED = 0.05
"""Largest kinetic cosine of gaps whose references know nothing of each other."""
PLACES = 21
"""At so many samples of a reference the coupling is looked at."""
STEPS = 40
"""Newton steps to the configuration at a sample."""
LONGEST = 0.3
"""Longest of them."""
REACHED = 1e-6
"""Error of a gap, relative to 1 and the gap, of a configuration that is found."""


def check_coupling(
    given: MechanicalReference, model: Model, tasks: Model | None, start: tuple[Array, Array]
) -> None:
    """Refuse references that coupled gaps cannot follow.

    Parameters
    ----------
    given : MechanicalReference
        The reference.
    model, tasks : Model
        The system, and the functions of its coordinates that follow, if any.
    start : (ndarray, ndarray)
        Coordinates and velocities of the plant.
    """
    if not given.apart or given.gaps.shape[1] < 2:
        return
    goals = given.goals if tasks is not None else None
    q, found = start[0], [_cosine(model, *start)]
    for k in np.linspace(0, len(given.q) - 1, min(PLACES, len(given.q))).astype(int).tolist():
        if goals is None or tasks is None:
            q = _configuration(model, given.q[k], given.gaps[k])
        else:
            q = _configuration(model, q, given.gaps[k], (tasks, goals[k, 0]))
        found.append(_cosine(model, q, 0.0 * q))
    worst = max(found)
    if worst > COUPLED:
        raise ValueError(
            f"reference gives each gap a motion of its own, but the gaps are coupled, c = "
            f"{worst:.3g}: an impact on one kicks the other. Follow a motion of the system, "
            "zivi.reference_run"
        )


def _cosine(model: Model, q: Array, qdot: Array) -> float:
    here = model.layout.read(model.evaluate(0.0, np.ascontiguousarray(q), qdot))
    cosines = kinetic_cosines(GapKinetics.of(here, qdot).D)
    np.fill_diagonal(cosines, 0.0)
    return float(np.abs(cosines).max())


def _configuration(
    model: Model, q: Array, gaps: Array, more: tuple[Model, Array] | None = None
) -> Array:
    """Give coordinates with these gaps and, as far as that leaves room, functions, near others."""
    q, still = np.array(q, dtype=np.float64), np.zeros(len(q))
    for k in range(2 * STEPS):
        here = model.layout.read(model.evaluate(0.0, q, still))
        missing = gaps - here.gaps
        to_gaps = np.linalg.pinv(here.gradients)
        step: Array = to_gaps @ missing
        if more is not None and k < STEPS:
            functions, goal = more
            there = functions.layout.read(functions.evaluate(0.0, q, still))
            beside = there.gradients @ (np.eye(len(q)) - to_gaps @ here.gradients)
            left = goal - there.gaps - there.gradients @ step
            step = step + np.linalg.pinv(beside, rcond=1e-6) @ left
        length = float(np.linalg.norm(step))
        q = q + step * min(1.0, LONGEST / max(length, 1e-300))
        if length < 1e-10:
            break
    here = model.layout.read(model.evaluate(0.0, q, still))
    if not np.all(np.abs(here.gaps - gaps) <= REACHED * (1.0 + np.abs(gaps))):
        raise ValueError(
            f"reference has gaps that the system does not have at once: {gaps.tolist()}, "
            f"the nearest found are {here.gaps.tolist()}"
        )
    return q
