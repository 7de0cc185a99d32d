"""What a run settled on: how many periods and impacts, at which phases and speeds."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.orbits.flights import PRECISE, FlightError
from zivi.orbits.mechanical.equations import newton
from zivi.orbits.mechanical.find import NEAR, least
from zivi.orbits.sequence import Frame, as_rows, as_word
from zivi.simulation.batch import simulate_batch
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import simulate
from zivi.system.mass import ImpactSystem

__all__ = ["Attractor", "Settled", "between", "classify", "quiet", "settle", "settle_one"]

TOLERANCE = 1e-5
MOST_STEPS = 60
"""Of Newton's iteration near a period doubling."""


@dataclasses.dataclass(frozen=True)
class Settled:
    """What a run did in its last periods: times since their start."""

    impacts: Array
    """Rows ``(t, u)``."""
    zeno_times: Array
    liftoff_times: Array
    rests: bool
    """Whether it rests at the end."""
    end: Array
    """The last state."""
    success: bool
    states: Array | None = None
    """The last and those a period after another, rows ``(x, xdot)``, where they are asked for."""


@dataclasses.dataclass(frozen=True)
class Attractor:
    """A motion that runs settle on.

    Attributes
    ----------
    kind : str
        ``"flight"``, ``"impacting"``, ``"resting"`` (rests and lifts off again), ``"rest"`` (for
        good), ``"irregular"`` (not periodic within what was looked at) or ``"failed"``.
    multiple : int
        After how many periods it repeats; 0 where it does not, or always.
    impacts : ndarray
        Rows of the phase, a part of the period, and the speed after the impact (m/s), sorted.
    gaps : ndarray of int or None
        Of a mechanical system the gap of each.
    """

    kind: str
    multiple: int
    impacts: Array
    gaps: NDArray[np.int64] | None = None

    def is_same(self, other: Attractor, tolerance: float) -> bool:
        """Whether another is the same motion.

        Parameters
        ----------
        other : Attractor
            The other.
        tolerance : float
            Largest difference of phases and of speeds, relative to the largest.

        Returns
        -------
        bool
            Resting motions are told by the phase of their first impact after the lift-off.
        """
        alike = (self.kind, self.multiple) == (other.kind, other.multiple)
        if not alike or len(self.impacts) != len(other.impacts):
            return False
        if not len(self.impacts) or self.kind == "irregular":
            return True
        size = float(np.max(np.abs(self.impacts[:, 1]))) or 1.0
        for one, two in zip(self._by_speed(), other._by_speed(), strict=True):
            if one[2] != two[2]:
                return False
            turn = abs((one[0] - two[0] + 0.5) % 1.0 - 0.5)
            if turn > tolerance or abs(one[1] - two[1]) > tolerance * size:
                return False
        return True

    def _by_speed(self) -> Array:
        """Give rows of phase, speed and gap."""
        gaps = np.zeros(len(self.impacts)) if self.gaps is None else self.gaps
        rows = np.column_stack([self.impacts, gaps])
        order = np.lexsort((rows[:, 0], np.round(rows[:, 1], 6), rows[:, 2]))
        return np.asarray(rows[order], np.float64)


