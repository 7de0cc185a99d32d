"""Axes, colours and frames of all plots; checks of the runs to plot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeGuard

import numpy as np

from zivi.base.extras import needed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from zivi.base.check import Array
    from zivi.control.loop_run import ClosedLoop
    from zivi.simulation.trajectory import Trajectory

# Common parts of all plots: axes, colours, and the frame of a run.

# Okabe and Ito's palette: distinguishable for colour-blind readers and in grey
BLUE, ORANGE, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
PALETTE = (BLUE, ORANGE, GREEN, PURPLE, "#E69F00", "#56B4E9", "black")
WALL = "0.5"
"""The colour of a wall."""

Frame: TypeAlias = Literal["wall", "fixed"]


def axes_of(ax: Axes | None) -> Axes:
    """Return the axes to draw into: those given, or those of a new figure."""
    if ax is not None:
        return _check_axes(ax)
    plt = needed("matplotlib.pyplot", "plots")
    axes: Axes = plt.subplots(layout="constrained")[1]
    return axes


def _check_axes(ax: Axes) -> Axes:
    """Reject objects other than Matplotlib axes; the message says how to get axes from them."""
    if hasattr(ax, "plot") and hasattr(ax, "set_xlabel"):
        return ax
    given: Any = ax
    if hasattr(ax, "gca"):  # a figure, or pyplot
        advice = f"; write ax={'figure' if hasattr(ax, 'add_subplot') else 'plt'}.gca()"
    elif isinstance(given, np.ndarray | list):
        advice = "; write one of them, ax=axes[0]"
    elif isinstance(given, tuple):
        advice = "; write ax=ax after figure, ax = plt.subplots()"
    elif isinstance(given, str):
        advice = "; settings of the line have names, color='r', ls='--'"
    else:
        advice = ""
    array = isinstance(given, np.ndarray)
    got = f"an array of shape {given.shape}" if array else f"{given!r:.60}"
    raise TypeError(f"ax must be a matplotlib.axes.Axes, got {got}{advice}")


def figure_of(figure: Figure | None, width: float, height: float) -> Figure:
    """Return the figure to draw into: the one given, or a new one of a size (inches)."""
    if figure is not None:
        if not hasattr(figure, "add_gridspec"):
            axes = "; one plot into given axes is zivi.plot.position(sol, ax)"
            advice = axes if hasattr(figure, "figure") else ""
            raise TypeError(
                f"figure must be a matplotlib.figure.Figure, got {figure!r:.60}{advice}"
            )
        return figure
    made: Figure = needed("matplotlib.pyplot", "plots").figure(
        figsize=(width, height), layout="constrained"
    )
    return made


def next_colour(ax: Axes, first: str) -> str:
    """Return the first colour from `first` on that no line in the axes has."""
    start = PALETTE.index(first)
    order = PALETTE[start:] + PALETTE[:start]
    used = [line.get_color() for line in ax.lines]
    return next((colour for colour in order if colour not in used), order[len(used) % len(order)])


def legend(ax: Axes, **settings: Any) -> None:
    """Place the legend outside the axes if the layout has room, else inside."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine, TightLayoutEngine

    placed: dict[str, Any] = {"loc": "best"}
    makes_room = ConstrainedLayoutEngine, TightLayoutEngine
    if isinstance(ax.figure.get_layout_engine(), makes_room):
        placed = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.2}
        placed |= {"frameon": False, "handlelength": 1.5}
    ax.legend(**{"fontsize": "small"} | placed | settings)


def in_frame(
    run: Trajectory | ClosedLoop, frame: Frame, t: Array, x: Array, xdot: Array
) -> tuple[Array, Array]:
    """Transform points from the wall's frame to a given frame."""
    if frame not in ("wall", "fixed"):
        raise ValueError(f"frame must be 'wall' or 'fixed', got {frame!r}")
    wall = wall_of(run)
    if frame == "wall" or wall is None:
        return x, xdot
    w, wdot, _ = wall(t)
    return x + w, xdot + wdot


def wall_of(run: Trajectory | ClosedLoop) -> Any:
    """Return the wall that moves, if one does."""
    return getattr(run, "_wall", None)


def axis_labels(run: Trajectory | ClosedLoop, frame: Frame) -> tuple[str, str]:
    """Return the frame of position and velocity, in words."""
    if wall_of(run) is None:
        return "position $x$ (m)", r"velocity $\dot x$ (m/s)"
    if frame == "fixed":
        return "position $x + w$, fixed frame (m)", r"velocity $\dot x + \dot w$, fixed frame (m/s)"
    return "distance from the wall $x$ (m)", r"velocity relative to the wall $\dot x$ (m/s)"


def has_reference(run: Trajectory | ClosedLoop) -> TypeGuard[ClosedLoop]:
    """Whether a run follows a reference."""
    reference = getattr(run, "x_ref", None)
    return reference is not None and not np.all(np.isnan(reference))


# Which runs a plot can draw; the error for another names the plot that can.

MOTION = ("t", "x", "xdot", "impacts")
"""What every run has."""

ADVICE = {
    "control": "a trajectory does not have a control; use zivi.simulate_closed_loop",
    "multipliers": "use zivi.plot.signs for the selections of a run",
}
"""What to do with a run of the other kind."""


def check_run(plot: str, run: Any, *, needs: str | None = None, of: str | None = None) -> None:
    """Raise a TypeError for a result that a plot cannot draw.

    Parameters
    ----------
    plot : str
        Name of the plot.
    run : object
        Its argument.
    needs : str, optional
        An attribute that it draws, which only one kind of run has.
    of : str, optional
        Name of this kind.
    """
    if not all(hasattr(run, name) for name in MOTION):
        kinds = "zivi.Trajectory or a zivi.ClosedLoop" if of is None else f"zivi.{of}"
        advice = _instead(run)
    elif needs is None or hasattr(run, needs):
        return
    else:
        kinds, advice = f"zivi.{of}", f": {ADVICE[plot]}"
    raise TypeError(f"zivi.plot.{plot} draws a {kinds}, got {type(run).__name__}{advice}")


def _instead(run: Any) -> str:
    if hasattr(run, "trajectory"):
        return ": draw its attribute trajectory"
    if hasattr(run, "gaps"):
        return ": of a mechanical system draw zivi.plot.gaps, reactions, coordinates, configuration"
    if hasattr(run, "n_impacts"):
        return ": a batch keeps no motion, simulate the run that is to be drawn by itself"
    if isinstance(run, list | tuple):
        return ": draw one run after the other into the same axes, ax="
    return ""
