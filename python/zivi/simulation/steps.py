"""Runs of fixed steps, reported otherwise than step by step: at given times, up to an event."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.simulation.dense import LinearPath, Path, PenetratingPath
from zivi.simulation.trajectory import Trajectory

__all__ = ["ended_by_event", "restrict"]


def restrict(sol: Trajectory, times: Array) -> Trajectory:
    """Report a run at `times` (those within the computed span) instead of at its steps."""
    return sol._resampled(times[times <= sol.t[-1]])


def ended_by_event(sol: Trajectory) -> Trajectory:
    """End a fixed-step run at its last event, within its last step."""
    end = max(float(times[-1]) for times in sol.t_events if len(times))
    kept = restrict(sol, np.append(sol.t[sol.t < end], end))
    rests = sol.rest_time is not None and sol.rest_time <= end
    # a rest that ended later was one until here
    last = sol.zeno_times[sol.zeno_times <= end]
    gone = sol.liftoff_times[sol.liftoff_times <= end]
    if not rests and len(last) and not np.any(gone >= last[-1]):
        rest_time: float | None = float(last[-1])
    else:
        rest_time = sol.rest_time if rests else None
    return dataclasses.replace(
        kept,
        resolved_impacts=sol.resolved_impacts[sol.resolved_impacts["t"] <= end],
        zeno_times=last,
        liftoff_times=gone,
        rest_time=rest_time,
        failed_steps=sol.failed_steps[sol.failed_steps < len(kept.t)],
        n_steps=len(kept.t) - 1,
        _path=_path_until(sol._known(), kept),
    )


def _path_until(path: Path, kept: Trajectory) -> Path:
    """Return the path of a fixed-step run through the samples that are left of it."""
    changes: dict[str, Any] = {"t": kept.t, "s": kept.transformed.s, "v": kept.transformed.v}
    if isinstance(path, PenetratingPath):
        changes |= {"x": kept.x, "xdot": kept.xdot}
    assert isinstance(path, LinearPath)
    return dataclasses.replace(path, **changes)
