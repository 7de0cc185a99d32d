"""Batches of closed loops of masses or mechanical systems that run sequentially."""

from __future__ import annotations

import copy
import dataclasses
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, by_name, real_array
from zivi.base.extras import ProgressBar
from zivi.base.status import ModelWarning
from zivi.base.table import Field, ResultTable
from zivi.control.loop_arguments import check_not_negative, check_seed, described, sampling_period
from zivi.control.loop_run import UpdatedBatch
from zivi.control.mechanical_loop import MechanicalClosedLoop, simulate_mechanical, times_ahead
from zivi.control.mechanical_reference import reference_of
from zivi.control.twisting import CONTROLLERS
from zivi.simulation.batch_result import check_threads, threads_for
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.run import pair
from zivi.system.mechanism import MechanicalSystem

if TYPE_CHECKING:
    from zivi.control.loop_run import ClosedLoop

# Loops of a batch that run one by one: with noise, at given times, with controllers of users.

SAVED = ("x", "x_ref", "u")
"""What is saved of the samples."""


def noises_of(noise: Any) -> list[tuple[float, float]]:
    """Return the deviations of the noise, of all loops or of each."""
    rows = np.atleast_2d(real_array("noise", noise))
    if rows.ndim != 2 or rows.shape[1] != 2:
        raise ValueError(f"noise must have shape (n, 2) or (2,), got {np.shape(noise)}")
    return [check_not_negative("noise", row.tolist()) for row in rows]


def seeds_of(seed: Any, n: int) -> list[int]:
    """Return the seeds of the loops: drawn if none is given."""
    if seed is None:
        return [int(it) for it in np.random.SeedSequence().generate_state(n, np.uint64)]
    several = [seed] if np.ndim(seed) == 0 else list(seed)
    return [check_seed(it) for it in several]


def copy_for_loop(controller: Any, i: int) -> Any:
    """Copy a controller for a loop of its own; zivi's are copied by the loop."""
    if isinstance(controller, CONTROLLERS):
        return controller
    try:
        return copy.deepcopy(controller)
    except Exception as error:
        kind = type(controller).__name__
        text = f"each loop has a controller of its own, but {kind} (number {i}) cannot be copied"
        raise TypeError(f"{text}: {error}") from error


def outcomes(
    numbers: Callable[[int], dict[str, Any]],
    n: int,
    threads: int,
    report: Callable[[int, int], None] | None,
) -> list[dict[str, Any]]:
    """Run the loops on threads, and keep the numbers of each."""
    pool = ThreadPoolExecutor(threads)
    found: list[dict[str, Any]] = []
    try:
        with warnings.catch_warnings():
            # the batch has said already what differs
            warnings.simplefilter("ignore", ModelWarning)
            for result in pool.map(numbers, range(n)):
                found.append(result)
                if report is not None:
                    report(len(found), n)
    finally:
        # after an error or Ctrl-C only the loops that run are awaited
        pool.shutdown(cancel_futures=True)
    return found


def numbers_of(run: ClosedLoop, within: float, every: int) -> dict[str, Any]:
    """Return the batch columns of a loop, summed in the order of the Rust batches."""
    # the last sample repeats the control of the one before
    held, error = run.u[:-1], np.abs(run.x - run.x_ref)
    late = np.flatnonzero(~(error <= within))
    settled = late[-1] + 1 if len(late) else 0
    last = {name: getattr(run, name)[-1:] for name in ("t", "x", "xdot", "x_ref", "xdot_ref")}
    return {
        **{name: it[0] if len(it) else np.nan for name, it in last.items()},
        "settling_time": run.t[settled] if settled < len(run.t) else np.nan,
        "error_max": np.fmax.reduce(error, initial=np.nan),
        "error_rms": _rms(error),
        "u_max": np.abs(held).max(initial=0.0),
        "u_rms": _rms(held),
        "u_variation": _sum(np.abs(np.diff(held))),
        "rest_time": np.nan if run.rest_time is None else run.rest_time,
        "n_impacts": len(run.impacts),
        "n_updates": run.n_updates,
        "n_refused": run.n_refused,
        "n_saturated": run.n_saturated,
        "n_unsolved": run.updates.unsolved,
        "status": int(run.status),
        "saved": [getattr(run, name)[::every] for name in SAVED] if every else None,
    }


