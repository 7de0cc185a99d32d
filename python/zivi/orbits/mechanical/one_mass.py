"""One mass above a wall as the smallest mechanical system."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from zivi.orbits.mechanical.by_parameter import flow_of
from zivi.orbits.mechanical.equations import Frame, evaluate
from zivi.orbits.mechanical.find import orbit_of
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.mechanical.word import Segment
from zivi.orbits.orbit import PeriodicOrbit
from zivi.system.force import LinearForce
from zivi.system.gap import LinearGap
from zivi.system.linear import LinearSystem
from zivi.system.loads import Harmonic
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import parameters_of, with_value
from zivi.system.parametric_mechanism import ParametricSystem

__all__ = ["as_mechanical", "mechanical_of"]


def mechanical_of(system: ImpactSystem) -> ParametricSystem:
    """Give one mass with a `LinearForce` as a linear system with the same parameters.

    Raises
    ------
    ValueError
        For another force.
    """
    if not isinstance(system.force, LinearForce) or system.force.excitation is not None:
        raise ValueError("event: of one mass, curves are there for a zivi.LinearForce")

    # no function in a function: results travel by pickle
    build = functools.partial(_with_values, system)
    return ParametricSystem(build, parameters_of(system) | {"e": float(system.e)})


def _with_values(system: ImpactSystem, /, e: float, **values: float) -> LinearSystem:
    for name, value in values.items():
        system = with_value(system, name, value)
    return _linear(system, e)


def _linear(system: ImpactSystem, e: float) -> LinearSystem:
    force: Any = system.force
    motion: Any = system.wall
    loads: list[Any] = [
        np.array([-force.gravity]),
        Harmonic([force.amplitude], force.omega, force.phase),
    ]
    made = LinearSystem(
        [[1.0]],
        [[force.damping]],
        [[force.stiffness]],
        excitation=loads,
        gaps=[LinearGap([1.0], 0.0, motion, name="wall")],
        e=min(max(e, 0.0), 1.0),
        coordinates=["x"],
    )
    # a difference may step over 1
    made._e = np.array([e])
    return made


def as_mechanical(orbit: PeriodicOrbit) -> MechanicalOrbit:
    """Give an impacting orbit of one mass as that of a mechanical system.

    Raises
    ------
    ValueError
        For an orbit of another kind.
    """
    if orbit.kind == "resting" or orbit._frame.free:
        raise ValueError(
            "event: a resting orbit of one mass, or one that nothing excites, has no curve"
        )
    system = mechanical_of(orbit.system)
    rows = orbit._frame.rows(orbit.system, orbit._y)
    kind = "I" if orbit.kind == "impacting" else "P"
    word = tuple(Segment((), kind, 0 if kind == "I" else -1, ()) for _ in rows)
    # a segment of a word ends with its event: the first one begins with the last impact
    x = np.roll(rows, 1, axis=0)
    length = orbit.multiple * orbit.period
    if kind == "I":
        x[0, [0, 3]] -= length
    method = orbit._frame.method
    frame = Frame(system, flow_of(system, method), word, method, length, section=float(x[0, 3]))
    return orbit_of(evaluate(frame, x.ravel()), orbit.multiple, orbit.residual, 0, None)
