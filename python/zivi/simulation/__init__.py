"""One run, many runs and their results, of a mass and of a mechanical system."""

from zivi.simulation.batch import Batch, simulate_batch
from zivi.simulation.mechanical_batch import MechanicalBatch
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory

__all__ = [
    "Batch",
    "MechanicalBatch",
    "MechanicalTrajectory",
    "Trajectory",
    "simulate",
    "simulate_batch",
]
