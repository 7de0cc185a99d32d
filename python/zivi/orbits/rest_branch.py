"""Branches of orbits that rest, and the parameter at which they end."""

from __future__ import annotations

import numpy as np

from zivi.derivatives.sensitivity import OrbitStatus
from zivi.orbits.along import failed_text, with_failed
from zivi.orbits.branch import MESSAGES, Branch, BranchEvent
from zivi.orbits.orbit import PeriodicOrbit
from zivi.orbits.rest import chatter_exponent, highest_pull, resting_orbit
from zivi.orbits.sequence import Frame
from zivi.system.parameters import parameter, with_value

__all__ = ["Follower", "ending", "follow_rest"]

Inside = tuple[float, PeriodicOrbit]
"""A value of the parameter, and the resting orbit there."""

CLOSEST = 1e-13
ENOUGH = 1e-11
"""Two roots in turn that differ by less, relative to them, are the end."""
SHORT = 1e-2
"""How far a look stays short of a root, relative to its distance: beyond is nothing to see."""
MOST_SECANTS = 12


class Follower:
    """Simulates the orbit at values of the parameter."""

    def __init__(self, orbit: PeriodicOrbit, name: str) -> None:
        self.orbit, self.name, self.runs = orbit, name, 0
        self.phase = (orbit.liftoff_time or 0.0) - 0.5 * (orbit.margin or 0.0)

    def at(self, value: float) -> PeriodicOrbit | None:
        """Give the orbit with as many periods as the first, None where there is none."""
        self.runs += 1
        first = self.orbit
        system = with_value(first.system, self.name, value)
        frame = Frame(first.multiple, first._frame.period, first._frame.method)
        found = resting_orbit(system, frame, self.phase, first.multiple + 1)
        same = found.success and found.multiple == first.multiple
        return found if same and (found.margin or 0.0) > 0.0 else None


def follow_rest(
    orbit: PeriodicOrbit, name: str, span: tuple[float, float], step: float, most: int
) -> Branch:
    """Follow an orbit that rests to both ends of a range, or of itself."""
    follower = Follower(orbit, name)
    width = span[1] - span[0]
    arms = [_arm(follower, end, step * width, most // 2) for end in span]
    (below, first, ends_below), (above, last, ends_above) = arms
    orbits = [*below[::-1], orbit, *above]
    values = np.array([parameter(it.system, name) for it in orbits])
    events = [it for it in (first, last) if it is not None]
    status = OrbitStatus.RANGE_END
    for ended in (ends_below, ends_above):
        status = ended if ended is not OrbitStatus.RANGE_END else status
    message = with_failed(MESSAGES[status], failed_text(orbits))
    return Branch(name, orbits, values, events, status, message, follower.runs)


def _arm(
    follower: Follower, end: float, step: float, most: int
) -> tuple[list[PeriodicOrbit], BranchEvent | None, OrbitStatus]:
    """Go from the first orbit towards one end of the range."""
    now = follower.orbit
    value = parameter(now.system, follower.name)
    sign = 1.0 if end > value else -1.0
    found: list[PeriodicOrbit] = []
    before: Inside | None = None
    while len(found) < most and value != end:
        new = value + sign * step
        if sign * (end - new) <= 1e-12 * step:
            new = end
        there = follower.at(new)
        if there is None:
            event = ending(follower, (value, now), new, before)
            return found, event, OrbitStatus.LEFT_ADMISSIBLE
        found.append(there)
        before, value, now = (value, now), new, there
    status = OrbitStatus.RANGE_END if value == end else OrbitStatus.MAX_POINTS
    return found, None, status


def ending(
    follower: Follower, inside: Inside, outside: float, before: Inside | None = None
) -> BranchEvent:
    """Find where the branch ends: where the time at rest vanishes, or the lift-off does.

    With ``s`` the time at rest ``s^(1/beta)`` is a smooth function of the parameter that vanishes
    at the end: its secants converge, those of ``s`` hardly do. `before` is a point further inside.
    """
    lifts = _end_of_liftoff(follower, inside, outside)
    if lifts is not None:
        return lifts
    beta = chatter_exponent(follower.orbit.system.e)
    value, orbit = inside
    step = outside - value
    points = [inside]
    if before is None and (near := follower.at(value - 0.25 * step)) is not None:
        before = (value - 0.25 * step, near)
    points = points if before is None else [before, inside]
    root = np.nan
    for _ in range(MOST_SECANTS):
        last, root = root, _root(points, beta)
        if abs(root - last) <= ENOUGH * abs(root):
            break
        guess = _next_guess(root, value, outside)
        if abs(guess - value) <= CLOSEST * max(abs(value), 1e-3):
            break
        there = follower.at(guess)
        if there is None:
            outside, root = guess, np.nan
            if abs(outside - value) <= 4e-12 * abs(value):
                break
            continue
        value, orbit = guess, there
        points.append((value, orbit))
    end = _root(points, beta)
    return BranchEvent("end_of_rest", end if np.isfinite(end) else value, orbit)


def _end_of_liftoff(follower: Follower, inside: Inside, outside: float) -> BranchEvent | None:
    """Find where the force at rest no longer becomes positive, if that is why there is no orbit."""
    first, period = follower.orbit, follower.orbit.period

    def highest(value: float) -> float:
        return highest_pull(with_value(first.system, follower.name, value), period)

    (low, orbit), high = inside, outside
    one, other = highest(low), highest(high)
    if other > 0.0 or one <= 0.0:
        return None
    for _ in range(60):
        middle = low - one * (high - low) / (other - one)
        if not min(low, high) < middle < max(low, high):
            middle = 0.5 * (low + high)
        value = highest(middle)
        if value > 0.0:
            low, one = middle, value
        else:
            high, other = middle, value
        if abs(value) < 1e-14 or abs(high - low) < 1e-15 * abs(high):
            break
    return BranchEvent("end_of_liftoff", middle, orbit)


def _root(points: list[Inside], beta: float) -> float:
    """Give the zero of the line through the last two values of ``s^(1/beta)``."""
    if len(points) < 2:
        return np.nan
    (p, one), (q, other) = points[-2:]
    a, b = ((it.margin or 0.0) ** (1.0 / beta) for it in (one, other))
    return q - b * (q - p) / (b - a) if a != b else np.nan


def _next_guess(root: float, inside: float, outside: float) -> float:
    """Give the next place to look: short of the root, or the middle of the bracket."""
    if min(inside, outside) < root < max(inside, outside):
        return float(inside + (1.0 - SHORT) * (root - inside))
    return 0.5 * (inside + outside)
