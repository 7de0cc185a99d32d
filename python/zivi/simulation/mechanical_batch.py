"""Batches of runs of mechanical systems, on threads."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, MaybeNone, real_array
from zivi.base.extras import ProgressBar
from zivi.base.table import Field, ResultTable
from zivi.simulation.batch_result import BatchRuns, replaced, room_for, stops_of, threads_for
from zivi.simulation.mechanical_run import (
    RunRequest,
    check_friction,
    check_mechanical_method,
    configuration,
    run_mechanical,
    with_kicks,
)
from zivi.simulation.mechanical_trajectory import AT_REST, MechanicalTrajectory
from zivi.simulation.methods import SwitchedRK
from zivi.system.mechanism import MechanicalSystem
from zivi.system.start import check_start

# Result of a batch of mechanical runs.

NUMBERS: dict[str, Field] = {
    "first_impact": ("run", "", "time of the first impact, NaN without one"),
    "last_impact": ("run", "", "time of the last impact, NaN without one"),
    "rest_time": ("run", "", "time from which nothing moves, NaN if something does"),
    "n_impacts": ("run", "", "number of impacts"),
    "n_zeno": ("run", "", "number of accumulations"),
    "n_liftoffs": ("run", "", "number of lift-offs"),
    "n_corners": ("run", "", "number of corners"),
    "n_flags": ("run", "", "number of flags"),
    "status": ("run", "", "how the run ended, a zivi.Status"),
    "nfev": ("run", "", "evaluations of the system"),
}
"""Dimensions, unit and meaning of what a batch counts in each run."""
ENDS: dict[str, Field] = {
    "t": ("run", "", "time of the end"),
    "q": (("run", "coordinate"), "", "coordinates at the end"),
    "qdot": (("run", "coordinate"), "", "velocities at the end"),
    "gaps": (("run", "gap"), "", "gaps at the end"),
    "contacts": (("run", "gap"), "", "which gaps are closed at the end"),
}
"""The same for the ends of the runs."""
SAMPLES: dict[str, Field] = {
    "sample_q": (("run", "time", "coordinate"), "", "coordinates"),
    "sample_qdot": (("run", "time", "coordinate"), "", "velocities"),
}
"""The same for samples."""
LABELS: dict[str, Field] = {
    "run": ("run", "", "number of the run"),
    "coordinate": ("coordinate", "", "name of the coordinate"),
    "gap": ("gap", "", "name of the gap"),
}
"""Coordinates of the dataset."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalBatch(BatchRuns):
    """Results of a batch of mechanical systems: an entry for each of N runs.

    Attributes
    ----------
    t : ndarray
        Time at the end of each run, shape (N,).
    q, qdot : ndarray
        Coordinates and velocities there, shape (N, n).
    gaps : ndarray
        Gaps there, shape (N, m).
    contacts : ndarray of bool
        Which gaps are closed there, shape (N, m).
    first_impact, last_impact : ndarray
        Times of the first and the last impact, NaN without one.
    n_impacts, n_zeno, n_liftoffs, n_corners, n_flags : ndarray of int
        Numbers of impacts (down to the part `slowest` of the fastest of the run, whether they were
        computed or skipped by a jump), accumulations, lift-offs, corners and flags.
    rest_time : ndarray
        Time from which nothing moves until the end, NaN if something does.
    status : ndarray of uint8
        How each run ended, the numbers of `Status`.
    nfev : ndarray of int
        Evaluations of the system.
    events : list of dict or None
        With ``save="events"``: the tables ``impacts``, ``zeno``, ``liftoffs``, ``openings``,
        ``corners`` and ``flags`` of each run, with friction also ``transitions`` and ``stick``.
    runs : list of MechanicalTrajectory or None
        With ``save="runs"``: the runs themselves.
    config : dict
        Settings of the batch, as plain values.
    sample_t : ndarray or None
        With ``t_eval``: the times of the samples, shape (k,).
    sample_q, sample_qdot : ndarray or None
        Coordinates and velocities there, shape (N, k, n); NaN where a run ended before.
    parameters : dict of str to ndarray
        The values of the argument `parameters`, of shape (N,) each, by name.
    """

    t: Array
    q: Array
    qdot: Array
    gaps: Array

    def _counted(self) -> str:
        flagged = int(np.count_nonzero(self.n_flags))
        return f"{flagged} with flags" if flagged else ""

    contacts: NDArray[np.bool_]
    first_impact: Array
    last_impact: Array
    n_impacts: NDArray[np.int64]
    n_zeno: NDArray[np.int64]
    n_liftoffs: NDArray[np.int64]
    n_corners: NDArray[np.int64]
    n_flags: NDArray[np.int64]
    status: NDArray[np.uint8]
    nfev: NDArray[np.int64]
    events: list[dict[str, Any]] | MaybeNone
    runs: list[MechanicalTrajectory] | MaybeNone
    config: dict[str, Any]
    sample_t: Array | MaybeNone = None
    sample_q: Array | MaybeNone = None
    sample_qdot: Array | MaybeNone = None
    rest_time: Array = dataclasses.field(default_factory=lambda: np.empty(0))
    parameters: dict[str, Array] = dataclasses.field(default_factory=dict)

    def _table(self) -> ResultTable:
        """Describe the dataset: ``run``, ``coordinate``, ``gap``, and ``time`` of the samples."""
        fields, coords = ENDS | NUMBERS | self._varied(), dict(LABELS)
        if self.sample_t is not None:
            fields |= SAMPLES
            coords["time"] = "time", "", "times of the samples"
        values = {
            "run": np.arange(len(self)),
            "time": self.sample_t,
            "coordinate": np.array(self.config["coordinates"], dtype=object),
            "gap": np.array(self.config["gaps"], dtype=object),
            **self.parameters,
        }
        return ResultTable(
            "Batch of runs of mechanical systems with impacts", fields, coords, values
        )


