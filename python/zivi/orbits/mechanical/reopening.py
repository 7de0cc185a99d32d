r"""Where a contact opens for a short time, and impacts close it again: both ways.

Where the least force of a contact falls below zero, :math:`\lambda \sim s^2 - r^2` in time, the
gap lifts off at :math:`s = -r` and is hit again at :math:`s = 3 r`: the solution of
:math:`\ddot g \sim r^2 - s^2` that begins there is :math:`g \sim (s + r)^3 (3 r - s)`. An
accumulation follows.

Where the impulse of a contact at the impact of another gap falls below zero, the impact opens it,
and the force that presses it brings it back, after a time that goes like the impulse.

On the way back the equations with the short flight are singular at the event; those of the word
without it are not, and the event is located there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from zivi.base.check import Array
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.accumulation import after_event
from zivi.orbits.mechanical.equations import Frame, Terms, evaluate
from zivi.orbits.mechanical.margins import Low
from zivi.orbits.mechanical.path import Path, Point, located
from zivi.orbits.mechanical.word import MOST_LETTERS, Segment

__all__ = ["about", "is_vanishing", "rejoined", "reopened"]

DISTANCES = (5e-3, 2e-3, 1e-2, 3e-2)
"""How far beyond the event, in scaled unknowns, the new orbit is looked for."""
LOOKS = 257
SHORT = 0.02
"""A flight that lasts less, relative to the word, may be about to vanish."""
PROBE, FAR = 1e-4, 0.3
"""How far, in scaled unknowns, a margin is looked at for its slope, and where it may vanish."""


def reopened(path: Path, edge: Point, low: Low) -> tuple[Path, Point] | None:
    """Give an orbit whose contact opens, a little beyond the event, and the path that it is on."""
    if len(path.frame.word) + 2 > MOST_LETTERS:
        return None
    for distance in DISTANCES:
        near = path.correct(edge.z + distance * edge.tangent, edge.tangent)
        if near is None:
            continue
        try:
            split = (_struck if low.kind == "opening" else _lifted)(near.terms, low)
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
    if terms.frame.word[0].kind == "P":
        if terms.frame.turn is not None or terms.frame.free:
            return None
        terms = evaluate(*about(terms, low.t))
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
    lifts = Segment(segment.contacts, "L", gap, open_ones)
    if segment.kind == "P":
        # the lift-off takes the place of the section
        rows = np.array([[*row, lift], [lift, *z, hit]])
        rows[0, 0] -= terms.length
        new = dataclasses.replace(frame, word=(lifts, back), section=0.0)
        return new, new.joined(rows, terms.length), 1
    word = (*frame.word[:s], lifts, back, *frame.word[s:])
    first, second, third = x[s].copy(), x[s].copy(), x[s].copy()
    first[-1] = lift
    second[:-1], second[-1] = np.append(lift, z), hit
    third[:-1] = row
    rows = np.vstack([x[:s], first, second, third, x[s + 1 :]])
    new = dataclasses.replace(frame, word=word)
    return new, new.joined(rows, terms.length), s + 1


def about(terms: Terms, middle: float) -> tuple[Frame, Array]:
    """Give a motion without events from half a period before a time to half a period after."""
    section = middle + 0.5 * terms.length
    frame = dataclasses.replace(terms.frame, section=section)
    return frame, frame.joined(_from(terms, 0, section), terms.length)


def _from(terms: Terms, s: int, end: float) -> Array:
    """Give the one segment that ends at a time, as the motion of a segment goes on."""
    frame, x, length = terms.frame, terms.x, terms.length
    t0 = float(x[s, 0])
    begin = end - length
    within = begin if begin >= t0 or frame.word[s].kind != "P" else end
    z = frame.flow.path(frame.word[s].contacts, t0, x[s, 1:-1], np.array([within]))[0]
    return np.concatenate([[begin], z, [end]])[None]


def _struck(terms: Terms, low: Low) -> tuple[Frame, Array, int] | None:
    """Let an impact open a contact that it would pull at, and the gap be hit again."""
    frame, x, s, gap = terms.frame, terms.x.copy(), low.segment, low.gap
    segment, flow, k = frame.word[s], frame.flow, len(frame.word)
    if segment.kind not in "IS":
        return None
    t, before = float(x[s, -1]), terms.segments.flights.z[s]
    e = 0.0 if segment.kind == "S" else float(flow.e[segment.gap])
    kept = tuple(i for i in segment.kept if i != gap)
    z = flow.impact(segment.gap, kept, t, before, e).z
    open_ones = tuple(i for i in segment.after if i != gap)
    last = s + 1 == k
    end = float(x[(s + 1) % k, -1]) + (terms.length if last else 0.0)
    again = _again(terms, open_ones, gap, (t, z), end)
    if again is None:
        return None
    hit, back, row = again
    if last:
        row = row.copy()
        row[0] -= terms.length
        if frame.turn is not None:
            row[1:] = np.linalg.inv(frame.turn) @ row[1:]
    x[(s + 1) % k, :-1] = row
    flight = np.concatenate([[t], z, [hit]])
    opens = dataclasses.replace(segment, after=open_ones)
    word = (*frame.word[:s], opens, back, *frame.word[s + 1 :])
    rows = np.vstack([x[: s + 1], flight, x[s + 1 :]])
    new = dataclasses.replace(frame, word=word)
    return new, new.joined(rows, terms.length), s + 1


def is_vanishing(points: Sequence[Point]) -> bool:
    """Whether the flight of an opened contact is short, and becomes shorter."""
    if len(points) < 2:
        return False
    last, before = points[-1].terms, points[-2].terms
    s = _shortest(last)
    if s is None:
        return False
    now, then = (float(it.x[s, -1] - it.x[s, 0]) for it in (last, before))
    return now < min(then, SHORT * abs(last.length))


def _shortest(terms: Terms) -> int | None:
    """Give which flight of an opened contact, until its gap is hit, is the shortest."""
    word = terms.frame.word
    own = [
        s
        for s, it in enumerate(word)
        if it.kind in "SZ" and it.gap in word[s - 1].contacts and it.gap not in word[s - 1].after
    ]
    return min(own, key=lambda s: float(terms.x[s, -1] - terms.x[s, 0]), default=None)


def rejoined(path: Path, last: Point) -> tuple[Path, Point, Low] | None:
    """Give where the short flight of an opened contact vanishes: the path without it, the event."""
    joined = _without_flight(last.terms)
    if joined is None:
        return None
    frame, y, kind, gap = joined
    new = Path(frame, path.name, y, float(path.scale[-1]))
    try:
        start = new.at_value(new.scaled(y, last.value), last.value)
        if start is None:
            return None
        event = _event_near(new, start, kind, gap)
    except (FlightError, ValueError):
        return None
    return None if event is None else (new, *event)


def _event_near(path: Path, start: Point, kind: str, gap: int) -> tuple[Point, Low] | None:
    """Find where a margin vanishes, and turn the tangent to where it is positive."""

    def least(point: Point) -> Low | None:
        own = [it for it in point.margins.lows if it.kind == kind and it.gap == gap]
        return min(own, key=lambda it: it.value, default=None)

    def test(point: Point) -> float:
        low = least(point)
        return np.nan if low is None else low.value

    def at(distance: float) -> Point | None:
        return path.correct(start.z + distance * start.tangent, start.tangent)

    beside = at(PROBE)
    if beside is None or test(beside) == test(start):
        return None
    # a little further than where the line through both vanishes
    distance = -1.2 * PROBE * test(start) / (test(beside) - test(start))
    other = at(distance) if abs(distance) < FAR else None
    if other is None or not test(start) * test(other) < 0.0:
        return None
    event = located(path, start, other, test)
    low = None if event is None else least(event)
    if event is None or low is None:
        return None
    side = start if test(start) > 0.0 else other
    if (side.z - event.z) @ event.tangent < 0.0:
        event = dataclasses.replace(event, tangent=-event.tangent)
    return event, low


def _without_flight(terms: Terms) -> tuple[Frame, Array, str, int] | None:
    """Leave out the shortest flight of an opened contact: of the word without it what vanishes."""
    frame, x, word = terms.frame, terms.x.copy(), terms.frame.word
    k = len(word)
    s = _shortest(terms)
    if s is None or x[s, -1] - x[s, 0] > SHORT * abs(terms.length) or frame.turn is not None:
        return None
    before, gap, after = (s - 1) % k, word[s].gap, (s + 1) % k
    if word[before].kind != "L":
        closed = tuple(sorted({*word[before].after, gap}))
        kept = dataclasses.replace(word[before], after=closed)
        new_word = tuple(kept if j == before else it for j, it in enumerate(word) if j != s)
        new = dataclasses.replace(frame, word=new_word)
        return new, new.joined(np.delete(x, s, axis=0), terms.length), "opening", gap
    if k == 2:
        held = word[before].contacts
        if frame.free:
            return None
        section = float(x[before, -1]) + 0.5 * terms.length
        new = dataclasses.replace(frame, word=(Segment(held, "P", -1, held),), section=section)
        row = _from(terms, before, section)
        return new, new.joined(row, terms.length), "contact_ends", gap
    shift = terms.length * ((after < before) - 0.0)
    x[after, :-1] = x[before, :-1]
    x[after, 0] -= shift
    gone = (before, s)
    new = dataclasses.replace(frame, word=tuple(it for j, it in enumerate(word) if j not in gone))
    return new, new.joined(np.delete(x, gone, axis=0), terms.length), "contact_ends", gap


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
