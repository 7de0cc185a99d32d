"""Across the end of rest: from a contact to chains of impacts, and from a chain to a contact.

Beyond the end of a rest the force throws a chain of impacts off before they accumulate. The nearer
the end, the more impacts it has, by one at each grazing. A branch of such orbits is followed to a
chain of `MOST` impacts; the orbit that rests is then looked for on both sides, and the event
``rest_appears`` is the end of that rest.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.equations import Terms
from zivi.orbits.mechanical.margins import Low
from zivi.orbits.mechanical.path import Path, Point
from zivi.orbits.mechanical.resting import end_of_rest, shortest_rest, with_duration
from zivi.orbits.mechanical.run_word import NotDifferentiable, recent
from zivi.simulation.run import simulate

__all__ = ["rest_beyond"]

MOST = 8
"""Impacts of a chain, each slower than the one before, with which a rest is looked for."""
FIRST, LOOKS = 1e-4, 12
"""How far away it is looked for first, relative to the range, and how often, twice as far each."""
ALIKE = 0.05
"""How far apart, relatively, the fastest impacts of both orbits may be."""
RETURNS = 12
"""Lengths of the word that are simulated there."""


def rest_beyond(
    path: Path, edge: Point, span: tuple[float, float]
) -> tuple[Path, Point, Low] | None:
    """Give where rest appears near an orbit with a long chain: its path, the end, the contact.

    The point has the value of the end; its unknowns are those of the shortest rest computed.
    """
    first = _chain(edge.terms)
    if first is None or path.frame.free or path.frame.turn is not None:
        return None
    for value in _values(edge.value, span):
        found = _resting(path, edge, first, value)
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
    for look in range(LOOKS):
        away = FIRST * 2.0**look * (span[1] - span[0])
        yield from (it for it in (value + away, value - away) if span[0] <= it <= span[1])


def _chain(terms: Terms) -> int | None:
    """Give the first of a chain of impacts of a gap, each slower than the one before."""
    word, k, speeds = terms.frame.word, len(terms.frame.word), -np.asarray(terms.rates)
    for s, hit in enumerate(word):
        if hit.kind != "I" or hit.contacts:
            continue
        n = 1
        while n < k and word[(s + n) % k] == hit and speeds[(s + n) % k] < speeds[(s + n - 1) % k]:
            n += 1
        if n >= MOST:
            return s
    return None


def _resting(path: Path, edge: Point, first: int, value: float) -> tuple[Path, Point] | None:
    """Give the orbit that rests on which a run from a long chain settles, at another parameter."""
    frame, before = path.frame_at(value), edge.terms
    t, z = float(before.x[first, 0]), before.x[first, 1:-1]
    n, span = frame.flow.n, (t, t + RETURNS * frame.length)
    try:
        run = simulate(frame.system, span, (z[:n], z[n:]), frame.method)
        new, x, *_ = recent(frame.system, run, 1, frame.length, False, frame.method)
        gap = frame.word[first].gap
        rests, before_it = (
            sum(it.kind == "Z" and it.gap == gap for it in word) for word in (new.word, frame.word)
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
