"""Hints for names and calls from other libraries and for misspelt names."""

from __future__ import annotations

import difflib
import functools
import importlib
import inspect
import sys
import types
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn, TypeVar, cast

# Arguments of other libraries, and the zivi function or method that accepts them.

RESTITUTION = "the coefficient of restitution is e"
_PARAMETERS = "give the function its parameters yourself, e.g. by functools.partial"

ARGUMENTS: Mapping[str, Mapping[str, str]] = {
    "ImpactSystem": dict.fromkeys(
        ("restitution", "coefficient_of_restitution", "cor", "epsilon", "eps", "e_n"), RESTITUTION
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
        "contact": "compliant contact belongs to a gap, zivi.LinearGap([1], contact=) of a "
        "zivi.MechanicalSystem",
        "mu": "friction is zivi.DryFriction here, or mu of a gap of zivi.MechanicalSystem",
        "x0": "the start belongs to the run, zivi.simulate(system, t_span, (x0, xdot0))",
        "y0": "the start belongs to the run, zivi.simulate(system, t_span, (x0, xdot0))",
        "floor": "it is wall, which moves; a floor at another height is one at x = 0",
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
        "f": "the angular frequency (rad/s) is omega, 2 pi times the frequency",
    },
    "MechanicalSystem": dict.fromkeys(
        ("restitution", "cor", "eps"), RESTITUTION + ", of all gaps or of each"
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
    "Contact": dict.fromkeys(
        ("contacts", "pair", "bodies", "shapes"), "the two shapes are first and second, by name"
    )
    | dict.fromkeys(("friction", "coefficient"), "it is mu")
    | dict.fromkeys(("restitution", "cor"), RESTITUTION)
    | {
        "tangent": "directions of slip follow from the shapes",
        "static": "it is mu_static",
        "law": "the force law of a compliant contact is contact",
    },
    "Gap": {
        "jac": "it is gradient",
        "jacobian": "it is gradient",
        "hessian": "it is curvature",
        "hess": "it is curvature",
        "fun": "it is value",
        "friction": "it is mu, with tangent",
        "e": "it belongs to the system, zivi.MechanicalSystem(..., e=)",
    },
    "DryFriction": dict.fromkeys(
        ("mu", "coefficient", "normal_force"),
        "limit is the largest force, mu times the load; mu belongs to zivi.LinearGap",
    )
    | {
        "Fc": "it is limit",
        "force": "it is limit",
        "mu_s": "it is static, a force",
        "Fs": "it is static",
        "belt": "it is velocity",
        "v": "it is velocity",
        "stribeck": "limit may be a function of (t, q, qdot)",
    },
    "LinearSystem": {
        "mass": "it is M",
        "damping": "it is C",
        "D": "the damping is C",
        "stiffness": "it is K",
        "F": "the load is excitation=zivi.Harmonic(F, omega)",
        "f": "the load is excitation=zivi.Harmonic(f, omega)",
        "force": "the load is excitation=zivi.Harmonic(force, omega)",
        "forcing": "it is excitation",
    },
    "Harmonic": dict.fromkeys(
        ("freq", "frequency", "f"), "the angular frequency (rad/s) is omega, 2 pi times it"
    )
    | {"A": "it is amplitude", "F": "it is amplitude", "w": "it is omega", "phi": "it is phase"},
    "Table": {"t": "it is times", "x": "it is times", "y": "it is values", "data": "it is values"},
    "Level": dict.fromkeys(("y", "position", "value"), "give x= or xdot=")
    | {"velocity": "it is xdot", "v": "it is xdot", "q": "levels are for one mass"},
    "event": {
        "terminate": "it is terminal",
        "stop": "it is terminal",
        "rising": "it is direction=1",
        "falling": "it is direction=-1",
    },
    "symbolic": {
        "L": "give T and V, of which L = T - V",
        "lagrangian": "give T and V, of which L = T - V",
        "constraints": "unilateral ones are gaps; for others choose coordinates that obey them",
        "params": "they are parameters",
        "forces": "they are Q",
        "restitution": RESTITUTION,
        "coordinates": "they are q",
        "D": "dissipative forces are part of Q",
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
        "max_iter": "steps are bounded by max_steps, impacts by max_impacts",
        "h": "SwitchedRK chooses its steps, at most max_step; fixed ones are zivi.ThetaGamma(h=)",
        "rtol": "a method of fixed steps has none: take zivi.SwitchedRK(rtol=), or a smaller h",
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
        "inputs": "a control is part of the force, or of zivi.simulate_closed_loop",
        "initial_state": "the start is y0 = (x0, xdot0), or (q0, qdot0)",
        "verbose": "a bar is progress=True; the run prints itself",
        "seed": "a run draws nothing; noise is of zivi.simulate_closed_loop",
        "n_steps": "times of output are t_eval, fixed steps are method=zivi.ThetaGamma(h=)",
        "controller": "it is an argument of zivi.simulate_closed_loop",
    },
    "simulate_closed_loop": {
        "dt": "the sampling period is h of the controller",
        "Ts": "the sampling period is h of the controller",
        "x0": "the start is y0 = (x0, xdot0)",
        "tspan": "it is t_span",
        "r": "it is reference",
        "ref": "it is reference",
        "setpoint": "it is reference",
        "noise_std": "it is noise=(of x, of xdot), standard deviations",
        "sigma": "it is noise=(of x, of xdot), standard deviations",
        "latency": "it is delay, in sampling periods",
        "saturation": "limits are u_limits of the controller",
        "u_limits": "they belong to the controller, zivi.TwistingTracker(..., u_limits=)",
    },
    "simulate_batch": dict.fromkeys(
        ("n_jobs", "n_workers", "workers", "processes"), "it is threads"
    )
    | {
        "dt": "fixed steps are method=zivi.ThetaGamma(h=)",
        "x0": "starts are y0",
        "e": "values for the runs are parameters={'e': [...]}",
    },
    "controller": {
        "dt": "the sampling period is h",
        "Ts": "the sampling period is h",
        "T": "the sampling period is h",
        "k1": "the gains are mu1 and mu2",
        "k2": "the gains are mu1 and mu2",
        "umax": "limits are u_limits=(low, high)",
        "u_max": "limits are u_limits=(low, high)",
        "saturation": "limits are u_limits=(low, high)",
        "gain": "the gains are mu1 and mu2",
        "gains": "the gains are mu1 and mu2",
        "kp": "the gains are mu1 and mu2",
        "kd": "the gains are mu1 and mu2",
        "restitution": RESTITUTION,
    },
    "design": {
        "umax": "limits are u_limits=(low, high)",
        "u_max": "limits are u_limits=(low, high)",
        "M": "it is bound",
        "disturbance": "it is bound",
        "T": "it is settling_time",
        "x0": "it is start",
    },
    "observer": {
        "Q": "the variance of the unknown force is q_d",
        "R": "standard deviations of the measurements are noise",
        "dt": "the sampling period is h",
        "Ts": "the sampling period is h",
        "sigma": "it is noise",
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
        "jacobian": "it is jac",
        "constraints": "only bounds are possible, lower and upper",
        "A": "the matrix of a linear problem is M",
        "b": "the constant term of a linear problem is q",
    },
    "sensitivity": dict.fromkeys(("params", "parameters", "argnums", "p"), "they are wrt"),
    "periodic_orbit": {"T": "it is period", "guess": "it is the second argument, start"},
    "continue_orbit": {
        "bounds": "the range is the third argument",
        "max_steps": "it is max_points",
        "ds": "it is step",
    },
    "settled": {
        "n_transient": "it is transient",
        "discard": "it is transient",
        "n": "it is keep",
        "n_iter": "it is keep",
        "dt": "SwitchedRK chooses its steps",
        "resolution": "give the values themselves, e.g. by numpy.linspace",
        "y0": "they are starts",
    },
    "animate": {
        "interval": "frames per second are fps",
        "frames": "frames follow from speed and fps",
        "dt": "the interval between frames is speed / fps in the motion (s)",
        "ax": "it is figure",
        "fig": "it is figure",
        "repeat": "the result is an animation of Matplotlib: .save(path), .to_jshtml()",
        "blit": "the result is an animation of Matplotlib: .save(path), .to_jshtml()",
        "filename": "the animation has .save(path)",
    },
    "sweep": {
        "n_jobs": "it is workers, with executor='processes'",
        "backend": "it is executor",
        "parallel": "it is executor='processes'",
        "args": "arguments that are the same at all points are fixed={...}",
        "kwargs": "arguments that are the same at all points are fixed={...}",
        "*": "parameters are one dictionary, the second argument: {'*': [...]}",
    },
    "at": {"*": "at evaluates a state; another system is replace(*=...)"},
    "sample": {
        "method": "it is the first argument, sampler",
        "size": "it is n",
        "n_samples": "it is n",
        "*": "bounds are one dictionary, the third argument: {'*': (low, high)}",
    },
}
"""Arguments of others by what takes them here."""

CALLS: Mapping[str, str] = {
    "ImpactSystem": "zivi.ImpactSystem(-9.81, e=0.5)",
    "LinearForce": "zivi.LinearForce(stiffness=4.0, damping=0.1, gravity=9.81)",
    "HarmonicWall": "zivi.HarmonicWall(amplitude=0.1, omega=10.0)",
    "MechanicalSystem": "zivi.MechanicalSystem(mass=M, force=F, gaps=[zivi.LinearGap([1.0])], "
    "e=0.5)",
    "LinearSystem": "zivi.LinearSystem(M, C, K, gaps=[zivi.LinearGap([1.0])], e=0.5)",
    "LinearGap": "zivi.LinearGap([0.0, 1.0])",
    "Gap": "zivi.Gap(g, gradient) with functions of (t, q)",
    "Contact": 'zivi.mechanics.Contact("ball", "floor", mu=0.3)',
    "DryFriction": "zivi.DryFriction(limit=1.0)",
    "Harmonic": "zivi.Harmonic([1.0], omega=2.0)",
    "Table": "zivi.Table(times, values)",
    "method": "zivi.SwitchedRK(rtol=1e-6)",
    "ThetaGamma": "zivi.ThetaGamma(h=1e-3)",
    "MoreauJean": "zivi.MoreauJean(h=1e-3)",
    "ExplicitEuler": "zivi.ExplicitEuler(h=1e-3)",
    "Level": "zivi.Level(x=0.5)",
    "Kick": "zivi.Kick(t=1.0, dv=-2.0)",
    "event": "@zivi.event(terminal=True) above the function",
    "simulate": "zivi.simulate(system, (0, 1), (x0, xdot0))",
    "simulate_batch": "zivi.simulate_batch(system, (0, 1), [(x0, xdot0), ...])",
    "simulate_closed_loop_batch": "zivi.simulate_closed_loop_batch(system, controller, (0, 1), "
    "[(x0, xdot0), ...])",
    "simulate_closed_loop": "zivi.simulate_closed_loop(system, controller, (0, 1), (x0, xdot0))",
    "controller": "zivi.TwistingTracker(mu1, mu2, h=1e-3, e=0.5)",
    "TwistingRegulator": "zivi.TwistingRegulator(mu1, mu2, h=1e-3, e=0.5)",
    "design": "zivi.design_tracker(1.0, start=(x0, xdot0))",
    "design_regulator": "zivi.design_regulator(1.0, start=(x0, xdot0))",
    "observer": "zivi.ImpactObserver(e, h)",
    "solve_vi": "zivi.solve_vi(F, lower, upper, x0)",
    "solve_avi": "zivi.solve_avi(M, q, lower, upper)",
    "solve_ncp": "zivi.solve_ncp(F, x0)",
    "solve_lcp": "zivi.solve_lcp(M, q)",
    "sensitivity": 'zivi.sensitivity(system, (0, 1), (x0, xdot0), ["x0", "e"])',
    "periodic_orbit": "zivi.periodic_orbit(system, (0, (x0, xdot0)))",
    "continue_orbit": 'zivi.continue_orbit(orbit, "amplitude", (1.0, 1.8))',
    "settled": 'zivi.bifurcation_diagram(system, "amplitude", values)',
    "basins": "zivi.basins(system, x0s, v0s)",
    "lyapunov_exponents": "zivi.lyapunov_exponents(system, t_span, y0)",
    "sweep": "zivi.sweep(function, {'e': [0.1, 0.2]})",
    "at": "zivi.MechanicalSystem.at(t, q, qdot)",
    "sample": "zivi.sample('sobol', 64, {'e': (0.1, 0.9)})",
    "symbolic": 'zivi.symbolic.system("a", T="m*adot**2/2", V="m*g*a", parameters={...})',
    "animate": "zivi.plot.animate(sol)",
}
"""A call that is right, for each function whose arguments may be missing or too many."""


# Attributes of results and functions that people bring from other libraries, and those here.

_EVENTS = "events are t_events and y_events"
_STATES = "states are x and xdot"
_SAVE = "it is zivi.files.save(sol, path)"

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
        "t_impacts": "they are impacts['t']",
        "t_impact": "they are impacts['t']",
        "n_bounces": "it is len(impacts)",
        "impact_speeds": "they are impacts['speed_before'] and impacts['speed_after']",
        "v_before": "they are impacts['speed_before']",
        "v_after": "they are impacts['speed_after']",
        "xdot_before": "they are impacts['xdot_before']",
        "xdot_after": "they are impacts['xdot_after']",
        "xdot_minus": "they are impacts['xdot_before']",
        "xdot_plus": "they are impacts['xdot_after']",
        "impulses": "they are impacts['impulse']",
        "t_zeno": "they are zeno['t'], the end of all is rest_time",
        "t_rest": "it is rest_time",
        "rest": "it is rest_time, None without rest",
        "at_rest": "it is rest_time, None without rest",
        "t_end": "it is t[-1]",
        "t_final": "it is t[-1]",
        "final": "the last state is x[-1], xdot[-1]",
        "state": "states are x and xdot, (x, xdot) at any time is sol(t)",
        "acceleration": "it is the force of the system",
        "dx": "it is xdot",
        "x_dot": "it is xdot",
        "velocities": "they are xdot",
        "positions": "they are x",
        "show": "it is plot(), then matplotlib.pyplot.show()",
        "draw": "it is plot()",
        "at": "the run itself is the dense output: sol(t)",
        "zeno_time": "they are zeno['t'], the end of all is rest_time",
        "ys": _STATES,
        "yout": _STATES,
        "tout": "it is t",
        "ts": "they are t",
        "xd": "it is xdot",
        "v0": "the velocity is xdot",
        "ie": _EVENTS,
        "events": _EVENTS + ", impacts are impacts",
        "bounces": "they are impacts",
        "collisions": "they are impacts",
        "n_impacts": "it is len(impacts)",
        "steps": "it is n_steps",
        "u": "a run without a controller has none; see zivi.simulate_closed_loop",
        "energy": "zivi does not know the potential: compute it from x and xdot",
        "interpolate": "the run itself is the dense output: sol(t)",
        "evaluate": "the run itself is the dense output: sol(t)",
        "reactions": "of one mass at rest it is minus the force",
        "gaps": "of one mass the gap is x",
        "contacts": "of one mass: at rest from rest_time, between zeno and liftoffs",
        "save": _SAVE,
        "to_csv": _SAVE,
        "to_dataframe": "it is to_pandas()",
        "df": "it is to_pandas()",
        "animate": "it is zivi.plot.animate(sol)",
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
        "dq": "it is qdot",
        "lambda_": "contact forces are reactions",
        "forces": "contact forces are reactions",
        "contact": "it is contacts",
        "velocity": "it is qdot",
        "position": "it is q",
        "positions": "they are q",
        "velocities": "they are qdot",
        "q_dot": "it is qdot",
        "qd": "it is qdot",
        "contact_forces": "they are reactions",
        "u": "a run without a controller has none; see zivi.simulate_closed_loop",
        "g": "they are gaps",
        "bounces": "they are impacts",
        "save": _SAVE,
        "to_dataframe": "it is to_pandas()",
        "animate": "it is zivi.plot.animate(sol)",
        "impact_times": "they are impacts['t']",
        "t_impacts": "they are impacts['t']",
        "impact_speeds": "they are impacts['speed_before'] and impacts['speed_after']",
        "impulses": "they are impacts['impulse']",
        "t_zeno": "they are zeno['t']",
        "t_end": "it is t[-1]",
        "gap": "they are gaps",
        "names": "they are coordinate_names and gap_names",
        "state": "states are q and qdot, (q, qdot) at any time is sol(t)",
    },
    "impacts": {
        "time": "it is 't'",
        "times": "they are 't'",
        "v": "speeds are 'speed_before' and 'speed_after'",
        "speed": "it is 'speed_before', or 'speed_after'",
        "velocity": "it is 'speed_before', or 'speed_after'",
        "v_minus": "it is 'speed_before'",
        "v_plus": "it is 'speed_after'",
        "before": "it is 'speed_before'",
        "after": "it is 'speed_after'",
        "x": "the states at impacts are sol(impacts['t'])",
        "q": "the states at impacts are sol(impacts['t'])",
        "force": "an impact has an 'impulse'",
        "name": "the number of the gap is 'gap', its name sol.gap_names[gap]",
        "wall": "the number of the gap is 'gap'",
        "contact": "the number of the gap is 'gap'",
    },
    "system": {
        "simulate": "it is zivi.simulate(system, t_span, y0)",
        "run": "it is zivi.simulate(system, t_span, y0)",
        "solve": "it is zivi.simulate(system, t_span, y0)",
        "step": "it is zivi.simulate(system, t_span, y0)",
        "control": "it is zivi.simulate_closed_loop(system, controller, t_span, y0)",
        "sweep": "it is zivi.sweep(function, parameters)",
        "plot": "runs are drawn, zivi.simulate(system, t_span, y0).plot()",
        "restitution": "it is e",
        "cor": "it is e",
        "params": "numbers belong to the force, force",
        "parameters": "numbers belong to the force, force",
        "gravity": "it belongs to the force, force",
        "stiffness": "it belongs to the force, force",
        "mass": "forces are per unit mass",
        "f": "it is force",
        "F": "it is force",
        "copy": "a system never changes: replace(...) makes another one",
        "set": "a system never changes: replace(...) makes another one",
        "update": "a system never changes: replace(...) makes another one",
        "with_": "it is replace(...)",
    },
    "mechanism": {
        "simulate": "it is zivi.simulate(system, t_span, (q0, qdot0))",
        "run": "it is zivi.simulate(system, t_span, (q0, qdot0))",
        "solve": "it is zivi.simulate(system, t_span, (q0, qdot0))",
        "plot": "runs are drawn, zivi.simulate(system, t_span, (q0, qdot0)).plot()",
        "restitution": "it is e",
        "mass": "it is at(t, q, qdot).mass",
        "M": "it is at(t, q, qdot).mass",
        "force": "it is at(t, q, qdot).force",
        "F": "it is at(t, q, qdot).force",
        "n": "it is the length of the coordinates, len(q0)",
        "contacts": "they are gaps",
        "names": "they are coordinate_names(n) and gap_names",
        "copy": "a system never changes: replace(...) makes another one",
        "set": "a system never changes: replace(...) makes another one",
        "update": "a system never changes: replace(...) makes another one",
    },
    "loop": {
        "y": "states are x and xdot",
        "inputs": "the control is u",
        "control": "it is u",
        "outputs": "they are x and xdot",
        "states": "they are x and xdot",
        "time": "it is t",
        "sol": "the run itself is the dense output: run(t)",
        "y_ref": "it is x_ref",
        "yr": "it is x_ref",
        "e": "the error is error, x - x_ref",
        "settling_time": "batches have it; of one loop see rest_time and error",
        "save": _SAVE,
        "to_dataframe": "it is to_pandas()",
    },
    "sensitivity": {
        "rest_time": "the time is trajectory.rest_time, its derivatives are zeno_times[-1]",
        "jac": "it is jacobian(t)",
        "gradient": "derivatives of the final state are final, of times zeno_times, impacts['dt']",
        "derivatives": "derivatives of the final state are final, of times zeno_times, "
        "impacts['dt']",
        "sol": "derivatives at any time are s(t)",
        "run": "it is trajectory",
        "names": "they are wrt",
        "parameters": "they are wrt",
    },
    "VI result": {
        "z": "it is x",
        "w": "it is F",
        "slack": "it is F",
        "info": "it is status, with message",
        "iterations": "it is n_iter, or nit",
        "jac": "the Jacobian is not kept",
        "lam": "multipliers of the bounds are F, at a lower bound F, at an upper one -F",
        "converged": "it is success",
    },
    "controller": {
        "update": "it is step(...)",
        "compute": "it is step(...)",
        "control": "it is step(...), once per sampling period",
        "gains": "they are settings['mu1'], settings['mu2']",
        "dt": "it is h",
        "Ts": "it is h",
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
        "sim": _RUN,
        "lsim": _RUN,
        "initial_response": _RUN,
        "Model": _ENGINE,
        "Contact": "contacts are gaps, zivi.LinearGap and zivi.Gap; shapes of a zivi.Tree have "
        "zivi.mechanics.Contact",
        "Spring": "it is zivi.LinearForce(stiffness=, damping=)",
        "Wall": "a wall at rest is x = 0, one that moves zivi.HarmonicWall or MovingWall",
        "Ball": "it is zivi.ImpactSystem(-9.81, e=0.5)",
        "Plant": "it is zivi.ImpactSystem or zivi.MechanicalSystem",
        "StateSpace": _CONTROL,
        "Tracker": "it is zivi.TwistingTracker",
        "Regulator": "it is zivi.TwistingRegulator",
        "Observer": "it is zivi.ImpactObserver",
        "KalmanFilter": "it is zivi.ImpactObserver",
        "Event": "it is the decorator zivi.event, or zivi.Level",
        "load": "it is zivi.files.load(path)",
        "save": "it is zivi.files.save(run, path)",
        "linprog": "bounds and signs of a map are zivi.solve_avi; zivi does not optimise",
        "floquet": "they are multipliers of zivi.periodic_orbit",
        "poincare": "it is zivi.plot.poincare, or zivi.impact_map",
        "bvp": "periodic motions are zivi.periodic_orbit",
        "jacobian": "derivatives of runs are zivi.sensitivity",
    }
)
"""Functions and classes of others, and what is nearest to them here."""

