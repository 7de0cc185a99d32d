"""What the equations of an orbit ask of a motion with some gaps closed."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from zivi.base.check import Array

__all__ = ["Contacts", "Flights", "Flow", "Jump", "Scalar", "uncoupled"]

Contacts = tuple[int, ...]


@dataclasses.dataclass(frozen=True)
class Flights:
    """The ends of k flights, and their derivatives."""

    z: Array
    """States ``(q, qdot)`` at the ends, shape (k, 2n)."""
    phi: Array
    """Derivatives by the states at the starts, shape (k, 2n, 2n)."""
    first: Array
    """Rates of the states at the starts, shape (k, 2n)."""
    last: Array
    """Rates of the states at the ends."""
    lows: Array | None = None
    """Of one mass time and height of the lowest minimum of each, infinite without one."""
    by: Array | None = None
    """Derivatives of the ends by a parameter, where one was asked for."""

    def of(self, s: int) -> Flights:
        """Give one of them."""
        return Flights(self.z[s], self.phi[s], self.first[s], self.last[s])


@dataclasses.dataclass(frozen=True)
class Scalar:
    """A number that depends on time and state, with its derivatives."""

    value: float
    by_z: Array
    by_t: float


@dataclasses.dataclass(frozen=True)
class Jump:
    """An impact: the state after it, impulses, derivatives by state and time."""

    z: Array
    impulses: Array
    """Of the gap that is hit and of the contacts that stay."""
    by_z: Array
    by_t: Array


class Flow(Protocol):
    """Motions of a system with given contacts, whatever the signs of gaps and forces."""

    n: int
    m: int
    e: Array
    accuracy: float
    """What flights leave of residuals, relative to their sizes: less cannot be asked for."""

    def fly(self, contacts: Contacts, t0: Array, z0: Array, t1: Array) -> Flights:
        """Fly k times, from times and states to times."""

    def path(self, contacts: Contacts, t0: float, z0: Array, times: Array) -> Array:
        """Give states along a flight, shape (len(times), 2n)."""

    def rate(self, contacts: Contacts, t: float, z: Array) -> Array:
        """Give the rate of the state."""

    def gap(self, i: int, t: float, z: Array) -> Scalar:
        """Give a gap."""

    def gaps(self, times: Array, z: Array) -> tuple[Array, Array]:
        """Give all gaps and their rates, each of shape (len(times), m)."""

    def reaction(self, contacts: Contacts, i: int, t: float, z: Array) -> Scalar:
        """Give the force of a contact."""

    def reactions(self, contacts: Contacts, times: Array, z: Array) -> Array:
        """Give the forces of all contacts, shape (len(times), len(contacts))."""

    def impact(self, i: int, kept: Sequence[int], t: float, z: Array, e: float) -> Jump:
        """Give an impact of a gap while some contacts stay closed."""


def uncoupled(flow: Flow, gaps: Sequence[int], t: float, z: Array) -> bool:
    """Whether impacts of some gaps leave the rates of the others: their order does not matter."""
    for i in gaps:
        after = flow.impact(i, (), t, z, 1.0).z
        both = flow.gaps(np.array([t, t]), np.array([z, after]))[1]
        moved = np.abs(both[1] - both[0])
        if any(moved[j] > 1e-12 * moved[i] for j in gaps if j != i):
            return False
    return True
