"""Runs whose system and initial state are functions of named parameters."""

from __future__ import annotations

import copy
import dataclasses
import functools
from collections.abc import Mapping
from typing import Any, TypeAlias

from zivi.base.check import Array
from zivi.derivatives.mechanical_sensitivity import (
    ALL_E,
    LAW,
    PARAMETER,
    QDOT0,
    T0,
    Column,
    columns_of,
)
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.run import pair
from zivi.system.impact_law import ImpactLaw, restitutions
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import INITIAL, ParametricSystem, check_smooth, codes_of, with_value

Moved: TypeAlias = tuple[Any, tuple[float, float], Any]
"""A system, a span and a start."""


@dataclasses.dataclass(frozen=True)
class SmoothMassRun:
    """A run of one mass."""

    system: ImpactSystem
    span: tuple[float, float]
    state: tuple[float, float]
    wrt: tuple[str, ...]

    def at(self, p: Array) -> Moved:
        """Return the run at values of its parameters; a ValueError for one out of its range."""
        given = dict(zip(self.wrt, map(float, p), strict=True))
        system, (x0, v0) = self.system, self.state
        for name, value in given.items():
            if name not in INITIAL:
                system = with_value(system, name, value)
        start = given.get("t0", self.span[0])
        return system, (start, self.span[1]), (given.get("x0", x0), given.get("xdot0", v0))


@dataclasses.dataclass(frozen=True)
class MechanicalRun:
    """A run of a mechanical system."""

    system: MechanicalSystem
    span: tuple[float, float]
    state: tuple[Array, Array]
    columns: tuple[Column, ...]

    @property
    def wrt(self) -> tuple[str, ...]:
        """Names of the parameters, one for each coordinate."""
        return tuple(column.name for column in self.columns)

    def at(self, p: Array) -> Moved:
        """Return the run at values of its parameters; a ValueError for one out of its range."""
        start, state = self.span[0], (self.state[0].copy(), self.state[1].copy())
        laws: list[ImpactLaw] = list(self.system.laws)
        parameters: dict[str, float] = {}
        for column, value in zip(self.columns, map(float, p), strict=True):
            kind, i = column.code
            if kind <= QDOT0:
                state[kind][i] = value
            elif kind == T0:
                start = value
            elif kind == ALL_E:
                laws = [_law_moved(law, "e", value - column.value) for law in laws]
            elif kind == LAW:
                name = dataclasses.fields(laws[i])[column.of].name
                laws[i] = _law_moved(laws[i], name, value - column.value)
            elif kind == PARAMETER:
                parameters[column.name] = value
        system = self.system
        if parameters:
            system = system.replace(**parameters)
        if tuple(laws) != self.system.laws:
            system = _with_laws(system, tuple(laws))
        return system, (start, self.span[1]), state


def _law_moved(law: ImpactLaw, name: str, by: float) -> ImpactLaw:
    """Return a law with one parameter moved; "e" and "e.floor" may move the same one."""
    return dataclasses.replace(law, **{name: getattr(law, name) + by})


def _with_laws(system: MechanicalSystem, laws: tuple[ImpactLaw, ...]) -> MechanicalSystem:
    """Return the same system with other impact laws."""
    if isinstance(system, ParametricSystem):
        build = functools.partial(_built, system._build, laws)
        return ParametricSystem(build, system.parameters)
    other = copy.copy(system)
    other._e = restitutions(laws, system.m)
    return other


def _built(build: Any, laws: tuple[ImpactLaw, ...], **parameters: float) -> MechanicalSystem:
    return _with_laws(build(**parameters), laws)


def smooth_run(system: Any, span: tuple[float, float], y0: Any, wrt: tuple[str, ...]) -> Any:
    """Check that a run has derivatives, and return it as `run_of`."""
    check_smooth(system)
    return run_of(system, span, y0, wrt)


def run_of(system: Any, span: tuple[float, float], y0: Any, wrt: tuple[str, ...]) -> Any:
    """Check the initial state and the names, and return the run."""
    if not isinstance(system, MechanicalSystem):
        codes_of(system, wrt)
        return SmoothMassRun(system, span, pair("y0", y0, "(x0, xdot0)"), wrt)
    state = state_of(y0, system._n)
    model = system.model(len(state[0]))
    columns = columns_of(
        wrt,
        state,
        span[0],
        dict(zip(system.gap_names, system.laws, strict=True)),
        system.coordinate_names(model.layout.n),
        _model_parameters(system),
    )
    return MechanicalRun(system, span, state, tuple(columns))


def _model_parameters(system: MechanicalSystem) -> Mapping[str, float]:
    found: Mapping[str, float] = getattr(system, "parameters", {})
    return found
