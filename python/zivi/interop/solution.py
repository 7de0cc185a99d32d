"""The solution of a VI as a function of its parameters, with its derivative: for optimisers."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.arrays import Array, is_sparse, vector
from zivi.base.check import real_array
from zivi.interop.function import ParameterFunction
from zivi.vi.derivatives import VIDerivative, solution_derivative
from zivi.vi.solve import VIOptions, VIResult, solve_vi

__all__ = ["SolutionFunction", "SolutionPoint", "solution_function"]

_STEP = float(np.finfo(float).eps) ** (1 / 3)


class SolutionPoint(NamedTuple):
    """A solution at one point of its parameters.

    Attributes
    ----------
    value : ndarray
        The unknowns; infinite where there is no solution.
    derivative : ndarray
        By the parameters, of shape (unknowns, parameters); NaN where there is none.
    solution : VIResult
        The solve.
    of : VIDerivative or None
        The derivative with its index sets, `VIDerivative.unclear` among them.
    """

    value: Array
    derivative: Array
    solution: VIResult
    of: VIDerivative | None


@dataclasses.dataclass(frozen=True)
class SolutionFunction(ParameterFunction[SolutionPoint]):
    """The solution of a VI as a function of parameters.

    Calling it, ``f(p)``, gives ``(x, dx/dp)``. `fun` and `jac` are what
    `scipy.optimize.least_squares` and `scipy.optimize.root` take, `gradient` is the derivative of
    a function of the solution. Each solve begins at the last solution. Where there is none, or it
    has no derivative, the value is infinite and the derivative NaN.
    """

    F: Callable[[Array, Array], ArrayLike]
    lower: Any
    upper: Any
    x0: Array
    names: tuple[str, ...]
    jacobian: Callable[[Array, Array], Any]
    map_slopes: Callable[[Array, Array], Any] | None
    options: VIOptions | Mapping[str, Any] | None

    @property
    def wrt(self) -> tuple[str, ...]:
        """What the entries of ``p`` are, tuple of str."""
        return self.names

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the value, ``(unknowns,)``."""
        return self.x0.shape

    def evaluate(self, p: ArrayLike) -> SolutionPoint:
        """Solve, and differentiate the solution.

        Parameters
        ----------
        p : array_like
            A value for each of `wrt`.

        Returns
        -------
        SolutionPoint
            ``value``, ``derivative``, ``solution``, ``of``.

        Raises
        ------
        ValueError
            If `p` has not as many entries as `wrt`.
        """
        found: SolutionPoint = self._at(p)
        return found

    def _computed(self, p: Array) -> SolutionPoint:
        last = next(iter(self._last.values()), None)
        start = last.solution.x if last is not None and last.solution.success else self.x0
        lower, upper = (_at(box, p) for box in (self.lower, self.upper))
        solution = solve_vi(
            lambda x: self.F(x, p),
            lower,
            upper,
            start,
            jac=lambda x: self.jacobian(x, p),
            options=self.options,
        )
        nothing = np.full((len(self.x0), len(p)), np.nan)
        if not solution.success:
            return SolutionPoint(np.full(self.shape, np.inf), nothing, solution, None)
        derivative = solution_derivative(
            solution,
            self.jacobian(solution.x, p),
            self._slopes(solution.x, p),
            lower,
            upper,
            dlower=_bound_slopes(self.lower, p, len(self.x0)),
            dupper=_bound_slopes(self.upper, p, len(self.x0)),
        )
        try:
            return SolutionPoint(solution.x, derivative.matrix, solution, derivative)
        except np.linalg.LinAlgError:
            return SolutionPoint(solution.x, nothing, solution, derivative)

    def _slopes(self, x: Array, p: Array) -> Any:
        """Give ``dF/dp``, by central differences if it is not given."""
        if self.map_slopes is None:
            return _differences(lambda q: real_array("F(x, p)", self.F(x, q)), p)
        slopes = self.map_slopes(x, p)
        return slopes if is_sparse(slopes) else np.reshape(slopes, (len(x), len(p)))

    def gradient(self, p: ArrayLike, weights: ArrayLike) -> Array:
        """Give the gradient of a function of the solution from its gradient by the unknowns.

        Parameters
        ----------
        p : array_like
            A value for each of `wrt`.
        weights : array_like
            The gradient of the function by the unknowns.

        Returns
        -------
        ndarray
            Its gradient by the parameters; NaN where the solution has no derivative.
        """
        of = self.evaluate(p).of
        try:
            return of.vjp(weights) if of is not None else np.full(len(self.wrt), np.nan)
        except np.linalg.LinAlgError:
            return np.full(len(self.wrt), np.nan)


