"""The end of rest in two parameters: its one-parameter event, again and again."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.branch import BranchEvent
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.branch import MechanicalEvent
from zivi.orbits.mechanical.by_parameter import moved_frame
from zivi.orbits.mechanical.curve import CurvePoint
from zivi.orbits.mechanical.family import value_of
from zivi.orbits.mechanical.path import Path, Point
from zivi.orbits.mechanical.resting import end_of_rest, shortest_rest, with_duration
from zivi.orbits.rest import resting_orbit
from zivi.orbits.rest_branch import follow_rest
from zivi.system.parameters import parameter, with_value

__all__ = ["rest_curve"]

ASIDE = (0.02, 0.01, 0.005, 0.05)
"""How far from the expected end the motion that rests begins, relative to it."""
RESTING = 0.02
"""The duration of the rests, in lengths of the word, from which ends of a mechanism are told."""
SHORTEST = 0.02
"""A step of the second parameter below this part of the first is given up."""
Names = tuple[str, str]


def rest_curve(
    event: BranchEvent | MechanicalEvent, names: Names, ranges: Array, step: float, most: int
) -> tuple[Array, list[CurvePoint], OrbitStatus]:
    """Give the values of both parameters, a row each, by the second one, and what was there."""
    orbit: Any = event.orbit
    ends: _OneMass | _Mechanism
    if isinstance(event, BranchEvent):
        second, ends = float(parameter(orbit.system, names[1])), _OneMass(orbit, names)
    else:
        second, ends = value_of(orbit.system, names[1]), _Mechanism(event, names)
    spacing = 2.5 * step * float(np.ptp(ranges[1]))
    sides: list[list[Array]] = []
    kept: list[list[CurvePoint]] = []
    status = OrbitStatus.RANGE_END
    for sign in (-1.0, 1.0):
        ends.begin()
        found, points = [np.array([event.value, second])], ends.first()
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
            end = ends.at(value, float(expected))
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
            points += ends.point
        sides.append(found)
        kept.append(points)
    values = np.array([*sides[0][:0:-1], *sides[1]])
    return values, [*kept[0][:0:-1], *kept[1]], status


class _OneMass:
    """The ends of rest of one mass."""

    point: list[CurvePoint]

    def __init__(self, orbit: Any, names: Names) -> None:
        self.orbit, self.names, self.point = orbit, names, []

    def begin(self) -> None:
        """Start anew from the event."""

    def first(self) -> list[CurvePoint]:
        """Give what is kept of the event: nothing."""
        return []

    def at(self, second: float, expected: float) -> float | None:
        """Find the end of rest at a value of the second parameter."""
        orbit, names = self.orbit, self.names
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


class _Mechanism:
    """The ends of rest of a mechanical system: each from an orbit whose rest has one duration."""

    def __init__(self, event: MechanicalEvent, names: Names) -> None:
        self.event, self.names = event, names
        self.point: list[CurvePoint] = []
        frame, y = event.orbit._frame, event.orbit._y
        path = Path(frame, names[0], y, abs(event.value) or 1.0)
        near = [path.start(y, value_of(frame.system, names[0]))]
        short = shortest_rest(near[0])
        if short is None:
            raise ValueError("event: its orbit has no contact")
        self.short, self.duration = short, RESTING * abs(near[0].terms.length)
        self.second = value_of(frame.system, names[1])
        self.start = near[0]
        length = short.value
        while length < self.duration:
            length = min(1.5 * length, self.duration)
            found = with_duration(path, near[-3:], short, length)
            if found is None:
                raise ValueError("event: the orbits before it could not be found")
            near.append(found)
        self.origin = near[-1]
        self.begin()

    def begin(self) -> None:
        """Start anew from the event."""
        self.near = [(self.second, self.origin)]

    def first(self) -> list[CurvePoint]:
        """Give the orbit of the event."""
        return [_kept(self.start, np.array([self.event.value, self.second]))]

    def at(self, second: float, expected: float) -> float | None:
        """Find the end of rest at a value of the second parameter."""
        (there, last), (before, other) = self.near[-1], self.near[-2:][0]
        y, first = last.terms.y, last.value
        if there != before:
            part = (second - there) / (there - before)
            y, first = y + part * (y - other.terms.y), first + part * (first - other.value)
        try:
            frame = moved_frame(last.terms.frame, {self.names[1]: second, self.names[0]: first})
            path = Path(frame, self.names[0], y, abs(self.event.value) or 1.0)
            guess = dataclasses.replace(last, z=path.scaled(y, first))
            found = with_duration(path, [guess], self.short, self.duration)
            nearer = found and with_duration(path, [found], self.short, 0.7 * self.duration)
        except (FlightError, ValueError, ArithmeticError):
            return None
        if found is None or nearer is None:
            return None
        wide = 10.0 * max(abs(nearer.value - found.value), abs(expected - found.value))
        end = end_of_rest(path, [found, nearer], (found.value - wide, found.value + wide))
        if end is None:
            return None
        self.near.append((second, found))
        self.point = [_kept(end[0], np.array([end[0].value, second]))]
        return end[0].value


def _kept(point: Point, values: Array) -> CurvePoint:
    return CurvePoint(
        point.z, point.terms, point.tangent, values, 0.0, point.corrections, point.residual
    )
