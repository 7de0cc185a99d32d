"""Periodic orbits from a run, a state, an orbit or an event sequence."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, finite, integer, real, real_array
from zivi.base.habits import hinted
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.equations import Frame, gaps_turned, of_segments, turn_of
from zivi.orbits.flows import PRECISE, FlightError, MassFlow, parsed
from zivi.orbits.orbit import MechanicalOrbit, PeriodicOrbit, word_of_rows
from zivi.orbits.path import core_of, flow_of, frequency_of, period_of
from zivi.orbits.words import (
    MOST_MULTIPLE,
    NotDifferentiable,
    failed,
    recent,
    resting_orbit,
    solve_word,
)
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import pair, simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.gap import HarmonicWall
from zivi.system.mass import ImpactSystem, LinearForce
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import check_newton, check_smooth, excitation
from zivi.system.table import Table

SETTLING = 200
"""Periods that are simulated from a state when nothing says how the motion repeats."""

# From what a user has, a run, a state, an orbit, a word, to an orbit of a mechanical system.

LOOSE = SwitchedRK(rtol=1e-9, atol=1e-10)
"""Of runs that give a guess."""


def find_mechanical_orbit(
    system: MechanicalSystem,
    start: Any,
    multiple: int | None,
    period: float | str | None,
    symmetry: Array | Callable[[Array], Array] | None,
    method: SwitchedRK,
    max_iter: int,
) -> Any:
    """Find a periodic orbit of a mechanical system: `zivi.periodic_orbit` of one."""
    check_smooth(system)
    _refuse_laws(system)
    _refuse_tables(system)
    if multiple is not None and integer("multiple", multiple) < 1:
        raise ValueError(f"multiple must be >= 1, got {multiple}")
    length, free = _period(system, period)
    if free and multiple not in (None, 1):
        raise ValueError(f"multiple must be None for an autonomous system, got {multiple}")
    flow = flow_of(system, method)
    if isinstance(start, MechanicalOrbit):
        return _from_orbit(system, start, multiple, length, free, symmetry, method, max_iter)
    try:
        frame, x, multiple, told = _guess(system, start, multiple, length, free, method)
    except NotDifferentiable as it:
        y, status = it.frame.joined(it.x, it.frame.length), OrbitStatus.NOT_DIFFERENTIABLE
        lost: MechanicalOrbit = failed(it.frame, y, it.count, str(it), status)
        return lost
    if symmetry is not None:
        frame, x = _half(frame, x, turn_of(symmetry, flow.n))
    orbit = solve_word(frame, frame.joined(x, frame.length), multiple, max_iter)
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
        raise ValueError(
            "periodic orbits of systems with a zivi.Table are not supported; use zivi.Harmonic "
            "loads"
        )


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
            "period must be given: the excitation of the system does not have a single known "
            "period; give period=..., or period='free' for an autonomous system"
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
    """Return frame, unknowns and multiple, with a run's description if one was given."""
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
    """Read an event sequence with times or with rows ``(t, q, qdot)`` after the events.

    Given times, the states that repeat are found from the equations without those of the events.
    """
    if not isinstance(start, tuple) or len(start) != 2:
        raise TypeError(
            "start must be a run, (t0, (q, qdot)), an orbit, or a word with rows, got "
            f"{type(start).__name__}"
        )
    letters, rows = start
    if np.ndim(letters) == 1 and np.size(letters) and not isinstance(letters[0], str):
        raise TypeError(f"start must be (t0, (q, qdot)) for a state, got two arrays: {start!r}")
    if isinstance(letters, str) or not isinstance(letters, Sequence):
        raise TypeError(f"start[0] must be an event sequence such as 'I stop', got {letters!r}")
    flow = flow_of(system, method)
    if flow.channels:
        raise ValueError(
            "start must be a run, a state or an orbit for a system with dry friction, got a word"
        )
    word = parsed(letters, system.gap_names)
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
    """Return the first half of an event sequence, whose image is the second half."""
    if frame.flow.channels:
        raise ValueError("symmetry must be None for a system with dry friction")
    if len(frame.word) == 1 and frame.word[0].kind == "P":
        half = dataclasses.replace(frame, length=0.5 * frame.length, turn=turn)
        x = x.copy()
        x[0, 0] = x[0, -1] - half.length
        return half, x
    count = len(frame.word)
    if count % 2:
        raise ValueError(
            "symmetry: the event sequence has an odd number of events and cannot be split into "
            "halves"
        )
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
) -> Any:
    """Solve the word of an orbit for another system, or over several of its periods."""
    own = start._frame
    times = 1 if multiple is None else multiple // start.multiple
    if own.turn is not None and times == 1:
        half = 0.5 * start.multiple * period if not free else own.length
        frame = Frame(
            system, flow_of(system, method), own.word, method, half, free, own.turn, own.section
        )
        return solve_word(frame, start._y, start.multiple, max_iter)
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
    return solve_word(frame, y, times * start.multiple, max_iter)