MODULE_CALLS: Mapping[str, str] = {
    "zivi.plot": "it is zivi.plot.overview(sol), or sol.plot()",
    "zivi.symbolic": "it is zivi.symbolic.system(coordinates, T=, V=, gaps=)",
    "zivi.files": "it is zivi.files.save(sol, path), or zivi.files.load(path)",
    "zivi.fmu": "it is zivi.export_fmu(folder)",
    "zivi.study": "it is zivi.sweep(function, parameters)",
    "zivi.control": "it is zivi.simulate_closed_loop(system, controller, t_span, y0)",
    "zivi.orbits": "it is zivi.periodic_orbit(system, start)",
    "zivi.vi": "it is zivi.solve_vi(F, lower, upper, x0)",
    "zivi.derivatives": "it is zivi.sensitivity(system, t_span, y0, wrt)",
    "zivi.simulation": "it is zivi.simulate(system, t_span, y0)",
    "zivi.system": "it is zivi.ImpactSystem(force, e=0.5), or zivi.MechanicalSystem",
    "zivi.mechanics": "it is zivi.MechanicalSystem(mass=, force=, gaps=, e=)",
    "zivi.interop": "it is one of its functions, zivi.interop.run_function",
    "zivi.batch": "it is zivi.simulate_batch(system, t_span, y0)",
    "zivi.closed_loop": "it is zivi.simulate_closed_loop(system, controller, t_span, y0)",
    "zivi.observer": "it is zivi.ImpactObserver(e, h)",
    "zivi.wall": "it is zivi.HarmonicWall(amplitude, omega)",
    "zivi.methods": "it is method=zivi.SwitchedRK()",
}
"""What is meant by the call of a module."""

