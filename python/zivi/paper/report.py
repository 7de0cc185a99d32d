"""Tables, checked numbers and figures of the stages of the paper."""

from __future__ import annotations

import csv
import dataclasses
import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.table import Table

import zivi._zivi as _zivi
from zivi import plot
from zivi.base.check import Array
from zivi.control.loop_run import ClosedLoop
from zivi.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


# Tables of measured rows: on the terminal and as CSV.


def save_rows(rows: Iterable[Any], path: Path) -> None:
    """Write rows (all of one dataclass) as CSV, every number in full."""
    with path.open("w", newline="") as file:
        writer = None
        for row in map(dataclasses.asdict, rows):
            if writer is None:
                writer = csv.DictWriter(file, list(row))
                writer.writeheader()
            writer.writerow(row)


def empty(title: str, caption: str) -> Table:
    """Create a table in the common style, for 80 columns."""
    return Table(
        title=title,
        caption=caption,
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )


def terminal_table(
    title: str, caption: str, columns: Sequence[str], rows: Iterable[Sequence[object]]
) -> Table:
    """Format rows for a terminal, numbers with three digits."""
    result = empty(title, caption)
    for column in columns:
        result.add_column(column, no_wrap=True)
    for row in rows:
        result.add_row(*(f"{cell:.3g}" if isinstance(cell, float) else str(cell) for cell in row))
    return result


# One number: what zivi computes, what the paper prints, what is exact, and whether it agrees.


@dataclasses.dataclass(frozen=True)
class Check:
    """A number with its reference value.

    Parameters
    ----------
    what : str
        The quantity, with its unit.
    computed : float
        What this installation computes.
    expected : float
        What it is held against.
    source : {"exact", "scheme", "bound", "paper"}
        Source of the reference: a closed form of the motion; an independent implementation of the
        same scheme at the same step size; a bound; or the value printed in the paper.
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


def _check_cells(check: Check) -> tuple[str, ...]:
    return (
        check.what,
        f"{check.computed:.6g}",
        f"{check.expected:.6g}",
        f"{check.tolerance:.1g}",
        check.source,
        check.paper,
        "yes" if check.ok else "NO",
    )


def checks_table(checks: Iterable[Check]) -> Table:
    """Format the checks for a terminal."""
    shown = [column for column in COLUMNS if column != "paper"]
    result = empty("Checked numbers", CAPTION)
    for column in shown:
        result.add_column(column, no_wrap=True)
    for check in checks:
        cells = dict(zip(COLUMNS, _check_cells(check), strict=True))
        result.add_row(*(cells[it] for it in shown), style="" if check.ok else "bold red")
    return result


def save_checks(checks: Iterable[Check], path: Path) -> None:
    """Write the checks as CSV."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS)
        rows.writerows(_check_cells(check) for check in checks)


# A figure with its settings and data.

UNITS = {
    "h": "s",
    "g": "m/s^2",
    "F": "m/s^2",
    "F_ref": "m/s^2",
    "mu1": "m/s^2",
    "mu2": "m/s^2",
    "x(0)": "m",
    "x'(0)": "m/s",
    "x_ref(0)": "m",
    "x_ref'(0)": "m/s",
}
"""Of the settings that have one."""

CHARACTERS = 16.5
"""Letters of a caption to the inch."""
NO_BREAK = "\u00a0"


