"""Names that people bring from other libraries, and what they are called here.

SciPy, python-control, MuJoCo, MATLAB: an argument, an attribute or a function of theirs gets an
error that names the one of zivi. Nothing here accepts another name.
"""

from __future__ import annotations

import difflib
import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, TypeVar, cast

__all__ = ["ARGUMENTS", "ATTRIBUTES", "MODULE", "attribute_error", "hinted", "keyword_hint"]

Called = TypeVar("Called", bound=Callable[..., Any])

_E = "the coefficient of restitution is e"
_PARAMETERS = "give the function its parameters yourself, e.g. by functools.partial"
_WORKERS = "threads=, or an executor of zivi.sweep"

ARGUMENTS: Mapping[str, Mapping[str, str]] = {
    "ImpactSystem": dict.fromkeys(
        ("restitution", "coefficient_of_restitution", "cor", "epsilon", "eps", "e_n"), _E
    )
    | dict.fromkeys(
        ("gravity", "stiffness", "damping", "k", "c", "g"),
        "it belongs to the force, zivi.ImpactSystem(zivi.LinearForce(stiffness=, damping=, "
        "gravity=), e=)",
    )
    | dict.fromkeys(
        ("m", "mass"), "the force is per unit mass: divide it, or take zivi.MechanicalSystem"
    )
    | {
        "mu": "friction is zivi.DryFriction here, or mu of a gap of zivi.MechanicalSystem",
        "args": _PARAMETERS,
    },
    "LinearForce": {
        "k": "the stiffness over the mass (1/s^2) is stiffness",
        "c": "the damping over the mass (1/s) is damping",
        "b": "the damping over the mass (1/s) is damping",
        "g": "the acceleration towards the wall is gravity, positive downwards",
        "m": "forces are per unit mass: divide them by it",
        "mass": "forces are per unit mass: divide them by it",
        "A": "the amplitude of the excitation is amplitude",
        "F0": "the amplitude of the excitation is amplitude",
        "w": "the angular frequency (rad/s) is omega",
        "frequency": "the angular frequency (rad/s) is omega, 2 pi times the frequency",
        "freq": "the angular frequency (rad/s) is omega, 2 pi times the frequency",
        "equilibrium": "a spring with its equilibrium at x0 is stiffness=k, gravity=-k*x0",
        "x0": "a spring with its equilibrium at x0 is stiffness=k, gravity=-k*x0",
    },
    "HarmonicWall": {
        "A": "it is amplitude (m)",
        "frequency": "the angular frequency (rad/s) is omega, 2 pi times the frequency",
        "freq": "the angular frequency (rad/s) is omega, 2 pi times the frequency",
        "w": "the angular frequency (rad/s) is omega",
    },
    "MechanicalSystem": dict.fromkeys(
        ("restitution", "cor", "eps"), _E + ", of all gaps or of each"
    )
    | {
        "M": "it is mass",
        "K": "write -K q into the force, or take zivi.LinearSystem",
        "C": "write -C qdot into the force, or take zivi.LinearSystem",
        "f": "it is force",
        "forces": "it is force, one function of all generalised forces",
        "constraints": "unilateral ones are gaps; for others choose coordinates that obey them",
        "contacts": "they are gaps",
        "mu": "it belongs to a gap: zivi.LinearGap(normal, tangent=, mu=)",
        "names": "they are coordinates",
    },
    "LinearGap": {
        "n": "it is normal",
        "distance": "it is offset",
        "friction": "it is mu, with tangent",
        "e": "it belongs to the system, zivi.MechanicalSystem(..., e=)",
        "restitution": "it belongs to the system, zivi.MechanicalSystem(..., e=)",
    },
    "method": {
        "dt": "the step of a method of fixed steps is h: zivi.ThetaGamma(h=1e-3)",
        "timestep": "the step of a method of fixed steps is h: zivi.ThetaGamma(h=1e-3)",
        "tol": "tolerances are rtol and atol",
        "reltol": "it is rtol",
        "abstol": "it is atol",
        "RelTol": "it is rtol",
        "AbsTol": "it is atol",
        "MaxStep": "it is max_step",
        "maxstep": "it is max_step",
        "maxiter": "steps are bounded by max_steps, impacts by max_impacts",
    },
    "simulate": {
        "t": "times of output are t_eval, the interval is t_span",
        "tspan": "it is t_span",
        "tlist": "times of output are t_eval",
        "dt": "SwitchedRK chooses its steps; times of output are t_eval, fixed steps are "
        "method=zivi.ThetaGamma(h=)",
        "x0": "the start is y0 = (x0, xdot0), or (q0, qdot0)",
        "q0": "the start is y0 = (q0, qdot0)",
        "qpos": "the start is y0 = (q0, qdot0)",
        "restitution": "it belongs to the system, zivi.ImpactSystem(force, e=...)",
        "tol": "tolerances belong to the method, zivi.SwitchedRK(rtol=, atol=)",
        "options": "settings belong to the method, zivi.SwitchedRK(rtol=, atol=)",
        "tstop": "it is tstops",
        "breakpoints": "they are tstops",
        "tcrit": "they are tstops",
        "u": "a control is part of the force, or of zivi.simulate_closed_loop",
    },
    "simulate_closed_loop": {
        "dt": "the sampling period is h of the controller",
        "Ts": "the sampling period is h of the controller",
        "x0": "the start is y0 = (x0, xdot0)",
        "tspan": "it is t_span",
    },
    "simulate_batch": dict.fromkeys(("n_jobs", "workers", "processes"), "it is threads")
    | {"dt": "fixed steps are method=zivi.ThetaGamma(h=)", "x0": "starts are y0"},
    "controller": {
        "dt": "the sampling period is h",
        "Ts": "the sampling period is h",
        "T": "the sampling period is h",
        "k1": "the gains are mu1 and mu2",
        "k2": "the gains are mu1 and mu2",
        "umax": "limits are u_limits=(low, high)",
        "u_max": "limits are u_limits=(low, high)",
        "restitution": _E,
    },
    "solve_vi": {
        "maxiter": "it is max_iter",
        "maxfev": "iterations are bounded by max_iter",
        "lb": "bounds are lower and upper, or bounds=",
        "ub": "bounds are lower and upper, or bounds=",
        "method": "there is one method; VIOptions switch its parts",
        "fprime": "it is jac",
        "xtol": "the natural residual is at most tol",
        "ftol": "the natural residual is at most tol",
    },
    "sensitivity": dict.fromkeys(("params", "parameters", "argnums", "p"), "they are wrt"),
    "periodic_orbit": {"T": "it is period", "guess": "it is the second argument, start"},
    "continue_orbit": {
        "bounds": "the range is the third argument",
        "max_steps": "it is max_points",
        "ds": "it is step",
    },
    "sweep": {
        "n_jobs": "it is workers, with executor='processes'",
        "backend": "it is executor",
        "parallel": "it is executor='processes'",
        "args": "arguments that are the same at all points are fixed={...}",
        "kwargs": "arguments that are the same at all points are fixed={...}",
    },
}
"""Arguments of others by what takes them here."""

