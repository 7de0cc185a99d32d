"""Complementarity problems and bimatrix games, by the solver of box VIs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, dense, real_array, require_finite
from zivi.base.habits import hinted
from zivi.vi.solve import observer, seconds, settings_of, solve_affine, solve_vi
from zivi.vi.types import VIOptions, VIProgress, VIResult


@hinted("solve_vi")
def solve_lcp(
    M: Any,
    q: ArrayLike,
    x0: ArrayLike | None = None,
    *,
    upper: Any = None,
    tol: float | None = None,
    rtol: float = 0.0,
    max_iter: int | None = None,
    time_limit: float | None = None,
    callback: Callable[[VIProgress], object] | None = None,
    options: VIOptions | Mapping[str, Any] | None = None,
) -> VIResult:
    """Solve a linear complementarity problem: ``x >= 0``, ``M x + q >= 0``, ``x'(M x + q) = 0``.

    With upper bounds ``M x + q <= 0`` where ``x`` is on them.

    Parameters
    ----------
    M : array_like or sparse matrix
        The matrix, ``n x n``.
    q : array_like
        The constant term.
    x0 : array_like, optional
        Where to begin; zero by default.
    upper : array_like, optional
        Upper bounds, none by default; a number stands for all components.
    tol, rtol, max_iter, time_limit, callback, options
        As for `solve_vi`.

    Returns
    -------
    VIResult
        Returned in all cases; check ``success``. ``res.F`` is the slack ``M x + q``.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    See Also
    --------
    solve_avi : affine problems in a general box.
    solve_ncp : nonlinear complementarity problems.
    bimatrix : Nash equilibria by the Lemke-Howson method.

    Notes
    -----
    An affine variational inequality with the bounds 0 and infinity, solved by `solve_avi`.

    References
    ----------
    R. W. Cottle, J.-S. Pang and R. E. Stone, The Linear Complementarity Problem, Academic Press,
    1992.

    Examples
    --------
    >>> res = zivi.solve_lcp([[2, 1], [1, 2]], [-5, -6])
    >>> res.x.round(9).tolist()
    [1.333333333, 2.333333333]
    """
    chosen = settings_of(tol, rtol, max_iter, options)
    limit, observe = seconds(time_limit), observer(callback)
    box = (0.0, np.inf if upper is None else upper)
    return solve_affine((M, q), box, x0, chosen, limit, observe)


@hinted("solve_vi")
def solve_ncp(
    F: Callable[..., Any],
    x0: ArrayLike,
    *,
    upper: Any = None,
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
    """Solve a nonlinear complementarity problem: ``x >= 0``, ``F(x) >= 0``, ``x'F(x) = 0``.

    Parameters
    ----------
    F : callable
        ``F(x, *args)`` returns an array of the length of `x`.
    x0 : array_like
        Where to begin.
    upper : array_like, optional
        Upper bounds, none by default; ``F(x) <= 0`` where ``x`` is on them.
    args, jac, jac_sparsity, tol, rtol, max_iter, time_limit, callback, options
        As for `solve_vi`.

    Returns
    -------
    VIResult
        Returned in all cases; check ``success``.

    Raises
    ------
    ValueError, TypeError
        Before `F` is called, if an argument is not as above.

    See Also
    --------
    solve_vi : problems in a general box.
    solve_lcp : linear complementarity problems.

    Notes
    -----
    A variational inequality with the bounds 0 and infinity, solved by `solve_vi`.

    References
    ----------
    F. Facchinei and J.-S. Pang, Finite-Dimensional Variational Inequalities and Complementarity
    Problems, Springer, 2003.

    Examples
    --------
    >>> res = zivi.solve_ncp(lambda x: x**3 - [8, -1], [1.0, 1.0])
    >>> res.x.round(9).tolist()
    [2.0, 0.0]
    """
    return solve_vi(
        F,
        0.0,
        np.inf if upper is None else upper,
        x0,
        args=args,
        jac=jac,
        jac_sparsity=jac_sparsity,
        tol=tol,
        rtol=rtol,
        max_iter=max_iter,
        time_limit=time_limit,
        callback=callback,
        options=options,
    )


@dataclasses.dataclass(frozen=True, eq=False)
class Equilibrium:
    """A Nash equilibrium of a bimatrix game.

    Attributes
    ----------
    x, y : ndarray
        Mixed strategies of the row and of the column player: probabilities.
    payoffs : tuple of float
        What they are worth to either player, ``(x'A y, x'B y)``.
    regret : float
        The most that either player would gain by another strategy: zero at an equilibrium.
    success : bool
        True if the underlying complementarity problem was solved.
    result : VIResult
        The solution of that problem, with its status and its message.
    """

    x: Array
    y: Array
    payoffs: tuple[float, float]
    regret: float
    success: bool
    result: VIResult


def bimatrix(
    A: ArrayLike,
    B: ArrayLike,
    *,
    options: VIOptions | Mapping[str, Any] | None = None,
    time_limit: float | None = None,
) -> Equilibrium:
    """Find a Nash equilibrium of the game with payoffs `A` to the row and `B` to the column player.

    With the costs ``C = c - A`` and ``D = d - B``, both positive, the equilibria are the solutions
    of ``0 <= u _|_ C v - 1 >= 0``, ``0 <= v _|_ D'u - 1 >= 0``, scaled to sum 1. One is found on
    the complementary paths of Lemke and Howson (1964), whose labels take turns.

    Parameters
    ----------
    A, B : array_like
        ``A[i, j]`` and ``B[i, j]`` are the payoffs when the row player plays `i` and the column
        player plays `j`; of equal shape.
    options : VIOptions, optional
        Enabled stages of the solver.
    time_limit : float, optional
        Seconds after which the search ends.

    Returns
    -------
    Equilibrium
        Returned in all cases; check ``success``. One of perhaps many equilibria.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    See Also
    --------
    solve_lcp : general linear complementarity problems.

    Notes
    -----
    The paths of the Lemke-Howson method, one per label, can have exponential length in the worst
    case.

    References
    ----------
    C. E. Lemke and J. T. Howson, Equilibrium points of bimatrix games, J. Soc. Indust. Appl. Math.
    12, 1964.

    R. W. Cottle, J.-S. Pang and R. E. Stone, The Linear Complementarity Problem, Academic Press,
    1992.

    Examples
    --------
    >>> game = zivi.bimatrix([[1, -1], [-1, 1]], [[-1, 1], [1, -1]])  # matching pennies
    >>> game.x.round(12).tolist(), game.y.round(12).tolist(), game.regret < 1e-12
    ([0.5, 0.5], [0.5, 0.5], True)
    """
    rows, columns = _payoff("A", A), _payoff("B", B)
    if columns.shape != rows.shape:
        raise ValueError(f"B must have the shape {rows.shape} of A, got {columns.shape}")
    m, n = rows.shape
    M = np.zeros((m + n, m + n))
    M[:m, m:] = _costs(rows)
    M[m:, :m] = _costs(columns).T
    limit = seconds(time_limit)
    path = _zivi.lemke_howson(3 - M[:m, m:], 3 - M[m:, :m].T, _PIVOTS * (m + n), limit)
    start, pivots = (None, 0) if path is None else (_scaled(M, *path[:2]), path[2])
    res = solve_lcp(M, -np.ones(m + n), start, tol=1e-9, options=options, time_limit=time_limit)
    if path is not None:
        res.__dict__["n_pivots"] += pivots
    x, y = _probabilities(res.x[:m]), _probabilities(res.x[m:])
    to_rows, to_columns = rows @ y, x @ columns
    payoffs = float(x @ to_rows), float(to_columns @ y)
    regret = max(to_rows.max() - payoffs[0], to_columns.max() - payoffs[1], 0.0)
    return Equilibrium(x, y, payoffs, float(regret), res.success, res)


_PIVOTS = 1000
"""Most pivots of the paths, for each strategy."""


def _scaled(M: Array, u: Array, v: Array) -> Array:
    """Return strategies such that the best of either player costs 1."""
    m = len(u)
    return np.concatenate([u / (M[m:, :m] @ u).min(), v / (M[:m, m:] @ v).min()])


def _payoff(name: str, value: ArrayLike) -> Array:
    array = real_array(name, dense(name, value))
    if array.ndim != 2 or not array.size:
        raise ValueError(f"{name} must be a matrix with at least one entry, got {array.shape}")
    require_finite(name, array)
    return array


def _costs(payoffs: Array) -> Array:
    """Return costs between 1 and 2 that fall as the payoffs grow: the same game."""
    scaled = payoffs / max(np.abs(payoffs).max(), np.finfo(float).tiny)  # the range may overflow
    lost = scaled.max() - scaled
    costs: Array = 1 + lost / (lost.max() or 1.0)
    return costs


def _probabilities(weights: Array) -> Array:
    total = weights.sum()
    if not total > 0:  # not a solution
        return np.full(len(weights), 1 / len(weights))
    shares: Array = weights / total
    return shares
