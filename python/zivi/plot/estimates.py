"""Plots of fits: data, predictions, residuals, profiles of the likelihood."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from zivi.plot.look import BLUE, ORANGE, axes_of, figure_of, legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_fit(rows: Sequence[Mapping[str, Any]], figure: Figure | None) -> Figure:
    """Draw data, predictions and residuals of each data set in a column of two axes."""
    figure = figure_of(figure, max(6.4, 4.2 * len(rows)), 4.8)
    axes = figure.subplots(2, len(rows), squeeze=False, height_ratios=(3, 1), sharex="col")
    for (top, bottom), row in zip(axes.T, rows, strict=True):
        if row["bounces"]:
            _draw_bounces(top, row)
        else:
            top.plot(row["t"], row["measured"], ".", ms=4, color="0.6", label="data")
            top.plot(row["t"], row["predicted"], color=BLUE, lw=1.2, label="fit")
            top.set_ylabel(row["label"])
        bottom.axhline(0.0, color="0.7", lw=0.8)
        bottom.plot(row["t"], row["residual"], ".", ms=4, color=ORANGE)
        bottom.set(xlabel="t (s)", ylabel="residual / $\\sigma$")
        legend(top)
    return figure


def _draw_bounces(ax: Axes, row: Mapping[str, Any]) -> None:
    """Draw the intervals between bounces; spurious times as crosses at the bottom."""
    known = np.isfinite(row["predicted"])
    times, predicted = row["measured"][known], row["predicted"][known]
    ax.plot(times[1:], np.diff(times), "o", ms=5, color="0.6", label="data")
    ax.plot(times[1:], np.diff(predicted), "_", ms=12, color=BLUE, label="fit")
    alone = row["measured"][~known]
    if len(alone):
        ax.plot(alone, np.zeros(len(alone)), "x", color=ORANGE, label="spurious")
    ax.set_ylabel("interval (s)")


def draw_profile(profile: Any, ax: Axes | None) -> Axes:
    """Draw the root of the rise of the sum of squares along a parameter."""
    ax = axes_of(ax)
    ax.plot(profile.values, np.sqrt(np.maximum(profile.delta, 0.0)), ".-", color=BLUE)
    for end in profile.interval(0.95):
        ax.axvline(end, color="0.7", lw=0.8)
    ax.set(xlabel=profile.name, ylabel=r"$\sqrt{\Delta\chi^2}$")
    return ax
