"""Orbits of one mass as sequences of impacts, rows ``(t, u)``, and as words of the equations.

Where nothing excites the system the first impact is put at ``t = 0``, and the period `T` takes the
place of its time. A motion without impacts is ``(x, xdot)`` at a time, or ``(x, T)`` where it is
highest.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from zivi.base.check import Array
from zivi.orbits.mechanical.by_parameter import by_parameter
from zivi.orbits.mechanical.equations import Terms
from zivi.orbits.mechanical.frame import Frame as WordFrame
from zivi.orbits.mechanical.mass_flow import MassFlow
from zivi.orbits.mechanical.word import Segment
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import excitation

__all__ = ["Frame", "as_rows", "as_word", "derivative", "rows_along", "unknowns_of"]


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


def as_word(system: ImpactSystem, frame: Frame, y: Array) -> tuple[WordFrame, Array]:
    """Give the word of an orbit, and its unknowns."""
    rows, length, method = frame.rows(system, y), frame.length(system, y), frame.method
    hits = y.ndim == 2
    segment = Segment((), "I", 0, ()) if hits else Segment((), "P", -1, ())
    section: int | float = 0 if frame.free else float(rows[0, 3])
    word = WordFrame(
        system, MassFlow(system, method), (segment,) * len(rows), method, length, frame.free, None,
        section,
    )  # fmt: skip
    if not hits or frame.free:
        return word, word.joined(rows, length)
    if system.e > 0.0:
        return word, np.column_stack([(1.0 + system.e) / system.e * y[:, 1], y[:, 0]]).ravel()
    # a segment of a word ends with its event: the first one begins with the last impact
    rows = np.roll(rows, 1, axis=0)
    rows[0, [0, 3]] -= length
    return word, word.joined(rows, length)


def as_rows(terms: Terms) -> Array:
    """Give the unknowns of a sequence, of a word."""
    x, free = terms.x, terms.frame.free
    if terms.frame.word[0].kind == "P":
        return np.array([x[0, 1], terms.length]) if free else x[0, 1:3].copy()
    if free:
        return unknowns_of(x[:, [0, 2]], terms.length)
    return np.column_stack([x[:, 3], np.roll(x[:, 2], -1)])


def rows_along(terms: Terms, move: Array) -> Array:
    """Give the change of the unknowns of a sequence with that of those of its word."""
    frame = terms.frame
    if frame.impulses is not None:
        e = float(frame.flow.e[0])
        return np.column_stack([move[1::2], e / (1.0 + e) * move[::2]])
    rows = move.reshape(-1, 4)
    if frame.word[0].kind == "I":
        return rows[:, [0, 2]]
    if frame.free:
        return rows[0, [1, 0]]
    # at the time at which it is looked at
    return np.asarray(rows[0, 1:3] - rows[0, 0] * terms.flights.first[0], np.float64)


def derivative(terms: Terms, name: str) -> Array:
    """Give the derivative of the unknowns of a sequence by a parameter."""
    frame = terms.frame
    move: Array = -np.linalg.solve(terms.matrix(), by_parameter(frame, terms.y, name))
    found = rows_along(terms, move)
    if name == "e" and frame.impulses is not None:
        found[:, 1] += terms.y[::2] / (1.0 + float(frame.flow.e[0])) ** 2
    return found
