r"""Orbits as sequences of impacts: unknowns are their times and the speeds after them.

With the flight from ``(t_i, 0, u_i)`` to ``t_j``, the last one to ``t_1 + m T``,

.. math:: x(t_j) = 0, \qquad u_j + e\,\dot x(t_j) = 0.

Every flight is a smooth problem of known length: nothing is searched for, and the equations are
regular where an impact grazes and beyond (``u < 0``, which no motion has).

Where nothing excites the system every shift of the times is an orbit too: the first impact is put
at ``t = 0``, and the period `T` takes the place of its time among the unknowns. A motion without
impacts starts at its highest point then, with the unknowns ``(x, T)`` instead of ``(x, xdot)``.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.base.status import Status
from zivi.orbits.flights import FlightError, Legs, fly
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import excitation

__all__ = [
    "Equations",
    "Frame",
    "Solution",
    "canonical",
    "equations",
    "newton",
    "size_of",
    "unknowns_of",
]

MOST_STEPS = 20
HALVINGS = 6


@dataclasses.dataclass(frozen=True)
class Frame:
    """What stays the same while unknowns move: how many periods, and the phase of a flight."""

    multiple: int
    period: float | None
    """The period where the system does not tell."""
    method: SwitchedRK
    start: float = 0.0
    """Where an orbit without impacts is looked at (s)."""
    free: bool = False
    """Whether nothing excites the system, and the period is an unknown."""

    def period_of(self, system: ImpactSystem) -> float:
        """Give the period of the excitation of a system."""
        if self.period is not None:
            return self.period
        omega, _ = excitation(system)
        if omega is None:
            raise ValueError("period: the excitation has no single period")
        return 2.0 * math.pi / omega

    def period_by(self, system: ImpactSystem, name: str | None) -> float:
        """Give the derivative of the period by a parameter."""
        omega, of = excitation(system)
        if self.free or self.period is not None or omega is None or name is None or name != of:
            return 0.0
        return -2.0 * math.pi / omega**2

    def length(self, system: ImpactSystem, y: Array) -> float:
        """Give after how long an orbit repeats."""
        if self.free:
            return float(y[1] if y.ndim == 1 else y[0, 0])
        return self.multiple * self.period_of(system)

    def rows(self, system: ImpactSystem, y: Array) -> Array:
        """Give the flights of an orbit: start, state, end."""
        length = self.length(system, y)
        if y.ndim == 1:
            xdot = 0.0 if self.free else y[1]
            return np.array([[self.start, y[0], xdot, self.start + length]])
        listed = self.listed(y)
        ends = np.append(listed[1:, 0], listed[0, 0] + length)
        return np.column_stack([listed[:, 0], np.zeros(len(y)), y[:, 1], ends])

    def listed(self, y: Array) -> Array:
        """Give the impacts, rows ``(t, u)``, of the unknowns of an orbit."""
        if not self.free:
            return y
        rows = y.copy()
        rows[0, 0] = 0.0
        return rows

    def unknowns(self, rows: Array, length: float) -> Array:
        """Give the unknowns of the orbit with these impacts."""
        return unknowns_of(rows, length) if self.free else rows


def unknowns_of(rows: Array, length: float) -> Array:
    """Give the unknowns of an orbit with a free period: its length instead of the first time."""
    y = rows - np.array([rows[0, 0], 0.0])
    y[0, 0] = length
    return np.asarray(y, np.float64)


@dataclasses.dataclass(frozen=True)
class Equations:
    """The equations at some unknowns: an array of rows ``(t, u)``, or ``(x, xdot)`` in flight."""

    y: Array
    residual: Array
    jacobian: Array
    by: Array
    """Derivative by the parameter, zero without one."""
    legs: Legs
    maps: list[Array]
    """Derivatives of ``(t, u)`` at each impact by that before it."""

    @property
    def monodromy(self) -> Array:
        """The derivative of the return map."""
        product = np.eye(2)
        with np.errstate(invalid="ignore"):
            for each in self.maps:
                product = each @ product
        return product

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """The eigenvalues of the monodromy; not finite at a grazing."""
        monodromy = self.monodromy
        if not np.all(np.isfinite(monodromy)):
            return np.array([np.inf, 0.0], np.complex128)
        return np.asarray(np.linalg.eigvals(monodromy), np.complex128)

    @property
    def lowest(self) -> tuple[float, float]:
        """The lowest minimum in flight, and when."""
        i = int(np.argmin(self.legs.x_low))
        return float(self.legs.x_low[i]), float(self.legs.t_low[i])

    @property
    def depth(self) -> float:
        """How high, or deep, the nearest grazing is (m)."""
        pulled = self.legs.last > 0.0
        heights = self.legs.v[pulled] ** 2 / (2.0 * self.legs.last[pulled])
        impacts = float(np.min(heights, initial=np.inf)) if self.y.ndim == 2 else np.inf
        return min(abs(self.lowest[0]), impacts)


def equations(
    system: ImpactSystem, frame: Frame, y: Array, name: str | None = None, minima: bool = False
) -> Equations:
    """Evaluate the equations and their derivatives."""
    rows = frame.rows(system, y)
    if np.any(rows[:, 3] <= rows[:, 0]) or not np.all(np.isfinite(rows)):
        raise FlightError(Status.STEP_SIZE_TOO_SMALL)
    legs = fly(system, rows, name, minima=minima, method=frame.method)
    if y.ndim == 1:
        return _of_flight(system, frame, y, legs, name)
    k, e, u = len(y), system.e, y[:, 1]
    residual = np.empty((k, 2))
    jacobian, by = np.zeros((k, 2, k, 2)), np.zeros((k, 2))
    scale = np.array([1.0, e])
    for i in range(k):
        j = (i + 1) % k
        residual[i] = legs.x[i], u[j] + e * legs.v[i]
        end = scale * [legs.v[i], legs.last[i]]
        if i or not frame.free:
            jacobian[i, :, i, 0] -= scale * (legs.phi[i] @ [u[i], legs.first[i]])
        jacobian[i, :, i, 1] += scale * legs.phi[i][:, 1]
        jacobian[i, :, j, 0] += end
        jacobian[i, 1, j, 1] += 1.0
        if name == "e":
            by[i, 1] = legs.v[i]
        elif name is not None:
            by[i] = scale * legs.by[i]
        if j == 0:
            by[i] += end * frame.multiple * frame.period_by(system, name)
    maps = [legs.map(i, u[i], e) for i in range(k)]
    flat = jacobian.reshape(2 * k, 2 * k)
    return Equations(y, residual.ravel(), flat, by.ravel(), legs, maps)


def _of_flight(
    system: ImpactSystem, frame: Frame, y: Array, legs: Legs, name: str | None
) -> Equations:
    """Evaluate ``P(z) - z`` of an orbit without impacts."""
    by = np.zeros(2) if name in (None, "e") else legs.by[0].copy()
    by += np.array([legs.v[0], legs.last[0]]) * frame.multiple * frame.period_by(system, name)
    end = np.array([legs.x[0], legs.v[0]])
    if frame.free:
        start, own = np.array([y[0], 0.0]), np.array([1.0, 0.0])
        jacobian = np.column_stack([legs.phi[0][:, 0] - own, [legs.v[0], legs.last[0]]])
        return Equations(y, end - start, jacobian, by, legs, [legs.phi[0]])
    return Equations(y, end - y, legs.phi[0] - np.eye(2), by, legs, [legs.phi[0]])


@dataclasses.dataclass(frozen=True)
class Solution:
    """What Newton's iteration found."""

    equations: Equations
    iterations: int
    residual: float
    converged: bool
    trace: list[float]
    """The residual at each step."""


