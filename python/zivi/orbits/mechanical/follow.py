"""The way along a branch of orbits of a mechanical system, in both directions from one."""

from __future__ import annotations

import dataclasses

import numpy as np

from zivi.derivatives.result import OrbitStatus
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.arc import Arc, Found, Way
from zivi.orbits.mechanical.branch import MESSAGES, BranchArc, MechanicalBranch, MechanicalEvent
from zivi.orbits.mechanical.family import value_of
from zivi.orbits.mechanical.find import orbit_of
from zivi.orbits.mechanical.normal_form import cubic_coefficient
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.mechanical.path import Path, Point

__all__ = ["follow", "point_orbit"]

WEIGHTS = (
    OrbitStatus.RETRACED,
    OrbitStatus.RANGE_END,
    OrbitStatus.CLOSED,
    OrbitStatus.LEFT_ADMISSIBLE,
    OrbitStatus.SIMULTANEOUS,
    OrbitStatus.MAX_POINTS,
    OrbitStatus.NOT_CONVERGED,
)


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
    value, width = value_of(orbit.system, name), span[1] - span[0]
    try:
        path = Path(orbit._frame, name, orbit._y, width)
        start = path.start(orbit._y, value)
    except FlightError as error:
        raise ValueError("orbit: its flights cannot be computed") from error
    backward = dataclasses.replace(start, tangent=-start.tangent)
    away = orbit._away
    if away is not None:
        side = start.tangent[:-1] @ (away / path.scale[:-1])
        ways = [Way(path, start if side > 0.0 else backward, span, step, most, through=through)]
        statuses = [ways[0].go()]
        arcs, found = ways[0].arcs, _events(ways[0].arcs)
    else:
        first = Way(path, start, span, step, most, through=through)
        statuses = [first.go()]
        arcs, found = first.arcs, _events(first.arcs)
        ways = [first]
        if statuses[0] is not OrbitStatus.CLOSED:
            other = Way(path, backward, span, step, most - first.count + 1, through=through)
            statuses.append(other.go())
            ways.append(other)
            arcs, found = _both(other.arcs, first.arcs)
    status = max(statuses, key=WEIGHTS.index)
    multiple = orbit.multiple
    names = orbit.system.gap_names
    flights = sum(
        path.flights for path in {id(a.path): a.path for w in ways for a in w.arcs}.values()
    )
    return MechanicalBranch(
        name=name,
        arcs=[_arc(arc, multiple) for arc in arcs],
        events=[_event(it, multiple, names, name) for it in found],
        status=status,
        message=MESSAGES[status],
        n_flights=flights,
    )


def _events(arcs: list[Arc]) -> list[Found]:
    return [event for arc in arcs for event in arc.events]


def _both(back: list[Arc], ahead: list[Arc]) -> tuple[list[Arc], list[Found]]:
    """Join both directions: the arcs of the start are one."""
    turned = [Arc(arc.path, arc.points[::-1], arc.events[::-1]) for arc in back[::-1]]
    meeting = turned.pop()
    middle = Arc(
        ahead[0].path,
        meeting.points[:-1] + ahead[0].points,
        meeting.events + ahead[0].events,
    )
    arcs = [*turned, middle, *ahead[1:]]
    return arcs, _unlike(_events(arcs))


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
