"""One run, many runs and their results, of a mass and of a mechanical system."""

from zivi.base.former import of_zivi
from zivi.simulation.batch import MechanicalBatch, simulate_batch
from zivi.simulation.batch_result import Batch
from zivi.simulation.events import Level, event
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.method_settings import Method
from zivi.simulation.methods import ExplicitEuler, MoreauJean, SwitchedRK, ThetaGamma
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory

__all__ = [
    "Batch",
    "ExplicitEuler",
    "Level",
    "MechanicalBatch",
    "MechanicalTrajectory",
    "Method",
    "MoreauJean",
    "SwitchedRK",
    "ThetaGamma",
    "Trajectory",
    "event",
    "simulate",
    "simulate_batch",
]

of_zivi(globals())
