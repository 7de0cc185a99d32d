"""The tables of the page."""

import functools
from pathlib import Path

from . import classics, differ, siconos, woodpecker
from .rows import Row

PAGE = Path(__file__).parents[2] / "benchmarks" / "results" / "validation.md"
HEADS = {
    "agree": ("source", "quantity", "published", "here", "difference, at most"),
    "differ": ("source", "quantity", "there", "here", "difference, at most"),
}


@functools.cache
def rows(name: str) -> tuple[Row, ...]:
    """Compute the rows of a table."""
    if name == "differ":
        return tuple(differ.rows())
    return (*siconos.rows(), *woodpecker.rows(), *classics.rows())


def markers(name: str) -> tuple[str, str]:
    """Give what stands around a table."""
    return f"<!-- {name}: python -m validation --write -->\n", f"<!-- end {name} -->"


def render(name: str) -> str:
    """Write a table: differences as the bounds that the tests hold."""
    body = [
        (row.source, row.quantity, row.published, row.ours, f"{row.within:.0e}")
        for row in rows(name)
    ]
    lines = [HEADS[name], ("---",) * len(HEADS[name]), *body]
    return "\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines) + "\n"


def split(page: str, name: str) -> tuple[str, str, str]:
    """Cut a page at a table: before, table, after."""
    first, last = markers(name)
    head, rest = page.split(first)
    table, tail = rest.split(last)
    return head + first, table, last + tail


def write() -> None:
    """Write both tables into the page."""
    page = PAGE.read_text()
    for name in HEADS:
        head, _, tail = split(page, name)
        page = head + render(name) + tail
    PAGE.write_text(page)
