r"""Beyond the end of a contact: the gap opens for a short time, and impacts close it again.

Where the least force of a contact falls below zero, :math:`\lambda \sim s^2 - r^2` in time, the
gap lifts off at :math:`s = -r` and is hit again at :math:`s = 3 r`: the solution of
:math:`\ddot g \sim r^2 - s^2` that begins there is :math:`g \sim (s + r)^3 (3 r - s)`. An
accumulation follows.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from zivi.base.check import Array
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.accumulation import after_event
from zivi.orbits.mechanical.equations import Frame, Terms
from zivi.orbits.mechanical.margins import Low
from zivi.orbits.mechanical.path import Path, Point
from zivi.orbits.mechanical.word import MOST_LETTERS, Segment

__all__ = ["reopened"]

DISTANCES = (5e-3, 2e-3, 1e-2, 3e-2)
"""How far beyond the event, in scaled unknowns, the new orbit is looked for."""
LOOKS = 257


def reopened(path: Path, edge: Point, low: Low) -> tuple[Path, Point] | None:
    """Give an orbit whose contact opens, a little beyond the event, and the path that it is on."""
    if len(path.frame.word) + 2 > MOST_LETTERS:
        return None
    for distance in DISTANCES:
        near = path.correct(edge.z + distance * edge.tangent, edge.tangent)
        if near is None:
            continue
        try:
            split = _lifted(near.terms, low)
            if split is None:
                continue
            frame, y, flight = split
            new = Path(frame, path.name, y, float(path.scale[-1]))
            point = new.at_value(new.scaled(y, near.value), near.value)
        except (FlightError, ValueError):
            continue
        least = None if point is None else point.margins.least
        if point is None or (least is not None and least.value < 0.0):
            continue
        # away from the event the flight lasts longer
        row = (point.tangent * new.scale)[flight * frame.size :][: frame.size]
        away = point.tangent if row[-1] > row[0] else -point.tangent
        return new, dataclasses.replace(point, tangent=away)
    return None


def _lifted(terms: Terms, low: Low) -> tuple[Frame, Array, int] | None:
    """Let a contact end where its force vanishes, and begin again where the gap is hit."""
    frame, x, s, gap = terms.frame, terms.x, low.segment, low.gap
    segment, flow = frame.word[s], frame.flow
    t0, z0 = float(x[s, 0]), x[s, 1:-1]
    times = np.linspace(t0, float(x[s, -1]), LOOKS)
    own = segment.contacts.index(gap)

    def force(t: Array) -> Array:
        states = flow.path(segment.contacts, t0, z0, t)
        return flow.reactions(segment.contacts, t, states)[:, own]

    pulls = np.flatnonzero(force(times) < 0.0)
    middle = low.t
    if len(pulls):
        middle = float(times[pulls[np.argmin(np.abs(times[pulls] - low.t))]])
    before = times[(times < middle)]
    before = before[force(before) > 0.0] if len(before) else before
    if not len(before) or not force(np.array([middle]))[0] < 0.0:
        return None
    lift = _root(force, float(before[-1]), middle)
    z = flow.path(segment.contacts, t0, z0, np.array([lift]))[0]
    open_ones = tuple(i for i in segment.contacts if i != gap)
    again = _again(terms, open_ones, gap, (lift, z), float(x[s, -1]))
    if again is None:
        return None
    hit, back, row = again
    word = (*frame.word[:s], Segment(segment.contacts, "L", gap, open_ones), back, *frame.word[s:])
    first, second, third = x[s].copy(), x[s].copy(), x[s].copy()
    first[-1] = lift
    second[:-1], second[-1] = np.append(lift, z), hit
    third[:-1] = row
    rows = np.vstack([x[:s], first, second, third, x[s + 1 :]])
    new = dataclasses.replace(frame, word=word)
    return new, new.joined(rows, terms.length), s + 1


def _again(
    terms: Terms, contacts: tuple[int, ...], gap: int, start: tuple[float, Array], end: float
) -> tuple[float, Segment, Array] | None:
    """Find when an opened gap is hit, the event, and time and state when it is closed again."""
    frame, (t0, z0) = terms.frame, start
    flow = frame.flow

    def height(t: Array) -> Array:
        return flow.gaps(t, flow.path(contacts, t0, z0, t))[0][:, gap]

    times = t0 + (end - t0) * np.geomspace(1e-6, 1.0, LOOKS)
    heights = height(times)
    falls = np.flatnonzero((heights[:-1] > 0.0) & (heights[1:] <= 0.0))
    if not len(falls):
        return None
    hit = _root(height, *times[[falls[0], falls[0] + 1]])
    kind = "S" if flow.e[gap] == 0.0 else "Z"
    back = Segment(contacts, kind, gap, tuple(sorted({*contacts, gap})))
    before = flow.path(contacts, t0, z0, np.array([hit]))[0]
    row = after_event(frame.system, frame.method, flow, back, hit, before, abs(terms.length))
    return (hit, back, row) if row[0] < end else None


def _root(function: Callable[[Array], Array], low: float, high: float) -> float:
    from scipy.optimize import brentq

    return float(brentq(lambda t: float(function(np.array([t]))[0]), low, high, xtol=1e-14))
