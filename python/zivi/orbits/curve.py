"""`zivi.continue_curve`: events of orbits in two parameters."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from zivi.base.check import Array, finite, integer
from zivi.base.table import Field, ResultTable, Tabulated
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.arc import about, end_of_rest, shortest_rest, with_duration
from zivi.orbits.critical import (
    Critical,
    Grazing,
    Margin,
    Singular,
    Turning,
    Values,
    crossed,
    cubic_test,
)
from zivi.orbits.equations import Frame, Terms, evaluate, sizes_of
from zivi.orbits.flows import FlightError
from zivi.orbits.orbit import (
    BranchEvent,
    MechanicalEvent,
    MechanicalOrbit,
    PeriodicOrbit,
    with_failed,
)
from zivi.orbits.path import Constraint, Margins, Path, Point, located, moved_frame, value_of
from zivi.orbits.words import FOUND, NotDifferentiable, orbit_of_mechanism, recent, rolled
from zivi.simulation.run import pair, simulate

# Curves of events in two parameters.

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
    """Return one of the numbers whose signs change; NaN for an unknown name."""
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
        """Return the point at an event."""
        values = [value_of(self.frame.system, name) for name in self.names]
        extra = [kappa] if self.critical.with_kappa else []
        z = np.concatenate([y, values, extra]) / self.scale
        return self.correct(z, None)

    def split(self, z: Array) -> tuple[Array, Array, float]:
        """Return unknowns, parameters and kappa."""
        full, n = z * self.scale, len(self.sizes)
        return full[:n], full[n : n + 2], float(full[n + 2]) if self.critical.with_kappa else 0.0

    def system(self, z: Array, near: Slopes | None = None) -> tuple[Terms, Array, Array, Slopes]:
        """Return terms, what must vanish, its scaled derivative, and slopes to lend."""
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
        """Return the derivative by a parameter, by a difference: only the convergence needs it."""
        h = STEP * max(abs(value), 1e-2)
        ahead = evaluate(moved_frame(terms.frame, {name: value + h}), terms.y)
        moved = (ahead.residual - terms.residual) / h
        if self.critical.is_measured:
            return np.append(moved, self.critical.rise(terms, ahead) / h)
        change = self.critical.matrix(ahead, kappa) - self.critical.matrix(terms, kappa)
        return np.append(moved, self.critical.by_matrix(found, change / h))

    def _weight(self, rows: Array) -> float:
        """Return the scale of the condition: its derivative with respect to the unknowns."""
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
        """Return the numbers whose signs change at points of codimension two."""
        found = self.regular(point)
        if self.kind in ("period_doubling", "pitchfork"):
            found[CUBIC] = self.cubic(point.terms, precise=False)
        own = self.critical.segment if isinstance(self.critical, Grazing) else -1
        return found | self._second_events(point.terms, own)

    def cubic(self, terms: Terms, *, precise: bool) -> float:
        """Return a number that vanishes with the cubic coefficient."""
        return cubic_test(terms, self.scale[: len(self.sizes)], self.sizes, precise=precise)

    def regular(self, point: CurvePoint) -> dict[str, float]:
        """Return those of the matrix and the speeds before impacts."""
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
        """Return the quantities that are positive on an admissible motion, by their event."""
        found: dict[str, float] = {}
        near = 1e-6 * abs(terms.length)
        ends = terms.x[own, -1] + np.array([-1, 0, 1]) * terms.length if own >= 0 else np.empty(0)
        for low in Margins(terms).lows:
            # the grazing impact is also a touch of its gap
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
        """Compute the borders at a point."""
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
    """Return the condition that holds along the curve of an event."""
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
    """Return the point where the curve leaves the range."""
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


# The end of rest in two parameters: its one-parameter event, again and again.

ASIDE = (0.0, 0.02, 0.05, 0.1, 0.2)
"""How far on the side of rest an orbit is looked for, relative to the expected one."""
RESTING = 0.02
"""The duration of the rests, in lengths of the word, from which ends are told."""
RETURNS = 12
"""Lengths of the word that are simulated where an orbit is not near the last one."""
LEAST_SPACING = 0.02
"""A step of the second parameter below this part of the first is given up."""
Names = tuple[str, str]


def rest_curve(
    event: BranchEvent | MechanicalEvent, names: Names, ranges: Array, step: float, most: int
) -> tuple[Array, list[CurvePoint], OrbitStatus]:
    """Return the values of both parameters, sorted by the second, and the orbits there."""
    ends = _Ends(event, names)
    second = ends.second
    spacing = 2.5 * step * float(np.ptp(ranges[1]))
    sides: list[list[Array]] = []
    kept: list[list[CurvePoint]] = []
    status = OrbitStatus.RANGE_END
    for sign in (-1.0, 1.0):
        ends.begin()
        found, points = [np.array([event.value, second])], [ends.first()]
        behind = sides[0][1] if sides and len(sides[0]) > 1 else None
        far = spacing
        while len(found) < most // 2:
            value = found[-1][1] + sign * far
            if (value - ranges[1, 0]) * (value - ranges[1, 1]) > 0.0:
                value = float(ranges[1, 0] if sign < 0.0 else ranges[1, 1])
            if abs(value - found[-1][1]) < 1e-12:
                break
            expected, last = found[-1][0], found[-2] if len(found) > 1 else behind
            if last is not None:
                slope = (found[-1] - last)[0] / (found[-1] - last)[1]
                expected += slope * (value - found[-1][1])
            end = ends.at(value, float(expected))
            if end is None:
                far *= 0.5
                if far < LEAST_SPACING * spacing:
                    status = OrbitStatus.NOT_CONVERGED
                    break
                continue
            far = min(2.0 * far, spacing)
            if not ranges[0, 0] <= end <= ranges[0, 1]:
                break
            found.append(np.array([end, value]))
            points.append(ends.point)
        sides.append(found)
        kept.append(points)
    values = np.array([*sides[0][:0:-1], *sides[1]])
    return values, [*kept[0][:0:-1], *kept[1]], status


class _Ends:
    """The ends of rest: each from an orbit whose rest has one duration."""

    point: CurvePoint

    def __init__(self, event: BranchEvent | MechanicalEvent, names: Names) -> None:
        self.event, self.names = event, names
        frame, y = event.orbit._frame, event.orbit._y
        path = Path(frame, names[0], y, abs(event.value) or 1.0)
        near = [path.start(y, value_of(frame.system, names[0]))]
        short = shortest_rest(near[0])
        if short is None:
            raise ValueError("event: its orbit does not have a contact")
        self.short, self.duration = short, RESTING * abs(near[0].terms.length)
        self.second = value_of(frame.system, names[1])
        self.start = near[0]
        if (origin := _lasting(path, near, short, self.duration)) is None:
            raise ValueError("event: the orbits before it could not be found")
        self.origin = origin
        self.begin()

    def begin(self) -> None:
        """Start again from the event."""
        self.near = [(self.second, self.origin)]

    def first(self) -> CurvePoint:
        """Return the orbit of the event."""
        return _kept(self.start, np.array([self.event.value, self.second]))

    def at(self, second: float, expected: float) -> float | None:
        """Find the end of rest at a value of the second parameter."""
        (there, last), (before, other) = self.near[-1], self.near[-2:][0]
        y, first = last.terms.y, last.value
        if there != before:
            part = (second - there) / (there - before)
            y, first = y + part * (y - other.terms.y), first + part * (first - other.value)
        inwards = self.origin.value - self.event.value
        for aside in ASIDE:
            value = float(first) + math.copysign(aside * first, inwards)
            pair_of = self._found(last, y, second, value)
            if pair_of is not None:
                break
        else:
            return None
        path, found, nearer = pair_of
        wide = 10.0 * max(abs(nearer.value - found.value), abs(expected - found.value))
        end = end_of_rest(path, [found, nearer], (found.value - wide, found.value + wide))
        if end is None:
            return None
        self.near.append((second, found))
        self.point = _kept(end[0], np.array([end[0].value, second]))
        return end[0].value

    def _found(
        self, last: Point, y: Array, second: float, first: float
    ) -> tuple[Path, Point, Point] | None:
        """Find orbits with rests of full and of shorter duration, from one near the parameters."""
        try:
            frame = moved_frame(last.terms.frame, {self.names[1]: second, self.names[0]: first})
            path = Path(frame, self.names[0], y, abs(self.event.value) or 1.0)
            near = dataclasses.replace(last, z=path.scaled(y, first))
            found = with_duration(path, [near], self.short, self.duration)
        except (FlightError, ValueError, ArithmeticError):
            found = None
        try:
            if found is None:
                y = self._simulated(last, frame)
                path = Path(frame, self.names[0], y, abs(self.event.value) or 1.0)
                start = path.at_value(path.scaled(y, first), first)
                found = start and _lasting(path, [start], self.short, self.duration)
            nearer = found and with_duration(path, [found], self.short, 0.7 * self.duration)
        except (FlightError, NotDifferentiable, ValueError, ArithmeticError):
            return None
        return None if found is None or nearer is None else (path, found, nearer)

    def _simulated(self, last: Point, frame: Frame) -> Array:
        """Return the unknowns of the word as a run from the middle of the rest shows them."""
        terms, s = last.terms, self.short.segment
        word, (begin, *z, end) = terms.frame.word, terms.x[s]
        t, length = 0.5 * (begin + end), frame.length * (1 if frame.turn is None else 2)
        state = frame.flow.path(word[s].contacts, begin, np.array(z), np.array([t]))[0]
        span = (t, t + RETURNS * length)
        run = simulate(frame.system, span, frame.flow.initial(state), frame.method)
        multiple = self.event.orbit.multiple
        new, x, *_ = recent(
            frame.system, run, multiple, length / multiple, frame.free, frame.method
        )
        turns = [rolled(new.word, x, length, k) for k in range(len(x))]
        own = next((x for turn, x in turns if turn == word), None)
        if own is None:
            raise ValueError("the event sequence of the run differs")
        own[:, [0, -1]] -= length * round((own[0, 0] - terms.x[0, 0]) / length)
        return frame.joined(own, frame.length)


def _lasting(path: Path, near: list[Point], short: Constraint, duration: float) -> Point | None:
    """Return the orbit with a rest of given duration, from one with another duration."""
    now = float(near[-1].terms.x[short.segment, -1] - near[-1].terms.x[short.segment, 0])
    while now != duration:
        now = min(1.5 * now, duration) if now < duration else max(now / 1.5, duration)
        found = with_duration(path, near[-3:], short, now)
        if found is None:
            return None
        near.append(found)
    return near[-1]


def _kept(point: Point, values: Array) -> CurvePoint:
    return CurvePoint(
        point.z, point.terms, point.tangent, values, 0.0, point.corrections, point.residual
    )


# `zivi.continue_curve`: where an event happens, in two parameters.

KINDS = (
    "fold",
    "period_doubling",
    "pitchfork",
    "neimark_sacker",
    "grazing",
    "interior_impact",
    "contact_ends",
    "simultaneous",
    "end_of_rest",
)
FIELDS: dict[str, Field] = {
    "first": ("point", "", "first parameter"),
    "second": ("point", "", "second parameter"),
    "kappa": ("point", "", "cosine of the angle of the pair that turns"),
    "residual": ("point", "", "largest residual"),
}
MESSAGES = {
    OrbitStatus.RANGE_END: "The curve was followed to the ends of the ranges.",
    OrbitStatus.CLOSED: "The curve is closed.",
    OrbitStatus.MAX_POINTS: "The curve has max_points points.",
    OrbitStatus.NOT_CONVERGED: "No step was short enough for Newton's iteration to converge.",
}


class CodimensionTwo(NamedTuple):
    """A bifurcation of codimension two on a curve.

    Attributes
    ----------
    kind : str
        On a fold ``cusp`` and ``fold_flip``; on a period doubling ``fold_flip`` and
        ``generalized_period_doubling`` (its cubic coefficient vanishes); for a complex pair on the
        unit circle ``resonance_1_1`` to ``resonance_1_4``; for a grazing ``resonant_grazing`` (a
        curve of folds touches there) and ``period_doubling``; for a contact end or two simultaneous
        events ``fold`` and ``period_doubling``. On all of them what ends a motion: ``grazing`` (of
        another impact), ``interior_impact``, ``contact_ends``, ``end_of_rest``, ``opening``,
        ``simultaneous``.
    values : ndarray
        Both parameters.
    orbit : MechanicalOrbit
        The orbit there.
    """

    kind: str
    values: Array
    orbit: MechanicalOrbit


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class EventCurve(Tabulated):
    """Where an event happens, in two parameters.

    Attributes
    ----------
    kind : str
        The event.
    names : (str, str)
        The parameters.
    values : ndarray
        Their values along the curve, shape (k, 2).
    kappa : ndarray
        Of turning pairs the cosine of their angle, else NaN, shape (k,).
    residual : ndarray
        The largest residual of each point, relative to the size of the motion, shape (k,).
    points : list of CodimensionTwo
        Points of codimension two, in order.
    status : OrbitStatus
        ``RANGE_END``, ``CLOSED``, ``MAX_POINTS`` or ``NOT_CONVERGED``, of both ends.
    message : str
        What happened.
    """

    kind: str
    names: tuple[str, str]
    values: Array
    kappa: Array
    residual: Array
    points: list[CodimensionTwo]
    status: OrbitStatus
    message: str
    _found: list[CurvePoint]
    _multiple: int

    def __len__(self) -> int:
        return len(self.values)

    def orbits(self, i: int) -> MechanicalOrbit:
        """Return the orbit at a point of the curve.

        Parameters
        ----------
        i : int
            Which. At an end of rest it is the shortest rest that was computed.

        Returns
        -------
        MechanicalOrbit
            See its attribute ``admissible``.
        """
        return orbit_at(self._found[i], self._multiple)

    @property
    def admissible(self) -> np.ndarray:
        """Whether the orbit is a motion at each point."""
        return np.array([_why_not(it) is None for it in self._found], dtype=bool)

    def of_kind(self, kind: str) -> list[CodimensionTwo]:
        """Return the points of codimension two of one kind.

        Parameters
        ----------
        kind : str
            As in `CodimensionTwo`.

        Returns
        -------
        list of CodimensionTwo
            In the order of the curve.
        """
        return [point for point in self.points if point.kind == kind]

    def switch(self, point: CodimensionTwo) -> MechanicalOrbit:
        """Return the orbit at a point of codimension two, from where other branches begin.

        Parameters
        ----------
        point : CodimensionTwo
            One of `points`.

        Returns
        -------
        MechanicalOrbit
            The orbit there.
        """
        return point.orbit

    def _failed_text(self) -> str:
        failed = text_of_failures(self._found)
        return f", {failed}" if failed else ""

    def _table(self) -> ResultTable:
        values = {"first": self.values[:, 0], "second": self.values[:, 1]}
        attrs = {
            "kind": self.kind,
            "names": list(self.names),
            "status": self.status.name,
            "points": [point.kind for point in self.points],
        }
        return ResultTable("Curve of an event in two parameters", FIELDS, {}, values, attrs)

    def __repr__(self) -> str:
        listed = ", ".join(
            f"{it.kind} at ({it.values[0]:.9g}, {it.values[1]:.9g})" for it in self.points
        )
        return (
            f"<EventCurve of {self.kind} over {self.names[0]} and {self.names[1]}, "
            f"{len(self)} points: {listed or 'nothing else'}{self._failed_text()}; "
            f"{self.status.name.lower()}>"
        )


def continue_curve(
    event: MechanicalEvent | BranchEvent,
    names: Sequence[str],
    spans: Sequence[Sequence[float]],
    *,
    step: float = 0.02,
    max_points: int = 400,
) -> EventCurve:
    """Follow an event of a branch in two parameters, in both directions.

    Parameters
    ----------
    event : MechanicalEvent or BranchEvent
        A ``fold``, ``period_doubling``, ``pitchfork``, ``neimark_sacker``, ``grazing``,
        ``interior_impact``, ``contact_ends``, ``simultaneous`` or ``end_of_rest`` of a branch; of
        one mass not ``rest_appears`` and ``end_of_liftoff``. For an end of rest the first parameter
        is that of its branch.
    names : (str, str)
        The parameters (see `continue_orbit`).
    spans : ((float, float), (float, float))
        Their ranges.
    step : float
        The first step along the curve, relative to the ranges and the motion. Steps adapt.
    max_points : int
        Most points.

    Returns
    -------
    EventCurve
        What was found, with its status.

    Raises
    ------
    ValueError
        For another kind of event, a parameter that there is not, a range that is none.

    See Also
    --------
    continue_orbit : the branch with the bifurcation.
    zivi.plot.chart : draw curves of bifurcations.

    Notes
    -----
    The equations of the orbit are extended by the condition of the bifurcation and continued in two
    parameters by pseudo-arclength; points of codimension two are zeros of further test functions.
    The added equations are listed in the section "Curves in two parameters" of orbit_theory.md.

    References
    ----------
    Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, 3rd ed., Springer, 2004.

    M. di Bernardo et al., Piecewise-smooth Dynamical Systems, Springer, 2008.

    Examples
    --------
    >>> table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    >>> orbit = zivi.periodic_orbit(zivi.ImpactSystem(table, e=0.5), [(0.6, 2.1)])
    >>> branch = zivi.continue_orbit(orbit, "amplitude", (1.0, 1.6))
    >>> fold = branch.of_kind("fold")[0]
    >>> curve = zivi.continue_curve(fold, ("amplitude", "e"), ((0.1, 2.0), (0.3, 0.9)))
    >>> amplitude, e = curve.values.T
    >>> bool(np.max(np.abs(amplitude - np.pi * (1 - e) / (1 + e))) < 1e-11)
    True
    """
    if not isinstance(event, MechanicalEvent | BranchEvent):
        raise TypeError(f"event must be one of a branch, got {event!r}")
    if event.kind not in KINDS:
        raise ValueError(f"event must be one of {', '.join(KINDS)}, got {event.kind!r}")
    rests = event.kind == "end_of_rest"
    both = tuple(str(name) for name in names)
    if len(both) != 2 or both[0] == both[1]:
        raise ValueError(f"names must be two different parameters, got {both!r}")
    if len(spans) != 2:
        raise ValueError("spans must be two ranges, ((low, high), (low, high))")
    ranges = np.array(
        [[finite("spans", end) for end in pair("spans", it, "(low, high)")] for it in spans]
    )
    if isinstance(event, BranchEvent) and "e" in both:
        ranges[both.index("e")] = ranges[both.index("e")].clip(0.0, 1.0)
    orbit: Any = event.orbit
    if isinstance(event, BranchEvent) and not rests:
        orbit = _of_one_mass(event.orbit)
    for name, (low, high) in zip(both, ranges, strict=True):
        value = value_of(orbit.system, name)
        if not low <= value <= high or low == high:
            raise ValueError(
                f"spans must contain {name} = {value} of the event, got ({low}, {high})"
            )
    if not 0.0 < finite("step", step) < 1.0:
        raise ValueError(f"step must be in (0, 1), got {step}")
    if integer("max_points", max_points) < 2:
        raise ValueError(f"max_points must be >= 2, got {max_points}")
    if rests:
        if isinstance(event, MechanicalEvent) and event.name != both[0]:
            raise ValueError(f"names must begin with that of the branch, {event.name!r}")
        of_rest = rest_curve(event, (both[0], both[1]), ranges, step, max_points)
        return _of_rest((both[0], both[1]), *of_rest, orbit.multiple)
    frame, y = _critical_word(event, orbit)
    kappa = getattr(event, "kappa", None)
    if kappa is None and event.kind == "neimark_sacker":
        turning = orbit.multipliers[np.imag(orbit.multipliers) > 0.0]
        kappa = float(np.real(turning[0]) / np.abs(turning[0]))
    found = _both_directions(
        event.kind, frame, y, (both[0], both[1]), ranges, step, max_points, kappa
    )
    return _curve(event.kind, (both[0], both[1]), found, orbit.multiple)


def _of_one_mass(orbit: PeriodicOrbit) -> MechanicalOrbit:
    """Return an orbit of one mass with its word."""
    if orbit.kind == "resting":
        raise ValueError("event: the only curve of a resting orbit of one mass is that of its end")
    terms, done = evaluate(orbit._frame, orbit._y), OrbitStatus.COMPLETED
    return orbit_of_mechanism(terms, orbit.multiple, orbit.residual, 0, done, FOUND)


def _both_directions(
    kind: str,
    frame: Frame,
    y: Array,
    names: tuple[str, str],
    ranges: Array,
    step: float,
    most: int,
    kappa: float | None,
) -> tuple[list[CurvePoint], list[Named], OrbitStatus]:
    line = Line(kind, frame, y, names, np.ptp(ranges, axis=1), kappa or 0.0)
    start = line.start(y, kappa or 0.0)
    if start is None:
        raise ValueError("event: its equations could not be solved")
    borders = line.critical
    ahead = run(line, start, ranges, step, most // 2 + 1, 1.0)
    if ahead[2] is OrbitStatus.CLOSED:
        return ahead
    line.critical = borders
    back = run(line, start, ranges, step, most - len(ahead[0]) + 1, -1.0)
    order = list(MESSAGES)
    status = max(ahead[2], back[2], key=order.index)
    return back[0][:0:-1] + ahead[0], back[1][::-1] + ahead[1], status


def _curve(
    kind: str,
    names: tuple[str, str],
    found: tuple[list[CurvePoint], list[Named], OrbitStatus],
    multiple: int,
) -> EventCurve:
    points, named, status = found
    turning = kind == "neimark_sacker"
    return EventCurve(
        kind=kind,
        names=names,
        values=np.array([it.values for it in points]),
        kappa=np.array([it.kappa if turning else np.nan for it in points]),
        residual=np.array([it.residual for it in points]),
        points=[
            CodimensionTwo(it.kind, it.point.values, orbit_at(it.point, multiple)) for it in named
        ],
        status=status,
        message=with_failed(MESSAGES[status], text_of_failures(points)),
        _found=points,
        _multiple=multiple,
    )


def _of_rest(
    names: tuple[str, str],
    values: Array,
    found: list[CurvePoint],
    status: OrbitStatus,
    multiple: int,
) -> EventCurve:
    none = np.full(len(values), np.nan)
    residual = np.array([it.residual for it in found]) if found else none
    message = with_failed(MESSAGES[status], text_of_failures(found))
    return EventCurve(
        "end_of_rest", names, values, none, residual, [], status, message, found, multiple
    )


def text_of_failures(found: list[CurvePoint]) -> str:
    """Describe at how many points the orbit is inadmissible; "" if at none."""
    number = sum(_why_not(it) is not None for it in found)
    return f"{number} of {len(found)} points where the orbit is inadmissible" if number else ""


def _critical_word(event: Any, orbit: MechanicalOrbit) -> tuple[Frame, Array]:
    """Return the word of an event: with the impact that is about to begin."""
    smooth = all(it.kind == "P" for it in orbit._frame.word)
    if event.kind == "contact_ends" and smooth and isinstance(orbit._frame.section, float):
        return _around_least_force(orbit)
    if event.kind != "interior_impact":
        return orbit._frame, orbit._y
    terms = evaluate(orbit._frame, orbit._y)
    own = [low for low in Margins(terms).lows if low.kind == "interior_impact"]
    beyond = crossed(terms, min(own, key=lambda it: abs(it.value))) if own else None
    if beyond is None:
        raise ValueError("event: no minimum of a gap was found at which to insert an impact")
    return beyond


def _around_least_force(orbit: MechanicalOrbit) -> tuple[Frame, Array]:
    """Move the section of a motion without events away from the minimum of a force."""
    terms = evaluate(orbit._frame, orbit._y)
    lows = [it for it in Margins(terms).lows if it.kind == "contact_ends"]
    return about(terms, min(lows, key=lambda it: it.value / it.size).t)


def _why_not(point: CurvePoint) -> str | None:
    """Return why a point is inadmissible; None if it is admissible."""
    return Margins(point.terms).why_not(1e-9, grazing=True)


def orbit_at(point: CurvePoint, multiple: int) -> MechanicalOrbit:
    """Return the orbit at a point."""
    why = _why_not(point)
    status = OrbitStatus.COMPLETED if why is None else OrbitStatus.LEFT_ADMISSIBLE
    message = why or "A point of a curve."
    return orbit_of_mechanism(
        point.terms, multiple, point.residual, point.corrections, status, message
    )
