"""Mechanical systems from their energies: derived by SymPy, compiled to one native function.

`system` makes a `zivi.MechanicalSystem` that runs without the interpreter.
"""

from zivi._formula import FormulaError
from zivi.symbolic.system import SymbolicSystem, system

__all__ = ["FormulaError", "SymbolicSystem", "system"]
