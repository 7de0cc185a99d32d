"""A bouncing mass under a force of time alone, arc by arc: nothing of zivi is used.

Over a part of the time in which the force ``f(t)`` is smooth

    x(t + h) = x + h x' + int (h - s) f(t + s) ds,      x'(t + h) = x' + int f(t + s) ds

are computed with Gauss's eight points, which is exact to rounding for parts that are short against
the scale of the force. An impact is found in them by Newton's method within a bracket; a chain is
followed until its arcs are so short that the rest of it is known to rounding.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES = [(0.5 * (1 + float(c)), 0.5 * float(w)) for c, w in zip(_NODES, _WEIGHTS, strict=True)]


@dataclasses.dataclass(frozen=True)
class Force:
    """A force of time: constant before `start` and after `end`, smooth over `scale` between."""

    at: Callable[[float], float]
    start: float
    end: float
    scale: float
    breaks: tuple = ()
    """Times at which it jumps."""


def step(g, a, t, width=0.0):
    """``-g``, from `t` on ``a - g``, over a time of `width`."""
    if width == 0.0:
        return Force(lambda s: (a if s > t else 0.0) - g, t, t, math.inf, (t,))
    smooth = lambda s: 0.5 * a * math.erfc((t - s) / width) - g  # noqa: E731
    return Force(smooth, t - 7 * width, t + 7 * width, width)


def pulse(g, a, t, length, width=0.0):
    """``a - g`` for the time `length` from `t` on, ``-g`` before and after."""
    end = t + length
    if width == 0.0:
        return Force(lambda s: (a if t < s < end else 0.0) - g, t, end, math.inf, (t, end))
    on, off = step(0.0, a, t, width), step(0.0, a, end, width)
    return Force(lambda s: on.at(s) - off.at(s) - g, on.start, off.end, width)


def harmonic(g, a, t, omega):
    """``-g``, from `t` on with an excitation that begins at zero."""
    excited = lambda s: (a * math.sin(omega * (s - t)) if s > t else 0.0) - g  # noqa: E731
    return Force(excited, t, math.inf, 1 / omega, (t,))


def advance(force, t, x, v, h):
    one = two = 0.0
    for c, w in NODES:
        f = w * force.at(t + c * h)
        one += f
        two += (1 - c) * f
    return x + h * (v + h * two), v + h * one


def part(force, t, h):
    """The longest part of `h` from `t` in which one quadrature is exact."""
    after = [b for b in (force.start, force.end, *force.breaks) if b > t]
    h = min([h] + [b - t for b in after])
    return min(h, 0.5 * force.scale) if force.start <= t < force.end else h


def first_impact(force, t, x, v, t_end):
    """Time and velocity of the first impact; the state at `t_end` if there is none."""
    while t < t_end:
        pull = abs(force.at(t)) + 1e-300
        arc = 2 * v / pull if x == 0.0 else (abs(v) + math.sqrt(v * v + 2 * pull * x)) / pull
        h = part(force, t, min(t_end - t, 0.4 * arc))
        x1, v1 = advance(force, t, x, v, h)
        if x1 < 0.0:
            low, high, s = 0.0, h, h
            for _ in range(100):
                x1, v1 = advance(force, t, x, v, s)
                low, high = (s, high) if x1 > 0.0 else (low, s)
                new = s - x1 / v1 if v1 < 0.0 else -1.0
                new = new if low < new < high else 0.5 * (low + high)
                if abs(new - s) <= 1e-16 * h:
                    break
                s = new
            return t + s, v1, True
        t, x, v = t + h, x1, v1
    return x, v, False


def first_rest(force, e, span, start, short=1e-6):
    """The impacts as ``(t, speed after)``, and the time of the first rest, or None."""
    (t, t_end), (x, v) = span, start
    impacts = []
    while True:
        where, velocity, hit = first_impact(force, t, x, v, t_end)
        if not hit:
            return impacts, None
        t, x, v = where, 0.0, -e * velocity
        impacts.append((t, v))
        g = -force.at(t)
        if g <= 0.0:
            continue
        scale = min(force.scale, 1.0) * (1 - e)
        near = [b - t for b in force.breaks if b > t]
        if 2 * v / g < short * min([scale, *near]):
            # to second order in the speed
            d = 1e-3 * min([scale, *near])
            slope = (force.at(t) - force.at(t + d)) / d if force.start <= t < force.end else 0.0
            z1 = 2 / (g * (1 - e))
            second = 4 * -slope / (3 * g**3) - z1 * e * 2 * -slope / (3 * g * g)
            second += 4 * e * -slope / (g**3 * (1 - e))
            return impacts, t + z1 * v + second / (1 - e * e) * v * v
