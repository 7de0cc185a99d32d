"""Derivatives of solutions of box VIs with respect to parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi.base.check import Array, bound, is_sparse, real, real_array, require_finite, vector
from zivi.vi.factorisation import Factoriser
from zivi.vi.types import VIResult


@dataclasses.dataclass(frozen=True, eq=False)
class VIDerivative:
    """How the solution of a VI changes with parameters.

    Where a component is at a bound, and the map there pushes it against that, it stays; the others
    keep their entries of the map zero. With ``A`` the former and ``I`` the latter

    ``dx_A = dbound_A dp``, ``J_II dx_I = -(dF_I dp + J_IA dx_A)``.

    Attributes
    ----------
    free : ndarray of int
        The components inside the box, ``I``.
    at_lower, at_upper : ndarray of int
        Those at their bounds.
    unclear : ndarray of int
        Degenerate components, at a bound with zero map: their one-sided derivatives differ. Given
        is that with them at their bounds.
    """

    free: NDArray[np.intp]
    at_lower: NDArray[np.intp]
    at_upper: NDArray[np.intp]
    unclear: NDArray[np.intp]
    _jacobian: Any = dataclasses.field(repr=False)
    _map_slopes: Any = dataclasses.field(repr=False)
    _bound_slopes: Array | None = dataclasses.field(repr=False)

    @property
    def shape(self) -> tuple[int, int]:
        """How many unknowns and parameters there are."""
        n, k = self._map_slopes.shape
        return n, k

    @cached_property
    def matrix(self) -> Array:
        """``dx/dp``, of shape (unknowns, parameters)."""
        n, k = self.shape
        return self.jvp(np.eye(k)) if k else np.zeros((n, 0))

    def jvp(self, dp: ArrayLike) -> Array:
        """Return the change of the solution for a change of the parameters.

        Parameters
        ----------
        dp : array_like
            Of shape (parameters,), or several columns of that.

        Returns
        -------
        ndarray
            ``dx/dp dp``, of shape (unknowns,) or with as many columns.

        Raises
        ------
        ValueError
            For another shape.
        numpy.linalg.LinAlgError
            If the solution is not isolated.
        """
        change = self._columns("dp", dp, self.shape[1])
        dx = np.zeros((self.shape[0], change.shape[1]))
        if self._bound_slopes is not None:
            dx += self._bound_slopes @ change
        right = -(self._map_slopes @ change + self._jacobian @ dx)
        dx[self.free] = self._forwards(right[self.free])
        dx += 0.0  # no negative zeros
        return dx.reshape(-1) if np.ndim(dp) == 1 else dx

    def vjp(self, weights: ArrayLike) -> Array:
        """Return the gradient of a function of the solution, from its gradient by the unknowns.

        Parameters
        ----------
        weights : array_like
            Of shape (unknowns,), or several columns of that.

        Returns
        -------
        ndarray
            ``(dx/dp)^T weights``, of shape (parameters,) or with as many columns; one system of
            equations a column, however many parameters there are.

        Raises
        ------
        ValueError
            For another shape.
        numpy.linalg.LinAlgError
            If the solution is not isolated.
        """
        of_x = self._columns("weights", weights, self.shape[0])
        multipliers = np.zeros_like(of_x)
        multipliers[self.free] = self._backwards(of_x[self.free])
        gradient: Array = -(self._map_slopes.T @ multipliers)
        if self._bound_slopes is not None:
            of_bounds = of_x - self._jacobian.T @ multipliers
            gradient = gradient + self._bound_slopes.T @ of_bounds
        return gradient.reshape(-1) if np.ndim(weights) == 1 else gradient

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the factors, which are made again."""
        return {
            name: value
            for name, value in self.__dict__.items()
            if name not in ("_forwards", "_backwards")
        }

    @staticmethod
    def _columns(name: str, value: ArrayLike, rows: int) -> Array:
        array = real_array(name, value)
        if array.ndim not in (1, 2) or len(array) != rows:
            raise ValueError(f"{name} must have {rows} rows, got shape {array.shape}")
        return array.reshape(rows, -1)

    @cached_property
    def _forwards(self) -> Callable[[Array], Array]:
        return _solver(self._jacobian[self.free][:, self.free])

    @cached_property
    def _backwards(self) -> Callable[[Array], Array]:
        return _solver(self._jacobian[self.free][:, self.free].T)


