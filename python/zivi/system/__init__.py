"""Mechanical systems: one mass or a mechanism, its forces, its wall or its gaps."""

from zivi.base.former import of_zivi
from zivi.system.gap import (
    DryFriction,
    Gap,
    HarmonicWall,
    Hertz,
    HuntCrossley,
    LinearGap,
    MovingWall,
    SpringDamper,
)
from zivi.system.impact_law import (
    ImpactLaw,
    NewtonImpact,
    Restitution,
    RestitutionTable,
    SpeedDependentImpact,
)
from zivi.system.kicks import Kick
from zivi.system.linear import Harmonic, LinearSystem
from zivi.system.mass import Force, ImpactSystem, LinearForce, ParametricForce, lift, project
from zivi.system.mechanism import MechanicalSystem
from zivi.system.model_parts import Equality
from zivi.system.parameters import ParametricSystem
from zivi.system.start import consistent
from zivi.system.table import Pulse, Square, Table
from zivi.system.tree import Tree

__all__ = [
    "DryFriction",
    "Equality",
    "Force",
    "Gap",
    "Harmonic",
    "HarmonicWall",
    "Hertz",
    "HuntCrossley",
    "ImpactLaw",
    "ImpactSystem",
    "Kick",
    "LinearForce",
    "LinearGap",
    "LinearSystem",
    "MechanicalSystem",
    "MovingWall",
    "NewtonImpact",
    "ParametricForce",
    "ParametricSystem",
    "Pulse",
    "Restitution",
    "RestitutionTable",
    "SpeedDependentImpact",
    "SpringDamper",
    "Square",
    "Table",
    "Tree",
    "consistent",
    "lift",
    "project",
]

of_zivi(globals())
