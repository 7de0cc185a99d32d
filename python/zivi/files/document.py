"""Lists all keys of a file for its page: ``python -m zivi.files.document PAGE`` writes them in.

Each command has a table, and so has each object that several commands or keys take: where one of
these is a value, the table of the command has a link in place of its keys.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from zivi.files.keys import CONTROL, LINEAR, RANGE, SIMULATE, SWEEP, WALL
from zivi.files.mechanical_keys import MECHANICS
from zivi.files.tables import Key, Row, Table, Tagged, rows
from zivi.files.tree_keys import TREE

__all__ = ["COMMANDS", "OBJECTS", "insert", "markdown"]

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


def insert(page: str) -> str:
    """Put the tables of all commands and objects between their marks in a page."""
    tables = {name: markdown(keys) for name, keys in COMMANDS.items()}
    tables |= {name: of_object(name) for name in OBJECTS}
    for name, table in tables.items():
        start, end = f"<!-- keys of {name} -->\n", f"<!-- end of {name} -->"
        if page.count(start) != 1 or page.count(end) != 1:
            raise ValueError(f"the page must have one place for the keys of {name}")
        before, _, rest = page.partition(start)
        page = before + start + table + end + rest.partition(end)[2]
    return page


if __name__ == "__main__":
    file = Path(sys.argv[1])
    file.write_text(insert(file.read_text("utf-8")), "utf-8")
