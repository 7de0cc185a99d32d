"""Methods of the sparse solver: active set, smoothing, interior point, and their search."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from zivi.base.check import Array
from zivi.vi.factorisation import Factoriser, Factors, in_thread, rows_of_sizes
from zivi.vi.types import VIStatus

# The search of the sparse solver: problem, best point so far, termination.


class Map(Protocol):
    """``F`` and its Jacobian, None where undefined."""

    is_affine: bool
    rounding: float
    nfev: int

    @property
    def undefined_points(self) -> str:
        """Text about points where `F` is not defined."""

    def value(self, x: Array) -> Array | None:
        """Return ``F(x)``."""

    def slopes(self, x: Array) -> Any:
        """Return the Jacobian as a ``csr_array``."""


class EndedError(Exception):
    """The search has ended from within, with a status."""

    def __init__(self, status: VIStatus) -> None:
        super().__init__(status.name)
        self.status = status


def natural_map(x: Array, F: Array, lower: Array, upper: Array) -> Array:
    """Return ``max(x - u, min(x - l, F))``, zero at a solution; it does not cancel at large `x`."""
    return np.maximum(x - upper, np.minimum(x - lower, F))


class Search:
    """Shared state of the stages.

    Parameters
    ----------
    map_ : Map
        The problem.
    lower, upper, x0 : ndarray
        The box and the initial point.
    tol, rtol : float
        Tolerances (see `solve_vi`).
    max_iterations : int
        Of all stages together.
    row_scale : ndarray or None
        Factors of the rows.
    time_limit : float or None
        Seconds.
    observe : callable or None
        Called after every iteration.
    """

    def __init__(
        self,
        map_: Map,
        lower: Array,
        upper: Array,
        x0: Array,
        *,
        tol: float,
        rtol: float,
        max_iterations: int,
        row_scale: Array | None,
        time_limit: float | None,
        observe: Callable[[int, float, int, str], object] | None,
    ) -> None:
        self.map = map_
        self.lower, self.upper, self.x0 = lower, upper, x0
        self.n = len(x0)
        self.tol, self._rtol = tol, rtol
        self._max_iterations = max_iterations
        self.scale = np.ones(self.n) if row_scale is None else row_scale
        self._deadline = None if time_limit is None else time.perf_counter() + time_limit
        self._observe = observe
        self.factoriser = Factoriser(self.poll)
        self.stage = "S0"
        self.found_in = "S0"
        self.n_iter = self.njev = 0
        self.best_x, self.best_residual = x0, np.inf
        self.best_F = np.full(self.n, np.nan)
        self.ratio = np.nan
        self._last = np.nan

    def poll(self) -> None:
        """End the search where its time is over."""
        if self._deadline is not None and time.perf_counter() > self._deadline:
            raise EndedError(VIStatus.TIME_LIMIT)

    @property
    def time_left(self) -> float | None:
        """Seconds until the time limit."""
        if self._deadline is None:
            return None
        return max(self._deadline - time.perf_counter(), 1e-3)

    def value(self, x: Array) -> Array | None:
        """Return `F` with its rows scaled; None if not finite."""
        self.poll()
        F = self.map.value(x)
        if F is None or not np.isfinite(F).all():
            return None
        return self.scale * F

    def slopes(self, x: Array) -> Any:
        """Return the Jacobian with its rows scaled; None if not finite."""
        self.poll()
        self.njev += 1
        J = self.map.slopes(x)
        if J is None or not np.isfinite(J.data).all():
            return None
        self.factoriser.see_pattern(J)
        if np.any(self.scale != 1):
            J = J.copy()
            J.data *= np.repeat(self.scale, np.diff(J.indptr))
        return J

    def inside(self, x: Array) -> Array:
        """Return the nearest point of the box."""
        return np.minimum(np.maximum(x, self.lower), self.upper)

    def consider(self, x: Array, F: Array) -> bool:
        """Store a point of the box if it is the best so far; return whether it is a solution."""
        residual = float(np.max(np.abs(natural_map(x, F, self.lower, self.upper))))
        if self._rtol and not np.isfinite(self.best_residual):
            self.tol = max(self.tol, self._rtol * residual)
        if residual < self.best_residual:
            self.best_x, self.best_F, self.best_residual = x, F, residual
            self.found_in = self.stage
        return residual <= self.tol

    def end_iteration(self, x: Array, F: Array) -> bool:
        """End an iteration at the point of the box nearest to `x`; whether that is a solution.

        It is counted and reported to the caller; limits are checked.
        """
        clipped = self.inside(x)
        value = F if np.array_equal(clipped, x) else self.value(clipped)
        solved = value is not None and self.consider(clipped, value)
        self._report(clipped, F if value is None else value)
        return solved

    def _report(self, x: Array, F: Array) -> None:
        self.n_iter += 1
        sizes = np.abs(natural_map(x, F, self.lower, self.upper))
        worst = int(np.argmax(sizes))
        residual = float(sizes[worst])
        with np.errstate(all="ignore"):
            self.ratio = float(np.float64(residual) / self._last)
        self._last = residual
        if self._observe is not None:
            try:
                self._observe(self.n_iter, residual, worst, self.stage)
            except StopIteration:
                raise EndedError(VIStatus.STOPPED) from None
        self.poll()
        if self.n_iter >= self._max_iterations and self.best_residual > self.tol:
            raise EndedError(VIStatus.ITERATION_LIMIT)


# Newton's method on the active set, the first stage of the sparse solver.
#
# ```text
# w = x - F/c,  A = {w <= l} and {w >= u},  I = the rest
# x_A at its bounds,  J_II d_I = -F_I - J_IA d_A
# ```
#
# The semismooth Newton method for the projection equation (Hintermüller, Ito & Kunisch, *SIAM J.
# Optim.* 13 (2002) 865-888): from a good initial point, such as a coarser grid's solution, two to
# four factorisations. From afar the boundary of the active set may move by one cell a step; then it
# is given up.

SETTLED = 2e-3
"""Changes of the active set, of all components, from which on other methods try it."""
_PATIENCE = 2
"""Steps whose changes of the active set are not half of those before."""
_LARGEST = 1e15
_SHORTEST_NEWTON = 2e-3
_MEMORY = 5
_ARMIJO = 1e-4


class ActiveSetEnd(NamedTuple):
    """How the stage ended."""

    solved: bool
    """A point within the tolerance was found."""
    move: float
    """Root mean square of the first step: that of the solution, perhaps."""
    largest: float
    """Largest component of the smallest step, 0 without one."""


def active_set(search: Search, x: Array, F: Array, c: Array) -> Any:
    """Return -1 where ``x - F/c`` is at or below the lower bound, 1 at the upper, 0 inside."""
    w = x - F / c
    up = (w >= search.upper).astype(np.int8)
    return up - (w <= search.lower).astype(np.int8) * (1 - up)


def active_set_newton(
    search: Search, x: Array, F: Array, J: Any, *, patience: int = _PATIENCE
) -> ActiveSetEnd:
    """Iterate from `x`, which need not be in the box for affine `F`, while it converges.

    Parameters
    ----------
    search : Search
        The problem.
    x, F, J : ndarray, ndarray, csr_array
        Where to begin, and the map and its Jacobian there.
    patience : int
        Steps whose changes of the active set may be more than half of those before.
    """
    c = rows_of_sizes(J)
    at = active_set(search, x, F, c)
    sizes = [float(np.linalg.norm(natural_map(x, F, search.lower, search.upper)))]
    fewest, slow, moves = search.n + 1, 0, (0.0, 0.0)
    while True:
        step = _step(search, x, F, J, at)
        if step is None:
            return ActiveSetEnd(False, *moves)
        largest = float(np.max(np.abs(step)))
        moves = moves[0] or float(np.sqrt(np.mean(step**2))), min(moves[1] or largest, largest)
        moved = _next_point(search, x, step, sizes)
        if moved is None:
            return ActiveSetEnd(False, *moves)
        x, F = moved
        if search.end_iteration(x, F):
            return ActiveSetEnd(True, *moves)
        if not search.map.is_affine:
            J = search.slopes(x)
            if J is None:
                return ActiveSetEnd(False, *moves)
            c = rows_of_sizes(J)
        now = active_set(search, x, F, c)
        changes = int(np.count_nonzero(now != at))
        if changes == 0 and search.map.is_affine:
            return ActiveSetEnd(False, *moves)  # as exact as it gets
        slow = slow + 1 if 2 * changes > fewest else 0
        fewest, at = min(fewest, changes), now
        is_converging = not search.map.is_affine and sizes[-1] <= 0.1 * sizes[-2]
        if slow >= patience and not is_converging:
            return ActiveSetEnd(False, *moves)


def _step(search: Search, x: Array, F: Array, J: Any, at: Any) -> Array | None:
    """Return the step of the active set; None where its Jacobian is singular."""
    step = np.where(at < 0, search.lower, search.upper) - x
    free = np.flatnonzero(at == 0)
    step[free] = 0.0
    if len(free):
        rows = J[free]
        solved = search.factoriser.solve(rows[:, free], -F[free] - rows @ step, free=free)
        if solved is None:
            return None
        step[free] = solved[0]
    if not np.isfinite(step).all() or np.max(np.abs(x + step)) > _LARGEST:
        return None
    return step


def _next_point(
    search: Search, x: Array, step: Array, sizes: list[float]
) -> tuple[Array, Array] | None:
    """Return the next point with `F` there: a full step for affine `F`, else a search in the box.

    ``|natural map| <= (1 - 1e-4 t) max of the last five``.
    """
    if search.map.is_affine:
        F = search.value(x + step)
        return None if F is None else (x + step, F)
    t = 1.0
    while t >= _SHORTEST_NEWTON:
        trial = search.inside(x + t * step)
        F = search.value(trial)
        if F is not None:
            size = float(np.linalg.norm(natural_map(trial, F, search.lower, search.upper)))
            if size <= (1 - _ARMIJO * t) * max(sizes[-_MEMORY:]):
                sizes.append(size)
                return trial, F
        t *= 0.5
    return None


# The smoothing Newton method with a predictor, the second stage of the sparse solver.
#
# ```text
# H(x) = x - p_mu(w) = 0,  w = x - F(x)/c,  c_i = max_j |J_ij|
# p_mu(w) = w + g(w - l) - g(u - w),  g(a) = (sqrt(a^2 + 4 mu^2) - a)/2     (0 without the bound)
# ((1 - D) + D J/c) d = -H,  D = p_mu'(w) in (0, 1]
# ```
#
# The projection onto the box is rounded off, less and less (Chen & Harker, *SIAM J. Matrix Anal.
# Appl.* 14 (1993) 1168-1190; Kanzow, *SIAM J. Matrix Anal. Appl.* 17 (1996) 851-868). Multiplied by
# ``c/D`` the matrix is ``J + diag(c (1 - D)/D)``: the pattern of `J` in every iteration, symmetric
# where `J` is. The same factors give the tangent ``dx/dmu``, along which `mu` decreases while the
# point stays close to the path (Burke & Xu, *Math. Program.* 87 (2000) 113-130). Where the active
# set has settled, Newton's method on it ends the solve exactly.

_SHORTEST_SMOOTHING = 1e-6
_NEAR = 1.0
"""``|H|`` over ``mu sqrt(n)`` of points near the path."""
_FALLS = (1e-3, 1e-2, 0.03, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9)
_FEW_FALLS = (0.01, 0.1, 0.4, 0.8)
"""Factors of `mu` that are tried, the latter where each costs an evaluation of `F`."""
_SHORT_SMOOTHING, _RISE, _RISES = 0.2, 10.0, 4
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


class _Iterate(NamedTuple):
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
        self.point = _Iterate(x, F, np.inf)

    def _proximal(self, x: Array, F: Array) -> Array:
        """Return ``F + weight c (x - centre)``."""
        return F + self._weight * self.c * (x - self._centre) if self._weight else F

    def _size(self, x: Array, F: Array, mu: float) -> float:
        H = x - self._project.value(x - self._proximal(x, F) / self.c, mu)
        return float(np.linalg.norm(H) / np.sqrt(len(H)))

    def _at(self, x: Array, mu: float) -> _Iterate | None:
        """Evaluate a trial; None where `F` is not finite."""
        if not self.search.map.is_affine:
            x = self.search.inside(x)
        F = self.search.value(x)
        return None if F is None else _Iterate(x, F, self._size(x, F, mu))

    def _directions(self) -> list[Array] | None:
        """Return the Newton step and the tangent ``dx/dmu``; None if there is none."""
        from scipy.sparse import diags_array

        x, F, _ = self.point
        p = self._project.at(x - self._proximal(x, F) / self.c, self.mu)
        weights = self.c / p.slope
        added = weights * (1 - p.slope) + self._weight * self.c
        matrix = self.J + diags_array(added)
        return self.search.factoriser.solve(matrix, weights * (p.value - x), weights * p.by_mu)

    def step(self) -> bool:
        """Step with the smallest admissible `mu`; return whether there is one."""
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
        while t >= _SHORTEST_SMOOTHING:
            trial = self._at(x + t * newton, self.mu)
            if trial is not None and trial.size <= (1 - _ARMIJO * t) * size:
                self.point = trial
                if t < _SHORT_SMOOTHING and self._rises < _RISES:
                    self.mu *= _RISE
                    self._rises += 1
                return True
            t *= 0.5
        return False

    def _ahead(self, newton: Array, tangent: Array) -> tuple[_Iterate, float] | None:
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
        """Iterate until a solution is found; False where that fails."""
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
            now = active_set(search, x, F, self.c)
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


# An interior-point method for sparse affine problems that are monotone, from afar.
#
# ```text
# M x + q - z + y = 0,   z (x - l) = mu,   y (u - x) = mu,   l < x < u,  z > 0,  y > 0
# (M + diag(z/(x - l) + y/(u - x))) dx = ...
# ```
#
# Mehrotra's predictor and corrector (*SIAM J. Optim.* 2 (1992) 575-601) and Gondzio's centrality
# correctors (*Comput. Optim. Appl.* 6 (1996) 137-156), which share the factors: the number of steps
# hardly grows with that of the unknowns, the pattern is that of `M`. The remaining sign conditions
# are resolved by Newton's method on the active set. Where `M` is not monotone the steps become
# short, and it is given up.

_TO_BOUNDARY = 0.995
_SHORT_INTERIOR, _SHORTS_INTERIOR = 0.1, 4
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
        # stored in addition to x, whose difference to a bound would cancel; 1 without a bound
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
        """Step once; return the step length, 0 if there is none."""
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
        short = short + 1 if length < _SHORT_INTERIOR else 0
        now = inner.places()
        bounded = np.where(now < 0, search.lower, np.where(now > 0, search.upper, inner.x))
        F = search.value(bounded)
        if F is None or short > _SHORTS_INTERIOR:
            return False
        if search.end_iteration(bounded, F):
            _polish(search, bounded, F, M, now)
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


def _polish(search: Search, x: Array, F: Array, M: Any, at: Any) -> None:
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


# Sparse affine problems without a solution, told by a row or by a certificate of Farkas.
#
# A solution needs ``F_i >= 0`` where ``u_i = inf`` and ``F_i <= 0`` where ``l_i = -inf``. HiGHS
# minimises the sum of the violations over the box; if the minimum is positive, its multipliers
# prove that no point satisfies these rows. The proof is checked on the data:
#
# ```text
# y_i >= 0 where F_i >= 0 is needed, y_i <= 0 where F_i <= 0 is, y_i = 0 where neither is:
# y'F >= 0 at every solution, but   max y'F over the box < 0
# ```

_NEGLIGIBLE = 1e-11
"""Slopes of the proof below this, relative to their terms, are rounding."""
_UNBOUNDED = 1e8
"""Where a column of the proof vanishes but for rounding, it holds for components up to this."""


def _most(search: Search, M: Any, q: Array) -> Array:
    """Return ``max F_i`` over the box, row by row."""
    up, down = M.maximum(0), M.minimum(0)
    for part in (up, down):
        part.eliminate_zeros()  # 0 inf
    value: Array = up @ search.upper + down @ search.lower + q
    return value


def a_row_is_infeasible(search: Search, M: Any, q: Array) -> bool:
    """Whether a row has the wrong sign everywhere in the box."""
    most, least = _most(search, M, q), -_most(search, -M, -q)
    sizes = abs(M) @ np.where(np.isfinite(search.lower), np.abs(search.lower), 0.0)
    sizes += abs(M) @ np.where(np.isfinite(search.upper), np.abs(search.upper), 0.0)
    slack = search.tol + _NEGLIGIBLE * (sizes + np.abs(q))
    never_positive = np.isposinf(search.upper) & (most < -slack)
    never_negative = np.isneginf(search.lower) & (least > slack)
    return bool(np.any(never_positive | never_negative))


def is_infeasible(search: Search, M: Any, q: Array) -> bool:
    """Whether it is proved that no point satisfies all rows, by more than the tolerance."""
    positive = np.flatnonzero(np.isposinf(search.upper))
    negative = np.flatnonzero(np.isneginf(search.lower))
    if not len(positive) + len(negative):
        return False
    y = np.zeros(search.n)
    found = _phase_one(search, M, q, positive, negative)
    if found is None:
        return False
    y[positive] += np.maximum(found[: len(positive)], 0.0)
    y[negative] -= np.maximum(found[len(positive) :], 0.0)
    y[np.abs(y) <= _NEGLIGIBLE * np.max(np.abs(y), initial=0.0)] = 0.0
    return bool(np.any(y)) and _proves(search, M, q, y)


def _phase_one(search: Search, M: Any, q: Array, positive: Any, negative: Any) -> Array | None:
    """Return multipliers of ``min sum s``, ``F_i + s_i >= 0`` (or ``-F_i``), over the box."""
    from scipy.optimize import linprog
    from scipy.sparse import eye_array, hstack, vstack

    rows = vstack([M[positive], -M[negative]], format="csr")
    constant = np.concatenate([q[positive], -q[negative]])
    sizes = np.maximum(abs(rows).max(axis=1).toarray().ravel(), np.abs(constant))
    sizes = np.where(sizes > 0, sizes, 1.0)
    rows.data /= np.repeat(sizes, np.diff(rows.indptr))
    k = len(constant)
    limit = search.time_left
    options: dict[str, float] = {} if limit is None else {"time_limit": limit}
    bounds = np.column_stack(
        [np.append(search.lower, np.zeros(k)), np.append(search.upper, np.full(k, np.inf))]
    )
    costs = np.append(np.zeros(search.n), np.ones(k))
    matrix = hstack([-rows, -eye_array(k)], format="csc")
    found = in_thread(
        lambda: linprog(
            costs, matrix, constant / sizes, bounds=bounds, method="highs", options=options
        ),
        search.poll,
    )
    if found.status != 0 or not found.fun > 0:
        return None
    multipliers: Array = -np.asarray(found.ineqlin.marginals, float) / sizes
    return multipliers


def _proves(search: Search, M: Any, q: Array, y: Array) -> bool:
    """Whether ``max y'F`` over the box is below zero, by more than tolerance and rounding."""
    by_columns = M.T.tocsr()
    slopes, terms = by_columns @ y, abs(by_columns) @ np.abs(y)
    bound = np.where(slopes > 0, search.upper, search.lower)
    is_finite = np.isfinite(bound)
    vanishes = np.abs(slopes) <= _NEGLIGIBLE * terms
    if np.any(~is_finite & ~vanishes & (slopes != 0)):
        return False
    reach = np.where(is_finite, bound, 0.0)
    most = float(y @ q + slopes @ reach)
    slack = search.tol * float(np.sum(np.abs(y)))
    slack += _UNBOUNDED * float(np.sum(np.abs(slopes[~is_finite])))
    size = float(np.abs(y) @ np.abs(q) + terms @ np.abs(reach))
    return bool(most + slack + search.n * np.finfo(float).eps * size < 0)
