"""Systems, forces and runs as plain values, which files and results keep."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from zivi.system.impact_law import NewtonImpact, Restitutions
from zivi.system.table import Table

if TYPE_CHECKING:
    from zivi.simulation.methods import Method
    from zivi.system.mass import ImpactSystem

__all__ = ["configuration_of", "describe", "describe_restitutions", "describe_system"]


def configuration_of(
    system: ImpactSystem, method: Method, span: tuple[float, float], state: tuple[float, float]
) -> dict[str, Any]:
    """Plain values that tell the run again (a callable only by its name)."""
    settings = method._values()  # type: ignore[attr-defined]
    return {
        **describe_system(system),
        "t_span": list(span),
        "y0": list(state),
        "method": {"name": type(method).__name__, **settings},
    }


def describe_system(system: ImpactSystem) -> dict[str, Any]:
    """Plain values that tell a system again."""
    law, newton = system.law, isinstance(system.law, NewtonImpact)
    return {
        "force": describe(system.force),
        "e": system.e if newton else describe(law),
        "kappa": system.kappa if newton else None,
        "wall": None if system.wall is None else describe(system.wall),
    }


def describe_restitutions(e: Restitutions) -> list[Any]:
    """Plain values that tell the coefficients or laws of gaps again."""
    return [describe(law) for law in e] if isinstance(e, tuple) else e.tolist()


def describe(force: Any) -> Any:
    """Plain values that tell a force, a wall or a law again (a callable only by its name)."""
    if dataclasses.is_dataclass(force) and not isinstance(force, type):
        values = {field.name: getattr(force, field.name) for field in dataclasses.fields(force)}
        if values.get("excitation", 0) is None:
            del values["excitation"]
        plain = {name: describe(it) if callable(it) else it for name, it in values.items()}
        return {"name": type(force).__name__, **plain}
    if isinstance(force, Table):
        numbers = {"times": force.times.tolist(), "values": force.values.tolist()}
        return {"name": "Table", **numbers, "kind": force.kind, "extend": force.extend}
    if isinstance(force, int | float):
        return float(force)
    name = getattr(force, "__qualname__", None) or type(force).__qualname__
    return f"{getattr(force, '__module__', None) or '?'}.{name}"
