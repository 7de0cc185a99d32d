"""Flights and flows with derivatives, for the orbit equations."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.base.machine_code import CallbackErrors, listening
from zivi.base.status import Status
from zivi.derivatives.sensitivity import sensitivity
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import simulate
from zivi.system.gap import HarmonicWall, LinearGap
from zivi.system.linear import Harmonic, LinearSystem
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.model_parts import Evaluation
from zivi.system.parameters import INITIAL, codes_of, parameter, parameters_of
from zivi.system.symbolic_system import SymbolicSystem

# Flights of known length with their derivatives: what orbits are made of.

PRECISE = SwitchedRK(rtol=1e-12, atol=1e-13)
"""The tolerances of orbits, unless others are given."""
UNIT = np.ones(2)

Equations: TypeAlias = tuple[tuple[Array, Array], Array, Array, Array, Array]
Corrected: TypeAlias = tuple[Array, Array, int, float, Equations]


class FlightError(ArithmeticError):
    """Raised for a flight that cannot be computed, with a status."""

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

    Returns rows of x, xdot, the accelerations at both ends, time and height of the lowest minimum
    (infinite without one); and the derivatives of the final states with respect to the initial
    state and to the parameter `name` of force or wall, of shape (k, 2, 2 or 3).
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

    Returns the flights of `fly` with minima; the residual; its derivatives with respect to the
    unknowns and, separately, to the last impact of the previous period; and its derivative with
    respect to a parameter, empty without one.
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
    """Return the extension's equations of a sequence as shaped arrays."""
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

    `at` returns the force, the length, e and the derivative of the length at a value; magnitudes
    are the scales of unknowns and equations; limits are the required residual, the residual
    accepted if rounding stalls the iteration, and the decrease for which the derivative with
    respect to the parameter is reused. Gives how often the equations were evaluated, and the
    unknowns, the tangent, the steps, the residual, the equations; None without a solution.
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
    """Return the number by which the extension knows a parameter that the equations have."""
    (code,) = codes_of(system, (name,))
    if code in INITIAL.values():
        parameter(system, name)  # which says what there is
    return code


def _asked(system: ImpactSystem, name: str | None) -> tuple[list[int], Array]:
    """Return the number of a parameter of the force or wall, and the derivatives' sizes."""
    if name is None or name == "e":
        return [], UNIT
    known = parameters_of(system)
    if name not in known:
        parameter(system, name)  # which says what there is
    return [list(known).index(name)], np.array([1.0, 1.0, abs(known[name]) or 1.0])


def _check(status: int, ear: CallbackErrors) -> None:
    if (error := ear.ends(status == 0)) is not None:
        raise error
    if status:
        raise FlightError(Status(status))


def _parted(numbers: Array, k: int) -> tuple[Array, Array]:
    table = numbers.reshape(k, -1)
    return table[:, :6], table[:, 6:].reshape(k, 2, -1)


# Words: what happens along a periodic motion, one letter an event.
#
# ========  ===================================================
# letter    event that ends a segment
# ========  ===================================================
# ``I``     an impact of a gap
# ``S``     a plastic impact (e = 0), which closes the gap
# ``Z``     the first impact of an accumulation, which closes it
# ``L``     a contact ends, its force vanishes
# ``P``     a section: nothing happens
# ``K``     a slip ends, its channel of dry friction sticks
# ``B``     a stick breaks, its channel slips
# ``T``     a slip turns into the other direction
# ========  ===================================================

LETTERS = "ISZLP"
"""Those of words that are given: `K`, `B` and `T` come from runs."""
MOST_LETTERS = 64


@dataclasses.dataclass(frozen=True)
class Segment:
    """A flight, with some gaps closed, and the event that ends it."""

    contacts: tuple[int, ...]
    """The gaps that are closed, or channels of friction that stick; -1 - c slips backwards."""
    kind: str
    gap: int
    """That of the event; -1 for a section."""
    after: tuple[int, ...]
    """The gaps that are closed after the event."""

    @property
    def kept(self) -> tuple[int, ...]:
        """The contacts that the event leaves closed."""
        return tuple(gap for gap in self.held if gap in self.after and gap != self.gap)

    @property
    def held(self) -> tuple[int, ...]:
        """The contacts that have a force."""
        return held_of(self.contacts)


Word = tuple[Segment, ...]


def named(word: Word, gaps: Sequence[str]) -> tuple[str, ...]:
    """Return the letters with the names of the gaps."""
    return tuple(it.kind if it.gap < 0 else f"{it.kind} {gaps[it.gap]}" for it in word)


