"""Variational inequalities on a box, or mixed complementarity problems, by zivi's own solver.

Find ``x`` in ``[lower, upper]`` with, for every component,

* ``F_i(x) >= 0`` where ``x_i = lower_i``,
* ``F_i(x) <= 0`` where ``x_i = upper_i``,
* ``F_i(x) = 0`` where ``lower_i < x_i < upper_i``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.arrays import MAX_DENSE, Array, bound, matrix, vector
from zivi.base.habits import hinted
from zivi.vi.arguments import arranged, limits, observer, seconds, settings_of
from zivi.vi.coloured import ColouredDifferences
from zivi.vi.jacobian import (
    Both,
    IsSparseError,
    JacobianError,
    check_jacobian,
    complex_steps,
    converters,
    jacobian,
    wants_sparse,
)
from zivi.vi.scale import (
    Affine,
    Watched,
    dense_is_off_scale,
    is_off_scale,
    polished,
    solve_scaled,
)
from zivi.vi.sparse_calls import SparseVI, affine_by_sparse, checked_affine, pattern_for
from zivi.vi.types import VIOptions, VIProgress, VIResult, VIStatus, result_of

__all__ = [
    "MAX_DENSE",
    "JacobianError",
    "VIOptions",
    "VIProgress",
    "VIResult",
    "VIStatus",
    "check_jacobian",
    "natural_residual",
    "solve_avi",
    "solve_vi",
]


@hinted("solve_vi")
def solve_vi(
    F: Callable[..., Any],
    lower: Any = None,
    upper: Any = None,
    x0: ArrayLike | None = None,
    *,
    bounds: Any = None,
    args: tuple[Any, ...] = (),
    jac: Callable[..., Any] | Any | None = None,
    jac_sparsity: Any = None,
    tol: float | None = None,
    rtol: float = 0.0,
    max_iter: int | None = None,
    time_limit: float | None = None,
    callback: Callable[[VIProgress], object] | None = None,
    options: VIOptions | Mapping[str, Any] | None = None,
) -> VIResult:
    """Solve a variational inequality on a box (a mixed complementarity problem).

    Parameters
    ----------
    F : callable
        ``F(x, *args)`` returns an array as long as `x` (or a number where `x` has one entry).
        Values that are not finite mean that `F` is not defined there; the solver backs off. So do
        an `ArithmeticError` or a `ValueError` after the first call; other exceptions, and these
        at `x0`, reach the caller.
    lower, upper : array_like or None
        Bounds, infinite ones allowed; a number stands for all components, None for no bound.
    x0 : array_like
        Where to begin; its length is the number of unknowns. A number is one unknown.
    bounds : scipy.optimize.Bounds or sequence of (lower, upper), optional
        Instead of `lower` and `upper`: ``solve_vi(F, x0, bounds=bounds)``.
    args : tuple
        Further arguments of `F` and `jac`.
    jac : callable, matrix, True or {"2-point", "3-point", "cs"}, optional
        ``jac(x, *args)`` returns the ``n x n`` matrix of ``dF_i/dx_j``, dense or sparse; a matrix
        stands for a constant one, True says that `F` returns ``(F(x), jac(x))``. By default, and
        as ``"3-point"``, it is taken by differences of second order of `F` in the box (``2 n``
        calls); ``"2-point"`` are differences of first order (``n`` calls), ``"cs"`` complex steps
        (``n`` calls of an analytic `F`). Entries that are not finite are replaced by differences.
        A sparse one is kept sparse where that pays: see ``VIOptions.linear_algebra``.
    jac_sparsity : array_like or sparse matrix, optional
        Where the Jacobian may be nonzero, ``n x n``: then the differences, or complex steps, take
        one or two calls for each group of columns that share no row. Not with a `jac` that is
        given.
    tol : float, optional
        Largest natural residual of a solution. By default 1e-9, and less where rows or unknowns
        are so small at the start that this would mean nothing.
    rtol : float
        The same relative to the residual at `x0`; the larger of the two holds.
    max_iter : int, optional
        Iterations of all stages together, 10000 by default.
    time_limit : float, optional
        Seconds after which the best point so far is returned; looked at between evaluations and
        during long factorisations. A Jacobian by differences counts as one evaluation.
    callback : callable, optional
        Called with a `VIProgress` after every iteration; it may raise `StopIteration` to end the
        solve.
    options : VIOptions or dict, optional
        Row scaling, and which parts of the solver take part; a dict has the names of `VIOptions`.

    Returns
    -------
    VIResult
        Always; look at ``success``.

    Raises
    ------
    ValueError, TypeError
        Before `F` is called, if an argument is not as above; the message names the index.

    Examples
    --------
    >>> res = zivi.solve_vi(lambda x: x**2 - 2, 0, np.inf, [1.0])
    >>> res.success, float(res.x[0].round(8))
    (True, 1.41421356)
    """
    lower, upper, x0 = arranged(lower, upper, x0, bounds)
    start = vector("x0", x0, scalar=True).reshape(-1)
    n = len(start)
    if not n:
        raise ValueError("x0 must have at least one entry, got none")
    if not callable(F):
        raise TypeError(f"F must be callable, got {type(F).__name__}")
    if args and not isinstance(args, tuple):
        raise TypeError(f"args must be a tuple, got {type(args).__name__}")
    map_: Any = (lambda x: F(x, *args)) if args else F
    box = limits(lower, upper, n)
    settings = settings_of(tol, rtol, max_iter, options)
    algebra = settings.pop("linear_algebra", "auto")
    limit, observe = seconds(time_limit), observer(callback)
    is_adaptive = _is_adaptive(tol, rtol, settings)
    calls = [0]
    both = Both(map_) if jac is True else None
    if both is not None:
        map_ = both
    if is_adaptive or both is not None or callable(jac):
        map_ = seen = Watched(map_)
    converts = converters(n, algebra)

    def by_sparse(slopes: Any) -> VIResult:
        problem = SparseVI(map_, slopes, converts, box, start, settings, limit, observe)
        result = problem.solve()
        return polished(result, seen.size, problem.solve) if is_adaptive else result

    kept = _kept_sparse(jac, jac_sparsity, both, args, start, algebra)
    if kept is not None:
        return by_sparse(kept)
    if both is not None:
        slopes: Any = both.jac
    elif jac_sparsity is not None:
        slopes = _by_colours(map_, pattern_for(jac_sparsity, jac, n), box, start, calls)
    elif isinstance(jac, str) and jac == "cs":
        slopes = complex_steps(map_, n, calls)
    else:
        slopes = jacobian(jac, start, args)

    def by_dense(x: Array, tol: float | None = None) -> VIResult:
        chosen = settings if tol is None else settings | {"tol": tol}
        return result_of(_zivi.solve_vi(map_, *box, x, slopes, converts, chosen, limit, observe))

    try:
        result = by_dense(start)
    except IsSparseError:
        before = seen.calls
        result = by_sparse(slopes)
        result.__dict__["nfev"] += before
        result.__dict__["njev"] += 1
        return result
    if is_adaptive:
        result = polished(result, seen.size, by_dense)
    result.__dict__["nfev"] += calls[0] + (both.more_calls if both is not None else 0)
    return result


def _kept_sparse(
    jac: Any, jac_sparsity: Any, both: Both | None, args: tuple[Any, ...], x0: Array, algebra: str
) -> Any:
    """Return the Jacobian for the sparse solver where it is known to be its; None where not.

    What a callable returns to the dense solver is looked at there. For more unknowns than that
    can have, it is looked at here, before `F` is called.
    """
    n = len(x0)
    if jac_sparsity is not None:
        pattern = pattern_for(jac_sparsity, jac, n)
        return pattern if wants_sparse(pattern[0], n, algebra) else None
    if jac is None or jac is False or isinstance(jac, str):
        return pattern_for(np.ones((n, n)), jac, n) if algebra == "sparse" else None
    if both is None and not callable(jac):
        return jac if wants_sparse(jac, n, algebra) else None
    function = both.jac if both is not None else jacobian(jac, x0, args)
    if algebra == "sparse":
        return function
    if n <= MAX_DENSE or isinstance(function, str):
        return None
    value = function(x0.copy())
    if algebra == "dense":
        matrix("jac(x)", value, n)  # a sparse one is refused before F is called
    return function if wants_sparse(value, n, algebra) else None


def _by_colours(
    map_: Callable[[Any], Any],
    pattern: tuple[Any, str],
    box: tuple[Array | float, Array | float],
    x0: Array,
    calls: list[int],
) -> Callable[[Array], Array]:
    """Return coloured differences as a dense Jacobian; their calls of `F` are counted."""
    n = len(x0)
    values = converters(n)[0]
    rounding = [float(np.finfo(float).eps)]

    def value(x: Any) -> Any:
        calls[0] += 1
        given = map_(x)
        if np.iscomplexobj(given):
            return np.asarray(given)
        array, rounding[0] = values(given)
        return array

    lower, upper = (np.broadcast_to(it, n).astype(float) for it in box)
    differences = ColouredDifferences(value, *pattern, lower, upper)

    def slopes(x: Array) -> Array:
        return np.asarray(differences(x, rounding[0]).toarray())

    return slopes


@hinted("solve_vi")
def solve_avi(
    M: Any,
    q: ArrayLike,
    lower: Any = None,
    upper: Any = None,
    x0: ArrayLike | None = None,
    *,
    bounds: Any = None,
    tol: float | None = None,
    rtol: float = 0.0,
    max_iter: int | None = None,
    time_limit: float | None = None,
    callback: Callable[[VIProgress], object] | None = None,
    options: VIOptions | Mapping[str, Any] | None = None,
) -> VIResult:
    """Solve the affine variational inequality with ``F(x) = M x + q`` on a box.

    Parameters
    ----------
    M : array_like or sparse matrix
        The matrix, ``n x n``. A sparse one is kept sparse where that pays: see
        ``VIOptions.linear_algebra``.
    q : array_like
        The constant term.
    lower, upper : array_like or None
        Bounds, infinite ones allowed; a number stands for all components, None for no bound.
    x0 : array_like, optional
        Where to begin; by default the point of the box nearest to zero.
    bounds : scipy.optimize.Bounds or sequence of (lower, upper), optional
        Instead of `lower` and `upper`.
    tol, rtol, max_iter, time_limit, callback, options
        As for `solve_vi`.

    Returns
    -------
    VIResult
        Always; look at ``success``. A row that has the wrong sign everywhere in the box ends it
        as `VIStatus.INFEASIBLE` at once.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    >>> res = zivi.solve_avi([[2, 1], [1, 2]], [-5, -6], -1, 1)
    >>> res.x.tolist()
    [1.0, 1.0]
    """
    constant = vector("q", q)
    n = len(constant)
    if not n:
        raise ValueError("q must have at least one entry, got none")
    if bounds is not None or upper is None:
        lower, upper, _ = arranged(lower, upper, 0.0, bounds)
    settings = settings_of(tol, rtol, max_iter, options)
    algebra = settings.pop("linear_algebra", "auto")
    keeps = wants_sparse(M, n, algebra)
    given: Any = M if keeps else matrix("M", M, n)
    start = None if x0 is None else vector("x0", x0)
    if start is not None and len(start) != n:
        raise ValueError(f"x0 must have {n} entries, as q has, got {len(start)}")
    box = limits(lower, upper, n)
    limit, observe = seconds(time_limit), observer(callback)
    is_adaptive = _is_adaptive(tol, rtol, settings)

    def solve(a: Affine) -> VIResult:
        if keeps:
            return affine_by_sparse(a, settings, limit, observe)
        return result_of(
            _zivi.solve_avi(a.M, a.q, a.lower, a.upper, a.x0, settings, limit, observe)
        )

    if keeps:
        problem = checked_affine(given, constant, box, start, settings)
        begin = np.clip(problem.x0, problem.lower, problem.upper)
        if is_adaptive and is_off_scale(inside := dataclasses.replace(problem, x0=begin)):
            return solve_scaled(inside, solve)
        return solve(problem)
    if is_adaptive and dense_is_off_scale(given, constant, box, start):
        low, high = (np.broadcast_to(it, n).astype(float) for it in box)
        begin = np.clip(np.zeros(n) if start is None else start, low, high)
        return solve_scaled(Affine(given, constant, low, high, begin), solve)
    return result_of(_zivi.solve_avi(given, constant, *box, start, settings, limit, observe))


def _is_adaptive(tol: float | None, rtol: float, settings: Mapping[str, Any]) -> bool:
    """Whether the tolerance may follow the units: where no row scale and no tolerance is given."""
    return tol is None and not rtol and "row_scale" not in settings


def natural_residual(x: ArrayLike, F: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> float:
    """Return ``max |max(x - upper, min(x - lower, F))|``, zero exactly at a solution.

    Parameters
    ----------
    x : array_like
        The point.
    F : array_like
        The value of the map there.
    lower, upper : array_like
        Bounds, infinite ones allowed; a number stands for all components.

    Returns
    -------
    float
        The residual; NaN if some `F` is NaN.

    Raises
    ------
    ValueError, TypeError
        If lengths differ or a bound is impossible.

    Examples
    --------
    >>> zivi.natural_residual([1.0, 0.5], [-3.0, 0.25], 0, 1)
    0.25
    """
    point, value = vector("x", x), vector("F", F)
    if len(value) != len(point):
        raise ValueError(f"F must have {len(point)} entries, as x has, got {len(value)}")
    n = len(point)
    return _zivi.natural_residual(point, value, bound("lower", lower, n), bound("upper", upper, n))
