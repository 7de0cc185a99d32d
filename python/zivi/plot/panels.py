"""Several plots of one run in a figure."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, cast

import numpy as np

from zivi.plot.curves import control, lifted, phase_plane, position, signs, velocity
from zivi.plot.look import figure_of
from zivi.plot.mechanics import (
    Units,
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
    from matplotlib.gridspec import SubplotSpec

    from zivi.control.closed_loop import ClosedLoop
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
    from zivi.simulation.trajectory import Trajectory


def overview(
    run: Trajectory | ClosedLoop | MechanicalTrajectory,
    figure: Figure | None = None,
    *,
    units: Units = None,
) -> Figure:
    """Plot a run as a whole.

    A trajectory: position, velocity and transformed state over time, and the physical phase
    plane. A closed loop: position, velocity, control and signs over time; the phase plane instead
    of signs that the controller does not have. A mechanical system: coordinates, gaps and
    reactions over time, and its configuration, of a closed loop its controls; with dry friction
    what sticks and slips instead of the reactions. What would be empty, as the reactions of a
    system that never rests on anything, is left out.

    Parameters
    ----------
    run : Trajectory, ClosedLoop or MechanicalTrajectory
        The run.
    figure : matplotlib.figure.Figure, optional
        Where to draw; a new figure by default.
    units : str or dict, optional
        Of a mechanical system the unit of all coordinates and gaps, or units by name.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> len(zivi.plot.overview(zivi.simulate(ball, (0, 3), (1, 0))).axes)
    4
    """
    if is_mechanical(run):
        drawings = _of_mechanical(cast("MechanicalTrajectory", run), units)
    else:
        check_run("overview", run)
        plane = partial(phase_plane, coordinates="physical")
        drawings = [position, velocity, lifted, plane]
        if hasattr(run, "u"):
            signed = not np.all(np.isnan(cast("ClosedLoop", run).signs))
            drawings[2:] = [control, signs if signed else plane]
    figure = figure_of(figure, 9.0, 6.0)
    first = None
    for place, draw in zip(_places(figure, len(drawings)), drawings, strict=True):
        over_time = getattr(draw, "func", draw) not in PLANES
        ax = figure.add_subplot(place, sharex=first if over_time else None)
        first = first or ax
        draw(run, ax=ax)
    return figure


def _of_mechanical(run: MechanicalTrajectory, units: Units) -> list[Callable[..., Axes]]:
    """Choose what is not empty."""
    drawings: list[Callable[..., Axes]] = [partial(coordinates, units=units)]
    drawings += [partial(gaps, units=units)] if run.gap_names else []
    if run.channel_names:
        drawings += [modes] if run.gap_names else [slips, modes]
    elif run.contacts.any():
        drawings += [partial(reactions, units=units)]
    plane = partial(configuration, units=units)
    return [*drawings, control if hasattr(run, "control_names") else plane]


PLANES = (phase_plane, configuration)
"""What is not drawn over time."""


def _places(figure: Figure, number: int) -> list[SubplotSpec]:
    """Divide a figure: two rows and columns, of three places the last one high."""
    if number == 2:
        row = figure.add_gridspec(1, 2)
        return [row[0, 0], row[0, 1]]
    grid = figure.add_gridspec(2, 2)
    if number == 3:
        return [grid[0, 0], grid[1, 0], grid[:, 1]]
    return [grid[0, 0], grid[0, 1], grid[1, 0], grid[1, 1]]