def shortened(letters: Sequence[str]) -> str:
    """Return letters in short: what repeats is counted."""
    parts: list[tuple[str, int]] = []
    for letter in letters:
        if parts and parts[-1][0] == letter:
            parts[-1] = (letter, parts[-1][1] + 1)
        else:
            parts.append((letter, 1))
    return " ".join(letter if count == 1 else f"{count}{letter}" for letter, count in parts)


def parsed(letters: Sequence[str], gaps: Sequence[str]) -> Word:
    """Read letters such as ``"I stop"``; a gap that lifts off before it closes begins closed.

    Raises
    ------
    ValueError
        For a letter or a gap that there is not, or an order that contradicts itself.
    """
    if not 1 <= len(letters) <= MOST_LETTERS:
        raise ValueError(f"start must have 1 to {MOST_LETTERS} event symbols, got {len(letters)}")
    events = [_read_event(str(letter), list(gaps)) for letter in letters]
    first: dict[int, str] = {}
    for kind, gap in events:
        if kind in "SZL":
            first.setdefault(gap, kind)
    closed = [gap for gap, kind in first.items() if kind == "L"]
    return of_events(events, closed)


def of_events(events: Sequence[tuple[str, int]], closed: Sequence[int]) -> Word:
    """Make a word of its events, from the contacts with which it begins."""
    contacts, word = tuple(sorted(closed)), []
    for kind, gap in events:
        after = contacts
        if kind in "SZ":
            after = tuple(sorted({*contacts, gap}))
        elif kind == "L":
            after = tuple(it for it in contacts if it != gap)
        if (kind in "ISZ") == (gap in contacts) and kind != "P":
            state = "closed" if gap in contacts else "open"
            raise ValueError(f"start: the word has {kind} at gap {gap}, which is {state} there")
        word.append(Segment(contacts, kind, gap, after))
        contacts = after
    if contacts != tuple(sorted(closed)):
        raise ValueError("start: the word ends with other contacts than it begins with")
    return tuple(word)


def _read_event(letter: str, gaps: list[str]) -> tuple[str, int]:
    kind, _, name = letter.strip().partition(" ")
    if kind not in LETTERS or len(kind) != 1:
        raise ValueError(f"start: an event symbol is one of I, S, Z, L, P, got {letter!r}")
    if kind == "P":
        return kind, -1
    if name in gaps:
        return kind, gaps.index(name)
    if not name and len(gaps) == 1:
        return kind, 0
    raise ValueError(f"start: {letter!r} needs one of the gaps {', '.join(gaps)}")


# Interface of motions with some gaps closed, for the equations of an orbit.

Contacts = tuple[int, ...]


def held_of(contacts: Contacts) -> Contacts:
    """Return the contacts that have a force: not the directions of slip."""
    return tuple(i for i in contacts if i >= 0)


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
        """Return one of them."""
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
    channels: int
    """How many channels of dry friction there are; then these are the gaps."""
    accuracy: float
    """What flights leave of residuals, relative to their sizes: less cannot be asked for."""

    def initial(self, z: Array) -> Any:
        """Return the initial state of a run."""

    def fly(self, contacts: Contacts, t0: Array, z0: Array, t1: Array) -> Flights:
        """Fly k times, from times and states to times."""

    def path(self, contacts: Contacts, t0: float, z0: Array, times: Array) -> Array:
        """Return states along a flight, shape (len(times), 2n)."""

    def rate(self, contacts: Contacts, t: float, z: Array) -> Array:
        """Return the rate of the state."""

    def gap(self, i: int, t: float, z: Array) -> Scalar:
        """Return a gap."""

    def gaps(self, times: Array, z: Array, contacts: Contacts = ()) -> tuple[Array, Array]:
        """Return all gaps and their rates, each of shape (len(times), m)."""

    def reaction(self, contacts: Contacts, i: int, t: float, z: Array) -> Scalar:
        """Return the force of a contact."""

    def reactions(self, contacts: Contacts, times: Array, z: Array) -> Array:
        """Return the forces of all contacts, shape (len(times), len(contacts))."""

    def impact(self, i: int, kept: Sequence[int], t: float, z: Array, e: float) -> Jump:
        """Return an impact of a gap while some contacts stay closed."""


