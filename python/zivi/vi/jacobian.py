"""The Jacobian of the map of a box VI: given, by differences, by complex steps, and checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.arrays import Array, dense, is_sparse, matrix, require_finite, vector
from zivi.base.check import real_array

__all__ = [
    "Both",
    "Converters",
    "IsSparseError",
    "JacobianError",
    "check_jacobian",
    "complex_steps",
    "converters",
    "jacobian",
    "wants_sparse",
]

_SCHEMES = ("2-point", "3-point")
_COMPLEX_STEP = 1e-200
"""So small that its square vanishes; there is no difference in which it could cancel."""


_MANY, _DENSE = 300, 0.1
"""Unknowns above which, and density below which, a sparse matrix is kept sparse."""


class IsSparseError(Exception):
    """The Jacobian that a callable has returned to the dense solver should be kept sparse."""


def wants_sparse(value: Any, n: int, algebra: str) -> bool:
    """Whether a matrix is one for the sparse solver."""
    if algebra != "auto":
        return algebra == "sparse"
    return is_sparse(value) and bool(n > _MANY or value.nnz < _DENSE * n * n)


def jacobian(jac: Any, x0: Array, args: tuple[Any, ...]) -> Callable[[Array], Any] | str:
    """Return `jac` as a function of `x`, or the name of a scheme of differences."""
    n = len(x0)
    if jac is None or jac is False:
        return "3-point"
    if isinstance(jac, str):
        if jac not in _SCHEMES:
            raise ValueError(f"jac must be '2-point', '3-point' or 'cs', got {jac!r}")
        return jac
    if callable(jac):
        return (lambda x: jac(x, *args)) if args else jac
    constant = matrix("jac", jac, n)
    require_finite("jac", constant)
    return lambda x: constant


class Both:
    """A map that returns its Jacobian with its values, as two functions.

    Parameters
    ----------
    F : callable
        ``F(x)`` returns both.
    """

    def __init__(self, F: Callable[[Array], Any]) -> None:
        self._F = F
        self._x: Array | None = None
        self._slopes: Any = None
        self.more_calls = 0
        """Calls for a Jacobian elsewhere than at the last value."""

    def __call__(self, x: Array) -> Any:
        """Return the values."""
        self._x, self._slopes = None, None
        both = self._F(x)
        if not isinstance(both, tuple | list) or len(both) != 2:
            raise TypeError(f"F must return (F(x), jac(x)) for jac=True, got {type(both).__name__}")
        value, self._slopes = both
        self._x = x.copy()
        return value

    def jac(self, x: Array) -> Any:
        """Return the Jacobian."""
        if self._x is None or not np.array_equal(self._x, x):
            self.more_calls += 1
            self(x)
        return self._slopes


def complex_steps(F: Callable[[Any], Any], n: int, calls: list[int]) -> Callable[[Array], Array]:
    """Return the Jacobian of `F` by ``Im F(x + i h e_j) / h``; its calls are counted."""

    def slopes(x: Array) -> Array:
        columns = np.empty((n, n))
        for j in range(n):
            moved = x.astype(complex)
            moved[j] += 1j * _COMPLEX_STEP
            value = np.asarray(F(moved))
            calls[0] += 1
            if value.dtype.kind != "c":
                raise TypeError(
                    "F(x) must be complex where x is, for jac='cs'; got dtype "
                    f"{value.dtype}: F is not analytic, or discards the imaginary part"
                )
            if value.shape != (n,) and not (n == 1 and value.ndim == 0):
                raise TypeError(f"F(x) must have shape ({n},), got {value.shape}")
            columns[:, j] = value.imag / _COMPLEX_STEP
        return columns

    return slopes


Converters: TypeAlias = tuple[Callable[[Any], tuple[Array, float]], Callable[[Any], Array]]


def converters(n: int, algebra: str = "dense") -> Converters:
    """Return what makes arrays of values of `F`, with their rounding, and of its Jacobian.

    The latter raises `IsSparseError` for one that should be kept sparse.
    """

    def values(value: Any) -> tuple[Array, float]:
        given = np.asanyarray(value) if hasattr(value, "dtype") else value
        array = _shaped("F(x)", given, (n,))
        kind = getattr(given, "dtype", array.dtype)
        rounding = float(np.finfo(kind).eps) if kind.kind == "f" else 0.0
        return array, max(rounding, float(np.finfo(float).eps))

    def matrices(value: Any) -> Array:
        if wants_sparse(value, n, algebra):
            raise IsSparseError
        return _shaped("jac(x)", dense("jac(x)", value), (n, n))

    return values, matrices


def _shaped(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    array = real_array(name, value)
    if array.ndim == 0 and shape[0] == 1:
        return array.reshape(shape)
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    return array


class JacobianError(NamedTuple):
    """The entry of a Jacobian that is farthest from the difference of the map."""

    error: float
    """``|J_ij - D_ij|``, less what ``D_ij`` is uncertain by, over the larger of both; 1e-6 or less
    is good, NaN where one is not finite."""
    row: int
    """``i``: which entry of `F`."""
    column: int
    """``j``: which entry of `x`."""
    given: float
    """``J_ij``, as given."""
    expected: float
    """``D_ij``, by differences."""


def check_jacobian(
    F: Callable[..., Any],
    jac: Callable[..., Any] | Any,
    x: ArrayLike,
    *,
    args: tuple[Any, ...] = (),
) -> JacobianError:
    """Compare a Jacobian with central differences of its map at a point.

    Parameters
    ----------
    F : callable
        ``F(x, *args)``, as for `solve_vi`; it is called at distances of about 1e-5 from `x`.
    jac : callable, matrix or True
        ``jac(x, *args)`` returns the ``n x n`` matrix of ``dF_i/dx_j``, dense or sparse; a matrix
        stands for a constant one, True for an `F` that returns both.
    x : array_like
        The point. Take one inside the box, where nothing is special.
    args : tuple
        Further arguments of `F` and `jac`.

    Returns
    -------
    JacobianError
        The worst entry.

    Raises
    ------
    ValueError, TypeError
        If an argument, or what `F` or `jac` returns, is not as above.

    Examples
    --------
    >>> worst = zivi.check_jacobian(lambda x: x**2, lambda x: np.diag([2 * x[0], 9.0]), [1.0, 2.0])
    >>> worst.row, worst.column, worst.given, round(worst.expected, 6)
    (1, 1, 9.0, 4.0)
    """
    point = np.atleast_1d(vector("x", x, scalar=True))
    n = len(point)
    values, matrices = converters(n)
    map_: Callable[..., Any] = (lambda x: F(x, *args)) if args else F
    if jac is True:
        map_ = both = Both(map_)
        given = matrices(both.jac(point.copy()))
    else:
        given = matrices(jac(point.copy(), *args) if callable(jac) else jac)
    expected, uncertain = _differences(lambda x: values(map_(x)), point)
    size = np.maximum(np.abs(given), np.abs(expected))
    with np.errstate(invalid="ignore"):
        excess = np.maximum(np.abs(given - expected) - uncertain, 0.0)
        errors = np.divide(excess, size, out=excess.copy(), where=size > 0)
    worst = np.argmax(np.where(np.isnan(errors), np.inf, errors))
    row, column = (int(k) for k in np.unravel_index(worst, errors.shape))
    return JacobianError(
        float(errors[row, column]),
        row,
        column,
        float(given[row, column]),
        float(expected[row, column]),
    )


def _differences(F: Callable[[Array], tuple[Array, float]], x: Array) -> tuple[Array, Array]:
    """Return central differences of `F`, and what they are uncertain by.

    Truncation is told by the differences over twice the step, rounding by the size of `F`.
    """
    n = len(x)
    here, rounding = F(x.copy())
    found, uncertain = np.empty((n, n)), np.empty((n, n))
    for j in range(n):
        step = rounding ** (1 / 3) * max(1.0, abs(x[j]))
        quotients = []
        size = np.abs(here)
        for h in (step, 2 * step):
            ends = np.array([x, x])
            ends[:, j] += h * np.array([-1.0, 1.0])
            below, above = (F(end.copy())[0] for end in ends)
            size = np.maximum(size, np.maximum(np.abs(below), np.abs(above)))
            quotients.append((above - below) / (ends[1, j] - ends[0, j]))
        found[:, j] = quotients[0]
        uncertain[:, j] = np.abs(quotients[1] - quotients[0]) + 2 * rounding * size / step
    return found, uncertain
