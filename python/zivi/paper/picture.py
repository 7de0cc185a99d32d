"""A figure, the settings that made it, and the data behind it."""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import zivi._zivi as _zivi
from zivi import plot
from zivi.base.check import Array
from zivi.control.closed_loop import ClosedLoop
from zivi.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["Picture", "loop_data", "plane", "run_data"]

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
class Picture:
    """A drawing that says what it was made with.

    Parameters
    ----------
    name : str
        Name of the files.
    title : str
        What is drawn.
    settings : mapping
        What it was drawn with, by name: numbers (units in `UNITS`) and text.
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
        return {name: _text(name, value) for name, value in self.settings.items()}

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


def _text(name: str, value: float | str) -> str:
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


def plane(s: Array, v: Array, near: tuple[float, float]) -> Figure:
    """Draw a run that comes to rest in the (s, v) plane, and what is `near` rest enlarged."""
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
