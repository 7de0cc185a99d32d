"""Units: an absolute tolerance of 1e-9 means nothing where all numbers are of 1e-10."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

import zivi._zivi as _zivi
from zivi.base.arrays import Array
from zivi.vi.types import VIResult

__all__ = ["Affine", "Watched", "dense_is_off_scale", "is_off_scale", "polished", "solve_scaled"]

TOL = 1e-9
"""Default tolerance, and that of a small problem relative to its values at the start."""
_FEW = 64
"""Up to so many numbers a loop of Python takes less than NumPy."""
_SMALL = 1e-3
"""Rows and unknowns of this size and above are compared with the tolerance as they are."""
_ROUNDS = 10
"""Of the equilibration of rows and columns."""
_NOISE, _NEAR = 1e-13, 1e-6
"""Such a residual, or one so far below the start's, that cannot be made better is a solution."""

Solve: TypeAlias = Callable[["Affine"], VIResult]


@dataclasses.dataclass(frozen=True)
class Affine:
    """``F(x) = M x + q`` on a box, and where it begins; `M` may be a ``csr_array``."""

    M: Any
    q: Array
    lower: Array
    upper: Array
    x0: Array


class _Entries:
    """The absolute values of a matrix, dense or sparse."""

    def __init__(self, M: Any) -> None:
        self._dense: Array | None = None
        if isinstance(M, np.ndarray):
            self._dense = np.abs(M)
        else:
            coordinates = M.tocoo()
            self._row, self._column = coordinates.coords
            self._values = np.abs(coordinates.data)

    def moves(self, value: Array) -> Array:
        """Return ``max_i value_i / |M_ij|``, zero where a column is empty."""
        if self._dense is not None:
            moved = np.where(self._dense > 0, value[:, None] / self._dense, 0.0)
            return np.asarray(moved.max(axis=0))
        moved = np.where(self._values > 0, value[self._row] / self._values, 0.0)
        return _largest(moved, self._column, len(value))

    def largest(self, rows: Array, columns: Array) -> tuple[Array, Array]:
        """Return the largest of each row and of each column of ``rows_i |M_ij| columns_j``."""
        if self._dense is not None:
            scaled = rows[:, None] * self._dense * columns
            return scaled.max(axis=1), scaled.max(axis=0)
        scaled = rows[self._row] * self._values * columns[self._column]
        n = len(rows)
        return _largest(scaled, self._row, n), _largest(scaled, self._column, n)


def _largest(values: Array, places: Any, n: int) -> Array:
    found = np.zeros(n)
    np.maximum.at(found, places, values)
    return found


def _times(rows: Array, M: Any, columns: Array) -> Any:
    """Return ``rows_i M_ij columns_j``."""
    if isinstance(M, np.ndarray):
        return rows[:, None] * M * columns
    scaled = M.copy()
    scaled.data *= np.repeat(rows, np.diff(M.indptr)) * columns[M.indices]
    return scaled


def _sizes(a: Affine) -> tuple[Array, Array]:
    """Return the sizes of rows and of unknowns, from what moves them at the start.

    Of the unknowns what balances a row, ``max_i |F_i / M_ij|``, at most the width of the box; of
    the rows their value and what those moves change.
    """
    entries = _Entries(a.M)
    value = np.abs(a.M @ a.x0 + a.q)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        moves = entries.moves(value)
        width = a.upper - a.lower
        moves = np.minimum(np.where(moves > 0, moves, 1.0), np.where(width > 0, width, 1.0))
        columns = np.maximum(moves, np.abs(a.x0))
        rows = np.maximum(value, entries.largest(np.ones(len(value)), np.minimum(columns, 1.0))[0])
    return np.where(rows > 0, rows, 1.0), columns


def is_off_scale(a: Affine) -> bool:
    """Whether some rows or unknowns are so small that an absolute tolerance means nothing."""
    rows, columns = _sizes(a)
    return bool(rows.min() < _SMALL or columns.min() < _SMALL)


