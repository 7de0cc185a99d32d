"""Arguments that people bring from other libraries, and what takes them here."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["ARGUMENTS", "CALLS", "RESTITUTION"]

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
    | {"dt": "fixed steps are method=zivi.ThetaGamma(h=)", "x0": "starts are y0"},
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
        "interval": "pictures a second of the film are fps",
        "frames": "pictures follow from speed and fps",
        "dt": "pictures are speed / fps apart in the motion",
        "ax": "it is figure",
        "fig": "it is figure",
        "repeat": "the film is Matplotlib's: .save(path), .to_jshtml()",
        "blit": "the film is Matplotlib's: .save(path), .to_jshtml()",
        "filename": "the film has .save(path)",
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
    "DryFriction": "zivi.DryFriction(limit=1.0)",
    "Harmonic": "zivi.Harmonic([1.0], omega=2.0)",
    "Table": "zivi.Table(times, values)",
    "method": "zivi.SwitchedRK(rtol=1e-6)",
    "ThetaGamma": "zivi.ThetaGamma(h=1e-3)",
    "MoreauJean": "zivi.MoreauJean(h=1e-3)",
    "ExplicitEuler": "zivi.ExplicitEuler(h=1e-3)",
    "Level": "zivi.Level(x=0.5)",
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
