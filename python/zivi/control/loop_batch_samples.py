"""The states of the loops of a batch at given times."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.base.warnings import ModelWarning
from zivi.control.loop_batch_result import ClosedLoopBatch
from zivi.control.loop_run import ClosedLoop
from zivi.simulation.run import times_within

__all__ = ["room_for", "sampled"]

QUANTITIES = ("x", "xdot", "x_ref", "u")
"""What is kept of each loop."""


def room_for(
    t_eval: Any, save: Any, span: tuple[float, float], n: int
) -> tuple[Array, Array] | None:
    """Return the times, and room for what is kept: shape (quantities, loops, times), all NaN."""
    if t_eval is None:
        return None
    if save != "final":
        raise ValueError(f"t_eval goes with save='final' only, got save={save!r}")
    times = times_within(t_eval, span)
    try:
        return times, np.full((len(QUANTITIES), n, len(times)), np.nan)
    except (MemoryError, ValueError):
        size = 8e-9 * len(QUANTITIES) * n * len(times)
        raise MemoryError(
            f"{n} loops and {len(times)} times of t_eval: {size:.3f} GB do not fit into memory; "
            "ask for fewer times, or compute fewer loops at a time"
        ) from None


def sampled(
    batch: ClosedLoopBatch,
    room: tuple[Array, Array],
    loop: Callable[[int], ClosedLoop],
    threads: int,
) -> ClosedLoopBatch:
    """Fill the room from the loops, each run once more alone, and give it to the batch."""
    times, rows = room

    def fill(i: int) -> None:
        run = loop(i)
        for row, name in zip(rows, QUANTITIES, strict=True):
            values = getattr(run, name)
            if values is not None:
                row[i, : len(run.t)] = values

    pool = ThreadPoolExecutor(threads)
    try:
        with warnings.catch_warnings():
            # the batch has said already what differs
            warnings.simplefilter("ignore", ModelWarning)
            for _ in pool.map(fill, range(len(batch))):
                pass
    finally:
        # after an error or Ctrl-C only the loops that run are awaited
        pool.shutdown(cancel_futures=True)
    x, xdot, x_ref, u = rows
    return dataclasses.replace(
        batch, sample_t=times, sample_x=x, sample_xdot=xdot, sample_x_ref=x_ref, sample_u=u
    )
