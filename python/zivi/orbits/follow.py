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
from zivi.orbits.arc import Arc, Found
from zivi.orbits.branch import MESSAGES, Branch, BranchEvent
from zivi.orbits.curve import Curve, Point
from zivi.orbits.find import orbit_of, why_not
from zivi.orbits.mechanical.branch import MechanicalBranch
from zivi.orbits.mechanical.family import value_of
from zivi.orbits.mechanical.follow import follow
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.orbit import PeriodicOrbit
from zivi.orbits.rest_appears import rest_beyond
from zivi.orbits.rest_branch import follow_rest
from zivi.simulation.run import pair
from zivi.system.parameters import parameter

__all__ = ["continue_orbit"]


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
    if isinstance(orbit, MechanicalOrbit):
        value = value_of(orbit.system, name)
    else:
        value = parameter(orbit.system, name)
    low, high = (finite("span", end) for end in pair("span", span, "(low, high)"))
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
    y, value = orbit._y, parameter(orbit.system, name)
    curve = Curve(orbit.system, orbit._frame, name, y, span[1] - span[0])
    start = curve.start(y, value)
    if start is None:
        raise ValueError("orbit: its flights cannot be computed")
    step = step / 3.0 ** math.log2(orbit.multiple)
    away = orbit._away
    forward, backward = (start, dataclasses.replace(start, tangent=-start.tangent))
    if away is not None:
        if start.tangent[:-1] @ (away.ravel() / curve.scale[:-1]) < 0.0:
            forward, backward = backward, forward
        arcs = [Arc(curve, forward, span, step, most).go()]
        points, found = arcs[0].points, arcs[0].events
    else:
        first = Arc(curve, backward, span, step, most // 2).go()
        second = Arc(curve, forward, span, step, most - len(first.points)).go()
        arcs = [first, second]
        points = first.points[:0:-1] + second.points
        found = first.events[::-1] + second.events
    # a start on the edge shows the same event to both sides
    found = [it for i, it in enumerate(found) if i == 0 or not _same(it, found[i - 1])]
    status = max((arc.status for arc in arcs), key=_weight)
    orbits = [_orbit(curve, point) for point in points]
    events = [_event(it, span) for it in found]
    if away is None:
        events = [*_rest(curve, arcs[0], span), *events]
    events += _rest(curve, arcs[-1], span)
    values = np.array([point.value for point in points])
    return Branch(name, orbits, values, events, status, MESSAGES[status], curve.flights)


def _event(found: Found, span: tuple[float, float]) -> BranchEvent:
    """Make an event: with the orbit there, or with the one that rests where rest appears."""
    kind, point, curve = found
    rests = rest_beyond(curve, point, span) if kind == "rest_appears" else None
    orbit = _orbit(curve, point, here=True) if rests is None else rests[1]
    return BranchEvent(kind, point.value, orbit)


def _rest(curve: Curve, arc: Arc, span: tuple[float, float]) -> list[BranchEvent]:
    """Give where rest appears beyond the end of an arc, if it does."""
    if arc.status is not OrbitStatus.LEFT_ADMISSIBLE or not arc.events:
        return []
    last = arc.events[-1]
    found = rest_beyond(curve, last.point, span) if last.kind == "interior_impact" else None
    return [] if found is None else [BranchEvent("rest_appears", *found)]


def _same(one: Found, other: Found) -> bool:
    if one.kind != other.kind or one.curve is not other.curve:
        return False
    return float(np.max(np.abs(one.point.z - other.point.z))) < 1e-9


def _weight(status: OrbitStatus) -> int:
    order = (
        OrbitStatus.COMPLETED,
        OrbitStatus.RANGE_END,
        OrbitStatus.LEFT_ADMISSIBLE,
        OrbitStatus.MAX_POINTS,
        OrbitStatus.NOT_CONVERGED,
    )
    return order.index(status)


def _orbit(curve: Curve, point: Point, *, here: bool = False) -> PeriodicOrbit:
    """Give the orbit at a point; at an event (`here`) it is on the edge of being a motion."""
    system = curve.system_at(point.value)
    why = None if here else why_not(system, point.at)
    status = OrbitStatus.COMPLETED if why is None else OrbitStatus.LEFT_ADMISSIBLE
    error = float(np.max(np.abs(point.at.residual / curve.sizes)))
    message = why or "A point of a branch."
    return orbit_of(system, curve.frame, point.at, error, point.corrections, status, message)
