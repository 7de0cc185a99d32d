"""Mechanical systems with several coordinates and gaps.

pieces, gap       what the user gives: arrays, functions, compiled functions
layout, assemble  one row of numbers, and the function that fills it
system            `MechanicalSystem`
start             what is checked before a run
"""

from zivi.mechanics.gap import Gap, LinearGap
from zivi.mechanics.layout import Evaluation
from zivi.mechanics.system import MechanicalSystem

__all__ = ["Evaluation", "Gap", "LinearGap", "MechanicalSystem"]