def _sum(values: Array) -> float:
    """Sum sequentially (NumPy sums pairwise)."""
    return float(np.cumsum(values)[-1]) if len(values) else 0.0


def _rms(values: Array) -> float:
    return float(np.sqrt(_sum(values * values) / len(values))) if len(values) else np.nan


def loop_columns(found: Sequence[dict[str, Any]], every: int) -> dict[str, Any]:
    """Collect the numbers of the loops in arrays, and the samples in rows padded with NaN."""
    names = [name for name in found[0] if name != "saved"]
    kinds = {name: np.uint64 for name in names if name.startswith("n_")} | {"status": np.uint8}
    columns: dict[str, Any] = {
        name: np.array([it[name] for it in found], dtype=kinds.get(name, np.float64))
        for name in names
    }
    for k, name in enumerate(SAVED):
        columns[f"sample_{name}"] = _padded([it["saved"][k] for it in found]) if every else None
    return columns


def _padded(several: list[Array]) -> Array:
    rows = np.full((len(several), max(map(len, several))), np.nan)
    for row, values in zip(rows, several, strict=True):
        row[: len(values)] = values
    return rows


def columns_of_record(record: _zivi.LoopBatchRecord, sampled: bool) -> dict[str, Any]:
    """Return the columns of a native batch by name."""
    names = (
        "settling_time error_max error_rms u_max u_rms u_variation rest_time n_impacts n_updates "
        "n_refused n_saturated n_unsolved status"
    )
    columns = {name: getattr(record, name) for name in names.split()}
    last = dict(zip(("t", "x", "xdot", "x_ref", "xdot_ref"), record.last.T, strict=True))
    saved = {
        f"sample_{name}": getattr(record, f"samples_{name}") if sampled else None for name in SAVED
    }
    return last | columns | saved


def check_starts(states: Array) -> None:
    """Refuse a state from which no loop can start, before any does."""
    for i, (x, xdot) in enumerate(states):
        if not (x >= 0.0 and np.isfinite(x) and np.isfinite(xdot)):
            raise ValueError(f"y0 must be finite with x >= 0, got {(x, xdot)} (run {i})")


# Many closed loops of a mechanical system.

