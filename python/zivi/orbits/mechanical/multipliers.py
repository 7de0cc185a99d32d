"""Floquet multipliers of a word, and its monodromy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.orbits.mechanical.equations import Terms

__all__ = ["monodromy_at", "multipliers_of"]


def multipliers_of(terms: Terms, *, half: bool = False) -> NDArray[np.complex128]:
    """Give the multipliers of a period, or of the `half` that a symmetric word is.

    ``(t, z)`` at an event has one eigenvalue 0, that of the shift along the motion. Every gap that
    is closed at some time adds two: they are exact zeros, and so are the eigenvalues given.
    """
    frame = terms.frame
    word = frame.word
    first = max(range(len(word)), key=lambda s: len(word[s].contacts))
    whole = terms.return_map(first)
    if not np.all(np.isfinite(whole)):
        return np.full(2 * frame.flow.n - frame.free, np.inf + 0j)
    values = np.linalg.eigvals(whole)
    values = values[np.argsort(-np.abs(values), kind="stable")].astype(np.complex128)
    zeros = 2 * len(word[first].contacts)
    if frame.free:
        values = np.delete(values, np.argmin(np.abs(values - 1.0)))
    values = values[:-1]
    if zeros:
        values[len(values) - min(zeros, len(values)) :] = 0.0
    return values if frame.turn is None or half else values**2


def monodromy_at(terms: Terms, length: float, t: float) -> Array:
    """Give the derivative of the state after one period by the state at a time.

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
