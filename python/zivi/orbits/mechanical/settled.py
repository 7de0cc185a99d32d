"""What runs of mechanical systems settled on, told by their states from period to period."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from zivi.base.check import Array
from zivi.orbits.attractor import Attractor, between, quiet
from zivi.simulation.batch import simulate_batch
from zivi.simulation.methods import SwitchedRK
from zivi.system.mechanism import MechanicalSystem

__all__ = ["Settled", "attractor_of", "classify", "settle"]

SLOW = 0.05
"""Impacts of an accumulation below this part of the fastest are not told."""

NEAR, NEARER = 100.0, 0.9
"""A motion that nearly repeats after fewer periods settles on that, if the differences fall."""


@dataclasses.dataclass(frozen=True)
class Settled:
    """What a run did in its last periods."""

    states: Array
    """At the starts of the periods and at the end, rows ``(q, qdot)``."""
    impacts: Array
    """Rows of the time since the first of these starts, the speed after the impact, the gap."""
    touches: bool
    """Whether a gap was closed for some time."""
    rests: bool
    """Whether nothing moves at the end."""
    success: bool

    @property
    def end(self) -> Array:
        """The last state, ``(q, qdot)`` of shape (2, n)."""
        return np.asarray(self.states[-1].reshape(2, -1), np.float64)


def settle(
    systems: Sequence[MechanicalSystem],
    states: Array,
    periods: Sequence[float],
    transient: int,
    keep: int,
    method: SwitchedRK,
    threads: int | None = None,
    progress: bool | None = None,
) -> list[Settled]:
    """Run all for a number of periods, and note what they do in further ones.

    `states` has the shape (N, 2, n). Those with the same period are one batch.
    """
    found: list[Settled | None] = [None] * len(systems)
    for length in dict.fromkeys(periods):
        own = [i for i, period in enumerate(periods) if period == length]
        group = [systems[i] for i in own]
        several = _settle(group, states[own], length, transient, keep, method, threads, progress)
        for i, it in zip(own, several, strict=True):
            found[i] = it
    return [it for it in found if it is not None]


def _settle(
    systems: Sequence[MechanicalSystem],
    states: Array,
    length: float,
    transient: int,
    keep: int,
    method: SwitchedRK,
    threads: int | None,
    progress: bool | None,
) -> list[Settled]:
    start, stop = transient * length, (transient + keep) * length
    batch = simulate_batch(
        systems,
        (0.0, stop),
        (states[:, 0], states[:, 1]),
        method=method,
        t_eval=np.linspace(start, stop, keep + 1),
        save="events",
        threads=threads,
        progress=progress,
    )
    assert batch.sample_q is not None
    assert batch.sample_qdot is not None
    rows = np.concatenate([batch.sample_q, batch.sample_qdot], axis=2)
    found = []
    for i, events in enumerate(batch.events or []):
        impacts = events["impacts"]
        impacts = impacts[impacts["t"] > start]
        listed = np.column_stack([impacts["t"] - start, impacts["speed_after"], impacts["gap"]])
        closed = any(np.any(events[name]["t"] > start) for name in ("zeno", "liftoffs", "openings"))
        found.append(
            Settled(
                states=rows[i],
                impacts=listed,
                touches=closed or bool(batch.contacts[i].any()),
                rests=not np.isnan(batch.rest_time[i]),
                success=bool(batch.success[i]),
            )
        )
    return found


def classify(settled: Settled, period: float, keep: int, tolerance: float) -> Attractor:
    """Say what a run settled on: its states repeat after so many periods."""
    none, no_gaps = np.empty((0, 2)), np.empty(0, np.int64)
    if not settled.success:
        return Attractor("failed", 0, none, no_gaps)
    if settled.rests:
        return Attractor("rest", 0, none, no_gaps)
    multiple = _multiple(settled.states, keep, tolerance)
    if not multiple:
        return Attractor("irregular", 0, none, no_gaps)
    rows = settled.impacts
    end = quiet(rows, keep * period) if len(rows) else keep * period
    rows = between(rows, end - multiple * period, end)
    kind = "resting" if settled.touches else "impacting" if len(rows) else "flight"
    phases = np.column_stack([rows[:, 0] / period % 1.0, rows[:, 1]])
    return attractor_of(kind, multiple, phases, rows[:, 2])


def attractor_of(kind: str, multiple: int, rows: Array, gaps: Array) -> Attractor:
    """Give an attractor by rows of phases and speeds: of accumulations the fast impacts only."""
    if kind == "resting":
        fast = rows[:, 1] > SLOW * rows[:, 1].max(initial=0.0)
        rows, gaps = rows[fast], gaps[fast]
    order = np.argsort(rows[:, 0], kind="stable")
    return Attractor(kind, multiple, rows[order], np.asarray(gaps)[order].astype(np.int64))


def _multiple(states: Array, keep: int, tolerance: float) -> int:
    """Give after how many periods the states repeat, 0 where they do not."""
    q, qdot = np.split(np.abs(states).max(axis=0), 2)
    scale = np.repeat([q.max() or 1.0, qdot.max() or 1.0], len(q))
    for m in range(1, keep // 2 + 1):
        apart = np.abs(states[-m - 1 :] - states[-2 * m - 1 : -m]) / scale
        if apart.max() <= tolerance:
            return _settling(states / scale, m, tolerance)
    return 0


def _settling(states: Array, multiple: int, tolerance: float) -> int:
    """Give the divisor after which states will repeat that come nearer and nearer to it."""
    for d in range(1, multiple):
        if multiple % d:
            continue
        apart = np.abs(states[d:] - states[:-d]).max(axis=1)
        late, early = apart[-multiple:].max(), apart[:multiple].max()
        if late <= min(NEAR * tolerance, NEARER * early):
            return d
    return multiple
