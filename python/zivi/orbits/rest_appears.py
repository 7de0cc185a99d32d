"""Where an orbit with ever more impacts turns into one that rests.

Near the end of a resting orbit, on its other side, there are orbits with a chain of impacts that
the force throws off before they accumulate. Their number grows without bound towards the end, by
one at each grazing: a branch of any of them ends there, and the point at which rest appears lies
near it. It is the end of the resting orbit, located from within it.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from zivi._check import Array
from zivi._parameters import with_value
from zivi.orbits.curve import Curve, Point
from zivi.orbits.orbit import PeriodicOrbit
from zivi.orbits.rest import resting_orbit
from zivi.orbits.rest_branch import Follower, ending

__all__ = ["rest_beyond"]

CHAIN = 3
"""Impacts, each slower than the one before, that make a chain."""
ALIKE = 0.05
"""How far the fastest impacts of both orbits may be apart, relative to the period and its speed."""
LOOKS = 12
FIRST = 1e-4


def rest_beyond(
    curve: Curve, edge: Point, span: tuple[float, float]
) -> tuple[float, PeriodicOrbit] | None:
    """Give the parameter near the end of a branch at which rest appears, and the orbit there.

    `edge` is where the branch ends with one impact more; it may have turned before, so both sides
    are looked at. None where there is no such orbit near it.
    """
    rows = edge.at.y
    if curve.frame.free or rows.ndim != 2 or not _is_chain(rows[:, 1]):
        return None
    outside = {1.0: edge.value, -1.0: edge.value}
    for look in range(LOOKS):
        for side in outside:
            value = edge.value + side * FIRST * 2.0**look * (span[1] - span[0])
            if not span[0] <= value <= span[1]:
                continue
            orbit = _resting(curve, rows, value)
            if orbit is None:
                outside[side] = value
                continue
            event = ending(Follower(orbit, curve.name), (value, orbit), outside[side])
            return (event.value, event.orbit) if event.kind == "end_of_rest" else None
    return None


def _is_chain(speeds: Array) -> bool:
    """Whether impacts, in any turn of the cycle, end with slower and slower ones."""
    k = len(speeds)
    if k <= CHAIN:
        return False
    turned = np.roll(speeds, -int(np.argmax(speeds)))
    falls = np.diff(turned) < 0.0
    return int(np.argmin(np.append(falls, False))) >= CHAIN


def _resting(curve: Curve, rows: Array, value: float) -> PeriodicOrbit | None:
    """Give the resting orbit with the fastest impact of an impacting one."""
    system = with_value(curve.system, curve.name, value)
    frame = dataclasses.replace(curve.frame, start=0.0)
    period = frame.period_of(system)
    t, u = rows[np.argmax(rows[:, 1])]
    slowest = rows[np.argmin(rows[:, 1]), 0]
    orbit = resting_orbit(system, frame, slowest - 0.125 * period, frame.multiple + 1)
    if not orbit.success or orbit.multiple != frame.multiple or not len(orbit.impacts):
        return None
    fastest = orbit.impacts[np.argmax(orbit.impacts["u"])]
    turn = (fastest["t"] - t) / (frame.multiple * period)
    apart = max(abs(turn - round(turn)), abs(fastest["u"] - u) / abs(u))
    return orbit if apart < ALIKE else None
