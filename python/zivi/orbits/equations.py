"""Equations of an event sequence, Newton iteration, Floquet multipliers."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zivi._zivi import PeriodicImpulses
from zivi.base.check import Array, real_array
from zivi.base.status import Status
from zivi.derivatives.sensitivity import sensitivity
from zivi.orbits.flows import (
    WORST,
    Evaluated,
    FlightError,
    Flights,
    Flow,
    LinearFlow,
    MassFlow,
    MassImpulses,
    Scalar,
    Segment,
    Word,
    impact_maps,
)
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem

# Linear systems as modes, for the equations in impulses.
#
# Every motion is the sum of the forced response and the response to the impulses. With the
# eigenvalues :math:`\lambda` and eigenvectors `V` of the free motion the kernel of a gap `i` for
# impulses of a gap `j` is
#
# .. math:: G_{ij}(d) = \sum_\lambda (n_i V)_\lambda (V^{-1} M^{-1} n_j)_\lambda e^{\lambda d}.

UNDAMPED = 1e-9
"""How near 1 a multiplier of the free motion may be: beyond, it resonates with the impulses."""

Complex = NDArray[np.complex128]


class _Modes(NamedTuple):
    """Modal data, independent of loads, walls and periods. Of conjugate pairs one mode is kept."""

    state: Array
    """Matrix of the free motion."""
    values: Complex
    parts: dict[str, Array]
    """Of the equations, complex numbers as pairs."""


@functools.lru_cache(maxsize=32)
def _modes(state: bytes, inverse: bytes, normals: bytes, n: int) -> _Modes | None:
    """Return the modes; None where eigenvectors nearly depend on each other."""
    whole = np.zeros((2 * n, 2 * n))
    whole[:n, n:] = np.eye(n)
    whole[n:] = np.frombuffer(state).reshape(n, 2 * n)
    values, vectors = np.linalg.eig(whole)
    if np.linalg.cond(vectors) > WORST:
        return None
    kept = np.imag(values) >= 0.0
    twice = np.where(np.imag(values[kept]) > 0.0, 2.0, 1.0)[:, None]
    back = np.linalg.inv(vectors)[kept] * twice
    values, vectors = values[kept], vectors[:, kept]
    rows = np.frombuffer(normals).reshape(-1, n)
    spread = np.frombuffer(inverse).reshape(n, n) @ rows.T
    inputs = back[:, n:] @ spread
    weights = (rows @ vectors[:n])[:, None, :] * inputs.T[None, :, :]
    parts = {
        "rates": _real_pairs(values),
        "kernels": _real_pairs(weights * values ** np.arange(4)[:, None, None, None]),
        "vectors": _real_pairs(vectors),
        "inputs": _real_pairs(inputs.T),
        "pushes": np.vstack([np.zeros_like(spread), spread]).T.copy(),
        "mobilities": np.einsum("in,ni->i", rows, spread),
    }
    return _Modes(whole, values.astype(np.complex128), parts)


def _real_pairs(values: NDArray[Any]) -> Array:
    return np.stack([np.real(values), np.imag(values)], axis=-1)


@functools.lru_cache(maxsize=64)
def _resolvent(whole: bytes, size: int, omega: float) -> Complex:
    """Return the response to a harmonic load of unit amplitude, as a matrix."""
    matrix = np.frombuffer(whole).reshape(size, size)
    found = np.linalg.inv(1j * omega * np.eye(size) - matrix)[:, size // 2 :]
    return np.asarray(found, np.complex128)


def _forced(flow: LinearFlow, whole: Array) -> Array:
    """Return the states of the forced response, columns of a constant, then cosines and sines."""
    n, push = flow.n, flow.push
    found = np.zeros((2 * n, push.shape[1]))
    key = whole.tobytes()
    if push[:, 0].any():
        found[:, 0] = (_resolvent(key, 2 * n, 0.0) @ push[:, 0]).real
    for k, omega in enumerate(flow.waves):
        moved = _resolvent(key, 2 * n, omega) @ (push[:, 1 + 2 * k] - 1j * push[:, 2 + 2 * k])
        found[:, 1 + 2 * k], found[:, 2 + 2 * k] = moved.real, -moved.imag
    return found


def periodic_impulses(
    flow: LinearFlow, gaps: Sequence[int], period: float
) -> PeriodicImpulses | None:
    """Return the equations of impacts in impulses; None where the free motion has no such modes."""
    modes = _modes(flow.state.tobytes(), flow.inverse.tobytes(), flow.normals.tobytes(), flow.n)
    if modes is None or np.min(np.abs(1.0 - np.exp(modes.values * period))) < UNDAMPED:
        return None
    states = _forced(flow, modes.state)
    return PeriodicImpulses(
        list(gaps),
        period=period,
        forced_gaps=flow.normals @ states[: flow.n] - flow.wall,
        forced_states=states,
        omegas=np.array(flow.waves),
        e=flow.e,
        **modes.parts,
    )


# The frame of an orbit: data that are constant while the unknowns change.


@dataclasses.dataclass(frozen=True)
class Frame:
    """Data that are constant while the unknowns change."""

    system: Any
    """A `MechanicalSystem`, or an `ImpactSystem`, whose flow is a `MassFlow`."""
    flow: Flow
    word: Word
    method: SwitchedRK
    length: float
    """After how long the word closes: periods, or half of them (s). A guess if it is free."""
    free: bool = False
    turn: Array | None = None
    r""":math:`\Sigma`, of shape (2n, 2n), of a symmetric word."""
    section: float | int = 0.0
    """Of the letter P: a time, or as an int the coordinate that is highest."""

    @functools.cached_property
    def impulses(self) -> PeriodicImpulses | MassImpulses | None:
        """The equations in impulses, where there are such."""
        if self.free or self.turn is not None:
            return None
        if any(it.kind != "I" or it.contacts for it in self.word):
            return None
        if isinstance(self.flow, MassFlow):
            return MassImpulses(self.flow, len(self.word), self.length)
        if not isinstance(self.flow, LinearFlow):
            return None
        return periodic_impulses(self.flow, [it.gap for it in self.word], self.length)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out cached data."""
        return {name: value for name, value in vars(self).items() if name != "impulses"}

    @property
    def size(self) -> int:
        """The number of unknowns of an event."""
        return 2 * self.flow.n + 2 if self.impulses is None else 2

    def split(self, y: Array) -> tuple[Array, float]:
        """Return the segments, rows ``(t, z, tau)``, and the length."""
        if self.impulses is not None:
            times, states = y[1::2], self.impulses.states(y)
            x = np.empty((len(times), states.shape[1] + 2))
            x[1:, 0], x[1:, 1:-1], x[:, -1] = times[:-1], states[:-1], times
            x[0, 0], x[0, 1:-1] = times[-1] - self.length, states[-1]
            return x, self.length
        x = y.reshape(len(self.word), self.size).copy()
        if not self.free:
            return x, self.length
        length, x[0, 0] = float(x[0, 0]), 0.0
        return x, length

    def joined(self, x: Array, length: float) -> Array:
        """Return the vector of unknowns from the segments."""
        if self.impulses is not None:
            ends = self.flow.fly((), x[:, 0], x[:, 1:-1], x[:, -1]).z
            own = [it.gap for it in self.word]
            rates = self.flow.gaps(x[:, -1], ends)[1][np.arange(len(x)), own]
            impulses = -(1.0 + self.flow.e[own]) * rates / self.impulses.mobilities
            return np.column_stack([impulses, x[:, -1]]).ravel()
        y = x.copy()
        if self.free:
            y[:, 0] -= x[0, 0]
            y[:, -1] -= x[0, 0]
            y[0, 0] = length
        return y.ravel()


