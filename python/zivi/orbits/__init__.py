"""Periodic orbits of systems with impacts: their stability, their branches, what they attract."""

from zivi.orbits.attractor import Attractor
from zivi.orbits.basins import Basins, basins
from zivi.orbits.branch import Branch, BranchEvent
from zivi.orbits.diagram import Diagram, bifurcation_diagram
from zivi.orbits.find import periodic_orbit
from zivi.orbits.follow import continue_orbit
from zivi.orbits.lyapunov import Lyapunov, lyapunov_exponents
from zivi.orbits.mechanical.branch import MechanicalBranch, MechanicalEvent
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.orbit import PeriodicOrbit

__all__ = [
    "Attractor",
    "Basins",
    "Branch",
    "BranchEvent",
    "Diagram",
    "Lyapunov",
    "MechanicalBranch",
    "MechanicalEvent",
    "MechanicalOrbit",
    "PeriodicOrbit",
    "basins",
    "bifurcation_diagram",
    "continue_orbit",
    "lyapunov_exponents",
    "periodic_orbit",
]
