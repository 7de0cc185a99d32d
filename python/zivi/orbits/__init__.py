"""Periodic orbits of systems with impacts: their stability, their branches, what they attract."""

from zivi.base.former import of_zivi
from zivi.orbits.attractor import Attractor
from zivi.orbits.basins import Basins, basins
from zivi.orbits.branch import Branch, BranchEvent
from zivi.orbits.diagram import Diagram, bifurcation_diagram
from zivi.orbits.find import periodic_orbit
from zivi.orbits.follow import continue_orbit
from zivi.orbits.lyapunov import Lyapunov, lyapunov_exponents
from zivi.orbits.mechanical.branch import MechanicalBranch, MechanicalEvent
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.mechanical.response import grazing_curve, response_amplitude
from zivi.orbits.mechanical.two_parameters import CodimensionTwo, EventCurve, continue_curve
from zivi.orbits.orbit import PeriodicOrbit

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
