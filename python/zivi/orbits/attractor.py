"""What a run settled on: how many periods and impacts, at which phases and speeds."""

from __future__ import annotations

import bisect
import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.base.extras import ProgressBar
from zivi.base.machine_code import listening, tell
from zivi.base.status import Status
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.flights import PRECISE, FlightError
from zivi.orbits.mechanical.equations import newton
from zivi.orbits.mechanical.find import NEAR, least
from zivi.orbits.rest import cycle_of, earliest, resting_orbit
from zivi.orbits.sequence import Frame, as_rows, as_word
from zivi.simulation.batch_result import check_threads
from zivi.simulation.impacts import SLOWEST
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import simulate
from zivi.system.mass import ImpactSystem

__all__ = ["Attractor", "Settled", "between", "classify", "quiet", "settle", "settle_one"]

TOLERANCE = 1e-5
LOOK = 100
"""Periods after which runs are looked at: whether they have settled."""
ROUNDING = 1e-12
"""What is less, relative to the period and to the fastest impact, is no difference."""
MOST_TURNS = 8
"""Periods that a run may take to repeat itself, for it to have settled early."""
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
        rested = _rested(system, settled, period, keep)
        if rested is not None:
            return rested
    rows = settled.impacts
    if not len(rows):
        return Attractor("flight", 1, none)
    size = float(np.abs(rows[:, 1]).max()) or 1.0
    times, end = rows[:, 0].tolist(), quiet(rows, keep * period)
    last, sizes = bisect.bisect_right(times, end), np.array([period, size])
    for m in range(1, keep // 2 + 1):
        first, middle = (bisect.bisect_right(times, end - n * m * period) for n in (2, 1))
        now, before = rows[middle:last], rows[first:middle]
        if not len(now) or len(now) != len(before):
            continue
        shift = np.abs(now - before - np.array([m * period, 0.0])) / sizes
        if shift.max() <= tolerance:
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


def _rested(system: ImpactSystem, settled: Settled, period: float, keep: int) -> Attractor | None:
    """Say how a run repeats that rested; None where it left that rest for another motion."""
    lifts, zenos, impacts = settled.liftoff_times, settled.zeno_times, settled.impacts
    end = keep * period
    since = float(max((*zenos[-1:], *lifts[-1:]), default=0.0))
    # the force is known at all phases: what it does not lift off in a period rests for good
    if settled.rests and end - since >= period:
        return Attractor("rest", 0, np.empty((0, 2)))
    cycle = cycle_of(lifts, period)
    if cycle is not None:
        first, last = cycle
        lift = lifts[first + earliest(lifts[first:last], period)]
        multiple, first_impact = round((lifts[last] - lifts[first]) / period), impacts[:, 0] > lift
        rows = impacts[first_impact][:1]
    else:
        # fewer periods were noted than it takes
        rest = end if settled.rests else float(zenos[-1])
        orbit = resting_orbit(system, Frame(1, period, PRECISE), rest)
        if orbit.status is OrbitStatus.RESTS:
            return Attractor("rest", 0, np.empty((0, 2)))
        if not orbit.success or rest + orbit.multiple * period < end:
            return None
        rows, multiple = (
            np.column_stack([orbit.impacts["t"], orbit.impacts["u"]])[:1],
            orbit.multiple,
        )
    return Attractor("resting", multiple, np.column_stack([rows[:, 0] / period % 1.0, rows[:, 1]]))


def quiet(rows: Array, end: float) -> float:
    """Give the middle of the last long flight between impacts, the rows, before the end."""
    times: list[float] = [*rows[-8:, 0].tolist(), end]
    gaps = [after - before for before, after in itertools.pairwise(times)]
    i = max(k for k, gap in enumerate(gaps) if gap >= 0.5 * max(gaps))
    return times[i] + 0.5 * gaps[i]


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
    *,
    look: int = LOOK,
) -> list[Settled]:
    """Run all for a number of periods, and note what they do in further ones.

    Runs whose forces need no interpreter are batches. They are looked at on the way, at first after
    `look` periods: those that repeat themselves to rounding by then have settled.
    """
    if not all(it._spec.is_native for it in systems):
        triples = zip(systems, states, periods, strict=True)
        return [settle_one(*it, transient, keep, method) for it in triples]
    runs = _Runs(systems, np.array(periods, np.float64), method, check_threads(threads), progress)
    before = look if transient >= look + keep else transient
    ends, ok = np.array(states, dtype=np.float64), np.ones(len(states), dtype=bool)
    if before:
        first = runs.record(before, ends, "final")
        ends, ok = np.column_stack([first.x, first.xdot]), first.status == Status.COMPLETED
        ends[~ok] = 0.0
    record = runs.record(keep, ends, "events")
    good = ok & (record.status == Status.COMPLETED)
    rests = ~np.isnan(record.rest_time)
    after = np.column_stack([record.x, record.xdot])
    found = [
        _settled(impacts[::3], impacts[2::3], zenos, lifts, *own)
        for impacts, zenos, lifts, *own in zip(
            record.resolved_impacts, record.zeno_times, record.liftoff_times,
            rests.tolist(), after, good.tolist(), strict=True,
        )
    ]  # fmt: skip
    if before == transient:
        return found
    left = [i for i in np.flatnonzero(good).tolist() if not _repeats(found[i], periods[i], keep)]
    more = settle(
        [systems[i] for i in left], after[left], [periods[i] for i in left],
        transient - before - keep, keep, method, threads, progress, look=2 * look,
    ) if left else []  # fmt: skip
    for i, it in zip(left, more, strict=True):
        found[i] = it
    return found


