"""The letter Z: from the first impact of an accumulation to shortly after its end."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.base.status import Status
from zivi.derivatives.sensitivity import sensitivity
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.flow import Flow
from zivi.orbits.mechanical.word import Segment
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import simulate
from zivi.system.mechanism import MechanicalSystem

__all__ = ["Accumulation", "accumulated", "after_event", "onto"]

AFTER = 1e-7
"""How long after its end an accumulation hands on to the contact, in periods."""


@dataclasses.dataclass(frozen=True)
class Accumulation:
    """An accumulation from the state after its first impact."""

    zeno: float
    """When it ends."""
    t: float
    """A little later, where its map ends."""
    z: Array
    by_z: Array
    """Derivatives of ``(t, z)`` by the state at the start, shape (1 + 2n, 2n)."""
    by_t: Array
    """And by its time."""
    impacts: Any
    """The impacts that were computed."""


def onto(flow: Flow, closed: Sequence[int], t: float, z: Array, rates: Sequence[int] = ()) -> Array:
    """Move a state by rounding so that gaps are closed, and some of them do not move."""
    z, n = z.copy(), flow.n
    for _ in range(2):
        for wanted, place, own in ((0, 0, closed), (1, n, rates)):
            if not len(own):
                continue
            off = np.array([flow.gaps(np.array([t]), z[None])[wanted][0, i] for i in own])
            normals = np.array([flow.gap(i, t, z).by_z[:n] for i in own])
            z[place : place + n] -= np.linalg.pinv(normals) @ off
    return z


def after_event(
    system: MechanicalSystem,
    method: SwitchedRK,
    flow: Flow,
    segment: Segment,
    t: float,
    before: Array,
    length: float,
) -> Array:
    """Give time and state after the event that ends a segment, a row ``(t, z)``."""
    if segment.kind in "LP":
        return np.append(t, before)
    e = 0.0 if segment.kind == "S" else float(flow.e[segment.gap])
    jump = flow.impact(segment.gap, segment.kept, t, before, e)
    if segment.kind != "Z":
        return np.append(t, jump.z)
    begin = onto(flow, [segment.gap, *segment.kept], t, jump.z, segment.kept)
    chain = accumulated(system, method, (t, begin), segment.gap, length, slopes=False)
    return np.append(chain.t, chain.z)


def accumulated(
    system: MechanicalSystem,
    method: SwitchedRK,
    start: tuple[float, Array],
    gap: int,
    horizon: float,
    *,
    slopes: bool = True,
) -> Accumulation:
    """Simulate an accumulation with its derivatives.

    Raises
    ------
    FlightError
        If the impacts on the gap do not accumulate within the horizon.
    """
    t, z = start
    n = len(z) // 2
    state = z[:n], z[n:]
    after = AFTER * horizon
    run = simulate(system, (t, t + horizon), state, method, dense_output=False)
    ends = run.zeno["t"][run.zeno["gap"] == gap]
    if not len(ends):
        raise FlightError(Status.STEP_SIZE_TOO_SMALL)
    zeno = float(ends[0])
    hits: Any = run.resolved_impacts
    hits = hits[(hits["t"] <= zeno) & (hits["t"] > t)]
    end = zeno + after
    if not slopes:
        run = simulate(system, (t, end), state, method, dense_output=False)
        z = np.append(run.q[-1], run.qdot[-1])
        none = np.full((1 + 2 * n, 2 * n), np.nan)
        return Accumulation(zeno, end, z, none, none[:, 0], hits)
    names = ("q0", "qdot0", "t0")
    s = sensitivity(system, (t, end), state, names, method, dense_output=False)
    sol: Any = s.trajectory
    place = [k for k, row in enumerate(sol.zeno) if row["gap"] == gap]
    if not place or not sol.contacts[-1, gap]:
        raise FlightError(Status.STEP_SIZE_TOO_SMALL)
    moved = s.zeno_times[place[0]]
    z = np.append(sol.q[-1], sol.qdot[-1])
    columns = s.final.reshape(2 * n, 2 * n + 1)
    # the end moves with the accumulation
    rate = _rate(system, end, z, sol, n)
    columns = columns + np.outer(rate, moved)
    whole = np.vstack([moved, columns])
    own = float(sol.zeno["t"][place[0]])
    return Accumulation(own, own + (end - zeno), z, whole[:, : 2 * n], whole[:, 2 * n], hits)


def _rate(system: MechanicalSystem, t: float, z: Array, sol: Any, n: int) -> Array:
    """Give the rate of the state in contact."""
    at = system.at(t, z[:n], z[n:])
    inverse = np.linalg.inv(at.mass)
    free = inverse @ at.force
    own = np.flatnonzero(sol.contacts[-1])
    if len(own):
        rows = at.gradients[own]
        spread = inverse @ rows.T
        free = free - spread @ np.linalg.solve(rows @ spread, rows @ free + at.curvatures[own])
    return np.append(z[n:], free)
