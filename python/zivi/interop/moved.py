"""Runs at other values of their parameters: the system, the span and the start that they give."""

from __future__ import annotations

import copy
import dataclasses
import functools
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.wrt import ALL_E, PARAMETER, QDOT0, T0, Column, E, columns_of
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.run import pair
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem, restitutions
from zivi.system.parameters import INITIAL, check_smooth, codes_of, with_value
from zivi.system.parametric_mechanism import ParametricSystem

__all__ = ["MassRun", "MechanicalRun", "Moved", "run_of"]

Moved: TypeAlias = tuple[Any, tuple[float, float], Any]
"""A system, a span and a start."""


@dataclasses.dataclass(frozen=True)
class MassRun:
    """A run of one mass."""

    system: ImpactSystem
    span: tuple[float, float]
    state: tuple[float, float]
    wrt: tuple[str, ...]

    def at(self, p: Array) -> Moved:
        """Give the run at values of its parameters; a ValueError for one out of its range."""
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
        """The names of the parameters, one for each coordinate."""
        return tuple(column.name for column in self.columns)

    def at(self, p: Array) -> Moved:
        """Give the run at values of its parameters; a ValueError for one out of its range."""
        start, state = self.span[0], (self.state[0].copy(), self.state[1].copy())
        e, parameters = np.array(self.system.e), {}
        for column, value in zip(self.columns, map(float, p), strict=True):
            kind, i = column.code
            if kind <= QDOT0:
                state[kind][i] = value
            elif kind == T0:
                start = value
            elif kind == ALL_E:
                e = e + (value - column.value)
            elif kind == E:
                e[i] += value - column.value
            elif kind == PARAMETER:
                parameters[column.name] = value
        system = self.system
        if parameters:
            system = system.replace(**parameters)  # type: ignore[attr-defined]
        if np.any(e != system.e):
            system = _with_restitution(system, e)
        return system, (start, self.span[1]), state


def _with_restitution(system: MechanicalSystem, e: Array) -> MechanicalSystem:
    """Give the same system with other coefficients of restitution."""
    if isinstance(system, ParametricSystem):
        build = functools.partial(_built, system._build, restitutions(e, system.m))
        return ParametricSystem(build, system.parameters)
    other = copy.copy(system)
    other._e = restitutions(e, system.m)
    return other


def _built(build: Any, e: Array, **parameters: float) -> MechanicalSystem:
    return _with_restitution(build(**parameters), e)


def run_of(system: Any, span: tuple[float, float], y0: Any, wrt: tuple[str, ...]) -> Any:
    """Check the start and the names, and give the run."""
    check_smooth(system)
    if not isinstance(system, MechanicalSystem):
        codes_of(system, wrt)
        return MassRun(system, span, pair("y0", y0, "(x0, xdot0)"), wrt)
    state = state_of(y0, system._n)
    model = system.model(len(state[0]))
    columns = columns_of(
        wrt,
        state,
        span[0],
        (system.e, system.gap_names),
        system.coordinate_names(model.layout.n),
        _parameters(system),
    )
    return MechanicalRun(system, span, state, tuple(columns))


def _parameters(system: MechanicalSystem) -> Mapping[str, float]:
    found: Mapping[str, float] = getattr(system, "parameters", {})
    return found
