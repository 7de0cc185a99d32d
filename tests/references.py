"""Reference trajectories with their truth, from ``data/reference_trajectories.json``."""

import json
from pathlib import Path

import zivi

DATA = Path(__file__).parent / "data" / "reference_trajectories.json"
with DATA.open() as _file:
    REFERENCES = {name: case for name, case in json.load(_file).items() if name != "_about"}


def follow(case, h, **settings):
    """Simulate a reference with step h."""
    system = zivi.ImpactSystem(zivi.LinearForce(**case["force"]), e=case["e"])
    span, state = (case["t0"], case["t_end"]), (case["x0"], case["xdot0"])
    return zivi.simulate(system, span, state, method=zivi.ThetaGamma(h=h, **settings))
