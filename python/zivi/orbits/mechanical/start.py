"""From what a user has, a run, a state, an orbit, a word, to an orbit of a mechanical system."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array, finite, integer, real, real_array
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.by_parameter import flow_of
from zivi.orbits.mechanical.equations import Frame
from zivi.orbits.mechanical.family import core_of, frequency_of
from zivi.orbits.mechanical.find import failed, solve
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.mechanical.run_word import NotDifferentiable, recent
from zivi.orbits.mechanical.segments import of_segments
from zivi.orbits.mechanical.symmetry import gaps_turned, turn_of
from zivi.orbits.mechanical.word import parsed
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import simulate
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import check_smooth
from zivi.system.table import Table

__all__ = ["mechanical_orbit"]

SETTLING = 200
"""Periods that are simulated from a state when nothing says how the motion repeats."""
LOOSE = SwitchedRK(rtol=1e-9, atol=1e-10)
"""Of runs that give a guess."""


def mechanical_orbit(
    system: MechanicalSystem,
    start: Any,
    multiple: int | None,
    period: float | str | None,
    symmetry: Array | Callable[[Array], Array] | None,
    method: SwitchedRK,
    max_iter: int,
) -> MechanicalOrbit:
    """Find a periodic orbit of a mechanical system: `zivi.periodic_orbit` of one."""
    check_smooth(system)
    _refuse_laws(system)
    _refuse_tables(system)
    if multiple is not None and integer("multiple", multiple) < 1:
        raise ValueError(f"multiple must be >= 1, got {multiple}")
    length, free = _period(system, period)
    if free and multiple not in (None, 1):
        raise ValueError(f"multiple counts periods of an excitation; there is none, got {multiple}")
    flow = flow_of(system, method)
    if isinstance(start, MechanicalOrbit):
        return _from_orbit(system, start, multiple, length, free, symmetry, method, max_iter)
    try:
        frame, x, multiple, told = _guess(system, start, multiple, length, free, method)
    except NotDifferentiable as it:
        y, status = it.frame.joined(it.x, it.frame.length), OrbitStatus.NOT_DIFFERENTIABLE
        return failed(it.frame, y, it.count, str(it), status)
    if symmetry is not None:
        frame, x = _half(frame, x, turn_of(symmetry, flow.n))
    orbit = solve(frame, frame.joined(x, frame.length), multiple, max_iter)
    if orbit.success or not told:
        return orbit
    return dataclasses.replace(orbit, message=f"{orbit.message} {told}")


def _refuse_laws(system: MechanicalSystem) -> None:
    _ = system.e  # which says what takes laws that depend on the speed
    law = core_of(system).impact_law
    # one gap without friction has the same impacts by all of them
    if law != "newton" and system.m > 1:
        raise ValueError(
            f"impact_law must be 'newton' for orbits of systems with several gaps, got {law!r}"
        )


def _refuse_tables(system: MechanicalSystem) -> None:
    core = core_of(system)
    parts = [*getattr(core, "excitation", ()), *(getattr(gap, "motion", None) for gap in core.gaps)]
    if core._inputs is not None or any(isinstance(part, Table) for part in parts):
        raise ValueError("system: orbits of systems with tables are not there, their knots move")


def _period(system: MechanicalSystem, period: float | str | None) -> tuple[float, bool]:
    if isinstance(period, str):
        if period != "free":
            raise ValueError(f"period must be a number or 'free', got {period!r}")
        if frequency_of(system) is not None:
            raise ValueError("period cannot be 'free': the system is excited, and has its period")
        return math.nan, True
    if period is not None:
        if not (length := finite("period", period)) > 0.0:
            raise ValueError(f"period must be > 0, got {period}")
        return length, False
    omega = frequency_of(system)
    if omega is None:
        raise ValueError(
            "period: the system has no single excitation whose period is known, give period=..., "
            "or period='free' where it does not depend on time"
        )
    return 2.0 * math.pi / omega, False


def _guess(
    system: MechanicalSystem,
    start: Any,
    multiple: int | None,
    period: float,
    free: bool,
    method: SwitchedRK,
) -> tuple[Frame, Array, int, str]:
    """Give the frame, the unknowns, the multiple, and of a run what it shows."""
    if isinstance(start, MechanicalTrajectory):
        return recent(system, start, multiple, period, free, method)
    if isinstance(start, tuple) and len(start) == 2 and np.ndim(start[0]) == 0:
        t0 = real("start[0]", start[0])
        state = state_of(start[1], system._n)
        if multiple is not None and not free:
            run = simulate(system, (t0, t0 + (multiple + 1) * period), state, method)
            return recent(system, run, multiple, period, free, method)
        span = SETTLING * (10.0 if free else period)
        run = simulate(system, (t0, t0 + span), state, LOOSE)
        return recent(system, run, multiple, period, free, method)
    return *_from_word(system, start, multiple, period, free, method), ""


def _from_word(
    system: MechanicalSystem,
    start: Any,
    multiple: int | None,
    period: float,
    free: bool,
    method: SwitchedRK,
) -> tuple[Frame, Array, int]:
    """Read a word with rows ``(t, q, qdot)``, the states after its events, or with times only.

    Given times, the states that repeat are found from the equations without those of the events.
    """
    if not isinstance(start, tuple) or len(start) != 2:
        raise TypeError(
            "start must be a run, (t0, (q, qdot)), an orbit, or a word with rows, got "
            f"{type(start).__name__}"
        )
    letters, rows = start
    if isinstance(letters, str) or not isinstance(letters, Sequence):
        raise TypeError(f"start[0] must be a sequence of letters such as 'I stop', got {letters!r}")
    word = parsed(letters, system.gap_names)
    flow = flow_of(system, method)
    table = real_array("start[1]", rows)
    table = table[:, None] if table.ndim == 1 else table
    times_only = table.shape in ((len(word), 1), (len(word), 2)) and flow.n > 0
    if not times_only and table.shape != (len(word), 1 + 2 * flow.n):
        raise ValueError(
            f"start[1] must have {len(word)} rows (t, q, qdot) of {1 + 2 * flow.n} numbers, rows "
            f"(t, u), or times, got shape {table.shape}"
        )
    if not np.all(np.isfinite(table)):
        raise ValueError("start[1] must be finite")
    if np.any(np.diff(table[:, 0]) < 0.0):
        raise ValueError("start[1] must have its rows at increasing times")
    span = float(table[-1, 0] - table[0, 0])
    if free:
        raise ValueError("start must be a run or a state where the period is free")
    multiple = multiple or math.floor(span / period * (1.0 - 1e-9)) + 1
    length = multiple * period
    x = np.zeros((len(word), 2 * flow.n + 2))
    x[:, -1] = table[:, 0]
    x[:, 0] = np.roll(table[:, 0], 1)
    x[0, 0] -= length
    frame = Frame(system, flow, word, method, length, free, None, float(x[0, -1]))
    if times_only:
        return frame, _states(frame, x), multiple
    x[:, 1:-1] = np.roll(table[:, 1:], 1, axis=0)
    return frame, x, multiple


def _states(frame: Frame, x: Array) -> Array:
    """Find the states of a motion whose events are at given times, as near as they allow."""
    rows = np.arange(x.size).reshape(x.shape)
    states, kept = rows[:, 1:-1].ravel(), rows[:, 2:].ravel()
    y = x.ravel().copy()
    for _ in range(8):
        try:
            at = of_segments(frame, y, y.reshape(x.shape), frame.length)
            move = np.linalg.lstsq(at.matrix()[np.ix_(kept, states)], -at.residual[kept])[0]
        except (FlightError, ValueError, np.linalg.LinAlgError):
            break
        y[states] += move
        if np.max(np.abs(move)) < 1e-9 * max(1.0, float(np.max(np.abs(y)))):
            break
    return y.reshape(x.shape)


def _half(frame: Frame, x: Array, turn: Array) -> tuple[Frame, Array]:
    """Take the half of a word that is to be the image of the other half."""
    if len(frame.word) == 1 and frame.word[0].kind == "P":
        half = dataclasses.replace(frame, length=0.5 * frame.length, turn=turn)
        x = x.copy()
        x[0, 0] = x[0, -1] - half.length
        return half, x
    count = len(frame.word)
    if count % 2:
        raise ValueError("symmetry: the word has no two halves, it has an odd number of events")
    if not frame.free:
        gaps_turned(frame.flow, turn, 0.5 * frame.length)
    half = dataclasses.replace(
        frame, word=frame.word[: count // 2], length=0.5 * frame.length, turn=turn
    )
    return half, x[: count // 2].copy()


def _from_orbit(
    system: MechanicalSystem,
    start: MechanicalOrbit,
    multiple: int | None,
    period: float,
    free: bool,
    symmetry: Any,
    method: SwitchedRK,
    max_iter: int,
) -> MechanicalOrbit:
    """Solve the word of an orbit for another system, or over several of its periods."""
    own = start._frame
    times = 1 if multiple is None else multiple // start.multiple
    if own.turn is not None and times == 1:
        half = 0.5 * start.multiple * period if not free else own.length
        frame = Frame(
            system, flow_of(system, method), own.word, method, half, free, own.turn, own.section
        )
        return solve(frame, start._y, start.multiple, max_iter)
    if multiple is not None and (multiple % start.multiple or multiple < start.multiple):
        raise ValueError(
            f"multiple must be a multiple of that of the orbit, {start.multiple}, got {multiple}"
        )
    length = start.multiple * start.period
    x = np.column_stack([start._starts, start.segments["t1"]])
    parts = []
    for k in range(times):
        part = x.copy()
        part[:, [0, -1]] += k * length
        parts.append(part)
    word, whole_x = start._word * times, np.vstack(parts)
    total = own.split(start._y)[1] if free else times * start.multiple * period
    frame = Frame(system, flow_of(system, method), word, method, total, free, None, own.section)
    if symmetry is not None:
        frame, whole_x = _half(frame, whole_x, turn_of(symmetry, frame.flow.n))
    y = frame.joined(whole_x, frame.length)
    return solve(frame, y, times * start.multiple, max_iter)
