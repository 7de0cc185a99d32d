"""Mechanical systems from their energies: derived by SymPy, compiled to one native function.

`system` makes a `zivi.MechanicalSystem` that runs without the interpreter.
"""

from zivi.base.former import hand_on
from zivi.base.formula import FormulaError
from zivi.base.habits import hint_calls
from zivi.system.symbolic_system import SymbolicSystem, system

__all__ = ["FormulaError", "SymbolicSystem", "system"]

hand_on(
    {f"symbolic.{name}": f"system.symbolic.{name}" for name in ("derive", "functions", "system")}
)

hint_calls(__name__)
