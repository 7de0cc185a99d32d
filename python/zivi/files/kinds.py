"""Types of values in an input file, with their validation."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import keyword
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

from zivi.base.formula import FormulaError, normal, parse
from zivi.base.habits import closest

# Errors in a file, reported with file, key and allowed values.

BARE = re.compile(r"[A-Za-z0-9_-]+")
"""Keys that TOML takes without quotes."""
LONGEST = 60
"""Characters of a wrong value that are shown."""


MEANT = dict.fromkeys(("restitution", "coefficient_of_restitution", "cor", "epsilon", "eps"), "e")
MEANT |= dict.fromkeys(("dt", "step", "step_size", "timestep"), "h")
MEANT |= dict.fromkeys(("frequency", "freq", "w"), "omega")
MEANT |= dict.fromkeys(("time", "span", "t_end", "duration"), "t_span")
MEANT |= dict.fromkeys(("start", "initial", "x0", "state"), "y0")
MEANT |= {"g": "gravity", "k": "stiffness", "c": "damping", "a": "amplitude", "tol": "rtol"}
"""Keys by names that other tools have for them."""


class FileError(ValueError):
    """A file that cannot be used; the text names it and everything that is wrong with it."""


class Mistakes:
    """Collects what is wrong with one file.

    Parameters
    ----------
    file : Path
        The file.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self.found: list[str] = []

    def add(self, key: str, text: str) -> None:
        """Note that something is wrong with a key."""
        self.found.append(f"{self.file}: {key} {text}" if key else f"{self.file}: {text}")

    def stop(self) -> None:
        """Raise if anything was noted."""
        if self.found:
            raise FileError("\n".join(self.found))

    @contextlib.contextmanager
    def naming(self, keys: Mapping[str, str], otherwise: str = "") -> Iterator[None]:
        """Turn an error about an argument into one about its key.

        Parameters
        ----------
        keys : dict
            The key of each argument that the library may name.
        otherwise : str
            The key of an error that names none of them.
        """
        try:
            yield
        except FileError:
            raise
        except (ValueError, TypeError, NotImplementedError) as error:
            argument, rest = _argument(str(error))
            if argument in keys:
                self.add(keys[argument], rest)
            else:
                self.add(f"{otherwise}:" if otherwise else "", str(error))
            raise FileError("\n".join(self.found)) from error


def _argument(message: str) -> tuple[str, str]:
    """Split an error into the argument it names, ``mu2`` or ``bounds['e']``, and the rest."""
    found = re.match(r"(\w+)(?:\[['\"]?(\w+)['\"]?\])? (.*)", message, re.DOTALL)
    return (found[2] or found[1], found[3]) if found else ("", message)


def dotted(path: str, name: str) -> str:
    """Append a name to the path of a table."""
    shown = name if BARE.fullmatch(name) else json.dumps(name)
    return f"{path}.{shown}" if path else shown


def got_value(value: Any) -> str:
    """Show a wrong value in a few characters."""
    text = repr(value)
    return f"got {text if len(text) <= LONGEST else text[: LONGEST - 3] + '...'}"


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return a hint: the most similar name, and the list of all names."""
    names = list(known)
    known_as = MEANT.get(name.lower())
    close = known_as if known_as in names else closest(name, names, 0.5)
    meant = f"; did you mean {close!r}?" if close else ";"
    return f"{meant} allowed: {', '.join(names) if names else 'nothing'}"


# Kinds of values in a file: each describes its values, and reads one or notes a mistake.


class Kind(Protocol):
    """Type of the values of a key."""

    @property
    def allowed(self) -> str:
        """Allowed values, in words."""

    def read(self, value: Any, key: str, mistakes: Mistakes) -> Any:
        """Return the value for the library; None if a mistake was noted."""


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
        """Allowed values, in words."""
        bounds = {">": self.above, ">=": self.least, "<": self.below, "<=": self.most}
        told = [f"{sign} {bound:g}" for sign, bound in bounds.items() if bound is not None]
        number = "a number" if self.infinite else "a finite number"
        return " ".join(filter(None, [number, " and ".join(told), "or inf" * self.infinite]))

    def read(self, value: Any, key: str, mistakes: Mistakes) -> float | None:
        """Return a float."""
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
        """Allowed values, in words."""
        top = "" if self.most == 2**63 - 1 else f" and <= {self.most}"
        return f"a whole number >= {self.least}{top}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> int | None:
        """Return an int."""
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
        """Allowed values, in words."""
        return "true or false"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> bool | None:
        """Return a bool."""
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
        """Allowed values, in words."""
        return "one of " + ", ".join(_quoted(name) for name in self.names)

    def read(self, value: Any, key: str, mistakes: Mistakes) -> Any:
        """Return the name."""
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
        """Allowed values, in words."""
        parts = zip(self.names, (self.first, self.second), strict=True)
        told = (f"{name}{kind.allowed.removeprefix('a finite number')}" for name, kind in parts)
        return f"a list of two finite numbers, [{', '.join(told)}]"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> tuple[Any, Any] | None:
        """Return a tuple of two floats."""
        if not (isinstance(value, list) and len(value) == 2):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
            return None
        first = self.first.read(value[0], f"{key}[0]", mistakes)
        return first, self.second.read(value[1], f"{key}[1]", mistakes)


def read_each(whole: Kind, of: Kind, value: Any, key: str, mistakes: Mistakes) -> list[Any] | None:
    """Return the entries of a list that must not be empty, each of one kind."""
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
        """Allowed values, in words."""
        return f"a list, each {self.of.allowed}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> list[Any] | None:
        """Return a list of numbers."""
        return read_each(self, self.of, value, key, mistakes)


@dataclasses.dataclass(frozen=True)
class Either:
    """A simple value, or a table."""

    simple: Kind
    table: Kind

    @property
    def allowed(self) -> str:
        """Allowed values, in words."""
        return f"{self.simple.allowed}, or {self.table.allowed}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> Any:
        """Return the value read by the table or the simple kind."""
        if isinstance(value, dict):
            return self.table.read(value, key, mistakes)
        tried = Mistakes(mistakes.file)
        found = self.simple.read(value, key, tried)
        if tried.found and not tried.found[0].startswith(f"{mistakes.file}: {key}["):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
        else:  # what is wrong is in it
            mistakes.found += tried.found
        return found


# Kinds of values that describe a mechanical system: expressions, names and states.
#
# An expression is a formula of `zivi.base.formula` and nothing else, so that a file cannot run
# code.


@dataclasses.dataclass(frozen=True)
class Expression:
    """A formula as a string, or a number."""

    @property
    def allowed(self) -> str:
        """Allowed values, in words."""
        return "an expression or a finite number"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> str | float | None:
        """Return the expression as it stands, or a float."""
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
        """Allowed values, in words."""
        return "a list of names"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> list[str] | None:
        """Return the names."""
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
        """Allowed values, in words."""
        return f"a list of {self.entries}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> list[Any] | None:
        """Return the list."""
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
        """Allowed values, in words."""
        lengths = range(self.least, len(self.names) + 1)
        forms = (self.names[0] if n == 1 else f"[{', '.join(self.names[:n])}]" for n in lengths)
        return f"{' or '.join(forms)}, each an expression or a finite number"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> list[str | float | None] | None:
        """Return the list."""
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
        """Allowed values, in words."""
        return f"{self.of.allowed}, or a list of them"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> Any:
        """Return a value or a list of values."""
        if isinstance(value, list):
            return [self.of.read(it, f"{key}[{n}]", mistakes) for n, it in enumerate(value)]
        return self.of.read(value, key, mistakes)
