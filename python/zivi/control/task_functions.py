"""Functions of the coordinates that a controller leads beside the gaps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from zivi.system.gap import Gap
from zivi.system.mechanism import MechanicalSystem
from zivi.system.symbolic.system import SymbolicSystem, system as symbolic_system

__all__ = ["check_tasks", "functions_of"]


def check_tasks(system: MechanicalSystem, tasks: Mapping[str, Any]) -> dict[str, Any]:
    """Read functions by name: all a `Gap`, or formulas for a symbolic system."""
    read = {str(name): it for name, it in tasks.items()}
    taken = {"posture", *system.gap_names}
    if strange := sorted(set(read) & taken):
        raise ValueError(f"tasks must have names other than {sorted(taken)}, got {strange[0]!r}")
    formulas = [name for name, it in read.items() if not isinstance(it, Gap)]
    if formulas and (len(formulas) < len(read) or not isinstance(system, SymbolicSystem)):
        raise TypeError(
            f"tasks[{formulas[0]!r}] must be a zivi.Gap with value and derivatives, or all are "
            "formulas in coordinates and parameters of a symbolic system"
        )
    return read


def functions_of(system: MechanicalSystem, tasks: Mapping[str, Any], n: int) -> MechanicalSystem:
    """Give a system whose gaps are the functions; its masses and forces do not matter."""
    if any(isinstance(it, Gap) for it in tasks.values()):
        gaps = list(tasks.values())
        return MechanicalSystem(mass=np.eye(n), force=np.zeros(n), gaps=gaps, e=0.0)
    assert isinstance(system, SymbolicSystem)
    names = system.coordinate_names(n)
    own = symbolic_system(
        list(names),
        T=" + ".join(f"{name}dot**2" for name in names),
        gaps={name: _in_symbols(it) for name, it in tasks.items()},
        parameters=dict(system.parameters),
        compiler=system._compiler,
    )
    own._parameters = system.parameters  # those change with the system's
    return own


def _in_symbols(formula: Any) -> Any:
    """Replace functions of time by symbols of their names."""
    functions = formula.atoms(_undefined()) if hasattr(formula, "atoms") else ()
    return formula.subs({it: it.func.__name__ for it in functions}) if functions else formula


def _undefined() -> Any:
    import sympy.core.function

    return sympy.core.function.AppliedUndef
