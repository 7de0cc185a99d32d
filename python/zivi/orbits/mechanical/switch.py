"""From an event of a branch to the branch that meets it there."""

from __future__ import annotations

import dataclasses

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.branch import MechanicalBranch, MechanicalEvent
from zivi.orbits.mechanical.by_parameter import moved_frame
from zivi.orbits.mechanical.crossing import crossed
from zivi.orbits.mechanical.equations import Frame, Terms, evaluate
from zivi.orbits.mechanical.find import orbit_of, solve
from zivi.orbits.mechanical.margins import Margins
from zivi.orbits.mechanical.normal_form import twice
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.mechanical.path import Path
from zivi.orbits.mechanical.run_word import NotDifferentiable, recent
from zivi.simulation.run import simulate

__all__ = ["switched"]

AMPLITUDES = (5e-3, 1e-3, 1e-4, 1e-5)
"""How far the new orbit is from the event, in scaled unknowns."""
ROUNDING = 1e-14
"""The residual of the new orbit: beside a doubling it is ill conditioned."""
DISTANCES = (1e-3, 6e-4, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6)
"""How far beyond the end of a rest orbits are looked for, relative to the parameter."""
RETURNS = 12
"""Periods of the motion that are simulated there."""


def switched(branch: MechanicalBranch, event: MechanicalEvent) -> MechanicalOrbit:
    """Give an orbit on the other branch."""
    if event.kind in ("period_doubling", "pitchfork"):
        return _doubled(branch, event)
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
    found = solve(*beyond, orbit.multiple)
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
            frame.system, (t, t + RETURNS * length), (path[0, :n], path[0, n:]), frame.method
        )
        try:
            guess, x, multiple, _ = recent(
                frame.system, run, orbit.multiple, length / orbit.multiple, frame.free, frame.method
            )
        except (NotDifferentiable, FlightError, ValueError):
            continue
        found = solve(guess, guess.joined(x, guess.length), multiple)
        if found.success and found.kind == "impacting":
            return found
    return orbit


def doubled(terms: Terms) -> tuple[Frame, Array, Array]:
    """Give the frame of a word written twice, its unknowns, and the direction that doubles it."""
    frame, y, direction = twice(terms, np.linalg.svd(terms.matrix(-1.0))[2][-1])
    # the half that comes first is the one with the earlier event
    later = direction.reshape(len(frame.word), -1)[0, -1] > 0.0
    return frame, y, -direction if later else direction


def _doubled(branch: MechanicalBranch, event: MechanicalEvent) -> MechanicalOrbit:
    orbit = event.orbit
    frame, y, direction = doubled(evaluate(orbit._frame, orbit._y))
    multiple = orbit.multiple if orbit._frame.turn is not None or frame.free else 2 * orbit.multiple
    values = branch.values
    width = float(np.ptp(values)) or abs(event.value) or 1.0
    path = Path(frame, branch.name, y, width)
    normal = np.append(direction / path.scale[:-1], 0.0)
    normal = normal / np.linalg.norm(normal)
    z = path.scaled(y, event.value)
    for amplitude in AMPLITUDES:
        try:
            point = path.correct(z + amplitude * normal, normal, ROUNDING)
        except FlightError:
            continue
        if point is None:
            continue
        found = orbit_of(
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
