"""How fast the impacts of a run are: a histogram."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from zivi.base.check import integer
from zivi.plot.look import BLUE, PALETTE, axes_of, legend
from zivi.plot.mechanics import is_mechanical
from zivi.plot.runs import check_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from zivi.control.closed_loop import ClosedLoop
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
    from zivi.simulation.trajectory import Trajectory

__all__ = ["impacts"]

DECADES = 100.0
"""From this ratio of the fastest to the slowest impact on the axis of speeds is logarithmic."""


def impacts(
    sol: Trajectory | ClosedLoop | MechanicalTrajectory,
    ax: Axes | None = None,
    *,
    bins: int = 20,
    **bars: Any,
) -> Axes:
    """Plot a histogram of the speeds before impacts, stacked by gap for a mechanical system.

    Parameters
    ----------
    sol : Trajectory, ClosedLoop or MechanicalTrajectory
        The run; its ``impacts`` are counted, those of extrapolated accumulations down to the part
        ``slowest`` of the fastest one.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    bins : int
        Number of intervals of the speed, >= 1: of equal length, or of equal ratio on a logarithmic
        axis if the fastest impact is more than 100 times as fast as the slowest.
    **bars
        Passed to `matplotlib.axes.Axes.hist`.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    TypeError
        If `sol` is not a run.
    ValueError
        If `bins` is not positive.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> ax = zivi.plot.impacts(zivi.simulate(ball, (0, 4), (1, 0)))
    >>> int(sum(bar.get_height() for bar in ax.patches)), ax.get_xlabel()
    (10, 'speed before the impact (m/s)')
    """
    mechanical = is_mechanical(sol)
    if not mechanical:
        check_run("impacts", sol, needs="impacts")
    if integer("bins", bins) < 1:
        raise ValueError(f"bins must be >= 1, got {bins}")
    ax = axes_of(ax)
    rows = sol.impacts
    speeds, gap = -np.asarray(rows["speed_before"]), np.asarray(rows["gap"])
    gap, speeds = gap[speeds > 0.0], speeds[speeds > 0.0]
    hit = np.unique(gap) if mechanical else np.zeros(1, int)
    if speeds.size:
        fast, slow = speeds.max(), speeds.min()
        if fast > DECADES * slow:
            ax.set_xscale("log")
            edges = np.geomspace(slow, fast, bins + 1)
        else:
            edges = np.histogram_bin_edges(speeds, bins)
        edges[0], edges[-1] = min(edges[0], slow), max(edges[-1], fast)
        settings: dict[str, Any] = {"stacked": True, "color": [BLUE]}
        if mechanical:
            names = cast("MechanicalTrajectory", sol).gap_names
            settings["label"] = [names[i] for i in hit]
            settings["color"] = [PALETTE[i % len(PALETTE)] for i in hit]
        ax.hist([speeds[gap == i] for i in hit], edges.tolist(), **settings | bars)
        if mechanical:
            legend(ax)
    else:
        ax.text(0.5, 0.5, "no impacts", ha="center", transform=ax.transAxes)
    ax.set(xlabel="speed before the impact (m/s)", ylabel="number of impacts")
    ax.locator_params(axis="y", integer=True)
    return ax
