r"""The cubic coefficient of a period doubling: whether doubled orbits beside it are stable.

Along the eigenvector of the multiplier -1 the return map is :math:`\xi \to -\xi + c\,\xi^3` after
a change of coordinates. With the equations `F` of the word written twice, their Jacobian `J` and
its singular vectors `V` and `W`, made of `v` and `w` of :math:`J(\pi)`,

.. math:: J D = -\tfrac12 F''[V, V], \qquad
    c = -2\,W^T (F''[V, D] + \tfrac16 F'''[V, V, V]) \, / \, (w^T J_\mu(\pi)\, v),

where :math:`J_\mu` is the derivative of the matrix by the multiplier. The doubling is
supercritical, with stable orbits of twice the period beside it, where `c` > 0.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from zivi.base.check import Array
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.equations import Frame, Terms, evaluate, sizes_of
from zivi.orbits.mechanical.symmetry import whole_word

__all__ = ["cubic_coefficient", "cubic_test", "twice"]

FIRST, LONGEST, PART = 1e-4, 3e-3, 5e-3
"""Steps of differences in scaled unknowns, and that relative to the cubic term."""
STEP = 1e-6
"""Of a difference for the direction of a doubled orbit."""


def twice(terms: Terms, null: Array) -> tuple[Frame, Array, Array]:
    """Give the frame of a word written twice, its unknowns, and how `null` moves both halves."""
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

    return new, both(0.0), (both(STEP) - both(-STEP)) / (2.0 * STEP)


def cubic_coefficient(terms: Terms) -> float:
    """Give the coefficient at a period doubling; `v` has unit length in scaled unknowns.

    It is NaN where the motion cannot be computed beside it.
    """
    try:
        return _coefficient(terms)
    except (FlightError, ValueError, np.linalg.LinAlgError):
        return math.nan


def cubic_test(terms: Terms, scale: Array, sizes: Array, *, precise: bool = True) -> float:
    """Give a number that vanishes where the coefficient does, and has none of its poles.

    They are where another multiplier is 1, or a second one -1.
    """
    try:
        cubic = _Cubic(terms, scale, sizes)
        value = cubic.precise() if precise else cubic.numerator(FIRST)
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
        """Give the sign of the bordered matrix: vectors of other signs change both it and `w`."""
        w, v = self.borders
        whole = np.block([[self.opposite, w[:, None]], [v, np.zeros(1)]])
        return float(np.linalg.slogdet(whole)[0])

    def precise(self) -> float:
        """Give the numerator with an error of fourth order in the steps.

        They are short beside the amplitude at which the cubic term is as large as the linear one.
        """
        h = min(LONGEST, PART / math.sqrt(abs(self.numerator(FIRST) / self.slope) + 1e-300))
        return (4.0 * self.numerator(h) - self.numerator(2.0 * h)) / 3.0

    def numerator(self, h: float) -> float:
        """Give the numerator of the coefficient by differences of the Jacobian over `h`."""
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
        """Give the scaled Jacobian, moved by `z` in scaled unknowns."""
        whole = evaluate(self.frame, self.y + self.scale * z).matrix()
        return np.asarray(whole * self.scale / self.sizes[:, None], np.float64)
