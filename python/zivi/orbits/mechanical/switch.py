"""From an event of a branch to the branch that meets it there."""

from __future__ import annotations

import dataclasses

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.branch import MechanicalBranch, MechanicalEvent
from zivi.orbits.mechanical.crossing import crossed
from zivi.orbits.mechanical.equations import Frame, evaluate
from zivi.orbits.mechanical.find import orbit_of, solve
from zivi.orbits.mechanical.margins import Margins
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.mechanical.path import Path

__all__ = ["switched"]

AMPLITUDES = (5e-3, 1e-3, 1e-4, 1e-5)
"""How far the new orbit is from the event, in scaled unknowns."""
STEP = 1e-6
"""Of a difference for the direction in which it lies."""


def switched(branch: MechanicalBranch, event: MechanicalEvent) -> MechanicalOrbit:
    """Give an orbit on the other branch."""
    if event.kind in ("period_doubling", "pitchfork"):
        return _doubled(branch, event)
    if event.kind in ("grazing", "interior_impact"):
        return _crossed(event)
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


def doubled(orbit: MechanicalOrbit) -> tuple[Frame, Array, Array]:
    """Give the frame of a word written twice, its unknowns, and the direction that doubles it."""
    frame = orbit._frame
    terms = evaluate(frame, orbit._y)
    null = np.real(np.linalg.svd(terms.matrix(-1.0))[2][-1])
    word = orbit._word if frame.turn is not None else frame.word * 2
    new = dataclasses.replace(frame, word=word, length=2.0 * terms.length, turn=None)

    def twice(part: float) -> Array:
        """Give the unknowns of both halves, each moved along the null vector."""
        if frame.impulses is not None:
            first, second = (frame.split(orbit._y + side * part * null)[0] for side in (1.0, -1.0))
        else:
            moved = part * null.reshape(terms.x.shape)
            first, second = terms.x + moved, terms.x - moved
        second[:, [0, -1]] += terms.length
        if frame.turn is not None:
            second[:, 1:-1] = second[:, 1:-1] @ frame.turn.T
        return new.joined(np.vstack([first, second]), new.length)

    direction = (twice(STEP) - twice(-STEP)) / (2.0 * STEP)
    # the half that comes first is the one with the earlier event
    later = direction.reshape(len(word), -1)[0, -1] > 0.0
    return new, twice(0.0), -direction if later else direction


def _doubled(branch: MechanicalBranch, event: MechanicalEvent) -> MechanicalOrbit:
    orbit = event.orbit
    frame, y, direction = doubled(orbit)
    multiple = orbit.multiple if orbit._frame.turn is not None or frame.free else 2 * orbit.multiple
    values = branch.values
    width = float(np.ptp(values)) or abs(event.value) or 1.0
    path = Path(frame, branch.name, y, width)
    normal = np.append(direction / path.scale[:-1], 0.0)
    normal = normal / np.linalg.norm(normal)
    z = path.scaled(y, event.value)
    for amplitude in AMPLITUDES:
        try:
            point = path.correct(z + amplitude * normal, normal)
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
