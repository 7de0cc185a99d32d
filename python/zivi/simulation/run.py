"""`simulate`: one run of a system."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, Never, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import real, real_array
from zivi.base.extras import ProgressBar, is_shown
from zivi.base.habits import hinted, keyword_hint
from zivi.base.machine_code import CallbackErrors, listening, listening_always
from zivi.base.status import Status, warn
from zivi.simulation.events import MECHANICAL, SLOWEST, check_slowest, events_of
from zivi.simulation.mechanical_run import (
    RunRequest,
    check_mechanical_method,
    run_mechanical,
    state_of,
    stops_with,
    with_kicks,
)
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.method_settings import FixedSteps, Method, Settings
from zivi.simulation.methods import METHODS, SwitchedRK
from zivi.simulation.run_result import as_raised, count_of_kicks, with_partial
from zivi.simulation.trajectory import NO_STOPS, Trajectory, end_run_at_event, restrict_run
from zivi.system.gap import LinearGap
from zivi.system.kicks import Kick, KickSchedule, kicks_table, schedule_of
from zivi.system.mass import WRAPPED, ImpactSystem, LinearForce, check_system
from zivi.system.mechanism import MechanicalSystem, as_mechanism

# Arguments in the wrong place: errors that name the right one, above all to users of SciPy.

BY_NAME = {
    "DOP853": "zivi.SwitchedRK(), of order 8",
    "RK45": "zivi.SwitchedRK(order=5)",
    "RK23": "zivi.SwitchedRK(order=5)",
}
"""SciPy's explicit methods, and what is nearest to them here."""

ELSEWHERE = {
    "args": "give the force its parameters yourself, e.g. by functools.partial",
    "jac": "no method of zivi needs the derivative of the force",
    "vectorized": "a force is a function of numbers; see zivi.simulate_batch for many runs",
    "fun": f"the force is part of the system, {WRAPPED}",
    "e": "it belongs to the system, zivi.ImpactSystem(force, e=...)",
    "kappa": "it belongs to the system, zivi.ImpactSystem(force, kappa=...)",
    "wall": "it belongs to the system, zivi.ImpactSystem(force, e=..., wall=...)",
}
"""Where an argument of `solve_ivp`, or of a system, belongs."""


def refuse(function: str, misplaced: Mapping[str, Any], known: Iterable[str]) -> None:
    """Raise a TypeError for unknown arguments of a function, with the place where they belong."""
    known = tuple(it for it in known if it != "misplaced")
    for name, value in misplaced.items():
        owner = next((kind for kind in METHODS.values() if name in _settings(kind)), None)
        if owner is not None:
            call = f"{function}(..., method=zivi.{owner.__name__}({name}={value!r}))"
            advice = f": it is a setting of the method, {call}"
        else:
            advice = keyword_hint(function, name) or keyword_hint("simulate", name, known)
            advice = f": {ELSEWHERE[name]}" if name in ELSEWHERE else advice
        raise TypeError(f"{function}() got an unexpected keyword argument {name!r}{advice}")


def _settings(kind: type[Any]) -> set[str]:
    return {field.name for field in dataclasses.fields(kind)}


def check_method(method: Any) -> None:
    """Reject what is no method with its settings."""
    if isinstance(method, Settings) or (not isinstance(method, type) and hasattr(method, "_core")):
        return
    example = "e.g. zivi.SwitchedRK(rtol=1e-6) or zivi.ThetaGamma(h=1e-3)"
    raise TypeError(f"method must be one of zivi's methods, {example}, got {argument_text(method)}")


def argument_text(method: Any) -> str:
    """Describe the value given for a method, with a suggestion."""
    if isinstance(method, type):
        name = f"{method.__module__.partition('.')[0]}.{method.__name__}"
        if not issubclass(method, Settings):
            return f"the class {name}" + _nearest(method.__name__)
        return f"the class {name}: call it, {_method_call(method)}"
    if isinstance(method, str):
        return repr(method) + _nearest(method)
    return repr(method)


def _method_call(kind: type[Settings]) -> str:
    return f"zivi.{kind.__name__}({'h=1e-3' if issubclass(kind, FixedSteps) else ''})"