def dense_is_off_scale(
    M: Array, q: Array, box: tuple[Array | float, Array | float], x0: Array | None
) -> bool:
    """`is_off_scale` of a dense problem before anything of it is made; False where it is none."""
    return _zivi.is_off_scale(M, q, *box, x0, _SMALL)


def _units(a: Affine) -> tuple[Array, Array]:
    """Return factors of rows and units of unknowns that bring all entries to 1 or below."""
    rows, columns = np.ones(len(a.q)), np.ones(len(a.q))
    entries = _Entries(a.M)
    for _ in range(_ROUNDS):
        across, along = entries.largest(rows, columns)
        rows /= np.sqrt(np.where(across > 0, across, 1.0))
        columns /= np.sqrt(np.where(along > 0, along, 1.0))
    # with the constant of 1 the solution is of 1, too
    size = max(np.abs(rows * (a.M @ a.x0 + a.q)).max(), np.abs(a.x0 / columns).max()) or 1.0
    return rows / size, columns * size


def solve_scaled(a: Affine, solve: Solve) -> VIResult:
    """Solve in units of the problem's own, then to the absolute tolerance as well."""
    rows, columns = _units(a)
    scaled = Affine(
        _times(rows, a.M, columns),
        rows * a.q,
        a.lower / columns,
        a.upper / columns,
        a.x0 / columns,
    )
    found = solve(scaled)
    x = np.clip(found.x * columns, a.lower, a.upper)
    if not found.success:
        F = a.M @ x + a.q
        residual = _zivi.natural_residual(x, F, a.lower, a.upper)
        return dataclasses.replace(found, x=x, F=F, residual=residual)
    last = solve(dataclasses.replace(a, x0=x))
    counts = _counts(found, last)
    return dataclasses.replace(
        last, stage=found.stage if last.n_iter == 0 else last.stage, projected=False, **counts
    )


_COUNTS = (
    "n_iter",
    "nfev",
    "njev",
    "n_pivots",
    "n_semismooth_steps",
    "n_gradient_steps",
    "n_restarts",
    "n_factorisations",
)


def _counts(first: VIResult, last: VIResult) -> dict[str, Any]:
    """Return the work of both."""
    counts = {name: getattr(first, name) + getattr(last, name) for name in _COUNTS}
    return counts | {"fill": max(first.fill, last.fill)}


class Watched:
    """A map that remembers how large its first value was."""

    def __init__(self, F: Callable[[Array], Any]) -> None:
        self._F = F
        self._first: Array | None = None
        self.calls = 0

    def __call__(self, x: Array) -> Any:
        """Return the values."""
        self.calls += 1
        value = self._F(x)
        if self._first is None:
            self._first = np.array(value)  # the caller may write over it
        return value

    @property
    def size(self) -> float:
        """The largest of the first values; infinite where they are not finite."""
        if self._first is None:
            return np.inf
        if self._first.size > _FEW:
            size = float(np.abs(self._first).max())
            return size if math.isfinite(size) else np.inf
        sizes = [abs(value) for value in self._first.ravel().tolist()]
        return float(max(sizes, default=0.0)) if all(map(math.isfinite, sizes)) else np.inf


def polished(first: VIResult, size: float, solve: Callable[[Array, float], VIResult]) -> VIResult:
    """Go on from a solution where `F` was small at the start: it may be the units that are small.

    Parameters
    ----------
    first : VIResult
        The end of the solve.
    size : float
        The largest value of `F` at the start.
    solve : callable
        The same from another start, to another tolerance.

    Returns
    -------
    VIResult
        `first`, or a better one.
    """
    if not first.success or not size or size >= _SMALL or first.residual <= TOL * size:
        return first
    last = solve(first.x, TOL * size)
    counts = _counts(first, last)
    if not last.success and first.residual <= max(_NOISE, _NEAR * size):
        return dataclasses.replace(first, **counts)
    return dataclasses.replace(last, projected=first.projected, **counts)
