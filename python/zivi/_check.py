"""Checks of numbers that arrive from outside; ranges are checked where they are known."""

import math
import numbers

__all__ = ["finite", "real"]


def real(name: str, value: object) -> float:
    """Return `value` as a float; a TypeError names what is not a real number."""
    if not isinstance(value, numbers.Real):
        raise TypeError(f"{name} must be a real number, got {type(value).__name__} {value!r}")
    return float(value)


def finite(name: str, value: object) -> float:
    """Return `value` as a finite float; a TypeError or ValueError names it otherwise."""
    number = real(name, value)
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {number}")
    return number
