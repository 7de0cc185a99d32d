"""Guesses of orbits of systems that nothing excites, whose period is an unknown."""

from __future__ import annotations

from typing import Any

import numpy as np

from zivi.base.check import Array, real
from zivi.base.status import Status
from zivi.orbits.flights import FlightError, fly
from zivi.orbits.mechanical.run_word import MOST_MULTIPLE, TOLERANCES
from zivi.orbits.orbit import PeriodicOrbit
from zivi.orbits.rest import force_at_rest
from zivi.orbits.sequence import unknowns_of
from zivi.orbits.start import NOTHING, Guess, rows_of
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import pair, simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.gap import HarmonicWall
from zivi.system.mass import ImpactSystem, LinearForce
from zivi.system.parameters import excitation

__all__ = ["apex", "free_guess", "is_autonomous"]

SPANS = (10.0, 100.0, 1e3, 1e4)
"""Durations of a run from a state, until it shows how it repeats (s)."""
ENOUGH = 60
"""Impacts that show it."""
LOOKS = (0.0, 0.173, 0.71, 1.9, 3.3, 7.1, 19.7, 53.9)
"""Times at which a force is evaluated to see whether it depends on them (s)."""


def is_autonomous(system: ImpactSystem) -> bool:
    """Whether nothing excites a system: a force of the state alone, as far as looks can tell."""
    force, wall = system.force, system.wall
    if isinstance(force, int | float) or excitation(system)[0] is not None:
        return False
    if wall is not None and not (isinstance(wall, HarmonicWall) and wall.amplitude == 0.0):
        return False
    if isinstance(force, LinearForce):
        return force.amplitude == 0.0
    values = [force_at_rest(system, t) for t in LOOKS]
    return bool(np.ptp(values) == 0.0)


def free_guess(system: ImpactSystem, start: Any, method: SwitchedRK) -> Guess:
    """Give the guess that a start is."""
    if isinstance(start, PeriodicOrbit):
        return Guess(start._y, 1, 0.0 if start.kind == "resting" else None)
    if isinstance(start, Trajectory):
        return _from_run(start)
    if isinstance(start, tuple) and len(start) == 2 and np.ndim(start[0]) == 0:
        real("start[0]", start[0])
        state = pair("start[1]", start[1], "(x0, xdot0)")
        for span in SPANS:
            run = simulate(system, (0.0, span), state, method)
            if len(run.resolved_impacts) >= ENOUGH or run.rest_time is not None or not run.success:
                break
        return _from_run(run)
    rows = rows_of(start)
    return Guess(unknowns_of(rows, rows[-1, 0] - rows[0, 0] + _flight(system, rows[-1, 1])), 1)


def _flight(system: ImpactSystem, speed: float) -> float:
    """Give the duration of a flight from the wall."""
    for span in SPANS:
        run = simulate(system, (0.0, span), (0.0, abs(speed)), dense_output=False)
        if len(run.resolved_impacts):
            return float(run.resolved_impacts["t"][0])
    raise ValueError(f"start: the last impact is followed by no other within {SPANS[-1]:g} s")


def _from_run(run: Trajectory) -> Guess:
    """Give what the end of a run shows."""
    if run.rest_time is not None:
        return Guess(NOTHING, 1, float(run.t[-1]))
    impacts = np.column_stack([run.resolved_impacts["t"], run.resolved_impacts["xdot_after"]])
    if len(impacts) < 2:
        return Guess(_cycle(run), 1)
    k = _repeats(impacts)
    last = impacts[-k - 1 :]
    return Guess(unknowns_of(last[:-1], last[-1, 0] - last[0, 0]), 1)


def _repeats(impacts: Array) -> int:
    """Give after how many impacts their speeds and the times between them repeat."""
    steps = np.column_stack([np.diff(impacts[:, 0]), impacts[1:, 1]])
    size = np.max(np.abs(steps), axis=0)
    for tolerance in TOLERANCES:
        for k in range(1, min(MOST_MULTIPLE, len(steps) // 2) + 1):
            if np.max(np.abs(steps[-k:] - steps[-2 * k : -k]) / size) <= tolerance:
                return k
    return 1


def _cycle(run: Trajectory) -> Array:
    """Give the highest point and the period of the last turn of a motion without impacts."""
    t = np.linspace(run.t[0], run.t[-1], 20_000)
    x, v = run(t)
    tops = np.flatnonzero((v[:-1] > 0.0) & (v[1:] <= 0.0))
    if len(tops) < 2:
        raise ValueError("start: the run has neither impacts nor two highest points")
    exact = t[tops] + v[tops] / (v[tops] - v[tops + 1]) * (t[1] - t[0])
    return np.array([x[tops[-1]], exact[-1] - exact[-2]])


def apex(system: ImpactSystem, row: Array, method: SwitchedRK) -> tuple[float, float]:
    """Give when a flight ``(t, x, xdot, end)`` is highest, and how high."""
    times = np.linspace(row[0], row[3], 65)[1:]
    starts = np.tile(row, (len(times), 1))
    starts[:, 3] = times
    t = float(times[int(np.argmax(fly(system, starts, method)[0][:, 0]))])
    for _ in range(6):
        ((_, v, _, last, *_),) = fly(system, np.array([[*row[:3], t]]), method)[0]
        t -= float(v / last)
        if not row[0] < t <= row[3]:
            raise FlightError(Status.STEP_SIZE_TOO_SMALL)
    return t, float(fly(system, np.array([[*row[:3], t]]), method)[0][0, 0])
