"""The smoothing Newton method with a predictor, the second stage of the sparse solver.

```text
H(x) = x - p_mu(w) = 0,  w = x - F(x)/c,  c_i = max_j |J_ij|
p_mu(w) = w + g(w - l) - g(u - w),  g(a) = (sqrt(a^2 + 4 mu^2) - a)/2     (0 without the bound)
((1 - D) + D J/c) d = -H,  D = p_mu'(w) in (0, 1]
```

The projection onto the box is rounded off, less and less (Chen & Harker, *SIAM J. Matrix Anal.
Appl.* 14 (1993) 1168-1190; Kanzow, *SIAM J. Matrix Anal. Appl.* 17 (1996) 851-868). Multiplied by
``c/D`` the matrix is ``J + diag(c (1 - D)/D)``: the pattern of `J` in every iteration, symmetric
where `J` is. The same factors give the tangent ``dx/dmu``, along which `mu` falls as far as the
point stays near the path (Burke & Xu, *Math. Program.* 87 (2000) 113-130). Where the active set has
settled, Newton's method on it ends the solve exactly.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from zivi.base.arrays import Array
from zivi.vi.active_set import SETTLED, active_set_newton, places
from zivi.vi.factorisation import rows_of_sizes
from zivi.vi.sparse_search import Search

__all__ = ["proximal_newton", "smoothing_newton"]

_ARMIJO, _SHORTEST = 1e-4, 1e-6
_NEAR = 1.0
"""``|H|`` over ``mu sqrt(n)`` of points near the path."""
_FALLS = (1e-3, 1e-2, 0.03, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9)
_FEW_FALLS = (0.01, 0.1, 0.4, 0.8)
"""Factors of `mu` that are tried, the latter where each costs an evaluation of `F`."""
_SHORT, _RISE, _RISES = 0.2, 10.0, 4
"""Where the step is shorter, `mu` was too small to begin with: it is raised, a few times."""
_LEAST_SLOPE = 1e-14
_LEAST_MU = 1e-16
_SLOW = 25
"""Iterations without a smaller `mu` or a much smaller ``|H|``, after which it is given up."""


class _Smooth(NamedTuple):
    """``p_mu`` at a point."""

    value: Array
    slope: Array
    by_mu: Array


class _Projection:
    """The rounded projection onto the box."""

    def __init__(self, lower: Array, upper: Array) -> None:
        self._has_lower, self._has_upper = np.isfinite(lower), np.isfinite(upper)
        self._lower = np.where(self._has_lower, lower, 0.0)
        self._upper = np.where(self._has_upper, upper, 0.0)

    def value(self, w: Array, mu: float) -> Array:
        """Return ``p_mu(w)``."""
        below = _rounding(w - self._lower, mu)[0]
        above = _rounding(self._upper - w, mu)[0]
        value: Array = w + np.where(self._has_lower, below, 0) - np.where(self._has_upper, above, 0)
        return value

    def at(self, w: Array, mu: float) -> _Smooth:
        """Return ``p_mu(w)`` with its slopes; ``dg/da = -g/h``, ``dg/dmu = 2 mu/h``."""
        g_low, h_low = _rounding(w - self._lower, mu)
        g_high, h_high = _rounding(self._upper - w, mu)
        low, high = self._has_lower, self._has_upper
        value = w + np.where(low, g_low, 0) - np.where(high, g_high, 0)
        slope = 1 - np.where(low, g_low / h_low, 0) - np.where(high, g_high / h_high, 0)
        by_mu = 2 * mu * (np.where(low, 1 / h_low, 0) - np.where(high, 1 / h_high, 0))
        # 1 - g/h cancels far below a lower bound: there it is (h + a)/2h = 2 mu^2/(h (h - a))
        deep = low & (w < self._lower)
        small = 2 * mu**2 / (h_low * (h_low + np.abs(w - self._lower)))
        slope = np.where(deep, small - np.where(high, g_high / h_high, 0), slope)
        deep = high & (w > self._upper)
        small = 2 * mu**2 / (h_high * (h_high + np.abs(self._upper - w)))
        slope = np.where(deep, small - np.where(low, g_low / h_low, 0), slope)
        return _Smooth(value, np.clip(slope, _LEAST_SLOPE, 1.0), by_mu)


def _rounding(a: Array, mu: float) -> tuple[Array, Array]:
    """Return ``g(a) = (h - a)/2`` without cancellation, and ``h = sqrt(a^2 + 4 mu^2)``."""
    h = np.hypot(a, 2 * mu)
    return np.where(a > 0, 2 * mu**2 / (h + np.abs(a)), 0.5 * (h - a)), h


class _Point(NamedTuple):
    """A point with its `F`, and ``|H|/sqrt(n)`` there."""

    x: Array
    F: Array
    size: float


class _Smoothing:
    """One run of the method.

    Parameters
    ----------
    search : Search
        The problem.
    x, F, J : ndarray, ndarray, csr_array
        Where to begin, and the map and its Jacobian there.
    mu : float
        The first one.
    weight : float
        Of the proximal term, ``weight c`` times the distance from there.
    """

    def __init__(
        self,
        search: Search,
        x: Array,
        F: Array,
        J: Any,
        mu: float,
        *,
        weight: float = 0.0,
    ) -> None:
        self.search = search
        self._project = _Projection(search.lower, search.upper)
        self._falls = _FALLS if search.map.is_affine else _FEW_FALLS
        self._centre = x
        self._weight = weight
        self.c = rows_of_sizes(J)
        self.mu = mu
        self._least = _LEAST_MU * mu
        self._rises = 0
        self.J = J
        self.point = _Point(x, F, np.inf)

    def _proximal(self, x: Array, F: Array) -> Array:
        """Return ``F + weight c (x - centre)``."""
        return F + self._weight * self.c * (x - self._centre) if self._weight else F

    def _size(self, x: Array, F: Array, mu: float) -> float:
        H = x - self._project.value(x - self._proximal(x, F) / self.c, mu)
        return float(np.linalg.norm(H) / np.sqrt(len(H)))

    def _at(self, x: Array, mu: float) -> _Point | None:
        """Evaluate a trial; None where `F` is not finite."""
        if not self.search.map.is_affine:
            x = self.search.inside(x)
        F = self.search.value(x)
        return None if F is None else _Point(x, F, self._size(x, F, mu))

    def _directions(self) -> list[Array] | None:
        """Return the Newton step and the tangent ``dx/dmu``; None where there is none."""
        from scipy.sparse import diags_array

        x, F, _ = self.point
        p = self._project.at(x - self._proximal(x, F) / self.c, self.mu)
        weights = self.c / p.slope
        added = weights * (1 - p.slope) + self._weight * self.c
        matrix = self.J + diags_array(added)
        return self.search.factoriser.solve(matrix, weights * (p.value - x), weights * p.by_mu)

    def step(self) -> bool:
        """Take a step, `mu` as small as it may be; whether there is one."""
        directions = self._directions()
        if directions is None:
            return False
        newton, tangent = directions
        x, F, _ = self.point
        if not np.isfinite(newton).all():
            return False
        size = self._size(x, F, self.mu)
        ahead = self._ahead(newton, tangent) if np.isfinite(tangent).all() else None
        if ahead is not None:
            self.point, self.mu = ahead
            return True
        t = 1.0
        while t >= _SHORTEST:
            trial = self._at(x + t * newton, self.mu)
            if trial is not None and trial.size <= (1 - _ARMIJO * t) * size:
                self.point = trial
                if t < _SHORT and self._rises < _RISES:
                    self.mu *= _RISE
                    self._rises += 1
                return True
            t *= 0.5
        return False

    def _ahead(self, newton: Array, tangent: Array) -> tuple[_Point, float] | None:
        """Return the point along both directions where `mu` is least near the path, with `mu`."""
        x = self.point.x
        for fall in self._falls:
            mu = fall * self.mu
            trial = self._at(x + newton + (mu - self.mu) * tangent, mu)
            if trial is not None and trial.size <= _NEAR * mu:
                return trial, mu
        trial = self._at(x + newton, self.mu)
        if trial is not None and trial.size <= _NEAR * self.mu:
            return trial, self.mu
        return None

    def run(self, limit: int) -> bool:
        """Go on until a solution is found; False where that fails."""
        search = self.search
        settled = SETTLED * search.n + 2
        wait, at, least, since = 0, None, np.inf, 0
        for _ in range(limit):
            mu, size = self.mu, self.point.size
            if not self.step():
                return False
            x, F, _ = self.point
            if search.end_iteration(x, F):
                return True
            if not search.map.is_affine and not self._linearise():
                return False
            now = places(search, x, F, self.c)
            changes = search.n if at is None else int(np.count_nonzero(now != at))
            at, wait = now, wait - 1
            if self.mu < mu and changes <= settled and wait <= 0 and not self._weight:
                if active_set_newton(search, x, F, self.J, patience=1).solved:
                    return True
                wait = 3
            has_moved = self.mu < least or self.point.size < 0.9 * size
            least, since = min(least, self.mu), 0 if has_moved else since + 1
            if self.mu < self._least or since > _SLOW:
                return False
        return False

    def _linearise(self) -> bool:
        J = self.search.slopes(self.point.x)
        if J is None:
            return False
        self.J, self.c = J, rows_of_sizes(J)
        return True


def smoothing_newton(
    search: Search, x: Array, F: Array, J: Any, mu: float, *, limit: int = 100
) -> bool:
    """Follow the path of the rounded problems from `x`; whether a solution was found.

    Parameters
    ----------
    search : Search
        The problem.
    x, F, J : ndarray, ndarray, csr_array
        Where to begin, and the map and its Jacobian there.
    mu : float
        The first one: a mean of the size of the unknowns and of ``F/c``.
    limit : int
        Iterations.
    """
    return _Smoothing(search, x, F, J, mu).run(limit)


def proximal_newton(search: Search, x: Array, F: Array, J: Any, mu: float, *, limit: int) -> bool:
    """Do the same with ``F + eps c (x - x_k)``, `eps` from 1e-2 to 1e-9: for singular Jacobians."""
    weight = 1e-2
    while weight > 5e-10:
        inner = _Smoothing(search, x, F, J, mu, weight=weight)
        if inner.run(limit):
            return True
        x = search.inside(inner.point.x)
        value = search.value(x)
        J = search.slopes(x) if value is not None else None
        if value is None or J is None:
            return False
        F, weight = value, 0.1 * weight
        if active_set_newton(search, x, F, J, patience=1).solved:
            return True
    return False
