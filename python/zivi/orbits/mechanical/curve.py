"""Curves of events in two parameters."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.by_parameter import moved_frame
from zivi.orbits.mechanical.critical import Critical, Grazing, Margin, Singular, Turning, Values
from zivi.orbits.mechanical.equations import Frame, Terms, evaluate, sizes_of
from zivi.orbits.mechanical.family import value_of
from zivi.orbits.mechanical.margins import Margins
from zivi.orbits.mechanical.normal_form import cubic_test
from zivi.orbits.mechanical.path import located

__all__ = ["CurvePoint", "Line", "Named"]

CORRECTIONS = 10
TOLERANCE = 1e-12
KAPPAS = {"resonance_1_1": 1.0, "resonance_1_2": -1.0, "resonance_1_3": -0.5, "resonance_1_4": 0.0}
CUBIC = "generalized_period_doubling"
REGULAR = ("cusp", "fold", "fold_flip", "period_doubling", "resonant_grazing", *KAPPAS)
"""Points that the matrix shows: margins need not be looked for."""
STEP = 1e-6
STALE = 0.05
"""Where the residual falls by less, slopes are computed again."""


class Slopes(NamedTuple):
    """Derivatives that a point nearby may lend: only the convergence depends on them."""

    columns: Array
    """By the parameters."""
    by_y: Array
    """Of what vanishes, by the unknowns."""


@dataclasses.dataclass(frozen=True)
class CurvePoint:
    """A point of a curve: scaled unknowns ``(y, p1, p2)``, for a turning pair with kappa."""

    z: Array
    terms: Terms
    tangent: Array
    values: Array
    kappa: float
    corrections: int
    residual: float
    line: Line | None = None
    matrix: Array | None = None
    """Derivative of the equations, scaled."""

    @functools.cached_property
    def tests(self) -> dict[str, float]:
        """Numbers whose signs change at points of codimension two."""
        return {} if self.line is None else self.line.tests(self)


def _test(name: str, point: CurvePoint) -> float:
    """Give one of the numbers whose signs change; NaN where there is none of the name."""
    if name == CUBIC and point.line is not None:
        return point.line.cubic(point.terms, precise=True)
    own = point.tests if point.line is None or name not in REGULAR else point.line.regular(point)
    return own.get(name, math.nan)


class Named(NamedTuple):
    """A point of codimension two."""

    kind: str
    point: CurvePoint


class Line:
    """The solutions of a word's equations at which something critical vanishes."""

    def __init__(
        self, kind: str, frame: Frame, y: Array, names: tuple[str, str], widths: Array, kappa: float
    ) -> None:
        self.kind, self.frame, self.names = kind, frame, names
        terms = evaluate(frame, y)
        unknowns, self.sizes = sizes_of(terms)
        self.critical = critical_of(kind, terms, kappa)
        extra = [1.0] if self.critical.with_kappa else []
        self.scale = np.concatenate([unknowns, widths, extra])

    def start(self, y: Array, kappa: float) -> CurvePoint | None:
        """Give the point at an event."""
        values = [value_of(self.frame.system, name) for name in self.names]
        extra = [kappa] if self.critical.with_kappa else []
        z = np.concatenate([y, values, extra]) / self.scale
        return self.correct(z, None)

    def split(self, z: Array) -> tuple[Array, Array, float]:
        """Give unknowns, parameters and kappa."""
        full, n = z * self.scale, len(self.sizes)
        return full[:n], full[n : n + 2], float(full[n + 2]) if self.critical.with_kappa else 0.0

    def system(self, z: Array, near: Slopes | None = None) -> tuple[Terms, Array, Array, Slopes]:
        """Give terms, what must vanish, its scaled derivative, and slopes to lend."""
        y, values, kappa = self.split(z)
        frame = moved_frame(self.frame, dict(zip(self.names, values.tolist(), strict=True)))
        terms = evaluate(frame, y)
        found = self.critical.at(terms, kappa, None if near is None else near.by_y)
        n, count = len(y), self.critical.count
        whole = np.zeros((n + count, len(z)))
        whole[:n, :n], whole[n:, :n] = terms.matrix(), found.by_y
        if near is None:
            each = zip(self.names, values.tolist(), strict=True)
            columns = np.column_stack([self._column(terms, kappa, found, *it) for it in each])
            near = Slopes(columns, found.by_y)
        whole[:, n : n + 2] = near.columns
        if found.by_kappa is not None:
            whole[n:, n + 2] = found.by_kappa
        weights = np.concatenate([self.sizes, np.full(count, self._weight(whole[n:]))])
        residual = np.concatenate([terms.residual, found.value]) / weights
        return terms, residual, whole * self.scale / weights[:, None], near

    def _column(self, terms: Terms, kappa: float, found: Values, name: str, value: float) -> Array:
        """Give the derivative by a parameter, by a difference: only the convergence needs it."""
        h = STEP * max(abs(value), 1e-2)
        ahead = evaluate(moved_frame(terms.frame, {name: value + h}), terms.y)
        moved = (ahead.residual - terms.residual) / h
        if self.critical.is_measured:
            rise = self.critical.measure(ahead) - self.critical.measure(terms)
            return np.append(moved, rise / h)
        change = self.critical.matrix(ahead, kappa) - self.critical.matrix(terms, kappa)
        return np.append(moved, self.critical.by_matrix(found, change / h))

    def _weight(self, rows: Array) -> float:
        """Give the size of what vanishes: how it changes with the unknowns."""
        return float(np.max(np.abs(rows * self.scale))) or 1.0

    def correct(self, guess: Array, normal: Array | None) -> CurvePoint | None:
        """Solve in the hyperplane through a guess; None if that fails."""
        z, before, near = guess.copy(), np.inf, None
        for step in range(CORRECTIONS):
            try:
                terms, residual, matrix, near = self.system(z, near)
            except (FlightError, ValueError, np.linalg.LinAlgError):
                return None
            if not np.all(np.isfinite(matrix)):
                return None
            error = float(np.max(np.abs(residual)))
            if error <= TOLERANCE or (error >= 0.5 * before and error <= 1e-10):
                return self._point(z, terms, matrix, step, error)
            if STALE * before < error:
                near = None
            before = error
            if normal is None:
                move = np.linalg.lstsq(matrix, residual)[0]
            else:
                full = np.vstack([matrix, normal])
                move = np.linalg.lstsq(full, np.append(residual, normal @ (z - guess)))[0]
            z = z - move
            if not np.all(np.isfinite(z)) or np.max(np.abs(z - guess)) > 1.0:
                return None
        return None

    def _point(self, z: Array, terms: Terms, matrix: Array, step: int, error: float) -> CurvePoint:
        tangent = np.asarray(np.linalg.svd(matrix)[2][-1], np.float64)
        _, values, kappa = self.split(z)
        return CurvePoint(z, terms, tangent, values, kappa, step, error, self, matrix)

    def tests(self, point: CurvePoint) -> dict[str, float]:
        """Give the numbers whose signs change at points of codimension two."""
        found = self.regular(point)
        if self.kind in ("period_doubling", "pitchfork"):
            found[CUBIC] = self.cubic(point.terms, precise=False)
        own = self.critical.segment if isinstance(self.critical, Grazing) else -1
        return found | self._second_events(point.terms, own)

    def cubic(self, terms: Terms, *, precise: bool) -> float:
        """Give a number that vanishes with the cubic coefficient."""
        return cubic_test(terms, self.scale[: len(self.sizes)], self.sizes, precise=precise)

    def regular(self, point: CurvePoint) -> dict[str, float]:
        """Give those of the matrix and the speeds before impacts."""
        terms, matrix, kappa = point.terms, point.matrix, point.kappa
        assert matrix is not None
        own = self.critical.segment if isinstance(self.critical, Grazing) else -1
        found = {
            f"grazing {s}": float(terms.rates[s])
            for s, it in enumerate(terms.frame.word)
            if it.kind in "ISZ" and s != own
        }
        sign, size = np.linalg.slogdet(terms.matrix(-1.0))
        doubling = float(sign * np.exp(min(size, 300.0)))
        sign, size = np.linalg.slogdet(terms.matrix(1.0))
        fold = float(sign * np.exp(min(size, 300.0)))
        if self.kind == "fold":
            n = len(self.sizes)
            v = np.linalg.svd(terms.matrix())[2][-1]
            assert isinstance(self.critical, Singular)
            v *= np.sign(v @ self.critical.c)
            found["cusp"] = float(matrix[n, :n] @ (v / self.scale[:n]))
            found["fold_flip"] = doubling
        elif isinstance(self.critical, Singular):
            found["fold_flip"] = fold
        elif isinstance(self.critical, Turning):
            found |= {name: kappa - value for name, value in KAPPAS.items()}
        else:
            touches = "resonant_grazing" if own >= 0 else "fold"
            found |= {touches: fold, "period_doubling": doubling}
        return found

    def _second_events(self, terms: Terms, own: int) -> dict[str, float]:
        """Give what must be positive of a motion, by the event at which it begins to be."""
        found: dict[str, float] = {}
        near = 1e-6 * abs(terms.length)
        ends = terms.x[own, -1] + np.array([-1, 0, 1]) * terms.length if own >= 0 else np.empty(0)
        for low in Margins(terms).lows:
            # the impact that grazes is a touch of its gap, too
            touches = low.kind == "interior_impact" and np.any(np.abs(ends - low.t) < near)
            if low.kind not in ("grazing", self.kind) and not touches:
                found[low.kind] = min(found.get(low.kind, np.inf), low.value / low.size)
        spans = [
            x[-1] - x[0] for x, it in zip(terms.x, terms.frame.word, strict=True) if not it.contacts
        ]
        if spans and self.kind != "simultaneous":
            found["simultaneous"] = float(min(spans))
        return found

    def renew(self, point: CurvePoint) -> None:
        """Take the borders of a point."""
        self.critical = self.critical.renewed(point.terms, point.kappa)

    def named(self, one: CurvePoint, other: CurvePoint) -> list[Named]:
        """Find the points of codimension two between two points."""
        found = []
        for name, value in one.tests.items():
            if value * other.tests.get(name, value) < 0.0:
                point = located(self, one, other, functools.partial(_test, name))
                if point is not None and abs(point.tests[name]) < abs(value):
                    found.append(Named(name.split()[0], point))
        chord = other.z - one.z
        return sorted(found, key=lambda it: float((it.point.z - one.z) @ chord))


