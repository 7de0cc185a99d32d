"""The tables that sum up runs and studies on a terminal."""

import dataclasses

import numpy as np
import pytest

import zivi
from inside import files_summary as summary

G = 9.81


def rows(table):
    names, values = ([str(it) for it in column.cells] for column in table.columns)
    return dict(zip(names, values, strict=True))


@pytest.fixture(scope="module")
def sol():
    return zivi.simulate(zivi.ImpactSystem(-G, e=0.5), (0, 3), (1, 0), method=zivi.ThetaGamma(1e-3))


def test_a_run_that_rests():
    told = rows(summary.run_table(zivi.simulate(zivi.ImpactSystem(-G, e=0.5), (0, 3), (1, 0))))
    zeno = pytest.approx(np.sqrt(2 / G) * 3, abs=1e-8)  # t1 (1 + e)/(1 - e)
    assert told["time"] == "0 .. 3 s"
    assert float(told["at rest at the end"].removeprefix("from ").removesuffix(" s")) == zeno
    assert float(told["Zeno points"].removeprefix("1, at ").removesuffix(" s")) == zeno
    assert told["last state"] == "x = 0 m, x' = 0 m/s"


def test_a_run_is_told_from_a_loop(sol):
    assert summary.run_table(sol).title == "Trajectory"


def test_a_run_that_does_not_rest(sol):
    never = dataclasses.replace(sol, rest_time=None, zeno_times=np.empty(0))
    told = rows(summary.run_table(never))
    assert (told["at rest at the end"], told["Zeno points"]) == ("no", "0")


def test_times_are_listed_up_to_a_number(sol):
    for times, said in (
        ([0.5], "1, at 0.5 s"),
        ([0.1, 0.2, 0.3], "3, at 0.1, 0.2, 0.3 s"),
        ([0.1, 0.2, 0.3, 0.4], "4, at 0.1, 0.2, 0.3, ... s"),
    ):
        found = rows(summary.run_table(dataclasses.replace(sol, liftoff_times=np.array(times))))
        assert found["lift-offs"] == said


def test_steps_that_the_solver_left_to_another(sol):
    assert rows(summary.run_table(sol))["steps"] == "3000, 0 more rejected"
    left = dataclasses.replace(sol, failed_steps=np.array([3, 5]))
    told = rows(summary.run_table(left))["steps"]
    assert told == "3000, 0 more rejected, 2 not solved by the chosen solver"


def test_a_closed_loop():
    plant = zivi.ImpactSystem(-G, kappa=0.5)
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, kappa=0.5)
    run = zivi.simulate_closed_loop(
        plant, tracker, (0, 1), (6, 5), y_ref0=(3, 3), force_ref=-19.81, noise=(1e-4, 0), seed=7
    )
    told = rows(summary.run_table(run))
    assert told["final error"] == f"x - x_ref = {run.x[-1] - run.x_ref[-1]:.6g} m"
    assert told["control"] == f"{run.u.min():.6g} .. {run.u.max():.6g} m/s^2"
    assert told["seed of the noise"] == "7"
    quiet = zivi.simulate_closed_loop(
        plant, zivi.TwistingRegulator(30, 25, h=1e-3, kappa=0.5), (0, 1), (6, 5)
    )
    told = rows(summary.run_table(quiet))
    assert told["last position"] == f"x = {quiet.x[-1]:.6g} m"
    assert "seed of the noise" not in told


def test_a_study_with_points_that_fail():
    def half(a):
        if a > 2:
            raise ValueError("too large")
        return {"b": a / 2}

    told = rows(summary.study_table(zivi.sweep(half, {"a": [0.0, 1.0, 2.0, 3.0]})))
    assert told["points"] == "4: a"
    assert (told["completed"], told["failed"], told["missing"]) == ("3", "1", "0")
    assert told["b"] == "0 .. 1"
    assert "too large" in told["point 3"]
