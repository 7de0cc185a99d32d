"""Attributes of results and functions that people bring from other libraries, and those here."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["ATTRIBUTES", "MODULE", "PLOT"]

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
        "qpos": "it is q",
        "qvel": "it is qdot",
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
        "Contact": "contacts are gaps, zivi.LinearGap and zivi.Gap",
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

_OVERVIEW = "it is zivi.plot.overview(sol), or one of its panels"

PLOT: Mapping[str, str] = dict.fromkeys(
    ("trajectory", "plot", "plots", "solution", "run", "time_series", "timeseries"), _OVERVIEW
) | {
    "show": "plots are axes of Matplotlib: matplotlib.pyplot.show() opens them",
    "savefig": "plots are axes of Matplotlib: ax.figure.savefig(path)",
    "figure": "every plot takes ax=, or makes a figure of its own",
    "phase": "it is zivi.plot.phase_plane",
    "phase_portrait": "it is zivi.plot.phase_plane",
    "bifurcation": "it is zivi.plot.diagram",
    "contact_forces": "they are zivi.plot.reactions",
    "forces": "they are zivi.plot.reactions",
    "states": "they are zivi.plot.position, zivi.plot.velocity and zivi.plot.coordinates",
}
"""Plots of others by those of ``zivi.plot``."""