FIELDS: dict[str, Field] = {
    "t": ("run", "", "time of the last sample"),
    "q": (("run", "coordinate"), "", "coordinates there"),
    "qdot": (("run", "coordinate"), "", "velocities there"),
    "gaps": (("run", "gap"), "", "gaps there"),
    "contacts": (("run", "gap"), "", "which gaps are closed there"),
    "reactions": (("run", "gap"), "", "contact forces there"),
    "u": (("run", "control"), "", "the last controls"),
    "error_max": (("run", "gap"), "", "largest error of a gap"),
    "error_rms": (("run", "gap"), "", "root mean square of the error of a gap"),
    "u_max": (("run", "control"), "", "largest control"),
    "u_variation": (("run", "control"), "", "total variation of the control"),
    "rest_time": ("run", "", "time from which nothing moves, NaN if something does"),
    "n_impacts": ("run", "1", "number of impacts"),
    "n_updates": ("run", "1", "number of control updates"),
    "n_refused": ("run", "1", "number of control updates that were rejected"),
    "n_saturated": ("run", "1", "number of control updates that were saturated"),
    "n_lost": ("run", "1", "number of samples at which a held contact was lost"),
    "status": ("run", "1", "how the run ended, a zivi.Status"),
}
"""Dimensions, unit and meaning of what a batch has for each loop."""
LABELS: dict[str, Field] = {
    "run": ("run", "", "number of the run"),
    "coordinate": ("coordinate", "", "name of the coordinate"),
    "gap": ("gap", "", "name of the gap"),
    "control": ("control", "", "name of the control"),
}


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalLoopBatch(UpdatedBatch):
    """Results of a batch of closed loops of a mechanical system: an entry for each of N loops.

    Attributes
    ----------
    t : ndarray
        Time of the last sample, shape (N,).
    q, qdot : ndarray
        Coordinates and velocities there, shape (N, n).
    gaps, contacts, reactions : ndarray
        Gaps, which of them are closed, and contact forces there, shape (N, m).
    u : ndarray
        The last controls, shape (N, r).
    error_max, error_rms : ndarray
        Largest error and root mean square of the error of each gap, NaN without a reference.
    u_max, u_variation : ndarray
        Largest control and total variation of each control, shape (N, r).
    rest_time : ndarray
        Time from which nothing moves until the end, NaN if something does.
    n_impacts : ndarray of int
        Numbers of impacts.
    n_updates, n_refused, n_saturated, n_lost : ndarray of int
        Numbers of control updates, of rejected updates, of updates with a saturated control, and of
        updates at which a held contact was lost.
    status : ndarray of uint8
        How each run ended, the numbers of `Status`.
    runs : list of MechanicalClosedLoop or None
        With ``save="runs"``: the loops themselves.
    config : dict
        Settings of the batch, as plain values.
    """

    t: Array
    q: Array
    qdot: Array
    gaps: Array
    contacts: NDArray[np.bool_]
    reactions: Array
    u: Array
    error_max: Array
    error_rms: Array
    u_max: Array
    u_variation: Array
    rest_time: Array
    n_impacts: NDArray[np.int64]
    n_updates: NDArray[np.int64]
    n_refused: NDArray[np.int64]
    n_saturated: NDArray[np.int64]
    n_lost: NDArray[np.int64]
    status: NDArray[np.uint8]
    runs: list[MechanicalClosedLoop] | None
    config: dict[str, Any]

    def _table(self) -> ResultTable:
        values = {"run": np.arange(len(self))}
        names = {"coordinate": "coordinates", "gap": "gaps", "control": "controls"}
        values |= {
            one: np.array(self.config[several], dtype=object) for one, several in names.items()
        }
        title = "Batch of closed loops of mechanical systems with impacts"
        return ResultTable(title, FIELDS, LABELS, values)


def simulate_mechanical_batch(
    system: MechanicalSystem,
    controller: Any,
    t_span: Sequence[float],
    starts: Any,
    *,
    reference: Any = None,
    noise: Any = (0.0, 0.0),
    seeds: Any = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    save: str | int = "final",
    threads: int | None = None,
    progress: bool | None = None,
    **asked: Any,
) -> MechanicalLoopBatch:
    """Simulate many closed loops of a mechanical system, as `simulate_closed_loop_batch` has it."""
    if save not in ("final", "runs"):
        raise ValueError(f"save must be 'final' or 'runs' for a mechanical system, got {save!r}")
    states = read_starts(starts)
    plants = plants_of(system, {} if parameters is None else by_name("parameters", parameters))
    deviations = noises_of(noise)
    noisy = any(it != (0.0, 0.0) for it in deviations)
    given = [] if seeds is None else np.atleast_1d(seeds).tolist()
    lists = {"starts": states, "parameters": plants, "noise": deviations, "seed": given}
    n = common_length(lists)
    numbers = seeds_of(seeds, n) if noisy or seeds is not None else []
    span, h = pair("t_span", t_span, "(t0, t1)"), sampling_period(controller)
    if isinstance(reference, MechanicalTrajectory):
        ahead = int(getattr(controller, "delay", 0))
        times = times_ahead(_zivi.grid_times(*span, h, 1), h, ahead, reference)
        reference = reference_of(reference, times, system.gap_names, states[0][0])

    def loop(i: int) -> MechanicalClosedLoop:
        more = {"seed": entry(numbers, i)} if numbers else {}
        return simulate_mechanical(
            entry(plants, i),
            controller,
            span,
            entry(states, i),
            reference=reference,
            noise=entry(deviations, i),
            dense_output=save == "runs",
            progress=False,
            **more,
            **asked,
        )

    def kept(i: int) -> tuple[dict[str, Any], MechanicalClosedLoop | None]:
        run = loop(i)
        return mechanical_numbers_of(run), run if save == "runs" else None

    found, runs = [], []
    with ProgressBar(progress) as bar:
        pool = ThreadPoolExecutor(threads_for(plants, check_threads(threads)))
        try:
            for row, run in pool.map(kept, range(n)):
                found.append(row)
                runs.append(run)
                if bar.report is not None:
                    bar.report(len(found), n)
        finally:
            pool.shutdown(cancel_futures=True)
    columns = {name: np.array([row[name] for row in found]) for name in found[0]}
    q0 = states[0][0]
    config = {
        "system": repr(system),
        "controller": described(controller),
        "t_span": list(span),
        "n": n,
        "coordinates": list(system.coordinate_names(len(q0))),
        "gaps": list(system.gap_names),
        "controls": list(system.control_inputs(q0).names),
        "seed": numbers,
        "parameters": {name: np.asarray(it).tolist() for name, it in (parameters or {}).items()},
    }
    whole: Any = runs if save == "runs" else None
    return MechanicalLoopBatch(**columns, runs=whole, config=config)


