"""From settings to Python: a script that runs what is on the screen."""

from __future__ import annotations

import inspect
from typing import Any

from zivi.lab.belt import FAR, SignedSlip
from zivi.lab.drawn_reference import Drawn, ExplicitFollower
from zivi.lab.explicit import ExplicitRegulator
from zivi.lab.settings import (
    Ball,
    Belt,
    Regulator,
    Settings,
    Tracker,
    landing_of,
    observer_of,
)

__all__ = ["script"]


def script(settings: Settings) -> str:
    """Write a script that gives the runs of `zivi.lab.runs.compute` and plots one.

    Parameters
    ----------
    settings : Ball, Regulator, Tracker or Belt
        The settings of a tab.

    Returns
    -------
    str
        Python. Its variables ``implicit`` and ``explicit``, of a ball or a belt also
        ``high_order``, are the runs; ``figure`` is a matplotlib figure.
    """
    if isinstance(settings, Ball):
        return _ball(settings)
    if isinstance(settings, Belt):
        return _belt(settings)
    return _regulator(settings) if isinstance(settings, Regulator) else _tracker(settings)


def _ball(ball: Ball) -> str:
    force = f"gravity={ball.gravity!r}, amplitude={ball.amplitude!r}, omega={ball.omega!r}"
    return f"""\
import zivi

force = zivi.LinearForce({force})
ball = zivi.ImpactSystem(force, e={ball.e!r})
span, start = (0.0, {ball.t_end!r}), ({ball.x0!r}, {ball.xdot0!r})

implicit = zivi.simulate(ball, span, start, method=zivi.ThetaGamma(h={ball.h!r}))
explicit = zivi.simulate(ball, span, start, method=zivi.ExplicitEuler(h={ball.h!r}))
high_order = zivi.simulate(ball, span, start)

for run in (implicit, explicit, high_order):
    print(run)
figure = zivi.plot.position(implicit).figure  # figure.savefig("ball.png")
"""


def _belt(given: Belt) -> str:
    force = f"-{given.stiffness!r} * q - {given.damping!r} * qdot"
    limits = f"limit={given.limit!r}, static={given.limit!r} + {given.extra!r}"
    numbers = f"{given.stiffness!r}, {given.damping!r}, {given.limit!r}, {given.speed!r}"
    return f"""\
from typing import Any

import numpy as np

import zivi

FAR = {FAR!r}  # m: the wall is never met


{inspect.getsource(SignedSlip)}

belt = zivi.DryFriction({limits}, velocity={given.speed!r})
system = zivi.MechanicalSystem(mass=1.0, force=lambda t, q, qdot: {force}, friction=[belt])
span, start = (0.0, {given.t_end!r}), ([{given.x0!r}], [{given.xdot0!r}])
times = np.linspace(0.0, {given.t_end!r}, round({given.t_end!r} / {given.h!r}) + 1)

implicit = zivi.simulate(system, span, start, zivi.ThetaGamma(h={given.h!r}))
high_order = zivi.simulate(system, span, start, t_eval=times)
signed = zivi.ImpactSystem(SignedSlip({numbers}), e=1.0)
far = (FAR + {given.x0!r}, {given.xdot0!r})
explicit = zivi.simulate(signed, span, far, zivi.ExplicitEuler(h={given.h!r}))

for run in (implicit, explicit, high_order):
    print(run)
figure = zivi.plot.modes(high_order).figure  # figure.savefig("belt.png")
"""


def _regulator(given: Regulator) -> str:
    gains = f"{given.mu1!r}, {given.mu2!r}, h={given.h!r}"
    return f"""\
import math

import zivi


{inspect.getsource(ExplicitRegulator)}

{_world(given)}
regulator = zivi.TwistingRegulator({gains}, e={given.e!r}, {_named(landing_of(given))})
baseline = ExplicitRegulator({gains})

{RUN_BOTH.format(controller="regulator", name="regulator")}"""


def _tracker(given: Tracker) -> str:
    gains = f"{given.mu1!r}, {given.mu2!r}, h={given.h!r}, e={given.e!r}"
    reference = (
        f"    y_ref0=({given.x_ref0!r}, {given.xdot_ref0!r}),\n    force_ref={given.force_ref!r},\n"
    )
    baseline, sources = "zivi.ExplicitTwisting", ""
    if given.drawn:
        reference = f"    reference=Drawn({given.heights!r}, {given.t_end!r}),\n"
        baseline = "ExplicitFollower"
        shown = "\n\n".join(inspect.getsource(it) for it in (Drawn, ExplicitFollower))
        sources = f"from zivi import ExplicitTwisting\n\n\n{shown}\n"
    return f"""\
import zivi
{sources}
{_world(given, reference)}
tracker = zivi.TwistingTracker(
    {gains}, branch="{given.branch}", {_named(landing_of(given))}
)
baseline = {baseline}({gains})

{RUN_BOTH.format(controller="tracker", name="tracking")}"""


RUN_BOTH = """\
implicit = zivi.simulate_closed_loop(plant, {controller}, span, start, **world)
explicit = zivi.simulate_closed_loop(plant, baseline, span, start, **world)

for run in (implicit, explicit):
    print(run)
figure = zivi.plot.overview(implicit)  # figure.savefig("{name}.png")
"""


def _world(given: Regulator | Tracker, reference: str = "") -> str:
    """Write the plant, and everything around it that the controller does not choose."""
    force = f"{given.force!r} + {given.disturbance!r}"
    if given.amplitude:
        sine = f"amplitude={given.amplitude!r}, omega={given.omega!r}"
        force = f"zivi.LinearForce(gravity=-({force}), {sine})"
    observer = "None"
    if given.observer:
        named = _named(observer_of(given))
        observer = f"zivi.ImpactObserver(\n        {given.e!r}, {given.h!r}, {named}\n    )"
    return f"""\
plant = zivi.ImpactSystem({force}, e={given.e!r})
span, start = (0.0, {given.t_end!r}), ({given.x0!r}, {given.xdot0!r})
world = dict(
{reference}    force_model={given.force!r},  # what the controller knows of the force
    noise=({given.noise_x!r}, {given.noise_xdot!r}),
    seed={given.seed!r},
    delay={given.delay!r},
    observer={observer},
)"""


def _named(arguments: dict[str, Any]) -> str:
    return ", ".join(f"{name}={value!r}" for name, value in arguments.items())
