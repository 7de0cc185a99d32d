"""Continuation of a branch in both directions, and branch switching."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, overload

import numpy as np

from zivi.base.check import Array, finite, integer
from zivi.base.habits import hinted
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.arc import Arc, Found, Way, single_doubling
from zivi.orbits.branch import (
    MASS_MESSAGES,
    MECHANICAL_MESSAGES,
    Branch,
    BranchArc,
    BranchEvent,
    Follower,
    MechanicalBranch,
    MechanicalEvent,
    failed_text,
    follow_rest,
    rest_beyond,
    with_failed,
)
from zivi.orbits.critical import crossed, cubic_coefficient, twice
from zivi.orbits.equations import Frame, Frame as WordFrame, Terms, evaluate
from zivi.orbits.find import apex, checked, orbit_of, periodic_orbit, solve, why_not
from zivi.orbits.flows import FlightError, fly
from zivi.orbits.orbit import MassFrame, MechanicalOrbit, PeriodicOrbit, as_word, rows_along
from zivi.orbits.path import Margins, Path, Point, moved_frame, value_of
from zivi.orbits.words import NotDifferentiable, orbit_of_word, recent, solve_word
from zivi.simulation.run import pair, simulate
from zivi.system.parameters import with_value

__all__ = [
    "Followed",
    "both_ways",
    "continue_orbit",
    "follow",
    "mechanical_point_orbit",
    "mechanical_switched",
    "path_of",
    "switched",
]

# The way along a branch of orbits of a mechanical system, in both directions from one.

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
        events=[_mechanical_event(it, multiple, names, name) for it in found.events],
        status=found.status,
        message=with_failed(MECHANICAL_MESSAGES[found.status], failed),
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


def mechanical_point_orbit(point: Point, multiple: int, *, here: bool = False) -> MechanicalOrbit:
    """Give the orbit at a point; at an event (`here`) it is on the edge of being a motion."""
    why = None if here else point.margins.why_not(1e-9)
    message = "A point of a branch."
    return orbit_of_word(
        point.terms, multiple, point.residual, point.corrections, why, message=message
    )


def _arc(arc: Arc, multiple: int) -> BranchArc:
    orbits = [mechanical_point_orbit(point, multiple) for point in arc.points]
    return BranchArc(orbits[0].word, orbits, np.array([point.value for point in arc.points]))


def _mechanical_event(
    found: Found, multiple: int, gaps: tuple[str, ...], name: str
) -> MechanicalEvent:
    point, kappa, gap = found.point, None, None
    orbit = mechanical_point_orbit(point, multiple, here=True)
    if found.kind == "neimark_sacker":
        own = point.multipliers[np.imag(point.multipliers) > 0.0]
        near = own[int(np.argmin(np.abs(np.abs(own) - 1.0)))]
        kappa = float(np.real(near) / abs(near))
    if found.low is not None and found.low.gap >= 0:
        gap = gaps[found.low.gap]
    doubles = found.kind in ("period_doubling", "pitchfork")
    cubic = cubic_coefficient(point.terms) if doubles else None
    return MechanicalEvent(found.kind, point.value, orbit, gap, kappa, name, cubic)


# The way along a branch of periodic orbits, in both directions from one.

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
    message = with_failed(MASS_MESSAGES[status], failed_text(orbits))
    return Branch(name, orbits, values, events, status, message, found.flights)


def _event(frame: MassFrame, name: str, found: Found, span: tuple[float, float]) -> BranchEvent:
    """Make an event: with the orbit there, or with the one that rests where rest appears."""
    orbit, value = point_orbit(frame, found.point, here=True), found.point.value
    rests = rest_beyond(orbit, name, value, span) if found.kind == "rest_appears" else None
    return BranchEvent(found.kind, value, orbit if rests is None else rests[1])


def _beyond(frame: MassFrame, name: str, way: Way, span: tuple[float, float]) -> list[BranchEvent]:
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


def point_orbit(frame: MassFrame, point: Point, *, here: bool = False) -> PeriodicOrbit:
    """Give the orbit at a point; at an event (`here`) it is on the edge of being a motion."""
    why = None if here else why_not(point.margins)
    status = OrbitStatus.COMPLETED if why is None else OrbitStatus.LEFT_ADMISSIBLE
    message = why or "A point of a branch."
    error, steps = point.residual, point.corrections
    return orbit_of(frame, point.terms, error, steps, status, message, point.multipliers)


# From an event of a branch to the branch that meets it there.

MECHANICAL_AMPLITUDES = (5e-3, 1e-3, 1e-4, 1e-5)
"""How far the new orbit is from the event, in scaled unknowns."""
ROUNDING = 1e-14
"""The residual of the new orbit: beside a doubling it is ill conditioned."""
DISTANCES = (1e-3, 6e-4, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6)
"""How far beyond the end of a rest orbits are looked for, relative to the parameter."""
RETURNS = 12
"""Periods of the motion that are simulated there."""


def mechanical_switched(branch: MechanicalBranch, event: MechanicalEvent) -> MechanicalOrbit:
    """Give an orbit on the other branch."""
    if event.kind in ("period_doubling", "pitchfork"):
        return _mechanical_doubled(branch, event)
    if event.kind in ("grazing", "interior_impact"):
        return _crossed(event)
    if event.kind == "end_of_rest":
        return _thrown_off(branch, event)
    return event.orbit


def _crossed(event: MechanicalEvent) -> MechanicalOrbit:
    orbit = event.orbit
    terms = evaluate(orbit._frame, orbit._y)
    own = [low for low in Margins(terms).lows if low.kind == event.kind]
    least = min(own, key=lambda it: abs(it.value) / it.size, default=None)
    beyond = None if least is None else crossed(terms, least)
    if beyond is None:
        return orbit
    found = solve_word(*beyond, orbit.multiple)
    if found.status is OrbitStatus.LEFT_ADMISSIBLE and found.depth < 1e-8:
        # whether a simulation sees an impact that grazes is rounding
        done = OrbitStatus.COMPLETED
        return dataclasses.replace(found, status=done, admissible=True, message="It grazes.")
    return found


def _thrown_off(branch: MechanicalBranch, event: MechanicalEvent) -> MechanicalOrbit:
    """Find the orbit of finitely many impacts that meets the resting one at its end.

    The nearer the end, the more impacts it has, and it grazes wherever their number changes: of
    some distances the first at which a run leads to a motion is taken.
    """
    orbit, name = event.orbit, branch.name
    sign = np.sign(event.value - float(np.mean(branch.values))) or 1.0
    s = max(
        (k for k, it in enumerate(orbit._word) if it.kind == "Z"),
        key=lambda k: float(orbit.segments["t1"][k] - orbit.segments["t0"][k]),
    )
    t = 0.5 * float(orbit.segments["t0"][s] + orbit.segments["t1"][s])
    path = orbit._frame.flow.path(
        orbit._word[s].contacts, float(orbit.segments["t0"][s]), orbit._starts[s, 1:], np.array([t])
    )
    n = path.shape[1] // 2
    for distance in DISTANCES:
        value = event.value + sign * distance * max(abs(event.value), 1e-3)
        frame = moved_frame(orbit._frame, {name: float(value)})
        length = frame.length * (1 if frame.turn is None else 2)
        run = simulate(
            frame.system,
            (t, t + RETURNS * length),
            (path[0, :n], path[0, n:]),
            frame.method,
        )
        try:
            guess, x, multiple, _ = recent(
                frame.system, run, orbit.multiple, length / orbit.multiple, frame.free, frame.method
            )
        except (NotDifferentiable, FlightError, ValueError):
            continue
        found = solve_word(guess, guess.joined(x, guess.length), multiple)
        if found.success and found.kind == "impacting":
            return found
    return orbit


def doubled(terms: Terms) -> tuple[Frame, Array, Array]:
    """Give the frame of a word written twice, its unknowns, and the direction that doubles it."""
    frame, y, direction = twice(terms, np.linalg.svd(terms.matrix(-1.0))[2][-1])
    # the half that comes first is the one with the earlier event
    later = direction.reshape(len(frame.word), -1)[0, -1] > 0.0
    return frame, y, -direction if later else direction


def _mechanical_doubled(branch: MechanicalBranch, event: MechanicalEvent) -> MechanicalOrbit:
    orbit = event.orbit
    frame, y, direction = doubled(evaluate(orbit._frame, orbit._y))
    multiple = orbit.multiple if orbit._frame.turn is not None or frame.free else 2 * orbit.multiple
    values = branch.values
    width = float(np.ptp(values)) or abs(event.value) or 1.0
    path = Path(frame, branch.name, y, width)
    normal = np.append(direction / path.scale[:-1], 0.0)
    normal = normal / np.linalg.norm(normal)
    z = path.scaled(y, event.value)
    for amplitude in MECHANICAL_AMPLITUDES:
        try:
            point = path.correct(z + amplitude * normal, normal, ROUNDING)
        except FlightError:
            continue
        if point is None:
            continue
        found = orbit_of_word(
            point.terms,
            multiple,
            point.residual,
            point.corrections,
            point.margins.why_not(),
            message="An orbit beside a period doubling.",
        )
        if found.success:
            return dataclasses.replace(found, _away=direction)
    return orbit


# From an event of a branch to the branch that meets it there.

AMPLITUDES = (5e-4, 2e-5, 1e-6)
"""How far the new orbit is from the event, relative to the period and the speeds: less for one with
impacts that are much slower than its fastest."""
EDGE = 1e-8
"""How deep an orbit that touches the wall may be (m)."""
CLOSE = 1e-9
NOT_CONVERGED = "Newton's iteration did not converge beside the event."


def switched(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
    """Give an orbit on the other branch."""
    kinds = {
        "period_doubling": _doubled,
        "grazing": _without,
        "interior_impact": _inserted,
        "end_of_rest": _orbit_beyond,
        "rest_appears": _resting,
    }
    if event.kind not in kinds:
        return event.orbit
    return kinds[event.kind](branch, event)


def _doubled(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
    """Solve twice the sequence, moved along the eigenvector of the multiplier -1."""
    orbit = event.orbit
    if len(orbit._y) < len(branch.orbits[0]._y):
        return orbit  # the single orbit at which a doubled one begins
    if orbit._y.ndim == 1:
        raise ValueError("an orbit without impacts has no multiplier -1 to follow")
    word, y, direction = doubled(evaluate(*as_word(orbit.system, orbit._frame, orbit._y)))
    frame = orbit._frame
    frame = dataclasses.replace(frame, multiple=frame.multiple * (1 if frame.free else 2))
    return _at_amplitude(branch, event, frame, word, y, direction)


def _inserted(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
    """Solve the sequence with the new impact, at a small speed."""
    orbit = event.orbit
    terms = evaluate(*as_word(orbit.system, orbit._frame, orbit._y))
    lows = [it for it in Margins(terms).lows if it.kind == "interior_impact"]
    low = min(lows, key=lambda it: it.value)
    beyond = crossed(terms, low)
    assert beyond is not None
    word, y = beyond
    # the impulse of the new impact, or the speed with which the segment after it begins
    direction, after = np.zeros(len(y)), (low.segment + 1) % len(word.word)
    direction[2 * low.segment if word.impulses is not None else 4 * after + 2] = 1.0
    return _at_amplitude(branch, event, orbit._frame, word, y, direction)


def _at_amplitude(
    branch: Branch,
    event: BranchEvent,
    frame: MassFrame,
    word: WordFrame,
    y: Array,
    direction: Array,
) -> PeriodicOrbit:
    """Solve with the parameter free and so much of a direction."""
    width = float(np.ptp(branch.values)) or abs(event.value) or 1.0
    path = Path(word, branch.name, y, width)
    normal = np.append(direction, 0.0) / path.scale
    normal /= np.linalg.norm(normal)
    scaled = path.scaled(y, event.value)
    found = None
    for amplitude in AMPLITUDES:
        point = path.correct(scaled + amplitude * normal, normal)
        if point is None:
            continue
        orbit = checked(frame, point.terms, point.residual, point.corrections)
        away = rows_along(point.terms, direction).reshape(orbit._y.shape)
        found = dataclasses.replace(orbit, _away=away)
        if found.success:
            break
    if found is not None:
        return found
    failed, message = OrbitStatus.NOT_CONVERGED, NOT_CONVERGED
    return dataclasses.replace(event.orbit, status=failed, admissible=False, message=message)


def _without(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
    """Solve the sequence without the impact that dies, or the motion that touches the wall."""
    del branch
    orbit = event.orbit
    system, frame, rows = orbit.system, orbit._frame, orbit._frame.listed(orbit._y)
    length, dies = frame.length(system, orbit._y), int(np.argmin(rows[:, 1]))
    rest = np.delete(rows, dies, axis=0)
    if len(rest):
        return _on_edge(solve(system, frame, frame.unknowns(rest, length)))
    t, u = rows[dies]
    if frame.free:
        _, high = apex(system, np.array([t, 0.0, u, t + length]), frame.method)
        return _on_edge(solve(system, frame, np.array([high, length])))
    middle = t + 0.5 * length
    ends, _ = fly(system, np.array([[t, 0.0, u, middle]]), frame.method)
    frame = dataclasses.replace(frame, start=float(middle))
    return _on_edge(solve(system, frame, ends[0, :2]))


def _on_edge(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """Give an orbit that touches the wall: whether a simulation sees an impact is rounding."""
    if orbit.status is not OrbitStatus.LEFT_ADMISSIBLE or orbit.depth > EDGE:
        return orbit
    done = OrbitStatus.COMPLETED
    return dataclasses.replace(
        orbit, status=done, admissible=True, message="The orbit touches the wall."
    )


def _orbit_beyond(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
    """Find the orbit of finitely many impacts that meets the resting one at its end.

    The nearer the end, the more impacts it has, and it grazes wherever their number changes: of
    some distances the first at which a run from the lift-off leads to a motion is taken.
    """
    orbit, found = event.orbit, None
    sign = np.sign(event.value - float(np.mean(branch.values))) or 1.0
    for distance in DISTANCES:
        beyond = event.value + sign * distance * max(abs(event.value), 1e-3)
        system = with_value(orbit.system, branch.name, float(beyond))
        length = orbit.multiple * orbit.period
        t = (orbit.liftoff_time or 0.0) - 0.25 * (orbit.margin or 0.0)
        span = (t, t + RETURNS * length)
        method, period = orbit._frame.method, orbit._frame.period
        run = simulate(system, span, (0.0, 0.0), method, dense_output=False)
        found = periodic_orbit(system, run, orbit.multiple, period=period, method=method)
        if found.kind == "impacting" and found.success:
            return found
    assert found is not None
    return found


def _resting(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
    """Give the resting orbit, away from where it appears by as much as the last orbit is."""
    near = float(branch.values[np.argmin(np.abs(branch.values - event.value))])
    orbit, away = event.orbit, event.value - near
    follower = Follower(orbit, branch.name)
    while abs(away) > CLOSE * abs(event.value):
        if (found := follower.at(event.value + away)) is not None:
            return found
        away *= 0.5
    return orbit