def uncoupled(flow: Flow, gaps: Sequence[int], t: float, z: Array) -> bool:
    """Whether impacts of some gaps leave the rates of the others: their order does not matter."""
    if len(gaps) == 1:
        return True
    for i in gaps:
        after = flow.impact(i, (), t, z, 1.0).z
        both = flow.gaps(np.array([t, t]), np.array([z, after]))[1]
        moved = np.abs(both[1] - both[0])
        if any(moved[j] > 1e-12 * moved[i] for j in gaps if j != i):
            return False
    return True


# Exact flights of linear systems, free and in contact.
#
# With the loads and walls as combinations of :math:`u = (1, \cos \omega t, \sin \omega t, \dots)`,
# :math:`\dot u = S u`, every motion with given contacts is one linear equation,
#
# .. math:: \frac{d}{dt} \begin{pmatrix} z \\ u \end{pmatrix}
# = \begin{pmatrix} A & B \\ 0 & S \end{pmatrix} \begin{pmatrix} z \\ u \end{pmatrix},
#
# whose exponential is a sum of modes, or is computed directly if the eigenvectors are nearly
# dependent (rigid bodies without damping, contacts).

WORST = 1e5
"""Condition of the eigenvectors up to which modes are summed."""


def is_exact(system: object) -> bool:
    """Whether a system is linear under constants and waves, so that its flights are exact."""
    if not isinstance(system, LinearSystem):
        return False
    loads = all(isinstance(part, Harmonic | np.ndarray) for part in system.excitation)
    walls = [getattr(gap, "motion", None) for gap in system.gaps]
    return loads and all(wall is None or isinstance(wall, HarmonicWall) for wall in walls)


PADE = [math.factorial(26 - j) / math.factorial(13 - j) / math.factorial(j) for j in range(14)]
"""Coefficients of the approximation of order 13, and the norm up to which it is exact:"""
PADE_NORM = 5.37


def exponentials(matrices: Array) -> Array:
    """Return the exponentials of small matrices.

    By scaling and squaring with a Pade approximation (N. J. Higham, The scaling and squaring method
    for the matrix exponential revisited, SIAM J. Matrix Anal. Appl. 26, 2005). That of SciPy goes
    matrix by matrix, and its threads take more time than the sums.
    """
    norm = float(np.abs(matrices).sum(axis=1).max(initial=0.0))
    halvings = max(0, math.ceil(math.log2(norm / PADE_NORM))) if 0.0 < norm < math.inf else 0
    a, b, one = matrices / 2.0**halvings, PADE, np.eye(matrices.shape[-1])
    a2 = a @ a
    a4 = a2 @ a2
    a6 = a4 @ a2
    odd = a6 @ (b[13] * a6 + b[11] * a4 + b[9] * a2) + b[7] * a6 + b[5] * a4 + b[3] * a2
    even = a6 @ (b[12] * a6 + b[10] * a4 + b[8] * a2) + b[6] * a6 + b[4] * a4 + b[2] * a2
    odd, even = a @ (odd + b[1] * one), even + b[0] * one
    found = np.linalg.solve(even - odd, even + odd)
    for _ in range(halvings):
        found = found @ found
    return np.asarray(found, np.float64)


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
        """Return the first rows of the exponentials, shape (k, rows, size)."""
        if self.values is None or self.vectors is None or self.inverse is None:
            return exponentials(self.whole * times[:, None, None])[:, :rows]
        grown = np.exp(times[:, None] * self.values)
        return np.real((self.vectors[:rows] * grown[:, None, :]) @ self.inverse)


@dataclasses.dataclass(frozen=True)
class _Law:
    """An impact as linear maps: velocities with inputs, states, and inputs."""

    impulses: Array
    by_z: Array
    by_input: Array


@functools.lru_cache(maxsize=64)
def _accelerations(mass: bytes, stiffness: bytes, damping: bytes, n: int) -> tuple[Array, Array]:
    """Return the inverse of the mass matrix, and the map from states to accelerations."""
    inverse: Array = np.asarray(np.linalg.inv(np.frombuffer(mass).reshape(n, n)), np.float64)
    rows = [np.frombuffer(it).reshape(n, n) for it in (stiffness, damping)]
    state: Array = -inverse @ np.hstack(rows)
    inverse.setflags(write=False)
    state.setflags(write=False)
    return inverse, state


