"""A ball on a table, and its orbit with one impact in a period in closed form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import zivi
from inside import PRECISE, SequenceFrame as Frame, Terms, evaluate, period_of
from oscillator import Oscillator

TURN = 2 * math.pi
MODES = Oscillator(0.05, 0.9, 0.8)


def table(amplitude: float = 1.3, e: float = 0.5, omega: float = 1.0) -> zivi.ImpactSystem:
    force = zivi.LinearForce(gravity=1.0, amplitude=amplitude, phase=-math.pi / 2, omega=omega)
    return zivi.ImpactSystem(force, e=e)


_FORCE = zivi.LinearForce(
    gravity=1.0, amplitude=2.7530122232, omega=2.9276547718, phase=0.2315667206
)
THREE = zivi.ImpactSystem(_FORCE, e=0.3833978916), TURN / _FORCE.omega, (0.11277758, 0.603272351)
"""A ball that rests once in three periods, its period and a state."""


def frame(multiple: int = 1, **other: Any) -> Frame:
    return Frame(multiple, None, PRECISE, **other)


def single(amplitude: float = 1.3, e: float = 0.5) -> np.ndarray:
    """The orbit of one impact in one period, rows (t, u)."""
    cosine = math.pi * (1 - e) / ((1 + e) * amplitude)
    return np.array([[math.acos(cosine), TURN * e / (1 + e)]])


def as_word(system: zivi.ImpactSystem, own: Frame, y: np.ndarray) -> tuple[Any, np.ndarray]:
    """The word of a sequence, and its unknowns."""
    free = float(y[1] if y.ndim == 1 else y[0, 0]) if own.free else None
    return own.word(system, y, free or period_of(system, own.period))


def as_rows(terms: Terms) -> np.ndarray:
    """The rows (t, u) of a word's impacts, or the state of a flight; free, with its length."""
    x, free = terms.x, terms.frame.free
    if terms.frame.word[0].kind == "P":
        return np.array([x[0, 1], terms.length]) if free else x[0, 1:3]
    if not free:
        return np.column_stack([x[:, 3], np.roll(x[:, 2], -1)])
    return np.vstack([[terms.length, x[0, 2]], x[1:, [0, 2]]])


def equations(system: zivi.ImpactSystem, own: Frame, y: np.ndarray) -> Terms:
    """The equations of a sequence."""
    return evaluate(*as_word(system, own, y))
