"""The end of rest: a contact whose duration vanishes like a power of the distance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zivi.orbits.mechanical.margins import Low
from zivi.orbits.mechanical.path import Path, Point
from zivi.orbits.rest import chatter_exponent

__all__ = ["end_of_rest"]

PULLS = (0.95, 0.8, 0.5, 0.2)
"""Parts of the way to the extrapolated end, where the whole of it throws the mass off."""
MOST = 40


def end_of_rest(
    path: Path, points: Sequence[Point], span: tuple[float, float]
) -> tuple[Point, Low] | None:
    """Find where a contact lasts no time, by secants of the power that is smooth; None if not."""
    if len(points) < 2:
        return None
    last, before = points[-1], points[-2]
    short = min(_rests(last), key=lambda it: it.value, default=None)
    if short is None:
        return None
    e = float(last.terms.frame.flow.e[short.gap])
    if last.terms.frame.word[short.segment - 1].kind == "S":
        e = 0.0
    power = 1.0 / chatter_exponent(e)

    def smooth(point: Point) -> float:
        own = [it.value for it in _rests(point) if it.segment == short.segment]
        return float(max(own[0], 0.0) ** power) if own else np.nan

    for _ in range(MOST):
        now, then = smooth(last), smooth(before)
        if last.value == before.value or not now < then:
            return None
        end = last.value - now * (last.value - before.value) / (now - then)
        if not span[0] <= end <= span[1]:
            return None
        if abs(end - last.value) < 1e-12 * max(1.0, abs(end)):
            break
        step = (last.z - before.z) / (last.value - before.value)
        found = None
        for part in PULLS:
            value = last.value + part * (end - last.value)
            found = path.at_value(last.z + (value - last.value) * step, value)
            if found is not None and smooth(found) > 0.0:
                break
            found = None
        if found is None:
            break
        before, last = last, found
    if abs(end - last.value) > 1e-6 * max(1.0, abs(end)):
        return None
    # the extrapolated end itself is not a motion: the orbit is the last one before it
    z = last.z.copy()
    z[-1] = end / path.scale[-1]
    return Point(z, last.terms, last.tangent, end, last.corrections, last.residual), short


def _rests(point: Point) -> list[Low]:
    return [it for it in point.margins.lows if it.kind == "end_of_rest"]
