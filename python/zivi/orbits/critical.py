"""Singular points of the orbit equations, and the adjacent event sequences."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.orbits.equations import Frame, Terms, evaluate, sizes_of, whole_word
from zivi.orbits.flows import MOST_LETTERS, FlightError, Segment, Word, uncoupled
from zivi.orbits.path import Constraint, Margins

# Conditions on a curve of events in two parameters, in addition to the orbit's equations.
#
# A fold or a doubling: the number :math:`\sigma` of the bordered system of :math:`J(0)` or
# :math:`J(\pi)`,
#
# .. math:: \begin{pmatrix} J & b \\ c^T & 0 \end{pmatrix}
# \begin{pmatrix} v \\ \sigma \end{pmatrix} = \begin{pmatrix} 0 \\ 1 \end{pmatrix}, \qquad
# d\sigma = -w^T\,dJ\,v.
#
# A pair that turns on the unit circle: the real matrix of it with :math:`\kappa = \cos\theta`
# (`turned` of the equations) has a rank deficiency of two, which includes real pairs at
# :math:`\kappa = \pm 1`; its :math:`\sigma` are two by two. A grazing: the speed of a gap before an
# impact. The end of a contact: the least of its forces. Two simultaneous events: the time between
# them.

CRITICAL_STEP = 1e-5
"""Of differences of the Jacobian: only the convergence depends on it."""


@dataclasses.dataclass(frozen=True)
class Values:
    """Values of the test functions and their derivatives."""

    value: Any
    by_y: Any
    """Derivatives by the unknowns, a row for each value."""
    by_kappa: Any
    right: list[tuple[Any, Any]]
    """A pair ``(w, v)`` for each value: -w dJ v is its change with that of the matrix."""


class Critical:
    """Numbers that vanish along a curve."""

    count = 1
    with_kappa = False
    is_measured = False
    """Whether it is a number of the motion, `measure`, not of the matrix."""

    def measure(self, terms: Terms) -> float:
        """Return the test function."""
        raise NotImplementedError

    def rise(self, terms: Terms, ahead: Terms) -> float:
        """Return its change to adjacent equations, to first order."""
        return self.measure(ahead) - self.measure(terms)

    def at(self, terms: Terms, kappa: float, near: Array | None = None) -> Values:
        """Return the values and their derivatives with respect to the unknowns.

        Those of a point `near` may be taken where only the convergence depends on them.
        """
        raise NotImplementedError

    def matrix(self, terms: Terms, kappa: float) -> Array:
        """Return the matrix that is singular."""
        raise NotImplementedError

    def renewed(self, terms: Terms, kappa: float) -> Critical:
        """Return the same with borders of this point."""
        return self

    def by_matrix(self, values: Values, change: Array) -> Array:
        """Return the change of the values with that of the matrix."""
        return np.array([-w @ change @ v for w, v in values.right])


@dataclasses.dataclass(frozen=True)
class Grazing(Critical):
    """The speed before the impact that ends a segment."""

    segment: int
    is_measured = True

    def measure(self, terms: Terms) -> float:
        """Return the speed."""
        return float(terms.rates[self.segment])

    def at(self, terms: Terms, kappa: float, near: Array | None = None) -> Values:
        """Return the speed and its derivatives."""
        by_y = terms.rate_gradient(self.segment)[None]
        return Values(np.array([self.measure(terms)]), by_y, None, [])


@dataclasses.dataclass(frozen=True)
class Margin(Critical):
    """The least force of a contact, the time between two events, or a gap at another's impact."""

    kind: str
    segment: int
    gap: int
    is_measured = True

    def measure(self, terms: Terms) -> float:
        """Return the force, the time, or the gap."""
        return self._at(terms, terms.x[self.segment], self._part(terms))

    def rise(self, terms: Terms, ahead: Terms) -> float:
        """Return its change; where a force is least its place moves nothing to first order."""
        part, s = self._part(terms), self.segment
        return self._at(ahead, ahead.x[s], part) - self._at(terms, terms.x[s], part)

    def _part(self, terms: Terms) -> float:
        """Return where in the segment the force is least, from 0 to 1."""
        if self.kind == "simultaneous":
            return 1.0
        lows = Margins(terms).between(self.segment, self.gap)
        own = [it for it in lows if (it.kind, it.gap) == (self.kind, self.gap)]
        t0, t1 = float(terms.x[self.segment, 0]), float(terms.x[self.segment, -1])
        if not own or t1 <= t0:
            return 0.0
        return (min(own, key=lambda it: it.value).t - t0) / (t1 - t0)

    def _at(self, terms: Terms, row: Array, part: float) -> float:
        """Return it at a part of a segment, whose times and state are a row."""
        t0, t1 = float(row[0]), float(row[-1])
        if self.kind == "simultaneous" and self.gap < 0:
            return t1 - t0
        flow, contacts = terms.frame.flow, terms.frame.word[self.segment].contacts
        t = np.array([t0 + part * (t1 - t0)])
        z = flow.path(contacts, t0, row[1:-1], t)
        if self.kind == "simultaneous":
            return float(flow.gaps(t, z)[0][0, self.gap])
        return float(flow.reaction(contacts, self.gap, float(t[0]), z[0]).value)

    def at(self, terms: Terms, kappa: float, near: Array | None = None) -> Values:
        """Return the number and its derivatives.

        Where a force is least its place moves nothing to first order.
        """
        frame, part, y = terms.frame, self._part(terms), terms.y

        def value(there: Array) -> float:
            return self._at(terms, frame.split(there)[0][self.segment], part)

        by_y = np.zeros((1, len(y)))
        for k in self._touched(terms):
            h = CRITICAL_STEP * max(1.0, abs(float(y[k])))
            step = np.zeros(len(y))
            step[k] = h
            by_y[0, k] = (value(y + step) - value(y - step)) / (2.0 * h)
        return Values(np.array([value(y)]), by_y, None, [])

    def _touched(self, terms: Terms) -> range:
        """Return the unknowns that it depends on: of segments those of its own."""
        frame, s = terms.frame, self.segment
        if frame.impulses is not None:
            return range(len(terms.y))
        # the first one of a free motion is its length
        return range(s * frame.size + (frame.free and s == 0), (s + 1) * frame.size)


