"""Attractors of runs, and batches of runs that converge to the same one."""

from __future__ import annotations

import bisect
import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.base.extras import ProgressBar
from zivi.base.machine_code import listening, tell
from zivi.base.status import Status
from zivi.derivatives.result import OrbitStatus
from zivi.derivatives.sensitivity import sensitivity
from zivi.orbits.equations import newton
from zivi.orbits.flows import PRECISE, FlightError
from zivi.orbits.orbit import word_of_rows
from zivi.orbits.words import NEAR, cycle_of, earliest, least, resting_orbit
from zivi.simulation.batch import simulate_batch
from zivi.simulation.batch_result import check_threads
from zivi.simulation.events import SLOWEST
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import simulate
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem

# Attractors of runs: numbers of periods and impacts, their phases and speeds.

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
    """Last periods of a run: times since their start."""

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
    """A motion to which runs converge.

    Attributes
    ----------
    kind : str
        ``"flight"``, ``"impacting"``, ``"resting"`` (rests and lifts off again), ``"rest"``
        (permanent), ``"irregular"`` (not periodic within the inspected periods) or ``"failed"``.
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
            Resting motions are identified by the phase of their first impact after the lift-off.
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
        """Return rows of phase, speed and gap."""
        gaps = np.zeros(len(self.impacts)) if self.gaps is None else self.gaps
        rows = np.column_stack([self.impacts, gaps])
        order = np.lexsort((rows[:, 0], np.round(rows[:, 1], 6), rows[:, 2]))
        return np.asarray(rows[order], np.float64)


def classify(
    system: ImpactSystem, settled: Settled, period: float, keep: int, tolerance: float = TOLERANCE
) -> Attractor:
    """Classify the attractor of a run; near a period doubling it may not have converged."""
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
    """Return the least multiple of the period after which a run repeats, and its impacts."""
    divisors = [p for p in range(2, len(rows) + 1) if len(rows) % p == multiple % p == 0]
    if all(_apart(rows, period, multiple, parts) > NEAR for parts in divisors):
        return multiple, rows
    word, y = word_of_rows(system, PRECISE, rows, multiple * period)
    try:
        _, fewer, found = least(word, multiple, y, newton(word, y), MOST_STEPS)
    except FlightError:
        return multiple, rows
    x = found.terms.x
    return (multiple, rows) if fewer == multiple else (
        fewer, np.column_stack([x[:, 3], np.roll(x[:, 2], -1)])
    )  # fmt: skip


def _apart(rows: Array, period: float, multiple: int, parts: int) -> float:
    """Return how far equal parts differ, relative to the period and the fastest impact."""
    starts = multiple * period / parts * np.arange(parts)
    split = rows.reshape(parts, -1, 2) - np.stack([starts, 0.0 * starts], axis=1)[:, None]
    time, speed = np.max(np.ptp(split, axis=0), axis=0)
    return max(float(time) / period, float(speed) / (float(np.max(np.abs(rows[:, 1]))) or 1.0))


def _rested(system: ImpactSystem, settled: Settled, period: float, keep: int) -> Attractor | None:
    """Return how a run that rested repeats; None if it left the rest for another motion."""
    lifts, zenos, impacts = settled.liftoff_times, settled.zeno_times, settled.impacts
    end = keep * period
    since = float(max((*zenos[-1:], *lifts[-1:]), default=0.0))
    # the force is known at all phases: a mass not lifted off within a period rests permanently
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
        orbit = resting_orbit(system, PRECISE, period, rest)
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
    """Return the middle of the last long flight between impacts, the rows, before the end."""
    times: list[float] = [*rows[-8:, 0].tolist(), end]
    gaps = [after - before for before, after in itertools.pairwise(times)]
    i = max(k for k, gap in enumerate(gaps) if gap >= 0.5 * max(gaps))
    return times[i] + 0.5 * gaps[i]


def between(rows: Array, start: float, end: float) -> Array:
    """Return the rows whose first entry, a time, is within these."""
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

    Runs whose forces need no interpreter are batches. They are inspected during the run, first
    after `look` periods: runs that repeat to rounding by then have settled.
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
    left = [i for i in np.flatnonzero(good).tolist() if not _is_settled(found[i], periods[i], keep)]
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


def _is_settled(settled: Settled, period: float, keep: int) -> bool:
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


# Many runs of one system that merge: what they settle on, and whether a grazing decided it.
#
# Runs of an attractor come ever closer. Those whose states at the start of a period differ by less
# than the tolerances of the method, which could not distinguish them either, are merged from there
# on. So of a million initial states soon a few are left.

After: TypeAlias = Callable[[Array, int], tuple[Array, NDArray[np.bool_]]]
"""States after some periods, NaN of runs that fail, and which runs graze."""


@dataclasses.dataclass(frozen=True)
class Cells:
    """Attractors of runs."""

    settled: list[Settled]
    """The different ones."""
    which: NDArray[np.int64]
    """For each run its number among them."""
    grazing: NDArray[np.bool_]
    """For each run whether an impact, or the want of one, was decided by the tolerances."""


@dataclasses.dataclass(frozen=True)
class _Runner:
    """Runs a system for some periods."""

    system: ImpactSystem
    period: float
    method: SwitchedRK
    threads: int | None
    progress: bool | None

    def after(self, states: Array, periods: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return the states after some periods, NaN for runs that fail, and which runs graze."""
        span = (0.0, periods * self.period)
        if not self.system._spec.is_native:
            return self._one_by_one(states, span)
        batch = simulate_batch(
            [self.system] * len(states),
            span,
            states,
            method=self.method,
            save="grazing",
            threads=self.threads,
            progress=self.progress,
        )
        ends = np.column_stack([batch.x, batch.xdot])
        ends[~batch.success] = np.nan
        assert batch.grazing is not None
        return ends, batch.grazing

    def _one_by_one(
        self, states: Array, span: tuple[float, float]
    ) -> tuple[Array, NDArray[np.bool_]]:
        ends, grazing = np.full(states.shape, np.nan), np.zeros(len(states), dtype=bool)
        for i, state in enumerate(states):
            s = sensitivity(
                self.system,
                span,
                state,
                ("x0",),
                self.method,
                errsens=False,
                dense_output=False,
                progress=self.progress,
            )
            grazing[i] = s.status is OrbitStatus.GRAZING
            if s.trajectory.success:
                ends[i] = s.trajectory.x[-1], s.trajectory.xdot[-1]
        return ends, grazing


