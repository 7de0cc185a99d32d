"""Jacobian of the map of a box VI: given, by finite differences or complex steps; checks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, dense, is_sparse, matrix, real_array, require_finite, vector

# Jacobians by differences of maps whose pattern is known: columns that share no row together.
#
# Curtis, Powell & Reid, *J. Inst. Math. Appl.* 13 (1974) 117-119: as many evaluations of `F` as
# there are colours, not as there are unknowns.

_COMPLEX_STEP = 1e-200


def pattern_of(jac_sparsity: Any, n: int) -> Any:
    """Return the pattern as a ``csc_array`` of ones, sorted."""
    from scipy.sparse import csc_array

    given = jac_sparsity if is_sparse(jac_sparsity) else np.asarray(jac_sparsity)
    if given.shape != (n, n):
        raise ValueError(f"jac_sparsity must have shape ({n}, {n}), got {given.shape}")
    if given.dtype.kind not in "biuf":
        raise TypeError(f"jac_sparsity must hold numbers, got dtype {given.dtype}")
    pattern = csc_array(given, copy=True)
    pattern.sum_duplicates()
    pattern.eliminate_zeros()
    return csc_array((np.ones(pattern.nnz), pattern.indices, pattern.indptr), shape=(n, n))


def colours_of(pattern: Any) -> Any:
    """Return a colour for each column, such that columns of one colour share no row.

    Greedily, each column the first colour that is left; those of a row are bits of an integer.
    """
    n = pattern.shape[1]
    indptr, indices = pattern.indptr.tolist(), pattern.indices.tolist()
    taken = [0] * pattern.shape[0]
    colours = np.zeros(n, np.intp)
    for j in range(n):
        rows = indices[indptr[j] : indptr[j + 1]]
        used = 0
        for i in rows:
            used |= taken[i]
        free = ~used & (used + 1)  # the lowest bit that is not set
        for i in rows:
            taken[i] |= free
        colours[j] = free.bit_length() - 1
    return colours


class ColouredDifferences:
    """The Jacobian of a map by finite differences in a box or by complex steps.

    Parameters
    ----------
    value : callable
        ``F(x)``; None if undefined.
    pattern : csc_array
        Where the Jacobian may be nonzero.
    scheme : {"3-point", "2-point", "cs"}
        Differences of second order, of first order, complex steps.
    lower, upper : ndarray
        The box, which is not left.
    """

    def __init__(
        self,
        value: Callable[[Any], Array | None],
        pattern: Any,
        scheme: str,
        lower: Array,
        upper: Array,
    ) -> None:
        self._value, self._pattern, self._scheme = value, pattern, scheme
        self._lower, self._upper = lower, upper
        self._colours = colours_of(pattern)
        self._columns = np.repeat(np.arange(pattern.shape[1]), np.diff(pattern.indptr))

    @property
    def n_colours(self) -> int:
        """Number of colours."""
        return int(self._colours.max(initial=-1)) + 1

    def __call__(self, x: Array, rounding: float) -> Any:
        """Return the Jacobian at `x`, where `F` rounds so; None where `F` is not defined."""
        from scipy.sparse import csc_array

        here = None if self._scheme == "cs" else self._value(x)
        if here is None and self._scheme != "cs":
            return None
        power = 1 / 3 if self._scheme == "3-point" else 1 / 2
        steps = self._steps(x, rounding**power * np.maximum(1.0, np.abs(x)))
        data = np.zeros(self._pattern.nnz)
        for colour in range(self.n_colours):
            mask = self._colours == colour
            entries = np.flatnonzero(mask[self._columns])
            rows, columns = self._pattern.indices[entries], self._columns[entries]
            slopes = self._slopes(x, here, mask, *steps, rows, columns)
            if slopes is None:
                return None
            data[entries] = slopes
        shape = self._pattern.shape
        return csc_array((data, self._pattern.indices, self._pattern.indptr), shape=shape)

    def _steps(self, x: Array, size: Array) -> tuple[Array, Any]:
        """Return signed steps that stay in the box, twice of them too, and which go both ways."""
        above, below = self._upper - x, x - self._lower
        both = (above >= size) & (below >= size) & (self._scheme == "3-point")
        forward = above >= below
        reach = np.where(forward, above, below)
        reach = 0.5 * reach if self._scheme == "3-point" else reach
        signed = np.where(forward, 1.0, -1.0) * np.minimum(size, reach)
        fixed = reach <= 0  # no room at all: the box is left
        return np.where(both | fixed, size, signed), both

    def _slopes(
        self, x: Array, here: Any, mask: Any, h: Array, both: Any, rows: Any, columns: Any
    ) -> Array | None:
        """Return the entries of the columns of one colour."""
        if self._scheme == "cs":
            moved = x.astype(complex)
            moved[mask] += 1j * _COMPLEX_STEP
            value = self._value(moved)
            return None if value is None else value.imag[rows] / _COMPLEX_STEP
        first = x + np.where(mask, np.where(both, -h, h), 0.0)
        one = self._value(first)
        if one is None:
            return None
        moved_by = (first - x)[columns]
        if self._scheme == "2-point":
            quotient: Array = (one[rows] - here[rows]) / moved_by
            return quotient
        second = x + np.where(mask, np.where(both, h, 2 * h), 0.0)
        two = self._value(second)
        if two is None:
            return None
        central = (two[rows] - one[rows]) / (second - first)[columns]
        sided = (4 * one[rows] - 3 * here[rows] - two[rows]) / (2 * moved_by)
        slopes: Array = np.where(both[columns], central, sided)
        return slopes


# The Jacobian of the map of a box VI: given, by differences, by complex steps, and checked.

_SCHEMES = ("2-point", "3-point")


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


class ValueWithJacobian:
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
    """Return converters of values of `F`, with rounding, and of its Jacobian to arrays.

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
        ``F(x, *args)`` (see `solve_vi`); it is called at distances of about 1e-5 from `x`.
    jac : callable, matrix or True
        ``jac(x, *args)`` returns the ``n x n`` matrix of ``dF_i/dx_j``, dense or sparse; a matrix
        stands for a constant one, True for an `F` that returns both.
    x : array_like
        The point. Choose a generic point inside the box.
    args : tuple
        Further arguments of `F` and `jac`.

    Returns
    -------
    JacobianError
        The worst entry.

    Raises
    ------
    ValueError, TypeError
        If an argument, or a value of `F` or `jac`, is invalid.

    See Also
    --------
    solve_vi : the solver that uses the Jacobian.
    scipy.optimize.check_grad : gradients of scalar functions.

    Notes
    -----
    Central differences whose step is the third root of the rounding of `F`; their error is
    estimated by twice the step: 4 n + 1 evaluations of the map for n unknowns.

    References
    ----------
    A. R. Curtis, M. J. D. Powell and J. K. Reid, On the estimation of sparse Jacobian matrices, IMA
    J. Appl. Math. 13, 1974.

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
        map_ = both = ValueWithJacobian(map_)
        given = matrices(both.jac(point.copy()))
    else:
        given = matrices(jac(point.copy(), *args) if callable(jac) else jac)
    expected, uncertain = _central_jacobian(lambda x: values(map_(x)), point)
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


def _central_jacobian(F: Callable[[Array], tuple[Array, float]], x: Array) -> tuple[Array, Array]:
    """Return central differences of `F` and their uncertainty.

    Truncation is estimated from differences over twice the step, rounding from the size of `F`.
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