@dataclasses.dataclass(frozen=True)
class Singular(Critical):
    """Where ``J(0)``, with the factor 1, or ``J(pi)``, with -1, is singular."""

    factor: float
    b: Array
    c: Array

    @classmethod
    def of(cls, terms: Terms, factor: float) -> Singular:
        """Compute the borders at a point."""
        left, _, right = np.linalg.svd(terms.matrix(factor))
        return cls(factor, left[:, -1], right[-1])

    def renewed(self, terms: Terms, kappa: float) -> Singular:
        """Return the same with borders of this point, of the signs of these."""
        new = Singular.of(terms, self.factor)
        b, c = new.b * (new.b @ self.b), new.c * (new.c @ self.c)
        return Singular(self.factor, b / np.linalg.norm(b), c / np.linalg.norm(c))

    def matrix(self, terms: Terms, kappa: float) -> Array:
        """Return the matrix that is singular."""
        return np.asarray(terms.matrix(self.factor), np.float64)

    def at(self, terms: Terms, kappa: float, near: Array | None = None) -> Values:
        """Return the number and its derivatives: a cusp shows in them."""
        matrix = self.matrix(terms, kappa)
        n = len(matrix)
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n], whole[n, :n] = matrix, self.b, self.c
        one = np.zeros(n + 1)
        one[n] = 1.0
        v, w = (np.asarray(np.linalg.solve(it, one), np.float64) for it in (whole, whole.T))
        by_y = -terms.curvature(self.factor, w[:n], v[:n])[None]
        return Values(v[n:], by_y, None, [(w[:n], v[:n])])


@dataclasses.dataclass(frozen=True)
class Turning(Critical):
    """Where a pair of multipliers has the product 1 and the sum 2 kappa."""

    b: Array
    c: Array
    count = 4
    with_kappa = True

    @classmethod
    def of(cls, terms: Terms, kappa: float) -> Turning:
        """Compute the borders at a point."""
        left, _, right = np.linalg.svd(terms.turned(kappa)[0])
        return cls(left[:, -2:], right[-2:].T)

    def matrix(self, terms: Terms, kappa: float) -> Array:
        """Return the matrix that is singular."""
        return terms.turned(kappa)[0]

    def renewed(self, terms: Terms, kappa: float) -> Turning:
        """Return the same with borders of this point."""
        return Turning.of(terms, kappa)

    def at(self, terms: Terms, kappa: float, near: Array | None = None) -> Values:
        """Return the four numbers and their derivatives."""
        matrix, turning = terms.turned(kappa)
        size = len(matrix)
        whole = np.zeros((size + 2, size + 2))
        whole[:size, :size], whole[:size, size:], whole[size:, :size] = matrix, self.b, self.c.T
        two = np.zeros((size + 2, 2))
        two[size:] = np.eye(2)
        v, w = (np.asarray(np.linalg.solve(it, two), np.float64) for it in (whole, whole.T))
        right = [(w[:size, i], v[:size, j]) for i in (0, 1) for j in (0, 1)]
        by_y = near
        if by_y is None:
            by_y = -np.array(terms.turned_curvature(kappa, w[:size], v[:size]))
        by_kappa = np.array([-one @ turning @ other for one, other in right])
        return Values(v[size:].ravel(), by_y, by_kappa, right)