class LinearFlow:
    """The motions of a `LinearSystem` under constants and waves."""

    accuracy, channels = 0.0, 0

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
        """Return the place of a wave in `u` and its parts of cosine and sine."""
        if wave.omega not in self.waves:
            self.waves.append(wave.omega)
        amplitude = np.asarray(wave.amplitude, np.float64)
        place = 1 + 2 * self.waves.index(wave.omega)
        return place, amplitude * np.cos(wave.phase), -amplitude * np.sin(wave.phase)

    def mode(self, contacts: Contacts) -> _Mode:
        """Return the equation with some contacts."""
        found = self.modes.get(contacts)
        if found is None:
            found = self.modes[contacts] = self._mode(contacts)
        return found

    def _mode(self, contacts: Contacts) -> _Mode:
        n, width, held = self.n, self.load.shape[1], list(held_of(contacts))
        rows = np.hstack([self.state, self._push(contacts)])
        forces = np.empty((0, 2 * n + width))
        if held:
            own = self.normals[held]
            spread = self.inverse @ own.T
            bend = np.hstack([np.zeros((len(own), 2 * n)), self.wall_bend[held]])
            # the forces follow from N qddot = w''
            forces = np.linalg.solve(own @ spread, bend - own @ rows)
            rows = rows + spread @ forces
        whole = np.zeros((2 * n + width, 2 * n + width))
        whole[:n, n : 2 * n] = np.eye(n)
        whole[n : 2 * n] = rows
        whole[2 * n :, 2 * n :] = self.shift
        values, vectors = np.linalg.eig(whole)
        if held or np.linalg.cond(vectors) > WORST:
            return _Mode(whole, forces, None)
        return _Mode(whole, forces, values, vectors, np.linalg.inv(vectors))

    def _push(self, contacts: Contacts) -> Array:
        """Return how the inputs accelerate the coordinates with some contacts."""
        return self.push

    def inputs(self, times: Array) -> Array:
        """Return `u`, shape (k, width)."""
        found = np.ones((len(times), self.load.shape[1]))
        if self.waves:
            angles = np.multiply.outer(times, np.array(self.waves))
            found[:, 1::2], found[:, 2::2] = np.cos(angles), np.sin(angles)
        return found

    def initial(self, z: Array) -> tuple[Array, Array]:
        """Return the state with which a run begins."""
        return z[: self.n], z[self.n :]

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
        """Return states along a flight, shape (len(times), 2n)."""
        spread = self.mode(contacts).exponentials(times - t0, 2 * self.n)
        found: Array = spread @ np.append(z0, self.inputs(np.array([t0]))[0])
        return found

    def rate(self, contacts: Contacts, t: float, z: Array) -> Array:
        """Return the rate of the state."""
        found: Array = self.mode(contacts).whole[: 2 * self.n] @ self._at(t, z)
        return found

    def _at(self, t: float, z: Array) -> Array:
        return np.append(z, self.inputs(np.array([t]))[0])

    def gap(self, i: int, t: float, z: Array) -> Scalar:
        """Return a gap."""
        u = self.inputs(np.array([t]))[0]
        normal = self.normals[i]
        value = float(normal @ z[: self.n] - self.wall[i] @ u)
        return Scalar(value, np.append(normal, 0.0 * normal), -float(self.wall_rate[i] @ u))

    def gaps(self, times: Array, z: Array, contacts: Contacts = ()) -> tuple[Array, Array]:
        """Return all gaps and their rates, each of shape (len(times), m)."""
        u, n = self.inputs(times), self.n
        return (
            z[:, :n] @ self.normals.T - u @ self.wall.T,
            z[:, n:] @ self.normals.T - u @ self.wall_rate.T,
        )

    def reaction(self, contacts: Contacts, i: int, t: float, z: Array) -> Scalar:
        """Return the force of a contact."""
        row = self.mode(contacts).forces[held_of(contacts).index(i)]
        at, size = self._at(t, z), 2 * self.n
        by_t = float(row[size:] @ self.shift @ at[size:])
        return Scalar(float(row @ at), row[:size], by_t)

    def reactions(self, contacts: Contacts, times: Array, z: Array) -> Array:
        """Return the forces of all contacts, shape (len(times), len(contacts))."""
        return np.asarray(self._with_inputs(times, z) @ self.mode(contacts).forces.T, np.float64)

    def impact(self, i: int, kept: Sequence[int], t: float, z: Array, e: float) -> Jump:
        r"""Return an impact, :math:`\dot q^+ = \dot q + M^{-1} N^T P`, while some contacts stay."""
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


# Flights of mechanical systems in general, by `zivi.sensitivity` of the motion without gaps.

