"""Mechanical systems against references of 26 digits: lists of events, states, times."""

import numpy as np
import pytest

import zivi
from mechanical_models import MULTI, NDOF, multi_case, ndof_case

pytestmark = pytest.mark.xdist_group("mechanical models")

SETTINGS = [(order, tol) for order in (8, 5) for tol in (1e-6, 1e-9, 1e-12)]
NESTED = {name for name, case in MULTI.items() if any(e[0] == "open" for e in case["events"])}
"""Infinitely many Zeno points: the first few and the corner can be compared."""
FIRST = 3


def run(case, order, tol, **more):
    system, span, state = case
    method = zivi.SwitchedRK(order=order, rtol=tol, atol=tol)
    return zivi.simulate(system, span, state, method=method, **more)


def expected(events, kind):
    """Times and gaps of the events of a kind."""
    found = [(float(e[1]), e[2]) for e in events if e[0] == kind]
    return np.array([t for t, _ in found]), [gaps for _, gaps in found]


@pytest.mark.parametrize(("order", "tol"), SETTINGS)
@pytest.mark.parametrize("name", NDOF)
def test_one_gap(name, order, tol):
    case = NDOF[name]
    sol = run(ndof_case(name), order, tol)
    assert sol.success, sol.message
    for kind, found in (("zeno", sol.zeno["t"]), ("lift", sol.liftoffs["t"])):
        times, _ = expected(case["events"], kind)
        assert len(found) == len(times), kind
        assert found == pytest.approx(times, abs=(50 if kind == "zeno" else 10) * tol)
    state = np.array(case["zT"], dtype=float)
    assert np.concatenate([sol.q[-1], sol.qdot[-1]]) == pytest.approx(state, abs=30 * tol)
    assert bool(sol.contacts[-1, 0]) is (case["mode"] == "C")


@pytest.mark.parametrize(("order", "tol"), SETTINGS)
@pytest.mark.parametrize("name", MULTI)
def test_several_gaps(name, order, tol):
    case = MULTI[name]
    sol = run(multi_case(name), order, tol)
    assert sol.success, sol.message
    times, gaps = expected(case["events"], "zeno")
    n = FIRST if name in NESTED else len(times)
    if name not in NESTED:
        assert len(sol.zeno) == len(times)
    assert sol.zeno["gap"][:n].tolist() == [gap for (gap,) in gaps[:n]]
    assert sol.zeno["t"][:n] == pytest.approx(times[:n], abs=50 * tol)
    times, gaps = expected(case["events"], "lift")
    assert sol.liftoffs["gap"].tolist() == [gap for (gap,) in gaps]
    assert sol.liftoffs["t"] == pytest.approx(times, abs=10 * tol)
    times, gaps = expected(case["events"], "corner")
    assert [np.flatnonzero(mask).tolist() for mask in sol.corners["gaps"]] == gaps
    # the pendulum's flights before it are off by some tolerances themselves
    allowed = 20 if name == "dpend" else 1
    assert sol.corners["t"] == pytest.approx(times, abs=allowed * tol)
    state = np.array(case["state"], dtype=float)
    assert np.concatenate([sol.q[-1], sol.qdot[-1]]) == pytest.approx(state, abs=30 * tol)
    assert np.flatnonzero(sol.contacts[-1]).tolist() == case["active"]
    # the impacts before the first accumulation
    first = min([float(e[1]) for e in case["events"] if e[0] == "zeno"], default=np.inf)
    hits = [e for e in case["events"] if e[0] == "impact" and float(e[1]) < first]
    hits = hits[: min(3, len(hits))]
    rows = sol.resolved_impacts[
        sol.resolved_impacts["speed_before"] < 0
    ]  # others pass an impulse on
    assert len(rows) >= len(hits)
    for event, row in zip(hits, rows, strict=False):
        assert row["t"] == pytest.approx(float(event[1]), abs=30 * tol)
        assert row["gap"] == event[2][0]
        assert -row["speed_before"] == pytest.approx(float(event[3][0]), abs=30 * tol)