# The cubic coefficient of a period doubling: stability of the nearby doubled orbits.
#
# Along the eigenvector of the multiplier -1 the return map is :math:`\xi \to -\xi + c\,\xi^3` after
# a change of coordinates. With the equations `F` of the word written twice, their Jacobian `J` and
# its singular vectors `V` and `W`, made of `v` and `w` of :math:`J(\pi)`,
#
# .. math:: J D = -\tfrac12 F''[V, V], \qquad
# c = -2\,W^T (F''[V, D] + \tfrac16 F'''[V, V, V]) \, / \, (w^T J_\mu(\pi)\, v),
#
# where :math:`J_\mu` is the derivative of the matrix by the multiplier. For `c` > 0 the doubling is
# supercritical: nearby orbits of twice the period are stable.

FIRST_STEP, LONGEST, PART = 1e-4, 3e-3, 5e-3
"""Steps of differences in scaled unknowns, and that relative to the cubic term."""
CUBIC_STEP = 1e-6
"""Of a difference for the direction of a doubled orbit."""


def twice(terms: Terms, null: Array) -> tuple[Frame, Array, Array]:
    """Return the frame of a word written twice, its unknowns, and how `null` moves both halves."""
    frame = terms.frame
    word = whole_word(terms)[0] if frame.turn is not None else frame.word * 2
    new = dataclasses.replace(frame, word=word, length=2.0 * terms.length, turn=None)

    def both(part: float) -> Array:
        if frame.impulses is not None:
            first, second = terms.y + part * null, terms.y - part * null
            second[1::2] += terms.length
            return np.append(first, second)
        moved = part * null.reshape(terms.x.shape)
        first, second = terms.x + moved, terms.x - moved
        second[:, [0, -1]] += terms.length
        if frame.turn is not None:
            second[:, 1:-1] = second[:, 1:-1] @ frame.turn.T
        return new.joined(np.vstack([first, second]), new.length)

    return new, both(0.0), (both(CUBIC_STEP) - both(-CUBIC_STEP)) / (2.0 * CUBIC_STEP)


def cubic_coefficient(terms: Terms) -> float:
    """Return the coefficient at a period doubling; `v` has unit length in scaled unknowns.

    It is NaN if neighbouring motions cannot be computed.
    """
    try:
        return _coefficient(terms)
    except (FlightError, ValueError, np.linalg.LinAlgError):
        return math.nan


def cubic_test(terms: Terms, scale: Array, sizes: Array, *, precise: bool = True) -> float:
    """Return a number that vanishes where the coefficient does, and has none of its poles.

    They are where another multiplier is 1, or a second one -1.
    """
    try:
        cubic = _Cubic(terms, scale, sizes)
        value = cubic.precise() if precise else cubic.numerator(FIRST_STEP)
        sign, size = np.linalg.slogdet(terms.matrix() * scale / sizes[:, None])
        return float(value * cubic.orientation() * sign * np.exp(min(size, 300.0)))
    except (FlightError, ValueError, np.linalg.LinAlgError):
        return math.nan


def _coefficient(terms: Terms) -> float:
    cubic = _Cubic(terms, *sizes_of(terms))
    return cubic.precise() / cubic.slope


