"""One number: what zivi computes, what the paper prints, what is exact, and whether it agrees."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Iterable
from pathlib import Path

from rich.table import Table

from zivi.paper import report

__all__ = ["Check", "save", "table"]


@dataclasses.dataclass(frozen=True)
class Check:
    """A number with the value that it is held against.

    Parameters
    ----------
    what : str
        The quantity, with its unit.
    computed : float
        What this installation computes.
    expected : float
        What it is held against.
    source : {"exact", "scheme", "bound", "paper"}
        A closed form of the motion, or what an independent implementation of the same scheme
        gives at the same step size, or a bound that holds where nothing is exact, or what the
        paper prints.
    tolerance : float
        Largest accepted ``|computed - expected|``.
    paper : str
        What the paper prints, if anything.
    """

    what: str
    computed: float
    expected: float
    source: str
    tolerance: float
    paper: str = ""

    @property
    def ok(self) -> bool:
        """Whether the number agrees (a NaN never does)."""
        return abs(self.computed - self.expected) <= self.tolerance


COLUMNS = ("quantity", "zivi", "expected", "within", "source", "paper", "ok")
CAPTION = (
    "exact: closed form; scheme: another implementation of the same scheme and step; "
    "bound: what must not be exceeded; paper: as printed there"
)


def _cells(check: Check) -> tuple[str, ...]:
    return (
        check.what,
        f"{check.computed:.6g}",
        f"{check.expected:.6g}",
        f"{check.tolerance:.1g}",
        check.source,
        check.paper,
        "yes" if check.ok else "NO",
    )


def table(checks: Iterable[Check]) -> Table:
    """Lay the checks out for a terminal."""
    shown = [column for column in COLUMNS if column != "paper"]
    result = report.empty("Checked numbers", CAPTION)
    for column in shown:
        result.add_column(column, no_wrap=True)
    for check in checks:
        cells = dict(zip(COLUMNS, _cells(check), strict=True))
        result.add_row(*(cells[it] for it in shown), style="" if check.ok else "bold red")
    return result


def save(checks: Iterable[Check], path: Path) -> None:
    """Write the checks as CSV."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS)
        rows.writerows(_cells(check) for check in checks)
