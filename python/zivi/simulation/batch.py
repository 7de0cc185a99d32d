"""Batches: many runs on all cores, of masses and of mechanical systems."""

from __future__ import annotations

import dataclasses
import itertools
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, MaybeNone, real_array
from zivi.base.extras import ProgressBar
from zivi.base.habits import hinted
from zivi.base.machine_code import listening, tell
from zivi.base.table import Field, ResultTable
from zivi.simulation.batch_result import (
    MAX_DESCRIBED,
    Batch,
    BatchRuns,
    check_threads,
    every_of,
    native_columns,
    replaced,
    room_for,
    sampled,
    sampling_of,
    states_for,
    stops_of,
    systems_of,
    threads_for,
    values_by_run,
    with_friction,
)
from zivi.simulation.events import IMPACT, SLOWEST, check_slowest, rows_of_events, rows_of_impacts
from zivi.simulation.mechanical_run import (
    RunRequest,
    check_friction,
    check_mechanical_method,
    configuration,
    run_mechanical,
    stops_with,
    with_kicks,
)
from zivi.simulation.mechanical_trajectory import AT_REST, MechanicalTrajectory
from zivi.simulation.method_settings import Method
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import DEFAULT_METHOD, check_method, pair, times_within
from zivi.simulation.trajectory import describe, describe_system
from zivi.system.kicks import Kick, schedule_of
from zivi.system.mass import ImpactSystem
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

MECHANICAL_SAVES = ("final", "events", "runs")
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
    if save not in MECHANICAL_SAVES:
        names = ", ".join(repr(name) for name in MECHANICAL_SAVES)
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


# Batches: many runs on all cores, for arrays of parameters and initial states.


SAVES = ("final", "statistics", "events", "grazing")
"""What can be kept of each run, beside samples."""


@overload
def simulate_batch(
    systems: MechanicalSystem | Sequence[MechanicalSystem],
    t_span: Sequence[float],
    y0: Any,
    *,
    method: Method = ...,
    t_eval: ArrayLike | None = ...,
    save: str | int = ...,
    slowest: float = ...,
    threads: int | None = ...,
    progress: bool | None = ...,
    tstops: ArrayLike | None = ...,
    kicks: Kick | Sequence[Kick] | None = ...,
    parameters: Mapping[str, ArrayLike] | None = ...,
) -> MechanicalBatch: ...


@overload
def simulate_batch(
    systems: ImpactSystem | Sequence[ImpactSystem],
    t_span: Sequence[float],
    y0: ArrayLike,
    *,
    method: Method = ...,
    t_eval: ArrayLike | None = ...,
    save: str | int = ...,
    slowest: float = ...,
    threads: int | None = ...,
    progress: bool | None = ...,
    tstops: ArrayLike | None = ...,
    kicks: Kick | Sequence[Kick] | None = ...,
    parameters: Mapping[str, ArrayLike] | None = ...,
) -> Batch: ...


