"""Flights of known length with their derivatives: what orbits are made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.base.machine_code import Ear, listening
from zivi.base.status import Status
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import INITIAL, codes_of, parameter, parameters_of

__all__ = ["PRECISE", "FlightError", "corrected", "fly", "sequence_equations"]

PRECISE = SwitchedRK(rtol=1e-12, atol=1e-13)
"""The tolerances of orbits, unless others are given."""
UNIT = np.ones(2)

Equations: TypeAlias = tuple[tuple[Array, Array], Array, Array, Array, Array]
Corrected: TypeAlias = tuple[Array, Array, int, float, Equations]


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
    return _parted(numbers, len(rows))


def sequence_equations(
    system: ImpactSystem,
    unknowns: Array,
    last: tuple[float, float],
    length: float,
    method: SwitchedRK,
    name: str | None = None,
) -> Equations:
    """Fly to each impact of a sequence ``(P, t)`` from the one before, the first from the last one.

    Gives the flights as `fly` does with minima, what must vanish, its derivative by the unknowns
    and, apart from that, the one by the last impact, a period ago; at last the one by a parameter,
    empty without one.
    """
    spec = system._spec
    wrt = None if name is None else (code_of(system, name), abs(parameter(system, name)) or 1.0)
    with listening((spec,)) as ear:
        status, found = _zivi.sequence_equations(
            spec, method._core, unknowns, last, length, system.e, wrt
        )
    _check(status, ear)
    return equations_of(found)


def equations_of(found: list[Array]) -> Equations:
    """Give shape to what the extension gives of the equations of a sequence."""
    numbers, residual, own, before, by = found
    n = len(residual)
    return _parted(numbers, n // 2), residual, own.reshape(n, n), before.reshape(n, n), by


def corrected(
    at: Callable[[float], tuple[_zivi.Force, float, float, float]],
    system: ImpactSystem,
    method: SwitchedRK,
    name: str,
    plane: tuple[Array, Array],
    magnitudes: tuple[Array, Array],
    evaluations: int,
    limits: tuple[float, float, float],
) -> tuple[int, Corrected | None]:
    """Solve the equations of a sequence and a parameter in a hyperplane, a point and a normal.

    `at` gives the force, the length, e and the derivative of the length at a value; magnitudes are
    those of the unknowns and of the equations; limits the residual that is sought, the one that is
    enough where rounding stalls, and the fall that keeps the derivative by the parameter. Gives how
    often the equations were evaluated, and the unknowns, the tangent, the steps, the residual, the
    equations; None without a solution.
    """
    code = code_of(system, name)
    with listening((system._spec,)) as ear:
        count, found = _zivi.correct_sequence(
            at, method._core, code, *plane, *magnitudes, evaluations, limits
        )
    if (error := ear.ends(found is not None)) is not None:
        raise error
    return count, None if found is None else (*found[:4], equations_of(found[4]))


def code_of(system: ImpactSystem, name: str) -> int:
    """Give the number by which the extension knows a parameter that the equations have."""
    (code,) = codes_of(system, (name,))
    if code in INITIAL.values():
        parameter(system, name)  # which says what there is
    return code


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


def _parted(numbers: Array, k: int) -> tuple[Array, Array]:
    table = numbers.reshape(k, -1)
    return table[:, :6], table[:, 6:].reshape(k, 2, -1)