def size_of(system: ImpactSystem, frame: Frame, at: Equations) -> Array:
    """Give the sizes of the residuals: of a distance and a speed, alternating.

    The speed is the largest of the motion. Near a grazing, and after plastic impacts, speeds at the
    wall are small, not the motion: it is not less than a part of what the force gives.
    """
    y, legs = at.y, at.legs
    time = frame.length(system, y) / frame.multiple / (2.0 * math.pi)
    speed = 0.1 * time * float(np.max(np.abs([legs.first, legs.last])))
    if y.ndim == 2:
        speed = max(speed, float(np.max(np.abs([y[:, 1], legs.v]))))
    else:
        speed = max(speed, 0.0 if frame.free else abs(y[1]), abs(y[0]) / time)
    return np.tile([speed * time, speed], max(1, y.size // 2))


def newton(system: ImpactSystem, frame: Frame, y: Array, most: int = MOST_STEPS) -> Solution:
    """Solve the equations for the unknowns, from a guess."""
    now = equations(system, frame, y)
    size = size_of(system, frame, now)
    error = float(np.max(np.abs(now.residual / size)))
    trace, tolerance = [error], 20.0 * max(frame.method.rtol, 1e-14)
    for step in range(most):
        if error <= tolerance:
            return Solution(now, step, error, True, trace)
        try:
            move = np.asarray(-np.linalg.solve(now.jacobian, now.residual), np.float64)
        except np.linalg.LinAlgError:
            break
        found = _damped(system, frame, now, move.reshape(y.shape), size, error)
        if found is None:
            break
        now, error = found
        trace.append(error)
    return Solution(now, len(trace) - 1, error, error <= tolerance, trace)


def _damped(
    system: ImpactSystem, frame: Frame, now: Equations, move: Array, size: Array, error: float
) -> tuple[Equations, float] | None:
    """Go along a step as far as the residual does not grow much."""
    part = 1.0
    for _ in range(HALVINGS):
        try:
            there = equations(system, frame, now.y + part * move)
        except FlightError:
            part *= 0.5
            continue
        new = float(np.max(np.abs(there.residual / size)))
        if new <= 2.0 * error or new < 1e-3:
            return there, new
        part *= 0.5
    return None


def canonical(y: Array, period: float, length: float) -> Array:
    """Give the impacts from that of the smallest phase on, its time within the first period."""
    if y.ndim == 1:
        return y
    phases = y[:, 0] % period
    first = int(np.argmin(phases))
    shift = phases[first] - y[first, 0]
    turned = np.roll(y, -first, axis=0)
    if first == 0 and shift == 0.0:
        return y
    times = turned[:, 0] + shift
    times[len(y) - first :] += length
    return np.column_stack([times, turned[:, 1]])
