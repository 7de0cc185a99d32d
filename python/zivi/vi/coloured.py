"""Jacobians by differences of maps whose pattern is known: columns that share no row together.

Curtis, Powell & Reid, *J. Inst. Math. Appl.* 13 (1974) 117-119: as many evaluations of `F` as
there are colours, not as there are unknowns.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from zivi.base.arrays import Array, is_sparse

__all__ = ["ColouredDifferences", "colours_of", "pattern_of"]

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
    """The Jacobian of a map by differences in a box, or by complex steps.

    Parameters
    ----------
    value : callable
        ``F(x)``; None where it is not defined.
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
