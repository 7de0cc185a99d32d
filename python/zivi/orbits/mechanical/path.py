"""The solutions of a word's equations over a parameter: points, tangents, located events."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.orbits.flights import FlightError, corrected
from zivi.orbits.mechanical.by_parameter import (
    by_parameter,
    frame_of,
    length_of,
    moved_frame,
    of_mass,
    trend_of,
)
from zivi.orbits.mechanical.equations import Frame, MassTerms, Terms, evaluate, sizes_of
from zivi.orbits.mechanical.family import with_values
from zivi.orbits.mechanical.margins import Margins
from zivi.orbits.mechanical.mass_flow import MassFlow, MassImpulses
from zivi.orbits.mechanical.multipliers import multipliers_of
from zivi.orbits.secant import secant
from zivi.system.mass import ImpactSystem

__all__ = ["Path", "Point", "located", "located_near"]

CORRECTIONS = 10
TOLERANCE = 1e-12
CLOSE = 1e-12
"""How near two places of an event are, in scaled unknowns, when it is found."""
MOST_SECANTS = 20
ENOUGH = 1e-10
"""A residual at which an iteration that stalls has found what rounding allows."""
STALE = 0.05
"""Where the residual falls by less, the derivative by the parameter is computed again."""


class Placed(Protocol):
    """A point of a curve of solutions."""

    @property
    def z(self) -> Array: ...
    @property
    def tangent(self) -> Array: ...


Found = TypeVar("Found", bound=Placed)
FoundCo = TypeVar("FoundCo", bound=Placed, covariant=True)


class Solutions(Protocol[FoundCo]):
    """A curve of solutions."""

    def correct(self, guess: Array, normal: Array) -> FoundCo | None:
        """Solve in the hyperplane through a guess with a normal; None if that fails."""


@dataclasses.dataclass(frozen=True)
class Point:
    """A solution, in scaled unknowns ``z = (y, p)``."""

    z: Array
    terms: Terms
    tangent: Array
    value: float
    corrections: int
    residual: float

    @functools.cached_property
    def margins(self) -> Margins:
        """What must be positive."""
        return Margins(self.terms)

    @functools.cached_property
    def multipliers(self) -> NDArray[np.complex128]:
        """The multipliers, of the half map of a symmetric word."""
        return multipliers_of(self.terms, half=True)

    @functools.cached_property
    def doubling(self) -> float:
        """The sign of det J(pi)."""
        return float(np.linalg.slogdet(self.terms.matrix(-1.0))[0])

    @functools.cached_property
    def pairs(self) -> float:
        """The product of all products of two multipliers less 1: zero where a pair turns."""
        own = self.multipliers[self.multipliers != 0.0]
        if not np.all(np.isfinite(own)) or len(own) < 2:
            return 1.0
        if len(own) == 2:
            return float(np.real(own[0] * own[1])) - 1.0
        i, j = np.triu_indices(len(own), 1)
        return float(np.real(np.prod(own[i] * own[j] - 1.0)))

    @functools.cached_property
    def turning(self) -> float:
        """How far the complex pair nearest the unit circle is from it; NaN without one."""
        own = self.multipliers[np.imag(self.multipliers) > 1e-9]
        if not len(own) or not np.all(np.isfinite(own)):
            return float("nan")
        sizes = np.abs(own) - 1.0
        return float(sizes[int(np.argmin(np.abs(sizes)))])


class Path:
    """The solutions of one word over one parameter."""

    def __init__(self, frame: Frame, name: str, y: Array, width: float) -> None:
        self.frame, self.name = frame, name
        unknowns, self.sizes = sizes_of(evaluate(frame, y))
        self.scale = np.append(unknowns, width)
        self.flights = 0

    def scaled(self, y: Array, value: float) -> Array:
        """Give unknowns and parameter as one scaled vector."""
        return np.asarray(np.append(y, value) / self.scale, np.float64)

    def frame_at(self, value: float) -> Frame:
        """Give the frame of the system with a value of the parameter."""
        return moved_frame(self.frame, {self.name: value})

    def column(self, terms: Terms) -> Array:
        """Give the derivative of the equations by the parameter."""
        if isinstance(terms.frame.flow, MassFlow):
            return of_mass(terms, self.name)
        self.flights += 2 * len(terms.frame.word)
        return by_parameter(terms.frame, terms.y, self.name)

    def evaluate(self, z: Array, *, derives: bool = False) -> tuple[Terms, Array]:
        """Give the equations at a point, and their scaled residual."""
        full = z * self.scale
        frame = self.frame_at(float(full[-1]))
        self.flights += len(frame.word)
        terms = evaluate(frame, full[:-1], name=self.name if derives else None)
        return terms, terms.residual / self.sizes

    def matrix(self, terms: Terms, column: Array, normal: Array | None = None) -> Array:
        """Give the scaled derivative by unknowns and parameter, with a normal as its last row."""
        n = len(column)
        full = np.empty((n + (normal is not None), n + 1))
        whole = full[:n]
        whole[:, :-1], whole[:, -1] = terms.matrix(), column
        whole *= self.scale
        whole /= self.sizes[:, None]
        if normal is not None:
            full[-1] = normal
        return full

    def correct(self, guess: Array, normal: Array, tolerance: float = TOLERANCE) -> Point | None:
        """Solve in the hyperplane through a guess with a normal; None if that fails."""
        if isinstance(self.frame.impulses, MassImpulses):
            return self._correct_mass(guess, normal, tolerance)
        z, column = guess.copy(), None
        before, stalled = np.inf, False
        for step in range(CORRECTIONS):
            try:
                terms, residual = self.evaluate(z, derives=column is None)
                error = float(np.abs(residual).max())
                if column is None or STALE * before < error:
                    # only the convergence depends on it
                    column = self.column(terms)
            except (FlightError, ValueError):
                return None
            full = self.matrix(terms, column, normal)
            # beside a grazing one step may stall before the next ones converge
            stalls = error >= 0.5 * before
            enough = error <= max(tolerance, terms.frame.flow.accuracy)
            if enough or (stalls and stalled and error <= ENOUGH):
                return self._point(z, terms, full, step, error)
            before, stalled = error, stalls
            right = np.empty(len(z))
            right[:-1], right[-1] = residual, normal @ (z - guess)
            try:
                z = z - np.linalg.solve(full, right)
            except np.linalg.LinAlgError:
                return None
            # false for NaN, too
            near = float(np.abs(z - guess).max()) <= 1.0
            if not near:
                return None
        return None

    def _correct_mass(self, guess: Array, normal: Array, tolerance: float) -> Point | None:
        """Do the same in the extension."""
        frame, name, trend = self.frame, self.name, self._trend
        system: ImpactSystem = frame.system

        def at(value: float) -> tuple[Any, float, float, float]:
            nonlocal system
            system = with_values(frame.system, {name: value})
            length = length_of(frame, system)
            longer = trend * length / value if trend else 0.0
            return system._spec, length, system.e, longer

        tolerance = max(tolerance, frame.flow.accuracy)
        count, found = corrected(
            at, frame.system, frame.method, name, (guess, normal),
            (self.scale, self.sizes), CORRECTIONS, (tolerance, ENOUGH, STALE),
        )  # fmt: skip
        self.flights += count * len(frame.word)
        if found is None:
            return None
        z, tangent, steps, error, numbers = found
        full = z * self.scale
        frame, y = frame_of(frame, system), full[:-1]
        assert isinstance(frame.impulses, MassImpulses)
        evaluated = frame.impulses.evaluated(y, float(y[-2]), *numbers)
        terms = MassTerms(frame, y, found=evaluated)
        return Point(z, terms, tangent, float(full[-1]), steps, error)

    @functools.cached_property
    def _trend(self) -> int:
        return trend_of(self.frame, self.name)

    def _point(self, z: Array, terms: Terms, full: Array, step: int, error: float) -> Point | None:
        right = np.zeros(len(z))
        right[-1] = 1.0
        try:
            null = np.linalg.solve(full, right)
        except np.linalg.LinAlgError:
            return None
        if not np.all(np.isfinite(null)):
            return None
        tangent = np.asarray(null / np.linalg.norm(null), np.float64)
        return Point(z, terms, tangent, float(z[-1] * self.scale[-1]), step, error)

    def start(self, y: Array, value: float) -> Point:
        """Give the point at a solution, its tangent towards larger values where it has one."""
        z = self.scaled(y, value)
        terms, residual = self.evaluate(z, derives=True)
        tangent = np.linalg.svd(self.matrix(terms, self.column(terms)))[2][-1]
        if tangent[-1] < 0.0:
            tangent = -tangent
        error = float(np.max(np.abs(residual)))
        return Point(z, terms, np.asarray(tangent, np.float64), value, 0, error)

    def at_value(self, guess: Array, value: float) -> Point | None:
        """Give the point with a value of the parameter, near a guess."""
        normal, guess = np.zeros(len(guess)), guess.copy()
        normal[-1], guess[-1] = 1.0, value / self.scale[-1]
        return self.correct(guess, normal)


def bordered(terms: Terms, factor: complex) -> tuple[Any, Any]:
    """Give the borders of a nearly singular matrix: its left and right singular vectors."""
    left, _, right = np.linalg.svd(terms.matrix(factor))
    return left[:, -1], right[-1].conj()


def sigma(terms: Terms, factor: complex, borders: tuple[Any, Any]) -> Any:
    """Give a smooth number that vanishes where the matrix is singular."""
    matrix = terms.matrix(factor)
    b, c = borders
    n = len(b)
    whole = np.zeros((n + 1, n + 1), matrix.dtype)
    whole[:n, :n], whole[:n, n], whole[n, :n] = matrix, b, c.conj()
    right = np.zeros(n + 1)
    right[n] = 1.0
    return np.linalg.solve(whole, right)[n]


def located(
    path: Solutions[Found], one: Found, other: Found, test: Callable[[Found], float]
) -> Found | None:
    """Find where a test function vanishes between two points, by secants in a bracket."""
    chord = other.z - one.z
    length = float(np.linalg.norm(chord))
    normal = chord / length
    low, high = (0.0, test(one)), (1.0, test(other))
    if not low[1] * high[1] < 0.0:
        return None
    best, last, before, near = None, high, low, one.z
    at = 0.0
    for _ in range(50):
        part = secant(last, before, low[0], high[0])
        point = path.correct(near + (part - at) * chord, normal)
        if point is None:
            # a part of the bracket that cannot be computed lies beyond the event
            high = (part, -low[1])
            last, before = high, low
            if high[0] - low[0] < 1e-12:
                return best
            continue
        if point.tangent @ one.tangent < 0.0:
            point = dataclasses.replace(point, tangent=-point.tangent)  # type: ignore[type-var]
        value, best, near, at = test(point), point, point.z, part
        before, last = last, (part, value)
        if (value > 0.0) == (low[1] > 0.0):
            low = last
        else:
            high = last
        moved = min(abs(last[0] - before[0]), high[0] - low[0]) * length
        if value == 0.0 or moved < CLOSE:
            break
    return best


def located_near(path: Path, start: Point, test: Callable[[Point], float]) -> Point | None:
    """Find where a test function vanishes near a point, by secants along the arc."""
    normal, before, last = start.tangent, (0.0, test(start)), (1e-4, 0.0)
    for _ in range(MOST_SECANTS):
        point = path.correct(start.z + last[0] * normal, normal)
        if point is None:
            return None
        last = (last[0], test(point))
        moved, rise = last[0] - before[0], last[1] - before[1]
        if last[1] == 0.0 or abs(moved) < 1e-13 or rise == 0.0:
            return point
        before, last = last, (last[0] - last[1] * moved / rise, 0.0)
    return None