def read_starts(starts: Any) -> list[tuple[Array, Array]]:
    """Read initial states: ``(q0, qdot0)`` of shapes (n,) or (N, n), or an array (N, 2, n)."""
    if isinstance(starts, tuple) and len(starts) == 2:
        q, qdot = (np.atleast_1d(real_array("starts", it)) for it in starts)
        if q.ndim < 2 and qdot.ndim < 2:
            return [(q, qdot)]
        rows = np.broadcast_arrays(np.atleast_2d(q), np.atleast_2d(qdot))
        return list(zip(np.array(rows[0]), np.array(rows[1]), strict=True))
    array = real_array("starts", starts)
    if array.ndim != 3 or array.shape[1] != 2 or not len(array):
        raise ValueError(
            f"starts must be (q0, qdot0) with rows for each loop, or shape (N, 2, n), "
            f"got {array.shape}"
        )
    return [(row[0], row[1]) for row in array]


def plants_of(
    system: MechanicalSystem, parameters: Mapping[str, ArrayLike]
) -> list[MechanicalSystem]:
    """Return the plants with their parameters."""
    if not isinstance(system, MechanicalSystem):
        raise TypeError(f"systems must be one MechanicalSystem, got {type(system).__name__}")
    if not parameters:
        return [system]
    columns = {
        name: np.atleast_1d(real_array(f"parameters[{name!r}]", it))
        for name, it in parameters.items()
    }
    for name, it in columns.items():
        if it.ndim != 1 or not len(it):
            raise ValueError(
                f"parameters[{name!r}] must be a number or one for each loop, got shape {it.shape}"
            )
    n = common_length({f"parameters[{name!r}]": list(it) for name, it in columns.items()})
    rows = [{name: float(entry(list(it), i)) for name, it in columns.items()} for i in range(n)]
    return [system.replace(**row) for row in rows]


def common_length(lists: Mapping[str, Sequence[Any]]) -> int:
    """Return the length that all lists have that differ from loop to loop."""
    lengths = {name: len(it) for name, it in lists.items() if len(it) > 1}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"all that differs from loop to loop must be as many, got {lengths}")
    return max([1, *lengths.values()])


def entry(things: Sequence[Any] | Array, i: int) -> Any:
    """Return the entry of one loop, or the one for all."""
    return things[i if len(things) > 1 else 0]


def mechanical_numbers_of(run: MechanicalClosedLoop) -> dict[str, Any]:
    """Return the batch columns of a loop."""
    held = run.u[:-1]
    error = np.abs(run.error_gaps)
    last = ("t", "q", "qdot", "gaps", "contacts", "reactions", "u")
    return {name: getattr(run, name)[-1] for name in last} | {
        "error_max": error.max(axis=0),
        "error_rms": np.sqrt(np.mean(error**2, axis=0)),
        "u_max": np.abs(held).max(axis=0),
        "u_variation": np.abs(np.diff(held, axis=0)).sum(axis=0),
        "rest_time": np.nan if run.rest_time is None else run.rest_time,
        "n_impacts": len(np.unique(run.impacts["group"])),
        "n_updates": run.n_updates,
        "n_refused": run.n_refused,
        "n_saturated": run.n_saturated,
        "n_lost": run.updates.lost,
        "status": np.uint8(int(run.status)),
    }
