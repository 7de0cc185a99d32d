"""Systems with other numbers, and the derivatives of the equations by them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from zivi.base.check import Array
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.equations import Frame, MassTerms, Terms, evaluate
from zivi.orbits.mechanical.family import core_of, frequency_of, value_of, values_of, with_values
from zivi.orbits.mechanical.flow import Flow
from zivi.orbits.mechanical.linear_flow import LinearFlow, is_exact
from zivi.orbits.mechanical.mass_flow import MassFlow
from zivi.orbits.mechanical.nonlinear_flow import NonlinearFlow
from zivi.simulation.methods import SwitchedRK
from zivi.system.linear import LinearSystem
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import excitation

__all__ = [
    "by_parameter",
    "flow_of",
    "frame_of",
    "length_of",
    "moved_frame",
    "of_mass",
    "trend_of",
]

STEPS = (1e-5, 2e-3)
"""Of a difference of second order, and of one of sixth, relative to the parameter."""
NEARER = (1.0, 1e-2, 1e-4)
"""Parts of the step that are tried near the end of a rest."""


def flow_of(system: MechanicalSystem | ImpactSystem, method: SwitchedRK) -> Flow:
    """Give the motions of a system with given contacts."""
    if isinstance(system, ImpactSystem):
        return MassFlow(system, method)
    core = core_of(system)
    if is_exact(core):
        assert isinstance(core, LinearSystem)
        flow: Flow = LinearFlow(core)
    else:
        flow = NonlinearFlow(core, method)
    flow.e = system.e
    return flow


def moved_frame(frame: Frame, values: Mapping[str, float]) -> Frame:
    """Give the frame of the system with other values of some numbers."""
    return frame_of(frame, with_values(frame.system, values))


def frame_of(frame: Frame, system: MechanicalSystem | ImpactSystem) -> Frame:
    """Give the frame of a system that differs by some numbers."""
    flow = flow_of(system, frame.method)
    return dataclasses.replace(frame, system=system, flow=flow, length=length_of(frame, system))


def length_of(frame: Frame, system: MechanicalSystem | ImpactSystem) -> float:
    """Give the length of the period of such a system."""
    return frame.length if frame.free else frame.length * _stretch(frame, system)


def _stretch(frame: Frame, system: MechanicalSystem | ImpactSystem) -> float:
    """Give by which factor the period changes."""
    before, after = frequency_of(frame.system), frequency_of(system)
    if before is not None and after is not None:
        return before / after
    if before is not None and isinstance(system, ImpactSystem):
        raise ValueError("period: the excitation has no single period")
    # a number of a system of functions that is the frequency, or the period, of its forces
    turns = frame.length / (2.0 * math.pi)
    now, then = values_of(frame.system), values_of(system)
    for name, value in now.items():
        if value == then[name] or value == 0.0 or then[name] == 0.0:
            continue
        count = turns * value * (1.0 if frame.turn is None else 2.0)
        if round(count) >= 1 and abs(count - round(count)) < 1e-9 * count:
            return value / then[name]
        count = frame.length / value
        if name in ("T", "period") and abs(count - round(count)) < 1e-9:
            return then[name] / value
    return 1.0


def by_parameter(frame: Frame, y: Array, name: str, *, precise: bool = False) -> Array:
    """Give the derivative of the equations by a parameter, by central differences."""
    value = value_of(frame.system, name)
    h = STEPS[precise] * max(abs(value), 1e-2)
    if isinstance(frame.flow, MassFlow):
        return of_mass(evaluate(frame, y, name=name), name)

    def at(steps: float) -> Array:
        moved = moved_frame(frame, {name: value + steps * h})
        return evaluate(moved, y, slopes=False).residual

    def centred(steps: float) -> Array:
        return np.asarray((at(steps) - at(-steps)) / (2.0 * steps * h), np.float64)

    if not precise:
        for k in NEARER:
            try:
                return centred(k)
            except FlightError:
                # an accumulation that is thrown off there: only the convergence depends on it
                continue
        return centred(1e-6)
    return 1.5 * centred(1) - 0.6 * centred(2) + 0.1 * centred(3)


def of_mass(terms: Terms, name: str) -> Array:
    """Give the derivative of the equations of one mass, whose flights have it."""
    frame, x = terms.frame, terms.x
    flow, longer = frame.flow, _longer(frame, name)
    assert isinstance(flow, MassFlow)
    if isinstance(terms, MassTerms):
        return terms.column(name, longer)
    rows = np.zeros((len(x), 4))
    if name == "e":
        ends = terms.flights.z
        rows[:, 3] = [z[1] * (it.kind == "I") for z, it in zip(ends, frame.word, strict=True)]
    else:
        moved = flow.fly((), x[:, 0], x[:, 1:-1], x[:, -1], name).by
        assert moved is not None
        e = float(flow.e[0])
        for row, (dx, dv), it in zip(rows, moved, frame.word, strict=True):
            row[2:] = (-dx, e * dv) if it.kind == "I" else (-dx, -dv)
            # what vanishes there: the distance, the velocity, or of a section a time
            row[0] = dx if it.kind == "I" else dv if isinstance(frame.section, int) else 0.0
    rows[-1, 1] += longer
    return rows.ravel()


def _longer(frame: Frame, name: str) -> float:
    """Give the derivative of the length by a parameter."""
    trend = trend_of(frame, name)
    return trend * frame.length / value_of(frame.system, name) if trend else 0.0


def trend_of(frame: Frame, name: str) -> int:
    """Tell whether the length goes with a parameter, 1, against it, -1, or not, 0."""
    omega, its_name = excitation(frame.system)
    if frame.free or name == "e" or (omega is not None and its_name != name):
        return 0
    if not (value := value_of(frame.system, name)):
        return 0
    ratio = _stretch(frame, with_values(frame.system, {name: 1.25 * value}))
    return (ratio > 1.0) - (ratio < 1.0)
