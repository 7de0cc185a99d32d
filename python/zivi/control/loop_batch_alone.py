"""Loops of a batch that run one by one: with noise, at given times, with controllers of users."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array, real_array
from zivi.base.warnings import ModelWarning
from zivi.control.loop_arguments import check_not_negative, check_seed
from zivi.control.twisting import CONTROLLERS

if TYPE_CHECKING:
    from zivi.control.loop_run import ClosedLoop

__all__ = [
    "check_starts",
    "columns_of",
    "columns_of_record",
    "copied",
    "noises_of",
    "numbers_of",
    "outcomes",
    "seeds_of",
]

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


def copied(controller: Any, i: int) -> Any:
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
    """Give what a batch has of a loop, summed sample by sample as the batches in Rust do."""
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
    """Sum from the first to the last, not by halves."""
    return float(np.cumsum(values)[-1]) if len(values) else 0.0


def _rms(values: Array) -> float:
    return float(np.sqrt(_sum(values * values) / len(values))) if len(values) else np.nan


def columns_of(found: Sequence[dict[str, Any]], every: int) -> dict[str, Any]:
    """Put the numbers of the loops into arrays, and the samples into rows, filled up with NaN."""
    names = [name for name in found[0] if name != "saved"]
    kinds = {name: np.uint64 for name in names if name.startswith("n_")} | {"status": np.uint8}
    columns: dict[str, Any] = {
        name: np.array([it[name] for it in found], dtype=kinds.get(name, np.float64))
        for name in names
    }
    for k, name in enumerate(SAVED):
        columns[f"sample_{name}"] = _rows([it["saved"][k] for it in found]) if every else None
    return columns


def _rows(several: list[Array]) -> Array:
    rows = np.full((len(several), max(map(len, several))), np.nan)
    for row, values in zip(rows, several, strict=True):
        row[: len(values)] = values
    return rows


def columns_of_record(record: _zivi.LoopBatchRecord, sampled: bool) -> dict[str, Any]:
    """Name the columns of a batch in Rust."""
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
