"""Mechanical systems against references that follow every impact (tests/brute_force)."""

import functools
import json
from pathlib import Path

import numpy as np
import pytest

import zivi

CASES = json.loads((Path(__file__).parent / "data" / "mechanical_references.json").read_text())
MODEL = ("q", "T", "V", "Q", "gaps", "parameters", "e")
SETTINGS = [(order, tol) for order in (8, 5) for tol in (1e-6, 1e-9, 1e-12)]
FIRST = 3
"""Of the infinitely many accumulations before a corner, so many can be compared."""

pytestmark = pytest.mark.xdist_group("mechanical models")


@functools.cache
def system(name):
    return zivi.symbolic.system(**{key: CASES[name][key] for key in MODEL if key in CASES[name]})


def run(name, order, tol, **more):
    case = CASES[name]
    method = zivi.SwitchedRK(order=order, rtol=tol, atol=tol)
    return zivi.simulate(system(name), (0, case["end"]), case["start"], method, **more)


def events(case, kind):
    found = [(float(time), gaps) for what, time, gaps, _ in case["events"] if what == kind]
    return np.array([time for time, _ in found]), [gaps for _, gaps in found]


@pytest.mark.parametrize(("order", "tol"), SETTINGS)
@pytest.mark.parametrize("name", CASES)
def test_every_impact_followed(name, order, tol):
    case = CASES[name]
    sol = run(name, order, tol)
    assert sol.success, sol.message
    corners, members = events(case, "corner")
    times, gaps = events(case, "zeno")
    n = FIRST if len(corners) else len(times)
    assert len(sol.zeno) == len(times) or len(corners)
    assert [[gap] for gap in sol.zeno["gap"][:n]] == gaps[:n]
    assert sol.zeno["t"][:n] == pytest.approx(times[:n], abs=50 * tol)
    times, gaps = events(case, "lift")
    assert [[gap] for gap in sol.liftoffs["gap"]] == gaps
    assert sol.liftoffs["t"] == pytest.approx(times, abs=10 * tol)
    assert [np.flatnonzero(mask).tolist() for mask in sol.corners["gaps"]] == members
    assert sol.corners["t"] == pytest.approx(corners, abs=tol)
    state = np.array(case["state"], dtype=float)
    assert np.concatenate([sol.q[-1], sol.qdot[-1]]) == pytest.approx(state, abs=30 * tol)
    assert np.flatnonzero(sol.contacts[-1]).tolist() == case["active"]
