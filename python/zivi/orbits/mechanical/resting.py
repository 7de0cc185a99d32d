r"""The end of rest: a contact whose duration vanishes.

The duration `D` goes like a power of the distance, :math:`|p - p_c| \sim D^{1/\beta}`, with an
infinite slope at the end, so that `D` is given and the parameter solved for: that is regular.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zivi.base.check import Array
from zivi.orbits.mechanical.margins import Low
from zivi.orbits.mechanical.path import Path, Point
from zivi.orbits.rest import chatter_exponent

__all__ = ["end_of_rest", "is_near", "shortest_rest", "with_duration"]

PULLS = (0.4, 0.7, 0.9, 0.97)
"""To which part the duration is shortened, as far as the equations can be solved there."""
MOST = 40
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
) -> tuple[Point, Low] | None:
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
    for _ in range(MOST):
        now = _duration(near[-1], short)
        tried = (with_duration(path, near, short, part * now) for part in PULLS)
        found = next((it for it in tried if it is not None), None)
        if found is None:
            break
        near = [*near[-2:], found]
        ends.append(_extrapolated(near, short))
        changes.append(abs(ends[-1] - ends[-2]))
        small = CLOSE * max(1.0, abs(ends[-1]))
        # where it is rounding that changes them, it is enough
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


def with_duration(path: Path, near: Sequence[Point], short: Low, duration: float) -> Point | None:
    """Give the orbit whose contact lasts so long, from one, two or three orbits beside it."""
    size, last = path.frame.size, near[-1]
    normal = np.zeros(len(last.z))
    at = short.segment * size
    normal[at], normal[at + size - 1] = -path.scale[at], path.scale[at + size - 1]
    if len(near) > 1:
        powers = (0.0, 1.0, _power(last, short))
        guess = np.array([it.z for it in near]).T @ _weights(near, short, powers, duration)
    else:
        part = (duration - _duration(last, short)) / (normal @ last.tangent)
        guess = last.z + part * last.tangent
    found = path.correct(guess, normal / np.linalg.norm(normal))
    return found if found is not None and _duration(found, short) > 0.0 else None


def _weights(near: Sequence[Point], short: Low, powers: Sequence[float], at: float) -> Array:
    """Give the weights of points whose sum is what powers of the duration make of them."""
    size = _duration(near[-1], short)
    own = np.array(powers if len(near) == 3 else powers[::2])
    rows = np.array([[(_duration(it, short) / size) ** p for p in own] for it in near])
    return np.asarray(np.linalg.solve(rows.T, (at / size) ** own), np.float64)


def _extrapolated(near: Sequence[Point], short: Low) -> float:
    """Give the end that points point to: `p` goes like ``D**power``, then one power more."""
    power = _power(near[-1], short)
    powers = (0.0, power, power + 1.0) if len(near) == 3 else (0.0, np.nan, power)
    weights = _weights(near, short, powers, 0.0)
    last = near[-1].value
    return last + float(weights @ [it.value - last for it in near])


def _power(point: Point, short: Low) -> float:
    """Give the power of the duration, which the restitution alone determines."""
    frame = point.terms.frame
    # a plastic impact closes at once, whatever the restitution
    plastic = frame.word[short.segment - 1].kind == "S"
    return 1.0 / chatter_exponent(0.0 if plastic else float(frame.flow.e[short.gap]))


def shortest_rest(point: Point) -> Low | None:
    """Give the contact that lasts the shortest time."""
    own = [it for it in point.margins.lows if it.kind == "end_of_rest"]
    return min(own, key=lambda it: it.value, default=None)


def _duration(point: Point, short: Low) -> float:
    """Give how long a contact lasts: it is handed on a little after its accumulation ends."""
    terms = point.terms
    row = terms.x[short.segment]
    chain = terms.accumulations.get((short.segment - 1) % len(terms.x))
    return float(row[-1] - row[0]) + (0.0 if chain is None else chain.t - chain.zeno)
