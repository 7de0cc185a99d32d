"""The way along a branch of periodic orbits, in both directions from one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import overload

import numpy as np

from zivi.base.check import finite, integer
from zivi.base.habits import hinted
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.along import failed_text, with_failed
from zivi.orbits.branch import MESSAGES, Branch, BranchEvent
from zivi.orbits.find import orbit_of, why_not
from zivi.orbits.mechanical.arc import Found, Way, single_doubling
from zivi.orbits.mechanical.branch import MechanicalBranch
from zivi.orbits.mechanical.family import value_of
from zivi.orbits.mechanical.follow import both_ways, follow, path_of
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.mechanical.path import Point
from zivi.orbits.orbit import PeriodicOrbit
from zivi.orbits.rest_appears import rest_beyond
from zivi.orbits.rest_branch import follow_rest
from zivi.orbits.sequence import Frame, as_word, rows_along
from zivi.simulation.run import pair

__all__ = ["continue_orbit"]

BEYOND = 3
"""Points that are followed where an orbit is no motion any more."""


@overload
def continue_orbit(
    orbit: MechanicalOrbit,
    name: str,
    span: Sequence[float],
    *,
    step: float = 0.02,
    max_points: int = 500,
    through: bool = True,
) -> MechanicalBranch: ...


@overload
def continue_orbit(
    orbit: PeriodicOrbit,
    name: str,
    span: Sequence[float],
    *,
    step: float = 0.02,
    max_points: int = 500,
    through: bool = True,
) -> Branch: ...


@hinted("continue_orbit")
def continue_orbit(
    orbit: PeriodicOrbit | MechanicalOrbit,
    name: str,
    span: Sequence[float],
    *,
    step: float = 0.02,
    max_points: int = 500,
    through: bool = True,
) -> Branch | MechanicalBranch:
    """Follow a periodic orbit over a parameter, through folds and grazings, in both directions.

    Parameters
    ----------
    orbit : PeriodicOrbit or MechanicalOrbit
        Where to begin. One that `Branch.switch` gave at a period doubling is followed away from it
        only.
    name : str
        The parameter, as in `sensitivity`.
    span : (float, float)
        Range of its values.
    step : float
        The first step along the arc, relative to the range, the period and the speeds; shorter for
        orbits of many periods. Steps adapt.
    max_points : int
        Most points.
    through : bool
        Of a `MechanicalOrbit`: whether the branch continues with another word where an impact
        grazes.

    Returns
    -------
    Branch or MechanicalBranch
        What was found, with its status.

    Raises
    ------
    ValueError
        For a parameter that there is not, a range that is none, an orbit that was not found.

    Examples
    --------
    >>> table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    >>> orbit = zivi.periodic_orbit(zivi.ImpactSystem(table, e=0.5), [(0.6, 2.1)])
    >>> branch = zivi.continue_orbit(orbit, "amplitude", (1.0, 1.6))
    >>> [(event.kind, round(event.value, 9)) for event in branch.events]
    [('fold', 1.047197551), ('period_doubling', 1.526823701)]
    """
    if not isinstance(orbit, PeriodicOrbit | MechanicalOrbit):
        raise TypeError(
            f"orbit must be a zivi.PeriodicOrbit or a zivi.MechanicalOrbit, got {orbit!r}"
        )
    value = value_of(orbit.system, name)
    low, high = (finite("span", end) for end in pair("span", span, "(low, high)"))
    if name == "e" and isinstance(orbit, PeriodicOrbit):
        low, high = max(low, 0.0), min(high, 1.0)
    if not low <= value <= high or low == high:
        raise ValueError(f"span must contain {name} = {value} of the orbit, got ({low}, {high})")
    if not 0.0 < finite("step", step) < 1.0:
        raise ValueError(f"step must be in (0, 1), got {step}")
    if integer("max_points", max_points) < 2:
        raise ValueError(f"max_points must be >= 2, got {max_points}")
    none = (OrbitStatus.NOT_CONVERGED, OrbitStatus.NOT_DIFFERENTIABLE, OrbitStatus.RESTS)
    if orbit.status in none:
        raise ValueError(f"orbit was not found: {orbit.message}")
    if isinstance(orbit, MechanicalOrbit):
        return follow(orbit, name, (low, high), step, max_points, through=through)
    if orbit.kind == "resting":
        return follow_rest(orbit, name, (low, high), step, max_points)
    return _follow(orbit, name, (low, high), step, max_points)


def _follow(
    orbit: PeriodicOrbit, name: str, span: tuple[float, float], step: float, most: int
) -> Branch:
    word, y = as_word(orbit.system, orbit._frame, orbit._y)
    path, start = path_of(word, name, y, span)
    step = step / 3.0 ** math.log2(orbit.multiple)
    away, side = orbit._away, None
    if away is not None:
        apart = rows_along(start.terms, (start.tangent * path.scale)[:-1]).reshape(away.shape)
        side = float(np.sum(apart * away / np.max(np.abs(orbit._y), axis=0) ** 2))

    def way(start: Point, most: int) -> Way:
        return Way(path, start, span, step, most, through=False, beyond=BEYOND)

    found = both_ways(way, start, most, most - most // 2, side)
    (arc,) = found.arcs
    orbits = [point_orbit(orbit._frame, point) for point in arc.points]
    events = [_event(orbit._frame, name, it, span) for it in found.events]
    behind, ahead = found.ways[-1], found.ways[0]
    if len(found.ways) > 1:
        events = [*_beyond(orbit._frame, name, behind, span), *events]
    events += _beyond(orbit._frame, name, ahead, span)
    values = np.array([point.value for point in arc.points])
    status = found.status
    if status is OrbitStatus.RETRACED:
        status = OrbitStatus.COMPLETED
    message = with_failed(MESSAGES[status], failed_text(orbits))
    return Branch(name, orbits, values, events, status, message, found.flights)


def _event(frame: Frame, name: str, found: Found, span: tuple[float, float]) -> BranchEvent:
    """Make an event: with the orbit there, or with the one that rests where rest appears."""
    orbit, value = point_orbit(frame, found.point, here=True), found.point.value
    rests = rest_beyond(orbit, name, value, span) if found.kind == "rest_appears" else None
    return BranchEvent(found.kind, value, orbit if rests is None else rests[1])


def _beyond(frame: Frame, name: str, way: Way, span: tuple[float, float]) -> list[BranchEvent]:
    """Give what is at the end of a way: a rest that appears, a doubling of the single orbit."""
    arc = way.arcs[-1]
    if way.status is OrbitStatus.LEFT_ADMISSIBLE and arc.events:
        last = arc.events[-1]
        orbit = point_orbit(frame, last.point, here=True)
        inserted = last.kind == "interior_impact"
        found = rest_beyond(orbit, name, last.point.value, span) if inserted else None
        return [] if found is None else [BranchEvent("rest_appears", *found)]
    if way.status is not OrbitStatus.RETRACED:
        return []
    single = single_doubling(arc.path, arc.points[-1])
    if single is None or not span[0] <= single.value <= span[1]:
        return []
    half = frame if frame.free else dataclasses.replace(frame, multiple=frame.multiple // 2)
    return [BranchEvent("period_doubling", single.value, point_orbit(half, single, here=True))]


def point_orbit(frame: Frame, point: Point, *, here: bool = False) -> PeriodicOrbit:
    """Give the orbit at a point; at an event (`here`) it is on the edge of being a motion."""
    why = None if here else why_not(point.margins)
    status = OrbitStatus.COMPLETED if why is None else OrbitStatus.LEFT_ADMISSIBLE
    message = why or "A point of a branch."
    error, steps = point.residual, point.corrections
    return orbit_of(frame, point.terms, error, steps, status, message, point.multipliers)
