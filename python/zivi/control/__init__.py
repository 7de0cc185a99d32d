"""Controllers, their gains, the observer, closed loops."""

from zivi.base.former import of_zivi
from zivi.control.closed_loop import ClosedLoop, Controller, simulate_closed_loop
from zivi.control.design import (
    GainDesign,
    InfeasibleError,
    best_ratio,
    design_regulator,
    design_tracker,
)
from zivi.control.experiments import tracker_gains
from zivi.control.gap_tracker import GapTracker
from zivi.control.joint_observer import JointObserver
from zivi.control.loop_batch import ClosedLoopBatch, simulate_closed_loop_batch
from zivi.control.mechanical_loop import MechanicalController, RKPeriod
from zivi.control.mechanical_loop_batch import MechanicalLoopBatch
from zivi.control.mechanical_loop_run import MechanicalClosedLoop
from zivi.control.mechanical_reference import ReferenceSample
from zivi.control.observer import ImpactObserver, Observed
from zivi.control.reference_run import reference_run
from zivi.control.striker import Striker
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
