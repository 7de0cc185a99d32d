"""Periodic orbits from a run, a state, an orbit or an event sequence."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi.base.check import Array, finite, integer, real, real_array
from zivi.base.habits import hinted
from zivi.base.status import Status
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.attractor import quiet
from zivi.orbits.branch import force_at_rest
from zivi.orbits.equations import (
    Frame,
    Terms,
    gaps_turned,
    multipliers_of,
    newton,
    of_segments,
    row_sizes,
    turn_of,
)
from zivi.orbits.flows import PRECISE, FlightError, fly, parsed
from zivi.orbits.orbit import (
    ORBIT_IMPACT,
    MassFrame,
    MechanicalOrbit,
    PeriodicOrbit,
    as_rows,
    as_word,
    unknowns_of,
)
from zivi.orbits.path import Margins, core_of, flow_of, frequency_of, period_of
from zivi.orbits.words import (
    MOST_MULTIPLE,
    TOLERANCES,
    NotDifferentiable,
    canonical,
    failed,
    least,
    recent,
    repeating,
    shown,
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

__all__ = [
    "Guess",
    "apex",
    "free_guess",
    "guess_of",
    "is_autonomous",
    "mechanical_orbit",
    "periodic_orbit",
]

# From what a user has, a run, a state, an orbit, an array, to a guess of an orbit.

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


# From what a user has, a run, a state, an orbit, a word, to an orbit of a mechanical system.

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


# Guesses of orbits of systems that nothing excites, whose period is an unknown.

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
    k = _free_repeats(impacts)
    last = impacts[-k - 1 :]
    return Guess(unknowns_of(last[:-1], last[-1, 0] - last[0, 0]), 1)


def _free_repeats(impacts: Array) -> int:
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


# From a simulation or a guess to a periodic orbit, and whether it is a motion.

WHY_NOT = {
    "grazing": "The impact at t = {t:.9g} s would leave the wall at {u:.3g} m/s < 0.",
    "rest_appears": "After the plastic impact at t = {t:.9g} s the force holds the mass at the "
    "wall.",
    "interior_impact": "The flight goes behind the wall, to {value:.3g} m at t = {t:.9g} s.",
}
"""What is there of no motion, the impacts first: one that dies hides what is behind the wall."""


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
    """Find a periodic orbit from what a simulation settled on, or from a guess.

    Unknowns are the times of the impacts and the speeds after them, so Newton's iteration looks for
    no events and is regular up to a grazing. A motion that rests needs no iteration: it starts
    at its lift-off, which the parameters alone determine, and one simulation is the orbit.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        A system with a periodic excitation, or one that nothing excites from outside.
    start : Trajectory, (t0, (x0, xdot0)), PeriodicOrbit or array_like
        A run, of which the end is taken; a state, from which some periods are simulated; an orbit
        (of a system near this one); or rows ``(t, u)`` of the impacts of one period. Of a
        `MechanicalSystem` a `MechanicalTrajectory`, ``(t0, (q, qdot))``, a `MechanicalOrbit`, or
        ``(word, rows)``: letters as in `MechanicalOrbit.word` with the times of their events, or
        with rows ``(t, q, qdot)`` of the states after them.
    multiple : int, optional
        After how many periods of the excitation the motion repeats; by default what `start` shows.
        An orbit that repeats earlier is given with its least period.
    period : float or "free", optional
        The period of the excitation (s), by default from a `LinearForce` or a `HarmonicWall`. Where
        nothing excites the system it is ``"free"``: an unknown, and times start at the first
        impact. A force that does not depend on the times at which it is evaluated is one of these.
    symmetry : array_like or callable, optional
        Of a `MechanicalSystem`: a linear map of the coordinates, shape (n, n), or of the states,
        that takes the second half of the motion to the first. Only that half is solved for.
    method : SwitchedRK
        Tolerances.
    max_iter : int
        Newton's steps, at most.

    Returns
    -------
    PeriodicOrbit or MechanicalOrbit
        Its ``status`` says whether it was found and whether it is a motion of the system.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range, or a system whose period is not known.

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
    if isinstance(system, MechanicalSystem):
        return mechanical_orbit(system, start, multiple, period, symmetry, method, max_iter)

    check_newton(system)
    if symmetry is not None:
        raise TypeError("symmetry is for a zivi.MechanicalSystem")
    if multiple is not None and integer("multiple", multiple) < 1:
        raise ValueError(f"multiple must be >= 1, got {multiple}")
    known = None if is_free(system, period, multiple) else period_of(system, period, or_free=True)
    if known is None:
        guess = free_guess(system, start, method)
        # at rest any period is one
        rests = guess.rest is not None
        frame = MassFrame(1, 1.0 if rests else None, method, free=not rests)
    else:
        guess = guess_of(system, start, multiple, known, method)
        own = None if period is None else known
        frame = MassFrame(guess.multiple, own, method, guess.start)
    if guess.rest is not None:
        from zivi.orbits.branch import resting_orbit

        orbit = resting_orbit(system, frame, guess.rest)
        # a run that goes on without this rest has left it for another motion
        back = guess.rest + orbit.multiple * orbit.period * (1.0 + 1e-6)
        if not len(guess.y) or (orbit.status is not OrbitStatus.NOT_CONVERGED and back > guess.end):
            return orbit
    orbit = solve(system, frame, guess.y, max_iter)
    if orbit.success or not guess.shown:
        return orbit
    return dataclasses.replace(orbit, message=f"{orbit.message} {guess.shown}")


