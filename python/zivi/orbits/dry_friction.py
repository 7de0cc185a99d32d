r"""Motions whose joints slip or stick, for the equations of an orbit.

A channel of dry friction counts as a gap whose value is its slip speed
:math:`w_c = B_c \dot q + \beta_c`: it is closed while it sticks. While it slips in the direction
:math:`\sigma_c` its force is :math:`-\sigma_c L_c B_c^T`, whatever the sign of `w`, so that the
equations are regular at and past the end of a slip. While it sticks, :math:`\dot w_c = 0`, and the
force `f` that maintains it is below the static limit,

.. math:: \frac{L_s^2 - f^2}{2 L_s} > 0.

The stick ends where this level vanishes, at either sign of `f`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.orbits.flows import (
    Contacts,
    Flights,
    LinearFlow,
    NonlinearFlow,
    Scalar,
    backward,
    differenced,
    held_of,
    is_exact,
)
from zivi.simulation.methods import SwitchedRK
from zivi.system.linear import LinearSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.model_parts import Evaluation

EXTRAPOLATION = (4.0, -6.0, 4.0, -1.0)
"""Weights of values at 0, w, 2 w, 3 w for the value of a cubic polynomial at -w."""


def slip_signs(contacts: Contacts, count: int) -> Array:
    """Return the directions of slip of the channels, 0 while sticking."""
    signs = np.ones(count)
    signs[[i for i in contacts if i >= 0]] = 0.0
    signs[[-1 - i for i in contacts if i < 0]] = -1.0
    return signs


def friction_flow_of(system: MechanicalSystem, method: SwitchedRK) -> LinearFlow | NonlinearFlow:
    """Return the motions of a system with dry friction in joints."""
    if is_exact(system) and all(_is_constant(joint) for joint in system.friction):
        assert isinstance(system, LinearSystem)
        return LinearFrictionFlow(system)
    return NonlinearFrictionFlow(system, method)


def _is_constant(joint: Any) -> bool:
    numbers = joint.limit, joint._slip.limit if joint.static is None else joint.static
    steady = joint._slip.is_steady() and joint._slip.motion is None
    return steady and all(np.ndim(it) == 0 and not callable(it) for it in numbers)


class LinearFrictionFlow(LinearFlow):
    """The motions of a `LinearSystem` whose joints have constant limits and belt speeds."""

    def __init__(self, system: LinearSystem) -> None:
        super().__init__(system)
        slips = [joint._slip for joint in system.friction]
        self.m = self.channels = len(slips)
        self.e, width = np.zeros(self.m), self.load.shape[1]
        self.normals = np.array([it.direction for it in slips], np.float64)
        self.limits = np.array([float(np.asarray(it.limit)) for it in slips])
        static = [it.limit if it.static is None else it.static for it in slips]
        self.statics = np.array([float(np.asarray(it)) for it in static])
        self.wall_rate = np.zeros((self.m, width))
        self.wall_rate[:, 0] = [-float(np.asarray(it.rate)) for it in slips]
        self.wall = self.wall_bend = np.zeros((self.m, width))

    def _push(self, contacts: Contacts) -> Array:
        drag = slip_signs(contacts, self.m) * self.limits
        found: Array = self.push.copy()
        found[:, 0] -= self.inverse @ self.normals.T @ drag
        return found

    def gap(self, i: int, t: float, z: Array) -> Scalar:
        """Return a slip speed."""
        u, row = self.inputs(np.array([t]))[0], self.normals[i]
        value = float(row @ z[self.n :] - self.wall_rate[i] @ u)
        return Scalar(value, np.append(0.0 * row, row), 0.0)

    def gaps(self, times: Array, z: Array, contacts: Contacts = ()) -> tuple[Array, Array]:
        """Return the slip speeds in the directions of slip and their rates."""
        signs, with_inputs = slip_signs(contacts, self.m), self._with_inputs(times, z)
        speeds = z[:, self.n :] @ self.normals.T - self.inputs(times) @ self.wall_rate.T
        rows = self.mode(contacts).whole[self.n : 2 * self.n]
        return signs * speeds, signs * (with_inputs @ rows.T @ self.normals.T)

    def reaction(self, contacts: Contacts, i: int, t: float, z: Array) -> Scalar:
        """Return the level of static friction that a channel has left."""
        force, most = super().reaction(contacts, i, t, z), float(self.statics[i])
        slope = -force.value / most
        level = 0.5 * (most - force.value**2 / most)
        return Scalar(level, slope * force.by_z, slope * force.by_t)

    def reactions(self, contacts: Contacts, times: Array, z: Array) -> Array:
        """Return the levels of all channels that stick."""
        most = self.statics[list(held_of(contacts))]
        return np.asarray(0.5 * (most - super().reactions(contacts, times, z) ** 2 / most))


class NonlinearFrictionFlow(NonlinearFlow):
    """The motions of a `MechanicalSystem` with dry friction in joints."""

    def __init__(self, system: MechanicalSystem, method: SwitchedRK) -> None:
        super().__init__(system, method)
        self.m = self.channels = len(system.channel_names)
        self.e = np.zeros(self.m)
        self.reversed: dict[Contacts, MechanicalSystem] = {}
        self._constant = all(isinstance(it.limit, np.ndarray) for it in system._slips())

    def _rows(self, here: Evaluation) -> tuple[Array, Array, Array]:
        return here.tangents, here.slip_curvatures, here.slip_rates

    def _applied(self, here: Evaluation, contacts: Contacts) -> Array:
        drag = slip_signs(contacts, self.m) * here.limits
        return np.asarray(here.force - here.tangents.T @ drag, np.float64)

    def at(self, t: float, z: Array, contacts: Contacts = ()) -> Evaluation:
        """Evaluate the system; limits go on smoothly where a slip has passed its end.

        A limit that depends on the size of the slip speed has a kink at zero. Beyond it, at `-w`,
        it is extrapolated from the values at 0, `w`, `2 w` and `3 w`.
        """
        here = super().at(t, z)
        speeds = here.tangents @ z[self.n :] + here.slip_rates
        past = np.flatnonzero(slip_signs(contacts, self.m) * speeds < 0.0)
        if not len(past) or self._constant:
            return here
        rows, z = here.tangents[past], z.copy()
        spread = np.linalg.solve(here.mass, rows.T)
        move = spread @ np.linalg.solve(rows @ spread, speeds[past])
        limits = here.limits.copy()
        limits[past] = 0.0
        for weight in EXTRAPOLATION:
            z[self.n :] -= move
            limits[past] += weight * super().at(t, z).limits[past]
        return dataclasses.replace(here, limits=limits)

    def _levels(self, here: Evaluation, contacts: Contacts) -> Array:
        most = here.static_limits[list(held_of(contacts))]
        force = self._contact_forces(here, contacts)[0]
        return np.asarray(0.5 * (most - force**2 / most), np.float64)

    def fly(self, contacts: Contacts, t0: Array, z0: Array, t1: Array) -> Flights:
        """Fly k times; a stick that would last a negative time is flown backwards."""
        found = super().fly(contacts, t0, z0, np.maximum(t0, t1))
        turn = np.append(np.ones(self.n), -np.ones(self.n))
        for i in np.flatnonzero(t1 < t0):
            if contacts not in self.reversed:
                self.reversed[contacts] = backward(self.without_gaps(contacts))
            end, phi = self._flown(self.reversed[contacts], -t0[i], turn * z0[i], -t1[i])
            found.z[i], found.phi[i] = turn * end, turn[:, None] * phi * turn
            found.last[i] = self.rate(contacts, t1[i], found.z[i])
        return found

    def gap(self, i: int, t: float, z: Array) -> Scalar:
        """Return a slip speed."""

        def speed(at: Array) -> Array:
            here = self.at(float(at[0]), at[1:])
            return here.tangents[[i]] @ at[1 + self.n :] + here.slip_rates[[i]]

        start = np.append(t, z)
        slopes = differenced(speed, start)[0]
        return Scalar(float(speed(start)[0]), slopes[1:], float(slopes[0]))

    def gaps(self, times: Array, z: Array, contacts: Contacts = ()) -> tuple[Array, Array]:
        """Return the slip speeds in the directions of slip and their rates."""
        signs, speeds, rates = slip_signs(contacts, self.m), [], []
        for t, state in zip(times, z, strict=True):
            here = self.at(t, state, contacts)
            speeds.append(here.tangents @ state[self.n :] + here.slip_rates)
            bend = self.rate(contacts, t, state)[self.n :]
            rates.append(here.tangents @ bend + here.slip_curvatures)
        shape = (len(times), self.m)
        return signs * np.array(speeds).reshape(shape), signs * np.array(rates).reshape(shape)

    def impact(self, i: int, kept: Sequence[int], t: float, z: Array, e: float) -> Any:
        """Return the projection of the velocities onto sticking channels, of which one is new."""
        return super().impact(i, kept, t, z, 0.0)
