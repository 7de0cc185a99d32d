"""An interior-point method for sparse affine problems that are monotone, from afar.

```text
M x + q - z + y = 0,   z (x - l) = mu,   y (u - x) = mu,   l < x < u,  z > 0,  y > 0
(M + diag(z/(x - l) + y/(u - x))) dx = ...
```

Mehrotra's predictor and corrector (*SIAM J. Optim.* 2 (1992) 575-601) and Gondzio's centrality
correctors (*Comput. Optim. Appl.* 6 (1996) 137-156), which share the factors: the number of steps
hardly grows with that of the unknowns, the pattern is that of `M`. What is left of the sign
conditions is settled by Newton's method on the active set. Where `M` is not monotone the steps
become short, and it is given up.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from zivi.base.arrays import Array
from zivi.vi.active_set import SETTLED, active_set_newton
from zivi.vi.factorisation import Factors, rows_of_sizes
from zivi.vi.sparse_search import Search, natural_map

__all__ = ["interior_point"]

_TO_BOUNDARY = 0.995
_SHORT, _SHORTS = 0.1, 4
"""Steps below the one, more of them than the other in a row, end the method."""
_CLOSE, _CLOSER = 1e-4, 1e-8
"""``mu`` over the first one, below which the active set may be told, and has been if ever."""
_ROOM, _PUSH = 3.0, 3.0
"""Distance of the start from the bounds, and its ``mu``, in typical ones."""
_CORRECTORS = 2
_LONGER, _WORTHWHILE = 0.3, 0.03
"""By how much a corrector aims at a longer step, and by how much it must become longer."""
_CENTRAL = 10.0
"""Products farther than by this factor from the aim are corrected."""
_PROXIMAL, _PASSES = 1e-8, 4
"""Weight of the term that makes the Jacobian inside regular, and steps that take it away."""
_HELD = 1e14
"""Diagonal of components that are fixed, relative to their row."""


class _Step(NamedTuple):
    """Of `x` and of both multipliers."""

    x: Array
    z: Array
    y: Array


class _Interior:
    """The iterate: a point inside the box and multipliers of its bounds."""

    def __init__(self, search: Search, x: Array, M: Any, q: Array, move: float) -> None:
        self.search, self.M, self.q = search, M, q
        lower, upper = search.lower, search.upper
        self._fixed = lower == upper
        self._low = np.isfinite(lower) & ~self._fixed
        self._high = np.isfinite(upper) & ~self._fixed
        self._pairs = max(1, int(self._low.sum() + self._high.sum()))
        self._c = rows_of_sizes(M)
        self._held = np.where(self._fixed, _HELD * self._c, 0.0)
        width = np.where(self._low & self._high, upper - lower, np.inf)
        room = np.minimum(_ROOM * move, 0.3 * width)
        x = np.where(self._low, np.maximum(x, lower + room), x)
        self.x = np.where(self._high, np.minimum(x, upper - room), x)
        F = M @ self.x + q
        sizes = natural_map(search.x0, M @ search.x0 + q, lower, upper)
        mu = _PUSH * float(np.sqrt(np.mean(sizes**2))) * _ROOM * move
        # kept beside x, whose difference to a bound would cancel; 1 where there is no bound
        self.below = np.where(self._low, self.x - lower, 1.0)
        self.above = np.where(self._high, upper - self.x, 1.0)
        self.z = np.where(self._low, np.maximum(F, 0.0) + mu / self.below, 0.0)
        self.y = np.where(self._high, np.maximum(-F, 0.0) + mu / self.above, 0.0)

    @property
    def mu(self) -> float:
        """The mean product of a multiplier and the distance of its bound."""
        return float((self.z @ self.below + self.y @ self.above) / self._pairs)

    def places(self) -> Any:
        """Return -1 where the lower bound is rather active than not, 1 for the upper, 0 inside."""
        at_lower = self._fixed | (self._low & (self.z > self._c * self.below))
        at_upper = self._high & (self.y > self._c * self.above)
        return at_upper.astype(np.int8) - at_lower.astype(np.int8)

    def _step(self, factors: Factors, lower: Array, upper: Array) -> _Step | None:
        """Return the step to ``z (x - l) = lower``, ``y (u - x) = upper``."""
        right = -(self.M @ self.x + self.q) + lower / self.below - upper / self.above
        x = factors.solve(np.where(self._fixed, 0.0, right))
        if x is None:
            return None
        z = np.where(self._low, (lower - self.z * x) / self.below - self.z, 0.0)
        y = np.where(self._high, (upper + self.y * x) / self.above - self.y, 0.0)
        return _Step(x, z, y)

    def _length(self, step: _Step, share: float) -> float:
        """Return the longest step, at most 1, that goes this share of the way to a bound."""
        length = 1.0
        for value, change, has in (
            (self.below, step.x, self._low),
            (self.above, -step.x, self._high),
            (self.z, step.z, self._low),
            (self.y, step.y, self._high),
        ):
            falls = has & (change < 0)
            with np.errstate(over="ignore"):
                reach = share * value[falls] / -change[falls]
            length = min(length, float(np.min(reach, initial=1.0)))
        return length

    def _products(self, step: _Step, t: float) -> tuple[Array, Array]:
        """Return ``z (x - l)`` and ``y (u - x)`` after a part of a step, 0 without the bound."""
        low = (self.z + t * step.z) * (self.below + t * step.x)
        high = (self.y + t * step.y) * (self.above - t * step.x)
        return np.where(self._low, low, 0.0), np.where(self._high, high, 0.0)

    def _corrected(
        self, factors: Factors, step: _Step, aims: tuple[Array, Array], centre: float
    ) -> tuple[_Step, float]:
        """Return the step with its length, made longer by bringing products back to `centre`."""
        t = self._length(step, _TO_BOUNDARY)
        for _ in range(_CORRECTORS):
            if t >= 1 - _WORTHWHILE:
                break
            change = []
            for products in self._products(step, min(1.0, t + _LONGER)):
                near = np.clip(products, centre / _CENTRAL, _CENTRAL * centre)
                change.append(np.maximum(near - products, -_CENTRAL * centre))
            aims = (
                aims[0] + np.where(self._low, change[0], 0.0),
                aims[1] + np.where(self._high, change[1], 0.0),
            )
            other = self._step(factors, *aims)
            length = 0.0 if other is None else self._length(other, _TO_BOUNDARY)
            if other is None or length < t + _WORTHWHILE:
                break
            step, t = other, length
        return step, t

    def advance(self) -> float:
        """Take a step; its length, 0 where there is none."""
        from scipy.sparse import diags_array

        added = self.z / self.below + self.y / self.above + self._held
        factors = self.search.factoriser.factors_of(self.M + diags_array(added))
        none = np.zeros(self.search.n)
        ahead = None if factors is None else self._step(factors, none, none)
        if factors is None or ahead is None:
            return 0.0
        low, high = self._products(ahead, self._length(ahead, 1.0))
        mu = self.mu
        centre = (float(np.sum(low + high)) / self._pairs / mu) ** 3 * mu
        aims = (
            np.where(self._low, centre - ahead.x * ahead.z, 0.0),
            np.where(self._high, centre + ahead.x * ahead.y, 0.0),
        )
        step = self._step(factors, *aims)
        if step is None:
            return 0.0
        step, t = self._corrected(factors, step, aims, centre)
        self.x, self.z, self.y = self.x + t * step.x, self.z + t * step.z, self.y + t * step.y
        self.below = np.where(self._low, self.below + t * step.x, 1.0)
        self.above = np.where(self._high, self.above - t * step.x, 1.0)
        return t


def interior_point(
    search: Search, x: Array, M: Any, q: Array, move: float, *, limit: int = 40
) -> bool:
    """Follow the central path of ``M x + q`` from near `x`; whether a solution was found.

    Parameters
    ----------
    search : Search
        The problem.
    x : ndarray
        Where to begin, in the box.
    M, q : csr_array, ndarray
        The map.
    move : float
        Typical size of the unknowns, above zero.
    limit : int
        Steps.
    """
    inner = _Interior(search, x, M, q, move)
    few = SETTLED * search.n + 2
    first, at, wait, short, moved = inner.mu, None, 0, 0, 0
    if not 0 < first < np.inf:
        return False  # there are no bounds, but for components that are fixed
    for _ in range(limit):
        length = inner.advance()
        if not length > 0 or not np.isfinite(inner.x).all():
            return False
        short = short + 1 if length < _SHORT else 0
        now = inner.places()
        bounded = np.where(now < 0, search.lower, np.where(now > 0, search.upper, inner.x))
        F = search.value(bounded)
        if F is None or short > _SHORTS:
            return False
        if search.end_iteration(bounded, F):
            _settle(search, bounded, F, M, now)
            return True
        changes = search.n if at is None else int(np.count_nonzero(now != at))
        moved += 0 if at is None else changes
        at, wait, mu = now, wait - 1, inner.mu
        # before the first changes it is the set of the start
        told = mu <= _CLOSE * first if moved > few else mu <= _CLOSER * first
        if changes <= few and told and wait <= 0:
            if active_set_newton(search, bounded, F, M, patience=1).solved:
                return True
            wait = 4
        if mu <= 1e-30 * first:
            return False
    return False


def _settle(search: Search, x: Array, F: Array, M: Any, at: Any) -> None:
    """Make a solution on an active set exact where the Jacobian inside may be singular.

    ``M_II d = -F_I`` by proximal steps, which the rest of a singular but consistent system takes.
    """
    from scipy.sparse import diags_array

    free = np.flatnonzero(at == 0)
    if not len(free):
        return
    inside = M[free][:, free]
    weights = _PROXIMAL * rows_of_sizes(inside)
    factors = search.factoriser.factors_of(inside + diags_array(weights))
    step, left = np.zeros(len(free)), -F[free]
    for _ in range(_PASSES):
        part = None if factors is None else factors.solve(left)
        if part is None:
            return
        step = step + part
        left = -F[free] - inside @ step
    exact = x.copy()
    exact[free] += step
    exact = search.inside(exact)
    value = search.value(exact)
    if value is not None:
        search.consider(exact, value)