# The letter Z: from the first impact of an accumulation to shortly after its end.

AFTER = 1e-7
"""How long after its end an accumulation hands on to the contact, in periods."""


@dataclasses.dataclass(frozen=True)
class Accumulation:
    """An accumulation from the state after its first impact."""

    zeno: float
    """When it ends."""
    t: float
    """A little later, where its map ends."""
    z: Array
    by_z: Array
    """Derivatives of ``(t, z)`` by the state at the start, shape (1 + 2n, 2n)."""
    by_t: Array
    """And by its time."""
    impacts: Any
    """The impacts that were computed."""


def onto(flow: Flow, closed: Sequence[int], t: float, z: Array, rates: Sequence[int] = ()) -> Array:
    """Move a state by rounding so that gaps are closed, and some of them do not move."""
    z, n = z.copy(), flow.n
    if flow.channels:
        return flow.impact(rates[0], rates[1:], t, z, 0.0).z if len(rates) else z
    for _ in range(2):
        for wanted, place, own in ((0, 0, closed), (1, n, rates)):
            if not len(own):
                continue
            off = np.array([flow.gaps(np.array([t]), z[None])[wanted][0, i] for i in own])
            normals = np.array([flow.gap(i, t, z).by_z[:n] for i in own])
            z[place : place + n] -= np.linalg.pinv(normals) @ off
    return z


def after_event(
    system: Any,
    method: SwitchedRK,
    flow: Flow,
    segment: Segment,
    t: float,
    before: Array,
    length: float,
) -> Array:
    """Return time and state after the event that ends a segment, a row ``(t, z)``."""
    if segment.kind in "LPBT":
        return np.append(t, before)
    e = 0.0 if segment.kind in "SK" else float(flow.e[segment.gap])
    jump = flow.impact(segment.gap, segment.kept, t, before, e)
    if segment.kind != "Z":
        return np.append(t, jump.z)
    begin = onto(flow, [segment.gap, *segment.kept], t, jump.z, segment.kept)
    chain = accumulated(system, method, (t, begin), segment.gap, length, slopes=False)
    return np.append(chain.t, chain.z)


def accumulated(
    system: Any,
    method: SwitchedRK,
    start: tuple[float, Array],
    gap: int,
    horizon: float,
    *,
    slopes: bool = True,
) -> Accumulation:
    """Simulate an accumulation with its derivatives.

    Raises
    ------
    FlightError
        If the impacts on the gap do not accumulate within the horizon.
    """
    t, z = start
    if isinstance(system, ImpactSystem):
        return _accumulated_mass(system, method, t, float(z[1]), horizon, slopes=slopes)
    n = len(z) // 2
    state = z[:n], z[n:]
    after = AFTER * horizon
    run = simulate(system, (t, t + horizon), state, method, dense_output=False)
    ends = run.zeno["t"][run.zeno["gap"] == gap]
    if not len(ends):
        raise FlightError(Status.STEP_SIZE_TOO_SMALL)
    zeno = float(ends[0])
    hits: Any = run.resolved_impacts
    hits = hits[(hits["t"] <= zeno) & (hits["t"] > t)]
    end = zeno + after
    if not slopes:
        run = simulate(system, (t, end), state, method, dense_output=False)
        z = np.append(run.q[-1], run.qdot[-1])
        none = np.full((1 + 2 * n, 2 * n), np.nan)
        return Accumulation(zeno, end, z, none, none[:, 0], hits)
    names = ("q0", "qdot0", "t0")
    s = sensitivity(system, (t, end), state, names, method, dense_output=False)
    sol: Any = s.trajectory
    place = [k for k, row in enumerate(sol.zeno) if row["gap"] == gap]
    if not place or not sol.contacts[-1, gap]:
        raise FlightError(Status.STEP_SIZE_TOO_SMALL)
    moved = s.zeno_times[place[0]]
    z = np.append(sol.q[-1], sol.qdot[-1])
    columns = s.final.reshape(2 * n, 2 * n + 1)
    # the end moves with the accumulation
    rate = _rate(system, end, z, sol, n)
    columns = columns + np.outer(rate, moved)
    whole = np.vstack([moved, columns])
    own = float(sol.zeno["t"][place[0]])
    return Accumulation(own, own + (end - zeno), z, whole[:, : 2 * n], whole[:, 2 * n], hits)


