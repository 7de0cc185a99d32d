"""Periodic orbits of systems with impacts: their stability, their branches, what they attract."""

from zivi.base.former import of_zivi
from zivi.orbits.attractor import Attractor
from zivi.orbits.curve import CodimensionTwo, EventCurve, continue_curve
from zivi.orbits.diagram import Basins, Diagram, basins, bifurcation_diagram
from zivi.orbits.find import periodic_orbit
from zivi.orbits.follow import continue_orbit
from zivi.orbits.lyapunov import Lyapunov, grazing_curve, lyapunov_exponents, response_amplitude
from zivi.orbits.orbit import (
    Branch,
    BranchEvent,
    MechanicalBranch,
    MechanicalEvent,
    MechanicalOrbit,
    PeriodicOrbit,
)

__all__ = [
    "Attractor",
    "Basins",
    "Branch",
    "BranchEvent",
    "CodimensionTwo",
    "Diagram",
    "EventCurve",
    "Lyapunov",
    "MechanicalBranch",
    "MechanicalEvent",
    "MechanicalOrbit",
    "PeriodicOrbit",
    "basins",
    "bifurcation_diagram",
    "continue_curve",
    "continue_orbit",
    "grazing_curve",
    "lyapunov_exponents",
    "periodic_orbit",
    "response_amplitude",
]

of_zivi(globals())
