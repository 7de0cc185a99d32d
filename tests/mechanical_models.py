"""The systems of the references, from their energies, each derived and compiled once."""

import functools
import json
from pathlib import Path

import zivi

DATA = Path(__file__).parent / "data"
NDOF = json.loads((DATA / "ndof_references.json").read_text())
NDOF.pop("_about")
MULTI = json.loads((DATA / "multi_references.json").read_text())["cases"]

PLANE = "m*(xdot**2 + ydot**2)/2"

MODELS = {
    # one gap
    "incline": {
        "q": "x y",
        "T": "mm*(xdot**2 + ydot**2)/2",
        "V": "mm*G*y",
        "gaps": ["-x*sin(al) + y*cos(al)"],
    },
    "bowl": {
        "q": "x y",
        "T": "(xdot**2 + ydot**2)/2",
        "V": "G*y",
        "Q": ["-cd*xdot", "-cd*ydot"],
        "gaps": ["y - c*x**2"],
    },
    "sine": {
        "q": "x y",
        "T": "(xdot**2 + ydot**2)/2",
        "V": "G*y",
        "gaps": ["y - a*sin(k*x)"],
    },
    "hopper": {
        "q": "y0 y1",
        "T": "mf*y0dot**2/2 + mb*y1dot**2/2",
        "V": "mf*G*y0 + mb*G*y1 + k*(l0 - y1 + y0)**2/2",
        "Q": [
            "c*(y1dot - y0dot) - A*sin(om*t)",
            "-c*(y1dot - y0dot) + A*sin(om*t)",
        ],
        "gaps": ["y0"],
    },
    "dpend": {
        "q": "a b",
        "T": "(m1 + m2)*l1**2*adot**2/2 + m2*l2**2*bdot**2/2 + m2*l1*l2*adot*bdot*cos(a - b)",
        "V": "-(m1 + m2)*G*l1*cos(a) - m2*G*l2*cos(b)",
        "Q": ["-cd*adot", "-cd*bdot"],
        "gaps": ["l1*sin(a) + l2*sin(b) + d"],
    },
    "surf3": {
        "q": "x y z",
        "T": "(xdot**2 + ydot**2 + zdot**2)/2",
        "V": "G*z",
        "Q": ["-cd*xdot + f*cos(om*t)", "-cd*ydot", "-cd*zdot"],
        "gaps": ["z - a*sin(k*x) - b*cos(k*y)"],
    },
    "cart": {
        "q": "x phi",
        "T": "(mc + mp)*xdot**2/2 + mp*l**2*phidot**2/2 + mp*l*xdot*phidot*cos(phi)",
        "V": "f0*x - mp*G*l*cos(phi)",
        "Q": ["-cx*xdot", "-cp*phidot"],
        "gaps": ["x"],
    },
    # several gaps
    "pair": {
        "q": "x",
        "T": "m*xdot**2/2",
        "V": "k*x**2/2 + m*G*x",
        "Q": ["-c*xdot"],
        "gaps": ["x - A*sin(om*t)", "L + A*sin(om*t) - x"],
    },
    "wedge": {
        "q": "x y",
        "T": PLANE,
        "V": "m*G*y",
        "Q": ["-cd*xdot", "-cd*ydot"],
        "gaps": ["y*cos(a1) + x*sin(a1)", "y*cos(a2) - x*sin(a2)"],
    },
    "corner": {
        "q": "x y",
        "T": PLANE,
        "V": "m*G*y",
        "Q": ["fx*cos(om*t)", 0],
        "gaps": ["y", "d - x"],
    },
    "dome": {
        "q": "x y",
        "T": PLANE,
        "V": "m*G*y",
        "Q": ["-cd*xdot + fx*sin(om*t)", "-cd*ydot"],
        "gaps": ["y + s*x + c*x**2", "d - x"],
    },
    "cradle": {
        "q": "x y z",
        "T": "(m1*xdot**2 + m2*ydot**2 + m3*zdot**2)/2",
        "V": "om**2*(m1*x**2 + m2*(y + dl)**2 + m3*(z + 2*dl)**2)/2",
        "gaps": ["y - x", "z - y"],
    },
    "rock": {
        "q": "y th",
        "T": "m*ydot**2/2 + J*thdot**2/2",
        "V": "m*G*y",
        "Q": ["A*sin(om*t)", "B*sin(om*t)"],
        "gaps": ["y - hh*cos(th) + b*sin(th)", "y - hh*cos(th) - b*sin(th)"],
    },
    "dumb": {
        "q": "x y th",
        "T": "m*(xdot**2 + ydot**2)/2 + J*thdot**2/2",
        "V": "m*G*y",
        "gaps": ["y + l*sin(th)", "y - l*sin(th)", "d - x - l*cos(th)"],
    },
    "dpend3": {
        "gaps": ["l1*sin(a) + d1", "l1*sin(a) + l2*sin(b) + d2", "d3 - l1*sin(a) - l2*sin(b)"],
    },
    "tower3": {
        "q": "x y z",
        "T": "(m0*xdot**2 + m1*ydot**2 + m2*zdot**2)/2",
        "V": "G*(m0*x + m1*y + m2*z)",
        "gaps": ["x - A*sin(om*t)", "y - x", "z - y"],
    },
    "gear": {
        "q": "a b",
        "T": "J1*adot**2/2 + J2*bdot**2/2",
        "Q": ["T0 + T1*sin(om*t) - c1*adot", "-TL - c2*bdot"],
        "gaps": ["bl/2 + r*(a - b)", "bl/2 - r*(a - b)"],
    },
}
MODELS["dpend3"] = MODELS["dpend"] | MODELS["dpend3"]


@functools.cache
def compiled(name, parameters):
    """Derive and compile a model; `parameters` are their names."""
    return zivi.symbolic.system(**MODELS[name], parameters=dict.fromkeys(parameters, 1.0), e=0.5)


def model(name, par, e):
    """Give a model with parameters, without compiling it again."""
    par = {key: float(value) for key, value in par.items()}
    return compiled(name, tuple(par)).replace(e, **par)


def ndof_case(name):
    """Give the system of a reference with one gap, and its span and state."""
    case = NDOF[name]
    par = dict(case["par"])
    e, q0, w0, t0, end = (par.pop(key) for key in ("e", "q0", "w0", "t0", "T"))
    return model(case["problem"], par, e), (t0, end), (q0, w0)


def multi_case(name):
    """Give the system of a reference with several gaps, and its span and state."""
    spec = MULTI[name]["spec"]
    kind = "dpend3" if spec["model"] == "dpend" else spec["model"]
    q0, w0, e = ([float(x) for x in spec[key]] for key in ("q0", "w0", "e"))
    return model(kind, spec["par"], e), (0.0, float(spec["T"])), (q0, w0)