def _accumulated_mass(
    system: ImpactSystem, method: SwitchedRK, t: float, u: float, horizon: float, *, slopes: bool
) -> Accumulation:
    """Simulate that of one mass, which rests from the end of it on."""
    run = simulate(system, (t, t + horizon), (0.0, u), method, dense_output=False)
    if not len(run.zeno_times):
        raise FlightError(Status.STEP_SIZE_TOO_SMALL)
    zeno, hits = float(run.zeno_times[0]), impact_rows(run)
    by = np.zeros((3, 3))
    if slopes:
        span, names = (t, zeno + AFTER * horizon), ("x0", "xdot0", "t0")
        s = sensitivity(system, span, (0.0, u), names, method, dense_output=False)
        by[0] = s.zeno_times[0]
    hits = hits[(hits["t"] <= zeno) & (hits["t"] > t)]
    return Accumulation(zeno, zeno, np.zeros(2), by[:, :2], by[:, 2], hits)


HIT = np.dtype([(name, "f8") for name in ("t", "speed_before", "speed_after", "impulse")]
               + [("gap", "i8"), ("group", "i8")])  # fmt: skip


def impact_rows(run: Trajectory) -> NDArray[np.void]:
    """Return the computed impacts of one mass, as those of a gap."""
    own = run.resolved_impacts
    found = np.zeros(len(own), HIT)
    found["t"], before, after = own["t"], own["xdot_before"], own["xdot_after"]
    found["speed_before"], found["speed_after"], found["impulse"] = before, after, after - before
    found["group"] = np.arange(len(own))
    return found


def _rate(system: MechanicalSystem, t: float, z: Array, sol: Any, n: int) -> Array:
    """Return the rate of the state in contact."""
    at = system.at(t, z[:n], z[n:])
    inverse = np.linalg.inv(at.mass)
    free = inverse @ at.force
    own = np.flatnonzero(sol.contacts[-1])
    if len(own):
        rows = at.gradients[own]
        spread = inverse @ rows.T
        free = free - spread @ np.linalg.solve(rows @ spread, rows @ free + at.curvatures[own])
    return np.append(z[n:], free)


# The equations of a word: durations and states of all segments are unknowns.
#
# Segment `s` starts at :math:`(t_s, z_s)` and ends with its event at :math:`\tau_s`,
#
# .. math:: E_s(\tau_s, z^-_s) = 0, \qquad (t_{s+1}, z_{s+1}) = R_s(\tau_s, z^-_s),
#
# the last one with :math:`(t_1 + L, z_1)`, or :math:`(t_1 + L, \Sigma z_1)` of a symmetric motion.
# No root search for events is needed: the equations are regular at and past a grazing. The Jacobian
# is block cyclic, and
#
# .. math:: J(\theta) = A + e^{i \theta} B, \qquad B = \partial(t_1 + L, \Sigma z_1),
#
# is singular if a multiplier is :math:`e^{i \theta}`, even if another one is infinite.
#
# Where nothing excites the system, :math:`t_1 = 0` and `L` takes its place among the unknowns.

SEGMENT_STEP = 1e-5
"""Of differences of the Jacobian: only the convergence depends on it."""
DEPENDENT = 1e-3
"""Parts of vectors that are smaller than this change only the convergence, too."""


