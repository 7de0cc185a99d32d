"""Flights of mechanical systems in general, by `zivi.sensitivity` of the motion without gaps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.base.status import Status
from zivi.derivatives.sensitivity import sensitivity
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.flow import Contacts, Flights, Jump, Scalar
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import simulate
from zivi.system.mechanism import MechanicalSystem
from zivi.system.model_parts import Evaluation
from zivi.system.symbolic.system import SymbolicSystem

__all__ = ["NonlinearFlow"]

STEP = 1e-3
"""The step of differences of sixth order, relative to the size of what is moved."""
WEIGHTS = ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0))


class NonlinearFlow:
    """The motions of a `MechanicalSystem` with given contacts, whose forces are solved for."""

    accuracy = 0.0

    def __init__(self, system: MechanicalSystem, method: SwitchedRK) -> None:
        if system._n is None:
            raise ValueError(
                "system: its mass, force, or a gradient must tell how many coordinates"
            )
        self.system, self.method = system, method
        self.n, self.m, self.e = system._n, system.m, system.e
        self.model = system.model(self.n)
        self.open: dict[Contacts, MechanicalSystem] = {}

    def __getstate__(self) -> dict[str, Any]:
        # models do not travel: they are made again of the system
        return {"system": self.system, "method": self.method, "e": self.e}

    def __setstate__(self, state: dict[str, Any]) -> None:
        NonlinearFlow.__init__(self, state["system"], state["method"])
        self.e = state["e"]

    def at(self, t: float, z: Array) -> Evaluation:
        """Evaluate the system."""
        q, qdot = np.ascontiguousarray(z[: self.n]), np.ascontiguousarray(z[self.n :])
        return self.model.layout.read(np.array(self.model.evaluate(float(t), q, qdot)))

    def without_gaps(self, contacts: Contacts) -> MechanicalSystem:
        """Give the system whose force holds some gaps, and that has none."""
        found = self.open.get(contacts)
        if found is not None:
            return found
        if not contacts and isinstance(self.system, SymbolicSystem):
            free = self.system._without_gaps()
            if free is not None:
                self.open[contacts] = free
                return free
        given = getattr(self.system, "_given", None)
        if given is None or contacts:

            def mass(t: float, q: Array) -> Array:
                return np.array(self.at(t, np.concatenate([q, np.zeros(self.n)])).mass)

            def force(t: float, q: Array, qdot: Array) -> Array:
                here = self.at(t, np.concatenate([q, qdot]))
                held, rows = self._contact_forces(here, contacts)
                return np.asarray(here.force + rows.T @ held, np.float64)

            given = {"mass": mass, "force": force}
        names = self.system.coordinate_names(self.n)
        inputs = self.system._inputs
        found = MechanicalSystem(**given, coordinates=names, inputs=None if contacts else inputs)
        self.open[contacts] = found
        return found

    def _contact_forces(self, here: Evaluation, contacts: Contacts) -> tuple[Array, Array]:
        """Give the forces of contacts and the gradients: the gaps have no acceleration."""
        own = list(contacts)
        rows = here.gradients[own]
        if not own:
            return np.empty(0), rows
        inverse = np.linalg.inv(here.mass)
        right = -here.curvatures[own] - rows @ inverse @ here.force
        forces = np.linalg.solve(rows @ inverse @ rows.T, right)
        return np.asarray(forces, np.float64), rows

    def rate(self, contacts: Contacts, t: float, z: Array) -> Array:
        """Give the rate of the state."""
        here = self.at(t, z)
        held, rows = self._contact_forces(here, contacts)
        return np.append(z[self.n :], np.linalg.solve(here.mass, here.force + rows.T @ held))

    def fly(self, contacts: Contacts, t0: Array, z0: Array, t1: Array) -> Flights:
        """Fly k times, from times and states to times."""
        k, n = len(t0), self.n
        z, phi = np.empty((k, 2 * n)), np.empty((k, 2 * n, 2 * n))
        first, last = np.empty((k, 2 * n)), np.empty((k, 2 * n))
        system = self.without_gaps(contacts)
        for i in range(k):
            z[i], phi[i] = z0[i], np.eye(2 * n)
            if t1[i] < t0[i]:
                raise FlightError(Status.STEP_SIZE_TOO_SMALL)
            if t1[i] > t0[i]:
                span, state = (float(t0[i]), float(t1[i])), (z0[i, :n], z0[i, n:])
                s = sensitivity(system, span, state, method=self.method, dense_output=False)
                run: Any = s.trajectory
                if not run.success:
                    raise FlightError(run.status)
                z[i] = np.append(run.q[-1], run.qdot[-1])
                phi[i] = s.final.reshape(2 * n, 2 * n)
            first[i] = self.rate(contacts, t0[i], z0[i])
            last[i] = self.rate(contacts, t1[i], z[i])
        return Flights(z, phi, first, last)

    def path(self, contacts: Contacts, t0: float, z0: Array, times: Array) -> Array:
        """Give states along a flight, shape (len(times), 2n)."""
        n, end = self.n, float(np.max(times))
        if end <= t0:
            return np.tile(z0, (len(times), 1))
        run = simulate(
            self.without_gaps(contacts), (t0, end), (z0[:n], z0[n:]), self.method, t_eval=times
        )
        return np.hstack([run.q, run.qdot])

    def gap(self, i: int, t: float, z: Array) -> Scalar:
        """Give a gap."""
        here = self.at(t, z)
        row = np.append(here.gradients[i], np.zeros(self.n))
        return Scalar(float(here.gaps[i]), row, float(here.rates[i]))

    def gaps(self, times: Array, z: Array) -> tuple[Array, Array]:
        """Give all gaps and their rates, each of shape (len(times), m)."""
        all_of = [self.at(t, state) for t, state in zip(times, z, strict=True)]
        rates = [it.gradients @ s[self.n :] + it.rates for it, s in zip(all_of, z, strict=True)]
        shape = (len(times), self.m)
        return np.array([it.gaps for it in all_of]).reshape(shape), np.array(rates).reshape(shape)

    def reaction(self, contacts: Contacts, i: int, t: float, z: Array) -> Scalar:
        """Give the force of a contact."""
        place = contacts.index(i)

        def force(at: Array) -> Array:
            return self._contact_forces(self.at(float(at[0]), at[1:]), contacts)[0][
                place : place + 1
            ]

        start = np.append(t, z)
        slopes = differenced(force, start)[0]
        return Scalar(float(force(start)[0]), slopes[1:], float(slopes[0]))

    def reactions(self, contacts: Contacts, times: Array, z: Array) -> Array:
        """Give the forces of all contacts, shape (len(times), len(contacts))."""
        found = [
            self._contact_forces(self.at(t, s), contacts)[0] for t, s in zip(times, z, strict=True)
        ]
        return np.array(found)

    def impact(self, i: int, kept: Sequence[int], t: float, z: Array, e: float) -> Jump:
        """Give an impact of a gap while some contacts stay closed."""
        own = [i, *kept]
        factor = np.ones(len(own))
        factor[0] += e

        def after(at: Array) -> tuple[Array, Array]:
            """Give state and impulses, and how the state changes with the velocities."""
            here = self.at(float(at[0]), at[1:])
            rows = here.gradients[own]
            spread = np.linalg.solve(here.mass, rows.T)
            answer = -np.linalg.solve(rows @ spread, np.diag(factor))
            impulses = answer @ (rows @ at[1 + self.n :] + here.rates[own])
            moved = at[1 + self.n :] + spread @ impulses
            turned = np.eye(self.n) + spread @ answer @ rows
            slopes = np.vstack([np.zeros((self.n, self.n)), turned])
            return np.concatenate([at[1 : 1 + self.n], moved, impulses]), slopes

        start, size = np.append(t, z), 2 * self.n
        found, by_velocities = after(start)
        by_place = differenced(lambda at: after(at)[0], start, 1 + self.n)
        by_z = np.hstack([by_place[:size, 1:], by_velocities])
        return Jump(found[:size], found[size:], by_z, by_place[:size, 0])


def differenced(function: Callable[[Array], Array], at: Array, count: int | None = None) -> Array:
    """Give derivatives of a smooth function, by the first `count` numbers, of sixth order."""
    columns = []
    for k in range(len(at) if count is None else count):
        h = STEP * max(1.0, abs(float(at[k])))
        step = np.zeros(len(at))
        step[k] = h
        parts = [w * (function(at + j * step) - function(at - j * step)) for j, w in WEIGHTS]
        columns.append(np.sum(parts, axis=0) / h)
    return np.array(columns).T
