"""Mechanical systems with several coordinates and gaps: names for `zivi.system` and its runs."""

from zivi.system.gap import Gap, LinearGap
from zivi.system.layout import Evaluation
from zivi.system.mechanism import MechanicalSystem

__all__ = ["Evaluation", "Gap", "LinearGap", "MechanicalSystem"]
