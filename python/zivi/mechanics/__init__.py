"""Mechanical systems with several coordinates and gaps.

pieces, gap       what the user gives: arrays, functions, compiled functions
layout, assemble  one row of numbers, and the function that fills it
system            `MechanicalSystem`
glue              compiled parts joined by a compiled function
start             what is checked before a run
run, trajectory   a run and its result; reactions, linear_motion, labelled: what it can do
parametric        a system with named parameters, by a function that builds it
partials, wrt     derivatives: of a model's numbers; what they are by
sensitivity       a run with its derivatives
batch             many runs on threads
"""

from zivi.mechanics.gap import Gap, LinearGap
from zivi.mechanics.layout import Evaluation
from zivi.mechanics.system import MechanicalSystem

__all__ = ["Evaluation", "Gap", "LinearGap", "MechanicalSystem"]
