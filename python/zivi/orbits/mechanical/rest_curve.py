"""The end of rest of one mass in two parameters: its one-parameter event, again and again."""

from __future__ import annotations

from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.branch import BranchEvent
from zivi.orbits.rest import resting_orbit
from zivi.orbits.rest_branch import follow_rest
from zivi.system.parameters import parameter, with_value

__all__ = ["rest_curve"]

ASIDE = (0.02, 0.01, 0.005, 0.05)
"""How far from the expected end the motion that rests begins, relative to it."""
SHORTEST = 0.02
"""A step of the second parameter below this part of the first is given up."""


def rest_curve(
    event: BranchEvent, names: tuple[str, str], ranges: Array, step: float, most: int
) -> tuple[Array, OrbitStatus]:
    """Give the values of both parameters, a row each, by the second one."""
    orbit = event.orbit
    second = float(parameter(orbit.system, names[1]))
    spacing = 2.5 * step * float(np.ptp(ranges[1]))
    sides: list[list[Array]] = []
    status = OrbitStatus.RANGE_END
    for sign in (-1.0, 1.0):
        found = [np.array([event.value, second])]
        behind = sides[0][1] if sides and len(sides[0]) > 1 else None
        far = spacing
        while len(found) < most // 2:
            value = found[-1][1] + sign * far
            if (value - ranges[1, 0]) * (value - ranges[1, 1]) > 0.0:
                value = float(ranges[1, 0] if sign < 0.0 else ranges[1, 1])
            if abs(value - found[-1][1]) < 1e-12:
                break
            expected, last = found[-1][0], found[-2] if len(found) > 1 else behind
            if last is not None:
                slope = (found[-1] - last)[0] / (found[-1] - last)[1]
                expected += slope * (value - found[-1][1])
            end = _end(orbit, names, value, float(expected))
            if end is None:
                far *= 0.5
                if far < SHORTEST * spacing:
                    status = OrbitStatus.NOT_CONVERGED
                    break
                continue
            far = min(2.0 * far, spacing)
            if not ranges[0, 0] <= end <= ranges[0, 1]:
                break
            found.append(np.array([end, value]))
        sides.append(found)
    return np.array([*sides[0][:0:-1], *sides[1]]), status


def _end(orbit: Any, names: tuple[str, str], second: float, expected: float) -> float | None:
    """Find the end of rest at a value of the second parameter."""
    for aside in ASIDE:
        for side in (-1.0, 1.0):
            first = expected * (1.0 + side * aside)
            system = with_value(with_value(orbit.system, names[1], second), names[0], first)
            phase = (orbit.liftoff_time or 0.0) - 0.02 * orbit.period
            near = resting_orbit(system, orbit._frame, phase)
            if near.status is not OrbitStatus.COMPLETED or near.multiple != orbit.multiple:
                continue
            span = sorted((first, expected * (1.0 - 3.0 * side * aside)))
            branch = follow_rest(near, names[0], (span[0], span[1]), 0.05, 100)
            ends = [it.value for it in branch.events if it.kind == "end_of_rest"]
            if ends:
                return float(min(ends, key=lambda it: abs(it - expected)))
    return None