def settle_cells(
    system: ImpactSystem,
    states: Array,
    period: float,
    transient: int,
    keep: int,
    method: SwitchedRK,
    threads: int | None = None,
    progress: bool | None = None,
) -> Cells:
    """Run from all states for a number of periods, and note what they do in further ones."""
    runner = _Runner(system, period, method, threads, progress)
    now, which, grazing = together(runner.after, states, transient, method)
    failed = np.isnan(now[:, 0])
    kept = np.where(failed[:, None], 0.0, now)
    settled = settle(
        [system] * len(kept), kept, [period] * len(kept), 0, keep, method, threads, progress
    )
    settled = [
        dataclasses.replace(it, success=False) if fails else it
        for it, fails in zip(settled, failed, strict=True)
    ]
    if len(kept):
        grazing |= runner.after(kept, keep)[1][which]
    return Cells(settled, which, grazing)


def together(
    after: After, states: Array, transient: int, method: SwitchedRK
) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
    """Run all for a number of periods: the different ends, which each is, and grazing."""
    which, now = np.arange(len(states)), states
    grazing = np.zeros(len(states), dtype=bool)
    left, length = transient, 1
    while left > 0:
        step = min(length, left)
        ends, grazes = after(now, step)
        grazing |= grazes[which]
        left, length = left - step, 2 * length
        now, merged = _merged(ends, method)
        which = merged[which]
    return now, which, grazing


def _merged(states: Array, method: SwitchedRK) -> tuple[Array, NDArray[np.int64]]:
    """Return the different ones of some states, and which of them each is."""
    size = np.max(np.abs(np.nan_to_num(states)), axis=0, initial=0.0)
    each = np.broadcast_to(np.asarray(method.atol, np.float64), 2)
    atol = np.repeat(each, states.shape[1] // 2)  # of positions, then of velocities
    # failed ones are one
    cells = np.nan_to_num(np.rint(states / (atol + method.rtol * size)), nan=-np.inf)
    order = np.lexsort(cells.T)
    ordered = cells[order]
    new = np.append(True, np.any(ordered[1:] != ordered[:-1], axis=1))
    which = np.empty(len(states), np.int64)
    which[order] = np.cumsum(new) - 1
    return states[order[new]], which


# Attractors of mechanical systems, identified by their states from period to period.

SLOW = 0.05
"""Impacts of an accumulation below this part of the fastest are not told."""

SETTLED_NEAR, FALLING = 100.0, 0.9
"""A motion that nearly repeats after fewer periods settles on that, if the differences fall."""


@dataclasses.dataclass(frozen=True)
class MechanicalSettled:
    """Last periods of a run."""

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


def settle_mechanical(
    systems: Sequence[MechanicalSystem],
    states: Array,
    periods: Sequence[float],
    transient: int,
    keep: int,
    method: SwitchedRK,
    threads: int | None = None,
    progress: bool | None = None,
) -> list[MechanicalSettled]:
    """Run all for a number of periods, and note what they do in further ones.

    `states` has the shape (N, 2, n). Those with the same period are one batch.
    """
    found: list[MechanicalSettled | None] = [None] * len(systems)
    for length in dict.fromkeys(periods):
        own = [i for i, period in enumerate(periods) if period == length]
        group = [systems[i] for i in own]
        several = _settle_batch(
            group, states[own], length, transient, keep, method, threads, progress
        )
        for i, it in zip(own, several, strict=True):
            found[i] = it
    return [it for it in found if it is not None]


def _settle_batch(
    systems: Sequence[MechanicalSystem],
    states: Array,
    length: float,
    transient: int,
    keep: int,
    method: SwitchedRK,
    threads: int | None,
    progress: bool | None,
) -> list[MechanicalSettled]:
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
            MechanicalSettled(
                states=rows[i],
                impacts=listed,
                touches=closed or bool(batch.contacts[i].any()),
                rests=not np.isnan(batch.rest_time[i]),
                success=bool(batch.success[i]),
            )
        )
    return found


