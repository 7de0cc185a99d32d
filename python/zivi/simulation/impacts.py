"""The impacts of a run: as a record, and with those that were extrapolated."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi import _zivi
from zivi.base.check import finite, whole

__all__ = ["IMPACT", "down_to", "impacts_of"]

IMPACT = np.dtype([("t", "f8"), ("xdot_before", "f8"), ("xdot_after", "f8")])
"""One impact: its time (s) and the velocities before and after it (m/s)."""


def impacts_of(record: _zivi.RunRecord | _zivi.LoopRecord) -> NDArray[np.void]:
    """Return the impacts of a record as a structured array."""
    return record.impacts.view(IMPACT)  # which has its rows


def down_to(known: NDArray[np.void], path: Any, speed: float, limit: int) -> NDArray[np.void]:
    """Add the impacts to `known` that the path of a run skipped, down to a speed."""
    speed = finite("speed", speed)
    if not speed > 0.0:
        raise ValueError(f"speed must be > 0, got {speed}")
    if whole("limit", limit) < 1:
        raise ValueError(f"limit must be >= 1, got {limit}")
    fast = known[known["xdot_after"] >= speed]
    skipped = getattr(path, "skipped_impacts", None)
    if skipped is None:
        return fast
    lazily = np.empty(len((columns := skipped(speed, limit))[0]), IMPACT)
    for field, column in zip(IMPACT.names or (), columns, strict=True):
        lazily[field] = column
    return np.sort(np.concatenate([fast, lazily]), order="t", kind="stable")
