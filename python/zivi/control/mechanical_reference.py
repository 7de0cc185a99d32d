"""References of mechanical systems at the samples of a controller."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, real_array
from zivi.control.loop_reference import SLOWEST, sampled_run
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.trajectory import Trajectory
from zivi.system.gap_coordinates import check_independent
from zivi.system.layout import places
from zivi.system.mechanism import Model

__all__ = ["MechanicalReference", "ReferenceSample", "reference_of"]

MOST_IMPACTS = 100_000
"""Impacts of an accumulation of a reference that are counted."""


class ReferenceSample(NamedTuple):
    """Where a reference is at one sample.

    Attributes
    ----------
    q, qdot : ndarray
        Coordinates and velocities, shape (n,).
    sides : ndarray
        1 or -1 for each gap, the other after each impact, shape (m,).
    contacts : ndarray of bool
        Which gaps are closed and stay so, shape (m,).
    gaps, gap_rates : ndarray or None
        Gaps and their rates, shape (m,); without them the controller's own model says.
    accelerations : ndarray or None
        Of the gaps, without the force of their own contact, shape (m,): in contact they are
        negative. Without them the difference of the rates.
    qddot : ndarray or None
        Accelerations of the coordinates without contact forces, shape (n,); 0 without them.
    tasks : ndarray or None
        The functions of the controller's `tasks`, their first and second derivatives, shape (3, k);
        without them they do not follow.
    """

    q: Array
    qdot: Array
    sides: Array
    contacts: NDArray[np.bool_]
    gaps: Array | None = None
    gap_rates: Array | None = None
    accelerations: Array | None = None
    qddot: Array | None = None
    tasks: Array | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class MechanicalReference:
    """A reference at the samples, one array a quantity.

    Parameters
    ----------
    q, qdot, qddot : ndarray
        Shape (k, n).
    gaps, gap_rates, accelerations, sides : ndarray
        Shape (k, m).
    contacts : ndarray of bool
        Shape (k, m).
    apart : bool
        Whether gaps and coordinates were given apart: their coupling must be small then.
    goals : ndarray or None
        Functions of the coordinates that follow, first and second derivatives, shape (k, 3, p).
    """

    q: Array
    qdot: Array
    qddot: Array
    gaps: Array
    gap_rates: Array
    accelerations: Array
    sides: Array
    contacts: NDArray[np.bool_]
    apart: bool = False
    goals: Array | None = None

    def sample(self, k: int) -> ReferenceSample:
        """Give sample `k`, the last one beyond the end."""
        k = min(k, len(self.q) - 1)
        return ReferenceSample(
            self.q[k],
            self.qdot[k],
            self.sides[k],
            self.contacts[k],
            self.gaps[k],
            self.gap_rates[k],
            self.accelerations[k],
            self.qddot[k],
            None if self.goals is None else self.goals[k],
        )


def reference_of(
    reference: Any, times: Array, names: tuple[str, ...], q0: Array, tasks: tuple[str, ...] = ()
) -> MechanicalReference | None:
    """Translate what a loop is given, for a controller with these tasks; None for none."""
    if reference is None or isinstance(reference, MechanicalReference):
        return reference
    if isinstance(reference, MechanicalTrajectory):
        return of_run(reference, times, names, q0)
    if isinstance(reference, str):
        reference = {}.fromkeys(names, reference)
    if not isinstance(reference, Mapping):
        raise TypeError(
            "reference must be a run of zivi.simulate or zivi.reference_run, 'rest', or a dict of "
            f"one for each gap and the posture, got {type(reference).__name__}"
        )
    return of_parts(dict(reference), times, names, q0, tasks)


def of_run(
    run: MechanicalTrajectory, times: Array, names: tuple[str, ...], q0: Array
) -> MechanicalReference:
    """Give a run of the system at the samples."""
    if run.gap_names != names:
        raise ValueError(f"reference must have the gaps {names}, it has {run.gap_names}")
    start, end = run._extent()
    if not (start <= times[0] and times[-1] <= end):
        raise ValueError(
            f"reference must be known over t_span = ({times[0]}, {times[-1]}), "
            f"it is a run over ({start}, {end})"
        )
    model = run._model
    if model is None:
        raise ValueError("reference has lost its system, as runs do that were loaded or sent")
    q, qdot, gaps, rates, contacts = run._known().at(np.ascontiguousarray(times))
    if q.shape[1] != len(q0):
        raise ValueError(f"reference must have {len(q0)} coordinates, it has {q.shape[1]}")
    gaps, rates = np.where(contacts, 0.0, gaps), np.where(contacts, 0.0, rates)
    qddot, accelerations = _without_contacts(model, times, (q, qdot), contacts)
    sides = _sides(run, times, len(names))
    return MechanicalReference(q, qdot, qddot, gaps, rates, accelerations, sides, contacts)


def _without_contacts(
    model: Model, times: Array, states: tuple[Array, Array], contacts: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Give the accelerations of coordinates and of gaps, each gap's without its own force."""
    layout, (q, qdot) = model.layout, (np.ascontiguousarray(it) for it in states)
    rows = np.empty((len(times), layout.size))
    for k, t in enumerate(times.tolist()):
        rows[k] = model.evaluate(t, q[k], qdot[k])
    count = len(times)
    part = {name: rows[:, at].reshape(count, *shape) for name, at, shape in places(layout)}
    mass, normals = part["mass"], part["gradients"]
    qddot: Any = np.linalg.solve(mass, part["force"][:, :, None])[:, :, 0]
    accelerations: Array = (normals @ qddot[:, :, None])[:, :, 0] + part["curvatures"]
    mobility: Any = np.linalg.solve(mass, normals.transpose(0, 2, 1))
    D: Array = normals @ mobility
    D = 0.5 * (D + D.transpose(0, 2, 1))
    check_independent(D)
    if layout.m > 1:  # one gap has no others
        for k in np.flatnonzero(contacts.any(axis=1)).tolist():
            accelerations[k] += _pushed(D[k], accelerations[k], contacts[k])
    return qddot, accelerations


