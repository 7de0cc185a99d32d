"""Tables of measured rows: on the terminal and as CSV."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

__all__ = ["empty", "save", "table"]


def save(rows: Iterable[Any], path: Path) -> None:
    """Write rows (all of one dataclass) as CSV, every number in full."""
    with path.open("w", newline="") as file:
        writer = None
        for row in map(dataclasses.asdict, rows):
            if writer is None:
                writer = csv.DictWriter(file, list(row))
                writer.writeheader()
            writer.writerow(row)


def empty(title: str, caption: str) -> Table:
    """Begin a table in the look of all of them, for 80 columns."""
    return Table(
        title=title,
        caption=caption,
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )


def table(
    title: str, caption: str, columns: Sequence[str], rows: Iterable[Sequence[object]]
) -> Table:
    """Lay rows out for a terminal: text as it is, numbers with three digits."""
    result = empty(title, caption)
    for column in columns:
        result.add_column(column, no_wrap=True)
    for row in rows:
        result.add_row(*(f"{cell:.3g}" if isinstance(cell, float) else str(cell) for cell in row))
    return result
