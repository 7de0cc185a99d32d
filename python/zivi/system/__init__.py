"""What moves: one mass or a mechanism, its forces, its wall or its gaps."""

from zivi.base.former import of_zivi
from zivi.system.friction import DryFriction
from zivi.system.gap import Gap, LinearGap
from zivi.system.impact_law import ImpactLaw, NewtonImpact, SpeedDependentImpact
from zivi.system.linear import LinearSystem
from zivi.system.loads import Harmonic
from zivi.system.mass import Force, ImpactSystem, LinearForce
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parametric import ParametricForce
from zivi.system.parametric_mechanism import ParametricSystem
from zivi.system.table import Table
from zivi.system.transform import lift, project
from zivi.system.tree.system import Tree
from zivi.system.wall import HarmonicWall, MovingWall

__all__ = [
    "DryFriction",
    "Force",
    "Gap",
    "Harmonic",
    "HarmonicWall",
    "ImpactLaw",
    "ImpactSystem",
    "LinearForce",
    "LinearGap",
    "LinearSystem",
    "MechanicalSystem",
    "MovingWall",
    "NewtonImpact",
    "ParametricForce",
    "ParametricSystem",
    "SpeedDependentImpact",
    "Table",
    "Tree",
    "lift",
    "project",
]

of_zivi(globals())