def _pushed(D: Array, free: Array, closed: NDArray[np.bool_]) -> Array:
    """Give what each gap gets from the forces of the other contacts."""
    forces = np.zeros(len(free))
    if closed.any():
        inside = np.ix_(closed, closed)
        forces[closed] = -np.linalg.solve(D[inside], free[closed])
    pushed: Array = D @ forces - np.diag(D) * forces
    return pushed


def _sides(run: MechanicalTrajectory, times: Array, m: int) -> Array:
    """Give the branch of each gap: 1, and the other after each of its impacts."""
    impacts = run.impacts_down_to(SLOWEST, limit=MOST_IMPACTS)
    sides = np.ones((len(times), m))
    for i in range(m):
        own = impacts[(impacts["gap"] == i) & (impacts["speed_before"] < 0.0)]["t"]
        sides[np.searchsorted(own, times, side="right") % 2 == 1, i] = -1.0
    return sides


def of_parts(
    parts: dict[str, Any],
    times: Array,
    names: tuple[str, ...],
    q0: Array,
    tasks: tuple[str, ...],
) -> MechanicalReference:
    """Give a reference that is told gap by gap, and what the rest of it follows."""
    posture = parts.pop("posture", q0)
    goals = goals_of({name: parts.pop(name) for name in tasks if name in parts}, tasks, times)
    strange = sorted(set(parts) - set(names))
    if strange:
        raise ValueError(f"reference has {strange[0]!r}, which is no gap of {names} and no task")
    missing = sorted(set(names) - set(parts))
    if missing:
        raise ValueError(f"reference must say what gap {missing[0]!r} does: 'rest' or a run")
    count, m, n = len(times), len(names), len(q0)
    gaps, rates, pulls = (np.zeros((count, m)) for _ in range(3))
    sides, contacts = np.ones((count, m)), np.ones((count, m), dtype=bool)
    for i, name in enumerate(names):
        one = parts[name]
        if isinstance(one, str):
            if one != "rest":
                raise ValueError(f"reference[{name!r}] must be 'rest' or a run, got {one!r}")
            continue
        rows = _scalar(name, one, times)
        gaps[:, i], rates[:, i], sides[:, i], pulls[:, i] = rows
        contacts[:, i] = (rows[0] == 0.0) & (rows[1] == 0.0)
    q, qdot, qddot = posture_at(posture, times, n)
    moving = not contacts.all()
    of_gaps = gaps, rates, pulls, sides
    return MechanicalReference(q, qdot, qddot, *of_gaps, contacts, apart=moving, goals=goals)


def goals_of(parts: dict[str, Any], tasks: tuple[str, ...], times: Array) -> Array | None:
    """Give functions of the coordinates with their derivatives at the times; None for none."""
    if not parts:
        return None
    goals = np.zeros((len(times), 3, len(tasks)))
    for j, name in enumerate(tasks):
        if name not in parts:
            raise ValueError(
                f"reference must say what task {name!r} does, as it does of {[*parts]}"
            )
        one = parts[name]
        for k, t in enumerate(times.tolist()):
            given = np.atleast_1d(
                real_array(f"reference[{name!r}]", one(t) if callable(one) else one)
            )
            if given.ndim != 1 or not 1 <= len(given) <= 3 or not np.all(np.isfinite(given)):
                raise ValueError(
                    f"reference[{name!r}] must be one finite number, or with its first and second "
                    f"derivatives, got shape {given.shape}"
                )
            goals[k, : len(given), j] = given
    return goals


def _scalar(name: str, run: Any, times: Array) -> tuple[Array, Array, Array, Array]:
    """Give a gap that is a run of one mass: position, velocity, side, acceleration."""
    if not isinstance(run, Trajectory):
        raise TypeError(
            f"reference[{name!r}] must be 'rest' or a run of one mass, got {type(run).__name__}"
        )
    start, end = run._extent()
    if not (start <= times[0] and times[-1] <= end):
        raise ValueError(f"reference[{name!r}] must be known over ({times[0]}, {times[-1]})")
    x, xdot, side, pull = sampled_run(run, times)
    return x, xdot, np.where(side == 0.0, 1.0, side), np.append(pull, pull[-1:])


def posture_at(posture: Any, times: Array, n: int) -> tuple[Array, Array, Array]:
    """Give ``(q, qdot, qddot)`` of a posture, constant or a function of time, at the times."""
    if callable(posture):
        rows = [posture_of(posture, float(t), n) for t in times]
        q, qdot, qddot = (np.array(it) for it in zip(*rows, strict=True))
        return q, qdot, qddot
    one = posture_of(posture, 0.0, n)
    q, qdot, qddot = (np.tile(it, (len(times), 1)) for it in one)
    return q, qdot, qddot


def posture_of(
    posture: Array | Callable[[float], Any], t: float, n: int
) -> tuple[Array, Array, Array]:
    """Read a posture at one time: ``q``, or ``(q, qdot)``, or with its acceleration."""
    given = real_array("posture", posture(t) if callable(posture) else posture)
    rows = given.reshape(1, -1) if given.ndim < 2 else given
    if rows.ndim != 2 or rows.shape[1] != n or len(rows) > 3 or not np.all(np.isfinite(rows)):
        raise ValueError(
            f"posture must be {n} finite coordinates, or these with velocities and "
            f"accelerations, got shape {given.shape}"
        )
    full = np.zeros((3, n))
    full[: len(rows)] = rows
    return full[0], full[1], full[2]
