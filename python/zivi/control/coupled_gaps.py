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
"""Error of a gap or a function, relative to 1 and to it, of a configuration that is found."""
Names = tuple[str, ...]


def check_coupling(
    given: MechanicalReference,
    model: Model,
    tasks: Model | None,
    start: tuple[Array, Array],
    known: tuple[Array, Names, Names],
) -> None:
    """Refuse references that coupled gaps cannot follow, or that no configuration reaches.

    Parameters
    ----------
    given : MechanicalReference
        The reference.
    model, tasks : Model
        The system, and the functions of its coordinates that follow, if any.
    start : (ndarray, ndarray)
        Coordinates and velocities of the plant.
    known : (ndarray, tuple of str, tuple of str)
        The times of the reference, the names of its gaps and of those functions.
    """
    goals = given.goals if tasks is not None else None
    if not given.apart and goals is None:
        return  # the gaps are those of a motion of the system, or rest
    several = given.apart and given.gaps.shape[1] > 1
    q, found = start[0], [_cosine(model, *start)] if several else [0.0]
    for k in _places(given.gaps, goals):
        more = None if goals is None or tasks is None else (tasks, goals[k, 0])
        near = [q] if more is not None else [given.q[k], q, start[0]]
        q = _reached(model, near, given.gaps[k], more, (float(known[0][k]), *known[1:]))
        if several:
            found.append(_cosine(model, q, 0.0 * q))
    worst = max(found)
    if worst > COUPLED:
        raise ValueError(
            f"reference gives each gap a motion of its own, but the gaps are coupled, c = "
            f"{worst:.3g}: an impact on one kicks the other. Follow a motion of the system, "
            "zivi.reference_run"
        )


def _places(gaps: Array, goals: Array | None) -> list[int]:
    """Give the samples that are looked at: even ones, and those of the extremes."""
    rows = [gaps] if goals is None else [gaps, goals[:, 0]]
    count = len(gaps)
    ends = [it(axis=0).tolist() for row in rows for it in (row.argmax, row.argmin)]
    even = np.linspace(0, count - 1, min(PLACES, count)).astype(int).tolist()
    return sorted({*even, *(k for end in ends for k in end)})


def _cosine(model: Model, q: Array, qdot: Array) -> float:
    here = model.layout.read(model.evaluate(0.0, np.ascontiguousarray(q), qdot))
    cosines = kinetic_cosines(GapKinetics.of(here, qdot).D)
    np.fill_diagonal(cosines, 0.0)
    return float(np.abs(cosines).max())


def _reached(
    model: Model,
    near: list[Array],
    gaps: Array,
    more: tuple[Model, Array] | None,
    known: tuple[float, Names, Names],
) -> Array:
    """Give a configuration with these gaps and functions, near one of others; or tell the lack."""
    lacks = []
    for q in near:
        q, has = _configuration(model, q, gaps, more)
        wanted = gaps if more is None else np.concatenate([gaps, more[1]])
        lack = np.abs(has - wanted) / (1.0 + np.abs(wanted))
        if len(wanted) > len(q):  # more than can be: functions follow as far as there is room
            lack = lack[: len(gaps)]
        if np.all(lack <= REACHED):
            return q
        lacks.append((float(np.nan_to_num(lack, nan=np.inf).max()), has))
    t, *names = known
    _, has = min(lacks, key=lambda it: it[0])
    words = [
        f"{name!r} = {one:.6g} ({abs(one - other):.3g} from the nearest found, {other:.6g})"
        for name, one, other in zip((*names[0], *names[1]), wanted, has, strict=False)
        if not abs(one - other) <= REACHED * (1.0 + abs(one))
    ]
    raise ValueError(
        f"reference asks at t = {t:.6g} for what no configuration was found to have: "
        f"{', '.join(words)}"
    )


def _configuration(
    model: Model, q: Array, gaps: Array, more: tuple[Model, Array] | None = None
) -> tuple[Array, Array]:
    """Give coordinates with these gaps and functions, near others, and what they do have."""
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
    has = [model.layout.read(model.evaluate(0.0, q, still)).gaps]
    if more is not None:
        has.append(more[0].layout.read(more[0].evaluate(0.0, q, still)).gaps)
    return q, np.concatenate(has)