# Batches of runs of mechanical systems, on threads.

SAVES = ("final", "events", "runs")
"""What can be kept of each run."""


@dataclasses.dataclass(frozen=True)
class Kept:
    """Data stored for one run; the rest is released immediately."""

    end: tuple[float, Array, Array, Array, NDArray[np.bool_]]
    numbers: dict[str, float]
    events: dict[str, Any] | None
    run: MechanicalTrajectory | None
    config: dict[str, Any]


def mechanical_batch(
    systems: MechanicalSystem | Sequence[MechanicalSystem],
    span: tuple[float, float],
    y0: Any,
    method: Any,
    times: Array | None,
    save: Any,
    slowest: float,
    threads: int,
    progress: bool | None,
    tstops: Any,
    kicks: Any,
    columns: Mapping[str, Array],
) -> MechanicalBatch:
    """Run many mechanical systems; see `zivi.simulate_batch`."""
    native = _native_parameters(systems, columns)
    if native is None and isinstance(systems, MechanicalSystem):
        systems = replaced(systems, columns)
    if save not in SAVES:
        names = ", ".join(repr(name) for name in SAVES)
        raise ValueError(f"save must be one of {names} for mechanical systems, got {save!r}")
    several = _systems(systems)
    threads = threads_for(several, threads)
    check_mechanical_method(method)
    stops = stops_of(several, tstops, method, span)
    n_columns = len(next(iter(columns.values()))) if columns else 1
    q, qdot = _batch_states(y0, max(len(several), n_columns))
    if save == "final" and times is None and kicks is None and isinstance(method, SwitchedRK):
        values = columns, *(native or (None, None))
        runs = _native_runs(several, method, span, (q, qdot), stops, values)
        if runs is not None:
            with ProgressBar(progress) as bar:
                found = runs.run(
                    method._core, span=span, slowest=slowest, threads=threads, progress=bar.report
                )
            first = _system_of_run(several, columns, 0)
            asked = RunRequest(span, q[0], qdot[0], None, stops[0], [], dense=False)
            config = configuration(first, first.model(q.shape[1]), method, asked)
            return _batch_of_ends(found, config | {"n_runs": len(q), "save": save}, dict(columns))
    if columns and len(several) == 1:
        several = replaced(several[0], columns)
    if len(several) == 1:
        several, stops = several * len(q), stops * len(q)
    elif len(stops) == 1:
        stops = stops * len(q)
    batch = _batch_of_runs(
        several, (span, q, qdot, stops, kicks), method, (times, save, slowest), threads, progress
    )
    return dataclasses.replace(batch, parameters=dict(columns))


