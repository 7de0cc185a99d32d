"""Solver for large sparse box VIs: maps, stages, statuses, result."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from zivi.base.check import MAX_DENSE, Array, is_sparse
from zivi.vi.factorisation import rows_of_sizes
from zivi.vi.jacobian import ColouredDifferences, pattern_of
from zivi.vi.sparse_methods import (
    EndedError,
    Map,
    Search,
    a_row_is_infeasible,
    active_set_newton,
    interior_point,
    is_infeasible,
    natural_map,
    proximal_newton,
    smoothing_newton,
)
from zivi.vi.types import VIResult, VIStatus

# Maps of the sparse solver: affine maps, and callables with checks of their values.


def sparse_matrix(name: str, value: Any, n: int) -> Any:
    """Return a matrix, sparse or dense, as a ``csr_array`` of floats, ``n x n``."""
    from scipy.sparse import csr_array

    given = value if is_sparse(value) else np.asarray(value)
    if given.shape != (n, n):
        raise ValueError(f"{name} must have shape ({n}, {n}), got {given.shape}")
    if given.dtype.kind not in "biuf":
        raise TypeError(f"{name} must hold real numbers, got dtype {given.dtype}")
    matrix = csr_array(given, dtype=np.float64, copy=True)
    matrix.sum_duplicates()
    return matrix


def require_finite_entries(name: str, matrix: Any) -> None:
    """Reject a ``csr_array`` that holds NaN or infinity."""
    bad = np.flatnonzero(~np.isfinite(matrix.data))
    if len(bad):
        i = int(np.searchsorted(matrix.indptr, bad[0], side="right")) - 1
        j = int(matrix.indices[bad[0]])
        raise ValueError(f"{name}[{i}, {j}] must be finite, got {matrix.data[bad[0]]}")


class AffineMap:
    """``F(x) = M x + q``."""

    is_affine = True
    rounding = float(np.finfo(float).eps)
    undefined_points = ""

    def __init__(self, M: Any, q: Array) -> None:
        self._M, self._q = M, q
        self.nfev = 0

    def value(self, x: Array) -> Array:
        """Return ``M x + q``."""
        self.nfev += 1
        value: Array = self._M @ x + self._q
        return value

    def slopes(self, x: Array) -> Any:
        """Return `M`."""
        return self._M


class CallableMap:
    """`F` and its Jacobian by callables.

    An `ArithmeticError` or a `ValueError` after the first call means that they are not defined.

    Parameters
    ----------
    F : callable
        The map.
    jac : callable, or tuple of pattern and scheme
        The Jacobian as a matrix, or arguments of `ColouredDifferences`.
    converts : callable
        Converts a value of `F` to an array with its rounding.
    lower, upper : ndarray
        The box.
    """

    is_affine = False

    def __init__(
        self,
        F: Callable[[Array], Any],
        jac: Callable[[Array], Any] | tuple[Any, str],
        converts: Callable[[Any], tuple[Array, float]],
        lower: Array,
        upper: Array,
    ) -> None:
        self._F, self._converts = F, converts
        self._n = len(lower)
        self._box = lower, upper
        self._jac = jac if callable(jac) else None
        self._differences = None if callable(jac) else self._coloured(*jac)
        self._called = [False, False]
        self.rounding = float(np.finfo(float).eps)
        self.nfev = 0
        self._undefined = 0
        self._last_error = ""

    def _coloured(self, pattern: Any, scheme: str) -> ColouredDifferences:
        value = self._complex_value if scheme == "cs" else self.value
        return ColouredDifferences(value, pattern, scheme, *self._box)

    def value(self, x: Array) -> Array | None:
        """Return ``F(x)``; None where it raised."""
        self.nfev += 1
        value = self._call(0, self._F, x)
        if value is None:
            return None
        array, self.rounding = self._converts(value)
        return array

    def _complex_value(self, x: Any) -> Any:
        """Return ``F(x)`` at a complex point."""
        self.nfev += 1
        value = self._call(0, self._F, x)
        if value is None:
            return None
        array = np.asarray(value)
        if array.dtype.kind != "c":
            raise TypeError(
                "F(x) must be complex where x is, for jac='cs'; got dtype "
                f"{array.dtype}: F is not analytic, or discards the imaginary part"
            )
        if array.shape != (self._n,):
            raise TypeError(f"F(x) must have shape ({self._n},), got {array.shape}")
        return array

    def slopes(self, x: Array) -> Any:
        """Return the Jacobian, entries that are not finite by differences; None if it raised."""
        if self._jac is None:
            return self._by_differences(x)
        value = self._call(1, self._jac, x)
        if value is None:
            return None
        J = sparse_matrix("jac(x)", value, self._n)
        if not np.isfinite(J.data).all():
            pattern = pattern_of(J.astype(bool), self._n)
            differences = ColouredDifferences(self.value, pattern, "3-point", *self._box)
            found = differences(x, self.rounding)
            if found is None:
                return None
            J.sort_indices()
            bad = ~np.isfinite(J.data)
            rows = np.repeat(np.arange(self._n), np.diff(J.indptr))[bad]
            J.data[bad] = np.asarray(found.tocsr()[rows, J.indices[bad]]).ravel()
        return J

    def _by_differences(self, x: Array) -> Any:
        if self._differences is None:
            return None
        found = self._differences(x, self.rounding)
        return None if found is None else found.tocsr()

    def _call(self, which: int, function: Callable[[Array], Any], x: Array) -> Any:
        try:
            value = function(x.copy())
        except (ArithmeticError, ValueError) as error:
            if not self._called[which]:
                raise
            self._undefined += 1
            self._last_error = str(error)
            return None
        finally:
            self._called[which] = True
        if value is None:
            raise TypeError(f"{('F(x)', 'jac(x)')[which]} must hold real numbers, got None")
        return value

    @property
    def undefined_points(self) -> str:
        """Text about points where `F` or its Jacobian raised."""
        if not self._undefined:
            return ""
        return (
            f"; raised at {self._undefined} points and taken as not defined there, the last time "
            f"{self._last_error}"
        )


# The solver of large sparse box VIs: its stages, its statuses, its result.
#
# ```text
# S0  Newton's method on the active set, from x0
# IP  an interior-point method, for affine problems, ended by S0
# SM  smoothing Newton, from x0, ended by S0
# S2  the same with a proximal term, for singular Jacobians
# the dense solver, where there are at most MAX_DENSE unknowns
# ```
#
# The only criterion of success is the natural residual, recomputed from `F` at a point of the box.

_PUSHES = (0.0, 1e-6, 1e-3, 1e-1, 1.0)
"""Distances from the bounds at which a start is tried while `F` is not finite there."""
_MAX_ITERATIONS = 10_000
_STAGE_ITERATIONS = 100
_PROXIMAL_ITERATIONS = 25
_INTERIOR_STEPS = 40
_ROUNDINGS = 10
_NEAR = 1e-6
"""Of the terms of `F` at the start: more rounding than that is no tolerance."""
_SINGULAR = 1e-12
_TRUSTED = 1e-3
"""Error of the slopes along a direction, relative to their size, of rows that are believed."""

_MESSAGES = {
    VIStatus.SOLVED: "solved: the natural residual is within the tolerance",
    VIStatus.SOLVED_NOT_ISOLATED: (
        "solved, but the Jacobian is singular there: other solutions may lie arbitrarily near"
    ),
    VIStatus.STALLED: (
        "progress became too slow: check the Jacobian, scale the rows of F, try another starting "
        "point, or the problem may have no solution"
    ),
    VIStatus.ITERATION_LIMIT: "the iteration limit was reached: raise it or start nearer",
    VIStatus.DOMAIN_ERROR: (
        "F or its Jacobian is not finite at all trial points: start where both are finite, or "
        "tighten the bounds to their domain"
    ),
    VIStatus.INFEASIBLE: (
        "there is no solution: no point of the box satisfies all rows of F (for components with "
        "one bound, their signs); check the bounds and the sign of F"
    ),
    VIStatus.STOPPED: "stopped by the caller before a solution was found",
    VIStatus.TIME_LIMIT: "the time limit was reached: allow more time or start nearer",
}


def solve_sparse(
    map_: Map,
    box: tuple[Array, Array],
    start: Array,
    settings: dict[str, Any],
    time_limit: float | None,
    observe: Callable[[int, float, int, str], object] | None,
    dense: Callable[[float | None], VIResult] | None = None,
) -> VIResult:
    """Solve a box VI with a sparse Jacobian.

    Parameters
    ----------
    map_ : Map
        `F` and its Jacobian.
    box : tuple of ndarray
        Lower and upper bounds.
    start : ndarray
        Where to begin; it is moved into the box.
    settings : dict
        What differs from the defaults of `VIOptions`.
    time_limit : float or None
        Seconds.
    observe : callable or None
        Called after every iteration.
    dense : callable, optional
        The dense solver, for small problems within the remaining time.
    """
    lower, upper = box
    inside = np.minimum(np.maximum(start, lower), upper)
    search = Search(
        map_,
        lower,
        upper,
        inside,
        tol=settings.get("tol", 1e-9),
        rtol=settings.get("rtol", 0.0),
        max_iterations=settings.get("max_iterations", _MAX_ITERATIONS),
        row_scale=settings.get("row_scale"),
        time_limit=time_limit,
        observe=observe,
    )
    try:
        status = _stages(search, settings)
    except EndedError as end:
        status = end.status
    if search.best_residual <= search.tol:
        status = VIStatus.SOLVED
    elif status is VIStatus.SOLVED:
        status = VIStatus.STALLED
    projected = not np.array_equal(inside, start)
    if status in (VIStatus.STALLED, VIStatus.DOMAIN_ERROR) and dense and search.n <= MAX_DENSE:
        return _with_work_before(search, dense(search.time_left), projected)
    if status is VIStatus.SOLVED and settings.get("test_isolation", True):
        try:
            if not _is_isolated(search):
                status = VIStatus.SOLVED_NOT_ISOLATED
        except EndedError:
            pass  # there was no time for the test
    search.factoriser.forget()
    return _result(search, status, projected)


def _stages(search: Search, settings: dict[str, Any]) -> VIStatus:
    """Run the stages until one succeeds."""
    begun = _interior_start(search, bool(settings.get("scale_by_jacobian")))
    if begun is None:
        return VIStatus.DOMAIN_ERROR
    x, F, J = begun
    if search.best_residual <= search.tol:
        return VIStatus.SOLVED
    size = float(np.max(np.abs(F) + abs(J) @ np.abs(x)))
    constant = F - J @ x if search.map.is_affine else None
    if constant is not None and a_row_is_infeasible(search, J, constant):
        return VIStatus.INFEASIBLE
    mu, move = _first_mu(search, x, F, J, 0.0), 0.0
    if settings.get("active_set", True):
        end = active_set_newton(search, x, F, J)
        if end.solved:
            return VIStatus.SOLVED
        mu, move = _first_mu(search, x, F, J, end.move), end.largest
    limit = settings.get("stage_iterations", _STAGE_ITERATIONS)
    search.stage = "IP"
    if constant is not None and settings.get("smoothing", True):
        steps = min(limit, _INTERIOR_STEPS)
        if interior_point(search, x, J, constant, move or max(mu, 1e-8), limit=steps):
            return VIStatus.SOLVED
    search.stage = "SM"
    if settings.get("smoothing", True) and smoothing_newton(search, x, F, J, mu, limit=limit):
        return VIStatus.SOLVED
    if _is_within_rounding(search, size):
        return VIStatus.SOLVED
    if constant is not None and is_infeasible(search, J, constant):
        return VIStatus.INFEASIBLE
    search.stage = "S2"
    if settings.get("proximal", True):
        limit = min(limit, _PROXIMAL_ITERATIONS)
        if proximal_newton(search, x, F, J, mu, limit=limit):
            return VIStatus.SOLVED
        if _is_within_rounding(search, size):
            return VIStatus.SOLVED
    return VIStatus.STALLED


def _interior_start(search: Search, scales: bool) -> tuple[Array, Array, Any] | None:
    """Return the start, off its bounds where it must be, with `F` and its Jacobian there."""
    width = search.upper - search.lower
    for push in _PUSHES:
        room = np.minimum(push * np.minimum(width, 1.0), 0.5 * width)
        x = np.minimum(np.maximum(search.x0, search.lower + room), search.upper - room)
        x = search.inside(x)
        F = search.value(x)
        if F is None:
            continue
        if not scales and search.consider(x, F) and not search.map.is_affine:
            return x, F, None
        J = search.slopes(x)
        if J is None:
            continue
        if scales:
            search.scale = 1 / rows_of_sizes(J)
            F = search.scale * F
            J.data *= np.repeat(search.scale, np.diff(J.indptr))
            search.consider(x, F)
        return x, F, J
    return None


def _first_mu(search: Search, x: Array, F: Array, J: Any, move: float) -> float:
    """Return where the path begins: it goes through the points where ``(x - l) F/c = mu^2``.

    With the mean size of the first Newton step for ``x - l``; without one the size of ``F/c``.
    """
    sizes = np.abs(natural_map(x, F / rows_of_sizes(J), search.lower, search.upper))
    if move > 0:
        return float(np.sqrt(np.sqrt(np.mean(sizes**2)) * move))
    return float(max(np.median(sizes), 0.1 * np.max(sizes)))


def _is_within_rounding(search: Search, size: float) -> bool:
    """Whether the best point is a solution with the tolerance raised to rounding.

    Where a component of the natural map exceeds `tol`, ``|F_i| <= 10 eps sum_j |J_ij x_j|``. Rows
    of a given Jacobian are accepted if a directional difference of `F` agrees. If terms of `F` grow
    far above their initial `size`, rounding hides that there is no solution.
    """
    x, F = search.best_x, search.best_F
    if not np.isfinite(F).all():
        return False
    over = np.abs(natural_map(x, F, search.lower, search.upper)) > search.tol
    J = search.slopes(x)
    if J is None:
        return False
    floor = _ROUNDINGS * search.map.rounding * (abs(J) @ np.abs(x))
    if not np.isfinite(floor).all() or np.any(np.abs(F[over]) > floor[over]):
        return False
    if np.max(floor[over], initial=0.0) > _NEAR * size:
        return False
    if not search.map.is_affine and not np.all(_agrees(search, x, J)[over]):
        return False
    search.tol = max(search.tol, float(np.max(floor[over], initial=0.0)))
    return True


def _agrees(search: Search, x: Array, J: Any) -> Any:
    """Return in which rows the slopes agree with a difference of `F` into the box."""
    length = search.map.rounding ** (1 / 3) * np.maximum(np.abs(x), 1.0)
    signs = np.where(np.random.default_rng(0).random(search.n) < 0.5, -1.0, 1.0)
    ends = [search.inside(x + sign * signs * length) for sign in (1, -1)]
    values = [search.value(end) for end in ends]
    if values[0] is None or values[1] is None:
        return np.zeros(search.n, bool)
    step = ends[0] - ends[1]
    return np.abs(values[0] - values[1] - J @ step) <= _TRUSTED * (abs(J) @ np.abs(step))


def _is_isolated(search: Search) -> bool:
    """Whether the Jacobian on the rows inside the box is regular at the solution.

    Judged by how much a random right-hand side grows, its rows scaled to 1.
    """
    x, F = search.best_x, search.best_F
    target = x - F
    inside = (search.lower < search.upper) & (target >= search.lower - search.tol)
    free = np.flatnonzero(inside & (target <= search.upper + search.tol))
    J = search.slopes(x) if len(free) else None
    if J is None:
        return True
    right = np.random.default_rng(0).uniform(-1, 1, len(free))
    A = J[free][:, free]
    sizes = rows_of_sizes(A)
    factors = search.factoriser.last_of(free)
    if factors is not None:
        grown = factors.solve(sizes * right)
    else:
        A.data /= np.repeat(sizes, np.diff(A.indptr))
        solved = search.factoriser.solve(A, right)
        grown = None if solved is None else solved[0]
    return grown is not None and bool(np.max(np.abs(grown)) <= 1 / _SINGULAR)


def _result(search: Search, status: VIStatus, projected: bool) -> VIResult:
    """Return the best point with its diagnostics."""
    x, F = search.best_x, search.best_F / search.scale
    sizes = np.abs(natural_map(x, F, search.lower, search.upper))
    return VIResult(
        x=x,
        F=F,
        residual=float(np.max(sizes)),
        status=status,
        success=status in (VIStatus.SOLVED, VIStatus.SOLVED_NOT_ISOLATED),
        message=_MESSAGES[status] + search.map.undefined_points,
        n_iter=search.n_iter,
        nfev=search.map.nfev,
        njev=search.njev,
        n_pivots=0,
        n_semismooth_steps=0,
        n_gradient_steps=0,
        n_restarts=0,
        stage=search.found_in,
        scaled_residual=search.best_residual if np.isfinite(search.best_residual) else np.nan,
        tolerance=search.tol,
        convergence_ratio=search.ratio,
        projected=projected,
        n_factorisations=search.factoriser.count,
        fill=search.factoriser.fill,
    )


def _with_work_before(search: Search, found: VIResult, projected: bool) -> VIResult:
    """Return the end of the dense solver with the work that was done before it."""
    return dataclasses.replace(
        found,
        n_iter=found.n_iter + search.n_iter,
        nfev=found.nfev + search.map.nfev,
        njev=found.njev + search.njev,
        projected=projected,
        n_factorisations=search.factoriser.count,
        fill=search.factoriser.fill,
    )