class _Cubic:
    """The cubic term of the word written twice, along what doubles it."""

    def __init__(self, terms: Terms, scale: Array, sizes: Array) -> None:
        n, opposite = len(terms.y), terms.matrix(-1.0)
        frame, y, direction = twice(terms, np.linalg.svd(opposite)[2][-1])
        self.both = _Doubled(frame, y, np.tile(scale, 2), np.tile(sizes, 2))
        self.opposite = opposite * scale / sizes[:, None]
        left, _, right = np.linalg.svd(self.opposite)
        v, w = right[-1], left[:, -1]
        self.slope = float(w @ (terms.by_multiplier() * scale / sizes[:, None]) @ v)
        own = direction / self.both.scale
        self.v = own / np.linalg.norm(own)
        self.base = self.both.matrix(0.0 * own)
        border = np.linalg.svd(self.base)[0][:, -1]
        # W = (w, -w)
        self.w = border * np.sign(border[:n] @ w) * np.sign(self.v[:n] @ v)
        self.borders = w, v

    def orientation(self) -> float:
        """Return the sign of the bordered matrix: vectors of other signs change both it and `w`."""
        w, v = self.borders
        whole = np.block([[self.opposite, w[:, None]], [v, np.zeros(1)]])
        return float(np.linalg.slogdet(whole)[0])

    def precise(self) -> float:
        """Return the numerator with an error of fourth order in the steps.

        They are short compared with the amplitude at which the cubic and the linear term are equal.
        """
        h = min(LONGEST, PART / math.sqrt(abs(self.numerator(FIRST_STEP) / self.slope) + 1e-300))
        return (4.0 * self.numerator(h) - self.numerator(2.0 * h)) / 3.0

    def numerator(self, h: float) -> float:
        """Return the numerator of the coefficient by differences of the Jacobian over `h`."""
        base, v, w = self.base, self.v, self.w
        ahead, back = (self.both.matrix(part * h * v) for part in (1.0, -1.0))
        second, third = (ahead - back) / (2.0 * h), (ahead + back - 2.0 * base) / h**2
        n = len(v)
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n], whole[n, :n] = base, w, v
        across = np.linalg.solve(whole, np.append(-0.5 * second @ v, 0.0))[:n]
        return -2.0 * float(w @ (second @ across + third @ v / 6.0))


@dataclasses.dataclass(frozen=True)
class _Doubled:
    """The equations of the word written twice."""

    frame: Frame
    y: Array
    scale: Array
    sizes: Array

    def matrix(self, z: Array) -> Array:
        """Return the scaled Jacobian, moved by `z` in scaled unknowns."""
        whole = evaluate(self.frame, self.y + self.scale * z).matrix()
        return np.asarray(whole * self.scale / self.sizes[:, None], np.float64)


# Other words at an event: without an impact that grazes, with one that begins.


def crossed(terms: Terms, low: Constraint) -> tuple[Frame, Array] | None:
    """Return frame and unknowns of the event sequence past an event; None if there is none."""
    segment = terms.frame.word[low.segment]
    if low.kind == "interior_impact":
        return _inserted(terms, low)
    if low.kind == "simultaneous":
        return _swapped(terms, low)
    if low.kind == "stick_vanishes":
        return _without_stick(terms, low.segment)
    if low.kind == "turn_sticks":
        return _with_stick(terms, low.segment)
    if low.kind != "grazing":
        return None
    if segment.kind == "Z":
        return _later(terms, low.segment)
    if segment.kind == "I" and segment.after == segment.contacts:
        return _dropped(terms, low.segment)
    return None


def _dropped(terms: Terms, s: int) -> tuple[Frame, Array] | None:
    """Merge the segments before and after an impact of no speed."""
    frame, x = terms.frame, terms.x
    word = frame.word
    k = len(word)
    if k == 1:
        return _without(terms)
    after = (s + 1) % k
    turned, length = x.copy(), terms.length
    if after == 0:
        # the last event goes: the first segment begins where the last one did
        turned[0, :-1] = x[s, :-1]
        turned[0, 0] -= length
        if frame.turn is not None:
            turned[0, 1:-1] = np.linalg.inv(frame.turn) @ x[s, 1:-1]
    else:
        turned[after, :-1] = x[s, :-1]
    kept = [j for j in range(k) if j != s]
    new = tuple(word[j] for j in kept)
    return _reframed(frame, new, turned[kept], length)


def _without(terms: Terms) -> tuple[Frame, Array]:
    """Return the motion without its only impact, with a section half a period away."""
    frame, x = terms.frame, terms.x.copy()
    segment = frame.word[0]
    word = (Segment(segment.contacts, "P", -1, segment.contacts),)
    if frame.free:
        gap = frame.flow.gap(segment.gap, float(x[0, -1]), terms.segments.flights.z[0])
        section: float | int = int(np.argmax(np.abs(gap.by_z[: frame.flow.n])))
    else:
        middle = float(x[0, 0]) + 0.5 * terms.length
        x[0, 1:-1] = frame.flow.path(segment.contacts, x[0, 0], x[0, 1:-1], np.array([middle]))[0]
        x[0, 0], x[0, -1] = middle, middle + terms.length
        section = float(x[0, -1])
    new = dataclasses.replace(frame, word=word, section=section)
    return new, new.joined(x, terms.length)