_OVERVIEW = "it is zivi.plot.overview(sol), or one of its panels"

PLOT: Mapping[str, str] = dict.fromkeys(
    ("trajectory", "plot", "plots", "solution", "run", "time_series", "timeseries"), _OVERVIEW
) | {
    "show": "plots are axes of Matplotlib: matplotlib.pyplot.show() opens them",
    "savefig": "plots are axes of Matplotlib: ax.figure.savefig(path)",
    "figure": "every plot takes ax=, or makes a figure of its own",
    "phase": "it is zivi.plot.phase_plane",
    "impact_speeds": "it is zivi.plot.impacts",
    "hist": "it is zivi.plot.impacts",
    "histogram": "it is zivi.plot.impacts",
    "zoom": "take the axes: zivi.plot.position(sol).set_xlim(t0, t1)",
    "energy": "zivi does not know the potential: compute it from x and xdot",
    "movie": "it is zivi.plot.animate",
    "acceleration": "it is the force of the system",
    "friction": "it is zivi.plot.modes, or zivi.plot.slips",
    "orbit": "it is zivi.plot.phase_plane(orbit.run)",
    "phase_portrait": "it is zivi.plot.phase_plane",
    "bifurcation": "it is zivi.plot.diagram",
    "contact_forces": "they are zivi.plot.reactions",
    "forces": "they are zivi.plot.reactions",
    "states": "they are zivi.plot.position, zivi.plot.velocity and zivi.plot.coordinates",
}
"""Plots of others by those of ``zivi.plot``."""