NONLINEAR_STEP = 1e-3
"""The step of differences of sixth order, relative to the size of what is moved."""
STENCIL = ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0))


class NonlinearFlow:
    """The motions of a `MechanicalSystem` with given contacts, whose forces are solved for."""

    accuracy, channels = 0.0, 0

    def __init__(self, system: MechanicalSystem, method: SwitchedRK) -> None:
        if system._n is None:
            raise ValueError(
                "system: the number of coordinates must follow from its mass, force or a gradient"
            )
        self.system, self.method = system, method
        self.n, self.m, self.e = system._n, system.m, system.e
        self.model = system.model(self.n)
        self.open: dict[Contacts, MechanicalSystem] = {}

    def __getstate__(self) -> dict[str, Any]:
        # models do not travel: they are made again of the system
        return {"system": self.system, "method": self.method, "e": self.e}

    def __setstate__(self, state: dict[str, Any]) -> None:
        type(self).__init__(self, state["system"], state["method"])
        self.e = state["e"]

    def initial(self, z: Array) -> tuple[Array, Array]:
        """Return the state with which a run begins."""
        return z[: self.n], z[self.n :]

    def at(self, t: float, z: Array, contacts: Contacts = ()) -> Evaluation:
        """Evaluate the system with some contacts."""
        q, qdot = np.ascontiguousarray(z[: self.n]), np.ascontiguousarray(z[self.n :])
        row = np.array(self.model.evaluate(float(t), q, qdot))
        return Evaluation(**self.model.layout.views(row))

    def without_gaps(self, contacts: Contacts) -> MechanicalSystem:
        """Return the system whose force holds some gaps, and that has none."""
        found = self.open.get(contacts)
        if found is not None:
            return found
        if not contacts and isinstance(self.system, SymbolicSystem):
            free = self.system._without_gaps()
            if free is not None:
                self.open[contacts] = free
                return free
        given = getattr(self.system, "_given", None)
        if given is None or contacts or self.channels:

            def mass(t: float, q: Array) -> Array:
                return np.array(self.at(t, np.concatenate([q, np.zeros(self.n)])).mass)

            def force(t: float, q: Array, qdot: Array) -> Array:
                here = self.at(t, np.concatenate([q, qdot]), contacts)
                return self._pull(here, contacts)

            known = self.system._mass
            given = {"mass": known if isinstance(known, np.ndarray) else mass, "force": force}
        names = self.system.coordinate_names(self.n)
        inputs = self.system._inputs
        found = MechanicalSystem(**given, coordinates=names, inputs=None if contacts else inputs)
        self.open[contacts] = found
        return found

    def _contact_forces(self, here: Evaluation, contacts: Contacts) -> tuple[Array, Array]:
        """Return the forces of contacts and the gradients: the gaps have no acceleration."""
        own, (normals, bends, _) = list(held_of(contacts)), self._rows(here)
        rows = normals[own]
        if not own:
            return np.empty(0), rows
        inverse = np.linalg.inv(here.mass)
        right = -bends[own] - rows @ inverse @ self._applied(here, contacts)
        forces = np.linalg.solve(rows @ inverse @ rows.T, right)
        return np.asarray(forces, np.float64), rows

    def _rows(self, here: Evaluation) -> tuple[Array, Array, Array]:
        """Return gradients, curvatures and rates of all gaps."""
        return here.gradients, here.curvatures, here.rates

    def _applied(self, here: Evaluation, contacts: Contacts) -> Array:
        """Return the forces without those of contacts."""
        return here.force

    def _pull(self, here: Evaluation, contacts: Contacts) -> Array:
        """Return all forces."""
        held, rows = self._contact_forces(here, contacts)
        return np.asarray(self._applied(here, contacts) + rows.T @ held, np.float64)

    def _levels(self, here: Evaluation, contacts: Contacts) -> Array:
        """Return the positive numbers of the contacts: their forces."""
        return self._contact_forces(here, contacts)[0]

    def rate(self, contacts: Contacts, t: float, z: Array) -> Array:
        """Return the rate of the state."""
        here = self.at(t, z, contacts)
        return np.append(z[self.n :], np.linalg.solve(here.mass, self._pull(here, contacts)))

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
                z[i], phi[i] = self._flown(system, t0[i], z0[i], t1[i])
            first[i] = self.rate(contacts, t0[i], z0[i])
            last[i] = self.rate(contacts, t1[i], z[i])
        return Flights(z, phi, first, last)

    def _flown(
        self, system: MechanicalSystem, t0: float, z0: Array, t1: float
    ) -> tuple[Array, Array]:
        """Return the end of a flight, and its derivative by the state at the start."""
        n, span = self.n, (float(t0), float(t1))
        state = z0[:n], z0[n:]
        s = sensitivity(system, span, state, method=self.method, dense_output=False)
        run: Any = s.trajectory
        if not run.success:
            raise FlightError(run.status)
        return np.append(run.q[-1], run.qdot[-1]), s.final.reshape(2 * n, 2 * n)

    def path(self, contacts: Contacts, t0: float, z0: Array, times: Array) -> Array:
        """Return states along a flight, shape (len(times), 2n)."""
        n, end = self.n, float(np.max(times))
        if end <= t0:
            return np.tile(z0, (len(times), 1))
        run = simulate(
            self.without_gaps(contacts), (t0, end), (z0[:n], z0[n:]), self.method, t_eval=times
        )
        return np.hstack([run.q, run.qdot])

    def gap(self, i: int, t: float, z: Array) -> Scalar:
        """Return a gap."""
        here = self.at(t, z)
        row = np.append(here.gradients[i], np.zeros(self.n))
        return Scalar(float(here.gaps[i]), row, float(here.rates[i]))

    def gaps(self, times: Array, z: Array, contacts: Contacts = ()) -> tuple[Array, Array]:
        """Return all gaps and their rates, each of shape (len(times), m)."""
        all_of = [self.at(t, state) for t, state in zip(times, z, strict=True)]
        rates = [it.gradients @ s[self.n :] + it.rates for it, s in zip(all_of, z, strict=True)]
        shape = (len(times), self.m)
        return np.array([it.gaps for it in all_of]).reshape(shape), np.array(rates).reshape(shape)

    def reaction(self, contacts: Contacts, i: int, t: float, z: Array) -> Scalar:
        """Return the force of a contact."""
        place = held_of(contacts).index(i)

        def force(at: Array) -> Array:
            here = self.at(float(at[0]), at[1:], contacts)
            return self._levels(here, contacts)[place : place + 1]

        start = np.append(t, z)
        slopes = differenced(force, start)[0]
        return Scalar(float(force(start)[0]), slopes[1:], float(slopes[0]))

    def reactions(self, contacts: Contacts, times: Array, z: Array) -> Array:
        """Return the forces of all contacts, shape (len(times), len(contacts))."""
        return np.array(
            [self._levels(self.at(t, s, contacts), contacts) for t, s in zip(times, z, strict=True)]
        )

    def impact(self, i: int, kept: Sequence[int], t: float, z: Array, e: float) -> Jump:
        """Return an impact of a gap while some contacts stay closed."""
        own = [i, *kept]
        factor = np.ones(len(own))
        factor[0] += e

        def after(at: Array) -> tuple[Array, Array]:
            """Return state and impulses, and how the state changes with the velocities."""
            here = self.at(float(at[0]), at[1:])
            normals, _, rates = self._rows(here)
            rows = normals[own]
            spread = np.linalg.solve(here.mass, rows.T)
            answer = -np.linalg.solve(rows @ spread, np.diag(factor))
            impulses = answer @ (rows @ at[1 + self.n :] + rates[own])
            moved = at[1 + self.n :] + spread @ impulses
            turned = np.eye(self.n) + spread @ answer @ rows
            slopes = np.vstack([np.zeros((self.n, self.n)), turned])
            return np.concatenate([at[1 : 1 + self.n], moved, impulses]), slopes

        start, size = np.append(t, z), 2 * self.n
        found, by_velocities = after(start)
        by_place = differenced(lambda at: after(at)[0], start, 1 + self.n)
        by_z = np.hstack([by_place[:size, 1:], by_velocities])
        return Jump(found[:size], found[size:], by_z, by_place[:size, 0])


