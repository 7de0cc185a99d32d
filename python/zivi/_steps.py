"""Runs of fixed steps, reported otherwise than step by step: at given times, up to an event."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from zivi import _zivi
from zivi._check import Array
from zivi._resample import resampled
from zivi.dense import LinearPath, Path, PenetratingPath
from zivi.events import Event, locate
from zivi.status import Status
from zivi.trajectory import Trajectory

__all__ = ["restrict", "with_events"]


def restrict(sol: Trajectory, times: Array) -> Trajectory:
    """Report a run at `times` (those within the computed span) instead of at its steps."""
    return resampled(sol, times[times <= sol.t[-1]])


def with_events(sol: Trajectory, events: Sequence[Event]) -> Trajectory:
    """Locate events on the interpolation of a fixed-step run, and end it where one ends it."""
    if not events:
        return sol
    hits = locate(sol.t, sol._known(), events)
    sol = dataclasses.replace(sol, t_events=hits.t, y_events=hits.y)
    return sol if hits.end is None else _cut(sol, hits.end)


def _cut(sol: Trajectory, end: float) -> Trajectory:
    """End a fixed-step run at `end`, within its span."""
    kept = restrict(sol, np.append(sol.t[sol.t < end], end))
    rests = sol.rest_time is not None and sol.rest_time <= end
    # a rest that ended later was one until here
    last = sol.zeno_times[sol.zeno_times <= end]
    gone = sol.liftoff_times[sol.liftoff_times <= end]
    if not rests and len(last) and not np.any(gone >= last[-1]):
        rest_time: float | None = float(last[-1])
    else:
        rest_time = sol.rest_time if rests else None
    status = Status.TERMINATED_BY_EVENT
    return dataclasses.replace(
        kept,
        impacts=sol.impacts[sol.impacts["t"] <= end],
        zeno_times=last,
        liftoff_times=gone,
        rest_time=rest_time,
        failed_steps=sol.failed_steps[sol.failed_steps < len(kept.t)],
        status=status,
        message=_zivi.STATUS_MESSAGES[status],
        n_steps=len(kept.t) - 1,
        _path=_path_until(sol._known(), kept),
    )


def _path_until(path: Path, kept: Trajectory) -> Path:
    """Return the path of a fixed-step run through the samples that are left of it."""
    changes = {name: getattr(kept, name) for name in ("t", "s", "v")}
    if isinstance(path, PenetratingPath):
        changes |= {"x": kept.x, "xdot": kept.xdot}
    assert isinstance(path, LinearPath)
    return dataclasses.replace(path, **changes)
