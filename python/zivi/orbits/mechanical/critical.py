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
from zivi.orbits.mechanical.equations import Frame, Terms
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

    def at(self, terms: Terms, kappa: float) -> Values:
        """Give the values and their derivatives by the unknowns."""
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

    def at(self, terms: Terms, kappa: float) -> Values:
        """Give the speed and its derivatives."""
        by_y = terms.rate_gradient(self.segment)[None]
        return Values(np.array([self.measure(terms)]), by_y, None, [])


@dataclasses.dataclass(frozen=True)
class Margin(Critical):
    """The least force of a contact in a segment, or the time between two events."""

    kind: str
    segment: int
    gap: int
    is_measured = True

    def measure(self, terms: Terms) -> float:
        """Give the force, or the time."""
        return self._at(terms.x, terms.frame, self._part(terms))

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

    def _at(self, x: Array, frame: Frame, part: float) -> float:
        t0, t1 = float(x[self.segment, 0]), float(x[self.segment, -1])
        if self.kind == "simultaneous":
            return t1 - t0
        flow, contacts = frame.flow, frame.word[self.segment].contacts
        t = t0 + part * (t1 - t0)
        z = flow.path(contacts, t0, x[self.segment, 1:-1], np.array([t]))[0]
        return float(flow.reaction(contacts, self.gap, t, z).value)

    def at(self, terms: Terms, kappa: float) -> Values:
        """Give the number and its derivatives, by the unknowns of its segment.

        Where a force is least its place moves nothing to first order.
        """
        frame, s, part = terms.frame, self.segment, self._part(terms)
        value = np.array([self._at(terms.x, terms.frame, part)])
        by_y = np.zeros((1, len(terms.y)))
        if frame.impulses is not None:
            # times are all that there is of it
            by_y[0, 2 * s + 1] += 1.0
            by_y[0, 2 * s - 1] -= 1.0
            return Values(value, by_y, None, [])
        for k in range(frame.size):
            h = STEP * max(1.0, abs(float(terms.x[s, k])))
            sides = []
            for sign in (1.0, -1.0):
                x = terms.x.copy()
                x[s, k] += sign * h
                sides.append(self._at(x, frame, part))
            by_y[0, s * frame.size + k] = (sides[0] - sides[1]) / (2.0 * h)
        if frame.free:
            by_y[0, 0] = 0.0
        return Values(value, by_y, None, [])


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

    def at(self, terms: Terms, kappa: float) -> Values:
        """Give the number and its derivatives."""
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

    def at(self, terms: Terms, kappa: float) -> Values:
        """Give the four numbers and their derivatives."""
        matrix, turning = terms.turned(kappa)
        size = len(matrix)
        whole = np.zeros((size + 2, size + 2))
        whole[:size, :size], whole[:size, size:], whole[size:, :size] = matrix, self.b, self.c.T
        two = np.zeros((size + 2, 2))
        two[size:] = np.eye(2)
        v, w = (np.asarray(np.linalg.solve(it, two), np.float64) for it in (whole, whole.T))
        right = [(w[:size, i], v[:size, j]) for i in (0, 1) for j in (0, 1)]
        by_y = -np.array(terms.turned_curvature(kappa, w[:size], v[:size]))
        by_kappa = np.array([-one @ turning @ other for one, other in right])
        return Values(v[size:].ravel(), by_y, by_kappa, right)
