r"""Exact flights of linear systems, free and in contact.

With the loads and walls as combinations of :math:`u = (1, \cos \omega t, \sin \omega t, \dots)`,
:math:`\dot u = S u`, every motion with given contacts is one linear equation,

.. math:: \frac{d}{dt} \begin{pmatrix} z \\ u \end{pmatrix}
    = \begin{pmatrix} A & B \\ 0 & S \end{pmatrix} \begin{pmatrix} z \\ u \end{pmatrix},

whose exponential is a sum of modes, or where the eigenvectors are nearly dependent (rigid bodies
without damping, contacts) is computed as such.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.orbits.mechanical.flow import Contacts, Flights, Jump, Scalar
from zivi.system.gap import HarmonicWall, LinearGap
from zivi.system.linear import Harmonic, LinearSystem

__all__ = ["LinearFlow", "is_exact"]

WORST = 1e5
"""Condition of the eigenvectors up to which modes are summed."""


def is_exact(system: object) -> bool:
    """Whether a system is linear under constants and waves, so that its flights are exact."""
    if not isinstance(system, LinearSystem):
        return False
    loads = all(isinstance(part, Harmonic | np.ndarray) for part in system.excitation)
    walls = [getattr(gap, "motion", None) for gap in system.gaps]
    return loads and all(wall is None or isinstance(wall, HarmonicWall) for wall in walls)


@dataclasses.dataclass(frozen=True)
class _Mode:
    """The linear equation with some contacts."""

    whole: Array
    """The matrix of ``(z, u)``."""
    forces: Array
    """Rows that give the forces of the contacts from ``(z, u)``."""
    values: NDArray[np.complex128] | None
    """Eigenvalues, None where the exponential is computed."""
    vectors: NDArray[np.complex128] | None = None
    inverse: NDArray[np.complex128] | None = None

    def exponentials(self, times: Array, rows: int) -> Array:
        """Give the first rows of the exponentials, shape (k, rows, size)."""
        if self.values is None or self.vectors is None or self.inverse is None:
            from scipy.linalg import expm

            found: Array = expm(self.whole * times[:, None, None])[:, :rows]
            return found
        grown = np.exp(times[:, None] * self.values)
        return np.real((self.vectors[:rows] * grown[:, None, :]) @ self.inverse)


@dataclasses.dataclass(frozen=True)
class _Law:
    """An impact as linear maps of velocities and inputs, of states, and of inputs."""

    impulses: Array
    by_z: Array
    by_input: Array


@functools.lru_cache(maxsize=64)
def _accelerations(mass: bytes, stiffness: bytes, damping: bytes, n: int) -> tuple[Array, Array]:
    """Give the inverse of the mass matrix, and what a state makes of the accelerations."""
    inverse: Array = np.asarray(np.linalg.inv(np.frombuffer(mass).reshape(n, n)), np.float64)
    rows = [np.frombuffer(it).reshape(n, n) for it in (stiffness, damping)]
    state: Array = -inverse @ np.hstack(rows)
    inverse.setflags(write=False)
    state.setflags(write=False)
    return inverse, state


class LinearFlow:
    """The motions of a `LinearSystem` under constants and waves."""

    accuracy = 0.0

    def __init__(self, system: LinearSystem) -> None:
        self.n, self.m, self.e = len(system.M), system.m, system.e
        self.waves: list[float] = []
        gaps = [gap for gap in system.gaps if isinstance(gap, LinearGap)]
        self.normals = np.array([gap.normal for gap in gaps]).reshape(self.m, self.n)
        loads = [self._wave(it) for it in system.excitation if isinstance(it, Harmonic)]
        walls = [self._wave(it.motion) for it in gaps if isinstance(it.motion, HarmonicWall)]
        width = 1 + 2 * len(self.waves)
        self.load, self.wall = np.zeros((self.n, width)), np.zeros((self.m, width))
        for part in system.excitation:
            if isinstance(part, np.ndarray):
                self.load[:, 0] += part
        for place, cosine, sine in loads:
            self.load[:, place] += cosine
            self.load[:, place + 1] += sine
        for i, gap in enumerate(gaps):
            self.wall[i, 0] -= gap.offset
            if isinstance(gap.motion, HarmonicWall):
                place, cosine, sine = walls.pop(0)
                self.wall[i, 0] += gap.motion.offset
                self.wall[i, place : place + 2] += [cosine, sine]
        self.shift = np.zeros((width, width))
        for k, omega in enumerate(self.waves):
            self.shift[1 + 2 * k, 2 + 2 * k], self.shift[2 + 2 * k, 1 + 2 * k] = -omega, omega
        self.wall_rate = self.wall @ self.shift
        self.wall_bend = self.wall_rate @ self.shift
        self.inverse, self.state = _accelerations(
            system.M.tobytes(), system.K.tobytes(), system.C.tobytes(), self.n
        )
        self.push = self.inverse @ self.load
        self.modes: dict[Contacts, _Mode] = {}
        self.laws: dict[tuple[Contacts, float], _Law] = {}

    def _wave(self, wave: Harmonic | HarmonicWall) -> tuple[int, Array, Array]:
        """Give the place of a wave in `u` and its parts of cosine and sine."""
        if wave.omega not in self.waves:
            self.waves.append(wave.omega)
        amplitude = np.asarray(wave.amplitude, np.float64)
        place = 1 + 2 * self.waves.index(wave.omega)
        return place, amplitude * np.cos(wave.phase), -amplitude * np.sin(wave.phase)

    def mode(self, contacts: Contacts) -> _Mode:
        """Give the equation with some contacts."""
        found = self.modes.get(contacts)
        if found is None:
            found = self.modes[contacts] = self._mode(contacts)
        return found

    def _mode(self, contacts: Contacts) -> _Mode:
        n, width = self.n, self.load.shape[1]
        rows = np.hstack([self.state, self.push])
        forces = np.empty((0, 2 * n + width))
        if contacts:
            own = self.normals[list(contacts)]
            spread = self.inverse @ own.T
            bend = np.hstack([np.zeros((len(own), 2 * n)), self.wall_bend[list(contacts)]])
            # N qddot = w'' gives the forces
            forces = np.linalg.solve(own @ spread, bend - own @ rows)
            rows = rows + spread @ forces
        whole = np.zeros((2 * n + width, 2 * n + width))
        whole[:n, n : 2 * n] = np.eye(n)
        whole[n : 2 * n] = rows
        whole[2 * n :, 2 * n :] = self.shift
        values, vectors = np.linalg.eig(whole)
        if contacts or np.linalg.cond(vectors) > WORST:
            return _Mode(whole, forces, None)
        return _Mode(whole, forces, values, vectors, np.linalg.inv(vectors))

    def inputs(self, times: Array) -> Array:
        """Give `u`, shape (k, width)."""
        found = np.ones((len(times), self.load.shape[1]))
        if self.waves:
            angles = np.multiply.outer(times, np.array(self.waves))
            found[:, 1::2], found[:, 2::2] = np.cos(angles), np.sin(angles)
        return found

    def _with_inputs(self, times: Array, z: Array) -> Array:
        return np.hstack([z, self.inputs(times)])

    def fly(self, contacts: Contacts, t0: Array, z0: Array, t1: Array) -> Flights:
        """Fly k times, from times and states to times."""
        mode, size = self.mode(contacts), 2 * self.n
        spread = mode.exponentials(t1 - t0, size)
        begin = self._with_inputs(t0, z0)
        z = np.einsum("kij,kj->ki", spread, begin)
        rows = mode.whole[:size].T
        return Flights(z, spread[:, :, :size], begin @ rows, self._with_inputs(t1, z) @ rows)

    def path(self, contacts: Contacts, t0: float, z0: Array, times: Array) -> Array:
        """Give states along a flight, shape (len(times), 2n)."""
        spread = self.mode(contacts).exponentials(times - t0, 2 * self.n)
        found: Array = spread @ np.append(z0, self.inputs(np.array([t0]))[0])
        return found

    def rate(self, contacts: Contacts, t: float, z: Array) -> Array:
        """Give the rate of the state."""
        found: Array = self.mode(contacts).whole[: 2 * self.n] @ self._at(t, z)
        return found

    def _at(self, t: float, z: Array) -> Array:
        return np.append(z, self.inputs(np.array([t]))[0])

    def gap(self, i: int, t: float, z: Array) -> Scalar:
        """Give a gap."""
        u = self.inputs(np.array([t]))[0]
        normal = self.normals[i]
        value = float(normal @ z[: self.n] - self.wall[i] @ u)
        return Scalar(value, np.append(normal, 0.0 * normal), -float(self.wall_rate[i] @ u))

    def gaps(self, times: Array, z: Array) -> tuple[Array, Array]:
        """Give all gaps and their rates, each of shape (len(times), m)."""
        u, n = self.inputs(times), self.n
        return (
            z[:, :n] @ self.normals.T - u @ self.wall.T,
            z[:, n:] @ self.normals.T - u @ self.wall_rate.T,
        )

    def reaction(self, contacts: Contacts, i: int, t: float, z: Array) -> Scalar:
        """Give the force of a contact."""
        row = self.mode(contacts).forces[contacts.index(i)]
        at, size = self._at(t, z), 2 * self.n
        by_t = float(row[size:] @ self.shift @ at[size:])
        return Scalar(float(row @ at), row[:size], by_t)

    def reactions(self, contacts: Contacts, times: Array, z: Array) -> Array:
        """Give the forces of all contacts, shape (len(times), len(contacts))."""
        return np.asarray(self._with_inputs(times, z) @ self.mode(contacts).forces.T, np.float64)

    def impact(self, i: int, kept: Sequence[int], t: float, z: Array, e: float) -> Jump:
        r"""Give an impact, :math:`\dot q^+ = \dot q + M^{-1} N^T P`, while some contacts stay."""
        law = self._law((i, *kept), e)
        u = self.inputs(np.array([t]))[0]
        impulses = law.impulses @ np.concatenate([z[self.n :], u])
        by_t = law.by_input @ (self.shift @ u)
        return Jump(law.by_z @ z + law.by_input @ u, impulses, law.by_z, by_t)

    def _law(self, own: tuple[int, ...], e: float) -> _Law:
        key = (own, e)
        found = self.laws.get(key)
        if found is not None:
            return found
        n, rows = self.n, list(own)
        normals = self.normals[rows]
        spread = self.inverse @ normals.T
        factor = np.ones(len(rows))
        factor[0] += e
        # G P = -(1 + e) gdot of the gap that is hit, -gdot of the contacts
        solved = -np.linalg.solve(normals @ spread, np.diag(factor))
        impulses = solved @ np.hstack([normals, -self.wall_rate[rows]])
        by_z, by_input = np.eye(2 * n), np.zeros((2 * n, self.load.shape[1]))
        by_z[n:, n:] += spread @ impulses[:, :n]
        by_input[n:] = spread @ impulses[:, n:]
        self.laws[key] = _Law(impulses, by_z, by_input)
        return self.laws[key]
