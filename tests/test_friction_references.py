"""Dry friction against references of 26 digits: lists of events and channels, times, states."""

import pickle

import numpy as np
import pytest

import zivi
from friction_problems import CASES, reference
from sticking_tails import Bouncing, Coupled

SETTINGS = [(8, 1e-6), (8, 1e-9), (8, 1e-11), (5, 1e-9)]
MODES = {1: "slip+", -1: "slip-", 0: "stick"}
LONG = ("belt_relax", "belt_stribeck", "belt2", "belt_stop", "coulomb")
"""Errors grow over 20 to 40 s: 100 tolerances, in the others 40."""


def told(sol):
    """Give what happened as the references tell it: sorted times, kinds, gaps and channels.

    A gap without restitution closes in one impact, no accumulation for the references.
    """
    bounces = sol.zeno[np.array(sol.config["e"])[sol.zeno["gap"]] > 0]
    found = [(row["t"], "zeno", int(row["gap"])) for row in bounces]
    found += [(row["t"], "lift", int(row["gap"])) for row in sol.liftoffs]
    found += [(row["t"], "open", int(row["gap"])) for row in sol.openings]
    for row in sol.transitions:
        landing = "land_" if row["before"] == 2 else ""
        found.append((row["t"], landing + MODES[int(row["after"])], int(row["channel"])))
    return sorted(found, key=lambda it: it[0])


def expected(case):
    for event in case["events"]:
        gaps = event["who"] if isinstance(event["who"], list) else [event["who"]]
        for gap in gaps:
            yield float(event["t"]), event["kind"], gap


@pytest.mark.parametrize(("order", "tol"), SETTINGS)
@pytest.mark.parametrize("name", CASES)
def test_the_motion_is_that_of_the_reference(name, order, tol):
    case, (system, span, state) = CASES[name], reference(name)
    method = zivi.SwitchedRK(order=order, rtol=tol, atol=tol)
    sol = zivi.simulate(system, span, state, method=method)
    assert sol.success, sol.message
    allowed = (100 if name in LONG else 40) * tol + 1e-13
    events, true = told(sol), list(expected(case))
    # of the events of one instant, the order is that of the list
    key = lambda it: (round(it[0], 5), it[1], it[2])  # noqa: E731
    assert [it[1:] for it in sorted(events, key=key)] == [it[1:] for it in sorted(true, key=key)]
    times = np.array([it[0] for it in events]), np.array([it[0] for it in true])
    assert np.sort(times[0]) == pytest.approx(np.sort(times[1]), abs=allowed)
    for point in [*case["checkpoints"], case["end"]]:
        there = np.array(point["state"], dtype=float)
        here = sol(float(point["t"])).ravel()
        assert here == pytest.approx(there, abs=allowed), point["t"]
    end = case["end"]
    assert np.flatnonzero(sol.contacts[-1]).tolist() == end["closed"]
    for channel, sigma in end["sigma"].items():
        assert sol.modes[-1, int(channel)] == sigma


@pytest.mark.parametrize("slider", ["none", "joint", "floor"])
def test_tails_that_stick_or_slip_are_the_closed_form(slider):
    for seed in range(10):
        rng = np.random.default_rng([7, seed])
        tol, mass = 10 ** rng.uniform(-11, -6), Bouncing.drawn(rng, slider)
        sol, times, size, zeno = mass.run(tol, np.sort(rng.random(200)))
        assert sol.success
        found, (q, w, work) = sol.resample(times), mass.at(times)
        assert np.abs(found.q - q).max() <= 20 * tol * size
        assert np.abs(found.qdot - w).max() <= 20 * tol * size / zeno
        assert np.abs(found.dissipated - work).max() <= 20 * tol * work.max()


@pytest.mark.parametrize(("slider", "seed"), [("none", 44), ("joint", 41), ("floor", 41)])
def test_the_last_flights_are_no_better_than_the_rounding_of_the_coordinates(slider, seed):
    """At the tightest tolerance the last one that is followed is 1e-5 of the whole time long."""
    rng, tol = np.random.default_rng([7, seed]), 1e-12
    rng.uniform(-11, -6)
    mass = Bouncing.drawn(rng, slider)
    sol, times, size, zeno = mass.run(tol, np.sort(rng.random(200)))
    found, (q, w, work) = sol.resample(times), mass.at(times)
    rounding = 8 * np.finfo(float).eps * zeno / (zeno - sol.resolved_impacts["t"].max())
    assert rounding < 400 * tol
    assert np.abs(found.q - q).max() <= 20 * tol * size
    assert np.abs(found.qdot - w).max() <= (20 * tol + rounding) * size / zeno
    assert np.abs(found.dissipated - work).max() <= (20 * tol + rounding) * work.max()


@pytest.mark.slow
@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("rough", [False, True])
def test_tails_of_coupled_coordinates_are_the_closed_form(rough, bent):
    for seed in range(10):
        rng = np.random.default_rng([11, rough, bent, seed])
        tol = 10 ** rng.uniform(-11, -6)
        errors = Coupled.drawn(rng, rough, bent).errors(tol, np.sort(rng.random(200)))
        assert (errors <= 20).all(), (seed, errors)


def test_a_tail_that_sticks_is_stored_and_sampled_by_its_bits():
    mass = Bouncing.drawn(np.random.default_rng([7, 2]), "none")
    sol, times, *_ = mass.run(1e-9, np.linspace(0, 0.999, 100))
    start = (sol.q[0], sol.qdot[0])
    config = zivi.SwitchedRK(**{k: v for k, v in sol.config["method"].items() if k != "name"})
    sampled = zivi.simulate(mass.system(), (0, sol.t[-1]), start, config, t_eval=times)
    assert np.array_equal(sampled.q, sol(times)[0])
    assert np.array_equal(sampled.qdot, sol(times)[1])
    again = pickle.loads(pickle.dumps(sol))
    assert np.array_equal(again(times), sol(times))
    assert np.array_equal(again.resample(times).dissipated, sampled.dissipated)
