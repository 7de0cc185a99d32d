"""Arguments in the wrong place: errors that name the right one, above all to users of SciPy."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from zivi.base.habits import keyword_hint
from zivi.simulation.methods import METHODS, FixedSteps, Settings
from zivi.system.mass import WRAPPED

__all__ = ["argument_text", "check_method", "refuse"]

BY_NAME = {
    "DOP853": "zivi.SwitchedRK(), of order 8",
    "RK45": "zivi.SwitchedRK(order=5)",
    "RK23": "zivi.SwitchedRK(order=5)",
}
"""SciPy's explicit methods, and what is nearest to them here."""

ELSEWHERE = {
    "args": "give the force its parameters yourself, e.g. by functools.partial",
    "jac": "no method of zivi needs the derivative of the force",
    "vectorized": "a force is a function of numbers; see zivi.simulate_batch for many runs",
    "fun": f"the force is part of the system, {WRAPPED}",
    "e": "it belongs to the system, zivi.ImpactSystem(force, e=...)",
    "kappa": "it belongs to the system, zivi.ImpactSystem(force, kappa=...)",
    "wall": "it belongs to the system, zivi.ImpactSystem(force, e=..., wall=...)",
}
"""Where an argument of `solve_ivp`, or of a system, belongs."""


def refuse(function: str, misplaced: Mapping[str, Any]) -> None:
    """Raise a TypeError for arguments that a function does not have, and say where they belong."""
    for name, value in misplaced.items():
        owner = next((kind for kind in METHODS.values() if name in _settings(kind)), None)
        if owner is not None:
            call = f"{function}(..., method=zivi.{owner.__name__}({name}={value!r}))"
            advice = f": it is a setting of the method, {call}"
        else:
            advice = keyword_hint(function, name) or keyword_hint("simulate", name)
            advice = f": {ELSEWHERE[name]}" if name in ELSEWHERE else advice
        raise TypeError(f"{function}() got an unexpected keyword argument {name!r}{advice}")


def _settings(kind: type[Any]) -> set[str]:
    return {field.name for field in dataclasses.fields(kind)}


def check_method(method: Any) -> None:
    """Refuse what is no method with its settings."""
    if isinstance(method, Settings) or (not isinstance(method, type) and hasattr(method, "_core")):
        return
    example = "e.g. zivi.SwitchedRK(rtol=1e-6) or zivi.ThetaGamma(h=1e-3)"
    raise TypeError(f"method must be one of zivi's methods, {example}, got {argument_text(method)}")


def argument_text(method: Any) -> str:
    """Say what was given for a method, and what may have been meant."""
    if isinstance(method, type):
        name = f"{method.__module__.partition('.')[0]}.{method.__name__}"
        if not issubclass(method, Settings):
            return f"the class {name}" + _nearest(method.__name__)
        return f"the class {name}: call it, {_called(method)}"
    if isinstance(method, str):
        return repr(method) + _nearest(method)
    return repr(method)


def _called(kind: type[Settings]) -> str:
    return f"zivi.{kind.__name__}({'h=1e-3' if issubclass(kind, FixedSteps) else ''})"


def _nearest(name: str) -> str:
    """Say which method here is nearest to one that is known by a name."""
    own = next((kind for it, kind in METHODS.items() if it.lower() == name.lower()), None)
    if own is not None:
        return f": the object is meant, {_called(own)}"
    nearest = BY_NAME.get(name.upper(), "zivi.SwitchedRK()")
    return f": the high-order method here is {nearest}"