def backward(system: MechanicalSystem) -> MechanicalSystem:
    """Return a system of two functions, mass and force, whose time runs backwards."""
    mass: Any = system._given["mass"]
    force: Any = system._given["force"]
    return MechanicalSystem(
        mass=(lambda t, q: mass(-t, q)) if callable(mass) else mass,
        force=lambda t, q, qdot: force(-t, q, -qdot),
    )


def differenced(function: Callable[[Array], Array], at: Array, count: int | None = None) -> Array:
    """Return derivatives of a smooth function, by the first `count` numbers, of sixth order."""
    columns = []
    for k in range(len(at) if count is None else count):
        h = NONLINEAR_STEP * max(1.0, abs(float(at[k])))
        step = np.zeros(len(at))
        step[k] = h
        parts = [w * (function(at + j * step) - function(at - j * step)) for j, w in STENCIL]
        columns.append(np.sum(parts, axis=0) / h)
    return np.array(columns).T


# One mass above a wall: the smallest system whose orbits are words.
#
# Its coordinate is the gap. Flights are those of `fly`, for any force and wall. As of a linear
# system the impulses :math:`P_k` and the times :math:`t_k` are the unknowns: from
# :math:`(t_k, 0, u_k)`, :math:`u_k = e P_k / (1 + e)`, to the next one,
#
# .. math:: x(t_{k+1}) = 0, \qquad (1 + e)\,\dot x(t_{k+1}^-) + P_{k+1} = 0.
#
# At rest :math:`\ddot x = 0`, and the force of the wall is minus the acceleration in flight.