def classify_mechanical(
    settled: MechanicalSettled, period: float, keep: int, tolerance: float
) -> Attractor:
    """Classify the attractor of a run by the number of periods after which states repeat."""
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
    """Return an attractor by rows of phases and speeds: of accumulations the fast impacts only."""
    if kind == "resting":
        fast = rows[:, 1] > SLOW * rows[:, 1].max(initial=0.0)
        rows, gaps = rows[fast], gaps[fast]
    order = np.argsort(rows[:, 0], kind="stable")
    return Attractor(kind, multiple, rows[order], np.asarray(gaps)[order].astype(np.int64))


def _multiple(states: Array, keep: int, tolerance: float) -> int:
    """Return after how many periods the states repeat, 0 where they do not."""
    q, qdot = np.split(np.abs(states).max(axis=0), 2)
    scale = np.repeat([q.max() or 1.0, qdot.max() or 1.0], len(q))
    for m in range(1, keep // 2 + 1):
        apart = np.abs(states[-m - 1 :] - states[-2 * m - 1 : -m]) / scale
        if apart.max() <= tolerance:
            return _settling(states / scale, m, tolerance)
    return 0


def _settling(states: Array, multiple: int, tolerance: float) -> int:
    """Return the divisor after which states will repeat that come nearer and nearer to it."""
    for d in range(1, multiple):
        if multiple % d:
            continue
        apart = np.abs(states[d:] - states[:-d]).max(axis=1)
        late, early = apart[-multiple:].max(), apart[:multiple].max()
        if late <= min(SETTLED_NEAR * tolerance, FALLING * early):
            return d
    return multiple


# Many runs of one mechanical system that merge: what they settle on.


def open_starts(system: MechanicalSystem, states: Array) -> NDArray[np.bool_]:
    """Return which states, of shape (N, 2, n), have all gaps >= 0 at time 0."""
    model = system.model(states.shape[2])
    rows = (model.layout.read(model.evaluate(0.0, q, qdot)).gaps for q, qdot in states)
    return np.array([bool((gaps >= 0.0).all()) for gaps in rows], dtype=bool)


def settle_mechanical_cells(
    system: MechanicalSystem,
    states: Array,
    period: float,
    transient: int,
    keep: int,
    method: SwitchedRK,
    threads: int | None = None,
    progress: bool | None = None,
) -> tuple[list[MechanicalSettled], NDArray[np.int64]]:
    """Run from all states, shape (N, 2, n); return attractors and the index of each state's."""
    n = states.shape[2]

    def after(rows: Array, periods: int) -> tuple[Array, NDArray[np.bool_]]:
        ends = np.full(rows.shape, np.nan)
        runs = ~np.isnan(rows[:, 0])
        if runs.any():
            batch = simulate_batch(
                system,
                (0.0, periods * period),
                (rows[runs, :n], rows[runs, n:]),
                method=method,
                threads=threads,
                progress=progress,
            )
            reached = np.hstack([batch.q, batch.qdot])
            reached[~batch.success] = np.nan
            ends[runs] = reached
        return ends, np.zeros(len(rows), dtype=bool)

    flat = states.reshape(len(states), 2 * n)
    now, which, _ = together(after, flat, transient, method)
    failed = np.isnan(now[:, 0])
    kept = np.where(failed[:, None], flat[:1], now).reshape(-1, 2, n)
    several = settle_mechanical(
        [system] * len(kept), kept, [period] * len(kept), 0, keep, method, threads, progress
    )
    pairs = zip(several, failed, strict=True)
    return [dataclasses.replace(it, success=it.success and not bad) for it, bad in pairs], which
