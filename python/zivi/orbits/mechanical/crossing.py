"""Other words at an event: without an impact that grazes, with one that begins."""

from __future__ import annotations

import dataclasses

import numpy as np

from zivi.base.check import Array
from zivi.orbits.mechanical.equations import Frame, Terms
from zivi.orbits.mechanical.flow import uncoupled
from zivi.orbits.mechanical.margins import Low
from zivi.orbits.mechanical.word import MOST_LETTERS, Segment

__all__ = ["crossed"]


def crossed(terms: Terms, low: Low) -> tuple[Frame, Array] | None:
    """Give the frame and the unknowns of the word beyond an event; None where there is none."""
    segment = terms.frame.word[low.segment]
    if low.kind == "interior_impact":
        return _inserted(terms, low)
    if low.kind == "simultaneous":
        return _swapped(terms, low)
    if low.kind != "grazing":
        return None
    if segment.kind == "Z":
        return _later(terms, low.segment)
    if segment.kind == "I" and segment.after == segment.contacts:
        return _dropped(terms, low.segment)
    return None


def _dropped(terms: Terms, s: int) -> tuple[Frame, Array] | None:
    """Merge the segments before and after an impact of no speed."""
    frame, x = terms.frame, terms.x
    word = frame.word
    k = len(word)
    if k == 1:
        return _without(terms)
    after = (s + 1) % k
    turned, length = x.copy(), terms.length
    if after == 0:
        # the last event goes: the first segment begins where the last one did
        turned[0, :-1] = x[s, :-1]
        turned[0, 0] -= length
        if frame.turn is not None:
            turned[0, 1:-1] = np.linalg.inv(frame.turn) @ x[s, 1:-1]
    else:
        turned[after, :-1] = x[s, :-1]
    kept = [j for j in range(k) if j != s]
    new = tuple(word[j] for j in kept)
    return _reframed(frame, new, turned[kept], length)


def _without(terms: Terms) -> tuple[Frame, Array]:
    """Give the motion without its only impact: a section instead of it."""
    frame, x = terms.frame, terms.x.copy()
    segment = frame.word[0]
    word = (Segment(segment.contacts, "P", -1, segment.contacts),)
    if frame.free:
        gap = frame.flow.gap(segment.gap, float(x[0, -1]), terms.segments.flights.z[0])
        section: float | int = int(np.argmax(np.abs(gap.by_z[: frame.flow.n])))
    else:
        section = float(x[0, -1])
    new = dataclasses.replace(frame, word=word, section=section)
    return new, new.joined(x, terms.length)


def _inserted(terms: Terms, low: Low) -> tuple[Frame, Array] | None:
    """Split a segment at the minimum of a gap that touches."""
    frame, x, s = terms.frame, terms.x, low.segment
    segment = frame.word[s]
    if len(frame.word) >= MOST_LETTERS:
        return None
    t0 = float(x[s, 0])
    before = frame.flow.path(segment.contacts, t0, x[s, 1:-1], np.array([low.t]))[0]
    e = float(frame.flow.e[low.gap])
    after = frame.flow.impact(low.gap, segment.contacts, low.t, before, e).z
    first, second = x[s].copy(), x[s].copy()
    first[-1] = low.t
    second[0], second[1:-1] = low.t, after
    hit = Segment(segment.contacts, "I", low.gap, segment.contacts)
    if segment.kind == "P":
        # the impact takes the place of the section
        row = first.copy()
        row[:-1] = second[:-1]
        row[0] -= terms.length
        if frame.turn is not None:
            row[1:-1] = np.linalg.inv(frame.turn) @ row[1:-1]
        return _reframed(frame, (hit,), row[None], terms.length)
    word = (*frame.word[:s], hit, *frame.word[s:])
    rows = np.vstack([x[:s], first, second, x[s + 1 :]])
    return _reframed(frame, word, rows, terms.length)


def _swapped(terms: Terms, low: Low) -> tuple[Frame, Array] | None:
    """Let two impacts at once change places, where neither gap feels the other."""
    frame, x, s = terms.frame, terms.x.copy(), low.segment
    first, second = frame.word[s - 1], frame.word[s]
    flow, plain = frame.flow, all(it.kind == "I" for it in (first, second))
    # where a gap is least at the impact of another one they are coupled
    if low.gap != second.gap or first.gap == low.gap or not plain or s == 0:
        return None
    t, before = float(x[s, -1]), terms.segments.flights.z[s - 1]
    if not uncoupled(flow, [first.gap, second.gap], t, before):
        return None
    x[s - 1, -1] = x[s, 0] = t
    x[s, 1:-1] = flow.impact(second.gap, second.kept, t, before, float(flow.e[second.gap])).z
    word = (*frame.word[: s - 1], second, first, *frame.word[s + 1 :])
    return _reframed(frame, word, x, terms.length)


def _later(terms: Terms, s: int) -> tuple[Frame, Array] | None:
    """Let an accumulation begin with its second impact."""
    impacts = terms.accumulations[s].impacts
    if not len(impacts):
        return None
    x = terms.x.copy()
    x[s, -1] = float(impacts["t"][0])
    return terms.frame, terms.frame.joined(x, terms.length)


def _reframed(
    frame: Frame, word: tuple[Segment, ...], x: Array, length: float
) -> tuple[Frame, Array]:
    new = dataclasses.replace(frame, word=word)
    return new, new.joined(x, length)
