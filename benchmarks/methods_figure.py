"""The figure of work and precision."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from methods_counts import EULER, MOREAU, RK5, RK8, SCIPY
from methods_report import Figures, at_setting
from methods_times import COMPILED, PYTHON
from zivi.plot import BLUE, GREEN, PURPLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = {"T3": "table that vibrates with 3 g", "O4": "oscillator, one impact a period"}
"""One problem with Zeno points, one without."""
STYLES = {
    RK8: (BLUE, "o"),
    RK5: (PURPLE, "D"),
    SCIPY: ("black", "s"),
    EULER: (GREEN, "^"),
    MOREAU: ("#E69F00", "v"),
}
LEAST = 1e-14
"""Errors are rounding below this."""


def _plot(ax: Axes, name: str, work: Sequence[float], error: Sequence[float], **line: Any) -> None:
    colour, marker = STYLES[name]
    style = {"color": colour, "marker": marker, "ms": 4.5, "lw": 1.3, "mfc": colour, "label": name}
    ax.loglog(work, [max(it, LEAST) for it in error], **style | line)


def _evaluations(ax: Axes, figures: Figures, key: str) -> None:
    for name, runs in figures.runs[key].items():
        # every second tolerance: whole decades
        shown = runs[::2] if name in (RK8, RK5, SCIPY) else runs
        _plot(ax, name, [run.nfev for run in shown], [run.error for run in shown])


def _times(ax: Axes, figures: Figures, key: str) -> None:
    times, runs = figures.times[key], figures.runs[key]
    for name in (RK8, RK5, SCIPY):
        errors = [at_setting(runs[name], it.tol).error for it in times]
        python = [1e3 * it.seconds[name, PYTHON] for it in times]
        _plot(ax, name, python, errors, ls="--", mfc="white")
        if name != SCIPY:
            compiled = [1e3 * it.seconds[name, COMPILED] for it in times]
            _plot(ax, name, compiled, errors)
    for name, seconds in figures.fixed_times[key].items():
        _plot(ax, name, [1e3 * took for took in seconds], [run.error for run in runs[name]])


def draw(figures: Figures, path: Path) -> None:
    """Draw error over evaluations and over time, for one problem of each kind."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D

    figure, panels = plt.subplots(2, 2, figsize=(9.6, 7.4), sharey="col")
    for column, (key, title) in enumerate(SHOWN.items()):
        problem = figures.problems[key]
        top, bottom = panels[:, column]
        _evaluations(top, figures, key)
        _times(bottom, figures, key)
        kind = "Zeno points, rest and lift-off" if problem.zeno else "no Zeno point"
        top.set_title(f"{title}: {kind}", fontsize=11)
        top.set_xlabel("evaluations of the force")
        bottom.set_xlabel("processor time of a run (ms)")
    for ax in panels.flat:
        ax.grid(True, which="major", color="0.88", lw=0.6)
        ax.spines[["top", "right"]].set_visible(False)
        ax.minorticks_off()
    for ax in panels[:, 0]:
        ax.set_ylabel("error at the end (m, m/s)")
    figure.tight_layout(rect=(0.0, 0.075, 1.0, 1.0), h_pad=1.6, w_pad=2.0)
    handles, names = panels[0, 0].get_legend_handles_labels()
    solid = Line2D([], [], color="0.3", marker="o", ms=4.5, lw=1.3)
    hollow = Line2D([], [], color="0.3", marker="o", ms=4.5, lw=1.3, ls="--", mfc="white")
    style: dict[str, Any] = {
        "loc": "lower center",
        "frameon": False,
        "fontsize": 9,
        "columnspacing": 1.4,
    }
    figure.legend(handles, names, ncols=5, bbox_to_anchor=(0.5, 0.035), **style)
    kinds = ("compiled force", "force in Python")
    figure.legend((solid, hollow), kinds, ncols=2, bbox_to_anchor=(0.5, 0.005), **style)
    figure.savefig(path, dpi=130)
    plt.close(figure)
