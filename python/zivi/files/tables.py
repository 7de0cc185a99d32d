"""Tables in a file: which keys they have, and which of them belong together."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from zivi.files.expressions import Each
from zivi.files.kinds import Choice, Either, Kind
from zivi.files.validation import Mistakes, got_value, joined, suggestion

__all__ = ["Key", "Open", "Row", "Table", "Tagged", "rows"]


@dataclasses.dataclass(frozen=True)
class Key:
    """One key of a table.

    Parameters
    ----------
    name : str
        Its name.
    kind : Kind
        What it may hold.
    meaning : str
        What it is.
    unit : str
        Its unit, "" if it is no quantity.
    default : str or None
        What holds if it is left out, in words or as in the file; None if it is required.
    """

    name: str
    kind: Kind
    meaning: str
    unit: str = ""
    default: str | None = None


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of known keys."""

    keys: tuple[Key, ...]

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return f"a table with {', '.join(key.name for key in self.keys)}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> dict[str, Any] | None:
        """Give the values of the keys that are there."""
        if not isinstance(value, dict):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
            return None
        return read_keys(self.keys, value, key, mistakes)


@dataclasses.dataclass(frozen=True)
class Tagged:
    """A table in which one key, the tag, decides which others there are."""

    tag: str
    variants: Mapping[str, tuple[Key, ...]]
    default: str | None = None
    others: str = ""

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return f"a table with {self.tag} = {Choice(tuple(self.variants)).allowed}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> dict[str, Any] | None:
        """Give the tag and the values of the keys that are there."""
        if not isinstance(value, dict):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
            return None
        where = joined(key, self.tag)
        choice = Choice(tuple(self.variants), others=self.others)
        if self.tag not in value and self.default is None:
            mistakes.add(where, f"is missing: it must be {choice.allowed}")
            return None
        tag = choice.read(value.get(self.tag, self.default), where, mistakes)
        if tag is None:
            return None
        rest = {name: it for name, it in value.items() if name != self.tag}
        for name in [name for name in rest if name in self._elsewhere(tag)]:
            others = " and ".join(self._elsewhere(tag)[name])
            mistakes.add(joined(key, name), f"is no setting of {tag}, but of {others}")
            del rest[name]
        return {self.tag: tag} | read_keys(self.variants[tag], rest, key, mistakes)

    def _elsewhere(self, tag: str) -> dict[str, list[str]]:
        """Give the keys that only other variants have, with those."""
        own = {key.name for key in self.variants[tag]}
        found: dict[str, list[str]] = {}
        for variant, keys in self.variants.items():
            for key in keys:
                if key.name not in own:
                    found.setdefault(key.name, []).append(variant)
        return found


@dataclasses.dataclass(frozen=True)
class Open:
    """A table whose names are the user's, all with one kind of value."""

    kind: Kind
    names: str

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return f"a table of {self.names}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> dict[str, Any] | None:
        """Give the values by name."""
        if not isinstance(value, dict):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
            return None
        return {name: self.kind.read(it, joined(key, name), mistakes) for name, it in value.items()}


def read_keys(
    keys: tuple[Key, ...], value: Mapping[str, Any], path: str, mistakes: Mistakes
) -> dict[str, Any]:
    """Read the keys of a table, and note those that are unknown or missing."""
    known = {key.name: key for key in keys}
    for name in value:
        if name not in known:
            mistakes.add(joined(path, name), f"is no key{suggestion(name, known)}")
    for key in keys:
        if key.default is None and key.name not in value:
            text = f"is missing: {key.meaning}, {key.kind.allowed}"
            mistakes.add(joined(path, key.name), text)
    return {
        name: known[name].kind.read(it, joined(path, name), mistakes)
        for name, it in value.items()
        if name in known
    }


@dataclasses.dataclass(frozen=True)
class Row:
    """One key as a page lists it; `variant` is the tag that it needs, "" if it needs none."""

    path: str
    variant: str
    key: Key


def rows(keys: tuple[Key, ...], path: str = "", variant: str = "") -> Iterator[Row]:
    """List keys with all keys below them."""
    for key in keys:
        here = joined(path, key.name)
        yield Row(here, variant, key)
        yield from _below(key.kind, here, variant)


def _below(kind: Kind, path: str, variant: str) -> Iterator[Row]:
    if isinstance(kind, Either):
        yield from _below(kind.table, path, variant)
    elif isinstance(kind, Table):
        yield from rows(kind.keys, path, variant)
    elif isinstance(kind, Each):
        yield from _below(kind.of, path, variant)
    elif isinstance(kind, Open):
        values = Key("NAME", kind.kind, f"one of the {kind.names}", default="")
        yield Row(f"{path}.NAME", variant, values)
        yield from _below(kind.kind, f"{path}.NAME", variant)
    elif isinstance(kind, Tagged):
        choice = Choice(tuple(kind.variants))
        default = None if kind.default is None else f'"{kind.default}"'
        yield Row(joined(path, kind.tag), variant, Key(kind.tag, choice, "which", default=default))
        first, *others = kind.variants.values()
        shared = tuple(key for key in first if all(key in keys for keys in others))
        yield from rows(shared, path, variant)
        for tag, keys in kind.variants.items():
            yield from rows(tuple(key for key in keys if key not in shared), path, tag)
