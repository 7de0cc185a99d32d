"""One direction of a branch: segments with one event sequence each, and their ends."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.critical import crossed
from zivi.orbits.equations import Frame, Terms, after_event, evaluate, row_sizes
from zivi.orbits.flows import MOST_LETTERS, FlightError, MassFlow, Segment, Word
from zivi.orbits.orbit import chatter_exponent
from zivi.orbits.path import (
    Constraint,
    Margins,
    Path,
    Point,
    bordered,
    located,
    located_near,
    sigma,
    value_of,
)
from zivi.orbits.words import NotDifferentiable, recent
from zivi.simulation.run import simulate

# Where a contact opens for a short time, and impacts close it again: both ways.
#
# Where the least force of a contact falls below zero, :math:`\lambda \sim s^2 - r^2` in time, the
# gap lifts off at :math:`s = -r` and is hit again at :math:`s = 3 r`: the solution of
# :math:`\ddot g \sim r^2 - s^2` that begins there is :math:`g \sim (s + r)^3 (3 r - s)`. An
# accumulation follows.
#
# Where the impulse of a contact at the impact of another gap falls below zero, the impact opens it,
# and the force that presses it brings it back, after a time that goes like the impulse.
#
# On the way back the equations with the short flight are singular at the event; those of the word
# without it are not, and the event is located there.

DISTANCES = (5e-3, 2e-3, 1e-2, 3e-2)
"""How far beyond the event, in scaled unknowns, the new orbit is looked for."""
REOPENING_LOOKS = 257
REOPENING_SHORT, SHORT_OF_MASS = 0.02, 0.1
"""A flight that lasts less, relative to the word, may be about to vanish."""
REOPENING_PROBE, FAR = 1e-4, 0.3
"""How far, in scaled unknowns, a margin is looked at for its slope, and where it may vanish."""


def reopened(path: Path, edge: Point, low: Constraint) -> tuple[Path, Point] | None:
    """Return an orbit whose contact opens, slightly past the event, and its path."""
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


def _lifted(terms: Terms, low: Constraint) -> tuple[Frame, Array, int] | None:
    """Split a contact where its force vanishes: it ends and begins again at the next impact."""
    if terms.frame.word[0].kind == "P":
        if terms.frame.turn is not None or terms.frame.free:
            return None
        terms = evaluate(*about(terms, low.t))
    frame, x, s, gap = terms.frame, terms.x, low.segment, low.gap
    segment, flow = frame.word[s], frame.flow
    t0, z0 = float(x[s, 0]), x[s, 1:-1]
    times = np.linspace(t0, float(x[s, -1]), REOPENING_LOOKS)
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
        # the lift-off replaces the section
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
    """Return a motion without events from half a period before a time to half a period after."""
    section = middle + 0.5 * terms.length
    frame = dataclasses.replace(terms.frame, section=section)
    return frame, frame.joined(_from(terms, 0, section), terms.length)


def _from(terms: Terms, s: int, end: float) -> Array:
    """Return the one segment that ends at a time, as the motion of a segment goes on."""
    frame, x, length = terms.frame, terms.x, terms.length
    t0 = float(x[s, 0])
    begin = end - length
    within = begin if begin >= t0 or frame.word[s].kind != "P" else end
    z = frame.flow.path(frame.word[s].contacts, t0, x[s, 1:-1], np.array([within]))[0]
    return np.concatenate([[begin], z, [end]])[None]


def _struck(terms: Terms, low: Constraint) -> tuple[Frame, Array, int] | None:
    """Open a contact at an impact whose impulse on it would be negative; the gap is hit again."""
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
    return now < min(then, _short(last))


def _short(terms: Terms) -> float:
    """Return how long a flight is that may be about to vanish: of one mass all are as short."""
    mass = isinstance(terms.frame.flow, MassFlow)
    return (SHORT_OF_MASS if mass else REOPENING_SHORT) * abs(terms.length)


def _shortest(terms: Terms) -> int | None:
    """Return which flight of an opened contact, until its gap is hit, is the shortest."""
    word = terms.frame.word
    own = [
        s
        for s, it in enumerate(word)
        if it.kind in "SZ" and it.gap in word[s - 1].contacts and it.gap not in word[s - 1].after
    ]
    return min(own, key=lambda s: float(terms.x[s, -1] - terms.x[s, 0]), default=None)


def rejoined(path: Path, last: Point) -> tuple[Path, Point, Constraint] | None:
    """Return the path without the short flight of an opened contact, and the event on it."""
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


def _event_near(path: Path, start: Point, kind: str, gap: int) -> tuple[Point, Constraint] | None:
    """Find where a margin vanishes, and orient the tangent towards its positive side."""

    def least(point: Point) -> Constraint | None:
        own = [it for it in point.margins.lows if it.kind == kind and it.gap == gap]
        return min(own, key=lambda it: it.value, default=None)

    def test(point: Point) -> float:
        low = least(point)
        return np.nan if low is None else low.value

    def at(distance: float) -> Point | None:
        return path.correct(start.z + distance * start.tangent, start.tangent)

    beside = at(REOPENING_PROBE)
    if beside is None or test(beside) == test(start):
        return None
    # a little further than where the line through both vanishes
    distance = -1.2 * REOPENING_PROBE * test(start) / (test(beside) - test(start))
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
    if s is None or x[s, -1] - x[s, 0] > _short(terms) or frame.turn is not None:
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

    times = t0 + (end - t0) * np.geomspace(1e-6, 1.0, REOPENING_LOOKS)
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


# The end of rest: a contact whose duration vanishes.
#
# The duration `D` goes like a power of the distance, :math:`|p - p_c| \sim D^{1/\beta}`, with an
# infinite slope at the end, so that `D` is given and the parameter solved for: that is regular.

PULLS = (0.4, 0.7, 0.9, 0.97)
"""To which part the duration is shortened, as far as the equations can be solved there."""
RESTING_MOST = 40
SHORTEST = 1e-4
"""The duration, in lengths of the word, at which the end is told."""
CLOSE, AGREE = 1e-12, 1e-8
"""How near extrapolated ends come to each other before there is no need of more, and must come."""


def is_near(points: Sequence[Point]) -> bool:
    """Whether the end that two points point to is nearer than they are to each other."""
    if len(points) < 2:
        return False
    before, last = points[-2], points[-1]
    short = shortest_rest(last)
    if short is None or not _duration(last, short) < _duration(before, short):
        return False
    return abs(_extrapolated([before, last], short) - last.value) < abs(last.value - before.value)


def end_of_rest(
    path: Path, points: Sequence[Point], span: tuple[float, float]
) -> tuple[Point, Constraint] | None:
    """Find where a contact lasts no time; None if it does not end so."""
    if len(points) < 2:
        return None
    last = points[-1]
    short = shortest_rest(last)
    if short is None:
        return None
    now = _duration(last, short)
    # not the nearest one: a difference of near durations is rounding
    before = next((it for it in points[-2::-1] if _duration(it, short) > 1.2 * now), points[0])
    if not _duration(before, short) > now:
        return None
    near, changes = [before, last], [np.inf]
    ends = [_extrapolated(near, short)]
    for _ in range(RESTING_MOST):
        now = _duration(near[-1], short)
        tried = (with_duration(path, near, short, part * now) for part in PULLS)
        found = next((it for it in tried if it is not None), None)
        if found is None:
            break
        near = [*near[-2:], found]
        ends.append(_extrapolated(near, short))
        changes.append(abs(ends[-1] - ends[-2]))
        small = CLOSE * max(1.0, abs(ends[-1]))
        # if only rounding changes them, the residual is small enough
        if changes[-1] < small or changes[-1] > 10.0 * min(changes) < AGREE * small / CLOSE:
            break
        if _duration(found, short) < SHORTEST * abs(found.terms.length):
            break
    best = int(np.argmin(changes))
    last, end = near[-1], ends[best]
    if not changes[best] < AGREE * max(1.0, abs(end)) or not span[0] <= end <= span[1]:
        return None
    # the extrapolated end itself is not a motion: the orbit is the last one before it
    z = last.z.copy()
    z[-1] = end / path.scale[-1]
    return Point(z, last.terms, last.tangent, end, last.corrections, last.residual), short


def with_duration(
    path: Path, near: Sequence[Point], short: Constraint, duration: float
) -> Point | None:
    """Return the orbit with a contact of a given duration, from one to three nearby orbits."""
    size, last = path.frame.size, near[-1]
    normal = np.zeros(len(last.z))
    at = short.segment * size
    normal[at], normal[at + size - 1] = -path.scale[at], path.scale[at + size - 1]
    if len(near) > 1:
        power = _power(last, short)
        powers = (0.0, 1.0, power if power != 1.0 else 2.0)
        guess = np.array([it.z for it in near]).T @ _weights(near, short, powers, duration)
    else:
        part = (duration - _duration(last, short)) / (normal @ last.tangent)
        guess = last.z + part * last.tangent
    found = path.correct(guess, normal / np.linalg.norm(normal))
    return found if found is not None and _duration(found, short) > 0.0 else None


def _weights(near: Sequence[Point], short: Constraint, powers: Sequence[float], at: float) -> Array:
    """Return the weights of points for an extrapolation in powers of the duration."""
    size = _duration(near[-1], short)
    own = np.array(powers if len(near) == 3 else powers[::2])
    rows = np.array([[(_duration(it, short) / size) ** p for p in own] for it in near])
    return np.asarray(np.linalg.solve(rows.T, (at / size) ** own), np.float64)


def _extrapolated(near: Sequence[Point], short: Constraint) -> float:
    """Return the end that points point to: `p` goes like ``D**power``, then one power more."""
    power = _power(near[-1], short)
    powers = (0.0, power, power + 1.0) if len(near) == 3 else (0.0, np.nan, power)
    weights = _weights(near, short, powers, 0.0)
    last = near[-1].value
    return last + float(weights @ [it.value - last for it in near])


def _power(point: Point, short: Constraint) -> float:
    """Return the power of the duration, which the restitution alone determines."""
    frame = point.terms.frame
    # a plastic impact closes immediately, for every restitution
    plastic = frame.word[short.segment - 1].kind == "S"
    return 1.0 / chatter_exponent(0.0 if plastic else float(frame.flow.e[short.gap]))


def shortest_rest(point: Point) -> Constraint | None:
    """Return the contact that lasts the shortest time."""
    own = [it for it in point.margins.lows if it.kind == "end_of_rest"]
    return min(own, key=lambda it: it.value, default=None)


def _duration(point: Point, short: Constraint) -> float:
    """Return how long a contact lasts: it is handed on a little after its accumulation ends."""
    terms = point.terms
    row = terms.x[short.segment]
    chain = terms.accumulations.get((short.segment - 1) % len(terms.x))
    return float(row[-1] - row[0]) + (0.0 if chain is None else chain.t - chain.zeno)


# Across the end of rest: from a contact to impact sequences and back.
#
# Beyond the end of a rest the force throws a chain of impacts off before they accumulate. The
# nearer the end, the more impacts it has, by one at each grazing. A branch of such orbits is
# followed to a chain of `MOST` impacts; the orbit that rests is then looked for on both sides, and
# the event ``rest_appears`` is the end of that rest.

CHAIN_MOST, CHAIN_OF_MASS = 8, 4
"""Impacts of a chain, each slower than the one before, with which a rest is looked for."""
FIRST, CHAIN_LOOKS = 1e-4, 12
"""How far away it is looked for first, relative to the range, and how often, twice as far each."""
ALIKE = 0.05
"""How far apart, relatively, the fastest impacts of both orbits may be."""
RETURNS = 12
"""Lengths of the word that are simulated there."""


def rest_beyond(
    path: Path, edge: Point, span: tuple[float, float]
) -> tuple[Path, Point, Constraint] | None:
    """Return where rest appears near an orbit with a long chain: its path, the end, the contact.

    The point has the value of the end; its unknowns are those of the shortest rest computed.
    """
    first = _chain(edge.terms)
    if first is None or path.frame.free or path.frame.turn is not None:
        return None
    for value in _values(edge.value, span):
        found = _resting_near(path, edge, first, value)
        if found is None:
            continue
        own, point = found
        short = shortest_rest(point)
        if short is None:
            return None
        near = with_duration(own, [point], short, 0.7 * short.value)
        end = None if near is None else end_of_rest(own, [point, near], span)
        return None if end is None else (own, *end)
    return None


def _values(value: float, span: tuple[float, float]) -> Iterator[float]:
    for look in range(CHAIN_LOOKS):
        away = FIRST * 2.0**look * (span[1] - span[0])
        yield from (it for it in (value + away, value - away) if span[0] <= it <= span[1])


def _chain(terms: Terms) -> int | None:
    """Return the first of a chain of impacts of a gap, each slower than the one before.

    Of one mass a plastic impact is one, that before the flight whose start the force pulls least.
    """
    word, k, speeds = terms.frame.word, len(terms.frame.word), -np.asarray(terms.rates)
    mass = isinstance(terms.frame.flow, MassFlow)
    if mass and terms.frame.flow.e[0] == 0.0:
        return (int(np.argmin(terms.flights.first[:, 1])) - 1) % k
    for s, hit in enumerate(word):
        if hit.kind != "I" or hit.contacts:
            continue
        n = 1
        while n < k and word[(s + n) % k] == hit and speeds[(s + n) % k] < speeds[(s + n - 1) % k]:
            n += 1
        if n >= (CHAIN_OF_MASS if mass else CHAIN_MOST):
            return s
    return None


def _resting_near(path: Path, edge: Point, first: int, value: float) -> tuple[Path, Point] | None:
    """Return the resting orbit to which a run from a long impact sequence converges."""
    frame, before = path.frame_at(value), edge.terms
    t, state = float(before.x[first, 0]), frame.flow.initial(before.x[first, 1:-1])
    span = t, t + RETURNS * frame.length
    try:
        run = simulate(frame.system, span, state, frame.method)
        new, x, *_ = recent(frame.system, run, 1, frame.length, False, frame.method)
        gap = frame.word[first].gap
        rests, before_it = (
            sum(it.kind in "SZ" and it.gap == gap for it in word) for word in (new.word, frame.word)
        )
        if rests <= before_it:
            return None
        y = new.joined(x, frame.length)
        own = Path(new, path.name, y, float(path.scale[-1]))
        point = own.at_value(own.scaled(y, value), value)
    except (FlightError, NotDifferentiable, ValueError):
        return None
    if point is None or point.margins.why_not() is not None:
        return None
    own_fastest, fastest = (it.rates[int(np.argmin(it.rates))] for it in (point.terms, before))
    return (own, point) if abs(own_fastest / fastest - 1.0) < ALIKE else None


# One direction of a branch: segments of one event sequence each, and their events.

EDGE = 1e-10
"""How far below zero, relative to its size, what must be positive counts as zero."""
PROBE = 1e-4
TOGETHER = 1e-7
"""Parts of a step that are no further apart are one place."""
HALVES_MEET = 1e-4
"""Half differences that are less, relative to the motion, are those of a single orbit."""
NO_TURNING = 1e-9
SINGULAR = 1e-4
"""The part of the accelerations below which the rate at the end of a slip counts as zero."""
CIRCLE = 1e-6
"""How near the unit circle a located pair must be."""
ALIGNED = 0.9
BEGIN = ("grazing", "interior_impact", "end_of_rest")
"""Events at which a branch may begin, to the side without a motion too."""
SHORT = 0.01
"""The first step where a contact, or its end, lasts a short time, relative to the longest."""


STILL = Segment((0,), "P", -1, (0,))
"""One mass that stays at rest: a branch of what lifts off ends where that begins."""
OPENING = ("contact_ends", "opening")
"""Beyond them a contact opens for a short time."""
VANISHING = ("grazing", "simultaneous", "end_of_rest")
"""What may be negative where that time is over."""


class Found(NamedTuple):
    """An event of a branch."""

    kind: str
    point: Point
    low: Constraint | None = None


@dataclasses.dataclass
class Arc:
    """Points of one word, in order."""

    path: Path
    points: list[Point]
    events: list[Found] = dataclasses.field(default_factory=list)
    admissible_near_start: bool = False
    """Whether an orbit a little beyond its start was seen to be a motion."""


class Continuation:
    """The way along a branch in one direction, from word to word."""

    def __init__(
        self,
        path: Path,
        start: Point,
        span: tuple[float, float],
        step: float,
        most: int,
        *,
        through: bool,
        beyond: int = 0,
    ) -> None:
        self.span, self.step, self.most, self.through = span, step, most, through
        self.status = OrbitStatus.MAX_POINTS
        self.beyond, self.out = beyond, 0
        """How many points where the orbit is no motion any more, and those so far."""
        self.first, self.longest = start, 5.0 * step
        self.arcs = [Arc(path, [start])]
        self.count = 1
        self.passed: list[tuple[str, tuple[object, ...], tuple[object, ...], float, Array]] = []

    def go(self) -> OrbitStatus:
        """Follow the branch to its end."""
        while self.count < self.most:
            status = self._advance()
            if status is not None:
                self.status = status
                break
        return self.status

    def _advance(self) -> OrbitStatus | None:
        arc = self.arcs[-1]
        last = arc.points[-1]
        if isinstance(arc.path.frame.flow, MassFlow) and arc.path.frame.word[0] == STILL:
            return OrbitStatus.LEFT_ADMISSIBLE
        if self.through and is_vanishing(arc.points) and self._join(arc, last):
            return None
        rests = is_near(arc.points)
        new = None if rests else self._next(arc.path, last)
        rest = end_of_rest(arc.path, arc.points, self.span) if new is None else None
        if rest is not None:
            self._look(arc, last, rest[0])
            arc.points.append(rest[0])
            arc.events.append(Found("end_of_rest", rest[0], rest[1]))
            return OrbitStatus.LEFT_ADMISSIBLE
        new = self._next(arc.path, last) if rests else new
        if new is None:
            joins = self.through and self._join(arc, last)
            return None if joins else OrbitStatus.NOT_CONVERGED
        if not self.span[0] <= new.value <= self.span[1]:
            return self._end_of_range(arc, last, new)
        if self.out and self._is_out(last):
            return self._beyond(arc, new)
        edge = self._edge(arc, last, new)
        if (
            edge is not None
            and edge.point is last
            and arc.admissible_near_start
            and self.step > PROBE
        ):
            # the sequence is admissible on this side: if impacts appear in close succession, the
            # step passed the next ones
            self.step *= 0.1
            return None
        if edge is not None:
            return self._over(arc, last, edge, new)
        if self._mirrored(last, new):
            return OrbitStatus.RETRACED
        self._look(arc, last, new)
        arc.points.append(new)
        self.count += 1
        return OrbitStatus.CLOSED if self._closes(arc, last, new) else None

    def _next(self, path: Path, last: Point) -> Point | None:
        while self.step > 1e-8:
            new = path.correct(last.z + self.step * last.tangent, last.tangent)
            if new is not None and new.tangent @ last.tangent < 0.0:
                new = dataclasses.replace(new, tangent=-new.tangent)
            if new is None or new.tangent @ last.tangent < ALIGNED:
                self.step *= 0.5
                continue
            if new.corrections <= 3:
                self.step = min(1.4 * self.step, self.longest)
            elif new.corrections > 5:
                self.step *= 0.6
            return new
        self.step = 1e-3 * self.longest
        return None

    def _end_of_range(self, arc: Arc, last: Point, new: Point) -> OrbitStatus | None:
        end = self.span[0] if new.value < self.span[0] else self.span[1]
        part = (end - last.value) / (new.value - last.value)
        point = arc.path.at_value(last.z + part * (new.z - last.z), end)
        if point is None:
            return OrbitStatus.RANGE_END
        if point.tangent @ last.tangent < 0.0:
            point = dataclasses.replace(point, tangent=-point.tangent)
        edge = None if self.out and self._is_out(last) else self._edge(arc, last, point)
        if edge is not None:
            over = self._over(arc, last, edge, point)
            return over or (OrbitStatus.RANGE_END if self.beyond else None)
        self._look(arc, last, point)
        arc.points.append(point)
        self.count += 1
        return OrbitStatus.RANGE_END

    def _is_out(self, point: Point) -> bool:
        return any(low.value < -EDGE * low.size for low in point.margins.lows)

    def _beyond(self, arc: Arc, new: Point) -> OrbitStatus | None:
        """Record a point past an event, up to the limit for inadmissible points."""
        arc.points.append(new)
        self.count += 1
        self.out += self._is_out(new)
        return OrbitStatus.LEFT_ADMISSIBLE if self.out >= self.beyond else None

    def _edge(self, arc: Arc, last: Point, new: Point) -> Found | None:
        """Find the first event between two points, past which the orbit is inadmissible."""
        behind = new.margins.behind()
        out = [it for it in new.margins.lows if it.value < -EDGE * it.size and it not in behind]
        found: list[tuple[float, Found]] = []
        chord = new.z - last.z
        for low in sorted(out, key=lambda it: it.value / it.size)[:4]:
            test = _watched(low, arc.path.frame.word)
            if test(last) <= EDGE * low.size:
                # it begins on the edge: two lows of one minimum, or a start at an event
                if low.kind in BEGIN and len(arc.points) == 1:
                    found.append((0.0, Found(low.kind, last, low)))
                continue
            point = located(arc.path, last, new, test)
            if point is None:
                continue
            low = min(_same_kind(point.margins, low), key=lambda it: abs(it.value), default=low)
            found.append((float((point.z - last.z) @ chord), Found(low.kind, point, low)))
        if not found:
            return None
        first = min(it[0] for it in found) + TOGETHER * float(chord @ chord)
        # where a doubled orbit meets a single one that grazes one half dies, one begins
        return min((it for it in found if it[0] <= first), key=_order)[1]

    def _over(self, arc: Arc, last: Point, edge: Found, new: Point) -> OrbitStatus | None:
        """Record an event and continue with the event sequence past it."""
        if self.through and edge.kind in VANISHING and self._join(arc, last):
            return None
        self._look(arc, last, edge.point)
        if self.beyond:
            arc.events.append(edge)
            return self._beyond(arc, new)
        if edge.point is not last:
            arc.points.append(edge.point)
            self.count += 1
        arc.events.append(edge)
        if edge.low is not None and self.through and edge.kind in OPENING:
            return self._reopen(arc, edge.point, edge.low)
        if edge.kind == "interior_impact" and self.through:
            rest = rest_beyond(arc.path, edge.point, self.span)
            if rest is not None:
                return self._rest(rest)
        beyond = crossed(edge.point.terms, edge.low) if edge.low and self.through else None
        if beyond is None:
            together = edge.kind == "simultaneous"
            return OrbitStatus.SIMULTANEOUS if together else OrbitStatus.LEFT_ADMISSIBLE
        frame, y = beyond
        before, after = arc.path.frame.word, frame.word
        phases = np.sort(edge.point.terms.x[:, -1] % edge.point.terms.length)
        mark = (edge.kind, _letters(before), _letters(after), edge.point.value, phases)
        if any(it[:3] == mark[:3] and _same(it[3:], mark[3:]) for it in self.passed):
            return OrbitStatus.CLOSED
        self.passed.append(mark)
        try:
            path = Path(frame, arc.path.name, y, float(arc.path.scale[-1]))
            start = path.start(y, edge.point.value)
        except (ValueError, ArithmeticError):
            return OrbitStatus.LEFT_ADMISSIBLE
        sided = self._sided(path, start, float(edge.point.tangent[-1]))
        if sided is None:
            return OrbitStatus.LEFT_ADMISSIBLE
        self.arcs.append(Arc(path, [sided], admissible_near_start=True))
        self.step = min(self.step, 0.2 * self.longest)
        return None

    def _reopen(self, arc: Arc, edge: Point, low: Constraint) -> OrbitStatus | None:
        """Continue at an event at which a contact opens briefly."""
        found = reopened(arc.path, edge, low)
        if found is None:
            return OrbitStatus.LEFT_ADMISSIBLE
        self.arcs.append(Arc(found[0], [found[1]]))
        self.count += 1
        self.step = min(self.step, SHORT * self.longest)
        return None

    def _join(self, arc: Arc, last: Point) -> bool:
        """Continue without the opening of a contact once it has vanished."""
        found = rejoined(arc.path, last)
        if found is None:
            return False
        path, event, low = found
        still = isinstance(path.frame.flow, MassFlow) and path.frame.word[0] == STILL
        arc.events.append(Found("end_of_liftoff" if still else low.kind, event, low))
        self.arcs.append(Arc(path, [event]))
        self.count += 1
        self.step = 0.2 * self.longest
        return True

    def _rest(self, rest: tuple[Path, Point, Constraint]) -> OrbitStatus | None:
        """Continue with the resting orbit at an impact sequence that became a rest."""
        path, end, short = rest
        self.arcs[-1].events.append(Found("rest_appears", end, short))
        start = path.start(end.terms.y, value_of(end.terms.frame.system, path.name))
        row = (start.tangent * path.scale)[short.segment * path.frame.size :][: path.frame.size]
        away = start.tangent if row[-1] > row[0] else -start.tangent
        self.arcs.append(Arc(path, [dataclasses.replace(start, tangent=away)]))
        self.count += 1
        self.step = min(self.step, SHORT * self.longest)
        return None

    def _sided(self, path: Path, start: Point, along: float) -> Point | None:
        """Return the start with the tangent to the side on which the word is a motion."""
        sides = []
        for sign in (1.0, -1.0) if along * start.tangent[-1] >= 0.0 else (-1.0, 1.0):
            tangent = sign * start.tangent
            probe = path.correct(start.z + PROBE * tangent, tangent)
            if probe is None:
                continue
            least = probe.margins.least
            sides.append((0.0 if least is None else least.value / least.size, tangent))
        good = [tangent for value, tangent in sides if value > 0.0]
        return dataclasses.replace(start, tangent=good[0]) if good else None

    def _look(self, arc: Arc, last: Point, new: Point) -> None:
        """Find folds, doublings and turning pairs between two points."""
        if new is last:
            return
        found: list[tuple[str, Point]] = []
        symmetric = arc.path.frame.turn is not None
        if last.tangent[-1] * new.tangent[-1] < 0.0 and not _began(last):
            found += [("fold", it) for it in _singular(arc.path, last, new, 1.0)]
        if last.doubling * new.doubling < 0.0:
            kind = "pitchfork" if symmetric else "period_doubling"
            found += [(kind, it) for it in _singular(arc.path, last, new, -1.0)]
        for test in (_pairs, _turning):
            ends = test(last), test(new)
            # without damping and loss it is rounding along the whole branch
            if ends[0] * ends[1] < 0.0 and max(map(abs, ends)) > NO_TURNING:
                point = located(arc.path, last, new, test)
                # two real ones whose product is 1 turn nothing
                if point is not None and abs(point.turning) < CIRCLE:
                    found.append(("neimark_sacker", point))
                    break
        # the equations are singular where a slip only touches zero, whatever the factor
        found = [it for it in found if not _grazes(it[1])]
        chord = new.z - last.z
        for kind, point in sorted(found, key=lambda it: float((it[1].z - last.z) @ chord)):
            arc.events.append(Found(kind, point))

    def _mirrored(self, last: Point, new: Point) -> bool:
        """Whether a doubled orbit is, or passed, the single one: it would retrace itself."""
        before, now = halves_apart(last), halves_apart(new)
        if before is None or now is None:
            return False
        sizes = np.tile(row_sizes(new.terms), len(new.terms.x) // 2)
        apart = [float(np.linalg.norm(it / sizes)) for it in (before, now)]
        return bool(before @ now < 0.0) or apart[1] < min(HALVES_MEET, apart[0])

    def _closes(self, arc: Arc, last: Point, new: Point) -> bool:
        """Whether the branch passes its own start again."""
        if arc is not self.arcs[0] or len(arc.points) < 6:
            return False
        chord = new.z - last.z
        part = float((self.first.z - last.z) @ chord / (chord @ chord))
        if not 0.0 <= part <= 1.0 or new.tangent @ self.first.tangent < 0.5:
            return False
        off = last.z + part * chord - self.first.z
        return bool(np.linalg.norm(off) < 0.1 * np.linalg.norm(chord))


def _order(found: tuple[float, Found]) -> tuple[bool, float]:
    return found[1].kind != "grazing", found[0]


def _grazes(point: Point) -> bool:
    """Whether the speed of a slip reaches zero tangentially."""
    lows = [it for it in point.margins.lows if it.kind == "slip_grazing"]
    return any(abs(it.value) < SINGULAR * it.size for it in lows)


def _pairs(point: Point) -> float:
    return point.pairs


def _turning(point: Point) -> float:
    return point.turning


def _began(point: Point) -> bool:
    return bool(point.tangent[-1] == 0.0)


def _letters(word: tuple[object, ...]) -> tuple[object, ...]:
    """Return a word from the same letter on, wherever it begins."""
    turns = [word[k:] + word[:k] for k in range(len(word))]
    return min(turns, key=repr)


def _same(one: tuple[float, Array], other: tuple[float, Array]) -> bool:
    """Whether a parameter and the times of events are those of an event before."""
    return abs(one[0] - other[0]) < 1e-8 and bool(np.max(np.abs(one[1] - other[1])) < 1e-6)


def _same_kind(margins: Margins, low: Constraint) -> list[Constraint]:
    own = [it for it in margins.lows if it[:3] == low[:3]]
    near = [it for it in own if abs(it.t - low.t) < 0.05 * abs(margins.terms.length)]
    return near or own


def _watched(low: Constraint, word: Word) -> Callable[[Point], float]:
    """Return the test function of the constraint that became negative."""
    s = low.segment
    if low.kind == "simultaneous" and low.gap == word[s].gap:
        return lambda point: float(point.terms.x[s, -1] - point.terms.x[s, 0])

    def test(point: Point) -> float:
        own = _same_kind(point.margins, low)
        return min((it.value for it in own), default=1e-3 * low.size)

    return test


def _singular(path: Path, last: Point, new: Point, factor: float) -> list[Point]:
    """Find where the matrix is singular between two points, by its bordered system."""
    sides = [np.linalg.svd(it.terms.matrix(factor), compute_uv=False)[-1] for it in (last, new)]
    borders = bordered((last, new)[int(np.argmin(sides))].terms, factor)

    def test(point: Point) -> float:
        return float(sigma(point.terms, factor, borders))

    point = located(path, last, new, test)
    if point is None:
        return []
    least = float(np.linalg.svd(point.terms.matrix(factor), compute_uv=False)[-1])
    return [point] if least < 1e-7 * max(1.0, max(sides)) else []


def halves_apart(point: Point) -> Array | None:
    """Return half the difference of the halves of an orbit; None if it has no equal halves."""
    frame, x = point.terms.frame, point.terms.x
    k = len(frame.word)
    if k % 2 or frame.turn is not None or frame.word[: k // 2] != frame.word[k // 2 :]:
        return None
    first, second = x[: k // 2], x[k // 2 :].copy()
    second[:, [0, -1]] -= 0.5 * point.terms.length
    return np.asarray((0.5 * (second - first)).ravel(), np.float64)


def single_doubling(path: Path, point: Point) -> Point | None:
    """Find the period doubling of the single orbit at which a doubled one, of a point, begins."""
    apart = halves_apart(point)
    if apart is None:
        return None
    frame, x = point.terms.frame, point.terms.x
    k, length = len(x) // 2, 0.5 * point.terms.length
    half = dataclasses.replace(frame, word=frame.word[:k], length=length)
    try:
        y = half.joined(x[:k] + apart.reshape(k, -1), length)
        single = Path(half, path.name, y, float(path.scale[-1]))
        start = single.at_value(single.scaled(y, point.value), point.value)
    except FlightError:
        return None
    if start is None:
        return None
    borders = bordered(start.terms, -1.0)
    return located_near(single, start, lambda it: float(sigma(it.terms, -1.0, borders)))