# From what a user has, a run, a state, an orbit, an array, to an orbit of one mass.

SPANS = (10.0, 100.0, 1e3, 1e4)
"""Durations of a run from a state, until it shows how it repeats where nothing excites it (s)."""
ENOUGH_IMPACTS = 60
"""Impacts that show it."""
FORCE_TIMES = (0.0, 0.173, 0.71, 1.9, 3.3, 7.1, 19.7, 53.9)
"""Times at which a force is evaluated to see whether it depends on them (s)."""


def find_mass_orbit(
    system: ImpactSystem,
    start: Any,
    multiple: int | None,
    period: float | str | None,
    method: SwitchedRK,
    max_iter: int,
) -> Any:
    """Find a periodic orbit of one mass: `zivi.periodic_orbit` of one."""
    check_newton(system)
    if multiple is not None and integer("multiple", multiple) < 1:
        raise ValueError(f"multiple must be >= 1, got {multiple}")
    free = is_free(system, period, multiple)
    length = math.nan if free else period_of(system, period, or_free=True)
    if isinstance(start, Trajectory):
        return _of_run(system, start, multiple, length, method, max_iter)
    if isinstance(start, tuple) and len(start) == 2 and np.ndim(start[0]) == 0:
        t0, state = real("start[0]", start[0]), pair("start[1]", start[1], "(x0, xdot0)")
        for span in SPANS if free else ((multiple or SETTLING) * length,):
            run = simulate(system, (t0, t0 + span), state, method)
            if (
                len(run.resolved_impacts) >= ENOUGH_IMPACTS
                or run.rest_time is not None
                or not run.success
            ):
                break
        return _of_run(system, run, multiple, length, method, max_iter)
    if isinstance(start, PeriodicOrbit):
        if start.kind == "resting":
            return _resting_again(system, start, 1.0 if free else length, method)
        multiple, own = multiple or start.multiple, start._frame
        total = own.split(start._y)[1] if free else multiple * length
        section = own.section if free else float(own.split(start._y)[0][0, 0]) + total
        frame = Frame(system, flow_of(system, method), own.word, method, total, free, None, section)
        return solve_word(frame, start._y, multiple, max_iter)
    rows = rows_of(start)
    total = float(rows[-1, 0] - rows[0, 0])
    multiple = 1 if free else multiple or math.floor(total / length * (1.0 - 1e-9)) + 1
    total = total + _flight(system, rows[-1, 1]) if free else multiple * length
    word = word_of_rows(system, method, rows, total, free=free)
    return solve_word(*word, multiple, max_iter)


def _resting_again(
    system: ImpactSystem, start: PeriodicOrbit, period: float, method: SwitchedRK
) -> PeriodicOrbit:
    """Begin in the middle of a rest."""
    phase = (start.liftoff_time or 0.0) - 0.5 * min(start.margin or period, period)
    return resting_orbit(system, method, period, phase)


