r"""The equations of a word: durations and states of all segments are unknowns.

Segment `s` starts at :math:`(t_s, z_s)` and ends with its event at :math:`\tau_s`,

.. math:: E_s(\tau_s, z^-_s) = 0, \qquad (t_{s+1}, z_{s+1}) = R_s(\tau_s, z^-_s),

the last one with :math:`(t_1 + L, z_1)`, or :math:`(t_1 + L, \Sigma z_1)` of a symmetric motion.
Nothing is searched for: the equations are regular where an impact grazes and beyond. The Jacobian
is block cyclic, and

.. math:: J(\theta) = A + e^{i \theta} B, \qquad B = \partial(t_1 + L, \Sigma z_1),

is singular where a multiplier is :math:`e^{i \theta}`, also where another one is infinite.

Where nothing excites the system, :math:`t_1 = 0` and `L` takes its place among the unknowns.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.base.status import Status
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.accumulation import Accumulation, accumulated, onto
from zivi.orbits.mechanical.flow import Flights, Scalar
from zivi.orbits.mechanical.frame import Frame
from zivi.orbits.mechanical.word import Segment

__all__ = ["SegmentTerms", "of_segments"]

STEP = 1e-5
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
        """Give the derivative of the matrix by the factor."""
        moved: Array = 0.5 * (self.matrix(1.0 + 1e-300j).real - self.matrix(-1.0))
        return moved

    def turned(self, kappa: float) -> tuple[Array, Array]:
        r"""Give the real matrix of a pair with :math:`\kappa = \cos \theta`, and its derivative.

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
        """Give the gradient of w J v by the unknowns, of the matrix with a factor."""
        return np.asarray(w @ self._along(v, factor), np.float64)

    def turned_curvature(self, kappa: float, w: Array, v: Array) -> list[Array]:
        """Give the gradients of w J v of the matrix of a pair, w and v of shape (2n, 2).

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
        """Give the derivative of the matrix along a direction of the unknowns."""
        frame, y = self.frame, self.y
        largest = float(np.max(np.abs(v))) or 1.0
        h = STEP * max(1.0, float(np.max(np.abs(y[1:])))) / largest
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
        """Give the derivative of the speed before an impact by the unknowns."""
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
        """Give the derivative of ``(t, z)`` at a segment's start one word later."""
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
    held = [i for i in frame.word[0].contacts if all(i in it.contacts for it in frame.word)]
    for s, segment in enumerate(frame.word):
        own = flights.of(s)
        tau = float(x[s, -1])
        event = _event(frame, segment, tau, own.z)
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
    found = Flights(rows[0], np.empty((k, width, width)), rows[1], rows[2])
    for contacts in dict.fromkeys(kinds):
        own = [s for s in range(k) if kinds[s] == contacts]
        part = frame.flow.fly(contacts, x[own, 0], x[own, 1:-1], x[own, -1])
        found.z[own], found.phi[own] = part.z, part.phi
        found.first[own], found.last[own] = part.first, part.last
    return found


def _event(frame: Frame, segment: Segment, tau: float, z: Array) -> Scalar:
    """Give what vanishes at the end of a segment."""
    flow, n = frame.flow, frame.flow.n
    if segment.kind == "P":
        if isinstance(frame.section, float):
            return Scalar(tau - frame.section, np.zeros(2 * n), 1.0)
        row = np.zeros(2 * n)
        row[n + frame.section] = 1.0
        return Scalar(float(z[n + frame.section]), row, 0.0)
    if segment.kind == "L":
        return flow.reaction(segment.contacts, segment.gap, tau, z)
    return flow.gap(segment.gap, tau, z)


@dataclasses.dataclass(frozen=True)
class _Mapped:
    """What an event makes of time and state, with derivatives of both, shape (1 + 2n, ...)."""

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
    if segment.kind in "LP":
        return _Mapped(tau, z, by_z, by_t, np.empty(0))
    plastic = segment.kind == "S"
    e = 0.0 if plastic else float(flow.e[segment.gap])
    jump = flow.impact(segment.gap, segment.kept, tau, z, e)
    by_z[1:], by_t[1:] = jump.by_z, jump.by_t
    if segment.kind != "Z":
        return _Mapped(tau, jump.z, by_z, by_t, jump.impulses)
    closed = [segment.gap, *segment.kept]
    begin = onto(flow, closed, tau, jump.z, segment.kept)
    horizon = abs(length)
    chain = accumulated(
        frame.system, frame.method, (tau, begin), segment.gap, horizon, slopes=slopes
    )
    # the start is put onto the closed gaps: what is across them does not count
    across = np.array([flow.gap(i, tau, begin).by_z[: flow.n] for i in closed])
    inverse = np.linalg.pinv(across)
    own, moved = jump.by_z.copy(), jump.by_t.copy()
    own[: flow.n] -= inverse @ across @ own[: flow.n]
    moved[: flow.n] = -inverse @ np.array([flow.gap(i, tau, begin).by_t for i in closed])
    by_t = chain.by_z @ moved + chain.by_t
    return _Mapped(chain.t, chain.z, chain.by_z @ own, by_t, jump.impulses, chain)


def _held(frame: Frame, held: list[int], mapped: _Mapped) -> _Mapped:
    """Put the state onto gaps that never open: no event of the word does, so it would not stay."""
    flow, n, t, z = frame.flow, frame.flow.n, mapped.t, mapped.z
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
