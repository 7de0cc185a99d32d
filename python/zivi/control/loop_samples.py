"""A closed loop reported otherwise than sample by sample: at given times, up to an event."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.control.loop_run import ESTIMATES, ClosedLoop

__all__ = ["ended_by_event", "restrict"]


def restrict(run: ClosedLoop, times: Array) -> ClosedLoop:
    """Report a run at `times` (those within the computed span) instead of at its samples."""
    if run._span is None:
        return run
    times = times[times <= run._span[1]]
    return dataclasses.replace(run, t=times, **_at(run, times))


def _at(run: ClosedLoop, times: Array) -> dict[str, Any]:
    """Give the states at `times`, and what is held there."""
    k = np.maximum(np.searchsorted(run.t, times, side="right") - 1, 0)
    x, xdot = run(times)
    unknown = np.full((2, len(times)), np.nan)
    x_ref, xdot_ref = unknown if run._reference is None else run.reference(times)
    names = ("u", "signs", "tick_status", *(ESTIMATES if run.x_est is not None else ()))
    held = {name: getattr(run, name)[k] for name in names}
    return {"x": x, "xdot": xdot, "x_ref": x_ref, "xdot_ref": xdot_ref, **held}


def ended_by_event(run: ClosedLoop, h: float) -> ClosedLoop:
    """End a run at its last event, within its last period."""
    end = max(float(times[-1]) for times in run.t_events if len(times))
    times = np.append(run.t[run.t < end], end)
    zeno = run.zeno_times[run.zeno_times <= end]
    gone = run.liftoff_times[run.liftoff_times <= end]
    cut = dataclasses.replace(
        run,
        t=times,
        **_at(run, times),
        impacts=run.impacts[run.impacts["t"] <= end],
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
