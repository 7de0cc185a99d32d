"""What stays the same while the unknowns of an orbit move, and what the unknowns are."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np

from zivi._zivi import PeriodicImpulses
from zivi.base.check import Array
from zivi.orbits.mechanical.flow import Flow
from zivi.orbits.mechanical.linear_flow import LinearFlow
from zivi.orbits.mechanical.mass_flow import MassFlow, MassImpulses
from zivi.orbits.mechanical.modes import periodic_impulses
from zivi.orbits.mechanical.word import Word
from zivi.simulation.methods import SwitchedRK

__all__ = ["Frame"]


@dataclasses.dataclass(frozen=True)
class Frame:
    """What stays the same while unknowns move."""

    system: Any
    """A `MechanicalSystem`, or an `ImpactSystem`, whose flow is a `MassFlow`."""
    flow: Flow
    word: Word
    method: SwitchedRK
    length: float
    """After how long the word closes: periods, or half of them (s). A guess if it is free."""
    free: bool = False
    turn: Array | None = None
    r""":math:`\Sigma`, of shape (2n, 2n), of a symmetric word."""
    section: float | int = 0.0
    """Of the letter P: a time, or as an int the coordinate that is highest."""

    @functools.cached_property
    def impulses(self) -> PeriodicImpulses | MassImpulses | None:
        """The equations in impulses, where there are such."""
        if self.free or self.turn is not None:
            return None
        if any(it.kind != "I" or it.contacts for it in self.word):
            return None
        if isinstance(self.flow, MassFlow):
            return MassImpulses(self.flow, len(self.word), self.length)
        if not isinstance(self.flow, LinearFlow):
            return None
        return periodic_impulses(self.flow, [it.gap for it in self.word], self.length)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what is made anew."""
        return {name: value for name, value in vars(self).items() if name != "impulses"}

    @property
    def size(self) -> int:
        """The number of unknowns of an event."""
        return 2 * self.flow.n + 2 if self.impulses is None else 2

    def split(self, y: Array) -> tuple[Array, float]:
        """Give the segments, rows ``(t, z, tau)``, and the length."""
        if self.impulses is not None:
            times, states = y[1::2], self.impulses.states(y)
            x = np.empty((len(times), states.shape[1] + 2))
            x[1:, 0], x[1:, 1:-1], x[:, -1] = times[:-1], states[:-1], times
            x[0, 0], x[0, 1:-1] = times[-1] - self.length, states[-1]
            return x, self.length
        x = y.reshape(len(self.word), self.size).copy()
        if not self.free:
            return x, self.length
        length, x[0, 0] = float(x[0, 0]), 0.0
        return x, length

    def joined(self, x: Array, length: float) -> Array:
        """Give the vector of unknowns from the segments."""
        if self.impulses is not None:
            ends = self.flow.fly((), x[:, 0], x[:, 1:-1], x[:, -1]).z
            own = [it.gap for it in self.word]
            rates = self.flow.gaps(x[:, -1], ends)[1][np.arange(len(x)), own]
            impulses = -(1.0 + self.flow.e[own]) * rates / self.impulses.mobilities
            return np.column_stack([impulses, x[:, -1]]).ravel()
        y = x.copy()
        if self.free:
            y[:, 0] -= x[0, 0]
            y[:, -1] -= x[0, 0]
            y[0, 0] = length
        return y.ravel()