# Names and calls of other libraries or misspelt ones, and their zivi equivalents.
#
# SciPy, python-control, MuJoCo, MATLAB: an argument, an attribute or a function of theirs gets an
# error that names the one of zivi; what is spelt nearly right, the name that is near. Nothing here
# accepts another name.

Called = TypeVar("Called", bound=Callable[..., Any])


def closest(name: str, known: Iterable[str], cutoff: float = 0.6) -> str | None:
    """Find the known name that is spelt most alike; capitals and underscores do not count."""
    plain = {_normalised(it): it for it in known}
    close = difflib.get_close_matches(_normalised(name), plain, 1, cutoff)
    return plain[close[0]] if close else None


def _normalised(name: str) -> str:
    return name.lower().replace("_", "")


def name_hint(name: str, known: Iterable[str], hints: Mapping[str, str]) -> str:
    """Return a hint, the zivi name for a foreign or misspelt name, or ""."""
    if name in hints:
        return f": {hints[name]}"
    if name.startswith("_"):  # what machinery asks for
        return ""
    close = closest(name, known, 0.75)
    return f": did you mean {close!r}?" if close else ""


def keyword_hint(owner: str, name: str, known: tuple[str, ...] = ()) -> str:
    """Return a hint, the zivi argument for a foreign or misspelt one, or ""."""
    hints = ARGUMENTS.get(owner, {})
    if name not in hints and (close := closest(name, known)):
        return f": did you mean {close!r}?"
    hint = hints.get(name) or hints.get(ANY, "").replace(ANY, name)
    return f": {hint}" if hint else ""


