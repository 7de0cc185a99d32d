"""Builds systems, methods and controllers from checked values."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from zivi.control import twisting
from zivi.files.tree_keys import GAPS
from zivi.files.validation import Mistakes
from zivi.simulation.methods import METHODS
from zivi.system.friction import DryFriction
from zivi.system.impact_law import LAWS
from zivi.system.mass import Force, ImpactSystem, LinearForce
from zivi.system.mechanism import MechanicalSystem
from zivi.system.symbolic.system import system as symbolic_system
from zivi.system.tree.body import Body
from zivi.system.tree.system import Tree
from zivi.system.wall import HarmonicWall

__all__ = [
    "controller",
    "force",
    "mechanics",
    "method",
    "named",
    "restitution",
    "spaced",
    "system",
    "tree",
]


def force(value: Any) -> Force:
    """Build a force from a number or coefficients."""
    return LinearForce(**value) if isinstance(value, dict) else value


def system(values: dict[str, Any], mistakes: Mistakes) -> ImpactSystem:
    """Build a system."""
    wall = values.get("wall")
    given: dict[str, Any] = {name: values[name] for name in ("e", "kappa") if name in values}
    given = with_law(given, mistakes)
    if friction := values.get("friction"):
        with mistakes.naming(named("system.friction", friction), "system.friction"):
            given["friction"] = DryFriction(**friction)
    with mistakes.naming(named("system", (*given, "wall")), "system"):
        return ImpactSystem(
            force(values["force"]),
            wall=None if wall is None else HarmonicWall(**wall),
            **given,
        )


def with_law(values: dict[str, Any], mistakes: Mistakes) -> dict[str, Any]:
    """Build the impact laws among what `e` has, one or a list."""
    e = values.get("e")
    if isinstance(e, list):
        return values | {"e": [law(it, f"system.e[{n}]", mistakes) for n, it in enumerate(e)]}
    return values if e is None else values | {"e": law(e, "system.e", mistakes)}


def law(value: Any, key: str, mistakes: Mistakes) -> Any:
    """Build an impact law from its table; a number stays one."""
    if not isinstance(value, dict):
        return value
    settings = {name: it for name, it in value.items() if name != "law"}
    with mistakes.naming(named(key, settings), key):
        return LAWS[value["law"]](**settings)


def mechanics(values: dict[str, Any], mistakes: Mistakes) -> MechanicalSystem:
    """Build a mechanical system from its energies."""
    values = with_law(values, mistakes)
    with mistakes.naming(named("system", values), "system"):
        return symbolic_system(**values)


def tree(values: dict[str, Any], mistakes: Mistakes) -> Tree:
    """Build a tree of bodies."""
    given = {name: it for name, it in values.items() if name in ("gravity", "e")}
    settings = with_law(given, mistakes)
    with mistakes.naming(named("system", ("bodies", "gaps", "gravity", "e")), "system"):
        bodies = [Body(**body) for body in values["bodies"]]
        gaps = [
            GAPS[gap["kind"]](**{name: it for name, it in gap.items() if name != "kind"})
            for gap in values.get("gaps", ())
        ]
        found = Tree(bodies, gaps=gaps, **settings)
    for name, value in values.get("parameters", {}).items():
        key = f"system.parameters.{name}"
        if name not in found.parameters:
            known = ", ".join(found.parameters)
            mistakes.add(key, f"is no parameter of the tree: allowed: {known}")
            mistakes.stop()
        with mistakes.naming({}, key):
            found.parameters[name] = value
    return found


def method(values: dict[str, Any], mistakes: Mistakes) -> Any:
    """Build a method by its name."""
    settings = {name: value for name, value in values.items() if name != "name"}
    with mistakes.naming(named("method", settings), "method"):
        return METHODS[values["name"]](**settings)


def controller(
    values: dict[str, Any], plant: ImpactSystem, keys: dict[str, str], mistakes: Mistakes
) -> Any:
    """Build a controller by its name; it believes in the wall of the plant unless told another."""
    settings = {name: value for name, value in values.items() if name != "name"}
    names = named("controller", settings)
    names |= dict.fromkeys(("u_min", "u_max"), "controller.u_limits")
    if not ("e" in settings or "kappa" in settings):
        settings["kappa"] = plant.kappa
        names |= {"e": keys["e"], "kappa": keys["kappa"]}
    with mistakes.naming(names, "controller"):
        return getattr(twisting, values["name"])(**settings)


def named(table: str, names: Iterable[str]) -> dict[str, str]:
    """Give the key of each argument that a table holds."""
    return {name: f"{table}.{name}" for name in names}


def restitution(values: dict[str, Any]) -> dict[str, str]:
    """Give the key behind the restitution of a system, whichever of the two was given."""
    key = "system.kappa" if "kappa" in values else "system.e"
    return {"e": key, "kappa": key}


def spaced(values: dict[str, Any], *, log: bool = False) -> np.ndarray:
    """Give the values of a range."""
    make = np.geomspace if log else np.linspace
    return make(values["start"], values["stop"], values["num"])