def critical_of(kind: str, terms: Terms, kappa: float) -> Critical:
    """Give what vanishes along the curve of an event."""
    if kind == "fold":
        return Singular.of(terms, 1.0)
    if kind in ("period_doubling", "pitchfork"):
        return Singular.of(terms, -1.0)
    if kind == "neimark_sacker":
        return Turning.of(terms, kappa)
    if kind in ("contact_ends", "simultaneous"):
        lows = [it for it in Margins(terms).lows if it.kind == kind]
        low = min(lows, key=lambda it: abs(it.value) / it.size, default=None)
        spans = np.abs(terms.x[:, -1] - terms.x[:, 0])
        apart = float(np.min(spans)) / abs(terms.length)
        if kind == "simultaneous" and (low is None or apart < abs(low.value) / low.size):
            return Margin(kind, int(np.argmin(spans)), -1)
        assert low is not None
        in_time = kind == "simultaneous" and low.gap == terms.frame.word[low.segment].gap
        return Margin(kind, low.segment, -1 if in_time else low.gap)
    hits = [s for s, it in enumerate(terms.frame.word) if it.kind in "ISZ"]
    return Grazing(min(hits, key=lambda s: abs(float(terms.rates[s]))))


def run(
    line: Line, start: CurvePoint, spans: Array, step: float, most: int, sign: float
) -> tuple[list[CurvePoint], list[Named], OrbitStatus]:
    """Follow a curve in one direction."""
    last = dataclasses.replace(start, tangent=sign * start.tangent)
    points, longest = [last], 5.0 * step
    named: list[Named] = []
    while len(points) < most:
        line.renew(last)
        new = None
        while step > 1e-7:
            new = line.correct(last.z + step * last.tangent, last.tangent)
            if new is not None and new.tangent @ last.tangent < 0.0:
                new = dataclasses.replace(new, tangent=-new.tangent)
            if new is None or new.tangent @ last.tangent < 0.9:
                step, new = 0.5 * step, None
                continue
            step = min(1.4 * step, longest) if new.corrections <= 4 else step
            break
        if new is None:
            return points, named, OrbitStatus.NOT_CONVERGED
        outside = np.any((new.values < spans[:, 0]) | (new.values > spans[:, 1]))
        if outside:
            new = _at_edge(line, last, new, spans)
        if new is not None:
            named += line.named(last, new)
            points.append(new)
        if outside or new is None:
            return points, named, OrbitStatus.RANGE_END
        if _closes(points, start):
            return points, named, OrbitStatus.CLOSED
        last = new
    return points, named, OrbitStatus.MAX_POINTS


