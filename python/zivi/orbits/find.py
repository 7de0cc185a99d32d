"""From a simulation or a guess to a periodic orbit, and whether it is a motion."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi.base.check import Array, integer
from zivi.base.habits import hinted
from zivi.derivatives.sensitivity import OrbitStatus
from zivi.orbits.flights import PRECISE, FlightError
from zivi.orbits.mechanical.equations import Terms, newton, row_sizes
from zivi.orbits.mechanical.family import period_of
from zivi.orbits.mechanical.find import canonical, least
from zivi.orbits.mechanical.margins import Margins
from zivi.orbits.mechanical.multipliers import multipliers_of
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.orbit import ORBIT_IMPACT, PeriodicOrbit
from zivi.orbits.sequence import Frame, as_rows, as_word
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import simulate
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import check_newton, excitation

__all__ = ["periodic_orbit"]

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
        from zivi.orbits.mechanical.start import mechanical_orbit

        return mechanical_orbit(system, start, multiple, period, symmetry, method, max_iter)
    from zivi.orbits.start import guess_of

    check_newton(system)
    if symmetry is not None:
        raise TypeError("symmetry is for a zivi.MechanicalSystem")
    if multiple is not None and integer("multiple", multiple) < 1:
        raise ValueError(f"multiple must be >= 1, got {multiple}")
    known = None if is_free(system, period, multiple) else period_of(system, period, or_free=True)
    if known is None:
        from zivi.orbits.free import free_guess

        guess = free_guess(system, start, method)
        # at rest any period is one
        rests = guess.rest is not None
        frame = Frame(1, 1.0 if rests else None, method, free=not rests)
    else:
        guess = guess_of(system, start, multiple, known, method)
        own = None if period is None else known
        frame = Frame(guess.multiple, own, method, guess.start)
    if guess.rest is not None:
        from zivi.orbits.rest import resting_orbit

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
    from zivi.orbits.free import is_autonomous

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


def solve(system: ImpactSystem, frame: Frame, y: Array, max_iter: int = 20) -> PeriodicOrbit:
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
    frame: Frame,
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


def checked(frame: Frame, terms: Terms, residual: float, iterations: int) -> PeriodicOrbit:
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


def _failed(system: ImpactSystem, frame: Frame, y: Array, message: str) -> PeriodicOrbit:
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
