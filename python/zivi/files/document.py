"""Lists all keys of a file: for the page of the command line, and for its option ``--keys``.

Each command has a table, and so has each object that several commands or keys take: where one of
these is a value, the table of the command has a link in place of its keys.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from zivi.files.keys import CONTROL, LINEAR, RANGE, SIMULATE, SWEEP, WALL
from zivi.files.mechanical_keys import MECHANICS
from zivi.files.tables import Key, Row, Table, Tagged, rows
from zivi.files.tree_keys import TREE

__all__ = ["COMMANDS", "OBJECTS", "insert", "keys", "markdown"]

COMMANDS = {
    "simulate": SIMULATE,
    "mechanics": MECHANICS,
    "tree": TREE,
    "control": CONTROL,
    "sweep": SWEEP,
}
HEAD = "| key | only for | unit | allowed | default | meaning |\n|---|---|---|---|---|---|\n"


def _tagged(keys: tuple[Key, ...], name: str) -> Tagged:
    kind = next(key.kind for key in keys if key.name == name)
    if not isinstance(kind, Tagged):
        raise TypeError(f"{name} has no variants")
    return kind


OBJECTS: dict[str, tuple[str, Table | Tagged]] = {
    "force": ("force force_ref force_model", LINEAR),
    "wall": ("wall", WALL),
    "method": ("method", _tagged(SIMULATE, "method")),
    "controller": ("controller", _tagged(CONTROL, "controller")),
    "times": ("t_eval", Table(RANGE)),
}
"""What has a table of its own: the keys that may hold it, and its own keys."""


def markdown(keys: tuple[Key, ...]) -> str:
    """Give the table of the keys of a command, with links where an object is a value."""
    linked = ""
    shown: list[tuple[str, tuple[str, ...]]] = []
    for row in rows(keys):
        if linked and row.path.startswith(linked):
            continue
        link = next((it for it, (of, _) in OBJECTS.items() if row.key.name in of.split()), None)
        linked = f"{row.path}." if link else ""
        shown.append((row.variant, _cells(row, _see(link, row.key) if link else "")))
    return _table(iter(shown))


def of_object(name: str) -> str:
    """Give the table of the keys of an object."""
    kind = OBJECTS[name][1]
    found = rows((Key(name, kind, ""),))
    return _table((row.variant, _cells(row)) for row in found if row.path != name)


def _see(name: str, key: Key) -> str:
    """Give the link to an object, and what of it is less here."""
    said = f", see [{name}](#{name})"
    of, here = OBJECTS[name][1], key.kind
    if isinstance(of, Tagged) and isinstance(here, Tagged):
        for variant, keys in here.variants.items():
            if len(keys) < len(of.variants[variant]):
                said += f", of {variant} only {', '.join(it.name for it in keys)}"
    return said


def _table(found: Iterator[tuple[str, tuple[str, ...]]]) -> str:
    """Write rows; those that several kinds of a thing share are one."""
    kinds: dict[tuple[str, ...], list[str]] = {}
    for variant, cells in found:
        kinds.setdefault(cells, []).append(variant)
    return HEAD + "".join(
        f"| {path} | {', '.join(filter(None, only))} | {' | '.join(rest)} |\n"
        for (path, *rest), only in kinds.items()
    )


def _cells(row: Row, more: str = "") -> tuple[str, ...]:
    key = row.key
    default = "**required**" if key.default is None else key.default
    allowed = getattr(key.kind, "words", "") or key.kind.allowed
    return f"`{row.path}`", key.unit, allowed + more, default, key.meaning


MARK = re.compile(r"^<!-- keys of (\w+) -->$", re.MULTILINE)
"""Where a page has a table."""


def insert(page: str) -> str:
    """Put the tables of commands and objects at their marks in a page."""

    def table(match: re.Match[str]) -> str:
        name = match[1]
        return markdown(COMMANDS[name]) if name in COMMANDS else of_object(name)

    return MARK.sub(table, page)


def keys(*names: str) -> str:
    """Give the tables of kinds of files, and of the objects that they hold."""
    tables = [f"# {name}\n\n{markdown(COMMANDS[name])}" for name in names]
    for name in OBJECTS:
        if any(f"(#{name})" in table for table in tables):
            tables.append(f"# {name}\n\n{of_object(name)}")
    return "\n".join(tables)