def _batch_of_runs(
    several: list[MechanicalSystem],
    starts: tuple[tuple[float, float], Array, Array, list[Array], Any],
    method: Any,
    kept: tuple[Array | None, str, float],
    threads: int,
    progress: bool | None,
) -> MechanicalBatch:
    """Run systems one by one, on threads."""
    (span, q, qdot, stops, kicks), (times, save, slowest) = starts, kept
    samples = None if times is None else room_for(2, len(q), len(times), q.shape[1])
    # the motion itself is requested in samples and whole runs only
    dense = times is not None or save == "runs" or not isinstance(method, SwitchedRK)

    def asked(q: Array, qdot: Array, stops: Array) -> RunRequest:
        return RunRequest(span, q, qdot, None, stops, [], dense, arcs=True, ends=save != "runs")

    tasks = list(zip(several, map(asked, q, qdot, stops), strict=True))
    if kicks is not None:
        tasks = [(system, with_kicks(it, kicks, system, method)) for system, it in tasks]

    def one(number: int, report: Any) -> Kept:
        system, asked = tasks[number]
        run, error = run_mechanical(system, method, asked, report)
        if error is not None:
            raise error
        if samples is not None and times is not None:
            reached = times[times <= run.t[-1]]
            samples[:, number, : len(reached)] = run(reached)
        vars(run)["slowest"] = slowest
        return _kept_numbers(run, save)

    with ProgressBar(progress) as bar:
        rows = _computed(one, len(tasks), threads, bar.report)
    config = rows[0].config | {"n_runs": len(rows), "save": save}
    batch = _batch(rows, save, config)
    if samples is None or times is None:
        return batch
    config["t_eval"] = times.tolist()
    return dataclasses.replace(batch, sample_t=times, sample_q=samples[0], sample_qdot=samples[1])


def _native_parameters(
    systems: Any, columns: Mapping[str, Array]
) -> tuple[Array | None, Array | None] | None:
    """Return the rows of a model's parameters, and e, where one model serves all runs."""
    if not columns:
        return None, None
    rigid = isinstance(systems, MechanicalSystem) and not systems._compliant()
    if not rigid or "e" in getattr(systems, "parameters", ()):
        return None
    others = {name: values for name, values in columns.items() if name != "e"}
    try:
        rows = systems._parameter_rows(others) if others else None
    except KeyError as error:
        raise ValueError(f"parameters: {error.args[0]}") from None
    return None if others and rows is None else (rows, columns.get("e"))


def _system_of_run(several: list[MechanicalSystem], columns: Mapping[str, Array], i: int) -> Any:
    """Return the system of a run, with its values of the parameters."""
    if len(several) > 1 or not columns:
        return several[i if len(several) > 1 else 0]
    own: MechanicalSystem = replaced(
        several[0], {name: it[i : i + 1] for name, it in columns.items()}
    )[0]
    return own


def _native_runs(
    several: list[MechanicalSystem],
    method: SwitchedRK,
    span: tuple[float, float],
    states: tuple[Array, Array],
    stops: list[Array],
    parameters: tuple[Mapping[str, Array], Array | None, Array | None],
) -> _zivi.MechanicalRuns | None:
    """Prepare runs that need no interpreter, and check their starts; None if some need it."""
    (q, qdot), (columns, rows, e) = states, parameters
    # each start must obey the rows, which the extension does not check
    if any(system._channels or system.equality_names for system in several):
        return None
    models = [system.model(q.shape[1]) for system in several]
    if not all(model.spec.is_native for model in models):
        return None
    check_friction(several[0], method)
    mechanisms = [system.mechanism(it) for system, it in zip(several, models, strict=True)]
    runs = _zivi.MechanicalRuns(mechanisms, q, qdot, tstops=stops, e=e, data=rows)
    # of all systems the first start, and of all starts those that may be wrong
    for i in sorted({*range(len(several)), *runs.unsound_starts(span[0])}):
        system = _system_of_run(several, columns, i)
        try:
            check_start(system, system.model(q.shape[1]), span, q[i], qdot[i])
        except ValueError as error:
            raise ValueError(f"run {i} of the batch: {error}") from None
    return runs


def _batch_of_ends(
    ends: _zivi.MechanicalEnds, config: dict[str, Any], parameters: dict[str, Array]
) -> MechanicalBatch:
    impacts, zeno, liftoffs, corners, flags = ends.totals.T
    since, fastest, fastest_since = ends.speeds.T
    rests = ends.contacts.any(axis=1) & ~(fastest_since > AT_REST * fastest)
    return MechanicalBatch(
        t=ends.t,
        q=ends.q,
        qdot=ends.qdot,
        gaps=ends.gaps,
        contacts=ends.contacts,
        first_impact=ends.first_impact,
        last_impact=ends.last_impact,
        n_impacts=impacts,
        n_zeno=zeno,
        n_liftoffs=liftoffs,
        n_corners=corners,
        n_flags=flags,
        status=ends.status,
        nfev=ends.nfev,
        rest_time=np.where(rests, since, np.nan),
        events=None,
        runs=None,
        config=config,
        parameters=parameters,
    )


