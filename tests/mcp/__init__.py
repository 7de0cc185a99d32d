"""Published mixed complementarity problems, each with its source, its starts and its truth."""

from . import complementarity, equations, linear, programs
from .problem import Problem

PROBLEMS = [
    problem
    for family in (complementarity, linear, programs, equations)
    for problem in family.problems()
]
BY_NAME = {problem.name: problem for problem in PROBLEMS}

__all__ = ["BY_NAME", "PROBLEMS", "Problem"]
