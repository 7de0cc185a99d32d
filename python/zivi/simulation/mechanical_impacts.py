"""The impacts of a mechanical system: those that were computed, and those that jumps skipped."""

from __future__ import annotations

from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.simulation.impacts import EventTable, Rows, check_bounds, skipped_before, skipped_fast

__all__ = ["down_to", "listed"]


def listed(known: Rows, zeno: Rows, path: Any, part: float) -> Rows:
    """List the impacts down to a part of the fastest, by the speeds before them."""
    speed = float(part * np.max(-known["speed_before"], initial=0.0))
    fast = _groups_with(-known["speed_before"] >= speed, known)
    return _with_skipped(fast, known, zeno, skipped_fast(path, speed))


def down_to(known: Rows, zeno: Rows, path: Any, speed: float, limit: int) -> Rows:
    """List the impacts with at least a speed before them."""
    check_bounds(speed, limit)
    fast = _groups_with(-known["speed_before"] >= speed, known)
    return _with_skipped(fast, known, zeno, skipped_before(path, speed, limit))


def _groups_with(chosen: Any, known: Any) -> Any:
    """Take the impacts at one instant of which one at least is chosen."""
    if np.all(chosen):
        return known
    groups = known["group"]
    wanted = np.zeros(1 + np.max(groups), bool)
    wanted[groups[chosen]] = True
    return known[wanted[groups]]


def _with_skipped(fast: Any, known: Any, zeno: Any, columns: tuple[Array, ...] | None) -> Rows:
    """Add what jumps to Zeno points skipped.

    That are impacts of one gap which repeat the last one that was computed: impulses, and what the
    gaps in contact take of them, fall with its speed.
    """
    # plain arrays, whose fields are quick to get
    known, zeno = np.asarray(known), np.asarray(zeno)
    found, beyond = [np.asarray(fast)], 1 + np.max(known["group"], initial=-1)
    t, before, after, ends = columns or [np.empty(0)] * 4
    if not len(t):
        return _numbered(_by_time(found[0]))
    begins = _changes(ends)
    each, place = ends[begins], np.cumsum(begins) - 1
    gaps, first, count = _last(known, zeno, each)
    alone = count[place] == 1
    if np.any(alone):
        rows = known[first[place[alone]]]
        _fall(rows, after[alone] / rows["speed_after"])
        rows["t"], rows["speed_before"], rows["speed_after"] = t[alone], before[alone], after[alone]
        rows["group"] = beyond + np.arange(len(rows))
        found.append(rows)
        beyond += len(rows)
    for k in np.flatnonzero(count > 1):
        own, last = place == k, known[first[k] : first[k] + count[k]]
        rows = _repeated(last, gaps[k], t[own], before[own], after[own])
        rows["group"] = beyond + np.repeat(np.arange(own.sum()), len(last))
        found.append(rows)
        beyond += own.sum()
    return _numbered(_by_time(np.concatenate(found)))


def _numbered(rows: Any) -> Rows:
    """Give impacts at one instant a number, in the order of their times."""
    groups = rows["group"]
    there = np.zeros(1 + np.max(groups, initial=0), bool)
    there[groups] = True
    begins = _changes(groups)
    if np.count_nonzero(begins) == np.count_nonzero(there):
        rows["group"] = np.cumsum(begins)
    else:  # two groups at one time, one in between the other
        _, start, number = np.unique(groups, return_index=True, return_inverse=True)
        rows["group"] = 1 + np.argsort(np.argsort(start))[number]
    whole: Rows = rows.view(EventTable)
    return whole


def _changes(values: Any) -> Any:
    """Tell where values differ from those before them; the first does."""
    return np.concatenate([np.ones(min(1, len(values)), bool), values[1:] != values[:-1]])


def _by_time(rows: Any) -> Any:
    """Sort impacts by their times, those at one time by what else is known of them."""
    order = np.argsort(rows["t"], kind="stable")
    t = rows["t"][order]
    if np.any(t[1:] == t[:-1]):
        return np.sort(rows, order="t", kind="stable")
    return rows[order]


def _last(known: Any, zeno: Any, ends: Array) -> tuple[Any, Any, Any]:
    """Find the gap that bounces before each accumulation, and its last impact.

    Of that the first row and how many there are; none where it is not known.
    """
    gaps, first, count = (np.zeros(len(ends), int) for _ in range(3))
    times = np.append(zeno["t"], np.nan)
    at = np.searchsorted(zeno["t"], ends)
    is_known = times[at] == ends
    gaps[is_known] = zeno["gap"][at[is_known]]
    for gap in np.unique(gaps[is_known]):
        own = np.flatnonzero(is_known & (gaps == gap))
        bounces = np.flatnonzero((known["gap"] == gap) & (known["speed_after"] > 0.0))
        before = np.searchsorted(known["t"][bounces], ends[own])
        own, before = own[before > 0], before[before > 0]
        group = known["group"][bounces[before - 1]]
        first[own] = np.searchsorted(known["group"], group)
        count[own] = np.searchsorted(known["group"], group, side="right") - first[own]
    return gaps, first, count


def _fall(rows: Any, ratio: Any) -> None:
    """Let impacts fall with the speed."""
    for name in ("speed_before", "speed_after", "impulse"):
        rows[name] = rows[name] * ratio
    if "sticks" in (rows.dtype.names or ()):
        rows["tangential_impulse"] = rows["tangential_impulse"] * ratio
        rows["slip_before"] = rows["slip_after"] = np.nan


def _repeated(last: Any, gap: int, t: Any, before: Any, after: Any) -> Any:
    """Repeat an impact on several gaps at falling speeds."""
    ratio = after / last["speed_after"][last["gap"] == gap][0]
    rows = np.repeat(last, len(t)).reshape(len(last), len(t))
    rows["t"] = t
    _fall(rows, ratio)
    own = last["gap"] == gap
    rows["speed_before"][own], rows["speed_after"][own] = before, after
    return rows.T.ravel()