def _nearest(name: str) -> str:
    """Return the zivi method closest to a method of SciPy."""
    own = next((kind for it, kind in METHODS.items() if it.lower() == name.lower()), None)
    if own is not None:
        return f": the object is meant, {_method_call(own)}"
    nearest = BY_NAME.get(name.upper(), "zivi.SwitchedRK()")
    return f": the high-order method here is {nearest}"


# Warnings for constant forces that accelerate a mass away from its wall without return.


def warn_of_flight(system: ImpactSystem, sol: Trajectory) -> None:
    """Warn of a mass that flies from its wall at the end, and that nothing brings back."""
    pull = _outward(system)
    if pull > 0.0 and sol.status is Status.COMPLETED and sol.xdot[-1] > 0.0:
        warn(
            f"force takes the mass away from its wall for ever, a constant {pull:.6g} m/s^2; write "
            "a negative number, as in zivi.ImpactSystem(-9.81, e=0.5), or a positive gravity of a "
            "zivi.LinearForce, if it shall come back"
        )


def warn_of_flight_from_gap(system: MechanicalSystem, sol: MechanicalTrajectory) -> None:
    """Warn likewise for a mechanical system with one gap at rest and constant forces."""
    own = vars(system)
    mass, force, gaps = own.get("_mass"), own.get("_force"), own.get("_gaps", ())
    if not (isinstance(mass, np.ndarray) and isinstance(force, np.ndarray) and len(gaps) == 1):
        return
    gap = gaps[0]
    still = isinstance(gap, LinearGap) and gap.motion is None
    if not still or system.channel_names or system._inputs is not None:
        return
    if sol.status is not Status.COMPLETED or not gap.normal @ sol.qdot[-1] > 0.0:
        return
    pull = gap.normal @ np.linalg.solve(mass, force)
    if pull > 0.0:
        warn(
            f"force opens the gap {system.gap_names[0]} for ever, with a constant {pull:.6g}; "
            "write the opposite sign if it shall close again"
        )


def _outward(system: ImpactSystem) -> float:
    """Return a constant acceleration; 0 if it varies."""
    force = system.force
    if system.wall is not None:
        return 0.0
    if isinstance(force, int | float):
        return float(force)
    if type(force) is LinearForce and force.gravity < 0.0 and force.excitation is None:
        varies = force.stiffness or force.damping or force.amplitude
        return 0.0 if varies else -force.gravity
    return 0.0


# Who drives: one call from a system, a span and a state to a trajectory.

DEFAULT_METHOD = SwitchedRK()
THE_MOTION, THE_STEPS = _zivi.RecordOptions(dense=True), _zivi.RecordOptions(dense=False)
"""What most runs keep, made once."""

Event: TypeAlias = Callable[..., float]
"""``g(t, x, xdot)`` or ``g(t, y)``, with attributes ``terminal`` and ``direction``."""


@overload
def simulate(
    system: MechanicalSystem,
    t_span: Sequence[float],
    y0: Any,
    method: Method = ...,
    t_eval: ArrayLike | None = ...,
    *,
    events: Event | Sequence[Event] | None = ...,
    dense_output: bool = ...,
    progress: bool | None = ...,
    tstops: ArrayLike | None = ...,
    kicks: Kick | Sequence[Kick] | None = ...,
    samples: Literal["motion", "steps"] = ...,
    slowest: float = ...,
    **misplaced: Never,
) -> MechanicalTrajectory: ...


@overload
def simulate(
    system: ImpactSystem,
    t_span: Sequence[float],
    y0: ArrayLike,
    method: Method = ...,
    t_eval: ArrayLike | None = ...,
    *,
    events: Event | Sequence[Event] | None = ...,
    dense_output: bool = ...,
    progress: bool | None = ...,
    tstops: ArrayLike | None = ...,
    kicks: Kick | Sequence[Kick] | None = ...,
    samples: Literal["motion", "steps"] = ...,
    slowest: float = ...,
    **misplaced: Never,
) -> Trajectory: ...


