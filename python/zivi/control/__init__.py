"""Controllers, their gains, the observer, closed loops."""

from zivi.control.closed_loop import ClosedLoop, Controller, simulate_closed_loop
from zivi.control.design import GainDesign, design_regulator, design_tracker
from zivi.control.experiments import tracker_gains
from zivi.control.loop_batch import ClosedLoopBatch, simulate_closed_loop_batch
from zivi.control.observer import ImpactObserver, Observed
from zivi.control.twisting import ExplicitTwisting, TickStatus, TwistingRegulator, TwistingTracker

__all__ = [
    "ClosedLoop",
    "ClosedLoopBatch",
    "Controller",
    "ExplicitTwisting",
    "GainDesign",
    "ImpactObserver",
    "Observed",
    "TickStatus",
    "TwistingRegulator",
    "TwistingTracker",
    "design_regulator",
    "design_tracker",
    "simulate_closed_loop",
    "simulate_closed_loop_batch",
    "tracker_gains",
]
