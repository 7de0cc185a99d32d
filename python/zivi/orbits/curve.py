"""Pseudo-arclength continuation of sequences of impacts: points, tangents, located events."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from zivi.base.check import Array
from zivi.orbits.flights import FlightError
from zivi.orbits.secant import secant
from zivi.orbits.sequence import Equations, Frame, equations, size_of
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import with_value

__all__ = ["Curve", "Point", "locate", "locate_near"]

CORRECTIONS = 10
MOST_SECANTS = 20


@dataclasses.dataclass(frozen=True)
class Point:
    """A solution of the equations, in scaled unknowns ``z = (y, p)``."""

    z: Array
    at: Equations
    tangent: Array
    value: float
    corrections: int

    @property
    def least_speed(self) -> float:
        """The least speed before an impact, which plastic ones have too; 1 without impacts."""
        return float(np.min(-self.at.legs.v)) if self.at.y.ndim == 2 else 1.0

    @property
    def least_push(self) -> float:
        """The least force after a plastic impact, which holds the mass where it is negative."""
        return float(np.min(self.at.legs.first))

    @property
    def doubling(self) -> float:
        """``1 + tr M + det M``: zero where a multiplier is -1."""
        m = self.at.monodromy
        with np.errstate(invalid="ignore"):
            return float(1.0 + np.trace(m) + m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0])


class Curve:
    """The solutions of the equations of a system over one of its parameters."""

    def __init__(
        self, system: ImpactSystem, frame: Frame, name: str, y: Array, width: float
    ) -> None:
        self.system, self.frame, self.name = system, frame, name
        self.shape = y.shape
        period = frame.length(system, y) / frame.multiple
        at = equations(system, frame, y, name)
        sizes = size_of(system, frame, at)
        speed = float(sizes[1])
        rates = np.linalg.lstsq(at.jacobian, at.by, rcond=1e-6)[0][1::2]
        speed = max(speed, min(0.3 * width * float(np.max(np.abs(rates))), 20.0 * speed))
        own = [period, speed] if y.ndim == 2 else [speed * period / 6.0, speed]
        self.scale = np.append(np.tile(own, y.size // 2), width)
        self.sizes = sizes
        self.tolerance = 20.0 * max(frame.method.rtol, 1e-14)
        self.flights = 0

    def scaled(self, y: Array, value: float) -> Array:
        """Give unknowns and parameter as one scaled vector."""
        return np.asarray(np.append(y.ravel(), value) / self.scale, np.float64)

    def system_at(self, value: float) -> ImpactSystem:
        """Give the system with a value of the parameter."""
        return with_value(self.system, self.name, value)

    def evaluate(self, z: Array) -> tuple[Equations, Array, Array]:
        """Give the equations at a point, their scaled residual and their scaled derivative."""
        full = z * self.scale
        self.flights += 1 if len(self.shape) == 1 else self.shape[0]
        system, y = self.system_at(float(full[-1])), full[:-1].reshape(self.shape)
        at = equations(system, self.frame, y, self.name, minima=True)
        matrix = np.column_stack([at.jacobian, at.by]) * self.scale / self.sizes[:, None]
        return at, at.residual / self.sizes, matrix

    def correct(self, guess: Array, normal: Array) -> Point | None:
        """Solve in the hyperplane through a guess with a normal; None if that fails."""
        z = guess.copy()
        for step in range(CORRECTIONS):
            try:
                at, residual, matrix = self.evaluate(z)
            except (FlightError, ValueError):
                return None
            full = np.vstack([matrix, normal])
            if np.max(np.abs(residual)) <= self.tolerance:
                return self._point(z, at, full, step)
            right = np.append(residual, normal @ (z - guess))
            try:
                z = z - np.linalg.solve(full, right)
            except np.linalg.LinAlgError:
                return None
            if not np.all(np.isfinite(z)) or np.max(np.abs(z - guess)) > 1.0:
                return None
        return None

    def _point(self, z: Array, at: Equations, full: Array, step: int) -> Point | None:
        right = np.zeros(len(z))
        right[-1] = 1.0
        try:
            null = np.linalg.solve(full, right)
        except np.linalg.LinAlgError:
            return None
        tangent = np.asarray(null / np.linalg.norm(null), np.float64)
        return Point(z, at, tangent, float(z[-1] * self.scale[-1]), step)

    def start(self, y: Array, value: float) -> Point | None:
        """Give the point at a solution, its tangent towards larger values where it has one."""
        z = self.scaled(y, value)
        try:
            at, _, matrix = self.evaluate(z)
        except FlightError:
            return None
        # the null vector of the derivative is regular at folds too
        tangent = np.linalg.svd(matrix)[2][-1]
        if tangent[-1] < 0.0:
            tangent = -tangent
        return Point(z, at, tangent, value, 0)


def locate(curve: Curve, one: Point, other: Point, test: Callable[[Point], float]) -> Point | None:
    """Find the point between two at which a test function vanishes, by secants in a bracket."""
    chord = other.z - one.z
    length = float(np.linalg.norm(chord))
    normal = chord / length
    low, high = (0.0, test(one)), (1.0, test(other))
    if not low[1] * high[1] < 0.0:
        return None
    last, before, best = high, low, None
    for _ in range(60):
        part = secant(last, before, low[0], high[0])
        point = curve.correct(one.z + part * chord, normal)
        if point is None:
            return best
        if point.tangent @ one.tangent < 0.0:
            point = dataclasses.replace(point, tangent=-point.tangent)
        value, best = test(point), point
        before, last = last, (part, value)
        if (value > 0.0) == (low[1] > 0.0):
            low = last
        else:
            high = last
        if value == 0.0 or abs(last[0] - before[0]) * length < 1e-13 or high[0] - low[0] < 1e-14:
            break
    return best


def locate_near(curve: Curve, start: Point, test: Callable[[Point], float]) -> Point | None:
    """Find the point near one at which a test function vanishes, by secants along the arc."""
    normal, before, last = start.tangent, (0.0, test(start)), (1e-4, 0.0)
    for _ in range(MOST_SECANTS):
        point = curve.correct(start.z + last[0] * normal, normal)
        if point is None:
            return None
        last = (last[0], test(point))
        moved, rise = last[0] - before[0], last[1] - before[1]
        if last[1] == 0.0 or abs(moved) < 1e-13 or rise == 0.0:
            return point
        before, last = last, (last[0] - last[1] * moved / rise, 0.0)
    return None