def _inserted(terms: Terms, low: Constraint) -> tuple[Frame, Array] | None:
    """Split a segment at the minimum of a gap that touches."""
    frame, x, s = terms.frame, terms.x, low.segment
    segment = frame.word[s]
    if len(frame.word) >= MOST_LETTERS:
        return None
    t0 = float(x[s, 0])
    before = frame.flow.path(segment.contacts, t0, x[s, 1:-1], np.array([low.t]))[0]
    e = float(frame.flow.e[low.gap])
    after = frame.flow.impact(low.gap, segment.contacts, low.t, before, e).z
    first, second = x[s].copy(), x[s].copy()
    first[-1] = low.t
    second[0], second[1:-1] = low.t, after
    hit = Segment(segment.contacts, "I", low.gap, segment.contacts)
    if segment.kind == "P":
        # the impact replaces the section
        row = first.copy()
        row[:-1] = second[:-1]
        row[0] -= terms.length
        if frame.turn is not None:
            row[1:-1] = np.linalg.inv(frame.turn) @ row[1:-1]
        return _reframed(frame, (hit,), row[None], terms.length)
    word = (*frame.word[:s], hit, *frame.word[s:])
    rows = np.vstack([x[:s], first, second, x[s + 1 :]])
    return _reframed(frame, word, rows, terms.length)


def _swapped(terms: Terms, low: Constraint) -> tuple[Frame, Array] | None:
    """Swap two simultaneous impacts of uncoupled gaps."""
    frame, x, s = terms.frame, terms.x.copy(), low.segment
    first, second = frame.word[s - 1], frame.word[s]
    flow, plain = frame.flow, all(it.kind == "I" for it in (first, second))
    # where a gap is least at the impact of another one they are coupled
    if low.gap != second.gap or first.gap == low.gap or not plain or s == 0:
        return None
    t, before = float(x[s, -1]), terms.segments.flights.z[s - 1]
    if not uncoupled(flow, [first.gap, second.gap], t, before):
        return None
    x[s - 1, -1] = x[s, 0] = t
    x[s, 1:-1] = flow.impact(second.gap, second.kept, t, before, float(flow.e[second.gap])).z
    word = (*frame.word[: s - 1], second, first, *frame.word[s + 1 :])
    return _reframed(frame, word, x, terms.length)


TOGETHER = 1e-9
"""Parts of the length, or of forces, below which a stick or a level counts as zero, too."""


def _without_stick(terms: Terms, s: int) -> tuple[Frame, Array]:
    """Turn slips without the sticks that last no time: of a symmetric motion there are two."""
    frame, x = terms.frame, terms.x
    word, k = list(frame.word), len(x)
    short = np.abs(x[:, -1] - x[:, 0]) <= TOGETHER * abs(terms.length)
    gone = [j for j in range(k) if j == s or (short[j] and _is_stick(frame.word, j))]
    for j in gone:
        word[(j - 1) % k] = dataclasses.replace(word[(j - 1) % k], kind="T", after=word[j].after)
    kept = [j for j in range(k) if j not in gone]
    return _reframed(frame, tuple(word[j] for j in kept), x[kept], terms.length)


def _is_stick(word: Word, s: int) -> bool:
    """Whether a segment is a stick between its two events."""
    return word[s].kind == "B" and word[s - 1].kind == "K" and word[s].gap == word[s - 1].gap


def _with_stick(terms: Terms, s: int) -> tuple[Frame, Array]:
    """Let slips that turn stick, at first for no time."""
    frame, x, k = terms.frame, terms.x, len(terms.x)
    lows = [it for it in Margins(terms).lows if it.kind == "turn_sticks"]
    own = {s, *(it.segment for it in lows if abs(it.value) <= TOGETHER * it.size)}
    word: list[Segment] = []
    rows: list[Array] = []
    for j, it in enumerate(frame.word):
        rows.append(x[j])
        if j not in own:
            word.append(it)
            continue
        stuck = tuple(sorted({*it.after, it.gap} - {-1 - it.gap}))
        word += [
            dataclasses.replace(it, kind="K", after=stuck),
            Segment(stuck, "B", it.gap, it.after),
        ]
        t = x[j, -1:]
        rows.append(np.concatenate([t, x[(j + 1) % k, 1:-1], t]))
    return _reframed(frame, tuple(word), np.array(rows), terms.length)


def _later(terms: Terms, s: int) -> tuple[Frame, Array] | None:
    """Start an accumulation with its second impact."""
    impacts = terms.accumulations[s].impacts
    if not len(impacts):
        return None
    x = terms.x.copy()
    x[s, -1] = float(impacts["t"][0])
    return terms.frame, terms.frame.joined(x, terms.length)


def _reframed(
    frame: Frame, word: tuple[Segment, ...], x: Array, length: float
) -> tuple[Frame, Array]:
    new = dataclasses.replace(frame, word=word)
    return new, new.joined(x, length)
