"""Objects of every public class, and what is asked of each after it was loaded."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

import zivi
from stored import functions

BALL = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81), e=0.5)
TABLE = zivi.ImpactSystem(zivi.LinearForce(gravity=1.0, amplitude=1.3, omega=1.0), e=0.5)
DROP = zivi.MechanicalSystem(mass=[[2.0]], force=[-19.62], gaps=[zivi.LinearGap([1.0])], e=0.5)
TRACKER = zivi.TwistingTracker(30, 17, h=1e-2, kappa=0.5)


def run_of(ball: Any, *arguments: Any, **settings: Any) -> Any:
    return zivi.simulate(ball, (0, 2), (1, 0), *arguments, **settings)


def path(sol: Any) -> Any:
    return np.array(sol([0.1, 0.7, 1.9]))


def settings(value: Any) -> Any:
    return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}


def observer_seen() -> Any:
    """Give an observer that has seen a fall, two impacts and what is none of it."""
    it = zivi.ImpactObserver(0.8, 1e-3, noise=1e-4, position_only=True, se=0.03, dmax=5)
    for k in range(500):
        t = 1e-3 * k - 0.2
        up = 0.8 * 9.81 * 0.2  # the first contact is at t = 0
        position = up * t - 9.81 * t**2 / 2 if t > 0 else 9.81 * (0.04 - (t + 0.2) ** 2) / 2
        it.step(abs(position), None, -9.81, 0.0)
    it.step(3.0, None, -9.81, 0.0)  # not taken
    return it


Case = tuple[Callable[[], Any], Callable[[Any], Any]]
"""How an object is made, and what is asked of it."""

CASES: dict[str, Case] = {
    "LinearForce": (lambda: zivi.LinearForce(stiffness=2.0, amplitude=0.3, omega=1.5), settings),
    "ImpactSystem": (lambda: BALL, lambda it: path(run_of(it))),
    "ImpactSystem_function": (
        lambda: zivi.ImpactSystem(functions.gravity, kappa=0.4),
        lambda it: path(run_of(it)),
    ),
    "HarmonicWall": (
        lambda: zivi.HarmonicWall(amplitude=0.01, omega=60.0),
        lambda it: (it.amplitude, it.omega),
    ),
    "MovingWall": (
        lambda: zivi.MovingWall(functions.height, functions.speed, functions.acceleration),
        lambda it: it.position(2.0),
    ),
    "LinearGap": (lambda: zivi.LinearGap([1.0, -1.0], 0.5), lambda it: (it.normal, it.offset)),
    "MechanicalSystem": (
        lambda: DROP,
        lambda it: zivi.simulate(it, (0, 1), ([1.0], [0.0])).zeno["t"],
    ),
    "SwitchedRK": (lambda: zivi.SwitchedRK(rtol=1e-9), settings),
    "ThetaGamma": (lambda: zivi.ThetaGamma(1e-2), settings),
    "MoreauJean": (lambda: zivi.MoreauJean(1e-2), settings),
    "ExplicitEuler": (lambda: zivi.ExplicitEuler(1e-2), settings),
    "TwistingTracker": (lambda: TRACKER.copy(), lambda it: it.step(0.5, 0.1, -9.81, -19.81)),
    "TwistingRegulator": (
        lambda: zivi.TwistingRegulator(30, 17, h=1e-2, kappa=0.5),
        lambda it: it.step(0.5, 0.1, -9.81),
    ),
    "ExplicitTwisting": (
        lambda: zivi.ExplicitTwisting(30, 17, h=1e-2, kappa=0.5),
        lambda it: it.step(0.5, 0.1, -9.81, -19.81),
    ),
    "ImpactObserver": (
        lambda: zivi.ImpactObserver(0.8, 1e-3, noise=1e-4, position_only=True),
        lambda it: it.h,
    ),
    "ImpactObserver_seen": (
        observer_seen,
        lambda it: [*it.estimate, *it.covariance.ravel(), it.n_refused, it.e, it.settings["q_d"]],
    ),
    "Trajectory": (lambda: run_of(BALL), path),
    "Trajectory_steps": (lambda: run_of(BALL, method=zivi.ThetaGamma(1e-2)), lambda it: it.x),
    "Batch": (
        lambda: zivi.simulate_batch(BALL, (0, 2), ([1.0, 1.2], [0.0, 0.1])),
        lambda it: it.x,
    ),
    "ClosedLoop": (
        lambda: zivi.simulate_closed_loop(
            zivi.ImpactSystem(-9.81, kappa=0.5),
            TRACKER.copy(),
            (0, 1),
            (6, 5),
            y_ref0=(3, 3),
            force_ref=-19.81,
        ),
        lambda it: it.u[-1],
    ),
    "MechanicalTrajectory": (
        lambda: zivi.simulate(DROP, (0, 2), ([1.0], [0.0])),
        lambda it: it([0.1, 0.7, 1.9])[0],
    ),
    "Sensitivity": (
        lambda: zivi.sensitivity(BALL, (0, 4), (1, 0), ["x0", "e"]),
        lambda it: it.zeno_times,
    ),
    "PeriodicOrbit": (
        lambda: zivi.periodic_orbit(TABLE, (0, (2, 2))),
        lambda it: it.multipliers.real,
    ),
    "Branch": (
        lambda: zivi.continue_orbit(
            zivi.periodic_orbit(TABLE, (0, (2, 2))), "amplitude", (1.2, 1.4)
        ),
        lambda it: [event.value for event in it.events],
    ),
    "VIOptions": (lambda: zivi.VIOptions(max_pivots=7), lambda it: it.max_pivots),
    "VIResult": (lambda: zivi.solve_lcp([[2.0]], [-1.0]), lambda it: it.x),
    "Status": (lambda: zivi.Status.COMPLETED, int),
}
