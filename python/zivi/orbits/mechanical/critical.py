r"""What vanishes along a curve of events in two parameters, beside the equations of the orbit.

A fold or a doubling: the number :math:`\sigma` of the bordered system of :math:`J(0)` or
:math:`J(\pi)`,

.. math:: \begin{pmatrix} J & b \\ c^T & 0 \end{pmatrix}
    \begin{pmatrix} v \\ \sigma \end{pmatrix} = \begin{pmatrix} 0 \\ 1 \end{pmatrix}, \qquad
    d\sigma = -w^T\,dJ\,v.

A pair that turns on the unit circle: with :math:`\kappa = \cos\theta` the real matrix

.. math:: \begin{pmatrix} A & B \\ -B & A + 2 \kappa B \end{pmatrix}

has rank two less, also where the pair becomes real at :math:`\kappa = \pm 1`; its :math:`\sigma`
are two by two. A grazing: the speed of a gap before an impact. The end of a contact: the least of
its forces. Two events at once: the time between them.

`A` of a segment depends on its own unknowns only, so that :math:`w^T (dJ/dy) v` is
:math:`d(w^T A(y + h v))/dh`: two evaluations, whatever the number of unknowns.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.orbits.mechanical.equations import Frame, Terms, evaluate
from zivi.orbits.mechanical.margins import Margins

__all__ = ["Critical", "Grazing", "Margin", "Singular", "Turning"]

STEP = 1e-5
"""Of differences of the Jacobian: only the convergence depends on it."""


@dataclasses.dataclass(frozen=True)
class Values:
    """The values of what vanishes, and how they change."""

    value: Any
    by_y: Any
    """Derivatives by the unknowns, a row for each value."""
    by_kappa: Any
    right: list[list[tuple[Any, Any]]]
    """Pairs ``(w, v)`` for each value, whose sum of -w dA v is its change."""


class Critical:
    """Numbers that vanish along a curve."""

    count = 1
    with_kappa = False
    is_measured = False
    """Whether it is a number of the motion, `measure`, not of the matrix."""

    def measure(self, terms: Terms) -> float:
        """Give the number that vanishes."""
        raise NotImplementedError

    def at(self, terms: Terms, kappa: float) -> Values:
        """Give the values and their derivatives by the unknowns."""
        raise NotImplementedError

    def renewed(self, terms: Terms, kappa: float) -> Critical:
        """Give the same with borders of this point."""
        return self

    def by_matrix(self, values: Values, change: Any) -> Array:
        """Give the change of the values with that of the matrix."""
        return np.array([-sum(w @ change @ v for w, v in pairs) for pairs in values.right])


@dataclasses.dataclass(frozen=True)
class Grazing(Critical):
    """The speed before the impact that ends a segment."""

    segment: int
    is_measured = True

    def measure(self, terms: Terms) -> float:
        """Give the speed."""
        return float(terms.rates[self.segment])

    def at(self, terms: Terms, kappa: float) -> Values:
        """Give the speed and its derivatives."""
        frame, s = terms.frame, self.segment
        gap, tau = frame.word[s].gap, float(terms.x[s, -1])
        z, size = terms.flights.z[s], len(terms.flights.z[s])

        def rate(t: float, state: Array) -> float:
            return float(frame.flow.gaps(np.array([t]), state[None])[1][0, gap])

        h = 1e-6
        by_z = np.array([rate(tau, z + h * e) - rate(tau, z - h * e) for e in np.eye(size)])
        by_t = (rate(tau + h, z) - rate(tau - h, z)) / (2.0 * h)
        own = terms.flights
        ends = np.column_stack([-own.phi[s] @ own.first[s], own.phi[s], own.last[s]])
        by_y = np.zeros((1, len(terms.y)))
        row = by_z / (2.0 * h) @ ends
        row[-1] += by_t
        by_y[0, s * frame.size : (s + 1) * frame.size] = row
        if frame.free:
            by_y[0, 0] = 0.0
        return Values(np.array([rate(tau, z)]), by_y, None, [[]])


@dataclasses.dataclass(frozen=True)
class Margin(Critical):
    """The least force of a contact in a segment, or the time between two events."""

    kind: str
    segment: int
    gap: int
    is_measured = True

    def measure(self, terms: Terms) -> float:
        """Give the force, or the time."""
        return self._at(terms, self._part(terms))

    def _part(self, terms: Terms) -> float:
        """Give where in the segment the force is least, from 0 to 1."""
        if self.kind == "simultaneous":
            return 1.0
        lows = Margins(terms).between(self.segment)
        own = [it for it in lows if (it.kind, it.gap) == (self.kind, self.gap)]
        t0, t1 = float(terms.x[self.segment, 0]), float(terms.x[self.segment, -1])
        if not own or t1 <= t0:
            return 0.0
        return (min(own, key=lambda it: it.value).t - t0) / (t1 - t0)

    def _at(self, terms: Terms, part: float) -> float:
        t0, t1 = float(terms.x[self.segment, 0]), float(terms.x[self.segment, -1])
        if self.kind == "simultaneous":
            return t1 - t0
        flow, contacts = terms.frame.flow, terms.frame.word[self.segment].contacts
        t = t0 + part * (t1 - t0)
        z = flow.path(contacts, t0, terms.x[self.segment, 1:-1], np.array([t]))[0]
        return float(flow.reaction(contacts, self.gap, t, z).value)

    def at(self, terms: Terms, kappa: float) -> Values:
        """Give the number and its derivatives, by the unknowns of its segment.

        Where a force is least its place moves nothing to first order.
        """
        frame, s, part = terms.frame, self.segment, self._part(terms)
        by_y = np.zeros((1, len(terms.y)))
        for k in range(frame.size):
            h = STEP * max(1.0, abs(float(terms.x[s, k])))
            sides = []
            for sign in (1.0, -1.0):
                x = terms.x.copy()
                x[s, k] += sign * h
                sides.append(self._at(dataclasses.replace(terms, x=x), part))
            by_y[0, s * frame.size + k] = (sides[0] - sides[1]) / (2.0 * h)
        if frame.free:
            by_y[0, 0] = 0.0
        return Values(np.array([self._at(terms, part)]), by_y, None, [[]])


def _along(frame: Frame, y: Array, v: Any, factor: float) -> Any:
    """Give the derivative of the matrix along a direction of the unknowns."""
    largest = float(np.max(np.abs(v))) or 1.0
    h = STEP * max(1.0, float(np.max(np.abs(y[1:])))) / largest
    moved = v.copy()
    if frame.free:
        moved[0] = 0.0
    ahead, back = (evaluate(frame, y + s * h * moved).matrix(factor) for s in (1.0, -1.0))
    return (ahead - back) / (2.0 * h)


@dataclasses.dataclass(frozen=True)
class Singular(Critical):
    """Where ``J(0)``, with the factor 1, or ``J(pi)``, with -1, is singular."""

    factor: float
    b: Array
    c: Array

    @classmethod
    def of(cls, terms: Terms, factor: float) -> Singular:
        """Take the borders of a point."""
        left, _, right = np.linalg.svd(terms.matrix(factor))
        return cls(factor, left[:, -1], right[-1])

    def renewed(self, terms: Terms, kappa: float) -> Singular:
        """Give the same with borders of this point."""
        return Singular.of(terms, self.factor)

    def at(self, terms: Terms, kappa: float) -> Values:
        """Give the number and its derivatives."""
        matrix = terms.matrix(self.factor)
        n = len(matrix)
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n], whole[n, :n] = matrix, self.b, self.c
        one = np.zeros(n + 1)
        one[n] = 1.0
        v, w = np.linalg.solve(whole, one), np.linalg.solve(whole.T, one)
        change = _along(terms.frame, terms.y, v[:n], self.factor)
        by_y = -(w[:n] @ change)[None]
        return Values(v[n:], by_y, None, [[(w[:n], v[:n])]])


@dataclasses.dataclass(frozen=True)
class Turning(Critical):
    """Where a pair of multipliers has the product 1 and the sum 2 kappa."""

    b: Array
    c: Array
    count = 4
    with_kappa = True

    @classmethod
    def of(cls, terms: Terms, kappa: float) -> Turning:
        """Take the borders of a point."""
        left, _, right = np.linalg.svd(_doubled(terms, kappa)[0])
        return cls(left[:, -2:], right[-2:].T)

    def renewed(self, terms: Terms, kappa: float) -> Turning:
        """Give the same with borders of this point."""
        return Turning.of(terms, kappa)

    def at(self, terms: Terms, kappa: float) -> Values:
        """Give the four numbers and their derivatives."""
        matrix, closing = _doubled(terms, kappa)
        size = len(matrix)
        n = size // 2
        whole = np.zeros((size + 2, size + 2))
        whole[:size, :size], whole[:size, size:], whole[size:, :size] = matrix, self.b, self.c.T
        two = np.zeros((size + 2, 2))
        two[size:] = np.eye(2)
        v, w = np.linalg.solve(whole, two), np.linalg.solve(whole.T, two)
        frame, y = terms.frame, terms.y
        changes = [[_along(frame, y, v[b * n : (b + 1) * n, j], -1.0) for j in (0, 1)]
                   for b in (0, 1)]  # fmt: skip
        by_y, by_kappa, pairs = [], [], []
        for i in (0, 1):
            for j in (0, 1):
                rows = [w[b * n : (b + 1) * n, i] @ changes[b][j] for b in (0, 1)]
                by_y.append(-(rows[0] + rows[1]))
                by_kappa.append(-2.0 * w[n:size, i] @ closing @ v[n:size, j])
                pairs.append(
                    [(w[b * n : (b + 1) * n, i], v[b * n : (b + 1) * n, j]) for b in (0, 1)]
                )
        values = v[size:].ravel()
        return Values(values, np.array(by_y), np.array(by_kappa), pairs)


def _doubled(terms: Terms, kappa: float) -> tuple[Any, Any]:
    """Give the real matrix of a pair, and `B`."""
    plus, minus = terms.matrix(1.0 + 1e-300j).real, terms.matrix(-1.0)
    a, b = 0.5 * (plus + minus), 0.5 * (plus - minus)
    return np.block([[a, b], [-b, a + 2.0 * kappa * b]]), b
