"""The equations of an orbit, in segments or in impulses, and Newton's iteration for them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from zivi.base.check import Array
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.frame import Frame
from zivi.orbits.mechanical.impulses import ImpulseTerms, MassTerms
from zivi.orbits.mechanical.mass_flow import MassFlow, MassImpulses
from zivi.orbits.mechanical.segments import SegmentTerms, of_segments

__all__ = ["Frame", "MassTerms", "Solution", "Terms", "evaluate", "newton", "row_sizes", "sizes_of"]

Terms = SegmentTerms | ImpulseTerms

TOLERANCE = 1e-13
ENOUGH = 1e-10
"""A residual at which an iteration that stalls has found what rounding allows."""


def evaluate(frame: Frame, y: Array, *, slopes: bool = True, name: str | None = None) -> Terms:
    """Evaluate the equations, and their derivatives; of one mass that by a parameter too."""
    if isinstance(frame.impulses, MassImpulses):
        return MassTerms(frame, y, name)
    if frame.impulses is not None:
        return ImpulseTerms(frame, y)
    return of_segments(frame, y, *frame.split(y), slopes=slopes)


def sizes_of(terms: Terms) -> tuple[Array, Array]:
    """Give the sizes of the unknowns and of the residuals."""
    frame, own = terms.frame, row_sizes(terms)
    length, distance, speed = own[0], own[1], own[-2]
    if frame.impulses is not None:
        unknowns, residuals = np.empty((2, len(terms.y)))
        unknowns[::2] = _per_speed(frame) * speed / frame.impulses.mobilities
        unknowns[1::2] = length
        residuals[::2], residuals[1::2] = distance, speed
        return unknowns, residuals
    flights, n, own = terms.flights, frame.flow.n, own[:-1]
    events = []
    for segment in frame.word:
        size = distance
        if segment.kind == "P":
            size = length if isinstance(frame.section, float) else speed
        elif segment.kind == "L":
            size = max(1.0, float(np.max(np.abs(flights.last[:, n:]))))
        events.append(size)
    unknowns = np.tile(np.append(own, length), len(frame.word))
    return unknowns, np.concatenate([np.append(size, own) for size in events])


def _per_speed(frame: Frame) -> float:
    """Give how large impulses are beside the speeds after them, where these are the motion."""
    return frame.impulses.per_speed if isinstance(frame.impulses, MassImpulses) else 1.0


def row_sizes(terms: Terms) -> Array:
    """Give the sizes of a segment's row ``(t, z, tau)``."""
    n, length, flights = terms.frame.flow.n, abs(terms.length), terms.flights
    x, z = terms.x[:, 1:-1], flights.z
    # where a grazing is the only event all speeds there may vanish
    pulls = _largest(flights.first[:, n:], flights.last[:, n:])
    # a section may lie where a motion without events hardly moves
    share = 1.0 if terms.frame.word[0].kind == "P" else 0.1
    pushed = share * length / (2.0 * math.pi) * pulls
    speed = max(_largest(x[:, n:], z[:, n:]), pushed) or 1.0
    # one mass is at the wall in all events: its flights are higher
    part = 0.5 / math.pi / len(x) if isinstance(terms.frame.flow, MassFlow) else 1e-3
    distance = max(_largest(x[:, :n], z[:, :n]), part * speed * length) or 1.0
    return np.array([length, *[distance] * n, *[speed] * n, length])


def _largest(*several: Array) -> float:
    """Give the largest absolute value."""
    return max(float(np.abs(it).max()) for it in several)


@dataclasses.dataclass(frozen=True)
class Solution:
    """What Newton's iteration found."""

    terms: Terms
    residual: float
    iterations: int
    converged: bool
    trace: list[float]


def newton(frame: Frame, y: Array, most: int = 20) -> Solution:
    """Solve the equations from a guess; steps are halved where the residual grows."""
    now = evaluate(frame, y)
    _, sizes = sizes_of(now)
    if frame.impulses is not None:
        sizes[1::2] *= _per_speed(frame)
    error = float(np.abs(now.residual / sizes).max())
    trace, accuracy = [error], frame.flow.accuracy
    for _ in range(most):
        if error <= max(TOLERANCE, accuracy):
            break
        try:
            move: Array = -np.linalg.solve(now.matrix(), now.residual)
        except np.linalg.LinAlgError:
            break
        found = _damped(frame, now, move, sizes, error)
        if found is None or (found[1] > 0.5 * error and error <= ENOUGH):
            break
        now, error = found
        trace.append(error)
    return Solution(now, error, len(trace) - 1, error <= max(ENOUGH, accuracy), trace)


def _damped(
    frame: Frame, now: Terms, move: Array, sizes: Array, error: float
) -> tuple[Terms, float] | None:
    part = 1.0
    for _ in range(8):
        try:
            there = evaluate(frame, now.y + part * move)
        except (FlightError, ValueError):
            part *= 0.5
            continue
        new = float(np.abs(there.residual / sizes).max())
        if math.isfinite(new) and (new <= 2.0 * error or new < 1e-3):
            return there, new
        part *= 0.5
    return None
