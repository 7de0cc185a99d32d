"""Whether an expression depends on symbols: by numbers, since simplification may never end."""

from __future__ import annotations

import importlib
import random
from collections.abc import Mapping, Sequence
from typing import Any

from zivi.base.extras import needed

__all__ = ["depends"]

DIGITS = 50
LARGEST = 1e4
"""Largest exponent of 2 in what is worked out: sums of very different numbers take long."""
TRIES = 5
NAMES = {"abs": "fabs", "Abs": "fabs"}
"""Functions whose names in mpmath are others."""


def depends(entry: Any, symbols: Sequence[Any]) -> bool:
    """Whether an expression changes with some symbols; True, too, if its values cannot be told.

    It is worked out twice at random places, with other values of these symbols, and both again with
    more digits: a difference by rounding shrinks, a true one stays.
    """
    there = sorted(set(symbols) & entry.free_symbols, key=str)
    if not there:
        return False
    drawn, told = random.Random(1), False
    for _ in range(TRIES):
        place = {s: drawn.uniform(-1, 1) for s in sorted(entry.free_symbols, key=str)}
        other = place | {s: drawn.uniform(-1, 1) for s in there}
        try:
            few, many = (_change(entry, place, other, digits) for digits in (DIGITS, 2 * DIGITS))
        except (ArithmeticError, ValueError):
            continue
        except _UnknownFunctionError:
            # in an expression of the user, not in a formula
            simple = needed("sympy", "symbolic systems").simplify(entry)
            return not simple.free_symbols.isdisjoint(there)
        if few and many > few / 10 ** (DIGITS // 5):
            return True
        told = True
    return not told


class _UnknownFunctionError(Exception):
    """A function without values in many digits."""


def _change(entry: Any, one: Mapping[Any, float], other: Mapping[Any, float], digits: int) -> Any:
    """Give the distance of the values at two places."""
    mpmath = importlib.import_module("mpmath")  # SymPy needs it

    with mpmath.workdps(digits):
        return abs(_Values(mpmath, one).of(entry) - _Values(mpmath, other).of(entry))


class _Values:
    """Works out expressions at one place; each part once, and none that would fill the memory."""

    def __init__(self, mpmath: Any, place: Mapping[Any, float]) -> None:
        self.mpmath = mpmath
        self.known: dict[Any, Any] = {s: mpmath.mpf(value) for s, value in place.items()}

    def of(self, part: Any) -> Any:
        if part not in self.known:
            value = self._worked_out(part)
            if any(abs(self.mpmath.mag(it)) > LARGEST for it in (value.real, value.imag) if it):
                raise OverflowError
            self.known[part] = value
        return self.known[part]

    def _worked_out(self, part: Any) -> Any:
        mpmath = self.mpmath
        if not part.args:
            return mpmath.mpmathify(part.evalf(mpmath.mp.dps))
        values = [self.of(argument) for argument in part.args]
        if part.is_Add:
            return mpmath.fsum(values)
        if part.is_Mul:
            return mpmath.fprod(values)
        name = type(part).__name__
        if part.is_Pow or name == "power":
            base, exponent = values
            if base and abs(exponent * mpmath.log(base)) > LARGEST:
                raise OverflowError
            return base**exponent
        if name in ("exp", "sinh", "cosh") and abs(values[0]) > LARGEST:
            raise OverflowError
        if name in ("atan2", "max", "Max", "sign"):
            if any(value.imag for value in values):
                raise ValueError("a function of real numbers")
            values = [value.real for value in values]
        function = max if name in ("max", "Max") else getattr(mpmath, NAMES.get(name, name), None)
        if function is None:
            raise _UnknownFunctionError
        return function(*values)
