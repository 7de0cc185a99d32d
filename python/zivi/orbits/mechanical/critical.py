r"""What vanishes along a curve of events in two parameters, beside the equations of the orbit.

A fold or a doubling: the number :math:`\sigma` of the bordered system of :math:`J(0)` or
:math:`J(\pi)`,

.. math:: \begin{pmatrix} J & b \\ c^T & 0 \end{pmatrix}
    \begin{pmatrix} v \\ \sigma \end{pmatrix} = \begin{pmatrix} 0 \\ 1 \end{pmatrix}, \qquad
    d\sigma = -w^T\,dJ\,v.

A pair that turns on the unit circle: the real matrix of it with :math:`\kappa = \cos\theta`
(`turned` of the equations) has rank two less, also where the pair becomes real at
:math:`\kappa = \pm 1`; its :math:`\sigma` are two by two. A grazing: the speed of a gap before an
impact. The end of a contact: the least of its forces. Two events at once: the time between them.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.orbits.mechanical.equations import Terms, evaluate
from zivi.orbits.mechanical.margins import Margins

__all__ = ["Critical", "Grazing", "Margin", "Singular", "Turning", "Values"]

STEP = 1e-5
"""Of differences of the Jacobian: only the convergence depends on it."""


@dataclasses.dataclass(frozen=True)
class Values:
    """The values of what vanishes, and how they change."""

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
        """Give the number that vanishes."""
        raise NotImplementedError

    def at(self, terms: Terms, kappa: float, near: Array | None = None) -> Values:
        """Give the values and their derivatives by the unknowns.

        Those of a point `near` may be taken where only the convergence depends on them.
        """
        raise NotImplementedError

    def matrix(self, terms: Terms, kappa: float) -> Array:
        """Give the matrix that is singular."""
        raise NotImplementedError

    def renewed(self, terms: Terms, kappa: float) -> Critical:
        """Give the same with borders of this point."""
        return self

    def by_matrix(self, values: Values, change: Array) -> Array:
        """Give the change of the values with that of the matrix."""
        return np.array([-w @ change @ v for w, v in values.right])


@dataclasses.dataclass(frozen=True)
class Grazing(Critical):
    """The speed before the impact that ends a segment."""

    segment: int
    is_measured = True

    def measure(self, terms: Terms) -> float:
        """Give the speed."""
        return float(terms.rates[self.segment])

    def at(self, terms: Terms, kappa: float, near: Array | None = None) -> Values:
        """Give the speed and its derivatives."""
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
        """Give the force, the time, or the gap."""
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
        row = terms.x[self.segment]
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
        """Give the number and its derivatives.

        Where a force is least its place moves nothing to first order.
        """
        frame, part, y = terms.frame, self._part(terms), terms.y

        def value(there: Array) -> float:
            return self._at(evaluate(frame, there, slopes=False), part)

        by_y = np.zeros((1, len(y)))
        for k in self._touched(terms):
            h = STEP * max(1.0, abs(float(y[k])))
            step = np.zeros(len(y))
            step[k] = h
            by_y[0, k] = (value(y + step) - value(y - step)) / (2.0 * h)
        return Values(np.array([self._at(terms, part)]), by_y, None, [])

    def _touched(self, terms: Terms) -> range:
        """Give the unknowns that it depends on: of segments those of its own."""
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
        """Take the borders of a point."""
        left, _, right = np.linalg.svd(terms.matrix(factor))
        return cls(factor, left[:, -1], right[-1])

    def renewed(self, terms: Terms, kappa: float) -> Singular:
        """Give the same with borders of this point, of the signs of these."""
        new = Singular.of(terms, self.factor)
        b, c = new.b * (new.b @ self.b), new.c * (new.c @ self.c)
        return Singular(self.factor, b / np.linalg.norm(b), c / np.linalg.norm(c))

    def matrix(self, terms: Terms, kappa: float) -> Array:
        """Give the matrix that is singular."""
        return np.asarray(terms.matrix(self.factor), np.float64)

    def at(self, terms: Terms, kappa: float, near: Array | None = None) -> Values:
        """Give the number and its derivatives: a cusp shows in them."""
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
        """Take the borders of a point."""
        left, _, right = np.linalg.svd(terms.turned(kappa)[0])
        return cls(left[:, -2:], right[-2:].T)

    def matrix(self, terms: Terms, kappa: float) -> Array:
        """Give the matrix that is singular."""
        return terms.turned(kappa)[0]

    def renewed(self, terms: Terms, kappa: float) -> Turning:
        """Give the same with borders of this point."""
        return Turning.of(terms, kappa)

    def at(self, terms: Terms, kappa: float, near: Array | None = None) -> Values:
        """Give the four numbers and their derivatives."""
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
