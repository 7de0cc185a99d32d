"""From an event of a branch to the branch that meets it there."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from zivi._check import Array
from zivi._parameters import with_value
from zivi.orbits.curve import Curve
from zivi.orbits.flights import fly
from zivi.orbits.orbit import PeriodicOrbit, checked, periodic_orbit, solve
from zivi.orbits.sequence import Frame, equations
from zivi.sensitivity import OrbitStatus
from zivi.simulate import simulate

if TYPE_CHECKING:
    from zivi.orbits.branch import Branch, BranchEvent

__all__ = ["switched"]

AMPLITUDE = 5e-4
"""How far the new orbit is from the event, relative to the period and the speeds."""
EDGE = 1e-8
"""How deep an orbit that touches the wall may be (m)."""
SETTLING = 400
"""Periods that are simulated beyond the end of a rest."""


def switched(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
    """Give an orbit on the other branch."""
    kinds = {
        "period_doubling": _doubled,
        "grazing": _without,
        "interior_impact": _inserted,
        "end_of_rest": _settled,
    }
    if event.kind not in kinds:
        return event.orbit
    return kinds[event.kind](branch, event)


def _doubled(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
    """Solve twice the sequence, moved along the eigenvector of the multiplier -1."""
    orbit = event.orbit
    y, frame = orbit._y, orbit._frame
    at = equations(orbit.system, frame, y)
    values, vectors = np.linalg.eig(at.monodromy)
    moved = [np.real(vectors[:, int(np.argmin(np.abs(values + 1.0)))])]
    if y.ndim == 1:
        raise ValueError("an orbit without impacts has no multiplier -1 to follow")
    for each in at.maps[:-1]:
        moved.append(each @ moved[-1])
    half = np.array(moved)
    length = frame.multiple * orbit.period
    twice = np.vstack([y, y + np.array([length, 0.0])])
    new = dataclasses.replace(frame, multiple=2 * frame.multiple)
    return _at_amplitude(branch, event, new, twice, np.vstack([half, -half]))


def _inserted(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
    """Solve the sequence with the new impact, at a small speed."""
    orbit = event.orbit
    frame, low = orbit._frame, equations(orbit.system, orbit._frame, orbit._y, minima=True).lowest
    if orbit._y.ndim == 1:
        y, first = np.array([[low[1], 0.0]]), 0
    else:
        y = np.vstack([orbit._y, [low[1], 0.0]])
        order = np.argsort(y[:, 0], kind="stable")
        y, first = y[order], int(np.argmax(order == len(y) - 1))
    direction = np.zeros_like(y)
    direction[first, 1] = 1.0
    return _at_amplitude(branch, event, frame, y, direction)


def _at_amplitude(
    branch: Branch, event: BranchEvent, frame: Frame, y: Array, direction: Array
) -> PeriodicOrbit:
    """Solve with the parameter free and so much of a direction."""
    width = float(np.ptp(branch.values)) or abs(event.value) or 1.0
    curve = Curve(event.orbit.system, frame, branch.name, y, width)
    normal = np.append(direction.ravel(), 0.0) / curve.scale
    normal /= np.linalg.norm(normal)
    point = curve.correct(curve.scaled(y, event.value) + AMPLITUDE * normal, normal)
    if point is None:
        failed = OrbitStatus.NOT_CONVERGED
        return dataclasses.replace(
            event.orbit,
            status=failed,
            admissible=False,
            message="Newton's iteration did not converge beside the event.",
        )
    system = curve.system_at(point.value)
    error = float(np.max(np.abs(point.at.residual / curve.sizes)))
    found = checked(system, frame, point.at, error, point.corrections)
    return dataclasses.replace(found, _away=direction)


def _without(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
    """Solve the sequence without the impact that dies, or the motion that touches the wall."""
    del branch
    orbit = event.orbit
    dies = int(np.argmin(orbit._y[:, 1]))
    rest = np.delete(orbit._y, dies, axis=0)
    if len(rest):
        return _on_edge(solve(orbit.system, orbit._frame, rest))
    t, u = orbit._y[dies]
    middle = t + 0.5 * orbit.multiple * orbit.period
    leg = fly(orbit.system, np.array([[t, 0.0, u, middle]]), method=orbit._frame.method)
    frame = dataclasses.replace(orbit._frame, start=float(middle))
    return _on_edge(solve(orbit.system, frame, np.array([leg.x[0], leg.v[0]])))


def _on_edge(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """Give an orbit that touches the wall: whether a simulation sees an impact is rounding."""
    if orbit.status is not OrbitStatus.LEFT_ADMISSIBLE or orbit.depth > EDGE:
        return orbit
    done = OrbitStatus.COMPLETED
    return dataclasses.replace(
        orbit, status=done, admissible=True, message="The orbit touches the wall."
    )


def _settled(branch: Branch, event: BranchEvent) -> PeriodicOrbit:
    """Find what a simulation settles on, a little beyond the end of the rest."""
    orbit = event.orbit
    inside = float(np.mean(branch.values))
    beyond = event.value + 1e-3 * np.sign(event.value - inside) * max(abs(event.value), 1.0)
    system = with_value(orbit.system, branch.name, float(beyond))
    t = orbit.liftoff_time or 0.0
    span = (t - 0.25 * (orbit.margin or 0.0), t + SETTLING * orbit.period)
    run = simulate(system, span, (0.0, 0.0), orbit._frame.method, dense_output=False)
    return periodic_orbit(system, run, period=orbit._frame.period, method=orbit._frame.method)
