"""The numbers of friction and contact laws by name, and systems with other values."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any

import numpy as np

from zivi.system.gap import Hertz, HuntCrossley, SpringDamper
from zivi.system.linear import LinearSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import ParametricSystem

SLIP, STATIC, BOTH, VELOCITY, RESTITUTION = range(5)
"""Kinds of numbers, as the extension numbers them."""
OF_GAP = {"mu": SLIP, "mu_static": STATIC, "e_t": RESTITUTION}
OF_JOINT = {"limit": SLIP, "static": STATIC, "velocity": VELOCITY}


@dataclasses.dataclass(frozen=True)
class FrictionNumber:
    """A number of a channel of dry friction.

    Parameters
    ----------
    channel : int
        The channel.
    kind : int
        What it is for the extension.
    field : str
        The argument of the gap or the joint.
    value : float
        The number.
    """

    channel: int
    kind: int
    field: str
    value: float


def friction_numbers(system: MechanicalSystem) -> dict[str, FrictionNumber]:
    """Return the numbers of the friction of a system by name: those that are given as numbers.

    Symbolic systems and trees have names of their own for them, among their parameters.
    """
    built = system._built if isinstance(system, ParametricSystem) else system
    if type(built) not in (MechanicalSystem, LinearSystem):
        return {}
    found = {}
    first = len(built._channels) - len(built._joints)
    for c, channel in enumerate(built._channels):
        if channel.gap is None:
            owner: Any = built._joints[c - first]
            given = {field: getattr(owner, field) for field in OF_JOINT}
            kinds, lowest = OF_JOINT, ("limit", "static")
        else:
            given = {"mu_static": None} | built._gaps[channel.gap]._friction
            kinds, lowest = OF_GAP, ("mu", "mu_static")
        for field, kind in kinds.items():
            if not isinstance(given[field], int | float | np.integer | np.floating):
                continue
            both = field == lowest[0] and given[lowest[1]] is None
            number = FrictionNumber(c, BOTH if both else kind, field, float(given[field]))
            found[f"{channel.name}.{field}"] = number
    return found


def with_friction_numbers(
    system: MechanicalSystem, values: Mapping[str, float]
) -> MechanicalSystem:
    """Return the same system with other numbers of friction, by name.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """
    if not values:
        return system
    if isinstance(system, ParametricSystem):
        build = functools.partial(_built_with_friction, system._build, dict(values))
        return ParametricSystem(build, system.parameters)
    numbers = friction_numbers(system)
    first = len(system._channels) - len(system._joints)
    gaps, joints = list(system.gaps), list(system.friction)
    for name, value in values.items():
        number = numbers[name]
        gap = system._channels[number.channel].gap
        owners: list[Any] = joints if gap is None else gaps
        at = number.channel - first if gap is None else gap
        owners[at] = _with_field(owners[at], number.field, float(value))
    return system.replace(gaps=gaps, friction=joints)


def _with_field(owner: Any, field: str, value: float) -> Any:
    """Return the same gap or joint with another number."""
    new = object.__new__(type(owner))
    new.__setstate__(owner.__getstate__() | {field: value})
    return new


def _built_with_friction(
    build: Any, values: Mapping[str, float], **parameters: float
) -> MechanicalSystem:
    return with_friction_numbers(build(**parameters), values)


# The numbers of the contact laws of compliant gaps.


def contact_numbers(system: MechanicalSystem) -> dict[str, tuple[int, int, float]]:
    """Return the numbers of contact laws by name, as ``"floor.k"``: gap, place, value."""
    found = {}
    for gap, law in enumerate(system._contact_laws()):
        for place, (field, value) in enumerate(_numbers_of_law(law).items()):
            found[f"{system.gap_names[gap]}.{field}"] = (gap, place, value)
    return found


def _numbers_of_law(law: Any) -> dict[str, float]:
    return dataclasses.asdict(law) if isinstance(law, SpringDamper | Hertz | HuntCrossley) else {}


def with_contact_numbers(system: MechanicalSystem, values: Mapping[str, float]) -> MechanicalSystem:
    """Return the same system with other numbers of contact laws, by name.

    Raises
    ------
    NotImplementedError
        For a tree or a symbolic system.
    ValueError
        If a number is out of its range.
    """
    if not values:
        return system
    if isinstance(system, ParametricSystem):
        build = functools.partial(_built_with_contacts, system._build, dict(values))
        return ParametricSystem(build, system.parameters)
    if type(system) is not MechanicalSystem:
        raise NotImplementedError(
            f"numbers of contact laws of a {type(system).__name__} are not supported here; use a "
            "zivi.MechanicalSystem or a zivi.ParametricSystem"
        )
    numbers, gaps = contact_numbers(system), list(system.gaps)
    for name, value in values.items():
        gap, place, _ = numbers[name]
        law: Any = gaps[gap].contact
        field = list(_numbers_of_law(law))[place]
        moved = dataclasses.replace(law, **{field: float(value)})
        gaps[gap] = _with_field(gaps[gap], "contact", moved)
    return system.replace(gaps=gaps)


def _built_with_contacts(
    build: Any, values: Mapping[str, float], **parameters: float
) -> MechanicalSystem:
    return with_contact_numbers(build(**parameters), values)
