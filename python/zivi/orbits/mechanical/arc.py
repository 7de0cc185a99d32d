"""One direction of a branch: arcs of one word each, and what happens on them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.crossing import crossed
from zivi.orbits.mechanical.equations import row_sizes
from zivi.orbits.mechanical.family import value_of
from zivi.orbits.mechanical.margins import Low, Margins
from zivi.orbits.mechanical.path import (
    Path,
    Point,
    bordered,
    located,
    located_near,
    sigma,
)
from zivi.orbits.mechanical.reopening import is_vanishing, rejoined, reopened
from zivi.orbits.mechanical.rest_appears import rest_beyond
from zivi.orbits.mechanical.resting import end_of_rest, is_near
from zivi.orbits.mechanical.word import Word

__all__ = ["Arc", "Found", "Way", "single_doubling"]

EDGE = 1e-10
"""How far below zero, relative to its size, what must be positive counts as zero."""
PROBE = 1e-4
TOGETHER = 1e-7
"""Parts of a step that are no further apart are one place."""
HALVES_MEET = 1e-4
"""Half differences that are less, relative to the motion, are those of a single orbit."""
ROUNDING = 1e-9
CIRCLE = 1e-6
"""How near the unit circle a located pair must be."""
ALIGNED = 0.9
BEGIN = ("grazing", "interior_impact", "end_of_rest")
"""Events at which a branch may begin, to the side without a motion too."""
SHORT = 0.01
"""The first step where a contact, or its end, lasts a short time, relative to the longest."""


OPENING = ("contact_ends", "opening")
"""Beyond them a contact opens for a short time."""
VANISHING = ("grazing", "simultaneous", "end_of_rest")
"""What may be negative where that time is over."""


class Found(NamedTuple):
    """An event of a branch."""

    kind: str
    point: Point
    low: Low | None = None


@dataclasses.dataclass
class Arc:
    """Points of one word, in order."""

    path: Path
    points: list[Point]
    events: list[Found] = dataclasses.field(default_factory=list)
    sided: bool = False
    """Whether an orbit a little beyond its start was seen to be a motion."""


class Way:
    """The way along a branch in one direction, from word to word."""

    def __init__(
        self,
        path: Path,
        start: Point,
        span: tuple[float, float],
        step: float,
        most: int,
        *,
        through: bool,
        beyond: int = 0,
    ) -> None:
        self.span, self.step, self.most, self.through = span, step, most, through
        self.status = OrbitStatus.MAX_POINTS
        self.beyond, self.out = beyond, 0
        """How many points where the orbit is no motion any more, and those so far."""
        self.first, self.longest = start, 5.0 * step
        self.arcs = [Arc(path, [start])]
        self.count = 1
        self.passed: list[tuple[str, tuple[object, ...], tuple[object, ...], float, Array]] = []

    def go(self) -> OrbitStatus:
        """Follow the branch to its end."""
        while self.count < self.most:
            status = self._advance()
            if status is not None:
                self.status = status
                break
        return self.status

    def _advance(self) -> OrbitStatus | None:
        arc = self.arcs[-1]
        last = arc.points[-1]
        if self.through and is_vanishing(arc.points) and self._join(arc, last):
            return None
        rests = is_near(arc.points)
        new = None if rests else self._next(arc.path, last)
        rest = end_of_rest(arc.path, arc.points, self.span) if new is None else None
        if rest is not None:
            self._look(arc, last, rest[0])
            arc.points.append(rest[0])
            arc.events.append(Found("end_of_rest", rest[0], rest[1]))
            return OrbitStatus.LEFT_ADMISSIBLE
        new = self._next(arc.path, last) if rests else new
        if new is None:
            joins = self.through and self._join(arc, last)
            return None if joins else OrbitStatus.NOT_CONVERGED
        if not self.span[0] <= new.value <= self.span[1]:
            return self._end_of_range(arc, last, new)
        if self.out and self._is_out(last):
            return self._beyond(arc, new)
        edge = self._edge(arc, last, new)
        if edge is not None and edge.point is last and arc.sided and self.step > PROBE:
            # the word is a motion on this side: where impacts begin one soon after the other, the
            # step went beyond the next ones
            self.step *= 0.1
            return None
        if edge is not None:
            return self._over(arc, last, edge, new)
        if self._mirrored(last, new):
            return OrbitStatus.RETRACED
        self._look(arc, last, new)
        arc.points.append(new)
        self.count += 1
        return OrbitStatus.CLOSED if self._closes(arc, last, new) else None

    def _next(self, path: Path, last: Point) -> Point | None:
        while self.step > 1e-8:
            new = path.correct(last.z + self.step * last.tangent, last.tangent)
            if new is not None and new.tangent @ last.tangent < 0.0:
                new = dataclasses.replace(new, tangent=-new.tangent)
            if new is None or new.tangent @ last.tangent < ALIGNED:
                self.step *= 0.5
                continue
            if new.corrections <= 3:
                self.step = min(1.4 * self.step, self.longest)
            elif new.corrections > 5:
                self.step *= 0.6
            return new
        self.step = 1e-3 * self.longest
        return None

    def _end_of_range(self, arc: Arc, last: Point, new: Point) -> OrbitStatus | None:
        end = self.span[0] if new.value < self.span[0] else self.span[1]
        part = (end - last.value) / (new.value - last.value)
        point = arc.path.at_value(last.z + part * (new.z - last.z), end)
        if point is None:
            return OrbitStatus.RANGE_END
        if point.tangent @ last.tangent < 0.0:
            point = dataclasses.replace(point, tangent=-point.tangent)
        edge = None if self.out and self._is_out(last) else self._edge(arc, last, point)
        if edge is not None:
            over = self._over(arc, last, edge, point)
            return over or (OrbitStatus.RANGE_END if self.beyond else None)
        self._look(arc, last, point)
        arc.points.append(point)
        self.count += 1
        return OrbitStatus.RANGE_END

    def _is_out(self, point: Point) -> bool:
        return any(low.value < -EDGE * low.size for low in point.margins.lows)

    def _beyond(self, arc: Arc, new: Point) -> OrbitStatus | None:
        """Note a point beyond an event, as far as such points are followed."""
        arc.points.append(new)
        self.count += 1
        self.out += self._is_out(new)
        return OrbitStatus.LEFT_ADMISSIBLE if self.out >= self.beyond else None

    def _edge(self, arc: Arc, last: Point, new: Point) -> Found | None:
        """Find the first event between two points beyond which the orbit is no motion."""
        behind = new.margins.behind()
        out = [it for it in new.margins.lows if it.value < -EDGE * it.size and it not in behind]
        found: list[tuple[float, Found]] = []
        chord = new.z - last.z
        for low in sorted(out, key=lambda it: it.value / it.size)[:4]:
            test = _watched(low, arc.path.frame.word)
            if test(last) <= EDGE * low.size:
                # it begins on the edge: two lows of one minimum, or a start at an event
                if low.kind in BEGIN and len(arc.points) == 1:
                    found.append((0.0, Found(low.kind, last, low)))
                continue
            point = located(arc.path, last, new, test)
            if point is None:
                continue
            low = min(_same_kind(point.margins, low), key=lambda it: abs(it.value), default=low)
            found.append((float((point.z - last.z) @ chord), Found(low.kind, point, low)))
        if not found:
            return None
        first = min(it[0] for it in found) + TOGETHER * float(chord @ chord)
        # where a doubled orbit meets a single one that grazes one half dies, one begins
        return min((it for it in found if it[0] <= first), key=_order)[1]

    def _over(self, arc: Arc, last: Point, edge: Found, new: Point) -> OrbitStatus | None:
        """Note an event, and go on with the word beyond it."""
        if self.through and edge.kind in VANISHING and self._join(arc, last):
            return None
        self._look(arc, last, edge.point)
        if self.beyond:
            arc.events.append(edge)
            return self._beyond(arc, new)
        if edge.point is not last:
            arc.points.append(edge.point)
            self.count += 1
        arc.events.append(edge)
        if edge.low is not None and self.through and edge.kind in OPENING:
            return self._reopen(arc, edge.point, edge.low)
        if edge.kind == "interior_impact" and self.through:
            rest = rest_beyond(arc.path, edge.point, self.span)
            if rest is not None:
                return self._rest(rest)
        beyond = crossed(edge.point.terms, edge.low) if edge.low and self.through else None
        if beyond is None:
            together = edge.kind == "simultaneous"
            return OrbitStatus.SIMULTANEOUS if together else OrbitStatus.LEFT_ADMISSIBLE
        frame, y = beyond
        before, after = arc.path.frame.word, frame.word
        phases = np.sort(edge.point.terms.x[:, -1] % edge.point.terms.length)
        mark = (edge.kind, _letters(before), _letters(after), edge.point.value, phases)
        if any(it[:3] == mark[:3] and _same(it[3:], mark[3:]) for it in self.passed):
            return OrbitStatus.CLOSED
        self.passed.append(mark)
        try:
            path = Path(frame, arc.path.name, y, float(arc.path.scale[-1]))
            start = path.start(y, edge.point.value)
        except (ValueError, ArithmeticError):
            return OrbitStatus.LEFT_ADMISSIBLE
        sided = self._sided(path, start, float(edge.point.tangent[-1]))
        if sided is None:
            return OrbitStatus.LEFT_ADMISSIBLE
        self.arcs.append(Arc(path, [sided], sided=True))
        self.step = min(self.step, 0.2 * self.longest)
        return None

    def _reopen(self, arc: Arc, edge: Point, low: Low) -> OrbitStatus | None:
        """Go on where a contact opens for a short time."""
        found = reopened(arc.path, edge, low)
        if found is None:
            return OrbitStatus.LEFT_ADMISSIBLE
        self.arcs.append(Arc(found[0], [found[1]]))
        self.count += 1
        self.step = min(self.step, SHORT * self.longest)
        return None

    def _join(self, arc: Arc, last: Point) -> bool:
        """Go on where an opened contact no longer opens, if it does."""
        found = rejoined(arc.path, last)
        if found is None:
            return False
        path, event, low = found
        arc.events.append(Found(low.kind, event, low))
        self.arcs.append(Arc(path, [event]))
        self.count += 1
        self.step = 0.2 * self.longest
        return True

    def _rest(self, rest: tuple[Path, Point, Low]) -> OrbitStatus | None:
        """Go on with an orbit that rests where a chain of impacts became one."""
        path, end, short = rest
        self.arcs[-1].events.append(Found("rest_appears", end, short))
        start = path.start(end.terms.y, value_of(end.terms.frame.system, path.name))
        row = (start.tangent * path.scale)[short.segment * path.frame.size :][: path.frame.size]
        away = start.tangent if row[-1] > row[0] else -start.tangent
        self.arcs.append(Arc(path, [dataclasses.replace(start, tangent=away)]))
        self.count += 1
        self.step = min(self.step, SHORT * self.longest)
        return None

    def _sided(self, path: Path, start: Point, along: float) -> Point | None:
        """Give the start with the tangent to the side on which the word is a motion."""
        sides = []
        for sign in (1.0, -1.0) if along * start.tangent[-1] >= 0.0 else (-1.0, 1.0):
            tangent = sign * start.tangent
            probe = path.correct(start.z + PROBE * tangent, tangent)
            if probe is None:
                continue
            least = probe.margins.least
            sides.append((0.0 if least is None else least.value / least.size, tangent))
        good = [tangent for value, tangent in sides if value > 0.0]
        return dataclasses.replace(start, tangent=good[0]) if good else None

    def _look(self, arc: Arc, last: Point, new: Point) -> None:
        """Find folds, doublings and turning pairs between two points."""
        if new is last:
            return
        found: list[tuple[str, Point]] = []
        symmetric = arc.path.frame.turn is not None
        if last.tangent[-1] * new.tangent[-1] < 0.0 and not _began(last):
            found += [("fold", it) for it in _singular(arc.path, last, new, 1.0)]
        if last.doubling * new.doubling < 0.0:
            kind = "pitchfork" if symmetric else "period_doubling"
            found += [(kind, it) for it in _singular(arc.path, last, new, -1.0)]
        for test in (_pairs, _turning):
            ends = test(last), test(new)
            # without damping and loss it is rounding along the whole branch
            if ends[0] * ends[1] < 0.0 and max(map(abs, ends)) > ROUNDING:
                point = located(arc.path, last, new, test)
                # two real ones whose product is 1 turn nothing
                if point is not None and abs(point.turning) < CIRCLE:
                    found.append(("neimark_sacker", point))
                    break
        chord = new.z - last.z
        for kind, point in sorted(found, key=lambda it: float((it[1].z - last.z) @ chord)):
            arc.events.append(Found(kind, point))

    def _mirrored(self, last: Point, new: Point) -> bool:
        """Whether a doubled orbit is, or passed, the single one: it would retrace itself."""
        before, now = halves_apart(last), halves_apart(new)
        if before is None or now is None:
            return False
        sizes = np.tile(row_sizes(new.terms), len(new.terms.x) // 2)
        apart = [float(np.linalg.norm(it / sizes)) for it in (before, now)]
        return bool(before @ now < 0.0) or apart[1] < min(HALVES_MEET, apart[0])

    def _closes(self, arc: Arc, last: Point, new: Point) -> bool:
        """Whether the branch passes its own start again."""
        if arc is not self.arcs[0] or len(arc.points) < 6:
            return False
        chord = new.z - last.z
        part = float((self.first.z - last.z) @ chord / (chord @ chord))
        if not 0.0 <= part <= 1.0 or new.tangent @ self.first.tangent < 0.5:
            return False
        off = last.z + part * chord - self.first.z
        return bool(np.linalg.norm(off) < 0.1 * np.linalg.norm(chord))


def _order(found: tuple[float, Found]) -> tuple[bool, float]:
    return found[1].kind != "grazing", found[0]


def _pairs(point: Point) -> float:
    return point.pairs


def _turning(point: Point) -> float:
    return point.turning


def _began(point: Point) -> bool:
    return bool(point.tangent[-1] == 0.0)


def _letters(word: tuple[object, ...]) -> tuple[object, ...]:
    """Give a word from the same letter on, wherever it begins."""
    turns = [word[k:] + word[:k] for k in range(len(word))]
    return min(turns, key=repr)


def _same(one: tuple[float, Array], other: tuple[float, Array]) -> bool:
    """Whether a parameter and the times of events are those of an event before."""
    return abs(one[0] - other[0]) < 1e-8 and bool(np.max(np.abs(one[1] - other[1])) < 1e-6)


def _same_kind(margins: Margins, low: Low) -> list[Low]:
    own = [it for it in margins.lows if it[:3] == low[:3]]
    near = [it for it in own if abs(it.t - low.t) < 0.05 * abs(margins.terms.length)]
    return near or own


def _watched(low: Low, word: Word) -> Callable[[Point], float]:
    """Give the test function of what became negative."""
    s = low.segment
    if low.kind == "simultaneous" and low.gap == word[s].gap:
        return lambda point: float(point.terms.x[s, -1] - point.terms.x[s, 0])

    def test(point: Point) -> float:
        own = _same_kind(point.margins, low)
        return min((it.value for it in own), default=1e-3 * low.size)

    return test


def _singular(path: Path, last: Point, new: Point, factor: float) -> list[Point]:
    """Find where the matrix is singular between two points, by its bordered system."""
    sides = [np.linalg.svd(it.terms.matrix(factor), compute_uv=False)[-1] for it in (last, new)]
    borders = bordered((last, new)[int(np.argmin(sides))].terms, factor)

    def test(point: Point) -> float:
        return float(sigma(point.terms, factor, borders))

    point = located(path, last, new, test)
    if point is None:
        return []
    least = float(np.linalg.svd(point.terms.matrix(factor), compute_uv=False)[-1])
    return [point] if least < 1e-7 * max(1.0, max(sides)) else []


def halves_apart(point: Point) -> Array | None:
    """Give half the difference of the halves of an orbit; None if it has no equal halves."""
    frame, x = point.terms.frame, point.terms.x
    k = len(frame.word)
    if k % 2 or frame.turn is not None or frame.word[: k // 2] != frame.word[k // 2 :]:
        return None
    first, second = x[: k // 2], x[k // 2 :].copy()
    second[:, [0, -1]] -= 0.5 * point.terms.length
    return np.asarray((0.5 * (second - first)).ravel(), np.float64)


def single_doubling(path: Path, point: Point) -> Point | None:
    """Find the period doubling of the single orbit at which a doubled one, of a point, begins."""
    apart = halves_apart(point)
    if apart is None:
        return None
    frame, x = point.terms.frame, point.terms.x
    k, length = len(x) // 2, 0.5 * point.terms.length
    half = dataclasses.replace(frame, word=frame.word[:k], length=length)
    try:
        y = half.joined(x[:k] + apart.reshape(k, -1), length)
        single = Path(half, path.name, y, float(path.scale[-1]))
        start = single.at_value(single.scaled(y, point.value), point.value)
    except FlightError:
        return None
    if start is None:
        return None
    borders = bordered(start.terms, -1.0)
    return located_near(single, start, lambda it: float(sigma(it.terms, -1.0, borders)))
