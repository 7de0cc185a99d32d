"""Kinds of values in a file: each says what it allows, and reads a value or notes a mistake."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Protocol

from zivi.files.validation import Mistakes, got_value, suggestion

__all__ = ["Choice", "Either", "Kind", "Number", "Numbers", "Pair", "Switch", "Whole"]


class Kind(Protocol):
    """What a key may hold."""

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""

    def read(self, value: Any, key: str, mistakes: Mistakes) -> Any:
        """Give the value as the library takes it; None if a mistake was noted."""


@dataclasses.dataclass(frozen=True)
class Number:
    """A real number within bounds.

    Parameters
    ----------
    above, below : float, optional
        Bounds that are not allowed themselves.
    least, most : float, optional
        Bounds that are allowed.
    infinite : bool
        Whether infinity is allowed.
    """

    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None
    infinite: bool = False

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        bounds = {">": self.above, ">=": self.least, "<": self.below, "<=": self.most}
        told = [f"{sign} {bound:g}" for sign, bound in bounds.items() if bound is not None]
        number = "a number" if self.infinite else "a finite number"
        return " ".join(filter(None, [number, " and ".join(told), "or inf" * self.infinite]))

    def read(self, value: Any, key: str, mistakes: Mistakes) -> float | None:
        """Give a float."""
        if isinstance(value, int | float) and not isinstance(value, bool):
            number = _float(value)
            if self._holds(number):
                return number
        mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
        return None

    def _holds(self, number: float) -> bool:
        return (
            (math.isfinite(number) or (self.infinite and number == math.inf))
            and (self.above is None or number > self.above)
            and (self.least is None or number >= self.least)
            and (self.below is None or number < self.below)
            and (self.most is None or number <= self.most)
        )


def _float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.nan


@dataclasses.dataclass(frozen=True)
class Whole:
    """A whole number within bounds, both of them allowed."""

    least: int
    most: int = 2**63 - 1

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        top = "" if self.most == 2**63 - 1 else f" and <= {self.most}"
        return f"a whole number >= {self.least}{top}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> int | None:
        """Give an int."""
        whole = isinstance(value, int) and not isinstance(value, bool)
        if whole and self.least <= value <= self.most:
            return int(value)
        mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
        return None


@dataclasses.dataclass(frozen=True)
class Switch:
    """True or false."""

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return "true or false"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> bool | None:
        """Give a bool."""
        if isinstance(value, bool):
            return value
        mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
        return None


@dataclasses.dataclass(frozen=True)
class Choice:
    """One of some names or numbers.

    Parameters
    ----------
    names : tuple
        The names.
    words : str
        What a page says instead of the names.
    others : str
        Where other names belong, for the error.
    """

    names: tuple[str | int, ...]
    words: str = ""
    others: str = ""

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return "one of " + ", ".join(_quoted(name) for name in self.names)

    def read(self, value: Any, key: str, mistakes: Mistakes) -> Any:
        """Give the name."""
        if value in self.names and not isinstance(value, bool | float):
            return value
        meant = f"; {self.others}" if self.others else ""
        if isinstance(value, str):
            near, _, _ = suggestion(value, (str(it) for it in self.names)).partition(" allowed:")
            meant = near.rstrip(";") or meant
        mistakes.add(key, f"must be {self.allowed}, {got_value(value)}{meant}")
        return None


def _quoted(name: str | int) -> str:
    return f'"{name}"' if isinstance(name, str) else str(name)


@dataclasses.dataclass(frozen=True)
class Pair:
    """A list of two numbers."""

    first: Number
    second: Number
    names: tuple[str, str]

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        parts = zip(self.names, (self.first, self.second), strict=True)
        told = (f"{name}{kind.allowed.removeprefix('a finite number')}" for name, kind in parts)
        return f"a list of two finite numbers, [{', '.join(told)}]"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> tuple[Any, Any] | None:
        """Give a tuple of two floats."""
        if not (isinstance(value, list) and len(value) == 2):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
            return None
        first = self.first.read(value[0], f"{key}[0]", mistakes)
        return first, self.second.read(value[1], f"{key}[1]", mistakes)


def read_each(whole: Kind, of: Kind, value: Any, key: str, mistakes: Mistakes) -> list[Any] | None:
    """Give the entries of a list that must not be empty, each of one kind."""
    if not (isinstance(value, list) and value):
        mistakes.add(key, f"must be {whole.allowed}, {got_value(value)}")
        return None
    return [of.read(it, f"{key}[{n}]", mistakes) for n, it in enumerate(value)]


@dataclasses.dataclass(frozen=True)
class Numbers:
    """A list of numbers, not empty."""

    of: Number | Whole = dataclasses.field(default_factory=Number)

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return f"a list, each {self.of.allowed}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> list[Any] | None:
        """Give a list of numbers."""
        return read_each(self, self.of, value, key, mistakes)


@dataclasses.dataclass(frozen=True)
class Either:
    """A simple value, or a table."""

    simple: Kind
    table: Kind

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return f"{self.simple.allowed}, or {self.table.allowed}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> Any:
        """Give what the one or the other gives."""
        if isinstance(value, dict):
            return self.table.read(value, key, mistakes)
        tried = Mistakes(mistakes.file)
        found = self.simple.read(value, key, tried)
        if tried.found and not tried.found[0].startswith(f"{mistakes.file}: {key}["):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
        else:  # what is wrong is in it
            mistakes.found += tried.found
        return found