@hinted("simulate_batch")
def simulate_batch(
    systems: Any,
    t_span: Sequence[float],
    y0: Any,
    *,
    method: Method = DEFAULT_METHOD,
    t_eval: ArrayLike | None = None,
    save: str | int = "final",
    slowest: float = SLOWEST,
    threads: int | None = None,
    progress: bool | None = None,
    tstops: ArrayLike | None = None,
    kicks: Kick | Sequence[Kick] | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
) -> Batch | MechanicalBatch:
    """Simulate many independent runs, on all cores and without the interpreter.

    The results do not depend on the number of threads, and each run is bit-identical to `simulate`.
    The memory requirement is the saved data plus the record of one run per thread.

    Parameters
    ----------
    systems : ImpactSystem or sequence of ImpactSystem, or of MechanicalSystem
        One system for all runs or one per run. Forces must not need the interpreter: numbers,
        `LinearForce` (with or without a `Table`) and compiled callables do not. A
        `MechanicalSystem` may; those of `zivi.symbolic`, which do not, run side by side. An
        `ImpactSystem` with friction runs as a `MechanicalSystem`.
    t_span : (float, float)
        Start and end (s), the same for all.
    y0 : array_like
        Initial states, shape (n, 2), or (2,) for all systems. Of a `MechanicalSystem`
        ``(q0, qdot0)``, each with a row for each run or one for all.
    method : SwitchedRK, ThetaGamma, MoreauJean or ExplicitEuler
        The method, by default and for mechanical systems `SwitchedRK`. Under constant forces
        `ThetaGamma` moves many masses side by side.
    t_eval : array_like, optional
        Increasing times in `t_span` (s) at which the states of all runs are stored in addition to
        their ends, equal to those of `simulate`: with `SwitchedRK` from its dense output, one state
        per time; with a fixed-step method interpolated between its steps (`ThetaGamma` then runs
        one by one). Of an `ImpactSystem` with ``save="final"`` or ``"events"``.
    save : {"final", "statistics", "events", "grazing"} or int
        Data stored for each run: final state; final state and extremes of the samples; final state
        and all events; final state and whether the run grazed (`SwitchedRK` only); or, for an
        integer n, final state and every n-th sample (fixed-step methods only). Of mechanical
        systems "final", "events" or "runs", the runs themselves.
    slowest : float
        The slowest impacts that are counted and listed, as a part of the fastest one, > 0: also
        those that a Zeno extrapolation skips.
    threads : int, optional
        Number of threads, >= 1; by default the number of cores. They call compiled
        parts at the same time, which must be reentrant: else give 1, as is taken for a
        `MechanicalSystem` with ``reentrant=False``.
    progress : bool, optional
        Show a progress bar on standard error once it lasts longer than a second. By default only
        on a terminal.
    tstops : array_like, optional
        With `SwitchedRK`: times of jumps of the forces of all runs (s; see `simulate`).
    kicks : Kick or sequence of Kick, optional
        With `SwitchedRK`: impulses on all runs at given times (see `simulate`); for an
        `ImpactSystem` numbers instead of functions.
    parameters : dict of str to array_like, optional
        Of one system: values of its parameters by name, a number or an array of shape (n,) with a
        value for each run. Names are those of `replace` and `sensitivity`: ``"e"``,
        ``"gravity"``, ``"wall.amplitude"``. Run ``i`` is that of
        ``system.replace(e=e[i], gravity=gravity[i])``, to the last bit, without an object for
        each.

    Returns
    -------
    Batch or MechanicalBatch
        An entry for each run; one that ended early has its status and the last valid state.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range, before anything is computed; a run that cannot start is
        named.
    KeyboardInterrupt
        On Ctrl-C; nothing is kept then.

    See Also
    --------
    simulate : a single run, with dense output.
    sweep : studies with any function, in parallel and restartable.
    simulate_closed_loop_batch : many closed loops.

    Notes
    -----
    Runs are distributed over threads; those of linear and compiled forces run without the
    interpreter.

    References
    ----------
    E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, 2nd ed.,
    Springer, 1993.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> heights = np.linspace(0.1, 1.0, 4)
    >>> starts = np.column_stack([heights, np.zeros(4)])
    >>> batch = zivi.simulate_batch(ball, (0, 3), starts, method=zivi.ThetaGamma(h=1e-3))
    >>> batch
    <Batch of 4 runs: 4 completed, 4 at rest>

    The same ball on walls of several materials:

    >>> batch = zivi.simulate_batch(ball, (0, 3), (1.0, 0.0), parameters={"e": [0.1, 0.5, 0.7]})
    >>> batch.rest_time.round(3)
    array([0.552, 1.355, 2.559])
    """
    span, slowest = pair("t_span", t_span, "(t0, t1)"), check_slowest(slowest)
    columns = values_by_run(parameters, systems, y0)
    numbers: list[tuple[int | None, Array]] | None = []
    if columns and isinstance(systems, ImpactSystem):
        numbers = native_columns(systems, columns)
        if numbers is None:
            systems = replaced(systems, columns)
    first = next(iter(systems), None) if isinstance(systems, Sequence) else systems
    if isinstance(first, ImpactSystem) and first.friction is not None:
        systems, y0 = with_friction(systems, y0)
        first = systems[0]
    if isinstance(first, MechanicalSystem):
        return mechanical_batch(
            systems,
            span,
            y0,
            method,
            None if t_eval is None else times_within(t_eval, span),
            save,
            slowest,
            check_threads(threads),
            progress,
            tstops,
            kicks,
            columns,
        )
    several = systems_of(systems)
    states = states_for(y0, len(next(iter(columns.values()))) if numbers else len(several))
    check_method(method)
    every = every_of(save, SAVES)
    if every is not None and isinstance(method, SwitchedRK):
        raise ValueError(f"save={every} needs a method of fixed steps, got {method!r}")
    sampling = sampling_of(t_eval, save, span, method, len(states))
    workers = check_threads(threads)
    stops = stops_of(several, tstops, method, span)
    kicked = schedule_of(kicks, several[0], None, span) if kicks is not None else None
    if kicked is not None:
        stops = [stops_with(kicked, it, method) for it in stops]
        states = states + np.array([0.0, dict(kicked.constant()).get(span[0], 0.0)])
    specs = [system._spec for system in several]
    laws = [system._impact for system in several]
    with ProgressBar(progress) as bar, listening([*specs, *laws], threads=True) as ear:
        record = _zivi.simulate_batch(
            specs,
            laws,
            states,
            method._core,
            span=span,
            save=save if every is None else every,
            slowest=slowest,
            threads=workers,
            at=sampling.at,
            steps=sampling.steps,
            tstops=stops if any(map(len, stops)) else None,
            kicks=None if kicked is None else kicked.constant(),
            columns=numbers or [],
            progress=bar.report,
        )
    tell(ear, record.status)
    told = {name: values[:MAX_DESCRIBED].tolist() for name, values in columns.items()}
    config = {
        "t_span": list(span),
        "method": describe(method),
        "save": save if every is None else every,
        **({} if sampling.times is None else {"t_eval": sampling.times.tolist()}),
        "systems": [describe_system(system) for system in several[:MAX_DESCRIBED]],
        "n_systems": len(several),
        **({"parameters": told} if told else {}),
        "y0": states[:MAX_DESCRIBED].tolist(),
        "n_runs": len(states),
    }
    batch = _batch_result(record, span, method, every, str(save), config, columns)
    return batch if sampling.times is None else sampled(batch, record, several, method, sampling)