@hinted("simulate")
def simulate(
    system: ImpactSystem | MechanicalSystem,
    t_span: Sequence[float],
    y0: ArrayLike,
    method: Method = DEFAULT_METHOD,
    t_eval: ArrayLike | None = None,
    *,
    events: Event | Sequence[Event] | None = None,
    dense_output: bool = True,
    progress: bool | None = None,
    tstops: ArrayLike | None = None,
    kicks: Kick | Sequence[Kick] | None = None,
    samples: Literal["motion", "steps"] = "motion",
    slowest: float = SLOWEST,
    **misplaced: Never,
) -> Trajectory | MechanicalTrajectory:
    r"""Simulate a system with impacts.

    .. math:: \ddot x = f(t, x, \dot x), \quad x \ge 0, \quad \dot x^+ = -e\,\dot x^-

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        The force and the wall; or mass, force and gaps of several coordinates.
    t_span : (float, float)
        Start and end (s), ``t0 < t1``.
    y0 : (float, float) or (array_like, array_like)
        Initial distance from the wall, >= 0 (m), and velocity (m/s). A velocity into the wall
        at ``x = 0`` is an impact at ``t0``. For a `MechanicalSystem`, a pair ``(q0, qdot0)`` of
        coordinates and velocities, each of shape (n,).
    method : SwitchedRK, ThetaGamma, MoreauJean or ExplicitEuler
        The method with its settings; by default `SwitchedRK` with error control. For
        a `MechanicalSystem` use `SwitchedRK`, or first-order methods for cross-checks: `MoreauJean`
        and, for M-orthogonal gaps, `ThetaGamma`.
    t_eval : array_like, optional
        Increasing times in `t_span` to report instead of all steps (s). With a method of fixed
        steps `s` and `v` are linear between them; the values of the signs and the residual are
        those of the step that contains the time.
    events : callable or sequence of callables, optional
        Functions ``g(t, x, xdot)`` or ``g(t, y)`` (SciPy's signature); for a `MechanicalSystem`
        ``g(t, q, qdot)`` with arrays. Their sign changes are located: see ``t_events`` and
        ``y_events`` of the result. Attributes as in SciPy: ``terminal`` (a bool, or the number of
        the event that ends the run) and ``direction`` (1 only rising, -1 only falling, 0 both). A
        velocity that changes its sign in an impact is an event at the impact, with the state after
        it; ``g = x`` is one with the state before it. A zero at the start is no event. The function
        is evaluated a few times per step and at least 200 times over the span: two closer sign
        changes may be missed unless ``max_step`` is short. For a `Level` none is missed. A method
        of fixed steps evaluates it at the end of each step and at the wall; it computes no step
        after that of a terminal event, and ``nfev`` counts the evaluations of the steps so far.
    dense_output : bool
        Whether the motion between the samples is kept, ``sol(t)``. Without it a run of
        `SwitchedRK` takes less memory and fewer evaluations.
    progress : bool, optional
        Show a progress bar on standard error once a run lasts longer than a second. By default
        only on a terminal.
    tstops : array_like, optional
        With `SwitchedRK`: times where the force, or one of its derivatives, jumps (s), such as
        the switching times of a held input; those outside of `t_span` have no effect. Steps end
        there, the force is evaluated on either side of them, by a few roundings, and never across,
        and nothing that was seen before is used after: the way to make short pulses seen and
        jumps cheap.
    kicks : Kick or sequence of Kick, optional
        With `SwitchedRK`: impulses at given times, which change the velocities instantaneously. A
        velocity into a closed gap is an impact at the same time. The result lists them in
        ``kicks``.
    samples : {"motion", "steps"}
        What `SwitchedRK` samples without `t_eval`. ``"motion"``: the ends of steps, the states
        before and after each impact, apexes, and enough points between them that straight lines
        draw the motion. The error is about 0.5 %, and less than 1 %, of the height of a flight or
        of a twentieth of the highest; an accumulation is drawn with at most 64 flights, down to 0.1
        % of the highest. ``"steps"``: the ends of steps and the states after impacts only, as
        without `dense_output`.
    slowest : float
        The slowest impacts that are listed in ``impacts``, as a part of the fastest one, > 0: also
        those that a Zeno extrapolation skips.
    **misplaced
        Not accepted: a `TypeError` names the place of settings of a method, such as ``rtol``, and
        of arguments of SciPy's `solve_ivp`.

    Returns
    -------
    Trajectory or MechanicalTrajectory
        A `MechanicalTrajectory` for a `MechanicalSystem` or a mass with friction. Always valid
        up to its last sample. If the run ended early, ``success`` is False; see ``status`` and
        ``message``.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range, before anything is computed.
    Exception
        Whatever the force raises, and `KeyboardInterrupt`: with the part of the run that was
        computed as the exception's attribute ``trajectory``.

    See Also
    --------
    simulate_batch : many runs on all cores.
    simulate_closed_loop : a run with a sampled controller.
    sensitivity : a run with derivatives.
    scipy.integrate.solve_ivp : smooth systems without impacts.

    Notes
    -----
    With `SwitchedRK`, the default, impacts are located on the dense output of an embedded
    Runge-Kutta pair (or, for linear forces, of power series), the Zeno time of an accumulation is
    extrapolated, and rest and contact are integrated on the constraint. The cost is proportional to
    the number of steps and impacts: about 20 force evaluations per flight, none for linear forces.

    References
    ----------
    E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, 2nd ed.,
    Springer, 1993.

    V. Ph. Zhuravlev, A method for analysing vibration-impact systems by means of special functions,
    Mechanics of Solids 11, 1976.

    B. Brogliato, Nonsmooth Mechanics, 3rd ed., Springer, 2016.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> sol = zivi.simulate(ball, (0, 3), (1, 0), events=lambda t, x, xdot: xdot)
    >>> round(sol.rest_time, 6)  # the Zeno point
    1.354571
    >>> round(float(sol.y_events[0][1, 0]), 9)  # the first apex after an impact, e^2 high
    0.25
    """
    if misplaced:
        refuse("simulate", misplaced, inspect.signature(simulate).parameters)
    if isinstance(system, ImpactSystem) and system.friction is not None:
        system = as_mechanism(system)
    if isinstance(system, MechanicalSystem):
        return _mechanical(
            system,
            t_span,
            y0,
            method,
            t_eval,
            events,
            dense_output,
            progress,
            tstops,
            samples,
            check_slowest(slowest),
            kicks,
        )
    check_system(system)
    check_method(method)
    _check_switches(samples, dense_output)
    slowest = check_slowest(slowest)
    span = pair("t_span", t_span, "(t0, t1)")
    state = pair("y0", y0, "(x0, xdot0)")
    times = None if t_eval is None else times_within(t_eval, span)
    stops = stop_times(tstops, method, system, span)
    watched = events_of(events)
    kicked = schedule_of(kicks, system, None, span) if kicks is not None else None
    start = state
    if kicked is not None:
        stops = stops_with(kicked, stops, method)
        start = (state[0], kicked.start(span[0], *state))
    if times is None and stops is NO_STOPS and not watched:
        keep = THE_MOTION if dense_output else THE_STEPS
    else:
        keep = _zivi.RecordOptions(
            t_eval=times, tstops=stops, kicks=kicked, events=watched, dense=dense_output
        )
    run = (system._core, method._core, span, _zivi.State(*start), keep)
    ear: CallbackErrors | None = None
    if is_shown(progress) or system._calls_functions:
        with ProgressBar(progress) as bar, listening([system._spec, system._impact]) as ear:
            record = _zivi.simulate(*run, bar.report)
    else:  # as most are: nobody looks on, and nothing can be heard
        record = _zivi.simulate(*run)
    drawn = samples == "motion" and times is None
    sol = Trajectory._from_record(record, system, method, span, state, stops, drawn=drawn)
    if kicked is not None:
        note_kicks(sol, kicked, kicks)
        if drawn and dense_output:
            end = sol.t[-1]
            sol._sample_kicks(np.array([t for t, *_ in kicked.rows if span[0] < t < end]))
    if slowest != SLOWEST:
        vars(sol)["slowest"] = slowest
    error = record.raised
    if error is None and ear is not None and (error := ear.ends(sol.success)):
        sol = as_raised(sol)
    if record.path is None:  # a method of fixed steps: its steps are all there is
        if sol.status is Status.TERMINATED_BY_EVENT:
            sol = end_run_at_event(sol)
        if times is not None:
            sol = restrict_run(sol, times)
    if error is None:
        warn_of_flight(system, sol)
        return sol
    try:
        raise with_partial(error, sol)
    finally:
        del error, ear


