"""Where an orbit with ever more impacts turns into one that rests.

Near the end of a resting orbit, on its other side, there are orbits with a chain of impacts that
the force throws off before they accumulate. Their number grows without bound towards the end, by
one at each grazing: a branch of any of them ends there, and the point at which rest appears lies
near it. It is the end of the resting orbit, located from within it.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from zivi.base.check import Array
from zivi.orbits.orbit import PeriodicOrbit
from zivi.orbits.rest import force_at_rest, resting_orbit
from zivi.orbits.rest_branch import Follower, ending
from zivi.system.parameters import with_value

__all__ = ["rest_beyond"]

CHAIN = 3
"""Impacts, each slower than the one before, that make a chain."""
ALIKE = 0.05
"""How far the fastest impacts of both orbits may be apart, relative to the period and its speed."""
LOOKS = 12
FIRST = 1e-4


def rest_beyond(
    edge: PeriodicOrbit, name: str, end: float, span: tuple[float, float]
) -> tuple[float, PeriodicOrbit] | None:
    """Give the parameter near the end of a branch at which rest appears, and the orbit there.

    `edge` is where the branch ends with one impact more; it may have turned before, so both sides
    are looked at. None where there is no such orbit near it.
    """
    impacts, e = edge.impacts, edge.system.e
    if edge._frame.free or not len(impacts):
        return None
    speeds = -impacts["xdot_before"]
    if e > 0.0 and not _is_chain(speeds):
        return None
    # where the chain, or the one plastic impact that the force holds, is
    pulls = speeds if e > 0.0 else [force_at_rest(edge.system, float(t)) for t in impacts["t"]]
    slowest = int(np.argmin(pulls))
    near = _Impacting(impacts["t"], speeds, float(impacts["t"][slowest]))
    outside = {1.0: end, -1.0: end}
    for look in range(LOOKS):
        for side in outside:
            value = end + side * FIRST * 2.0**look * (span[1] - span[0])
            if not span[0] <= value <= span[1]:
                continue
            orbit = _resting(edge, name, near, value)
            if orbit is None:
                outside[side] = value
                continue
            event = ending(Follower(orbit, name), (value, orbit), outside[side])
            return (event.value, event.orbit) if event.kind == "end_of_rest" else None
    return None


@dataclasses.dataclass(frozen=True)
class _Impacting:
    """The orbit at the end of the branch."""

    times: Array
    speeds: Array
    """Of the impacts, before them."""
    slowest: float
    """When it nearly rests."""


def _is_chain(speeds: Array) -> bool:
    """Whether impacts, in any turn of the cycle, end with slower and slower ones."""
    k = len(speeds)
    if k <= CHAIN:
        return False
    turned = np.roll(speeds, -int(np.argmax(speeds)))
    falls = np.diff(turned) < 0.0
    return int(np.argmin(np.append(falls, False))) >= CHAIN


def _resting(
    edge: PeriodicOrbit, name: str, near: _Impacting, value: float
) -> PeriodicOrbit | None:
    """Give the resting orbit with the fastest impact of an impacting one."""
    system = with_value(edge.system, name, value)
    frame = dataclasses.replace(edge._frame, start=0.0)
    period, i = frame.period_of(system), int(np.argmax(near.speeds))
    phase = near.slowest - 0.125 * period
    orbit = resting_orbit(system, frame, phase, frame.multiple + 1)
    if not orbit.success or orbit.multiple != frame.multiple or not len(orbit.impacts):
        return None
    fastest = orbit.impacts[np.argmin(orbit.impacts["xdot_before"])]
    turn = (fastest["t"] - near.times[i]) / (frame.multiple * period)
    faster = -fastest["xdot_before"] / near.speeds[i] - 1.0
    return orbit if max(abs(turn - round(turn)), abs(faster)) < ALIKE else None