MASS_STEP = 1e-6
"""Of differences of the Jacobian: only the convergence depends on it."""


class MassFlow:
    """The motions of an `ImpactSystem`, in flight and at rest at its wall."""

    n = m = 1
    channels = 0

    def __init__(self, system: ImpactSystem, method: SwitchedRK) -> None:
        self.system, self.method, self.e = system, method, np.array([system.e])
        self.accuracy = 20.0 * max(method.rtol, 1e-14)

    def initial(self, z: Array) -> tuple[float, float]:
        """Return the initial state of a run, with x < 0 by rounding set to 0."""
        return max(float(z[0]), 0.0), float(z[1])

    def fly(
        self, contacts: Contacts, t0: Array, z0: Array, t1: Array, name: str | None = None
    ) -> Flights:
        """Fly k times, from times and states to times; `name` is a parameter to derive by."""
        if contacts:
            phi = np.tile(np.eye(2), (len(t0), 1, 1))
            phi[:, 0, 1] = t1 - t0
            z, rates = np.einsum("kij,kj->ki", phi, z0), np.column_stack([z0[:, 1], 0.0 * t0])
            return Flights(z, phi, rates, rates.copy(), np.full((len(t0), 2), np.inf))
        rows = np.empty((len(t0), 4))
        rows[:, 0], rows[:, 1:3], rows[:, 3] = t0, z0, t1
        if not ((t1 > t0).all() and np.isfinite(rows).all()):
            raise FlightError(Status.STEP_SIZE_TOO_SMALL)
        return self.flights(*fly(self.system, rows, self.method, name, minima=True), z0[:, 1])

    def flights(self, ends: Array, columns: Array, speeds: Array) -> Flights:
        """Return flights by their ends and derivatives, from these speeds."""
        rates = ends.copy()
        rates[:, 0] = speeds
        by = columns[:, :, 2] if columns.shape[2] > 2 else None
        return Flights(
            ends[:, :2], columns[:, :, :2], rates[:, 0:3:2], rates[:, 1:4:2], ends[:, 4:], by
        )

    def path(self, contacts: Contacts, t0: float, z0: Array, times: Array) -> Array:
        """Return states along a flight, shape (len(times), 2)."""
        if contacts:
            return np.column_stack([z0[0] + (times - t0) * z0[1], np.full(len(times), z0[1])])
        rows = np.column_stack([np.tile([t0, *z0], (len(times), 1)), times])
        return fly(self.system, rows, self.method)[0][:, :2]

    def rate(self, contacts: Contacts, t: float, z: Array) -> Array:
        """Return the rate of the state."""
        if contacts:
            return np.array([z[1], 0.0])
        ends, _ = fly(self.system, np.array([[t, *z, t]]), self.method)
        return ends[0, 1:3].copy()

    def gap(self, i: int, t: float, z: Array) -> Scalar:
        """Return the gap."""
        return Scalar(float(z[0]), np.array([1.0, 0.0]), 0.0)

    def gaps(self, times: Array, z: Array, contacts: Contacts = ()) -> tuple[Array, Array]:
        """Return the gap and its rate, each of shape (len(times), 1)."""
        return z[:, :1], z[:, 1:]

    def reaction(self, contacts: Contacts, i: int, t: float, z: Array) -> Scalar:
        """Return the force of a contact."""
        at, parts = np.append(t, z), np.array([[j, -j] for j, _ in STENCIL]).ravel()
        h = NONLINEAR_STEP * np.maximum(1.0, np.abs(at))
        moved = at + parts[:, None, None] * np.diag(h)
        rows = np.vstack([at, moved.reshape(-1, 3)])
        forces = self.reactions(contacts, rows[:, 0], rows[:, 1:])[:, 0]
        weights = np.array([[w, -w] for _, w in STENCIL]).ravel()
        slopes = weights @ forces[1:].reshape(-1, 3) / h
        return Scalar(float(forces[0]), slopes[1:], float(slopes[0]))

    def reactions(self, contacts: Contacts, times: Array, z: Array) -> Array:
        """Return the forces of all contacts, shape (len(times), len(contacts))."""
        rows = np.column_stack([times, z, times])
        return -fly(self.system, rows, self.method)[0][:, 2:3]

    def impact(self, i: int, kept: Sequence[int], t: float, z: Array, e: float) -> Jump:
        """Return an impact."""
        after, impulse = np.array([z[0], -e * z[1]]), np.array([-(1.0 + e) * z[1]])
        return Jump(after, impulse, np.diag([1.0, -e]), np.zeros(2))


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
        """Return the derivative with respect to a parameter on which the period depends."""
        return np.asarray(self.by - longer * self.before[:, -1], np.float64)


