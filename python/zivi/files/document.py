"""Lists all keys of a file for its page: ``python -m zivi.files.document PAGE`` writes them in."""

from __future__ import annotations

import sys
from pathlib import Path

from zivi.files.keys import CONTROL, SIMULATE, SWEEP
from zivi.files.mechanical_keys import MECHANICS
from zivi.files.tables import Key, rows

__all__ = ["COMMANDS", "insert", "markdown"]

COMMANDS = {"simulate": SIMULATE, "mechanics": MECHANICS, "control": CONTROL, "sweep": SWEEP}
HEAD = "| key | only for | unit | allowed | default | meaning |\n|---|---|---|---|---|---|\n"


def markdown(keys: tuple[Key, ...]) -> str:
    """Give a table of keys; those that several kinds of a thing share are one row."""
    kinds: dict[tuple[str, ...], list[str]] = {}
    for row in rows(keys):
        kinds.setdefault(_cells(row.path, row.key), []).append(row.variant)
    lines = (
        f"| {path} | {', '.join(filter(None, only))} | {' | '.join(rest)} |\n"
        for (path, *rest), only in kinds.items()
    )
    return HEAD + "".join(lines)


def _cells(path: str, key: Key) -> tuple[str, ...]:
    default = "**required**" if key.default is None else key.default
    allowed = getattr(key.kind, "words", "") or key.kind.allowed
    return f"`{path}`", key.unit, allowed, default, key.meaning


def insert(page: str) -> str:
    """Put the tables of all commands between their marks in a page."""
    for command, keys in COMMANDS.items():
        start, end = f"<!-- keys of {command} -->\n", f"<!-- end of {command} -->"
        if page.count(start) != 1 or page.count(end) != 1:
            raise ValueError(f"the page must have one place for the keys of {command}")
        before, _, rest = page.partition(start)
        page = before + start + markdown(keys) + end + rest.partition(end)[2]
    return page


if __name__ == "__main__":
    file = Path(sys.argv[1])
    file.write_text(insert(file.read_text("utf-8")), "utf-8")
