"""From an event of a branch to the branch that meets it there."""

from __future__ import annotations

import dataclasses

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.sensitivity import OrbitStatus
from zivi.orbits.branch import Branch, BranchEvent
from zivi.orbits.find import checked, periodic_orbit, solve
from zivi.orbits.flights import fly
from zivi.orbits.free import apex
from zivi.orbits.mechanical.crossing import crossed
from zivi.orbits.mechanical.equations import Frame as WordFrame, evaluate
from zivi.orbits.mechanical.margins import Margins
from zivi.orbits.mechanical.path import Path
from zivi.orbits.mechanical.switch import doubled
from zivi.orbits.orbit import PeriodicOrbit
from zivi.orbits.rest_branch import Follower
from zivi.orbits.sequence import Frame, as_word, rows_along
from zivi.simulation.run import simulate
from zivi.system.parameters import with_value

__all__ = ["switched"]

AMPLITUDES = (5e-4, 2e-5, 1e-6)
"""How far the new orbit is from the event, relative to the period and the speeds: less for one with
impacts that are much slower than its fastest."""
EDGE = 1e-8
"""How deep an orbit that touches the wall may be (m)."""
DISTANCES = (1e-3, 6e-4, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6)
"""How far beyond the end of a rest orbits are looked for, relative to the parameter."""
RETURNS = 12
"""Periods of the motion that are simulated there."""
CLOSE = 1e-9
NOT_CONVERGED = "Newton's iteration did not converge beside the event."


def switched(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
    """Give an orbit on the other branch."""
    kinds = {
        "period_doubling": _doubled,
        "grazing": _without,
        "interior_impact": _inserted,
        "end_of_rest": _beyond,
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
    branch: Branch, event: BranchEvent, frame: Frame, word: WordFrame, y: Array, direction: Array
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


def _beyond(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
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