def is_free(system: ImpactSystem, period: float | str | None, multiple: int | None) -> bool:
    """Whether the period is an unknown; a ValueError for what does not go with it."""
    if isinstance(period, str):
        if period != "free":
            raise ValueError(f"period must be a number of seconds or 'free', got {period!r}")
        if excitation(system)[0] is not None:
            raise ValueError("period cannot be 'free': the system is excited, and has its period")
    elif period is not None or not is_autonomous(system):
        return False
    if multiple not in (None, 1):
        raise ValueError(f"multiple counts periods of an excitation; there is none, got {multiple}")
    return True


def solve(system: ImpactSystem, frame: MassFrame, y: Array, max_iter: int = 20) -> PeriodicOrbit:
    """Solve for an orbit from a guess of its unknowns, and look whether it is a motion."""
    try:
        word, guess = as_word(system, frame, y)
        found = newton(word, guess, max_iter)
        steps = found.iterations
        word, multiple, found = least(word, frame.multiple, guess, found, max_iter)
    except FlightError as error:
        return _failed(system, frame, y, f"A flight could not be computed: {error}")
    terms, frame = found.terms, dataclasses.replace(frame, multiple=multiple)
    if not found.converged:
        message = (
            f"Newton's iteration did not converge in {steps} steps: the residual is "
            f"{found.residual:.3g}, the nearest grazing {depth_of(terms):.3g} m away."
        )
        status = OrbitStatus.NOT_CONVERGED
        return orbit_of(frame, terms, found.residual, steps, status, message)
    if not frame.free and y.ndim == 2:
        terms = canonical(terms, multiple)
    return checked(frame, terms, found.residual, steps)


def orbit_of(
    frame: MassFrame,
    terms: Terms,
    residual: float,
    iterations: int,
    status: OrbitStatus,
    message: str,
    multipliers: NDArray[np.complex128] | None = None,
) -> PeriodicOrbit:
    """Make the orbit that the equations describe."""
    y, word = as_rows(terms), terms.frame
    hits, free = y.ndim == 2, word.free
    period = terms.length / frame.multiple
    frame = dataclasses.replace(
        frame,
        period=None if frame.period is None else period,
        start=frame.start if hits or free else float(terms.x[0, 0]),
    )
    impacts = np.empty(len(y) if hits else 0, ORBIT_IMPACT)
    if hits:
        impacts["t"], impacts["u"] = frame.listed(y).T
        impacts["xdot_after"] = impacts["u"]
        impacts["xdot_before"] = np.roll(terms.rates, 1) if free else terms.rates
    if multipliers is None:
        multipliers = multipliers_of(terms)
    if not np.all(np.isfinite(multipliers)):
        multipliers = np.array([np.inf, 0.0], np.complex128)
    elif free:
        multipliers = np.append(multipliers, 1.0)
    return PeriodicOrbit(
        system=word.system,
        kind="impacting" if hits else "flight",
        period=period,
        multiple=frame.multiple,
        impacts=impacts,
        multipliers=multipliers,
        residual=residual,
        iterations=iterations,
        depth=depth_of(terms),
        admissible=status is OrbitStatus.COMPLETED,
        status=status,
        message=message,
        _frame=frame,
        _y=y,
    )


