"""Checks of numbers that arrive from outside; ranges are checked where they are known."""

from __future__ import annotations

import math
import numbers
import re
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Array",
    "MaybeNone",
    "by_name",
    "finite",
    "identifier",
    "integer",
    "not_negative",
    "positive",
    "real",
    "real_array",
    "switch",
    "unmasked",
]

Array = NDArray[np.float64]
MaybeNone: TypeAlias = Any
"""None in a case that a caller often knows to be excluded.

``float | MaybeNone`` may be compared with None and, unlike ``float | None``, be used without that.
"""


def real(name: str, value: object) -> float:
    """Return `value` as a float; an error names what is not a real number, or too large."""
    if type(value) is float:
        return value
    if type(value) is not int and not isinstance(value, numbers.Real):
        raise TypeError(f"{name} must be a real number, got {type(value).__name__} {value!r}")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{name} must fit into a float, got an integer beyond 1e308") from None


def real_array(name: str, value: object) -> Array:
    """Return `value` as a new contiguous array of floats; a TypeError names what holds no reals.

    A copy: what the caller, or a function that the caller gave, writes into `value` later changes
    nothing.
    """
    unmasked(name, value)
    try:
        array = np.asarray(value)
    except ValueError as error:  # ragged
        raise TypeError(f"{name} must hold real numbers: {error}") from None
    if array.dtype.kind not in "biuf":
        raise TypeError(f"{name} must hold real numbers, got dtype {array.dtype}")
    return array.astype(np.float64, order="C", copy=True)


def unmasked(name: str, value: object) -> None:
    """Raise a ValueError for masked entries: NumPy would use the numbers behind the mask."""
    if isinstance(mask := getattr(value, "_mask", None), np.ndarray) and mask.any():
        raise ValueError(
            f"{name} must have no masked entries, got {np.count_nonzero(mask)} of {mask.size}; "
            "use .compressed() or .filled(value)"
        )


def finite(name: str, value: object) -> float:
    """Return `value` as a finite float; a TypeError or ValueError names it otherwise."""
    number = real(name, value)
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {number}")
    return number


def not_negative(name: str, value: object) -> float:
    """Return `value` as a finite float >= 0; a TypeError or ValueError names it otherwise."""
    number = real(name, value)
    if not (math.isfinite(number) and number >= 0.0):
        raise ValueError(f"{name} must be finite and >= 0, got {number}")
    return number


def positive(name: str, value: object) -> float:
    """Return a finite number > 0."""
    number = real(name, value)
    if not (math.isfinite(number) and number > 0.0):
        raise ValueError(f"{name} must be finite and > 0, got {number}")
    return number


def identifier(name: str, value: str) -> str:
    """Return `value` if it can be a name in C; a ValueError tells it otherwise."""
    if re.fullmatch(r"[A-Za-z]\w*", value, re.ASCII) is None:
        raise ValueError(
            f"{name} must be a letter, then letters, digits and underscores, got {value!r}"
        )
    return value


def by_name(name: str, value: object) -> dict[str, Any]:
    """Return a dict with names for keys; a TypeError names what is none."""
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} must be a dict by names, got {type(value).__name__} {value!r}")
    return {str(key): it for key, it in value.items()}


def integer(name: str, value: object) -> int:
    """Return `value` as an int of 64 bits; a TypeError or ValueError names it otherwise."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise TypeError(f"{name} must be a whole number, got {value!r}")
    if abs(number := int(value)) >= 2**63:
        raise ValueError(f"{name} must be a whole number below 2**63, got {value}")
    return number


def switch(name: str, value: object) -> bool:
    """Return `value` as True or False; a TypeError names it otherwise."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {value!r}")
    return bool(value)