def _computed(one: Callable[[int, Any], Kept], count: int, threads: int, report: Any) -> list[Kept]:
    """Compute runs by their numbers; the first exception ends the batch."""
    stopped = threading.Event()

    def go_on(*_: int) -> None:
        if stopped.is_set():
            raise KeyboardInterrupt

    # several runs per task: submitting a task costs as much as a short run
    size = min(max(count // (64 * threads), 1), 64)

    def some(first: int) -> list[Kept]:
        kept = []
        for number in range(first, min(first + size, count)):
            go_on()
            kept.append(one(number, go_on))
        return kept

    # a hundredth of a second that others need not wait for
    from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait

    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(some, first) for first in range(0, count, size)]
        left = set(futures)
        try:
            while left:
                done, left = wait(left, timeout=0.2, return_when=FIRST_EXCEPTION)
                for future in done:
                    future.result()
                if report is not None:
                    report(max(count - len(left) * size, 0), count)
        except BaseException:
            stopped.set()  # those under way end at their next report
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [kept for future in futures for kept in future.result()]


def _systems(systems: Any) -> list[MechanicalSystem]:
    several = [systems] if isinstance(systems, MechanicalSystem) else list(systems)
    for i, system in enumerate(several):
        if not isinstance(system, MechanicalSystem):
            raise TypeError(f"systems must be zivi.MechanicalSystem (number {i}), got {system!r}")
        if system.gap_names != several[0].gap_names:
            raise ValueError(f"systems must have the same gaps, number {i} has {system.gap_names}")
        if system.channel_names != several[0].channel_names:
            names = system.channel_names
            raise ValueError(f"systems must have the same friction, number {i} has {names}")
    return several


def _batch_states(y0: Any, n_systems: int) -> tuple[Array, Array]:
    """Read ``(q0, qdot0)``, each of shape (n,) or (N, n)."""
    given = tuple(y0) if isinstance(y0, Iterable) else ()
    if len(given) != 2:
        raise TypeError(f"y0 must be (q0, qdot0), arrays of shape (N, n) or (n,), got {y0!r}")
    states = [
        np.atleast_2d(real_array(name, value)).astype(np.float64)
        for name, value in zip(("q0", "qdot0"), given, strict=True)
    ]
    count = max(n_systems, *(len(state) for state in states))
    for name, state in zip(("q0", "qdot0"), states, strict=True):
        if state.ndim != 2 or len(state) not in (1, count) or n_systems not in (1, count):
            raise ValueError(
                f"{name} must have a row for each of {count} runs, got shape {state.shape}"
            )
        if not np.all(np.isfinite(state)):
            raise ValueError(f"{name} must be finite")
    q, qdot = states
    if q.shape[1] != qdot.shape[1]:
        raise ValueError(f"qdot0 must have {q.shape[1]} columns as q0, got {qdot.shape[1]}")
    shape = (count, q.shape[1])
    return np.broadcast_to(q, shape).copy(), np.broadcast_to(qdot, shape).copy()


TABLES = ("impacts", "zeno", "liftoffs", "openings", "corners", "flags")
OF_FRICTION = ("transitions", "stick")


def _kept_numbers(run: MechanicalTrajectory, save: str) -> Kept:
    rows = np.asarray(run.impacts)  # whose fields are quick to get
    impacts, groups = rows["t"], rows["group"]
    numbers = {f"n_{name}": len(getattr(run, name)) for name in COUNTED} | {
        "first_impact": impacts[0] if len(impacts) else np.nan,
        "last_impact": impacts[-1] if len(impacts) else np.nan,
        "n_impacts": int(np.max(groups, initial=0)),
        "rest_time": np.nan if run.rest_time is None else run.rest_time,
        "status": int(run.status),
        "nfev": run.nfev,
    }
    tables = (*TABLES, *OF_FRICTION) if run.channel_names else TABLES
    return Kept(
        end=(run.t[-1], run.q[-1], run.qdot[-1], run.gaps[-1], run.contacts[-1]),
        numbers=numbers,
        events={name: getattr(run, name) for name in tables} if save == "events" else None,
        run=run if save == "runs" else None,
        config=run.config,
    )


COUNTED = ("zeno", "liftoffs", "corners", "flags")
KINDS: dict[str, type] = {"status": np.uint8}
KINDS |= dict.fromkeys(("first_impact", "last_impact", "rest_time"), float)
"""Types of the numbers that are no counts."""


def _batch(rows: list[Kept], save: str, config: dict[str, Any]) -> MechanicalBatch:
    ends = zip(*(row.end for row in rows), strict=True)
    names = ("t", "q", "qdot", "gaps", "contacts")
    values: dict[str, Any] = {
        name: np.array(column) for name, column in zip(names, ends, strict=True)
    }
    for name in NUMBERS:
        column = [row.numbers[name] for row in rows]
        values[name] = np.array(column, KINDS.get(name, np.int64))
    return MechanicalBatch(
        **values,
        events=[row.events for row in rows if row.events is not None] if save == "events" else None,
        runs=[row.run for row in rows if row.run is not None] if save == "runs" else None,
        config=config,
    )