ANY = "*"
"""Stands for every argument that is not known otherwise, in its hint for its name."""


def attribute_error(kind: str, thing: object, name: str, part: str = "") -> AttributeError:
    """Make the error of an attribute that a result or a system does not have.

    `part` is the attribute with another object, such as the run of derivatives: the hint names the
    part for an attribute of this object.
    """
    owner: Any = type(thing)  # whose hash mypy does not know
    hint = _attribute_hint(kind, owner, name)
    other: Any = type(thing.__dict__.get(part)) if part else owner
    if name not in ATTRIBUTES[kind] and other is not owner and name in _public_names(other):
        hint = f": it is {part}.{name}"
    text = f"{type(thing).__name__!r} object has no attribute {name!r}"
    # Python adds a suggestion of its own if it knows the object
    return AttributeError(f"{text}{hint}", name=name, obj=None if hint else thing)


@functools.lru_cache(1024)  # `getattr` with a default asks for the same name in every run
def _attribute_hint(kind: str, owner: type, name: str) -> str:
    return name_hint(name, _public_names(owner), ATTRIBUTES[kind])


def _public_names(owner: type) -> list[str]:
    known = [*dir(owner), *(getattr(owner, "__dataclass_fields__", None) or ())]
    return [it for it in known if not it.startswith("_")]


