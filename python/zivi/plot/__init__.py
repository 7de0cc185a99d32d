"""Plots of trajectories and closed loops.

Every function draws into ``ax`` (a new figure's axes by default), returns the axes, changes no
global setting and never calls ``show``. A line drawn into axes with other lines has the next colour
of the palette. Further keywords go to `matplotlib.axes.Axes.plot`.
"""

from typing import TYPE_CHECKING

from zivi.base.former import of_zivi
from zivi.base.habits import PLOT, module_error
from zivi.plot.animation import animate
from zivi.plot.curves import (
    control,
    impacts,
    lifted,
    multipliers,
    overview,
    phase_plane,
    poincare,
    position,
    signs,
    velocity,
)
from zivi.plot.drawing import BLUE, GREEN, ORANGE, PURPLE
from zivi.plot.mechanics import configuration, coordinates, gaps, modes, reactions, slips
from zivi.plot.orbits import basins, branch, chart, curve, diagram

map = chart

__all__ = [
    "BLUE",
    "GREEN",
    "ORANGE",
    "PURPLE",
    "animate",
    "basins",
    "branch",
    "chart",
    "configuration",
    "control",
    "coordinates",
    "curve",
    "diagram",
    "gaps",
    "impacts",
    "lifted",
    "map",
    "modes",
    "multipliers",
    "overview",
    "phase_plane",
    "poincare",
    "position",
    "reactions",
    "signs",
    "slips",
    "velocity",
]


if not TYPE_CHECKING:  # which would take any name for granted

    def __getattr__(name):
        raise module_error("zivi.plot", name, __all__, PLOT)


of_zivi(globals())
