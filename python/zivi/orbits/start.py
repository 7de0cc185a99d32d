"""From what a user has, a run, a state, an orbit, an array, to a guess of an orbit."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, real, real_array
from zivi.orbits.attractor import quiet
from zivi.orbits.mechanical.run_word import MOST_MULTIPLE, TOLERANCES, repeating, shown
from zivi.orbits.orbit import PeriodicOrbit
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import pair, simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.mass import ImpactSystem

__all__ = ["Guess", "guess_of"]

NOTHING = np.empty((0, 2))
SETTLING = 200
"""Periods that are simulated from a state when nothing says how the motion repeats."""


@dataclasses.dataclass(frozen=True)
class Guess:
    """A guess of an orbit."""

    y: Array
    multiple: int
    rest: float | None = None
    """A time at rest: the motion after the next lift-off may rest again."""
    start: float = 0.0
    """Where an orbit without impacts is looked at."""
    end: float = -math.inf
    """Where the run ends that shows it."""
    shown: str = ""
    """What the run shows, for messages."""


def guess_of(
    system: ImpactSystem, start: Any, multiple: int | None, period: float, method: SwitchedRK
) -> Guess:
    """Give the guess that a start is."""
    if isinstance(start, PeriodicOrbit):
        if start.kind == "resting":
            phase = (start.liftoff_time or 0.0) - 0.5 * min(start.margin or period, period)
            return Guess(NOTHING, multiple or start.multiple, phase)
        return Guess(start._y, multiple or start.multiple, start=start._frame.start)
    if isinstance(start, Trajectory):
        return from_run(system, start, multiple, period, method)
    if isinstance(start, tuple) and len(start) == 2 and np.ndim(start[0]) == 0:
        return _from_state(system, start, multiple, period, method)
    rows = rows_of(start)
    shown = math.floor((rows[-1, 0] - rows[0, 0]) / period * (1.0 - 1e-9)) + 1
    return Guess(rows, multiple or shown)


def _from_state(
    system: ImpactSystem,
    start: tuple[Any, Any],
    multiple: int | None,
    period: float,
    method: SwitchedRK,
) -> Guess:
    t0, state = real("start[0]", start[0]), pair("start[1]", start[1], "(x0, xdot0)")
    span = (t0, t0 + (multiple or SETTLING) * period)
    run = simulate(system, span, state, method, dense_output=False)
    if multiple is None:
        return from_run(system, run, None, period, method)
    # a guess of the orbit itself: the impacts of its period
    if len(run.zeno_times):
        return Guess(NOTHING, multiple, float(run.zeno_times[-1]))
    impacts = _impacts(run)
    return Guess(impacts if len(impacts) else np.array(state), multiple, start=t0)


def _impacts(run: Trajectory) -> Array:
    return np.column_stack([run.resolved_impacts["t"], run.resolved_impacts["xdot_after"]])


def from_run(
    system: ImpactSystem,
    run: Trajectory,
    multiple: int | None,
    period: float,
    method: SwitchedRK,
    *,
    further: bool = True,
) -> Guess:
    """Give what the end of a run shows; where it has no impacts, what a further run shows."""
    end, rest = float(run.t[-1]), None
    if run.rest_time is not None:
        return Guess(NOTHING, 1, end)
    if len(run.zeno_times) and run.zeno_times[-1] > end - MOST_MULTIPLE * period:
        rest = float(run.zeno_times[-1])
    impacts = _impacts(run)
    impacts = impacts[impacts[:, 0] > end - 2 * MOST_MULTIPLE * period]
    repeats = multiple or _repeats(impacts, end, period)
    # a motion with impacts has one in as many periods as it takes to repeat
    if not np.any(impacts[:, 0] > end - (repeats or 4) * period):
        state = np.array([run.x[-1], run.xdot[-1]])
        if further and multiple is None:
            times = end + period * np.arange(2 * MOST_MULTIPLE + 1)
            span = (end, float(times[-1]))
            more = simulate(system, span, tuple(state), method, t_eval=times)
            if len(more.resolved_impacts):
                return from_run(system, more, None, period, method, further=False)
            states = np.column_stack([more.x, more.xdot])
            multiple = repeating(states) if more.success else None
        multiple = multiple or 1
        # far from t = 0 the phase of the excitation loses digits
        return Guess(state, multiple, rest, end % period, end, shown(multiple, 0))
    multiple = repeats or 1
    rows = _window(impacts, end, multiple * period)
    while not len(rows):
        # a flight of more than the periods that were taken
        multiple += 1
        rows = _window(impacts, end, multiple * period)
    told = shown(multiple, len(rows), repeats=repeats is not None)
    return Guess(rows, multiple, rest, end=end, shown=told)


def _window(impacts: Array, end: float, length: float, before: float = 0.0) -> Array:
    """Give the impacts of the last period of the motion, as seen from the middle of a flight."""
    close = quiet(impacts, end) - before
    inside = (impacts[:, 0] > close - length) & (impacts[:, 0] <= close)
    return impacts[inside]


def _repeats(impacts: Array, end: float, period: float) -> int | None:
    """Give after how many periods the impacts repeat; None if they do not."""
    if not len(impacts):
        return None
    scale = float(np.max(np.abs(impacts[:, 1]))) or 1.0
    for tolerance in TOLERANCES:
        for m in range(1, MOST_MULTIPLE + 1):
            length = m * period
            now, before = (_window(impacts, end, length, back) for back in (0.0, length))
            if not len(now) or len(now) != len(before):
                continue
            shift = np.abs(now - before - [length, 0.0]) / [period, scale]
            if np.max(shift) <= tolerance:
                return m
    return None


def rows_of(start: ArrayLike) -> Array:
    """Give the impacts of an array as rows ``(t, u)``."""
    array = np.asarray(start)
    if array.dtype.names:
        speed = "u" if "u" in array.dtype.names else "xdot_after"
        return np.column_stack([array["t"], array[speed]]).astype(np.float64)
    rows = real_array("start", array)
    if rows.ndim != 2 or rows.shape[1] != 2 or not len(rows):
        raise ValueError(f"start must have rows (t, u), got an array of shape {rows.shape}")
    if not np.all(np.isfinite(rows)) or np.any(np.diff(rows[:, 0]) <= 0.0):
        raise ValueError("start must have finite rows (t, u) at increasing times")
    return rows