def solution_derivative(
    solution: VIResult,
    jac: Any,
    dF: Any,
    lower: Any = None,
    upper: Any = None,
    *,
    dlower: ArrayLike | None = None,
    dupper: ArrayLike | None = None,
    tol: float = 1e-7,
) -> VIDerivative:
    """Differentiate a solution of a VI by parameters of its map and its bounds.

    Parameters
    ----------
    solution : VIResult
        From `solve_vi`, `solve_avi`, `solve_ncp` or `solve_lcp`.
    jac : array_like or sparse matrix
        The Jacobian of the map by the unknowns at the solution, ``n x n``.
    dF : array_like or sparse matrix
        Its derivatives with respect to the parameters, ``n x k``; a vector for one parameter.
    lower, upper : array_like or None
        The bounds (see `solve_vi`). (`solve_lcp` and `solve_ncp` have ``lower=0``.)
    dlower, dupper : array_like, optional
        Derivatives of the bounds by the parameters, ``n x k``, zero by default.
    tol : float
        Distances from bounds below this, relative to the largest unknown, and entries of the map
        below it, relative to the terms of their row, are zero.

    Returns
    -------
    VIDerivative
        ``matrix``, ``jvp``, ``vjp``; ``unclear`` names the components where the derivative is one
        of two.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above, or the solve had no success.

    See Also
    --------
    zivi.interop.solution_function : solution and derivative for optimisers.

    Examples
    --------
    A price clears two markets; a tax on the second makes its trade end:

    >>> M, q = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-4.0, 1.0])
    >>> res = zivi.solve_lcp(M, q)
    >>> derivative = zivi.vi.solution_derivative(res, M, np.eye(2), 0.0)
    >>> res.x, derivative.at_lower
    (array([2., 0.]), array([1]))
    >>> derivative.matrix
    array([[-0.5,  0. ],
           [ 0. ,  0. ]])
    """
    if not isinstance(solution, VIResult):
        raise TypeError(f"solution must be a zivi.VIResult, got {type(solution).__name__}")
    if not solution.success:
        raise ValueError(f"solution must be one, got {solution.status.name}: {solution.message}")
    if not 0.0 < real("tol", tol) < 1.0:
        raise ValueError(f"tol must be in (0, 1), got {tol}")
    x, F = vector("solution.x", solution.x), vector("solution.F", solution.F)
    n = len(x)
    J, slopes = _read_matrix("jac", jac, (n, n)), _read_matrix("dF", dF, (n, None))
    box = [
        np.broadcast_to(bound(name, value, n), n)
        for name, value in (("lower", lower), ("upper", upper))
    ]
    k = slopes.shape[1]
    size = float(np.max(np.abs(x), initial=0.0))
    small = tol * np.asarray(abs(J).sum(axis=1)).ravel() * size
    at_lower, at_upper = x - box[0] <= tol * size, box[1] - x <= tol * size
    # at both bounds the component is held, whatever the map
    pushed_down, pushed_up = small < F, small < -F
    held = (at_lower & pushed_down) | (at_upper & pushed_up) | (at_lower & at_upper)
    at_bound = at_lower | at_upper
    slopes_of_bounds = None
    if dlower is not None or dupper is not None:
        slopes_of_bounds = np.zeros((n, k))
        for name, given, at in (("dlower", dlower, at_lower), ("dupper", dupper, at_upper)):
            if given is not None:
                slopes_of_bounds[at] = np.asarray(_to_dense(_read_matrix(name, given, (n, k))))[at]
    return VIDerivative(
        free=np.flatnonzero(~at_bound),
        at_lower=np.flatnonzero(at_lower),
        at_upper=np.flatnonzero(at_upper & ~at_lower),
        unclear=np.flatnonzero(at_bound & ~held),
        _jacobian=J,
        _map_slopes=slopes,
        _bound_slopes=slopes_of_bounds,
    )


def _to_dense(matrix: Any) -> Any:
    return matrix.toarray() if is_sparse(matrix) else matrix


def _read_matrix(name: str, value: Any, shape: tuple[int, int | None]) -> Any:
    """Return a finite matrix, one that is sparse by rows."""
    if is_sparse(value):
        from scipy.sparse import csr_array

        array = csr_array(value, dtype=float)
        require_finite(f"{name}.data", array.data)
    else:
        array = real_array(name, value)
        array = array.reshape(-1, 1) if array.ndim <= 1 else array
        require_finite(name, array)
    rows, columns = shape
    if array.ndim != 2 or array.shape[0] != rows or columns not in (None, array.shape[1]):
        wanted = f"({rows}, {'k' if columns is None else columns})"
        raise ValueError(f"{name} must have shape {wanted}, got {array.shape}")
    return array


def _solver(A: Any) -> Callable[[Array], Array]:
    """Return what solves ``A X = B``, factored once."""
    if A.shape[0] == 0:
        return lambda right: right
    if is_sparse(A):
        factoriser = Factoriser(lambda: None)
        factoriser.see_pattern(A.tocsr())
        factors = factoriser.factors_of(A)

        def solve(right: Array) -> Array:
            solved = np.empty_like(right)
            for k, column in enumerate(right.T):
                solution = None if factors is None else factors.solve(column)
                if solution is None:
                    raise np.linalg.LinAlgError(_SINGULAR)
                solved[:, k] = solution
            return solved

        return solve
    from scipy.linalg import lu_factor, lu_solve

    scale = np.max(np.abs(A), axis=1)
    if not np.all(scale > 0) or np.linalg.cond(A / scale[:, None]) > _WORST:
        raise np.linalg.LinAlgError(_SINGULAR)
    factored = lu_factor(A)
    return lambda right: lu_solve(factored, right)


_WORST = 1e14
"""A matrix, its rows scaled, with a larger condition number is singular."""
_SINGULAR = (
    "the Jacobian on the components inside the box is singular: the solution is not isolated and "
    "has no derivative"
)