def classify(
    system: ImpactSystem, settled: Settled, period: float, keep: int, tolerance: float = TOLERANCE
) -> Attractor:
    """Say what a run settled on; near a period doubling it may not have settled yet."""
    none = np.empty((0, 2))
    if not settled.success:
        return Attractor("failed", 0, none)
    if len(settled.zeno_times) or settled.rests:
        return _rested(settled, period, none)
    rows = settled.impacts
    if not len(rows):
        return Attractor("flight", 1, none)
    size = float(np.max(np.abs(rows[:, 1]))) or 1.0
    end = quiet(rows, keep * period)
    for m in range(1, keep // 2 + 1):
        now = between(rows, end - m * period, end)
        before = between(rows, end - 2 * m * period, end - m * period)
        if not len(now) or len(now) != len(before):
            continue
        shift = np.abs(now - before - np.array([m * period, 0.0])) / [period, size]
        if np.max(shift) <= tolerance:
            least, now = least_rows(system, period, now, m)
            phases = np.column_stack([now[:, 0] / period % 1.0, now[:, 1]])
            return Attractor("impacting", least, phases[np.argsort(phases[:, 0])])
    return Attractor("irregular", 0, none)


def least_rows(
    system: ImpactSystem, period: float, rows: Array, multiple: int
) -> tuple[int, Array]:
    """Give the least multiple of the period, and its impacts, of what a run seems to repeat."""
    divisors = [p for p in range(2, len(rows) + 1) if len(rows) % p == multiple % p == 0]
    if all(_apart(rows, period, multiple, parts) > NEAR for parts in divisors):
        return multiple, rows
    word, y = as_word(system, Frame(multiple, period, PRECISE), rows)
    try:
        _, fewer, found = least(word, multiple, y, newton(word, y), MOST_STEPS)
    except FlightError:
        return multiple, rows
    return (multiple, rows) if fewer == multiple else (fewer, as_rows(found.terms))


def _apart(rows: Array, period: float, multiple: int, parts: int) -> float:
    """Give how far equal parts differ, relative to the period and the fastest impact."""
    starts = multiple * period / parts * np.arange(parts)
    split = rows.reshape(parts, -1, 2) - np.stack([starts, 0.0 * starts], axis=1)[:, None]
    time, speed = np.max(np.ptp(split, axis=0), axis=0)
    return max(float(time) / period, float(speed) / (float(np.max(np.abs(rows[:, 1]))) or 1.0))


def _rested(settled: Settled, period: float, none: Array) -> Attractor:
    lifts = settled.liftoff_times
    if not len(lifts):
        return Attractor("rest", 0, none)
    multiple = round(float(lifts[-1] - lifts[-2]) / period) if len(lifts) > 1 else 1
    first = settled.impacts[settled.impacts[:, 0] > lifts[-1]]
    if not len(first) and len(lifts) > 1:
        first = settled.impacts[settled.impacts[:, 0] > lifts[-2]]
    rows = first[:1] / [period, 1.0]
    rows[:, 0] %= 1.0
    return Attractor("resting", max(multiple, 1), rows)


def quiet(rows: Array, end: float) -> float:
    """Give the middle of the last long flight between impacts, the rows, before the end."""
    times = np.append(rows[-8:, 0], end)
    gaps = np.diff(times)
    i = int(np.flatnonzero(gaps >= 0.5 * np.max(gaps))[-1])
    return float(times[i] + 0.5 * gaps[i])


def between(rows: Array, start: float, end: float) -> Array:
    """Give the rows whose first entry, a time, is within these."""
    return rows[(rows[:, 0] > start) & (rows[:, 0] <= end)]


def settle(
    systems: Sequence[ImpactSystem],
    states: Array,
    periods: Sequence[float],
    transient: int,
    keep: int,
    method: SwitchedRK,
    threads: int | None = None,
    progress: bool | None = None,
) -> list[Settled]:
    """Run all for a number of periods, and note what they do in further ones.

    Runs whose forces need no interpreter and whose periods are the same are batches.
    """
    together = len(set(periods)) == 1 and all(it._spec.is_native for it in systems)
    if not together:
        triples = zip(systems, states, periods, strict=True)
        return [settle_one(*it, transient, keep, method) for it in triples]
    length = float(periods[0])
    ends, ok = np.array(states, dtype=np.float64), np.ones(len(states), dtype=bool)
    if transient:
        span = (0.0, transient * length)
        first = simulate_batch(
            systems, span, ends, method=method, threads=threads, progress=progress
        )
        ends, ok = np.column_stack([first.x, first.xdot]), first.success
        ends[~ok] = 0.0
    batch = simulate_batch(
        systems,
        (0.0, keep * length),
        ends,
        method=method,
        save="events",
        threads=threads,
        progress=progress,
    )
    return [
        _settled(it, not math.isnan(rest), np.array([x, v]), bool(good and done))
        for it, rest, x, v, good, done in zip(
            batch.events or [], batch.rest_time, batch.x, batch.xdot, ok, batch.success, strict=True
        )
    ]


def settle_one(
    system: ImpactSystem,
    state: Any,
    period: float,
    transient: int,
    keep: int,
    method: SwitchedRK,
) -> Settled:
    """Run one for a number of periods, and note what it does in further ones."""
    if transient:
        run = simulate(
            system, (0.0, transient * period), state, method, dense_output=False, progress=False
        )
        if not run.success:
            empty = np.empty(0)
            return Settled(np.empty((0, 2)), empty, empty, False, np.zeros(2), False)
        state = (float(run.x[-1]), float(run.xdot[-1]))
    run = simulate(system, (0.0, keep * period), state, method, dense_output=False, progress=False)
    events = {
        "resolved_impacts": run.resolved_impacts,
        "zeno_times": run.zeno_times,
        "liftoff_times": run.liftoff_times,
    }
    end = np.array([run.x[-1], run.xdot[-1]])
    return _settled(events, run.rest_time is not None, end, run.success)


def _settled(events: dict[str, Any], rests: bool, end: Array, success: bool) -> Settled:
    impacts = events["resolved_impacts"]
    rows = np.column_stack([impacts["t"], impacts["xdot_after"]])
    return Settled(rows, events["zeno_times"], events["liftoff_times"], rests, end, success)
