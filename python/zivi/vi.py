"""Variational inequalities on a box, or mixed complementarity problems, by zivi's own solver.

Find ``x`` in ``[lower, upper]`` with, for every component,

* ``F_i(x) >= 0`` where ``x_i = lower_i``,
* ``F_i(x) <= 0`` where ``x_i = upper_i``,
* ``F_i(x) = 0`` where ``lower_i < x_i < upper_i``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi import _zivi
from zivi._arrays import MAX_DENSE, bound, count, matrix, vector
from zivi._check import real
from zivi._vi_jacobian import JacobianError, check_jacobian, complex_steps, converters, jacobian
from zivi._vi_types import VIOptions, VIProgress, VIResult, VIStatus, result_of

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


def solve_vi(
    F: Callable[..., ArrayLike],
    lower: ArrayLike,
    upper: ArrayLike,
    x0: ArrayLike,
    *,
    args: tuple[Any, ...] = (),
    jac: Callable[..., Any] | Any | None = None,
    tol: float = 1e-9,
    rtol: float = 0.0,
    max_iter: int | None = None,
    time_limit: float | None = None,
    callback: Callable[[VIProgress], object] | None = None,
    options: VIOptions | None = None,
) -> VIResult:
    """Solve a variational inequality on a box (a mixed complementarity problem).

    Parameters
    ----------
    F : callable
        ``F(x, *args)`` returns an array as long as `x` (or a number where `x` has one entry).
        Values that are not finite mean that `F` is not defined there; the solver backs off. So do
        an `ArithmeticError` or a `ValueError` after the first call; other exceptions, and these
        at `x0`, reach the caller.
    lower, upper : array_like
        Bounds, infinite ones allowed; a number stands for all components.
    x0 : array_like
        Where to begin; its length is the number of unknowns. A number is one unknown.
    args : tuple
        Further arguments of `F` and `jac`.
    jac : callable, matrix or {"2-point", "3-point", "cs"}, optional
        ``jac(x, *args)`` returns the ``n x n`` matrix of ``dF_i/dx_j``, dense or sparse; a matrix
        stands for a constant one. By default, and as ``"3-point"``, it is taken by differences of
        second order of `F` in the box (``2 n`` calls); ``"2-point"`` are differences of first
        order (``n`` calls), ``"cs"`` complex steps (``n`` calls of an analytic `F`). Entries that
        are not finite are replaced by differences.
    tol : float
        Largest natural residual of a solution.
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
    options : VIOptions, optional
        Row scaling, and which parts of the solver take part.

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
    start = np.atleast_1d(vector("x0", x0, scalar=True))
    n = len(start)
    if not n:
        raise ValueError("x0 must have at least one entry, got none")
    if not callable(F):
        raise TypeError(f"F must be callable, got {type(F).__name__}")
    if args and not isinstance(args, tuple):
        raise TypeError(f"args must be a tuple, got {type(args).__name__}")
    map_ = (lambda x: F(x, *args)) if args else F
    limits = bound("lower", lower, n), bound("upper", upper, n)
    settings = _settings(tol, rtol, max_iter, options)
    limit, observe = _time_limit(time_limit), _observer(callback)
    calls = [0]
    if isinstance(jac, str) and jac == "cs":
        slopes: Any = complex_steps(map_, n, calls)
    else:
        slopes = jacobian(jac, start, args)
    record = _zivi.solve_vi(map_, *limits, start, slopes, converters(n), settings, limit, observe)
    result = result_of(record)
    result.__dict__["nfev"] += calls[0]
    return result


def solve_avi(
    M: Any,
    q: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    x0: ArrayLike | None = None,
    *,
    tol: float = 1e-9,
    rtol: float = 0.0,
    max_iter: int | None = None,
    time_limit: float | None = None,
    callback: Callable[[VIProgress], object] | None = None,
    options: VIOptions | None = None,
) -> VIResult:
    """Solve the affine variational inequality with ``F(x) = M x + q`` on a box.

    Parameters
    ----------
    M : array_like or sparse matrix
        The matrix, ``n x n``. A sparse one is made dense, up to ``zivi.vi.MAX_DENSE`` unknowns.
    q : array_like
        The constant term.
    lower, upper : array_like
        Bounds, infinite ones allowed; a number stands for all components.
    x0 : array_like, optional
        Where to begin; by default the point of the box nearest to zero.
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
    dense = matrix("M", M, n)
    start = None if x0 is None else vector("x0", x0)
    if start is not None and len(start) != n:
        raise ValueError(f"x0 must have {n} entries, as q has, got {len(start)}")
    record = _zivi.solve_avi(
        dense,
        constant,
        bound("lower", lower, n),
        bound("upper", upper, n),
        start,
        _settings(tol, rtol, max_iter, options),
        _time_limit(time_limit),
        _observer(callback),
    )
    return result_of(record)


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


def _settings(
    tol: float, rtol: float, max_iter: int | None, options: VIOptions | None
) -> dict[str, Any]:
    if options is None:
        settings = {}
    elif isinstance(options, VIOptions):
        settings = options._settings()
    else:
        raise TypeError(f"options must be a VIOptions, got {type(options).__name__}")
    settings["tol"] = real("tol", tol)
    if rtol:
        settings["rtol"] = real("rtol", rtol)
    if max_iter is not None:
        settings["max_iterations"] = count("max_iter", max_iter, least=1)
    return settings


def _time_limit(limit: float | None) -> float | None:
    if limit is None:
        return None
    seconds = real("time_limit", limit)
    if not seconds > 0:
        raise ValueError(f"time_limit must be > 0 seconds, got {seconds}")
    return seconds


def _observer(
    callback: Callable[[VIProgress], object] | None,
) -> Callable[[int, float, int, str], object] | None:
    if callback is None:
        return None
    if not callable(callback):
        raise TypeError(f"callback must be callable, got {type(callback).__name__}")
    return lambda *progress: callback(VIProgress(*progress))