def module_error(module: str, name: str, known: Iterable[str], hints: Mapping[str, str]) -> Any:
    """Make the error of a name that a module does not have."""
    hint = name_hint(name, known, hints)
    return AttributeError(f"module {module!r} has no attribute {name!r}{hint}")


class CallableHint(types.ModuleType):
    """A module that is called as if it were a function: the error names the function."""

    def __call__(self, *args: Any, **kwargs: Any) -> NoReturn:
        """Raise a TypeError."""
        hint = MODULE_CALLS.get(self.__name__)
        raise TypeError(f"module {self.__name__!r} is not callable{f': {hint}' if hint else ''}")

    def __reduce__(self) -> tuple[Any, ...]:
        # cloudpickle takes along the modules that a function names, this one among them
        return importlib.import_module, (self.__name__,)


def field_error(kind: str, name: str, fields: Iterable[str]) -> ValueError:
    """Make the error of a field that a table does not have."""
    fields = tuple(fields)
    hint = name_hint(name, fields, ATTRIBUTES[kind])
    return ValueError(f"no field of name {name!r}{hint}; the fields are {', '.join(fields)}")


def hint_calls(module: str) -> None:
    """Make calls of a module raise an error with a hint."""
    sys.modules[module].__class__ = CallableHint


class Hinted:
    """A run: names that it does not have, keys and unpacking are answered by a hint."""

    _habits: ClassVar[str]

    if not TYPE_CHECKING:  # which would take any name for granted

        def __getattr__(self, name):
            raise attribute_error(self._habits, self, name)

        def __getitem__(self, key):
            kind = type(self).__name__
            if not isinstance(key, str):
                raise TypeError(f"{kind} is not indexable; use its arrays, e.g. sol.t[i]")
            hint = f"it is sol.{key}" if hasattr(self, key) else ATTRIBUTES[self._habits].get(key)
            raise TypeError(f"{kind} is not indexable{f': {hint}' if hint else ''}")

        def __iter__(self):
            states = "sol.q, sol.qdot" if "x" in ATTRIBUTES[self._habits] else "sol.x, sol.xdot"
            kind = type(self).__name__
            raise TypeError(f"{kind} is not iterable; its arrays are sol.t, {states}")


