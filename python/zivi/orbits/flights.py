"""Flights of known length with their derivatives: what orbits are made of."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array, finite
from zivi.base.compiled import listening
from zivi.base.status import Status
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import codes_of, excitation, parameter

__all__ = ["PRECISE", "FlightError", "Legs", "flown", "fly", "period_of"]

PRECISE = SwitchedRK(rtol=1e-12, atol=1e-13)
"""The tolerances of orbits, unless others are given."""


class FlightError(ArithmeticError):
    """A flight that cannot be computed; the status says why."""

    def __init__(self, status: Status) -> None:
        super().__init__(_zivi.STATUS_MESSAGES[status])
        self.status = status


@dataclasses.dataclass(frozen=True)
class Legs:
    """The ends of flights and their derivatives, one after the other."""

    x: Array
    v: Array
    first: Array
    """Accelerations at the starts."""
    last: Array
    """Accelerations at the ends."""
    t_low: Array
    x_low: Array
    """The lowest minimum between the ends; infinite where there is none."""
    phi: Array
    """Derivatives of the end by the start, of shape (k, 2, 2)."""
    by: Array
    """Derivatives of the end by the parameter, of shape (k, 2); of zero size without one."""

    def map(self, i: int, u: float, e: float) -> Array:
        """Give the derivative of ``(t, u)`` after the leg by that before it."""
        by_t = -self.phi[i] @ [u, self.first[i]]
        by_u = self.phi[i][:, 1]
        dx, dv = np.column_stack([by_t, by_u])
        with np.errstate(divide="ignore", invalid="ignore"):
            # infinite where the impact grazes
            dt = -dx / self.v[i]
            return np.stack([dt, -e * (dv + self.last[i] * dt)])


def fly(
    system: ImpactSystem,
    starts: Array,
    name: str | None = None,
    *,
    minima: bool = False,
    method: SwitchedRK = PRECISE,
) -> Legs:
    """Fly from each ``(t, x, xdot)`` to its end, ``starts`` having four columns.

    `name` is a parameter of the force or the wall to differentiate by.
    """
    ends, columns = flown(system, starts, name, minima=minima, method=method)
    x, v, first, last, t_low, x_low = ends.T
    by = columns[:, :, 2:].reshape(len(ends), -1)
    return Legs(x, v, first, last, t_low, x_low, columns[:, :, :2], by)


def flown(
    system: ImpactSystem, starts: Array, name: str | None, *, minima: bool, method: SwitchedRK
) -> tuple[Array, Array]:
    """Give rows of what `Legs` names, and the derivatives of the ends, of shape (k, 2, 2 or 3)."""
    by = [] if name in (None, "e") else codes_of(system, (str(name),))
    sizes = [1.0, 1.0] + [abs(parameter(system, str(name))) or 1.0 for _ in by]
    rows = np.ascontiguousarray(starts, dtype=np.float64).reshape(-1, 4)
    spec = system._spec
    with listening([spec]) as ear:
        core = method._core
        status, numbers = _zivi.fly_apart(spec, core, rows.ravel(), by, np.array(sizes), minima)
    if (error := ear.ends(status == 0)) is not None:
        raise error
    if status:
        raise FlightError(Status(status))
    n = 2 + len(by)
    table = numbers.reshape(len(rows), 6 + 2 * n)
    return table[:, :6], table[:, 6:].reshape(len(rows), 2, n)


def period_of(system: ImpactSystem, period: float | str | None, *, or_free: bool = False) -> float:
    """Give the period of the excitation; a ValueError where it is not known."""
    if period is not None:
        if not (period := finite("period", period)) > 0.0:
            raise ValueError(f"period must be > 0, got {period}")
        return period
    omega, _ = excitation(system)
    if omega is None:
        hint = ", or period='free' where it does not depend on time" if or_free else ""
        raise ValueError(
            "period: the force has no single excitation whose period is known, give period=... (s)"
            f"{hint}"
        )
    return 2.0 * math.pi / omega
