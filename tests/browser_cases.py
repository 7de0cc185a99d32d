"""Runs of the page without Python, and the same runs of the host library."""

import itertools
from typing import Any

import numpy as np

import zivi
from zivi.lab.explicit import ExplicitRegulator

COLUMNS = ("x", "xdot", "s", "v", "x_ref", "xdot_ref", "u")
SIGNS = ("lambda_s", "lambda_v", "lambda_sr", "lambda_vr", "lambda_es", "lambda_ev")

BALL = {"h": 1e-3, "e": 0.59 / 1.41, "g": 9.81, "x": 1.0, "xdot": 6.0}
REGULATOR = {"h": 1e-3, "e": 1 / 3, "mu1": 3.0, "mu2": 2.0, "force": 0.0, "x": 1.0, "xdot": 0.0}
TRACKER = {
    "h": 1e-3,
    "e": 1 / 3,
    "mu1": 30.0,
    "mu2": 17.0,
    "g": 9.81,
    "g_ref": 19.81,
    "unknown": 0.0,
}
TRACKER |= {"x": 6.0, "xdot": 5.0, "x_ref": 3.0, "xdot_ref": 3.0}

Case = tuple[str, dict[str, float], Any, int]


def cases() -> list[Case]:
    """Give system, settings, signs and number of steps: the paper's, and others."""
    balls = [BALL, BALL | {"h": 1e-2}, BALL | {"e": 0.8, "xdot": -2.5, "h": 2e-3}]
    balls += [BALL | {"g": -1.5, "xdot": -3.0}, BALL | {"e": 0.05, "x": 0.0, "xdot": 1.0}]
    regulators = [REGULATOR, REGULATOR | {"h": 7e-3, "e": 0.7, "force": -0.5, "xdot": 2.0}]
    trackers = [
        TRACKER,
        TRACKER | {"h": 3e-3, "e": 0.6, "x": 0.5, "xdot": -4.0, "g_ref": 4.0, "unknown": 1.5},
    ]
    runs: list[Case] = []
    for settings, explicit in itertools.product(balls, (False, True)):
        runs.append(("ball", settings, explicit, 3000))
    for settings, explicit in itertools.product(regulators, (False, True)):
        runs.append(("regulator", settings, explicit, 2500))
    for settings, kind in itertools.product(trackers, ("positive", "nearest", "explicit")):
        runs.append(("tracker", settings, kind, 2000))
    return runs


def native(system: str, p: dict[str, float], signs: Any, n: int) -> dict[str, np.ndarray]:
    """Compute a run with the host library: its columns, without those that it lacks."""
    span = (0.0, n * p["h"])
    if system == "ball":
        method = zivi.ExplicitEuler(p["h"]) if signs else zivi.ThetaGamma(p["h"])
        ball = zivi.ImpactSystem(-p["g"], e=p["e"])
        sol = zivi.simulate(ball, span, (p["x"], p["xdot"]), method)
        lifted = {name: getattr(sol.transformed, name) for name in (*COLUMNS[2:4], *SIGNS[:2])}
        return {"t": sol.t, "x": sol.x, "xdot": sol.xdot, **lifted}
    run = _loop(system, p, signs, span)
    found = {name: getattr(run, name) for name in ("t", "x", "xdot", "u")}
    if system == "tracker":
        found |= {"x_ref": run.x_ref, "xdot_ref": run.xdot_ref}
    return found | dict(zip(SIGNS, run.signs.T, strict=True))


def _loop(system: str, p: dict[str, float], signs: Any, span: Any) -> zivi.ClosedLoop:
    h, e, gains = p["h"], p["e"], (p["mu1"], p["mu2"])
    scheme, start = zivi.ThetaGamma(h), (p["x"], p["xdot"])
    if system == "regulator":
        law = ExplicitRegulator(*gains, h=h)
        if not signs:
            law = zivi.TwistingRegulator(*gains, h=h, e=e, landing=False)
        plant = zivi.ImpactSystem(p["force"], e=e)
        return zivi.simulate_closed_loop(plant, law, span, start, method=scheme)
    if signs == "explicit":
        law = zivi.ExplicitTwisting(*gains, h=h, e=e)
    else:
        law = zivi.TwistingTracker(*gains, h=h, e=e, branch=signs, landing=False)
    return zivi.simulate_closed_loop(
        zivi.ImpactSystem(-p["g"] + p["unknown"], e=e),
        law,
        span,
        start,
        y_ref0=(p["x_ref"], p["xdot_ref"]),
        force_ref=-p["g_ref"],
        force_model=-p["g"],
        method=scheme,
    )


def differences(case: Case, columns: dict[str, np.ndarray]) -> list[str]:
    """Name the columns of a run that differ in a bit from the host library's."""
    return [
        name
        for name, values in native(*case).items()
        if not np.array_equal(columns[name], values, equal_nan=True)
    ]
