"""Fewer points of a line that look the same: the extremes of every piece of it."""

from __future__ import annotations

import numpy as np

from zivi.base.check import Array

__all__ = ["POINTS", "thinned"]

POINTS = 1000
"""Points of a line that is drawn."""


def thinned(
    columns: tuple[Array, ...], breaks: np.ndarray | None = None, points: int = POINTS
) -> tuple[Array, ...]:
    """Thin the columns of a line alike, keeping the extremes of each in every piece.

    Parameters
    ----------
    columns : tuple of ndarray
        Coordinates of the line's points, all of one length.
    breaks : ndarray of int, optional
        Indices of points before which the line is interrupted, by NaN.
    points : int
        At most so many points are returned, NaN included; at least 2 for each column and 2.

    Returns
    -------
    tuple of ndarray
        The columns at the points that are left.

    Examples
    --------
    >>> t = np.linspace(0.0, 1.0, 100_001)
    >>> few_t, few_x = thinned((t, np.sin(1000.0 * t)))
    >>> len(few_t) <= 1000, round(float(few_x.max()), 6)
    (True, 1.0)
    """
    before = np.empty(0, dtype=int) if breaks is None else breaks
    kept = _kept(columns, points - min(len(before), points // 2))
    gaps = np.unique(np.searchsorted(kept, before))
    gaps = gaps[(gaps > 0) & (gaps < len(kept))]
    return tuple(np.insert(column[kept], gaps, np.nan) for column in columns)


def _kept(columns: tuple[Array, ...], points: int) -> np.ndarray:
    """Choose indices: both ends, and where each column is least and greatest in every piece."""
    length = len(columns[0])
    if length <= points:
        return np.arange(length)
    pieces = max((points - 2) // (2 * len(columns)), 1)
    size = -(-length // pieces)
    starts = np.arange(0, length, size)
    chosen = [np.array([0, length - 1])]
    for column in columns:
        # the last piece is filled up with its last value, whose first index is taken
        full = np.append(column, np.full(len(starts) * size - length, column[-1]))
        piece = np.nan_to_num(full).reshape(len(starts), size)
        chosen += [starts + piece.argmin(axis=1), starts + piece.argmax(axis=1)]
    return np.unique(np.minimum(np.concatenate(chosen), length - 1))