def solution_function(
    F: Callable[[Array, Array], ArrayLike],
    lower: Any,
    upper: Any,
    x0: ArrayLike,
    wrt: Sequence[str] | str,
    *,
    jac: Callable[[Array, Array], Any],
    dF: Callable[[Array, Array], Any] | None = None,
    options: VIOptions | Mapping[str, Any] | None = None,
) -> SolutionFunction:
    """Make a function of parameters that gives the solution of a VI and its derivative.

    Parameters
    ----------
    F : callable
        ``F(x, p)``, the map.
    lower, upper : array_like, callable or None
        Bounds, or functions of ``p`` that give them.
    x0 : array_like
        Where the first solve begins.
    wrt : sequence of str
        Names of the parameters.
    jac : callable
        ``jac(x, p)``, the Jacobian of `F` by the unknowns, dense or sparse.
    dF : callable, optional
        ``dF(x, p)``, its derivatives by the parameters, of shape (unknowns, parameters); by default
        central differences.
    options : VIOptions or dict, optional
        As for `zivi.solve_vi`.

    Returns
    -------
    SolutionFunction
        ``f(p) -> (x, dx/dp)``, with `SolutionFunction.fun`, `SolutionFunction.jac` and
        `SolutionFunction.gradient`; `jax_function` takes it, too.

    Raises
    ------
    ValueError, TypeError
        For an argument that is not as above.

    Examples
    --------
    Two firms choose quantities; the price falls with their sum and ``p`` is the cost of the second:

    >>> def profit(x, p):
    ...     return np.array([2 * x[0] + x[1] - 10, x[0] + 2 * x[1] - 10 + p[0]])
    >>> M = np.array([[2.0, 1.0], [1.0, 2.0]])
    >>> f = zivi.interop.solution_function(profit, 0, None, [1, 1], ["cost"], jac=lambda x, p: M)
    >>> f([1.0])
    (array([3.66666667, 2.66666667]), array([[ 0.33333333],
           [-0.66666667]]))
    >>> f.fun([6.0])  # the second sells nothing any more
    array([5., 0.])
    """
    for name, function in (("F", F), ("jac", jac)):
        if not callable(function):
            raise TypeError(f"{name} must be callable, got {type(function).__name__}")
    if dF is not None and not callable(dF):
        raise TypeError(f"dF must be callable or None, got {type(dF).__name__}")
    names = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    if not names or not all(isinstance(name, str) for name in names):
        raise ValueError(f"wrt must be names of parameters, got {wrt!r}")
    start = np.atleast_1d(vector("x0", x0, scalar=True)).copy()
    return SolutionFunction(F, lower, upper, start, names, jac, dF, options)


def _at(box: Any, p: Array) -> Any:
    return box(p) if callable(box) else box


def _bound_slopes(box: Any, p: Array, n: int) -> Array | None:
    """Give the derivatives of a bound that is a function; of an infinite one zero."""
    if not callable(box):
        return None
    with np.errstate(invalid="ignore"):
        slopes = _differences(lambda q: np.broadcast_to(np.asarray(box(q), float), (n,)), p)
    return np.nan_to_num(slopes)


def _differences(function: Callable[[Array], Array], p: Array) -> Array:
    columns = []
    for j, value in enumerate(p):
        ends = np.array([p, p])
        ends[:, j] += _STEP * max(1.0, abs(value)) * np.array([-1.0, 1.0])
        below, above = (function(end) for end in ends)
        columns.append((above - below) / (ends[1, j] - ends[0, j]))
    return np.column_stack(columns)