_EVENTS = "events are t_events and y_events"
_POSITIONS = "positions are x and q, velocities xdot and qdot"

ATTRIBUTES: Mapping[str, Mapping[str, str]] = {
    "run": {
        "y": "states are x and xdot, (x, xdot) at any time is sol(t)",
        "sol": "the run itself is the dense output: sol(t)",
        "te": _EVENTS,
        "ye": _EVENTS,
        "time": "it is t",
        "times": "they are t",
        "position": "it is x",
        "velocity": "it is xdot",
        "states": "they are x and xdot",
        "q": "of one mass it is x",
        "qdot": "of one mass it is xdot",
        "qpos": "of one mass it is x",
        "qvel": "of one mass it is xdot",
        "njev": "no method of zivi evaluates the derivative of the force; nfev counts forces",
        "nlu": "no method of zivi factorises; n_steps counts steps",
        "outputs": "they are x and xdot",
        "impact_times": "they are impacts['t']",
        "zeno_time": "they are zeno['t'], the end of all is rest_time",
    },
    "mechanical run": {
        "y": "states are q and qdot, (q, qdot) at any time is sol(t)",
        "sol": "the run itself is the dense output: sol(t)",
        "te": _EVENTS,
        "ye": _EVENTS,
        "time": "it is t",
        "x": "coordinates are q",
        "xdot": "velocities are qdot",
        "v": "velocities are qdot",
        "qpos": "it is q",
        "qvel": "it is qdot",
        "dq": "it is qdot",
        "lambda_": "contact forces are reactions",
        "forces": "contact forces are reactions",
        "contact": "it is contacts",
        "velocity": "it is qdot",
        "position": "it is q",
        "impact_times": "they are impacts['t']",
    },
    "loop": {
        "y": "states are x and xdot",
        "inputs": "the control is u",
        "control": "it is u",
        "outputs": "they are x and xdot",
        "states": "they are x and xdot",
        "time": "it is t",
        "sol": "the run itself is the dense output: run(t)",
    },
    "VI result": {
        "z": "it is x",
        "w": "it is F",
        "slack": "it is F",
        "info": "it is status, with message",
        "iterations": "it is n_iter, or nit",
        "jac": "the Jacobian is not kept",
    },
}
"""Attributes of the results of others by the result here."""