class MassImpulses:
    """The equations of impacts in impulses, as `zivi.PeriodicImpulses` of linear systems."""

    def __init__(self, flow: MassFlow, count: int, length: float) -> None:
        self.flow, self.length = flow, length
        self.before = np.arange(-1, count - 1)
        self.e = float(flow.e[0])

    @property
    def per_speed(self) -> float:
        """Ratio of an impulse to the speed after it (before it for a plastic impact)."""
        return (1.0 + self.e) / self.e if self.e > 0.0 else 1.0

    @property
    def mobilities(self) -> Array:
        """The inverse masses, which are 1."""
        return np.ones(len(self.before))

    def states(self, y: Array) -> Array:
        """Return the states after the impacts."""
        found = np.zeros((len(y) // 2, 2))
        found[:, 1] = self.e / (1.0 + self.e) * y[::2]
        return found

    def equations(self, y: Array, name: str | None = None, last: Array | None = None) -> Evaluated:
        """Return the equations; `last` is the last impact of the previous period (default: in `y`).

        With the name of a parameter, the derivative with respect to it is added.
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
        """Return the equations from the extension's results; `push` is the last impulse before."""
        speeds = self.e / (1.0 + self.e) * y[::2][self.before]
        speeds[0] = self.e / (1.0 + self.e) * push
        return Evaluated(self.flow.flights(*flights, speeds), residual, own, before, by)

    def curvature(self, y: Array, kappa: float, w: Array, v: Array) -> tuple[Array, Array]:
        """Return the gradients of w (A + kappa B) v and of -w B v by the unknowns."""
        return self._along(y, w, v, kappa * v[-2:]), -self._along(y, w, 0.0 * v, v[-2:])

    def _along(self, y: Array, w: Array, own: Array, before: Array) -> Array:
        """Return the directional derivative of w J; the previous period has its own direction."""
        h = MASS_STEP * max(1.0, float(np.max(np.abs(y))))
        h /= max(float(np.max(np.abs(own))), float(np.max(np.abs(before)))) or 1.0
        ends: list[Any] = []
        for step in (h, -h):
            it = self.equations(y + step * own, last=y[-2:] + step * before)
            ends.append(w @ (it.own + it.before))
        return np.asarray((ends[0] - ends[1]) / (2.0 * h), np.float64)


def impact_maps(flights: Flights, e: float) -> Array:
    """Return the derivatives of ``(t, x, u)`` after each impact by those after the one before."""
    starts, found = np.empty((len(flights.z), 2, 3)), np.zeros((len(flights.z), 3, 3))
    starts[:, :, 0], starts[:, :, 1:] = -_by_start(flights), flights.phi
    with np.errstate(all="ignore"):  # infinite where the impact grazes
        found[:, 0] = -starts[:, 0] / flights.z[:, 1:]
        found[:, 2] = -e * (starts[:, 1] + flights.last[:, 1:] * found[:, 0])
    return found


def _by_start(flights: Flights) -> Array:
    """Return less the derivative of the ends by the times at the starts."""
    phi, first = flights.phi, flights.first
    return np.asarray(phi[:, :, 0] * first[:, :1] + phi[:, :, 1] * first[:, 1:], np.float64)
