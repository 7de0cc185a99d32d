"""The impacts of a mechanical system: those that were computed, and those that jumps skipped."""

from __future__ import annotations

from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.simulation.impacts import Rows, check_bounds, skipped_fast, skipped_impacts

__all__ = ["down_to", "listed"]


def listed(known: Rows, zeno: Rows, path: Any, part: float) -> Rows:
    """List the impacts down to a part of the fastest, by the speeds before them."""
    speed = float(part * np.max(-known["speed_before"], initial=0.0))
    groups = known["group"]
    fast = known[np.isin(groups, groups[-known["speed_before"] >= speed])]
    return _with_skipped(fast, known, zeno, skipped_fast(path, speed))


def down_to(known: Rows, zeno: Rows, path: Any, speed: float, limit: int) -> Rows:
    """List the impacts with at least a speed after them."""
    check_bounds(speed, limit)
    groups = known["group"]
    fast = known[np.isin(groups, groups[known["speed_after"] >= speed])]
    return _with_skipped(fast, known, zeno, skipped_impacts(path, speed, limit))


def _with_skipped(fast: Any, known: Rows, zeno: Rows, columns: tuple[Array, ...] | None) -> Rows:
    """Add what jumps to Zeno points skipped.

    That are impacts of one gap which repeat the last one that was computed: impulses, and what the
    gaps in contact take of them, fall with its speed.
    """
    found, beyond = [fast], 1 + np.max(known["group"], initial=-1)
    t, before, after, ends = columns or [np.empty(0)] * 4
    for end in np.unique(ends):
        own, last = ends == end, _last(known, zeno, float(end))
        if last is not None:
            rows = _repeated(*last, t[own], before[own], after[own])
            rows["group"] = beyond + np.repeat(np.arange(own.sum()), len(last[0]))
            found.append(rows)
            beyond += own.sum()
    rows = np.sort(np.concatenate(found), order="t", kind="stable")
    _, first, number = np.unique(rows["group"], return_index=True, return_inverse=True)
    rows["group"] = 1 + np.argsort(np.argsort(first))[number]
    return rows.view(np.recarray)


def _last(known: Rows, zeno: Rows, end: float) -> tuple[Rows, int] | None:
    """Give the rows of the last impact before an accumulation, and the gap that bounces."""
    ending = np.flatnonzero(zeno["t"] == end)
    if not len(ending):
        return None
    gap = int(zeno["gap"][ending[0]])
    before = known[(known["gap"] == gap) & (known["t"] < end) & (known["speed_after"] > 0.0)]
    return (known[known["group"] == before["group"][-1]], gap) if len(before) else None


def _repeated(last: Rows, gap: int, t: Any, before: Any, after: Any) -> Any:
    """Repeat an impact at falling speeds."""
    ratio = after / last["speed_after"][last["gap"] == gap][0]
    rows = np.repeat(last, len(t)).reshape(len(last), len(t))
    rows["t"] = t
    for name in ("speed_before", "speed_after", "impulse"):
        rows[name] = last[name][:, None] * ratio
    if "sticks" in (last.dtype.names or ()):
        rows["tangential_impulse"] = last["tangential_impulse"][:, None] * ratio
        rows["slip_before"] = rows["slip_after"] = np.nan
    own = last["gap"] == gap
    rows["speed_before"][own], rows["speed_after"][own] = before, after
    return rows.T.ravel()