@dataclasses.dataclass(frozen=True)
class PaperFigure:
    """A figure with its settings.

    Parameters
    ----------
    name : str
        Name of the files.
    title : str
        What is drawn.
    settings : mapping
        Its settings by name: numbers (units in `UNITS`) and text.
    figure : matplotlib.figure.Figure
        The drawing.
    data : mapping
        A table for each CSV file; the keys follow `name` in the file's name.
    remark : str
        A sentence below the figure.
    """

    name: str
    title: str
    settings: Mapping[str, float | str]
    figure: Figure
    data: Mapping[str, pd.DataFrame]
    remark: str = ""

    @property
    def stated(self) -> dict[str, str]:
        """The settings as text, with their units."""
        return {name: _setting_text(name, value) for name, value in self.settings.items()}

    @property
    def caption(self) -> str:
        """The line below the figure."""
        return self._caption(" ")

    def _caption(self, space: str) -> str:
        stated = (f"{name} = {text}".replace(" ", space) for name, text in self.stated.items())
        return f"{self.title}. {', '.join(stated)}." + f" {self.remark}".rstrip()

    def save(self, folder: Path) -> None:
        """Write the PNG and the CSV files, settings in the metadata and in ``#`` lines."""
        import matplotlib.pyplot as plt

        width = int(CHARACTERS * self.figure.get_size_inches()[0])
        caption = textwrap.fill(self._caption(NO_BREAK), width)
        self.figure.supxlabel(caption, x=0.01, ha="left", fontsize="small", color="0.25")
        about = {
            "Title": self.title,
            "Description": self.caption,
            "Software": f"zivi {_zivi.__version__}",
        }
        self.figure.savefig(folder / f"{self.name}.png", dpi=200, metadata=about | self.stated)
        plt.close(self.figure)
        lines = [self.title, *(f"{name} = {text}" for name, text in self.stated.items())]
        for suffix, table in self.data.items():
            path = folder / (f"{self.name}_{suffix}.csv" if suffix else f"{self.name}.csv")
            with path.open("w", newline="") as file:
                file.writelines(f"# {line}\n" for line in lines)
                table.to_csv(file)


def _setting_text(name: str, value: float | str) -> str:
    if isinstance(value, str):
        return value
    return f"{value:g} {UNITS.get(name, '')}".rstrip()


def run_data(sol: Trajectory, quantities: list[str]) -> pd.DataFrame:
    """Return samples of a run."""
    return sol.to_xarray()[quantities].to_dataframe()


def loop_data(run: ClosedLoop, *quantities: str) -> pd.DataFrame:
    """Return samples of a loop, of all quantities by default; a reference it lacks is left out."""
    data = run.to_xarray()
    sampled = data[["x", "xdot", "x_ref", "xdot_ref", "u"]].merge(data["signs"].to_dataset("sign"))
    table = sampled.to_dataframe().dropna(axis="columns", how="all")
    return table[list(quantities)] if quantities else table


def draw_sv_plane(s: Array, v: Array, near: tuple[float, float]) -> Figure:
    """Draw a run that comes to rest in the (s, v) plane, with an enlargement `near` rest."""
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(layout="constrained", figsize=(6.4, 4.6))
    enlarged = ax.inset_axes((0.31, 0.42, 0.32, 0.33))
    for axes in (ax, enlarged):
        axes.plot(s, v, color=plot.BLUE)
        axes.plot(0, 0, "s", color=plot.ORANGE, label="rest")
    ax.plot(s[:1], v[:1], "o", color=plot.GREEN, label="start")
    ax.set(xlabel="transformed position $s$ (m)", ylabel="transformed velocity $v$ (m/s)")
    ax.legend(loc="lower right")
    (of_s, of_v) = near
    enlarged.set(xlim=(-of_s, of_s), ylim=(-of_v, of_v))
    enlarged.locator_params(nbins=4)
    enlarged.tick_params(labelsize="small")
    enlarged.set_title("enlarged", fontsize="small")
    return figure


# Numbers of runs that tables and checks have.


def rest_time_of(run: Trajectory | ClosedLoop) -> float:
    """Return the time from which the mass stays at rest (s), NaN if it does not."""
    return math.nan if run.rest_time is None else run.rest_time


def max_abs(values: Array) -> float:
    """Return the largest magnitude; NaN for an empty selection, which must not pass for zero."""
    return float(np.max(np.abs(values))) if values.size else math.nan


def farthest_from(values: Array, center: float) -> float:
    """Return the value with the largest distance from `center`."""
    return float(values[np.argmax(np.abs(values - center))])