@dataclasses.dataclass(frozen=True)
class _Runs:
    """Runs that need no interpreter, each over a number of its periods."""

    systems: Sequence[ImpactSystem]
    periods: Array
    method: SwitchedRK
    threads: int
    progress: bool | None

    def record(self, count: int, states: Array, save: str) -> _zivi.BatchRecord:
        """Run all from the start of a period."""
        specs, ends = [it._spec for it in self.systems], count * self.periods
        with ProgressBar(self.progress) as bar, listening(specs, threads=True) as ear:
            record = _zivi.simulate_batch(
                specs,
                [it._impact for it in self.systems],
                states,
                self.method._core,
                span=(0.0, float(np.max(ends))),
                save=save,
                slowest=SLOWEST,
                threads=self.threads,
                ends=ends.tolist(),
                progress=bar.report,
            )
        tell(ear, record.status)
        return record


def _repeats(settled: Settled, period: float, keep: int) -> bool:
    """Whether all periods that were noted are the same to rounding, or some of them in turns."""
    rows = settled.impacts
    if len(settled.zeno_times) or settled.rests or len(rows) < 2:
        return False
    speeds = rows[:, 1]
    size = float(speeds.max()) or 1.0
    for m in range(1, min(MOST_TURNS, keep // 2) + 1):
        count = round(len(rows) * m / keep)
        if not 0 < count < len(rows):
            continue
        if abs(speeds[-1] - speeds[-1 - count]) > ROUNDING * size:
            continue
        late, other = (rows[count:] - rows[:-count]).T
        shifts = np.abs(late - m * period).max() / period, np.abs(other).max() / size
        if max(shifts) <= ROUNDING:
            return True
    return False


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
    impacts, end = run.resolved_impacts, np.array([run.x[-1], run.xdot[-1]])
    return _settled(
        impacts["t"], impacts["xdot_after"], run.zeno_times, run.liftoff_times,
        run.rest_time is not None, end, run.success,
    )  # fmt: skip


def _settled(
    times: Array, speeds: Array, zenos: Array, lifts: Array, rests: bool, end: Array, success: bool
) -> Settled:
    rows = np.empty((len(times), 2))
    rows[:, 0], rows[:, 1] = times, speeds
    return Settled(rows, zenos, lifts, rests, end, success)
