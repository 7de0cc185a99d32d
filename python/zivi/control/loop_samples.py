"""A closed loop reported otherwise than sample by sample: at given times, up to an event."""

from __future__ import annotations

import dataclasses

import numpy as np

from zivi.base.check import Array
from zivi.control.loop_run import ClosedLoop

__all__ = ["QUANTITIES", "ended_by_event", "keep", "restrict"]

QUANTITIES = ("x", "xdot", "x_ref", "u")
"""What a batch keeps of each loop at given times."""


def restrict(run: ClosedLoop, times: Array) -> ClosedLoop:
    """Report a run at `times` (those within the computed span) instead of at its samples."""
    if run._span is None:
        return run
    return run._resampled(times[times <= run._span[1]])


def keep(rows: Array, run: ClosedLoop, times: Array) -> None:
    """Put the quantities of a loop of a batch at `times` into their rows."""
    there = restrict(run, times)
    for row, name in zip(rows, QUANTITIES, strict=True):
        values = getattr(there, name)
        if values is not None:
            row[: len(there.t)] = values


def ended_by_event(run: ClosedLoop, h: float) -> ClosedLoop:
    """End a run at its last event, within its last period."""
    end = max(float(times[-1]) for times in run.t_events if len(times))
    times = np.append(run.t[run.t < end], end)
    zeno = run.zeno_times[run.zeno_times <= end]
    gone = run.liftoff_times[run.liftoff_times <= end]
    cut = dataclasses.replace(
        run._resampled(times),
        resolved_impacts=run.resolved_impacts[run.resolved_impacts["t"] <= end],
        zeno_times=zeno,
        liftoff_times=gone,
        _span=(float(run.t[0]), end),
    )
    return dataclasses.replace(cut, rest_time=_rest(cut, max(end - h, times[0])))


def _rest(run: ClosedLoop, latest: float) -> float | None:
    """Give the time from which the plant rests until the end, if that is not after `latest`."""
    if (run.x[-1], run.xdot[-1]) != (0.0, 0.0):
        return None
    left = run.liftoff_times[-1] if len(run.liftoff_times) else -np.inf
    since = run.zeno_times[run.zeno_times > left]
    start = since[-1] if len(since) else max(left, run.t[0])
    return float(start) if start <= latest else None