def _at_edge(line: Line, last: CurvePoint, new: CurvePoint, spans: Array) -> CurvePoint | None:
    """Give the point where the curve leaves the range."""
    parts = []
    for k in (0, 1):
        for end in spans[k]:
            moved = new.values[k] - last.values[k]
            part = (end - last.values[k]) / moved if moved else -1.0
            beyond = (new.values[k] - end) * (last.values[k] - end) < 0.0
            if beyond and 0.0 <= part <= 1.0:
                parts.append((float(part), k, float(end)))
    if not parts:
        return None
    part, k, end = min(parts)
    guess = last.z + part * (new.z - last.z)
    place = len(line.sizes) + k
    normal = np.zeros(len(guess))
    normal[place], guess[place] = 1.0, end / line.scale[place]
    point = line.correct(guess, normal)
    if point is not None and point.tangent @ last.tangent < 0.0:
        point = dataclasses.replace(point, tangent=-point.tangent)
    return point


def _closes(points: list[CurvePoint], start: CurvePoint) -> bool:
    if len(points) < 8:
        return False
    last, new = points[-2], points[-1]
    chord = new.z - last.z
    part = float((start.z - last.z) @ chord / (chord @ chord))
    off = last.z + part * chord - start.z
    return 0.0 <= part <= 1.0 and bool(np.linalg.norm(off) < 0.1 * np.linalg.norm(chord))
