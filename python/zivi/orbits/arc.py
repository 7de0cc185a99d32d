"""One direction of a branch: steps along the arc, and what happens between them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from zivi.orbits.curve import Curve, Point, locate
from zivi.sensitivity import OrbitStatus

__all__ = ["Arc"]

BEYOND = 3
"""Points that are followed where an orbit is no motion any more."""
HALVES_MEET = 1e-6
EDGES = ("grazing", "interior_impact")


def _rise(point: Point) -> float:
    return float(point.tangent[-1])


def _least(point: Point) -> float:
    return point.least_speed


def _lowest(point: Point) -> float:
    return point.at.lowest[0]


class Arc:
    """One direction of a branch."""

    def __init__(
        self, curve: Curve, start: Point, span: tuple[float, float], step: float, most: int
    ) -> None:
        self.curve, self.span, self.step, self.most = curve, span, step, most
        self.longest = 5.0 * step
        self.edge = 1e-9 * float(np.max(curve.scale[:-1]))
        self.points = [start]
        self.events: list[tuple[str, Point]] = []
        self.status = OrbitStatus.MAX_POINTS
        self.left = 0

    def is_out(self, point: Point) -> bool:
        """Whether a point is no motion, by more than rounding."""
        return min(point.least_speed, _lowest(point)) < -self.edge

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
        if self._halves_meet(new):
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

    def _halves_meet(self, new: Point) -> bool:
        """Whether a doubled orbit is the single one again."""
        k = len(new.at.y) if new.at.y.ndim == 2 else 0
        frame = self.curve.frame
        halves = k % 2 == 0 and (frame.free or frame.multiple % 2 == 0)
        if k == 0 or not halves or len(self.points) < 2:
            return False
        speeds = new.at.y[:, 1]
        apart = np.max(np.abs(speeds[: k // 2] - speeds[k // 2 :]))
        return bool(apart < HALVES_MEET * np.max(np.abs(speeds)))

    def _look(self, last: Point, new: Point) -> None:
        """Find what happens between two points."""
        if self.is_out(last):
            return
        found: list[tuple[str, Point]] = []
        # an impact that dies takes the flight after it behind the wall
        dies = new.least_speed < 0.0
        tests: list[tuple[str, Callable[[Point], float]]] = [("fold", _rise)]
        tests.append(("grazing", _least) if dies else ("interior_impact", _lowest))
        if not dies:
            tests.append(("period_doubling", lambda point: point.doubling))
        for kind, test in tests:
            if kind in EDGES and abs(test(last)) <= self.edge and test(new) < 0.0:
                found.append((kind, last))
            elif test(last) * test(new) < 0.0:
                point = locate(self.curve, last, new, test)
                found += [(kind, point)] if point is not None else []
        if dies and found:
            self._doubling_before(last, found)
        chord = new.z - last.z
        self.events += sorted(found, key=lambda it: float((it[1].z - last.z) @ chord))

    def _doubling_before(self, last: Point, found: list[tuple[str, Point]]) -> None:
        """Look for a period doubling that hides just before a grazing, where a multiplier grows."""
        grazing = next((point for kind, point in found if kind == "grazing"), None)
        if grazing is None or last.doubling <= 0.0:
            return
        chord = grazing.z - last.z
        normal = chord / np.linalg.norm(chord)
        near = self.curve.correct(last.z + 0.999 * chord, normal)
        if near is not None and near.doubling < 0.0 < near.least_speed:
            point = locate(self.curve, last, near, lambda point: point.doubling)
            found += [("period_doubling", point)] if point is not None else []