def depth_of(terms: Terms) -> float:
    """Give how high, or deep, the nearest grazing is (m); a force that presses hides none."""
    assert terms.flights.lows is not None
    lowest = float(np.min(np.abs(terms.flights.lows[:, 1])))
    if terms.frame.word[0].kind == "P":
        return lowest
    v, pull = terms.flights.z[:, 1], terms.flights.last[:, 1]
    pulled = pull > 0.0
    return min(lowest, float(np.min(v[pulled] ** 2 / (2.0 * pull[pulled]), initial=np.inf)))


def why_not(margins: Margins, rounding: float = 1e-11) -> str | None:
    """Say why unknowns that solve the equations are no motion; None if they may be one."""
    terms, lows = margins.terms, [it for it in margins.lows if it.value < 0.0]
    if not lows:
        return None
    # where the only impact grazes the speeds there are rounding
    sizes = {"grazing": float(row_sizes(terms)[2])}
    out = [it for it in lows if it.value < -rounding * sizes.get(it.kind, it.size)]
    for kind, why in WHY_NOT.items():
        if own := [it for it in out if it.kind == kind]:
            low = min(own, key=lambda it: it.value)
            u = float(terms.frame.flow.e[0]) * low.value
            return why.format(t=low.t, value=low.value, u=u)
    return None


def checked(frame: MassFrame, terms: Terms, residual: float, iterations: int) -> PeriodicOrbit:
    """Look whether an orbit is a motion: its signs, and one simulation of it."""
    done, left = OrbitStatus.COMPLETED, OrbitStatus.LEFT_ADMISSIBLE
    why = why_not(Margins(terms))
    message = why or "The orbit was found, and a simulation follows it."
    orbit = orbit_of(frame, terms, residual, iterations, left if why else done, message)
    why = None if why else _not_followed(orbit)
    if why is None:
        return orbit
    return dataclasses.replace(orbit, admissible=False, status=left, message=why)


def _not_followed(orbit: PeriodicOrbit) -> str | None:
    """Say where a simulation from the first impact leaves the orbit; None if it does not."""
    length, method = orbit.multiple * orbit.period, orbit._frame.method
    t, state = orbit._beginning()
    run = simulate(orbit.system, (t, t + length), state, method, dense_output=False)
    impacts, listed = run.resolved_impacts, orbit.impacts["t"][1:]
    # the impact that ends the period may lie on either side of its end
    seen = impacts[impacts["t"] < t + length * (1.0 - 1e-6)]
    if len(seen) != len(listed):
        return f"A simulation has {len(seen)} impacts within the period, the orbit {len(listed)}."
    growth = max(1.0, float(np.max(np.abs(orbit.multipliers))))
    near = 1e5 * method.rtol * growth
    if len(listed) and np.max(np.abs(seen["t"] - listed)) > near * length:
        return "A simulation has its impacts at other times than the orbit."
    return None


def _failed(system: ImpactSystem, frame: MassFrame, y: Array, message: str) -> PeriodicOrbit:
    impacts = np.empty(len(y) if y.ndim == 2 else 0, ORBIT_IMPACT)
    if y.ndim == 2:
        impacts["t"], impacts["u"] = frame.listed(y).T
        impacts["xdot_after"], impacts["xdot_before"] = y[:, 1], np.nan
    return PeriodicOrbit(
        system=system,
        kind="impacting" if y.ndim == 2 else "flight",
        period=frame.length(system, y) / frame.multiple,
        multiple=frame.multiple,
        impacts=impacts,
        multipliers=np.full(2, np.nan, np.complex128),
        residual=np.inf,
        iterations=0,
        depth=np.nan,
        admissible=False,
        status=OrbitStatus.NOT_CONVERGED,
        message=message,
        _frame=frame,
        _y=y,
    )
