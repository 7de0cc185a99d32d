"""From settings to runs: implicit signs beside explicit ones."""

from __future__ import annotations

import warnings
from typing import Any, TypeAlias

from zivi.base.warnings import ModelWarning
from zivi.control.closed_loop import ClosedLoop, Controller, simulate_closed_loop
from zivi.control.observer import ImpactObserver
from zivi.control.twisting import ExplicitTwisting, TwistingRegulator, TwistingTracker
from zivi.lab.belt import BeltRun, belt_runs
from zivi.lab.drawn_reference import Drawn, ExplicitFollower
from zivi.lab.explicit import ExplicitRegulator
from zivi.lab.settings import (
    Ball,
    Belt,
    Regulator,
    Settings,
    Tracker,
    check,
    landing_of,
    observer_of,
)
from zivi.simulation.methods import ExplicitEuler, Method, SwitchedRK, ThetaGamma
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.mass import Force, ImpactSystem, LinearForce

__all__ = ["Runs", "compute"]

Runs: TypeAlias = dict[str, Trajectory] | dict[str, ClosedLoop] | dict[str, BeltRun]
"""The run of each method or controller, by the name that the page gives it."""


def compute(settings: Settings) -> Runs:
    """Simulate what the settings ask for.

    Parameters
    ----------
    settings : Ball, Regulator, Tracker or Belt
        The settings of a tab.

    Returns
    -------
    dict
        ``implicit`` and ``explicit``, of a ball and a belt also ``high_order``.

    Raises
    ------
    ValueError, TypeError
        For a setting out of range, with the library's message.
    """
    check(settings)
    if isinstance(settings, Ball):
        return _ball(settings)
    if isinstance(settings, Belt):
        return belt_runs(settings)
    if isinstance(settings, Regulator):
        return {name: _loop(settings, made) for name, made in _regulators(settings).items()}
    reference: dict[str, Any] = {
        "y_ref0": (settings.x_ref0, settings.xdot_ref0),
        "force_ref": settings.force_ref,
    }
    if settings.drawn:
        reference = {"reference": Drawn(settings.heights, settings.t_end)}
    trackers = _trackers(settings).items()
    return {name: _loop(settings, made, **reference) for name, made in trackers}


def _ball(ball: Ball) -> dict[str, Trajectory]:
    force = LinearForce(gravity=ball.gravity, amplitude=ball.amplitude, omega=ball.omega)
    system = ImpactSystem(force, e=ball.e)
    methods: dict[str, Method] = {
        "implicit": ThetaGamma(ball.h),
        "explicit": ExplicitEuler(ball.h),
        "high_order": SwitchedRK(),
    }
    span, start = (0.0, ball.t_end), (ball.x0, ball.xdot0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # a ball that flies off is seen to do so
        return {
            name: simulate(system, span, start, method=method, progress=False)
            for name, method in methods.items()
        }


def _regulators(given: Regulator) -> dict[str, Controller]:
    mu1, mu2, h = given.mu1, given.mu2, given.h
    return {
        "implicit": TwistingRegulator(mu1, mu2, h=h, e=given.e, **landing_of(given)),
        "explicit": ExplicitRegulator(mu1, mu2, h=h),
    }


def _trackers(given: Tracker) -> dict[str, Controller]:
    mu1, mu2, h, e = given.mu1, given.mu2, given.h, given.e
    lands = landing_of(given)
    baseline: Any = ExplicitFollower if given.drawn else ExplicitTwisting
    return {
        "implicit": TwistingTracker(mu1, mu2, h=h, e=e, branch=given.branch, **lands),
        "explicit": baseline(mu1, mu2, h=h, e=e),
    }


def _loop(given: Regulator | Tracker, controller: Controller, **reference: Any) -> ClosedLoop:
    constant = given.force + given.disturbance
    force: Force = constant
    if given.amplitude:
        force = LinearForce(gravity=-constant, amplitude=given.amplitude, omega=given.omega)
    observer = ImpactObserver(given.e, given.h, **observer_of(given)) if given.observer else None
    return simulate_closed_loop(
        ImpactSystem(force, e=given.e),
        controller,
        (0.0, given.t_end),
        (given.x0, given.xdot0),
        force_model=given.force,
        noise=(given.noise_x, given.noise_xdot),
        seed=given.seed,
        delay=given.delay,
        observer=observer,
        progress=False,
        **reference,
    )