def _batch_result(
    record: _zivi.BatchRecord,
    span: tuple[float, float],
    method: Any,
    every: int | None,
    save: str,
    config: dict[str, Any],
    parameters: dict[str, Array],
) -> Batch:
    n_impacts, n_zeno, n_liftoffs, n_resolved = record.counts.T
    extremes = save == "statistics"
    return Batch(
        t=record.t,
        x=record.x,
        xdot=record.xdot,
        rest_time=record.rest_time,
        first_impact=record.first_impact,
        last_impact=record.last_impact,
        last_resolved=record.last_resolved,
        hardest_impact=record.hardest_impact,
        n_impacts=n_impacts,
        n_zeno=n_zeno,
        n_liftoffs=n_liftoffs,
        n_resolved=n_resolved,
        status=record.status,
        nfev=record.nfev,
        x_max=record.x_max if extremes else None,
        speed_max=record.speed_max if extremes else None,
        grazing=record.grazing if save == "grazing" else None,
        events=_event_columns(record) if save == "events" else None,
        sample_t=None if every is None else _zivi.grid_times(*span, method.h, every),
        sample_x=None if every is None else record.samples_x,
        sample_xdot=None if every is None else record.samples_xdot,
        config=config,
        parameters=parameters,
    )


def _event_columns(record: _zivi.BatchRecord) -> list[dict[str, Any]]:
    # each access creates a new list
    listed, resolved = record.impacts, record.resolved_impacts
    zeno_times, liftoff_times = record.zeno_times, record.liftoff_times
    columns = (
        _split_rows(listed, lambda flat: _rows_of_all(flat.view(IMPACT), listed), 3),
        _split_rows(zeno_times, lambda times: rows_of_events("zeno", times)),
        _split_rows(liftoff_times, lambda times: rows_of_events("liftoffs", times)),
        [rows.view(IMPACT) for rows in resolved],
        zeno_times,
        liftoff_times,
    )
    names = ("impacts", "zeno", "liftoffs", "resolved_impacts", "zeno_times", "liftoff_times")
    return [dict(zip(names, own, strict=True)) for own in zip(*columns, strict=True)]


def _rows_of_all(impacts: NDArray[np.void], several: list[Array]) -> Any:
    """Return the impacts of all runs, numbered from 0 in each run."""
    rows = rows_of_impacts(impacts)
    counts = [len(flat) // 3 for flat in several]
    rows["group"] -= np.repeat(np.cumsum([0, *counts[:-1]]), counts)
    return rows


def _split_rows(several: list[Array], table: Callable[[Array], Any], width: int = 1) -> list[Any]:
    """Make one table for all runs and split it by run."""
    ends = np.cumsum([0, *map(len, several)]) // width
    rows = table(np.concatenate([*several, np.empty(0)]))
    return [rows[start:end] for start, end in itertools.pairwise(ends)]
