"""The states of the loops of a batch at given times."""

from __future__ import annotations

from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.control.loop_run import ClosedLoop
from zivi.control.loop_samples import restrict
from zivi.simulation.run import times_within

__all__ = ["columns_at", "keep", "room_for"]

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


def keep(room: tuple[Array, Array], i: int, run: ClosedLoop) -> None:
    """Put the states of a loop at the times into its rows."""
    times, rows = room
    there = restrict(run, times)
    for row, name in zip(rows, QUANTITIES, strict=True):
        values = getattr(there, name)
        if values is not None:
            row[i, : len(there.t)] = values


def columns_at(room: tuple[Array, Array]) -> dict[str, Array]:
    """Name what was kept of the loops."""
    times, rows = room
    return {"sample_t": times} | dict(zip((f"sample_{it}" for it in QUANTITIES), rows, strict=True))
