"""The numbers of a mechanical system by their names, and systems with other values of them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from zivi.base.check import Array, finite
from zivi.system.gap import HarmonicWall, LinearGap
from zivi.system.linear import Harmonic, LinearSystem
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import (
    ParametricSystem,
    excitation,
    parameter,
    parameters_of,
    with_value,
)

__all__ = ["core_of", "frequency_of", "period_of", "value_of", "values_of", "with_values"]

System = TypeVar("System", bound=MechanicalSystem | ImpactSystem)
OF_WALL = ("amplitude", "omega", "phase")


def core_of(system: MechanicalSystem) -> MechanicalSystem:
    """Give what a system with parameters is built to."""
    return system._built if isinstance(system, ParametricSystem) else system


def _parameters(system: MechanicalSystem) -> dict[str, float]:
    return dict(getattr(system, "parameters", {}))


def values_of(system: MechanicalSystem | ImpactSystem) -> dict[str, float]:
    """Give the numbers that have names, and their values."""
    if isinstance(system, ImpactSystem):
        return {"e": system.e} | parameters_of(system)
    found = _parameters(system)
    if isinstance(system, LinearSystem):
        found |= _of_linear(system)
    if system.m:
        e = system.e
        if np.ptp(e) == 0.0:
            found["e"] = float(e[0])
        found |= {f"e.{name}": float(e[i]) for i, name in enumerate(system.gap_names)}
    return found


def _of_linear(system: LinearSystem) -> dict[str, float]:
    found: dict[str, float] = {}
    waves = [part for part in system.excitation if isinstance(part, Harmonic)]
    if waves and len({wave.omega for wave in waves}) == 1:
        found["omega"] = waves[0].omega
        force = _strength(waves)
        found |= {"F": force, "amplitude": force}
        found["phase"] = waves[0].phase
    for name, gap in zip(system.gap_names, system.gaps, strict=True):
        assert isinstance(gap, LinearGap)
        found[f"{name}.offset"] = float(gap.offset)
        if isinstance(gap.motion, HarmonicWall):
            found |= {f"{name}.{part}": getattr(gap.motion, part) for part in OF_WALL}
    moving = {name: value for name, value in found.items() if name.endswith(".omega")}
    if not waves and len(set(moving.values())) == 1:
        found["omega"] = next(iter(moving.values()))
    return found


def _strength(waves: list[Harmonic]) -> float:
    """Give the largest amplitude of the loads, with the sign of the load."""
    loads = np.concatenate([np.atleast_1d(np.asarray(wave.amplitude)) for wave in waves])
    return float(loads[int(np.argmax(np.abs(loads)))])


def value_of(system: MechanicalSystem | ImpactSystem, name: str) -> float:
    """Give the value of a number by its name.

    Raises
    ------
    ValueError
        For a name that there is not, with those that there are.
    """
    if isinstance(system, ImpactSystem):
        own = values_of(system)
        return own[name] if name in own else parameter(system, name)
    known = values_of(system)
    if name not in known:
        hint = "" if known else ": zivi.ParametricSystem(build, {...}) gives numbers names"
        raise ValueError(f"{name!r} is no parameter here: {', '.join(known) or 'none'}{hint}")
    return known[name]


def with_values(system: System, values: Mapping[str, float]) -> System:
    """Give the same system with other values of some numbers."""
    if isinstance(system, ImpactSystem):
        return _of_mass(system, values)  # type: ignore[return-value]
    new: Any = system
    own = _parameters(system)
    given = {name: value for name, value in values.items() if name in own}
    if given:
        new = system.replace(**given)
        if isinstance(system, ParametricSystem) and np.any(system.e != system._built.e):
            new = _with_e(new, system.e)
    known = values_of(system) if len(given) < len(values) else {}
    for name, value in values.items():
        if name in given:
            continue
        if name not in known:
            value_of(system, name)
        if name == "e" or name.startswith("e."):
            new = _with_e(new, _moved_e(new, name, value))
        else:
            assert isinstance(new, LinearSystem)
            new = _with_number(new, name, value, known[name])
    return new  # type: ignore[no-any-return]


def _of_mass(system: ImpactSystem, values: Mapping[str, float]) -> ImpactSystem:
    """Give one mass with other values: a step over 1 may go to an e that no system has."""
    e, new = values.get("e", system.e), system
    if not 0.0 <= system.e <= 1.0:
        new = ImpactSystem(system.force, e=1.0, wall=system.wall)
    for name, value in values.items():
        if name != "e":
            new = with_value(new, name, value)
    if new.e != e:
        new = with_value(new, "e", min(max(e, 0.0), 1.0))
        new._e = e
    return new


def _moved_e(system: MechanicalSystem, name: str, value: float) -> Array:
    e = system.e
    if name == "e":
        e[:] = value
    else:
        e[system.gap_names.index(name.removeprefix("e."))] = value
    return e


def _with_e(system: MechanicalSystem, e: Array) -> MechanicalSystem:
    """Give a copy with other coefficients of restitution: a difference may step over 1."""
    new = object.__new__(type(system))
    vars(new).update(vars(system))
    new._e = np.asarray(e, np.float64)
    return new


def _with_number(system: LinearSystem, name: str, value: float, now: float) -> LinearSystem:
    parts, gaps = system.excitation, list(system.gaps)
    waves = any(isinstance(part, Harmonic) for part in parts)
    if name in ("omega", "F", "amplitude", "phase") and waves:
        parts = tuple(
            _wave(part, name, value, now) if isinstance(part, Harmonic) else part for part in parts
        )
    else:
        for i, gap in enumerate(gaps):
            assert isinstance(gap, LinearGap)
            gaps[i] = _moved_gap(gap, system.gap_names[i], name, value)
    return system._with(parts, tuple(gaps))


def _wave(part: Harmonic, name: str, value: float, now: float) -> Harmonic:
    if name == "omega":
        return dataclasses.replace(part, omega=value)
    if name == "phase":
        return dataclasses.replace(part, phase=part.phase + value - now)
    if now == 0.0:
        raise ValueError(f"{name} must not be 0: there is no direction of the load")
    return dataclasses.replace(part, amplitude=np.asarray(part.amplitude) * (value / now))


def _moved_gap(gap: LinearGap, own: str, name: str, value: float) -> LinearGap:
    if name == f"{own}.offset":
        return LinearGap(gap.normal, value, gap.motion, gap.name)
    wall = gap.motion
    part = "omega" if name == "omega" else name.removeprefix(f"{own}.")
    if isinstance(wall, HarmonicWall) and part in OF_WALL and (name in ("omega", f"{own}.{part}")):
        wall = dataclasses.replace(wall, **{part: value})
        return LinearGap(gap.normal, gap.offset, wall, gap.name)
    return gap


def frequency_of(system: MechanicalSystem | ImpactSystem) -> float | None:
    """Give the angular frequency of what excites a system, None where it is not known."""
    if isinstance(system, ImpactSystem):
        return excitation(system)[0]
    core: Any = core_of(system)
    found = {abs(it.omega) for it in getattr(core, "excitation", ()) if isinstance(it, Harmonic)}
    walls = [getattr(gap, "motion", None) for gap in core.gaps]
    found |= {abs(it.omega) for it in walls if isinstance(it, HarmonicWall) and it.amplitude}
    found.discard(0.0)
    if len(found) != 1 or not math.isfinite(next(iter(found))):
        return None
    return float(found.pop())


def period_of(
    system: MechanicalSystem | ImpactSystem,
    period: float | str | None,
    *,
    or_free: bool = False,
) -> float:
    """Give the period of the excitation; a ValueError where it is not known."""
    if period is not None:
        if not (period := finite("period", period)) > 0.0:
            raise ValueError(f"period must be > 0, got {period}")
        return period
    omega = frequency_of(system)
    if omega is None:
        what = "force" if isinstance(system, ImpactSystem) else "system"
        hint = ", or period='free' where it does not depend on time" if or_free else ""
        raise ValueError(
            f"period: the {what} has no single excitation whose period is known, give "
            f"period=... (s){hint}"
        )
    return 2.0 * math.pi / omega
