"""Flights of known length with their derivatives: what orbits are made of."""

from __future__ import annotations

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.base.compiled import listening
from zivi.base.status import Status
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import codes_of, parameter

__all__ = ["PRECISE", "FlightError", "fly"]

PRECISE = SwitchedRK(rtol=1e-12, atol=1e-13)
"""The tolerances of orbits, unless others are given."""


class FlightError(ArithmeticError):
    """A flight that cannot be computed; the status says why."""

    def __init__(self, status: Status) -> None:
        super().__init__(_zivi.STATUS_MESSAGES[status])
        self.status = status


def fly(
    system: ImpactSystem,
    starts: Array,
    method: SwitchedRK = PRECISE,
    name: str | None = None,
    *,
    minima: bool = False,
) -> tuple[Array, Array]:
    """Fly from each ``(t, x, xdot)`` to its end, ``starts`` having four columns.

    Gives rows of x, xdot, the accelerations at both ends, time and height of the lowest minimum,
    infinite without one; and the derivatives of the ends by the state at the start, and by the
    parameter `name` of the force or the wall, of shape (k, 2, 2 or 3).
    """
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
