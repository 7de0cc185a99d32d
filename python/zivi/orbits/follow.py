"""Continuation of a branch in both directions, and branch switching."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias, overload

import numpy as np

from zivi.base.check import Array, finite, integer
from zivi.base.habits import hinted
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.arc import STILL, Arc, Continuation, Found, rest_beyond, single_doubling
from zivi.orbits.critical import crossed, cubic_coefficient, twice
from zivi.orbits.equations import Frame, Terms, evaluate
from zivi.orbits.flows import FlightError, MassFlow
from zivi.orbits.orbit import (
    MASS_MESSAGES,
    MECHANICAL_MESSAGES,
    Branch,
    BranchArc,
    BranchEvent,
    MechanicalBranch,
    MechanicalEvent,
    MechanicalOrbit,
    PeriodicOrbit,
    failed_text,
    letter_names,
    with_failed,
)
from zivi.orbits.path import (
    TOLERANCE,
    Constraint,
    Margins,
    Path,
    Point,
    is_resting,
    moved_frame,
    value_of,
)
from zivi.orbits.words import (
    NotDifferentiable,
    checked,
    orbit_of_word,
    recent,
    resting_orbit,
    solve_word,
)
from zivi.simulation.run import pair, simulate

Span: TypeAlias = tuple[float, float]

# The way along a branch of orbits of a mechanical system, in both directions from one.

BEYOND = 3
"""Points of one mass that are followed where an orbit is no motion any more."""
SEVERITY = (
    OrbitStatus.RETRACED,
    OrbitStatus.RANGE_END,
    OrbitStatus.CLOSED,
    OrbitStatus.LEFT_ADMISSIBLE,
    OrbitStatus.SIMULTANEOUS,
    OrbitStatus.MAX_POINTS,
    OrbitStatus.NOT_CONVERGED,
)


class ContinuationResult(NamedTuple):
    """Results of both directions."""

    arcs: list[Arc]
    events: list[Found]
    status: OrbitStatus
    """Of the two ends the one that needs more attention."""
    flights: int
    ways: list[Continuation]


def path_of(frame: Frame, name: str, y: Array, span: tuple[float, float]) -> tuple[Path, Point]:
    """Return the solutions of a word over a parameter, and the point of one of them."""
    try:
        path = Path(frame, name, y, span[1] - span[0])
        return path, path.start(y, value_of(frame.system, name))
    except FlightError as error:
        raise ValueError("orbit: its flights cannot be computed") from error


def both_ways(
    way: Callable[[Point, int], Continuation],
    start: Point,
    most: int,
    first: int,
    side: float | None,
) -> ContinuationResult:
    """Continue from a point in both directions, first a few points, or in one direction."""
    backward = dataclasses.replace(start, tangent=-start.tangent)
    if side is not None:
        ways = [way(start if side > 0.0 else backward, most)]
    else:
        ways = [way(start, first)]
    status = ways[0].go()
    arcs = ways[0].arcs
    if side is None and status is not OrbitStatus.CLOSED:
        ways.append(way(backward, most - ways[0].count + 1))
        status = max(status, ways[1].go(), key=SEVERITY.index)
        arcs = _both(ways[1].arcs, arcs)
    paths = {id(arc.path): arc.path for it in ways for arc in it.arcs}
    flights = sum(path.flights for path in paths.values())
    return ContinuationResult(arcs, _unlike(_all_events(arcs)), status, flights, ways)


def _all_events(arcs: list[Arc]) -> list[Found]:
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


def follow(
    orbit: MechanicalOrbit, name: str, span: Span, step: float, most: int, *, through: bool
) -> MechanicalBranch:
    """Follow an orbit of a mechanical system over a parameter."""
    multiple, names = orbit.multiple, letter_names(orbit.system)
    found = _found(orbit, name, span, step, most, most, through=through)
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


def _found(
    orbit: Any,
    name: str,
    span: Span,
    step: float,
    most: int,
    first: int,
    *,
    through: bool,
    beyond: int = 0,
) -> ContinuationResult:
    """Continue in both directions from an orbit, or away from the event of its origin."""
    path, start = path_of(orbit._frame, name, orbit._y, span)
    away = orbit._away
    side = None if away is None else float(start.tangent[:-1] @ (away / path.scale[:-1]))

    def way(start: Point, most: int) -> Continuation:
        return Continuation(path, start, span, step, most, through=through, beyond=beyond)

    return both_ways(way, start, most, first, side)


def point_orbit(point: Point, multiple: int, *, here: bool = False) -> Any:
    """Return the orbit at a point; at an event (`here`) it is on the edge of being a motion."""
    mass = isinstance(point.terms.frame.flow, MassFlow)
    return orbit_of_word(
        point.terms,
        multiple,
        point.residual,
        point.corrections,
        None if here else point.margins.why_not(1e-11 if mass else 1e-9),
        message="A point of a branch.",
        multipliers=point.multipliers if mass else None,
    )


def _arc(arc: Arc, multiple: int) -> BranchArc:
    orbits = [point_orbit(point, multiple) for point in arc.points]
    return BranchArc(orbits[0].word, orbits, np.array([point.value for point in arc.points]))


def _mechanical_event(
    found: Found, multiple: int, gaps: tuple[str, ...], name: str
) -> MechanicalEvent:
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
        The parameter (see `sensitivity`); of dry friction ``"belt.velocity"``, ``"belt.limit"``.
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

    See Also
    --------
    periodic_orbit : the first orbit of a branch.
    continue_curve : continue a bifurcation in two parameters.
    zivi.plot.branch : draw a branch.

    Notes
    -----
    Pseudo-arclength continuation with Newton correction; bifurcations are zeros of test functions
    between two points and are located to rounding. The page "Sensitivities and orbits: theory"
    (orbit_theory.md) has the equations.

    References
    ----------
    Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, 3rd ed., Springer, 2004.

    A. B. Nordmark, Non-periodic motion caused by grazing incidence, J. Sound Vib. 145, 1991.

    M. di Bernardo et al., Piecewise-smooth Dynamical Systems, Springer, 2008.

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
    return _follow_mass(orbit, name, (low, high), step, max_points)


def _follow_mass(orbit: PeriodicOrbit, name: str, span: Span, step: float, most: int) -> Branch:
    """Follow an orbit of one mass; one that rests goes from word to word."""
    rests, multiple = orbit.kind == "resting", orbit.multiple
    step = step if rests else step / 3.0 ** math.log2(multiple)
    ahead, beyond = most - most // 2, 0 if rests else BEYOND
    found = _found(orbit, name, span, step, most, ahead, through=rests, beyond=beyond)
    points = [
        point for arc in found.arcs if arc.path.frame.word[0] != STILL for point in arc.points
    ]
    orbits = [point_orbit(point, multiple) for point in points]
    events = [_branch_event(multiple, it, found.arcs[0].path, span) for it in found.events]
    if len(found.ways) > 1:
        events = [*_beyond(multiple, found.ways[-1]), *events]
    events += _beyond(multiple, found.ways[0])
    values = np.array([point.value for point in points])
    status = found.status
    if status is OrbitStatus.RETRACED:
        status = OrbitStatus.COMPLETED
    message = with_failed(MASS_MESSAGES[status], failed_text(orbits))
    return Branch(name, orbits, values, events, status, message, found.flights)


def _branch_event(multiple: int, found: Found, path: Path, span: Span) -> BranchEvent:
    """Make an event with the orbit there (the resting orbit where rest appears)."""
    point = found.point
    if found.kind == "rest_appears" and not is_resting(point.terms.frame.word):
        rests = rest_beyond(path, point, span)
        point = point if rests is None else rests[1]
    return BranchEvent(found.kind, found.point.value, point_orbit(point, multiple, here=True))


def _beyond(multiple: int, way: Continuation) -> list[BranchEvent]:
    """Return the events at the end of a branch: rest that appears, or a period doubling."""
    arc = way.arcs[-1]
    if way.status is OrbitStatus.LEFT_ADMISSIBLE and arc.events and not way.through:
        last = arc.events[-1]
        inserted = last.kind == "interior_impact"
        rests = rest_beyond(arc.path, last.point, way.span) if inserted else None
        found = None if rests is None else Found("rest_appears", rests[1])
        return [] if found is None else [_branch_event(multiple, found, arc.path, way.span)]
    if way.status is not OrbitStatus.RETRACED:
        return []
    single = single_doubling(arc.path, arc.points[-1])
    if single is None or not way.span[0] <= single.value <= way.span[1]:
        return []
    half = multiple if arc.path.frame.free else multiple // 2
    return [_branch_event(half, Found("period_doubling", single), arc.path, way.span)]


# From an event of a branch to the branch that meets it there.

AMPLITUDES, MECHANICAL_AMPLITUDES = (5e-4, 2e-5, 1e-6), (5e-3, 1e-3, 1e-4, 1e-5)
"""How far the new orbit is from the event, in scaled unknowns: less for one with impacts that are
much slower than its fastest."""
DOUBLED_RESIDUAL = 1e-14
"""The residual of the new orbit: beside a doubling it is ill conditioned."""
BEYOND_REST = (1e-3, 6e-4, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6)
"""How far beyond the end of a rest orbits are looked for, relative to the parameter."""
RETURNS = 12
"""Periods of the motion that are simulated there."""
TOUCHING = 1e-8
"""How deep an orbit that touches the wall may be."""
LEAST_AWAY = 1e-9
NOT_CONVERGED = "Newton's iteration did not converge beside the event."


def switched(branch: Any, event: Any) -> Any:
    """Return an orbit on the other branch."""
    kinds = {
        "period_doubling": _double_orbit,
        "pitchfork": _double_orbit,
        "grazing": _cross_event,
        "interior_impact": _cross_event,
        "end_of_rest": _leave_rest,
    }
    if isinstance(event, BranchEvent):
        kinds |= {"interior_impact": _insert_impact, "rest_appears": _appearing_rest}
    return kinds[event.kind](branch, event) if event.kind in kinds else event.orbit


def _cross_event(branch: Any, event: Any) -> Any:
    """Solve the event sequence without the vanishing impact or with the new one."""
    del branch
    orbit = event.orbit
    terms = evaluate(orbit._frame, orbit._y)
    low = _touching(terms, event.kind)
    beyond = None if low is None else crossed(terms, low)
    if beyond is None:
        return orbit
    found = solve_word(*beyond, orbit.multiple)
    if found.status is OrbitStatus.LEFT_ADMISSIBLE and found.depth < TOUCHING:
        # whether a simulation sees an impact that grazes is rounding
        done = OrbitStatus.COMPLETED
        return dataclasses.replace(found, status=done, admissible=True, message="It grazes.")
    return found


def _touching(terms: Terms, kind: str) -> Constraint | None:
    own = [low for low in Margins(terms).lows if low.kind == kind]
    return min(own, key=lambda it: abs(it.value) / it.size, default=None)


def _leave_rest(branch: Any, event: Any) -> Any:
    """Find the orbit of finitely many impacts that meets the resting one at its end.

    The nearer the end, the more impacts it has, and it grazes wherever their number changes: of
    some distances the first at which a run leads to a motion is taken.
    """
    orbit, name, last = event.orbit, branch.name, None
    own: Frame = orbit._frame
    x, word = own.split(orbit._y)[0], own.word
    sign = np.sign(event.value - float(np.mean(branch.values))) or 1.0
    s = max((k for k, it in enumerate(word) if it.kind in "SZ"), key=lambda k: x[k, -1] - x[k, 0])
    t = 0.5 * float(x[s, 0] + x[s, -1])
    z = own.flow.path(word[s].contacts, float(x[s, 0]), x[s, 1:-1], np.array([t]))[0]
    for distance in BEYOND_REST:
        value = event.value + sign * distance * max(abs(event.value), 1e-3)
        frame = moved_frame(own, {name: float(value)})
        length = frame.length * (1 if frame.turn is None else 2)
        span, state = (t, t + RETURNS * length), frame.flow.initial(z)
        run = simulate(frame.system, span, state, frame.method)
        period = length / orbit.multiple
        try:
            guess, x, multiple, _ = recent(
                frame.system, run, orbit.multiple, period, frame.free, frame.method
            )
        except (NotDifferentiable, FlightError, ValueError):
            continue
        last = solve_word(guess, guess.joined(x, guess.length), multiple)
        if last.success and last.kind == "impacting":
            return last
    return orbit if last is None or isinstance(event, MechanicalEvent) else last


def doubled(terms: Terms) -> tuple[Frame, Array, Array]:
    """Return the frame of a word written twice, its unknowns, and the direction that doubles it."""
    frame, y, direction = twice(terms, np.linalg.svd(terms.matrix(-1.0))[2][-1])
    # the half that comes first is the one with the earlier event
    later = direction.reshape(len(frame.word), -1)[0, -1] > 0.0
    return frame, y, -direction if later else direction


def _double_orbit(branch: Any, event: Any) -> Any:
    """Solve the word written twice, moved along the eigenvector of the multiplier -1."""
    orbit, mass = event.orbit, isinstance(event, BranchEvent)
    own: Frame = orbit._frame
    if mass and len(own.word) < len(branch.orbits[0]._frame.word):
        return orbit  # the single orbit at which a doubled one begins
    if mass and own.word[0].kind == "P":
        raise ValueError("an orbit without impacts does not have a multiplier -1 to continue")
    frame, y, direction = doubled(evaluate(own, orbit._y))
    multiple = orbit.multiple * (1 if own.turn is not None or own.free else 2)
    return _at_amplitude(branch, event, multiple, frame, y, direction)


def _insert_impact(branch: Any, event: Any) -> Any:
    """Solve the word with the new impact, at a small speed."""
    terms = evaluate(event.orbit._frame, event.orbit._y)
    low = _touching(terms, event.kind)
    beyond = None if low is None else crossed(terms, low)
    if low is None or beyond is None:
        return event.orbit
    word, y = beyond
    # the impulse of the new impact, or the speed with which the segment after it begins
    direction, after = np.zeros(len(y)), (low.segment + 1) % len(word.word)
    direction[2 * low.segment if word.impulses is not None else 4 * after + 2] = 1.0
    return _at_amplitude(branch, event, event.orbit.multiple, word, y, direction)


def _at_amplitude(
    branch: Any, event: Any, multiple: int, frame: Frame, y: Array, direction: Array
) -> Any:
    """Solve with the parameter free and so much of a direction."""
    mass, found = isinstance(event, BranchEvent), None
    width = float(np.ptp(branch.values)) or abs(event.value) or 1.0
    path = Path(frame, branch.name, y, width)
    normal = np.append(direction / path.scale[:-1], 0.0)
    normal /= np.linalg.norm(normal)
    z = path.scaled(y, event.value)
    for amplitude in AMPLITUDES if mass else MECHANICAL_AMPLITUDES:
        try:
            point = path.correct(
                z + amplitude * normal, normal, TOLERANCE if mass else DOUBLED_RESIDUAL
            )
        except FlightError:
            continue
        if point is None:
            continue
        if mass:
            orbit = checked(point.terms, multiple, point.residual, point.corrections)
        else:
            orbit = point_orbit(point, multiple)
            orbit = dataclasses.replace(orbit, message="An orbit beside a period doubling.")
        found = dataclasses.replace(orbit, _away=direction)
        if found.success:
            return found
    if found is not None and mass:
        return found
    if not mass:
        return event.orbit
    failed, message = OrbitStatus.NOT_CONVERGED, NOT_CONVERGED
    return dataclasses.replace(event.orbit, status=failed, admissible=False, message=message)


def _appearing_rest(branch: Any, event: Any) -> Any:
    """Return the resting orbit, away from where it appears by as much as the last orbit is."""
    orbit, frame = event.orbit, event.orbit._frame
    near = float(branch.values[np.argmin(np.abs(branch.values - event.value))])
    away, phase = event.value - near, (orbit.liftoff_time or 0.0) - 0.5 * (orbit.margin or 0.0)
    while abs(away) > LEAST_AWAY * abs(event.value):
        there = moved_frame(frame, {branch.name: event.value + away})
        period = there.length / orbit.multiple
        found = resting_orbit(there.system, frame.method, period, phase, orbit.multiple + 1)
        if found.success and found.multiple == orbit.multiple:
            return found
        away *= 0.5
    return orbit