def _of_run(
    system: ImpactSystem,
    run: Trajectory,
    multiple: int | None,
    period: float,
    method: SwitchedRK,
    max_iter: int,
    *,
    further: bool = True,
) -> Any:
    """Find what the end of a run shows; where it has no impacts, what a further run shows."""
    end, free = float(run.t[-1]), math.isnan(period)
    rests, zenos = run.rest_time is not None, run.zeno_times
    if rests or (not free and len(zenos) and zenos[-1] > end - MOST_MULTIPLE * period):
        rest = end if rests else float(zenos[-1])
        orbit = resting_orbit(system, method, 1.0 if free else period, rest)
        # a run that goes on without this rest has left it for another motion
        back = rest + orbit.multiple * orbit.period * (1.0 + 1e-6)
        if rests or (orbit.status is not OrbitStatus.NOT_CONVERGED and back > end):
            return orbit
    late = run.resolved_impacts["t"] > end - 4.0 * period
    kept = run._path is not None and getattr(run._path, "dense", True)
    if further and not (kept and (free or multiple or late.any())):
        span = 2 * MOST_MULTIPLE * period if kept else end - float(run.t[0])
        state = float(run.x[-1]), float(run.xdot[-1])
        run = simulate(system, (end, end + span), state, method)
        return _of_run(system, run, multiple, period, method, max_iter, further=False)
    frame, x, count, told = recent(system, run, multiple, period, free, method)
    orbit = solve_word(frame, frame.joined(x, frame.length), count, max_iter)
    if orbit.success or not told:
        return orbit
    return dataclasses.replace(orbit, message=f"{orbit.message} {told}")


def rows_of(start: ArrayLike) -> Array:
    """Return the impacts of an array as rows ``(t, u)``."""
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


def is_autonomous(system: ImpactSystem) -> bool:
    """Whether nothing excites a system: a force of the state alone, as far as looks can tell."""
    force, wall = system.force, system.wall
    if isinstance(force, int | float) or excitation(system)[0] is not None:
        return False
    if wall is not None and not (isinstance(wall, HarmonicWall) and wall.amplitude == 0.0):
        return False
    if isinstance(force, LinearForce):
        return force.amplitude == 0.0
    times, still = np.array(FORCE_TIMES), np.zeros((len(FORCE_TIMES), 2))
    return bool(np.ptp(MassFlow(system, PRECISE).reactions((0,), times, still)) == 0.0)


def is_free(system: ImpactSystem, period: float | str | None, multiple: int | None) -> bool:
    """Whether the period is an unknown; a ValueError for conflicting arguments."""
    if isinstance(period, str):
        if period != "free":
            raise ValueError(f"period must be a number of seconds or 'free', got {period!r}")
        if excitation(system)[0] is not None:
            raise ValueError("period cannot be 'free': the system is excited, and has its period")
    elif period is not None or not is_autonomous(system):
        return False
    if multiple not in (None, 1):
        raise ValueError(f"multiple must be None for an autonomous system, got {multiple}")
    return True


def _flight(system: ImpactSystem, speed: float) -> float:
    """Return the duration of a flight from the wall."""
    for span in SPANS:
        run = simulate(system, (0.0, span), (0.0, abs(speed)), dense_output=False)
        if len(run.resolved_impacts):
            return float(run.resolved_impacts["t"][0])
    raise ValueError(f"start: no impact follows the last one within {SPANS[-1]:g} s")


# From a simulation or a guess to a periodic orbit, and whether it is a motion.


@overload
def periodic_orbit(
    system: MechanicalSystem,
    start: Any,
    multiple: int | None = None,
    *,
    period: float | Literal["free"] | None = None,
    symmetry: ArrayLike | Callable[[Array], Array] | None = None,
    method: SwitchedRK = PRECISE,
    max_iter: int = 20,
) -> MechanicalOrbit: ...


@overload
def periodic_orbit(
    system: ImpactSystem,
    start: Any,
    multiple: int | None = None,
    *,
    period: float | Literal["free"] | None = None,
    symmetry: None = None,
    method: SwitchedRK = PRECISE,
    max_iter: int = 20,
) -> PeriodicOrbit: ...