def hinted(owner: str) -> Callable[[Called], Called]:
    """Decorate a function or a class: errors of arguments that it does not have get a hint."""

    def decorate(it: Called) -> Called:
        if isinstance(it, type):
            it.__init__ = _hinting(it.__init__, owner)  # type: ignore[misc]
            return cast("Called", it)
        return cast("Called", _hinting(it, owner))

    return decorate


def _hinting(function: Callable[..., Any], owner: str) -> Callable[..., Any]:
    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except TypeError as error:
            where = error.__traceback__
            if where is None or where.tb_next is not None:
                _note(error, args)  # not of this call's arguments
                raise
            text = _call_error(function, owner, str(error), args, kwargs)
            if text is None:
                raise
            raise TypeError(text) from None

    return call


def _call_error(
    function: Callable[..., Any], owner: str, text: str, args: Any, kwargs: dict[str, Any]
) -> str | None:
    """Return an error that names the replacement of a call, or None."""
    parameters = inspect.signature(function).parameters
    example = CALLS.get(function.__qualname__.partition(".")[0], CALLS[owner])
    known = tuple(parameters)
    wrong = [name for name in kwargs if name not in known]
    hint = keyword_hint(owner, wrong[0], known) if wrong else ""
    if hint:
        text = text.partition(". Did you mean")[0]
        if "missing" in text:  # under another name
            text = f"{function.__name__}() got an unexpected keyword argument {wrong[0]!r}"
        return f"{text}{hint}"
    if "positional argument" in text and "takes" in text:
        place = [it.name for it in parameters.values() if it.kind is not it.KEYWORD_ONLY]
        named = [name for name in known if name not in place and name not in kwargs]
        pairs = zip(named, args[len(place) :], strict=False)
        written = ", ".join(f"{name}={short(value)}" for name, value in pairs)
        if written and not any(map(callable, args[len(place) :])):  # no decorator without brackets
            return f"{text}: write {written}, as in {example}"
    return None if wrong else f"{text}: write {example}"


def short(value: object) -> str:
    """Show a value in a few characters."""
    text = repr(value)
    return text if len(text) <= 40 and "\n" not in text else "..."


OF_NUMBERS = ("is not subscriptable", "has no len()", "is not iterable", "unpack non-iterable")
"""What Python says of a number that is used as an array."""


def _note(error: TypeError, args: tuple[Any, ...]) -> None:
    """Note on an error which arguments a user function receives: numbers, not arrays."""
    form = next((it._call_form for it in args[:1] if hasattr(it, "_call_form")), None)
    if form and "float" in str(error) and any(it in str(error) for it in OF_NUMBERS):
        error.add_note(f"zivi: {form}")