def _mechanical(
    system: MechanicalSystem,
    t_span: Sequence[float],
    y0: Any,
    method: Any,
    t_eval: ArrayLike | None,
    events: Any,
    dense_output: bool,
    progress: bool | None,
    tstops: ArrayLike | None,
    samples: str,
    slowest: float,
    kicks: Any,
) -> MechanicalTrajectory:
    """Run a system of several coordinates and gaps."""
    check_mechanical_method(method)
    _check_switches(samples, dense_output)
    span = pair("t_span", t_span, "(t0, t1)")
    q, qdot = state_of(system._start_of(y0), system._n)
    times = None if t_eval is None else times_within(t_eval, span)
    stops = stop_times(tstops, method, system, span)
    asked = RunRequest(span, q, qdot, times, stops, events_of(events, MECHANICAL), dense_output)
    asked = with_kicks(asked, kicks, system, method)
    with ProgressBar(progress) as bar, listening_always() as ear:
        sol, error = run_mechanical(system, method, asked, bar.report)
    if asked.kicks is not None:
        note_kicks(sol, asked.kicks, kicks)
    vars(sol)["slowest"] = slowest
    if error is None and (error := ear.ends(sol.success)):
        sol = as_raised(sol)
    if error is None:
        warn_of_flight_from_gap(system, sol)
        return sol
    try:
        raise with_partial(error, sol)
    finally:
        del error, ear