@hinted("periodic_orbit")
def periodic_orbit(
    system: ImpactSystem | MechanicalSystem,
    start: Any,
    multiple: int | None = None,
    *,
    period: float | Literal["free"] | None = None,
    symmetry: Any = None,
    method: SwitchedRK = PRECISE,
    max_iter: int = 20,
) -> PeriodicOrbit | MechanicalOrbit:
    """Find a periodic orbit from the attractor of a simulation or from a guess.

    Unknowns are the times of the impacts and the speeds after them, so Newton's iteration needs no
    event location and is regular up to a grazing. A motion that rests needs no iteration: it starts
    at its lift-off, which the parameters alone determine, and one simulation is the orbit.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        A system with a periodic excitation, or one that nothing excites from outside.
    start : Trajectory, (t0, (x0, xdot0)), PeriodicOrbit or array_like
        A run, of which the end is taken; a state, from which some periods are simulated; an orbit
        (of a system near this one); or rows ``(t, u)`` of the impacts of one period. For a
        `MechanicalSystem`: a `MechanicalTrajectory`, ``(t0, (q, qdot))``, a `MechanicalOrbit`, or
        ``(word, rows)``: event symbols (see `MechanicalOrbit.word`) with the event times, or with
        rows ``(t, q, qdot)`` of the states after the events.
    multiple : int, optional
        After how many periods of the excitation the motion repeats; by default what `start` shows.
        An orbit that repeats earlier is given with its least period.
    period : float or "free", optional
        The period of the excitation (s), by default from a `LinearForce` or a `HarmonicWall`. Where
        nothing excites the system it is ``"free"``: an unknown, and times start at the first
        impact. A force that does not depend on the times at which it is evaluated is one of these.
    symmetry : array_like or callable, optional
        For a `MechanicalSystem`: a linear map of the coordinates, shape (n, n), or of the states,
        that maps the second half of the motion to the first. Only that half is solved for.
    method : SwitchedRK
        Tolerances.
    max_iter : int
        Newton's steps, at most.

    Returns
    -------
    PeriodicOrbit or MechanicalOrbit
        See its ``status`` for convergence and admissibility.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range, or a system whose period is not known.

    See Also
    --------
    continue_orbit : continue an orbit in a parameter.
    bifurcation_diagram : attractors over a parameter, by simulation.
    lyapunov_exponents : exponents of motions that are not periodic.

    Notes
    -----
    The unknowns are event times and states; Newton iteration solves the periodicity conditions, and
    the Floquet multipliers are eigenvalues of the derivative over a period. A simulation over one
    period verifies admissibility. The page "Sensitivities and orbits: theory" (orbit_theory.md) has
    the equations.

    References
    ----------
    R. I. Leine and H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems,
    Springer, 2004.

    J. M. Luck and A. Mehta, Bouncing ball with a finite restitution: chattering, locking, and
    chaos, Phys. Rev. E 48, 1993.

    Examples
    --------
    >>> table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    >>> ball = zivi.ImpactSystem(table, e=0.5)
    >>> orbit = zivi.periodic_orbit(ball, [(0.6, 2.1)])
    >>> orbit.kind, orbit.stable
    ('impacting', True)
    >>> abs(orbit.multipliers).round(9)  # complex, of the modulus e
    array([0.5, 0.5])
    """
    if not isinstance(method, SwitchedRK):
        raise TypeError(f"method must be a zivi.SwitchedRK, got {method!r}")
    if integer("max_iter", max_iter) < 1:
        raise ValueError(f"max_iter must be >= 1, got {max_iter}")
    if symmetry is not None and not isinstance(system, MechanicalSystem):
        raise TypeError("symmetry is for a zivi.MechanicalSystem")
    orbit: PeriodicOrbit | MechanicalOrbit = (
        find_mechanical_orbit(system, start, multiple, period, symmetry, method, max_iter)
        if isinstance(system, MechanicalSystem)
        else find_mass_orbit(system, start, multiple, period, method, max_iter)
    )
    return orbit