@dataclasses.dataclass(frozen=True)
class SegmentTerms:
    """The equations of segments at some unknowns."""

    frame: Frame
    y: Array
    x: Array
    length: float
    residual: Array
    blocks: Array
    r"""The diagonal blocks of `A`, shape (k, 2n + 2, 2n + 2)."""
    flights: Flights
    rates: Array
    """Of each event along the motion: the speed with which a gap closes, or a force vanishes."""
    impulses: list[Array]
    """Of each event, that of its gap first, then of the contacts that stay."""
    accumulations: dict[int, Accumulation]
    maps: Array
    """Derivatives of ``(t, z)`` from the start of each segment to the next."""

    def matrix(self, factor: complex = 1.0) -> Any:
        r""":math:`J`, with the factor :math:`e^{i \\theta}` at the closing rows."""
        frame = self.frame
        k, size, _ = self.blocks.shape
        kind = np.float64 if np.imag(factor) == 0.0 else np.complex128
        whole: Any = np.zeros((k, size, k, size), kind)
        at = np.arange(k)
        whole[at, :, at, :] = self.blocks
        for s in range(k - 1):
            whole[s, 1:, s + 1, :-1] += np.eye(size - 1)
        last = np.eye(size - 1)
        if frame.turn is not None:
            last[1:, 1:] = frame.turn
        whole[k - 1, 1:, 0, :-1] += (np.real(factor) if kind is np.float64 else factor) * last
        if frame.free and factor == 1.0:
            # the length instead of the first time
            whole[:, :, 0, 0] = 0.0
            whole[k - 1, 1, 0, 0] = 1.0
        return whole.reshape(k * size, k * size)

    def by_multiplier(self) -> Array:
        """Return the derivative of the matrix by the factor."""
        moved: Array = 0.5 * (self.matrix(1.0 + 1e-300j).real - self.matrix(-1.0))
        return moved

    def turned(self, kappa: float) -> tuple[Array, Array]:
        r"""Return the real matrix of a pair with :math:`\kappa = \cos \theta`, and its derivative.

        .. math:: \begin{pmatrix} A & B \\ -B & A + 2 \kappa B \end{pmatrix}
        """
        b = self.by_multiplier()
        a = self.matrix(-1.0) + b
        zero = np.zeros_like(b)
        return (
            np.block([[a, b], [-b, a + 2.0 * kappa * b]]),
            np.block([[zero, zero], [zero, 2.0 * b]]),
        )

    def curvature(self, factor: float, w: Array, v: Array) -> Array:
        """Return the gradient of w J v by the unknowns, of the matrix with a factor."""
        return np.asarray(w @ self._along(v, factor), np.float64)

    def turned_curvature(self, kappa: float, w: Array, v: Array) -> list[Array]:
        """Return the gradients of w J v of the matrix of a pair, w and v of shape (2n, 2).

        With v = (p, q) also (-q, p + 2 kappa q) vanishes with the matrix: of the four parts of two
        vectors only two are independent.
        """
        n = len(w) // 2
        parts = np.column_stack([v[:n], v[n:]])
        left, sizes, right = np.linalg.svd(parts, full_matrices=False)
        count = int(np.sum(sizes > DEPENDENT * sizes[0]))
        moved = [self._along(left[:, k], -1.0) for k in range(count)]
        weights = sizes[:count, None] * right[:count]
        each = [sum(a * it for a, it in zip(w_, moved, strict=True)) for w_ in weights.T]
        changes = [each[:2], each[2:]]
        return [w[:n, i] @ changes[0][j] + w[n:, i] @ changes[1][j] for i in (0, 1) for j in (0, 1)]

    def _along(self, v: Array, factor: float) -> Array:
        """Return the derivative of the matrix along a direction of the unknowns."""
        frame, y = self.frame, self.y
        largest = float(np.max(np.abs(v))) or 1.0
        h = SEGMENT_STEP * max(1.0, float(np.max(np.abs(y[1:])))) / largest
        moved = v.copy()
        if frame.free:
            moved[0] = 0.0
        ends: list[Array] = []
        for step in (h, -h):
            x, length = frame.split(y + step * moved)
            if frame.free and factor != 1.0:
                x[0, 0] += step * v[0]
            ends.append(of_segments(frame, y, x, length).matrix(factor))
        found = np.asarray((ends[0] - ends[1]) / (2.0 * h), np.float64)
        if frame.free:
            # the length is in no matrix
            found[:, 0] = 0.0
        return found

    def rate_gradient(self, s: int) -> Array:
        """Return the derivative of the speed before an impact by the unknowns."""
        frame = self.frame
        gap, tau = frame.word[s].gap, float(self.x[s, -1])
        z, size = self.flights.z[s], len(self.flights.z[s])

        def rate(t: float, state: Array) -> float:
            return float(frame.flow.gaps(np.array([t]), state[None])[1][0, gap])

        h = 1e-6
        by_z = np.array([rate(tau, z + h * e) - rate(tau, z - h * e) for e in np.eye(size)])
        by_t = (rate(tau + h, z) - rate(tau - h, z)) / (2.0 * h)
        own = self.flights
        ends = np.column_stack([-own.phi[s] @ own.first[s], own.phi[s], own.last[s]])
        gradient = np.zeros(len(self.y))
        row = by_z / (2.0 * h) @ ends
        row[-1] += by_t
        gradient[s * frame.size : (s + 1) * frame.size] = row
        if frame.free:
            gradient[0] = 0.0
        return gradient

    @property
    def segments(self) -> SegmentTerms:
        """Itself."""
        return self

    def return_map(self, first: int = 0) -> Array:
        """Return the derivative of ``(t, z)`` at a segment's start one word later."""
        size = self.maps.shape[1]
        product = np.eye(size)
        count = len(self.maps)
        with np.errstate(all="ignore"):
            for s in range(first, first + count):
                product = self.maps[s % count] @ product
                if s % count == count - 1 and self.frame.turn is not None:
                    back = np.eye(size)
                    back[1:, 1:] = np.linalg.inv(self.frame.turn)
                    product = back @ product
        return product


def of_segments(
    frame: Frame, y: Array, x: Array, length: float, *, slopes: bool = True
) -> SegmentTerms:
    """Evaluate the equations of segments, and their derivatives."""
    if not np.all(np.isfinite(x)) or np.max(np.abs(x[:, -1] - x[:, 0])) > 1e3 * abs(length):
        raise FlightError(Status.STEP_SIZE_TOO_SMALL)
    flights = _flown(frame, x)
    k, size = x.shape
    residual, blocks = np.empty((k, size)), np.zeros((k, size, size))
    maps, rates = np.empty((k, size - 1, size - 1)), np.empty(k)
    impulses: list[Array] = []
    chains: dict[int, Accumulation] = {}
    held = [i for i in frame.word[0].held if all(i in it.contacts for it in frame.word)]
    for s, segment in enumerate(frame.word):
        own = flights.of(s)
        tau = float(x[s, -1])
        event = _event_function(frame, segment, tau, own.z)
        # dz- = Phi dz - Phi f0 dt + f1 dtau
        ends = np.column_stack([-own.phi @ own.first, own.phi, own.last])
        mapped = _mapped(frame, segment, tau, own.z, length, slopes)
        if held and s + 1 == k:
            mapped = _held(frame, held, mapped)
        blocks[s, 0] = event.by_z @ ends
        blocks[s, 0, -1] += event.by_t
        blocks[s, 1:] = -mapped.by_z @ ends
        blocks[s, 1:, -1] -= mapped.by_t
        rates[s] = blocks[s, 0, -1]
        residual[s, 0] = event.value
        following = x[s + 1, :-1] if s + 1 < k else _closing(frame, x, length)
        residual[s, 1:] = following - np.append(mapped.t, mapped.z)
        with np.errstate(all="ignore"):
            moved = -blocks[s, 0, :-1] / rates[s]
            maps[s] = -blocks[s, 1:, :-1] - np.outer(blocks[s, 1:, -1], moved)
        impulses.append(mapped.impulses)
        if mapped.chain is not None:
            chains[s] = mapped.chain
    return SegmentTerms(
        frame, y, x, length, residual.ravel(), blocks, flights, rates, impulses, chains, maps
    )


