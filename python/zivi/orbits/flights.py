"""Flights of known length with their derivatives: what orbits are made of."""

from __future__ import annotations

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.base.compiled import Ear, listening
from zivi.base.status import Status
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import parameter, parameters_of

__all__ = ["PRECISE", "FlightError", "fly", "sequence_equations"]

PRECISE = SwitchedRK(rtol=1e-12, atol=1e-13)
"""The tolerances of orbits, unless others are given."""
UNIT = np.ones(2)


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
    by, sizes = _asked(system, name)
    rows = np.ascontiguousarray(starts, dtype=np.float64).reshape(-1, 4)
    spec = system._spec
    with listening((spec,)) as ear:
        status, numbers = _zivi.fly_apart(spec, method._core, rows.ravel(), by, sizes, minima)
    _check(status, ear)
    return _parted(numbers, len(rows), 2 + len(by))


def sequence_equations(
    system: ImpactSystem,
    unknowns: Array,
    last: tuple[float, float],
    length: float,
    method: SwitchedRK,
    name: str | None = None,
) -> tuple[tuple[Array, Array], Array, Array, Array]:
    """Fly to each impact of a sequence ``(P, t)`` from the one before, the first from the last one.

    Gives the flights as `fly` does with minima, what must vanish, its derivative by the unknowns
    and, apart from that, the one by the last impact, a period ago.
    """
    by, sizes = _asked(system, name)
    spec, e, n = system._spec, system.e, len(unknowns)
    with listening((spec,)) as ear:
        status, (numbers, residual, own, before) = _zivi.sequence_equations(
            spec, method._core, unknowns, last, length, e, by, sizes
        )
    _check(status, ear)
    flights = _parted(numbers, n // 2, 2 + len(by))
    return flights, residual, own.reshape(n, n), before.reshape(n, n)


def _asked(system: ImpactSystem, name: str | None) -> tuple[list[int], Array]:
    """Give the number of a parameter of the force or the wall, and the sizes of the derivatives."""
    if name is None or name == "e":
        return [], UNIT
    known = parameters_of(system)
    if name not in known:
        parameter(system, name)  # which says what there is
    return [list(known).index(name)], np.array([1.0, 1.0, abs(known[name]) or 1.0])


def _check(status: int, ear: Ear) -> None:
    if (error := ear.ends(status == 0)) is not None:
        raise error
    if status:
        raise FlightError(Status(status))


def _parted(numbers: Array, k: int, n: int) -> tuple[Array, Array]:
    table = numbers.reshape(k, 6 + 2 * n)
    return table[:, :6], table[:, 6:].reshape(k, 2, n)