_RUN = "it is zivi.simulate(zivi.ImpactSystem(force, e=0.5), t_span, y0)"
_SOLVE = "it is zivi.solve_vi; without bounds it solves equations"
_CONTROL = "zivi.interop makes blocks of python-control of plants and controllers"
_ENGINE = "a mechanism is zivi.MechanicalSystem, or zivi.symbolic.system of its energies"

MODULE: Mapping[str, str] = (
    dict.fromkeys(("solve_ivp", "odeint", "ode", "ode45", "integrate", "run", "solve"), _RUN)
    | dict.fromkeys(("DOP853", "RK45", "RK23"), "the method of high order is zivi.SwitchedRK()")
    | dict.fromkeys(("fsolve", "root", "mcp", "path", "solve_mcp", "pathmcp"), _SOLVE)
    | dict.fromkeys(("lcp", "lemke", "solve_mlcp"), "it is zivi.solve_lcp, or zivi.solve_avi")
    | dict.fromkeys(("ss", "tf", "input_output_response", "forced_response"), _CONTROL)
    | dict.fromkeys(("MjModel", "mj_step", "MultibodyPlant", "LagrangianDS", "Body"), _ENGINE)
    | dict.fromkeys(("minimize", "least_squares"), "zivi.interop.run_function is for SciPy's")
    | dict.fromkeys(("parallel", "map", "Parallel"), "it is zivi.sweep, or zivi.simulate_batch")
    | {
        "System": "it is zivi.ImpactSystem or zivi.MechanicalSystem",
        "BouncingBall": "it is zivi.ImpactSystem(-9.81, e=0.5)",
        "Simulator": "it is zivi.simulate",
        "step_response": "it is zivi.simulate of a force that jumps, with tstops=",
        "NewtonImpactNSL": "it is e of the system, or zivi.NewtonImpact",
        "TimeStepping": "it is method=zivi.MoreauJean(h)",
        "MoreauJeanOSI": "it is method=zivi.MoreauJean(h)",
        "TwistingController": "it is zivi.TwistingRegulator or zivi.TwistingTracker",
        "lyapunov": "it is zivi.lyapunov_exponents",
        "bifurcation": "it is zivi.bifurcation_diagram",
        "continuation": "it is zivi.continue_orbit",
        "fsolve_lcp": "it is zivi.solve_lcp",
    }
)
"""Functions and classes of others, and what is nearest to them here."""


def keyword_hint(owner: str, name: str, known: tuple[str, ...] = ()) -> str:
    """Say what an argument is called here, or which is spelt nearly so; "" if nothing is near."""
    hint = ARGUMENTS.get(owner, {}).get(name)
    if hint is not None:
        return f": {hint}"
    close = difflib.get_close_matches(name, known, 1)
    return f": did you mean {close[0]!r}?" if close else ""


def attribute_error(kind: str, thing: object, name: str) -> AttributeError:
    """Make the error of an attribute that a result does not have."""
    hint = ATTRIBUTES[kind].get(name)
    text = f"{type(thing).__name__!r} object has no attribute {name!r}"
    return AttributeError(f"{text}: {hint}" if hint else text, name=name, obj=thing)


def hinted(owner: str) -> Callable[[Called], Called]:
    """Decorate a function or a class: errors of arguments that it does not have get a hint."""

    def decorate(it: Called) -> Called:
        if isinstance(it, type):
            it.__init__ = _hinting(it.__init__, owner)  # type: ignore[misc]
            return cast(Called, it)
        return cast(Called, _hinting(it, owner))

    return decorate


def _hinting(function: Callable[..., Any], owner: str) -> Callable[..., Any]:
    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except TypeError as error:
            where = error.__traceback__
            if where is None or where.tb_next is not None:
                raise  # not of this call's arguments
            known = tuple(inspect.signature(function).parameters)
            wrong = [name for name in kwargs if name not in known]
            hint = keyword_hint(owner, wrong[0], known) if wrong else ""
            if not hint:
                raise
            text = str(error).partition(". Did you mean")[0]
            raise TypeError(f"{text}{hint}") from None

    return call
