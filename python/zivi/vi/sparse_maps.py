"""Maps of the sparse solver: affine ones, and those of callables with what they may do wrong."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from zivi.base.arrays import Array, is_sparse
from zivi.vi.coloured import ColouredDifferences, pattern_of

__all__ = ["AffineMap", "CallableMap", "require_finite_entries", "sparse_matrix"]


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
    """Refuse a ``csr_array`` that holds NaN or infinity."""
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
        The Jacobian as a matrix, or what `ColouredDifferences` makes it of.
    converts : callable
        Makes an array with its rounding of what `F` returns.
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
        """Return the Jacobian; None where it raised. What is not finite in it is differenced."""
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
        """What to say about points where `F` or its Jacobian raised."""
        if not self._undefined:
            return ""
        return (
            f"; raised at {self._undefined} points and taken as not defined there, the last time "
            f"{self._last_error}"
        )
