"""The way along a branch of orbits of a mechanical system, in both directions from one."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.along import failed_text, with_failed
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.arc import Arc, Found, Way
from zivi.orbits.mechanical.branch import MESSAGES, BranchArc, MechanicalBranch, MechanicalEvent
from zivi.orbits.mechanical.equations import Frame
from zivi.orbits.mechanical.family import value_of
from zivi.orbits.mechanical.find import orbit_of
from zivi.orbits.mechanical.normal_form import cubic_coefficient
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.mechanical.path import Path, Point

__all__ = ["Followed", "both_ways", "follow", "path_of", "point_orbit"]

WEIGHTS = (
    OrbitStatus.RETRACED,
    OrbitStatus.RANGE_END,
    OrbitStatus.CLOSED,
    OrbitStatus.LEFT_ADMISSIBLE,
    OrbitStatus.SIMULTANEOUS,
    OrbitStatus.MAX_POINTS,
    OrbitStatus.NOT_CONVERGED,
)


class Followed(NamedTuple):
    """What was found in both directions."""

    arcs: list[Arc]
    events: list[Found]
    status: OrbitStatus
    """Of the two ends the one that needs more attention."""
    flights: int
    ways: list[Way]


def follow(
    orbit: MechanicalOrbit,
    name: str,
    span: tuple[float, float],
    step: float,
    most: int,
    *,
    through: bool,
) -> MechanicalBranch:
    """Follow an orbit over a parameter: `zivi.continue_orbit` of a mechanical system."""
    path, start = path_of(orbit._frame, name, orbit._y, span)
    away = orbit._away
    side = None if away is None else float(start.tangent[:-1] @ (away / path.scale[:-1]))

    def way(start: Point, most: int) -> Way:
        return Way(path, start, span, step, most, through=through)

    found = both_ways(way, start, most, most, side)
    multiple, names = orbit.multiple, orbit.system.gap_names
    arcs = [_arc(arc, multiple) for arc in found.arcs]
    failed = failed_text([orbit for arc in arcs for orbit in arc.orbits])
    return MechanicalBranch(
        name=name,
        arcs=arcs,
        events=[_event(it, multiple, names, name) for it in found.events],
        status=found.status,
        message=with_failed(MESSAGES[found.status], failed),
        n_flights=found.flights,
    )


def path_of(frame: Frame, name: str, y: Array, span: tuple[float, float]) -> tuple[Path, Point]:
    """Give the solutions of a word over a parameter, and the point of one of them."""
    try:
        path = Path(frame, name, y, span[1] - span[0])
        return path, path.start(y, value_of(frame.system, name))
    except FlightError as error:
        raise ValueError("orbit: its flights cannot be computed") from error


def both_ways(
    way: Callable[[Point, int], Way], start: Point, most: int, first: int, side: float | None
) -> Followed:
    """Go both ways from a point, at first so many points, or one if a side is given."""
    backward = dataclasses.replace(start, tangent=-start.tangent)
    if side is not None:
        ways = [way(start if side > 0.0 else backward, most)]
    else:
        ways = [way(start, first)]
    status = ways[0].go()
    arcs = ways[0].arcs
    if side is None and status is not OrbitStatus.CLOSED:
        ways.append(way(backward, most - ways[0].count + 1))
        status = max(status, ways[1].go(), key=WEIGHTS.index)
        arcs = _both(ways[1].arcs, arcs)
    paths = {id(arc.path): arc.path for it in ways for arc in it.arcs}
    flights = sum(path.flights for path in paths.values())
    return Followed(arcs, _unlike(_events(arcs)), status, flights, ways)


def _events(arcs: list[Arc]) -> list[Found]:
    return [event for arc in arcs for event in arc.events]


def _both(back: list[Arc], ahead: list[Arc]) -> list[Arc]:
    """Join both directions: the arcs of the start are one."""
    turned = [Arc(arc.path, arc.points[::-1], arc.events[::-1]) for arc in back[::-1]]
    meeting = turned.pop()
    middle = Arc(
        ahead[0].path,
        meeting.points[:-1] + ahead[0].points,
        meeting.events + ahead[0].events,
    )
    return [*turned, middle, *ahead[1:]]


def _unlike(found: list[Found]) -> list[Found]:
    """Leave out what both directions saw at the start."""
    kept: list[Found] = []
    for it in found:
        same = [
            other
            for other in kept[-2:]
            if other.kind == it.kind
            and len(other.point.z) == len(it.point.z)
            and np.max(np.abs(other.point.z - it.point.z)) < 1e-9
        ]
        if not same:
            kept.append(it)
    return kept


def point_orbit(point: Point, multiple: int, *, here: bool = False) -> MechanicalOrbit:
    """Give the orbit at a point; at an event (`here`) it is on the edge of being a motion."""
    why = None if here else point.margins.why_not(1e-9)
    message = "A point of a branch."
    return orbit_of(point.terms, multiple, point.residual, point.corrections, why, message=message)


def _arc(arc: Arc, multiple: int) -> BranchArc:
    orbits = [point_orbit(point, multiple) for point in arc.points]
    return BranchArc(orbits[0].word, orbits, np.array([point.value for point in arc.points]))


def _event(found: Found, multiple: int, gaps: tuple[str, ...], name: str) -> MechanicalEvent:
    point, kappa, gap = found.point, None, None
    orbit = point_orbit(point, multiple, here=True)
    if found.kind == "neimark_sacker":
        own = point.multipliers[np.imag(point.multipliers) > 0.0]
        near = own[int(np.argmin(np.abs(np.abs(own) - 1.0)))]
        kappa = float(np.real(near) / abs(near))
    if found.low is not None and found.low.gap >= 0:
        gap = gaps[found.low.gap]
    doubles = found.kind in ("period_doubling", "pitchfork")
    cubic = cubic_coefficient(point.terms) if doubles else None
    return MechanicalEvent(found.kind, point.value, orbit, gap, kappa, name, cubic)