def note_kicks(sol: Trajectory | MechanicalTrajectory, kicked: KickSchedule, given: Any) -> None:
    """Attach the table of kicks to a result."""
    own = vars(sol)
    # state before the initial kick, which the tighter run repeats
    closer: Any = sol._closer
    own["_closer"] = None if closer is None else functools.partial(closer, kicks=given)
    own["_kicks"] = kicks_table(kicked.rows, kicked.n)
    own["message"] = f"{sol.message} {count_of_kicks(len(kicked.rows))}."


def _check_switches(samples: Any, dense_output: Any) -> None:
    if samples not in ("motion", "steps"):
        raise ValueError(f"samples must be 'motion' or 'steps', got {samples!r}")
    if not isinstance(dense_output, bool):
        raise TypeError(f"dense_output must be True or False, got {dense_output!r}")


def pair(name: str, value: Any, form: str) -> tuple[float, float]:
    """Return `value` as two floats; an error names it and its form."""
    try:
        first, second = value
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be two numbers {form}, got {value!r}") from None
    if type(first) is type(second) is float:
        return first, second
    return real(name, first), real(name, second)


def stop_times(
    tstops: ArrayLike | None,
    method: Method,
    system: ImpactSystem | MechanicalSystem,
    span: tuple[float, float],
) -> np.ndarray:
    """Return the declared breaks of the force and the knots of tables, increasing."""
    knots = system._breaks(span)
    if tstops is None:
        return knots if len(knots) and getattr(method, "_takes_tstops", False) else NO_STOPS
    if not getattr(method, "_takes_tstops", False):
        raise ValueError(
            f"tstops is not supported by {type(method).__name__}; use zivi.SwitchedRK, or choose "
            "h such that steps end at the breaks of the force"
        )
    stops = real_array("tstops", tstops)
    if stops.ndim != 1:
        raise ValueError(f"tstops must be one-dimensional, got shape {stops.shape}")
    if not np.all(np.isfinite(stops)):
        raise ValueError("tstops must be finite times")
    return np.unique(np.concatenate([stops, knots]))


def times_within(t_eval: ArrayLike, span: tuple[float, float]) -> np.ndarray:
    """Return increasing times within a span."""
    times = real_array("t_eval", t_eval)
    if times.ndim != 1:
        got = f"shape {times.shape}" if times.ndim else f"the number {times:.6g}"
        advice = "" if times.ndim else "; write t_eval=numpy.linspace(t0, t1, n)"
        raise ValueError(f"t_eval must be one-dimensional, got {got}{advice}")
    inside = not len(times) or span[0] <= times[0] <= times[-1] <= span[1]
    if not (inside and (times[1:] >= times[:-1]).all()):
        raise ValueError(f"t_eval must be increasing and within t_span = {span}")
    return times
