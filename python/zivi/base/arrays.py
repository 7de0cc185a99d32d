"""Arrays that arrive from outside for the VI solver: their type, shape and entries."""

from __future__ import annotations

from typing import Any

import numpy as np

from zivi.base.check import Array, integer, real, real_array

__all__ = [
    "MAX_DENSE",
    "Array",
    "bound",
    "count",
    "dense",
    "is_sparse",
    "matrix",
    "require_finite",
    "vector",
]

MAX_DENSE = 2000
"""Largest number of unknowns for which a sparse matrix is made dense: 2 x 32 MB of work."""


def vector(name: str, value: Any, *, scalar: bool = False) -> Array:
    """Return `value` as a one-dimensional array of floats, or perhaps a scalar one."""
    array = real_array(name, value)
    if array.ndim != 1 and not (scalar and array.ndim == 0):
        raise ValueError(f"{name} must be one-dimensional, got shape {array.shape}")
    return array


def bound(name: str, value: Any, n: int) -> Array | float:
    """Return `value`, a number or an array of `n`, as a float or an array of `n` floats.

    None, also as an entry, is no bound.
    """
    if type(value) in (float, int):
        return real(name, value)
    none = -np.inf if name == "lower" else np.inf
    if value is None:
        return none
    if isinstance(value, list | tuple) and any(entry is None for entry in value):
        value = [none if entry is None else entry for entry in value]
    array = real_array(name, value)
    if array.ndim == 0:
        return float(array)
    if array.shape != (n,):
        raise ValueError(f"{name} must have {n} entries, got shape {array.shape}")
    return array


def count(name: str, value: object, *, least: int = 0) -> int:
    """Return `value` as an integer that is large enough."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be an integer, got {type(value).__name__} {value!r}")
    if value < least:
        raise ValueError(f"{name} must be >= {least}, got {value}")
    return integer(name, int(value))


def require_finite(name: str, array: Array) -> None:
    """Refuse an array with an entry that is not finite, naming the first one."""
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        index = ", ".join(str(int(k)) for k in bad[0])
        raise ValueError(f"{name}[{index}] must be finite, got {array[tuple(bad[0])]}")


def is_sparse(value: Any) -> bool:
    """Whether it is a sparse matrix or array."""
    return hasattr(value, "toarray") and hasattr(value, "nnz")


def dense(name: str, value: Any) -> Any:
    """Return a sparse matrix as a dense one, up to `MAX_DENSE` rows; others as they are."""
    if not is_sparse(value):
        return value
    if max(value.shape) > MAX_DENSE:
        raise ValueError(
            f"{name} is sparse with shape {value.shape}; made dense it may have at most "
            f"{MAX_DENSE} rows (zivi.vi.MAX_DENSE): the solver of VIs takes it as it is with "
            "linear_algebra='auto' or 'sparse'"
        )
    return value.toarray()


def matrix(name: str, value: Any, n: int) -> Array:
    """Return `value`, dense or sparse, as an ``n x n`` array of floats."""
    array = real_array(name, dense(name, value))
    if array.shape != (n, n):
        raise ValueError(f"{name} must have shape ({n}, {n}), got {array.shape}")
    return array
