r"""The least period of an orbit.

An orbit of a period `T` solves the equations of every multiple of it too. Near a period doubling,
where a multiplier is -1, those of :math:`2T` are nearly singular: with the half difference `a` of
the two halves they are

.. math:: a (c\,\delta - a^2) = 0

at a distance :math:`\delta` from the doubling, so that a residual `r` leaves an `a` of up to
:math:`r^{1/3}`. Newton's steps on to rounding tell a doubled orbit, which keeps its `a`, from a
single one that is written twice.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from zivi.base.check import Array
from zivi.orbits.flights import PRECISE, FlightError, Legs
from zivi.orbits.sequence import Equations, Frame, Solution, equations, newton, size_of
from zivi.system.mass import ImpactSystem

__all__ = ["half_difference", "half_frame", "least_period", "least_rows", "mean_half"]

NEAR = 0.05
"""Parts that differ by less, relative to the period and the speeds, may be one orbit."""
ALIKE = 0.25
"""Parts of a guess without a solution that differ by less are replaced by their mean."""
SAME = 2e-4
"""Parts that differ by less after Newton's last steps are one orbit."""
MOST_STEPS = 60


def least_period(
    system: ImpactSystem, frame: Frame, guess: Array, found: Solution, max_iter: int
) -> tuple[Frame, Solution]:
    """Give the solution over the least period: `found`, or an orbit of which it is a repetition.

    Where `found` did not converge from its `guess`, the mean of the parts of the guess may.
    """
    for parts in _prime_factors(_most_parts(frame, guess)):
        single = _single(system, frame, guess, found, parts, max_iter)
        if single is not None:
            part = _part(frame, parts)
            return least_period(system, part, single.equations.y, single, max_iter)
    return frame, found


def least_rows(
    system: ImpactSystem, period: float, rows: Array, multiple: int
) -> tuple[int, Array]:
    """Give the least multiple of the period, and its impacts, of what a run seems to repeat."""
    frame = Frame(multiple, period, PRECISE)
    speed = float(np.max(np.abs(rows[:, 1])))
    factors = _prime_factors(_most_parts(frame, rows))
    if all(_apart(system, frame, rows, speed, parts) > NEAR for parts in factors):
        return multiple, rows
    try:
        found = newton(system, frame, rows)
    except FlightError:
        return multiple, rows
    least, single = least_period(system, frame, rows, found, MOST_STEPS)
    if least.multiple == multiple:
        return multiple, rows
    return least.multiple, single.equations.y


def half_difference(system: ImpactSystem, frame: Frame, y: Array) -> Array | None:
    """Give half the difference of the halves of an orbit, rows ``(t, u)``; None if it has none."""
    if y.ndim == 1 or _most_parts(frame, y) % 2:
        return None
    first, second = _split(system, frame, y, 2)
    return np.asarray(0.5 * (second - first), np.float64)


def half_frame(frame: Frame) -> Frame:
    """Give the frame of an orbit of half the period."""
    return _part(frame, 2)


def mean_half(system: ImpactSystem, frame: Frame, y: Array) -> Array:
    """Give the unknowns of the mean of the halves of an orbit."""
    return _mean(system, frame, y, 2)


def _most_parts(frame: Frame, y: Array) -> int:
    """Give the number of which that of equal parts is a divisor."""
    impacts = len(y) if y.ndim == 2 else 0
    return impacts if frame.free else math.gcd(impacts, frame.multiple)


def _prime_factors(number: int) -> list[int]:
    """Give the prime factors, each once."""
    found, factor = [], 2
    while number > 1:
        if number % factor == 0:
            found.append(factor)
            while number % factor == 0:
                number //= factor
        factor += 1
    return found


def _part(frame: Frame, parts: int) -> Frame:
    return frame if frame.free else dataclasses.replace(frame, multiple=frame.multiple // parts)


def _split(system: ImpactSystem, frame: Frame, y: Array, parts: int) -> Array:
    """Give equal parts of the impacts of an orbit, of shape (parts, k, 2), each from its start."""
    shift = frame.length(system, y) / parts * np.arange(parts)
    rows = frame.listed(y).reshape(parts, -1, 2).copy()
    rows[:, :, 0] -= shift[:, None]
    return rows


def _mean(system: ImpactSystem, frame: Frame, y: Array, parts: int) -> Array:
    """Give the unknowns of the mean of the parts of an orbit, or its state in flight."""
    if y.ndim == 1:
        return y
    rows = _split(system, frame, y, parts).mean(axis=0)
    return frame.unknowns(rows, frame.length(system, y) / parts)


def _spread(system: ImpactSystem, frame: Frame, y: Array, legs: Legs, parts: int) -> float:
    """Give how far the parts differ, relative to the period and the fastest impact."""
    if y.ndim == 1:
        part = equations(system, _part(frame, parts), y)
        return float(np.max(np.abs(part.residual / size_of(system, frame, part))))
    return _apart(system, frame, y, float(np.max(np.abs(legs.v))), parts)


def _apart(system: ImpactSystem, frame: Frame, y: Array, speed: float, parts: int) -> float:
    apart = np.max(np.ptp(_split(system, frame, y, parts), axis=0), axis=0)
    period = frame.length(system, y) / frame.multiple
    # plastic impacts have no speeds
    return max(float(apart[0]) / period, float(apart[1]) / (speed or 1.0))


def _single(
    system: ImpactSystem, frame: Frame, guess: Array, found: Solution, parts: int, max_iter: int
) -> Solution | None:
    """Give the orbit of which a solution has so many; None if it has not."""
    at = found.equations
    try:
        if found.converged:
            if _spread(system, frame, at.y, at.legs, parts) > NEAR:
                return None
            guess = _polished(system, frame, at, parts).y
        if _spread(system, frame, guess, at.legs, parts) > (SAME if found.converged else ALIKE):
            return None
        single = newton(system, _part(frame, parts), _mean(system, frame, guess, parts), max_iter)
    except FlightError:
        return None
    return single if single.converged else None


def _polished(system: ImpactSystem, frame: Frame, at: Equations, parts: int) -> Equations:
    """Go on with Newton's steps until they are rounding, or the parts are one orbit."""
    for _ in range(MOST_STEPS):
        try:
            move = np.linalg.solve(at.jacobian, at.residual).reshape(at.y.shape)
        except np.linalg.LinAlgError:
            break
        size = max(1.0, float(np.max(np.abs(at.y))))
        same = _spread(system, frame, at.y, at.legs, parts) <= SAME
        if same or np.max(np.abs(move)) <= 1e-11 * size:
            break
        at = equations(system, frame, at.y - move)
    return at