def _closing(frame: Frame, x: Array, length: float) -> Array:
    z = x[0, 1:-1] if frame.turn is None else frame.turn @ x[0, 1:-1]
    return np.append(x[0, 0] + length, z)


def _flown(frame: Frame, x: Array) -> Flights:
    """Fly all segments, those with the same contacts together."""
    kinds = [segment.contacts for segment in frame.word]
    if len(set(kinds)) == 1:
        return frame.flow.fly(kinds[0], x[:, 0], x[:, 1:-1], x[:, -1])
    k, width = len(x), x.shape[1] - 2
    rows = [np.empty((k, width)) for _ in range(3)]
    lows = np.empty((k, 2)) if isinstance(frame.flow, MassFlow) else None
    found = Flights(rows[0], np.empty((k, width, width)), rows[1], rows[2], lows)
    for contacts in dict.fromkeys(kinds):
        own = [s for s in range(k) if kinds[s] == contacts]
        part = frame.flow.fly(contacts, x[own, 0], x[own, 1:-1], x[own, -1])
        found.z[own], found.phi[own] = part.z, part.phi
        found.first[own], found.last[own] = part.first, part.last
        if lows is not None:
            lows[own] = part.lows
    return found


def _event_function(frame: Frame, segment: Segment, tau: float, z: Array) -> Scalar:
    """Return the residual at the end of a segment."""
    flow, n = frame.flow, frame.flow.n
    if segment.kind == "P":
        if isinstance(frame.section, float):
            return Scalar(tau - frame.section, np.zeros(2 * n), 1.0)
        row = np.zeros(2 * n)
        row[n + frame.section] = 1.0
        return Scalar(float(z[n + frame.section]), row, 0.0)
    if segment.kind in "LB":
        return flow.reaction(segment.contacts, segment.gap, tau, z)
    found = flow.gap(segment.gap, tau, z)
    if -1 - segment.gap in segment.contacts:
        return Scalar(-found.value, -found.by_z, -found.by_t)
    return found


@dataclasses.dataclass(frozen=True)
class _Mapped:
    """Image of time and state under an event, with its derivatives, shape (1 + 2n, ...)."""

    t: float
    z: Array
    by_z: Array
    by_t: Array
    impulses: Array
    chain: Accumulation | None = None


def _mapped(
    frame: Frame, segment: Segment, tau: float, z: Array, length: float, slopes: bool
) -> _Mapped:
    flow, size = frame.flow, len(z)
    by_z, by_t = np.zeros((1 + size, size)), np.zeros(1 + size)
    by_z[1:], by_t[0] = np.eye(size), 1.0
    if segment.kind in "LPBT":
        return _Mapped(tau, z, by_z, by_t, np.empty(0))
    plastic = segment.kind in "SK"
    e = 0.0 if plastic else float(flow.e[segment.gap])
    jump = flow.impact(segment.gap, segment.kept, tau, z, e)
    by_z[1:], by_t[1:] = jump.by_z, jump.by_t
    if segment.kind != "Z":
        return _Mapped(tau, jump.z, by_z, by_t, jump.impulses)
    horizon, closed = abs(length), [segment.gap, *segment.kept]
    if isinstance(flow, MassFlow):
        own = jump.by_z.copy()
        own[0] = 0.0
        chain = accumulated(frame.system, frame.method, (tau, jump.z), 0, horizon, slopes=slopes)
        return _Mapped(chain.t, chain.z, chain.by_z @ own, chain.by_t, jump.impulses, chain)
    begin = onto(flow, closed, tau, jump.z, segment.kept)
    start = tau, begin
    chain = accumulated(frame.system, frame.method, start, segment.gap, horizon, slopes=slopes)
    # the start is put onto the closed gaps: what is across them does not count
    across = np.array([flow.gap(i, tau, begin).by_z[: flow.n] for i in closed])
    inverse = np.linalg.pinv(across)
    own, moved = jump.by_z.copy(), jump.by_t.copy()
    own[: flow.n] -= inverse @ across @ own[: flow.n]
    moved[: flow.n] = -inverse @ np.array([flow.gap(i, tau, begin).by_t for i in closed])
    by_t = chain.by_z @ moved + chain.by_t
    return _Mapped(chain.t, chain.z, chain.by_z @ own, by_t, jump.impulses, chain)


def _held(frame: Frame, held: list[int], mapped: _Mapped) -> _Mapped:
    """Project the state onto permanently closed gaps, which no event of the sequence closes."""
    flow, n, t, z = frame.flow, frame.flow.n, mapped.t, mapped.z
    if flow.channels:
        jump = flow.impact(held[0], held[1:], t, z, 0.0)
        whole = np.eye(1 + 2 * n)
        whole[1:, 0], whole[1:, 1:] = jump.by_t, jump.by_z
        by_z, by_t = whole @ mapped.by_z, whole @ mapped.by_t
        return dataclasses.replace(mapped, z=jump.z, by_z=by_z, by_t=by_t)
    own = [flow.gap(i, t, z) for i in held]
    inverse = np.linalg.pinv(np.array([it.by_z[:n] for it in own]))
    h = 1e-6

    def rates(t: float, z: Array) -> Array:
        return np.asarray(flow.gaps(np.array([t]), z[None])[1][0, held], np.float64)

    by_z = np.array([rates(t, z + h * e) - rates(t, z - h * e) for e in np.eye(2 * n)]).T
    by_t = rates(t + h, z) - rates(t - h, z)
    across = np.vstack([[it.by_z for it in own], by_z / (2.0 * h)])
    moving = np.concatenate([[it.by_t for it in own], by_t / (2.0 * h)])
    back = np.zeros((2 * n, 2 * len(held)))
    back[:n, : len(held)], back[n:, len(held) :] = inverse, inverse
    whole = np.eye(1 + 2 * n)
    whole[1:, 1:] -= back @ across
    whole[1:, 0] = -back @ moving
    state = onto(flow, held, t, z, held)
    return dataclasses.replace(mapped, z=state, by_z=whole @ mapped.by_z, by_t=whole @ mapped.by_t)


