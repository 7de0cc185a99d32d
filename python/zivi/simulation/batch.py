"""Batches: many runs on all cores, for arrays of parameters and initial states."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.base.extras import ProgressBar
from zivi.base.habits import hinted
from zivi.base.machine_code import listening, tell
from zivi.simulation.batch_result import (
    MAX_DESCRIBED,
    Batch,
    check_threads,
    every_of,
    native_columns,
    replaced,
    sampled,
    sampling_of,
    states_for,
    stops_of,
    systems_of,
    values_by_run,
    with_friction,
)
from zivi.simulation.impacts import IMPACT, SLOWEST, check_slowest, rows_of_events, rows_of_impacts
from zivi.simulation.mechanical_batch import MechanicalBatch, mechanical_batch
from zivi.simulation.mechanical_run import stops_with
from zivi.simulation.method_settings import Method
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import DEFAULT_METHOD, check_method, pair, times_within
from zivi.simulation.trajectory import describe, describe_system
from zivi.system.kicks import Kick, schedule_of
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem

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
        one by one). Of an `ImpactSystem` not with another `save`.
    save : {"final", "statistics", "events", "grazing"} or int
        Data stored for each run: final state; final state and extremes of the samples; final state
        and all events; final state and whether the run grazed (`SwitchedRK` only); or, for an
        integer n, final state and every n-th sample (fixed-step methods only). Of mechanical
        systems "final", "events" or "runs", the runs themselves.
    slowest : float
        The slowest impacts that are counted and listed, as a part of the fastest one, > 0: also
        those that a jump to rest skips.
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
