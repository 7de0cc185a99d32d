"""Several plots of one run in a figure."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from zivi.plot.curves import control, lifted, phase_plane, position, signs, velocity
from zivi.plot.look import figure_of
from zivi.plot.mechanics import (
    configuration,
    coordinates,
    gaps,
    is_mechanical,
    modes,
    reactions,
    slips,
)
from zivi.plot.runs import check_run

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from zivi.control.closed_loop import ClosedLoop
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
    from zivi.simulation.trajectory import Trajectory


def overview(
    run: Trajectory | ClosedLoop | MechanicalTrajectory, figure: Figure | None = None
) -> Figure:
    """Plot a run as a whole.

    A trajectory: position, velocity and transformed state over time, and the physical phase
    plane. A closed loop: position, velocity, control and signs over time. A mechanical system:
    coordinates, gaps and reactions over time, and its configuration; with dry friction what sticks
    and slips instead of the reactions.

    Parameters
    ----------
    run : Trajectory, ClosedLoop or MechanicalTrajectory
        The run.
    figure : matplotlib.figure.Figure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> len(zivi.plot.overview(zivi.simulate(ball, (0, 3), (1, 0))).axes)
    4
    """
    drawings: list[Callable[..., Axes]] = [coordinates, gaps, reactions, partial(configuration)]
    if not is_mechanical(run):
        check_run("overview", run)
        drawings = [position, velocity, lifted, partial(phase_plane, coordinates="physical")]
        if hasattr(run, "u"):
            drawings[2:] = [control, signs]
    elif getattr(run, "channel_names", ()):
        drawings[1:3] = [gaps if getattr(run, "gap_names", ()) else slips, modes]
    figure = figure_of(figure, 9.0, 6.0)
    first = None
    for number, draw in enumerate(drawings, start=1):
        over_time = not isinstance(draw, partial)
        ax = figure.add_subplot(2, 2, number, sharex=first if over_time else None)
        first = first or ax
        draw(run, ax=ax)
    return figure