# The equations of a linear system whose events are impacts: times and impulses are unknown.
#
# With the impulses :math:`P_k` at :math:`t_k` and their effect on the gaps (see `modes`), each
# impact has two equations,
#
# .. math:: g_k(t_k) = 0, \qquad (1 + e_k)\,\dot g_k(t_k^-) + D_k P_k = 0,
#
# whatever the number of coordinates. They are regular where an impact grazes, `P = 0`, and so is
# their Jacobian :math:`J(\theta) = R(\kappa) + i \sin\theta\,S(\kappa)` for disturbances that turn
# by :math:`\theta` a period, :math:`\kappa = \cos\theta`.

IMPULSE_STEP = 1e-6
"""Of a difference by kappa: only the convergence depends on it."""


class ImpulseTerms:
    """The equations at some unknowns, rows ``(P, t)`` of the impacts."""

    def __init__(self, frame: Frame, y: Array) -> None:
        assert frame.impulses is not None
        self.frame, self.y, self.length = frame, y, frame.length
        self.kernel: Any = frame.impulses
        self.accumulations: dict[int, Accumulation] = {}
        self.residual, self.rates, self.jacobian = self._evaluated()

    def _evaluated(self) -> tuple[Array, Array, Array]:
        """Return the residual, the speeds before the impacts, the derivative."""
        times = self.y[1::2]
        if not np.isfinite(self.y).all() or times.max() - times.min() > 1e3 * abs(self.length):
            raise FlightError(Status.STEP_SIZE_TOO_SMALL)
        found: tuple[Array, Array, Array] = self.kernel.equations(self.y)
        return found

    @functools.cached_property
    def x(self) -> Array:
        """The segments between the impacts, rows ``(t, z, tau)``."""
        return self.frame.split(self.y)[0]

    @functools.cached_property
    def flights(self) -> Flights:
        """The flights to the impacts."""
        return self.frame.flow.fly((), self.x[:, 0], self.x[:, 1:-1], self.x[:, -1])

    @functools.cached_property
    def segments(self) -> SegmentTerms:
        """The equations of the same motion in segments."""
        return of_segments(self.frame, self.y, self.x, self.length)

    @property
    def impulses(self) -> list[Array]:
        """The impulses, those of `segments` too."""
        return [np.array([it]) for it in self.y[::2]]

    def matrix(self, factor: complex = 1.0) -> Any:
        r"""Return :math:`J`, for disturbances with a factor :math:`e^{i \theta}` a period."""
        if factor == 1.0:
            return self.jacobian
        real, sine = self.parts(float(np.real(factor)))
        return real if np.imag(factor) == 0.0 else real + 1j * np.imag(factor) * sine

    def by_multiplier(self) -> Array:
        """Return the derivative of the matrix by the factor, at -1."""
        return self.parts(-1.0)[1]

    def parts(self, kappa: float) -> tuple[Array, Array]:
        """Return R and S."""
        real, sine = self.kernel.turned(self.y, kappa)
        return real, sine

    def turned(self, kappa: float) -> tuple[Array, Array]:
        r"""Return the real matrix of a pair with :math:`\kappa = \cos \theta`, and its derivative.

        .. math:: \begin{pmatrix} R & -(1 - \kappa^2) S \\ S & R \end{pmatrix}
        """
        sides = [self._turned(kappa + h) for h in (IMPULSE_STEP, -IMPULSE_STEP)]
        return self._turned(kappa), (sides[0] - sides[1]) / (2.0 * IMPULSE_STEP)

    def _turned(self, kappa: float) -> Array:
        real, sine = self.parts(kappa)
        return np.block([[real, (kappa * kappa - 1.0) * sine], [sine, real]])

    def curvature(self, factor: float, w: Array, v: Array) -> Array:
        """Return the gradient of w J v by the unknowns, of the matrix with a factor."""
        found: Array = self.kernel.curvature(self.y, factor, w, v)[0]
        return found

    def turned_curvature(self, kappa: float, w: Array, v: Array) -> list[Array]:
        """Return the gradients of w J v of the matrix of a pair, w and v of shape (2n, 2)."""
        n, square = len(self.y), kappa * kappa - 1.0

        def part(rows: int, i: int, columns: int, j: int) -> tuple[Array, Array]:
            left, right = w[rows : rows + n, i], v[columns : columns + n, j]
            own, sine = self.kernel.curvature(self.y, kappa, left, right)
            return own, sine

        return [
            part(0, i, 0, j)[0]
            + square * part(0, i, n, j)[1]
            + part(n, i, 0, j)[1]
            + part(n, i, n, j)[0]
            for i in (0, 1)
            for j in (0, 1)
        ]

    def rate_gradient(self, s: int) -> Array:
        """Return the derivative of the speed before an impact by the unknowns."""
        row = self.jacobian[2 * s + 1].copy()
        row[2 * s] -= self.kernel.mobilities[s]
        return np.asarray(row / (1.0 + self.frame.flow.e[self.frame.word[s].gap]), np.float64)

    def return_map(self, first: int = 0) -> Array:
        """Return the derivative of ``(t, z)`` at a segment's start one word later."""
        return self.segments.return_map(first)


