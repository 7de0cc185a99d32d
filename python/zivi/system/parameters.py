"""The parameters of a system by their names: numbers, values, systems with other values."""

from __future__ import annotations

import dataclasses
from typing import Any

from zivi.base.habits import closest
from zivi.system.force import NativeForce
from zivi.system.impact_law import NewtonImpact, law_parameters
from zivi.system.mass import ImpactSystem, check_system
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parametric import ParametricForce
from zivi.system.table import refuse_tables
from zivi.system.wall import HarmonicWall

__all__ = [
    "check_differentiable",
    "check_newton",
    "check_smooth",
    "codes_of",
    "excitation",
    "names_of",
    "parameter",
    "parameters_of",
    "with_value",
]

INITIAL = {"x0": -1, "xdot0": -2, "t0": -3}
"""What the extension calls the initial state; parameters of the impact law go down from -4."""
OF_LAW = -4


def check_differentiable(system: Any) -> None:
    """Refuse what is no system of one mass and one wall, and say what there is for others."""
    if isinstance(system, MechanicalSystem):
        raise TypeError(
            "this is there for a zivi.ImpactSystem, one mass above one wall: of a "
            "zivi.MechanicalSystem zivi.sensitivity gives the derivatives and the monodromy"
        )
    check_system(system)
    check_smooth(system)


def check_smooth(system: Any) -> None:
    """Refuse a system with dry friction: derivatives through stick and slip are not there yet."""
    mechanical = isinstance(system, MechanicalSystem)
    if system.channel_names if mechanical else system.friction:
        more = "; diagrams and basins take a zivi.MechanicalSystem with friction"
        raise NotImplementedError(
            "derivatives of runs with dry friction are not there yet: difference runs of "
            f"zivi.simulate with tight tolerances{'' if mechanical else more}"
        )


def check_newton(system: Any) -> None:
    """Refuse as `check_differentiable`, and another impact law than Newton's."""
    check_differentiable(system)
    _ = system.e  # which says what takes another
    refuse_tables(system, "this")


def of_force(force: Any) -> dict[str, float]:
    """Names and values of the parameters of a force, in the order of the extension."""
    if isinstance(force, NativeForce):
        return force._numbers()
    if isinstance(force, ParametricForce):
        return dict(force.parameters)
    if isinstance(force, int | float):
        return {"force": float(force)}
    return {}


def parameters_of(system: ImpactSystem) -> dict[str, float]:
    """Names and values of the parameters of the force and of the wall."""
    values = of_force(system.force)
    if isinstance(system.wall, HarmonicWall):
        wall = dataclasses.asdict(system.wall)
        values |= {f"wall.{name}": value for name, value in wall.items()}
    return values


def names_of(system: ImpactSystem) -> list[str]:
    """All names by which a run of the system can be differentiated."""
    return [*INITIAL, *of_law(system), *parameters_of(system)]


def of_law(system: ImpactSystem) -> dict[str, float]:
    """Names and values of the parameters of the impact law: ``e``, or as ``law.e0``."""
    law = system.law
    if isinstance(law, NewtonImpact):
        return {"e": system.e}
    return {f"law.{name}": value for name, value in law_parameters(law).items()}


def codes_of(system: ImpactSystem, names: tuple[str, ...]) -> list[int]:
    """Give the numbers by which the extension knows names; a ValueError lists the names."""
    known = {**INITIAL} | {name: OF_LAW - i for i, name in enumerate(of_law(system))}
    known |= {name: number for number, name in enumerate(parameters_of(system))}
    for name in names:
        if name not in known:
            raise ValueError(_unknown(system, name))
    return [known[name] for name in names]


def parameter(system: ImpactSystem, name: str) -> float:
    """Give the value of a parameter of the system, those of its impact law included."""
    values = {**of_law(system), **parameters_of(system)}
    if name not in values:
        raise ValueError(_unknown(system, name, start=False))
    return values[name]


def with_value(system: ImpactSystem, name: str, value: float) -> ImpactSystem:
    """Give the same system with another value of a parameter."""
    force, wall = system.force, system.wall
    if isinstance(force, NativeForce) and name in force._numbers():
        return system._under(force._moved(name, value))
    parameter(system, name)
    if name == "e":
        return system._with(e=value)
    if name.startswith("law."):
        law: Any = system.law
        return system._with(e=dataclasses.replace(law, **{name.removeprefix("law."): value}))
    if name.startswith("wall."):
        assert isinstance(wall, HarmonicWall)
        moved = dataclasses.replace(wall, **{name.removeprefix("wall."): value})
        return system._with(wall=moved)
    if isinstance(force, ParametricForce):
        return system._with(force=force.replace(**{name: value}))
    return system._with(force=value)


def excitation(system: ImpactSystem) -> tuple[float | None, str | None]:
    """Give the angular frequency of the excitation, and its name; None if nothing excites."""
    found = {}
    force = system.force
    if isinstance(force, NativeForce) and (omega := force._excitation) is not None:
        found["omega"] = omega
    if isinstance(system.wall, HarmonicWall) and system.wall.amplitude != 0.0:
        found["wall.omega"] = abs(system.wall.omega)
    values = set(found.values())
    if len(values) != 1 or 0.0 in values:
        return None, None
    name = next(iter(found)) if len(found) == 1 else None
    return values.pop(), name


def _unknown(system: ImpactSystem, name: str, *, start: bool = True) -> str:
    names = names_of(system) if start else [*of_law(system), *parameters_of(system)]
    hint = ""
    if close := closest(name, names):
        hint = f"; did you mean {close!r}?"
    elif isinstance(system.force, int | float):
        hint = (
            "; a constant force is the one parameter force: zivi.LinearForce(gravity=9.81, ...) "
            "has gravity, stiffness, damping"
        )
    elif not of_force(system.force):
        hint = (
            "; a plain callable has no parameters: give them names with "
            "zivi.ParametricForce(f, parameters={...})"
        )
    return f"{name!r} is no parameter here: {', '.join(names)}{hint}"
