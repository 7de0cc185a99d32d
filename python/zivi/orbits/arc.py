"""One direction of a branch: steps along the arc, and what happens between them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.sensitivity import OrbitStatus
from zivi.orbits.curve import Curve, Point, locate, locate_near
from zivi.orbits.flights import FlightError
from zivi.orbits.least_period import half_difference, half_frame, mean_half

__all__ = ["Arc", "Found"]

BEYOND = 3
"""Points that are followed where an orbit is no motion any more."""
HALVES_MEET = 1e-4
"""Half differences that are less, in scaled unknowns, are those of a single orbit."""
EDGES = ("grazing", "interior_impact")


def _rise(point: Point) -> float:
    return float(point.tangent[-1])


def _least(point: Point) -> float:
    return point.least_speed


def _lowest(point: Point) -> float:
    return point.at.lowest[0]


def _doubling(point: Point) -> float:
    return point.doubling


def _push(point: Point) -> float:
    return point.least_push


class Found(NamedTuple):
    """An event of a branch."""

    kind: str
    point: Point
    curve: Curve
    """The curve of the point: where a doubled orbit begins that of the single one."""


class Arc:
    """One direction of a branch."""

    def __init__(
        self, curve: Curve, start: Point, span: tuple[float, float], step: float, most: int
    ) -> None:
        self.curve, self.span, self.step, self.most = curve, span, step, most
        self.longest = 5.0 * step
        self.edge = 1e-9 * float(np.max(curve.scale[:-1]))
        self.plastic = curve.system.e == 0.0 and curve.name != "e" and start.at.y.ndim == 2
        self.points = [start]
        self.events: list[Found] = []
        self.status = OrbitStatus.MAX_POINTS
        self.left = 0

    def sticks(self, point: Point) -> bool:
        """Whether the force holds the mass at the wall after a plastic impact."""
        return self.plastic and point.least_push < 0.0

    def is_out(self, point: Point) -> bool:
        """Whether a point is no motion, by more than rounding."""
        return self.sticks(point) or min(point.least_speed, _lowest(point)) < -self.edge

    def go(self) -> Arc:
        """Follow the curve to its end."""
        while len(self.points) < self.most:
            status = self._advance()
            if status is not None:
                self.status = status
                break
        return self

    def _advance(self) -> OrbitStatus | None:
        last = self.points[-1]
        new = self._next(last)
        if new is None:
            return OrbitStatus.NOT_CONVERGED
        if not self.span[0] <= new.value <= self.span[1]:
            self._end_of_range(last, new)
            return OrbitStatus.RANGE_END
        if self._halves_meet(last, new):
            self._single_orbit(last)
            return OrbitStatus.COMPLETED
        self._look(last, new)
        self.points.append(new)
        self.left += self.is_out(new)
        return OrbitStatus.LEFT_ADMISSIBLE if self.left >= BEYOND else None

    def _next(self, last: Point) -> Point | None:
        while self.step > 1e-7:
            new = self.curve.correct(last.z + self.step * last.tangent, last.tangent)
            if new is None:
                self.step *= 0.5
                continue
            if new.tangent @ last.tangent < 0.9:
                self.step *= 0.5
                continue
            if new.corrections <= 3:
                self.step = min(1.4 * self.step, self.longest)
            elif new.corrections > 5:
                self.step *= 0.6
            return new
        return None

    def _end_of_range(self, last: Point, new: Point) -> None:
        end = self.span[0] if new.value < self.span[0] else self.span[1]
        part = (end - last.value) / (new.value - last.value)
        guess = last.z + part * (new.z - last.z)
        normal = np.zeros(len(guess))
        normal[-1] = 1.0
        guess[-1] = end / self.curve.scale[-1]
        point = self.curve.correct(guess, normal)
        if point is None:
            return
        if point.tangent @ last.tangent < 0.0:
            point = dataclasses.replace(point, tangent=-point.tangent)
        self._look(last, point)
        self.points.append(point)

    def _halves_meet(self, last: Point, new: Point) -> bool:
        """Whether a doubled orbit is, or passed, the single one again: its halves change places."""
        before, now = self._half_difference(last), self._half_difference(new)
        if before is None or now is None:
            return False
        near = float(np.linalg.norm(now)) < min(HALVES_MEET, float(np.linalg.norm(before)))
        return near or bool(before @ now < 0.0)

    def _half_difference(self, point: Point) -> Array | None:
        curve = self.curve
        system = curve.system_at(point.value)
        apart = half_difference(system, curve.frame, point.at.y)
        return None if apart is None else apart.ravel() / curve.scale[: apart.size]

    def _single_orbit(self, last: Point) -> None:
        """Find the period doubling of the single orbit at which a doubled one begins."""
        curve = self.curve
        system = curve.system_at(last.value)
        mean = mean_half(system, curve.frame, last.at.y)
        width = float(curve.scale[-1])
        try:
            single = Curve(system, half_frame(curve.frame), curve.name, mean, width)
        except FlightError:
            return
        fixed = np.zeros(mean.size + 1)
        fixed[-1] = 1.0
        start = single.correct(single.scaled(mean, last.value), fixed)
        point = None if start is None else locate_near(single, start, _doubling)
        curve.flights += single.flights
        if point is not None and self.span[0] <= point.value <= self.span[1]:
            self.events.append(Found("period_doubling", point, single))

    def _look(self, last: Point, new: Point) -> None:
        """Find what happens between two points."""
        if self.is_out(last):
            return
        found: list[tuple[str, Point]] = []
        # an impact that dies takes the flight after it behind the wall
        dies = new.least_speed < 0.0
        for kind, test in self._tests(new):
            if kind in EDGES and abs(test(last)) <= self.edge and test(new) < 0.0:
                found.append((kind, last))
            elif test(last) * test(new) < 0.0:
                point = locate(self.curve, last, new, test)
                found += [(kind, point)] if point is not None else []
        if dies and found:
            self._doubling_before(last, found)
        chord = new.z - last.z
        found = sorted(found, key=lambda it: float((it[1].z - last.z) @ chord))
        self.events += [Found(kind, point, self.curve) for kind, point in found]

    def _tests(self, new: Point) -> list[tuple[str, Callable[[Point], float]]]:
        """Give the functions that may change their signs before a point."""
        tests: list[tuple[str, Callable[[Point], float]]] = [("fold", _rise)]
        if self.sticks(new):
            # a held mass is behind the wall for the equations
            return [*tests, ("rest_appears", _push), ("period_doubling", _doubling)]
        if new.least_speed < 0.0:
            return [*tests, ("grazing", _least)]
        return [*tests, ("interior_impact", _lowest), ("period_doubling", _doubling)]

    def _doubling_before(self, last: Point, found: list[tuple[str, Point]]) -> None:
        """Look for a period doubling that hides just before a grazing, where a multiplier grows."""
        grazing = next((point for kind, point in found if kind == "grazing"), None)
        if grazing is None or last.doubling <= 0.0:
            return
        chord = grazing.z - last.z
        normal = chord / np.linalg.norm(chord)
        near = self.curve.correct(last.z + 0.999 * chord, normal)
        if near is not None and near.doubling < 0.0 < near.least_speed:
            point = locate(self.curve, last, near, _doubling)
            found += [("period_doubling", point)] if point is not None else []