class MassTerms(ImpulseTerms):
    """The equations of one mass, whose flights are computed once."""

    kernel: MassImpulses

    def __init__(
        self, frame: Frame, y: Array, name: str | None = None, found: Evaluated | None = None
    ) -> None:
        self.name, self._found = name, found
        super().__init__(frame, y)

    def _evaluated(self) -> tuple[Array, Array, Array]:
        found = self._found or self.kernel.equations(self.y, self.name)
        self._found, self.flights = found, found.flights
        return found.residual, self.flights.z[:, 1], found.own + found.before

    def parts(self, kappa: float) -> tuple[Array, Array]:
        """Return R and S."""
        assert self._found is not None
        return self._found.own + kappa * self._found.before, -self._found.before

    def column(self, name: str, longer: float) -> Array:
        """Return the derivative by a parameter, by which the length has one too."""
        assert self._found is not None
        found = self._found if name == self.name else self.kernel.equations(self.y, name)
        return found.by_parameter(longer)

    def return_map(self, first: int = 0) -> Array:
        """Return the derivative of ``(t, x, u)`` after an impact one word later."""
        maps = impact_maps(self.flights, self.kernel.e)
        product: Array = maps[first]
        if len(maps) == 1:
            return product
        with np.errstate(all="ignore"):
            for s in range(first + 1, first + len(maps)):
                product = maps[s % len(maps)] @ product
        return product


# The equations of an orbit, in segments or in impulses, and Newton's iteration for them.

Terms = SegmentTerms | ImpulseTerms

TOLERANCE = 1e-13
ENOUGH = 1e-10
"""A residual at which an iteration that stalls has found what rounding allows."""


def evaluate(frame: Frame, y: Array, *, slopes: bool = True, name: str | None = None) -> Terms:
    """Evaluate the equations, and their derivatives; of one mass that by a parameter too."""
    if isinstance(frame.impulses, MassImpulses):
        return MassTerms(frame, y, name)
    if frame.impulses is not None:
        return ImpulseTerms(frame, y)
    return of_segments(frame, y, *frame.split(y), slopes=slopes)


def sizes_of(terms: Terms) -> tuple[Array, Array]:
    """Return the sizes of the unknowns and of the residuals."""
    frame, own = terms.frame, row_sizes(terms)
    length, distance, speed = own[0], own[1], own[-2]
    if frame.impulses is not None:
        unknowns, residuals = np.empty((2, len(terms.y)))
        unknowns[::2] = _per_speed(frame) * speed / frame.impulses.mobilities
        unknowns[1::2] = length
        residuals[::2], residuals[1::2] = distance, speed
        return unknowns, residuals
    flights, n, own = terms.flights, frame.flow.n, own[:-1]
    events = []
    for segment in frame.word:
        size = distance
        if segment.kind == "P":
            size = length if isinstance(frame.section, float) else speed
        elif segment.kind in "KT":
            size = speed
        elif segment.kind in "LB":
            size = max(1.0, float(np.max(np.abs(flights.last[:, n:]))))
        events.append(size)
    unknowns = np.tile(np.append(own, length), len(frame.word))
    return unknowns, np.concatenate([np.append(size, own) for size in events])


def _per_speed(frame: Frame) -> float:
    """Return the sizes of impulses relative to the speeds after them."""
    return frame.impulses.per_speed if isinstance(frame.impulses, MassImpulses) else 1.0


def row_sizes(terms: Terms) -> Array:
    """Return the sizes of a segment's row ``(t, z, tau)``."""
    n, length, flights = terms.frame.flow.n, abs(terms.length), terms.flights
    x, z = terms.x[:, 1:-1], flights.z
    # where a grazing is the only event all speeds there may vanish
    pulls = _largest(flights.first[:, n:], flights.last[:, n:])
    # a section may lie where a motion without events hardly moves
    share = 1.0 if terms.frame.word[0].kind == "P" else 0.1
    pushed = share * length / (2.0 * math.pi) * pulls
    speed = max(_largest(x[:, n:], z[:, n:]), pushed) or 1.0
    # one mass is at the wall in all events: its flights are higher
    part = 0.5 / math.pi / len(x) if isinstance(terms.frame.flow, MassFlow) else 1e-3
    distance = max(_largest(x[:, :n], z[:, :n]), part * speed * length) or 1.0
    return np.array([length, *[distance] * n, *[speed] * n, length])


def _largest(*several: Array) -> float:
    """Return the largest absolute value."""
    return max(float(np.abs(it).max()) for it in several)


@dataclasses.dataclass(frozen=True)
class Solution:
    """Result of Newton's iteration."""

    terms: Terms
    residual: float
    iterations: int
    converged: bool
    trace: list[float]


def newton(frame: Frame, y: Array, most: int = 20) -> Solution:
    """Solve the equations from a guess; steps are halved where the residual grows."""
    now = evaluate(frame, y)
    _, sizes = sizes_of(now)
    if frame.impulses is not None:
        sizes[1::2] *= _per_speed(frame)
    error = float(np.abs(now.residual / sizes).max())
    trace, accuracy = [error], frame.flow.accuracy
    for _ in range(most):
        if error <= max(TOLERANCE, accuracy):
            break
        try:
            move: Array = -np.linalg.solve(now.matrix(), now.residual)
        except np.linalg.LinAlgError:
            break
        found = _damped(frame, now, move, sizes, error)
        if found is None or (found[1] > 0.5 * error and error <= ENOUGH):
            break
        now, error = found
        trace.append(error)
    return Solution(now, error, len(trace) - 1, error <= max(ENOUGH, accuracy), trace)


def _damped(
    frame: Frame, now: Terms, move: Array, sizes: Array, error: float
) -> tuple[Terms, float] | None:
    part = 1.0
    for _ in range(8):
        try:
            there = evaluate(frame, now.y + part * move)
        except (FlightError, ValueError):
            part *= 0.5
            continue
        new = float(np.abs(there.residual / sizes).max())
        if math.isfinite(new) and (new <= 2.0 * error or new < 1e-3):
            return there, new
        part *= 0.5
    return None


