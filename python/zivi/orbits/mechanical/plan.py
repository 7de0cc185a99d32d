"""What is done at each value of a bifurcation diagram of a mechanical system."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.orbits.attractor import TOLERANCE
from zivi.orbits.mechanical.settled import Settled, classify, settle
from zivi.orbits.plan import Found, Plan
from zivi.simulation.mechanical_run import state_of
from zivi.system.mechanism import MechanicalSystem

__all__ = ["MechanicalPlan", "number_of", "read_states", "starts_of"]


def number_of(what: str, name: str | None, names: tuple[str, ...]) -> int | None:
    """Give the number of a gap or a coordinate by its name."""
    if name is None:
        return None
    if name not in names:
        raise ValueError(f"{what} must be one of {', '.join(map(repr, names))}, got {name!r}")
    return names.index(name)


def read_states(name: str, starts: Array) -> Array:
    """Give states of shape (N, 2, n) of one, ``(q0, qdot0)``, or several."""
    states = starts[None] if starts.ndim == 2 else starts
    if states.ndim != 3 or states.shape[1] != 2 or not states.shape[2]:
        raise ValueError(f"{name} must be (q0, qdot0), or several, got shape {starts.shape}")
    return states


def _place(name: str, names: tuple[str, ...]) -> tuple[int, int]:
    """Give where an initial value is in ``(q0, qdot0)``."""
    for part, kind in enumerate(("q0", "qdot0")):
        for i, own in enumerate(names):
            if name in (f"{kind}.{own}", f"{kind}[{i}]"):
                return part, i
    known = ", ".join(f"'{kind}.{own}'" for kind in ("q0", "qdot0") for own in names)
    raise ValueError(f"axes must be two of {known}, got {name!r}")


def starts_of(
    system: MechanicalSystem, values: Array, axes: Sequence[str] | None, y0: Any
) -> tuple[tuple[str, str], Array]:
    """Give the names of two initial values, and states of shape (N, 2, n) with pairs of them."""
    if y0 is None and system._n is None:
        raise ValueError("y0 must be given: the system does not tell how many coordinates it has")
    base = np.zeros((2, system._n or 0)) if y0 is None else np.array(state_of(y0, system._n))
    names = system.coordinate_names(base.shape[1])
    given = (f"q0.{names[0]}", f"qdot0.{names[0]}") if axes is None else tuple(axes)
    places = [_place(name, names) for name in given]
    if len(places) != 2 or places[0] == places[1]:
        raise ValueError(f"axes must be two different initial values, got {given!r}")
    states = np.repeat(base[None], len(values), axis=0)
    for (part, i), column in zip(places, values.T, strict=True):
        states[:, part, i] = column
    return (given[0], given[1]), states


@dataclasses.dataclass(frozen=True)
class MechanicalPlan(Plan):
    """What is done at each value."""

    gap: int | None = None
    """Of which gap the impacts are noted, None for all."""
    coordinate: int = 0
    """Of which coordinate the states are noted."""

    def settle(
        self, systems: list[Any], states: Array, periods: list[float], *how: Any
    ) -> list[Settled]:
        """Run each from its state."""
        return settle(systems, states, periods, self.transient, self.keep, self.method, *how)

    def points(self, system: MechanicalSystem, settled: Settled, period: float) -> Found:
        """Give phases and speeds of the impacts, or states."""
        kind = classify(settled, period, self.keep, TOLERANCE)
        if self.section == "impacts":
            rows = settled.impacts.copy()
            rows[:, 0] = rows[:, 0] / period % 1.0
            return (rows if self.gap is None else rows[rows[:, 2] == self.gap]), kind
        n = settled.states.shape[1] // 2
        states = settled.states[1:, [self.coordinate, n + self.coordinate]]
        return np.column_stack([states, np.full(len(states), -1.0)]), kind
