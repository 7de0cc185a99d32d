"""Arrays that arrive from outside for the VI solver: their type, shape and entries."""

from collections.abc import Callable
from typing import Any

import numpy as np

from zivi._check import Array, real_array

__all__ = [
    "MAX_DENSE",
    "Array",
    "bound",
    "dense",
    "matrix",
    "of_shape",
    "require_finite",
    "vector",
]

MAX_DENSE = 2000
"""Largest number of unknowns for which a sparse matrix is made dense: 2 x 32 MB of work."""


def vector(name: str, value: Any) -> Array:
    """Return `value` as a one-dimensional array of floats."""
    array = real_array(name, value)
    if array.ndim != 1:
        raise ValueError(f"{name} must be one-dimensional, got shape {array.shape}")
    return array


def bound(name: str, value: Any, n: int) -> Array:
    """Return `value`, a number or an array of `n`, as an array of `n` floats."""
    array = real_array(name, value)
    if array.ndim == 0:
        return np.full(n, float(array))
    if array.shape != (n,):
        raise ValueError(f"{name} must have {n} entries, got shape {array.shape}")
    return array


def require_finite(name: str, array: Array) -> None:
    """Refuse an array with an entry that is not finite, naming the first one."""
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        index = ", ".join(str(int(k)) for k in bad[0])
        raise ValueError(f"{name}[{index}] must be finite, got {array[tuple(bad[0])]}")


def dense(name: str, value: Any) -> Any:
    """Return a sparse matrix as a dense one, up to `MAX_DENSE` rows; others as they are."""
    if not (hasattr(value, "toarray") and hasattr(value, "nnz")):
        return value
    if max(value.shape) > MAX_DENSE:
        raise ValueError(
            f"{name} is sparse with shape {value.shape}; the solver is dense and takes at most "
            f"{MAX_DENSE} unknowns (zivi.vi.MAX_DENSE)"
        )
    return value.toarray()


def matrix(name: str, value: Any, n: int) -> Array:
    """Return `value`, dense or sparse, as an ``n x n`` array of floats."""
    array = real_array(name, dense(name, value))
    if array.shape != (n, n):
        raise ValueError(f"{name} must have shape ({n}, {n}), got {array.shape}")
    return array


def of_shape(
    name: str, function: Callable[[Array], Any], shape: tuple[int, ...]
) -> Callable[[Array], Array]:
    """Wrap a callback so that what it returns has the right type and shape."""

    def checked(x: Array) -> Array:
        value = real_array(name, dense(name, function(x)))
        if value.shape != shape:
            raise ValueError(f"{name} must have shape {shape}, got {value.shape}")
        return value

    return checked