# Floquet multipliers of a word, and its monodromy.


def multipliers_of(terms: Terms, *, half: bool = False) -> NDArray[np.complex128]:
    """Return the Floquet multipliers of a period, or of half a symmetric one with `half`.

    ``(t, z)`` at an event has one eigenvalue 0, that of the shift along the motion. Every gap that
    is closed at some time adds two, every channel of friction that sticks one: they are exact
    zeros, and so are the eigenvalues given.
    """
    frame = terms.frame
    word = frame.word
    first = max(range(len(word)), key=lambda s: len(word[s].held))
    whole = terms.return_map(first)
    if not np.all(np.isfinite(whole)):
        return np.full(2 * frame.flow.n - frame.free, np.inf + 0j)
    values = np.linalg.eigvals(whole)
    values = values[np.argsort(-np.abs(values), kind="stable")].astype(np.complex128)
    zeros = (1 if frame.flow.channels else 2) * len(word[first].held)
    if frame.free:
        values = np.delete(values, np.argmin(np.abs(values - 1.0)))
    values = values[:-1]
    if zeros:
        values[len(values) - min(zeros, len(values)) :] = 0.0
    return values if frame.turn is None or half else values**2


def monodromy_at(terms: Terms, length: float, t: float) -> Array:
    """Return the derivative of the state after one period by the state at a time.

    Raises
    ------
    ValueError
        If the time lies within an accumulation.
    """
    frame = terms.frame
    begin = float(terms.x[0, 0])
    local = begin + (t - begin) % length
    turn = frame.turn if local >= begin + terms.length else None
    local -= 0.0 if turn is None else terms.length
    s = _segment(terms, local)
    # from the start of the segment to the time, at fixed times
    own = frame.flow.fly(
        frame.word[s].contacts, terms.x[s, :1], terms.x[s, None, 1:-1], np.array([local])
    )
    once = terms.return_map(s)
    whole = once if frame.turn is None else once @ once
    fixed = whole[1:, 1:] - np.outer(own.first[0], whole[0, 1:])
    found: Array = own.phi[0] @ fixed @ np.linalg.inv(own.phi[0])
    return found if turn is None else turn @ found @ np.linalg.inv(turn)


def _segment(terms: Terms, t: float) -> int:
    inside = [s for s in range(len(terms.x)) if terms.x[s, 0] <= t < terms.x[s, -1]]
    if inside:
        return inside[0]
    # within an accumulation: the contact after it
    later = [s for s in range(len(terms.x)) if terms.x[s, 0] > t]
    raise ValueError(
        "t must lie in a segment, not in an accumulation: the next begins at "
        f"{terms.x[later[0], 0]:.9g}"
        if later
        else "t must lie in a segment, not in an accumulation"
    )


# Symmetric motions: half of the word, whose image under the symmetry is the other half.


def turn_of(symmetry: Any, n: int) -> Array:
    r"""Read a symmetry: :math:`\Sigma` of shape (2n, 2n).

    Raises
    ------
    ValueError
        If it is not a linear map of coordinates or states.
    """
    if callable(symmetry):
        columns = [np.asarray(symmetry(row), np.float64).ravel() for row in np.eye(2 * n)]
        matrix = np.array(columns).T
    else:
        matrix = np.atleast_2d(real_array("symmetry", symmetry))
    if matrix.shape == (n, n):
        matrix = np.asarray(np.kron(np.eye(2), matrix), np.float64)
    if matrix.shape != (2 * n, 2 * n) or not np.all(np.isfinite(matrix)):
        raise ValueError(
            f"symmetry must be a matrix of shape {(n, n)} for the coordinates, or {(2 * n, 2 * n)} "
            f"for the states, got {matrix.shape}"
        )
    if not np.allclose(matrix @ matrix, np.eye(2 * n), atol=1e-12):
        raise ValueError(
            "symmetry must be an involution: applied twice, it must return the same state"
        )
    return matrix


def gaps_turned(flow: Flow, turn: Array, half: float) -> list[int]:
    """Return the permutation of the gaps under the symmetry, half a period later.

    Raises
    ------
    ValueError
        If a gap has no image.
    """
    rng = np.random.default_rng(0)
    times = rng.uniform(0.0, 2.0 * half, 3)
    states = rng.uniform(-1.0, 1.0, (3, 2 * flow.n))
    here, there = flow.gaps(times, states)[0], flow.gaps(times + half, states @ turn.T)[0]
    found = []
    for i in range(flow.m):
        same = [j for j in range(flow.m) if np.allclose(here[:, i], there[:, j], atol=1e-9)]
        if len(same) != 1:
            raise ValueError(f"symmetry: the image of gap {i} is not a gap")
        found.append(same[0])
    return found


def whole_word(terms: Terms) -> tuple[Word, Array, list[Array]]:
    """Return the word of the whole period, its unknowns and its impulses."""
    frame = terms.frame
    if frame.turn is None:
        return frame.word, terms.x, terms.impulses
    to = gaps_turned(frame.flow, frame.turn, terms.length)
    image = tuple(_turned(segment, to) for segment in frame.word)
    x = terms.x.copy()
    x[:, [0, -1]] += terms.length
    x[:, 1:-1] = x[:, 1:-1] @ frame.turn.T
    return frame.word + image, np.vstack([terms.x, x]), terms.impulses * 2


def _turned(segment: Segment, to: list[int]) -> Segment:
    gap = segment.gap if segment.gap < 0 else to[segment.gap]
    contacts, after = (tuple(sorted(to[i] for i in it)) for it in (segment.contacts, segment.after))
    return dataclasses.replace(segment, contacts=contacts, gap=gap, after=after)
