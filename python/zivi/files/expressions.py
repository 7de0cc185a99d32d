"""Kinds of values that describe a mechanical system: expressions, names and states.

An expression is a formula of `zivi.base.formula` and nothing else, so that a file cannot run code.
"""

from __future__ import annotations

import dataclasses
import keyword
from typing import Any

from zivi.base.formula import FormulaError, normal, parse
from zivi.files.kinds import Kind, Number, read_each
from zivi.files.validation import Mistakes, got_value

__all__ = ["Each", "Expression", "Few", "Names", "OneOrEach"]


@dataclasses.dataclass(frozen=True)
class Expression:
    """A formula as a string, or a number."""

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return "an expression or a finite number"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> str | float | None:
        """Give the expression as it stands, or a float."""
        if isinstance(value, str):
            try:
                parse(value)
            except FormulaError as error:
                mistakes.add(key, f"must be {self.allowed}, {got_value(value)}: {error}")
            return value
        tried = Mistakes(mistakes.file)
        number = Number().read(value, key, tried)
        if tried.found:
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
        return number


@dataclasses.dataclass(frozen=True)
class Names:
    """A list of names, not empty and all different."""

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return "a list of names"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> list[str] | None:
        """Give the names."""
        if not (isinstance(value, list) and value):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
            return None
        names = [normal(name) if isinstance(name, str) else name for name in value]
        for n, name in enumerate(names):
            if not (isinstance(name, str) and name.isidentifier()) or keyword.iskeyword(name):
                mistakes.add(
                    f"{key}[{n}]", f"must be a name of letters and digits, {got_value(name)}"
                )
            elif name in names[:n]:
                mistakes.add(f"{key}[{n}]", f"must be another name, got {name!r} again")
        return names


@dataclasses.dataclass(frozen=True)
class Each:
    """A list of any length, not empty.

    Parameters
    ----------
    of : Kind
        Its entries.
    entries : str
        What they are.
    """

    of: Kind
    entries: str

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return f"a list of {self.entries}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> list[Any] | None:
        """Give the list."""
        return read_each(self, self.of, value, key, mistakes)


@dataclasses.dataclass(frozen=True)
class Few:
    """A list of a few expressions, of which those at the end may be left out.

    Parameters
    ----------
    names : tuple of str
        What the expressions are.
    least : int
        How many there must be. One alone needs no list.
    """

    names: tuple[str, ...]
    least: int

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        lengths = range(self.least, len(self.names) + 1)
        forms = (self.names[0] if n == 1 else f"[{', '.join(self.names[:n])}]" for n in lengths)
        return f"{' or '.join(forms)}, each an expression or a finite number"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> list[str | float | None] | None:
        """Give the list."""
        given = value if isinstance(value, list) else [value]
        if not self.least <= len(given) <= len(self.names):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
            return None
        several = isinstance(value, list)
        places = [f"{key}[{n}]" if several else key for n in range(len(given))]
        return [Expression().read(it, at, mistakes) for it, at in zip(given, places, strict=True)]


@dataclasses.dataclass(frozen=True)
class OneOrEach:
    """One value for all, or a list with one for each."""

    of: Kind

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return f"{self.of.allowed}, or a list of them"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> Any:
        """Give a value or a list of values."""
        if isinstance(value, list):
            return [self.of.read(it, f"{key}[{n}]", mistakes) for n, it in enumerate(value)]
        return self.of.read(value, key, mistakes)
