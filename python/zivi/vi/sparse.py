"""The solver of large sparse box VIs: its stages, its statuses, its result.

```text
S0  Newton's method on the active set, from x0
IP  an interior-point method, for affine problems, ended by S0
SM  smoothing Newton, from x0, ended by S0
S2  the same with a proximal term, for singular Jacobians
    the dense solver, where there are at most MAX_DENSE unknowns
```

Success is told by the natural residual recomputed from `F` at a point of the box, by nothing else.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from zivi.base.arrays import MAX_DENSE, Array
from zivi.vi.active_set import active_set_newton
from zivi.vi.factorisation import rows_of_sizes
from zivi.vi.farkas import a_row_is_infeasible, is_infeasible
from zivi.vi.interior_point import interior_point
from zivi.vi.smoothing import proximal_newton, smoothing_newton
from zivi.vi.sparse_search import EndedError, Map, Search, natural_map
from zivi.vi.types import VIResult, VIStatus

__all__ = ["solve_sparse"]

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
        "no point was found from which to go on with F and its Jacobian finite: start where both "
        "are defined, or tighten the bounds to the domain"
    ),
    VIStatus.INFEASIBLE: (
        "there is no solution: no point of the box satisfies all rows of F (their signs where "
        "there is no bound at which they may be wrong); check the bounds and the sign of F"
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
        The dense solver, for what is left of small problems, with the time that is left.
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
        return _merged(search, dense(search.time_left), projected)
    if status is VIStatus.SOLVED and settings.get("test_isolation", True):
        try:
            if not _is_isolated(search):
                status = VIStatus.SOLVED_NOT_ISOLATED
        except EndedError:
            pass  # there was no time for the test
    search.factoriser.forget()
    return _result(search, status, projected)


def _stages(search: Search, settings: dict[str, Any]) -> VIStatus:
    """Go through the stages until one succeeds."""
    begun = _begin(search, bool(settings.get("scale_by_jacobian")))
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


def _begin(search: Search, scales: bool) -> tuple[Array, Array, Any] | None:
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
    of a given Jacobian are believed where a difference of `F` along a direction agrees. Far beyond
    the `size` of the terms of `F` at the start rounding hides that there is no solution.
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
    """Return the best point with what is known of it."""
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


def _merged(search: Search, found: VIResult, projected: bool) -> VIResult:
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
