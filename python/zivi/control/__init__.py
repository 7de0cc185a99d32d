"""Controllers, their gains, the observer, closed loops."""

from zivi.base.former import of_zivi
from zivi.control.closed_loop import Controller, simulate_closed_loop, tracker_gains
from zivi.control.design import (
    GainDesign,
    InfeasibleError,
    best_ratio,
    design_regulator,
    design_tracker,
)
from zivi.control.gap_tracker import GapTracker, Striker
from zivi.control.loop_batch import MechanicalLoopBatch, simulate_closed_loop_batch
from zivi.control.loop_run import ClosedLoop, ClosedLoopBatch
from zivi.control.mechanical_loop import (
    MechanicalClosedLoop,
    MechanicalController,
    RKPeriod,
)
from zivi.control.mechanical_reference import ReferenceSample, reference_run
from zivi.control.model_based import JointObserver
from zivi.control.observer import ImpactObserver, Observed
from zivi.control.twisting import *  # noqa: F403
from zivi.control.twisting import __all__ as _twisting

__all__ = [
    "ClosedLoop",
    "ClosedLoopBatch",
    "Controller",
    "GainDesign",
    "GapTracker",
    "ImpactObserver",
    "InfeasibleError",
    "JointObserver",
    "MechanicalClosedLoop",
    "MechanicalController",
    "MechanicalLoopBatch",
    "Observed",
    "RKPeriod",
    "ReferenceSample",
    "Striker",
    "best_ratio",
    "design_regulator",
    "design_tracker",
    "reference_run",
    "simulate_closed_loop",
    "simulate_closed_loop_batch",
    "tracker_gains",
]
__all__ += _twisting

of_zivi(globals())
