r"""One mass above a wall: the smallest system whose orbits are words.

Its coordinate is the gap. Flights are those of `zivi.orbits.flights`, for any force and wall. As of
a linear system the impulses :math:`P_k` and the times :math:`t_k` are the unknowns: from
:math:`(t_k, 0, u_k)`, :math:`u_k = e P_k / (1 + e)`, to the next one,

.. math:: x(t_{k+1}) = 0, \qquad (1 + e)\,\dot x(t_{k+1}^-) + P_{k+1} = 0.

A mass that rests needs no equations: its lift-off is known, see `zivi.orbits.rest`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from zivi.base.check import Array
from zivi.base.status import Status
from zivi.orbits.flights import FlightError, fly, sequence_equations
from zivi.orbits.mechanical.flow import Contacts, Flights, Jump, Scalar
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem

__all__ = ["Evaluated", "MassFlow", "MassImpulses", "impact_maps"]

STEP = 1e-6
"""Of differences of the Jacobian: only the convergence depends on it."""


class MassFlow:
    """The motions of an `ImpactSystem` in flight."""

    n = m = 1

    def __init__(self, system: ImpactSystem, method: SwitchedRK) -> None:
        self.system, self.method, self.e = system, method, np.array([system.e])
        self.accuracy = 20.0 * max(method.rtol, 1e-14)

    def fly(
        self, contacts: Contacts, t0: Array, z0: Array, t1: Array, name: str | None = None
    ) -> Flights:
        """Fly k times, from times and states to times; `name` is a parameter to derive by."""
        rows = np.empty((len(t0), 4))
        rows[:, 0], rows[:, 1:3], rows[:, 3] = t0, z0, t1
        if not ((t1 > t0).all() and np.isfinite(rows).all()):
            raise FlightError(Status.STEP_SIZE_TOO_SMALL)
        return self.flights(*fly(self.system, rows, self.method, name, minima=True), z0[:, 1])

    def flights(self, ends: Array, columns: Array, speeds: Array) -> Flights:
        """Give flights by their ends and derivatives, from these speeds."""
        rates = ends.copy()
        rates[:, 0] = speeds
        by = columns[:, :, 2] if columns.shape[2] > 2 else None
        return Flights(
            ends[:, :2], columns[:, :, :2], rates[:, 0:3:2], rates[:, 1:4:2], ends[:, 4:], by
        )

    def path(self, contacts: Contacts, t0: float, z0: Array, times: Array) -> Array:
        """Give states along a flight, shape (len(times), 2)."""
        rows = np.column_stack([np.tile([t0, *z0], (len(times), 1)), times])
        return fly(self.system, rows, self.method)[0][:, :2]

    def rate(self, contacts: Contacts, t: float, z: Array) -> Array:
        """Give the rate of the state."""
        ends, _ = fly(self.system, np.array([[t, *z, t]]), self.method)
        return ends[0, 1:3].copy()

    def gap(self, i: int, t: float, z: Array) -> Scalar:
        """Give the gap."""
        return Scalar(float(z[0]), np.array([1.0, 0.0]), 0.0)

    def gaps(self, times: Array, z: Array) -> tuple[Array, Array]:
        """Give the gap and its rate, each of shape (len(times), 1)."""
        return z[:, :1], z[:, 1:]

    def reaction(self, contacts: Contacts, i: int, t: float, z: Array) -> Scalar:
        """Give the force of a contact."""
        raise NotImplementedError(RESTS)

    def reactions(self, contacts: Contacts, times: Array, z: Array) -> Array:
        """Give the forces of contacts."""
        raise NotImplementedError(RESTS)

    def impact(self, i: int, kept: Sequence[int], t: float, z: Array, e: float) -> Jump:
        """Give an impact."""
        after, impulse = np.array([z[0], -e * z[1]]), np.array([-(1.0 + e) * z[1]])
        return Jump(after, impulse, np.diag([1.0, -e]), np.zeros(2))


RESTS = "a mass that rests is simulated from its lift-off"


class Evaluated(NamedTuple):
    """The equations of impacts at some unknowns."""

    flights: Flights
    """To the impacts."""
    residual: Array
    own: Array
    """Its derivative by the unknowns."""
    before: Array
    """Apart from that, the one by the last impact, a period ago."""
    by: Array
    """The one by a parameter at a fixed period, empty without one."""

    def by_parameter(self, longer: float) -> Array:
        """Give the derivative by a parameter by which the period has one, too."""
        return np.asarray(self.by - longer * self.before[:, -1], np.float64)


class MassImpulses:
    """The equations of impacts in impulses, as `zivi.PeriodicImpulses` of linear systems."""

    def __init__(self, flow: MassFlow, count: int, length: float) -> None:
        self.flow, self.length = flow, length
        self.before = np.arange(-1, count - 1)
        self.e = float(flow.e[0])

    @property
    def per_speed(self) -> float:
        """How large an impulse is beside the speed after it, or where it is plastic before it."""
        return (1.0 + self.e) / self.e if self.e > 0.0 else 1.0

    @property
    def mobilities(self) -> Array:
        """The inverse masses, which are 1."""
        return np.ones(len(self.before))

    def states(self, y: Array) -> Array:
        """Give the states after the impacts."""
        found = np.zeros((len(y) // 2, 2))
        found[:, 1] = self.e / (1.0 + self.e) * y[::2]
        return found

    def equations(self, y: Array, name: str | None = None, last: Array | None = None) -> Evaluated:
        """Give the equations; `last` is what the last impact was a period ago if not as in `y`.

        With the name of a parameter they are derived by that, too.
        """
        y = np.ascontiguousarray(y)
        push, time = (y if last is None else last)[-2:].tolist()
        found = sequence_equations(
            self.flow.system, y, (push, time), self.length, self.flow.method, name
        )
        return self.evaluated(y, push, *found)

    def evaluated(
        self,
        y: Array,
        push: float,
        flights: tuple[Array, Array],
        residual: Array,
        own: Array,
        before: Array,
        by: Array,
    ) -> Evaluated:
        """Give the equations by what the extension found, the last impulse a period ago `push`."""
        speeds = self.e / (1.0 + self.e) * y[::2][self.before]
        speeds[0] = self.e / (1.0 + self.e) * push
        return Evaluated(self.flow.flights(*flights, speeds), residual, own, before, by)

    def curvature(self, y: Array, kappa: float, w: Array, v: Array) -> tuple[Array, Array]:
        """Give the gradients of w (A + kappa B) v and of -w B v by the unknowns."""
        return self._along(y, w, v, kappa * v[-2:]), -self._along(y, w, 0.0 * v, v[-2:])

    def _along(self, y: Array, w: Array, own: Array, before: Array) -> Array:
        """Give the change of w J along a direction, of the last impact a period ago another one."""
        h = STEP * max(1.0, float(np.max(np.abs(y))))
        h /= max(float(np.max(np.abs(own))), float(np.max(np.abs(before)))) or 1.0
        ends: list[Any] = []
        for step in (h, -h):
            it = self.equations(y + step * own, last=y[-2:] + step * before)
            ends.append(w @ (it.own + it.before))
        return np.asarray((ends[0] - ends[1]) / (2.0 * h), np.float64)


def impact_maps(flights: Flights, e: float) -> Array:
    """Give the derivatives of ``(t, x, u)`` after each impact by those after the one before."""
    starts, found = np.empty((len(flights.z), 2, 3)), np.zeros((len(flights.z), 3, 3))
    starts[:, :, 0], starts[:, :, 1:] = -_by_start(flights), flights.phi
    with np.errstate(all="ignore"):  # infinite where the impact grazes
        found[:, 0] = -starts[:, 0] / flights.z[:, 1:]
        found[:, 2] = -e * (starts[:, 1] + flights.last[:, 1:] * found[:, 0])
    return found


def _by_start(flights: Flights) -> Array:
    """Give less the derivative of the ends by the times at the starts."""
    phi, first = flights.phi, flights.first
    return np.asarray(phi[:, :, 0] * first[:, :1] + phi[:, :, 1] * first[:, 1:], np.float64)
