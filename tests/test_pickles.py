"""Results and settings travel by pickle, as between processes of a study."""

from __future__ import annotations

import dataclasses
import functools
import math
import pickle
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zivi
from inside import FORMER, CodimensionTwo, ball_rest_time
from orbit_systems import chain2, listed
from test_api import RESULTS
from zivi import interop

BALL = zivi.ImpactSystem(-9.81, e=0.5)
TABLE = zivi.ImpactSystem(zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-math.pi / 2), e=0.5)
DROP = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1])], e=0.5)
TRACKER = zivi.TwistingTracker(30, 17, h=1e-3, e=0.5)


@functools.cache
def branch() -> zivi.Branch:
    orbit = zivi.periodic_orbit(TABLE, [(0.6, 2.1)])
    return zivi.continue_orbit(orbit, "amplitude", (1.2, 1.6))


@functools.cache
def mechanical_branch() -> Any:
    orbit = zivi.periodic_orbit(chain2(), (["I stop"] * 4, listed("two_dof_four_impacts", "t")))
    return zivi.continue_orbit(orbit, "omega", (0.9, 0.93))


def basins() -> zivi.Basins:
    return zivi.basins(TABLE, [0, 1.0], [0, 1.0], transient=5, keep=4)


def run_function() -> interop.RunFunction:
    return interop.run_function(BALL, (0, 3), (1, 0), ["e"], "zeno_time")


MAKE = {
    "Attractor": lambda: basins().attractors[0],
    "Basins": basins,
    "Batch": lambda: zivi.simulate_batch(BALL, (0, 3), [[1, 0], [2, 0]]),
    "Branch": branch,
    "BranchEvent": lambda: branch().events[0],
    "ClosedLoop": lambda: zivi.simulate_closed_loop(
        BALL, TRACKER, (0, 0.1), (1, 0), y_ref0=(0.5, 0)
    ),
    "ClosedLoopBatch": lambda: zivi.simulate_closed_loop_batch(
        BALL, TRACKER, (0, 0.1), [[1, 0]], y_ref0=(0.5, 0)
    ),
    "Diagram": lambda: zivi.bifurcation_diagram(TABLE, "amplitude", [1.3], transient=10, keep=4),
    "CodimensionTwo": lambda: CodimensionTwo("grazing", np.ones(2), mechanical_branch().orbits[0]),
    "Equilibrium": lambda: zivi.bimatrix(np.eye(2), np.eye(2)),
    "EventCurve": lambda: zivi.continue_curve(
        branch().of_kind("period_doubling")[0], ("amplitude", "e"), ((0, 4), (0.45, 0.55))
    ),
    "Bootstrap": lambda: _fit().bootstrap(3),
    "Fit": lambda: _fit(),
    "Profile": lambda: _fit().profile("e"),
    "GainDesign": lambda: zivi.design_tracker(3, e=0.5, start=(0.01, 0)),
    "ImpactMap": lambda: zivi.impact_map(TABLE),
    "ImpactReturn": lambda: zivi.impact_map(TABLE)([0.6], [2.1]),
    "Lyapunov": lambda: zivi.lyapunov_exponents(TABLE, (0, 90), (0.1, 2)),
    "MechanicalBatch": lambda: zivi.simulate_batch(DROP, (0, 3), ([[1.0], [2.0]], [[0.0], [0.0]])),
    "MechanicalEvent": lambda: mechanical_branch().events[0],
    "MechanicalOrbit": lambda: mechanical_branch().orbits[0],
    "MechanicalBranch": lambda: mechanical_branch(),
    "MechanicalClosedLoop": lambda: resting(),
    "MechanicalLoopBatch": lambda: zivi.simulate_closed_loop_batch(
        DROP,
        zivi.GapTracker(DROP, h=1e-2, gains={"gap0": (30, 17)}),
        (0, 0.3),
        ([[0.1], [0.2]], [[0.0], [0.0]]),
        reference="rest",
    ),
    "MechanicalSensitivity": lambda: zivi.sensitivity(DROP, (0, 2), ([1.0], [0.0])),
    "MechanicalTrajectory": lambda: zivi.simulate(DROP, (0, 3), ([1.0], [0.0])),
    "Observed": lambda: zivi.ImpactObserver(0.5, 1e-3, position_only=True).observe(
        np.arange(20) * 1e-3, np.ones(20), force=-9.81
    ),
    "PeriodicOrbit": lambda: branch().orbits[0],
    "ReferenceSample": lambda: zivi.ReferenceSample(*np.ones((4, 2))),
    "ControlledFunction": lambda: interop.controlled_function(BALL, [0, 1, 2], (1, 0), "force"),
    "RunFunction": run_function,
    "RunPoint": lambda: run_function().evaluate([0.5]),
    "Sensitivity": lambda: zivi.sensitivity(BALL, (0, 3), (1, 0)),
    "SolutionFunction": lambda: _solution(),
    "SolutionPoint": lambda: _solution().evaluate([2.0]),
    "Trajectory": lambda: zivi.simulate(BALL, (0, 3), (1, 0)),
    "VIDerivative": lambda: _solution().evaluate([2.0]).of,
    "VIProgress": lambda: _progress(),
    "VIResult": lambda: zivi.solve_lcp([[1.0]], [-1.0]),
}


def _fit() -> zivi.Fit:
    return zivi.fit(BALL, zivi.Bounces([0.45, 0.91, 1.13], 1e-2), "e", y0=(1, 0), starts=1)


def _line(x: Any, p: Any) -> Any:
    return x - p


def _slope(x: Any, p: Any) -> Any:
    return np.eye(1)


def _solution() -> Any:
    return zivi.interop.solution_function(_line, 0, None, [1.0], "p", jac=_slope)


def resting() -> zivi.MechanicalClosedLoop:
    tracker = zivi.GapTracker(DROP, h=1e-2, gains={"gap0": (30, 17)})
    return zivi.simulate_closed_loop(DROP, tracker, (0, 0.5), ([0.1], [0.0]), reference="rest")


def _progress() -> Any:
    seen: list[Any] = []
    zivi.solve_vi(lambda x: x**3 - 1, [0.0], [5.0], [3.0], callback=seen.append)
    return seen[0]


def numbers(thing: Any, depth: int = 3) -> list[Any]:
    """All arrays and numbers in the fields of a result, and in what these hold."""
    if isinstance(thing, np.ndarray | float | int | str | tuple) and not hasattr(thing, "_fields"):
        return [thing]
    fields = getattr(thing, "_fields", None)
    if dataclasses.is_dataclass(thing):
        fields = [it.name for it in dataclasses.fields(thing) if not it.name.startswith("_")]
    if fields is None or depth == 0:
        return []
    return [it for name in fields for it in numbers(getattr(thing, name), depth - 1)]


@pytest.mark.parametrize("name", sorted(MAKE))
def test_results_travel(name):
    thing = MAKE[name]()
    assert type(thing).__name__ == name
    for protocol in (2, pickle.HIGHEST_PROTOCOL):
        other = pickle.loads(pickle.dumps(thing, protocol))
        assert type(other) is type(thing)
        assert repr(other) == repr(thing)
        for one, two in zip(numbers(thing), numbers(other), strict=True):
            if isinstance(one, np.ndarray) or not isinstance(one, tuple):
                np.testing.assert_array_equal(one, two)


def test_no_result_is_forgotten():
    assert set(MAKE) >= RESULTS


@pytest.mark.parametrize("build", ["arrays", "names", "lambda"])
def test_derivatives_of_mechanical_systems_go_on_after_their_travel(build):
    if build == "arrays":
        system: zivi.MechanicalSystem = DROP
    elif build == "names":
        system = zivi.ParametricSystem(dropping, {"weight": 9.81})
    else:
        system = zivi.MechanicalSystem(
            mass=1.0, force=lambda t, q, v: [-9.81], gaps=[zivi.LinearGap([1])], e=0.5
        )
    wrt = ("q0", "weight") if build == "names" else ("q0",)
    s = zivi.sensitivity(system, (0, 1.0), ([1.0], [0.0]), wrt)
    other = pickle.loads(pickle.dumps(s))
    np.testing.assert_array_equal(other.final, s.final)
    assert other.nearest == s.nearest
    if build == "lambda":
        # what cannot travel is missed when it is asked for, and only then
        with pytest.raises(ValueError, match="functions of this system could not be stored"):
            other(0.3)
        return
    np.testing.assert_array_equal(other([0.3, 0.7]), s([0.3, 0.7]))
    np.testing.assert_array_equal(other.monodromy, s.monodromy)


def dropping(weight: float) -> zivi.MechanicalSystem:
    return zivi.MechanicalSystem(mass=1.0, force=[-weight], gaps=[zivi.LinearGap([1])], e=0.5)


def one(a: float) -> dict[str, float]:
    """A study's point."""
    return {"b": a}


def terminal(count: int) -> Any:
    """An event that ends a run."""

    def event(t: float, q: Any, v: Any) -> float:
        return float(np.ravel(q)[0]) - 0.5

    event.terminal = count  # type: ignore[attr-defined]
    return event


SOL = zivi.simulate(BALL, (0, 3), (1, 0))
INTEGERS = {
    "linearisations": lambda n: zivi.ThetaGamma(0.1, linearisations=n),
    "max_steps": lambda n: zivi.SwitchedRK(max_steps=n),
    "max_impacts": lambda n: zivi.SwitchedRK(max_impacts=n),
    "order": lambda n: zivi.SwitchedRK(order=n),
    "threads": lambda n: zivi.simulate_batch(BALL, (0, 3), [[1, 0]], threads=n),
    "save": lambda n: zivi.simulate_batch(BALL, (0, 3), [[1, 0]], save=n),
    "n": lambda n: SOL.resample(n=n),
    "limit": lambda n: SOL.impacts_down_to(1e-3, limit=n),
    "delay": lambda n: zivi.design_tracker(3, e=0.5, start=(0.01, 0), delay=n),
    "ahead": lambda n: zivi.TwistingTracker(30, 17, h=1e-3, e=0.5, ahead=n),
    "multiple": lambda n: zivi.periodic_orbit(TABLE, [(0.6, 2.1)], n),
    "max_iter": lambda n: zivi.periodic_orbit(TABLE, [(0.6, 2.1)], max_iter=n),
    "max_points": lambda n: zivi.continue_orbit(branch().orbits[0], "e", (0.4, 0.6), max_points=n),
    "transient": lambda n: zivi.basins(TABLE, [0.0], [1.0], transient=n),
    "keep": lambda n: zivi.bifurcation_diagram(TABLE, "amplitude", [1.3], keep=n),
    "number": lambda n: interop.run_function(BALL, (0, 3), (1, 0), ["e"], "zeno_time", n),
    "seed": lambda n: zivi.sweep(one, zivi.grid(a=[1.0]), seed=n),
    "chunk": lambda n: zivi.sweep(one, zivi.grid(a=[1.0]), chunk=n),
    "terminal": lambda n: zivi.simulate(DROP, (0, 1), ([1.0], [0.0]), events=terminal(n)),
    "max_iter ": lambda n: zivi.solve_lcp([[1.0]], [-1.0], max_iter=n),
    "max_pivots": lambda n: zivi.solve_lcp([[1.0]], [-1.0], options=zivi.VIOptions(max_pivots=n)),
    "memory": lambda n: zivi.solve_lcp([[1.0]], [-1.0], options=zivi.VIOptions(memory=n)),
    "restarts": lambda n: zivi.solve_lcp([[1.0]], [-1.0], options=zivi.VIOptions(restarts=n)),
}
SIZES = {"2^63": 2**63, "2^64": 2**64, "2^200": 2**200, "-2^64": -(2**64)}


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", INTEGERS)
def test_integers_beyond_64_bits_are_refused_by_name(name, size):
    if name == "seed" and SIZES[size] > 0:
        return  # any is one
    with pytest.raises((ValueError, TypeError), match=name.strip()):
        INTEGERS[name](SIZES[size])


def test_modules_under_former_names_travel():
    cloudpickle = pytest.importorskip("cloudpickle")
    for former in FORMER:
        module = sys.modules[f"zivi.{former}"]
        assert pickle.loads(cloudpickle.dumps(module)) is module


KEPT = Path(__file__).parent / "data" / "version_0_2.zip"


def kept(ending: str) -> list[str]:
    return [name for name in zipfile.ZipFile(KEPT).namelist() if name.endswith(ending)]


@pytest.mark.parametrize("name", kept(".pickle"))
def test_pickles_of_the_last_version_are_read(name: str) -> None:
    value = pickle.loads(zipfile.ZipFile(KEPT).read(name))
    assert repr(value)
    assert repr(pickle.loads(pickle.dumps(value))) == repr(value)


@pytest.mark.parametrize("name", kept(".nc"))
def test_files_of_the_last_version_are_read(name: str, tmp_path: Any) -> None:
    archive = zipfile.ZipFile(KEPT)
    run = zivi.files.load(archive.extract(name, tmp_path))
    pickled = pickle.loads(archive.read(name.replace(".nc", ".pickle")))
    assert repr(run) == repr(pickled)
    times = np.linspace(run.t[0], run.t[-1], 50)
    for one, other in zip(run(times), pickled(times), strict=True):
        assert np.array_equal(one, other, equal_nan=True)


def test_a_study_of_the_last_version_goes_on(tmp_path: Any) -> None:
    archive = zipfile.ZipFile(KEPT)
    archive.extractall(tmp_path, kept("/zarr.json") + kept("/0"))
    folder = tmp_path / "study"
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    study = zivi.sweep(ball_rest_time, {"e": [0.3, 0.5]}, out=folder, progress=False)
    assert np.max(np.abs(study.rest_time - study.exact)) < 1e-12
    assert before == {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


ORBITS = Path(__file__).parent / "data" / "orbits_0_2.zip"
"""Orbits of one mass as version 0.2 pickled them: rows of impacts instead of words."""


def kept_orbit(name):
    return pickle.loads(zipfile.ZipFile(ORBITS).read(f"{name}.pickle"))


@pytest.mark.parametrize("name", ["resting", "free", "flight", "doubled", "plastic"])
def test_orbits_of_one_mass_that_a_version_pickled_are_found_again(name):
    orbit = kept_orbit(name)
    again = zivi.periodic_orbit(orbit.system, orbit)
    assert again.status is orbit.status is zivi.OrbitStatus.COMPLETED
    assert (again.kind, again.multiple) == (orbit.kind, orbit.multiple)
    assert again.period == pytest.approx(orbit.period, rel=1e-10)
    for field in ("t", "u"):
        count = len(orbit.impacts)
        assert again.impacts[field][:count] == pytest.approx(orbit.impacts[field], abs=1e-9)
    assert np.abs(again.multipliers) == pytest.approx(np.abs(orbit.multipliers), abs=1e-7)
    parameter = "damping" if name == "free" else "amplitude"
    if name != "flight":
        slope = again.derivative(parameter)
        assert orbit.derivative(parameter) == pytest.approx(slope, rel=1e-6, abs=1e-9)
    run = orbit.trajectory
    assert run.t[-1] - run.t[0] == pytest.approx(orbit.multiple * orbit.period)
    value = getattr(orbit.system.force, parameter)
    branch = zivi.continue_orbit(orbit, parameter, (value - 0.01, value + 0.01), max_points=6)
    assert len(branch) > 1
    assert pickle.loads(pickle.dumps(orbit)).impacts.tolist() == orbit.impacts.tolist()


def test_other_results_of_one_mass_that_a_version_pickled():
    assert kept_orbit("still").status is zivi.OrbitStatus.RESTS
    assert not kept_orbit("still").trajectory.x.any()
    assert kept_orbit("lost").status is zivi.OrbitStatus.NOT_CONVERGED
    branch = kept_orbit("resting_branch")
    (end,) = branch.of_kind("end_of_rest")
    assert branch.switch(end).kind == "impacting"
    assert zivi.continue_orbit(branch.orbits[0], "amplitude", (1.2, 1.3)).values[-1] > 1.25
    curve = kept_orbit("rest_curve")
    assert curve.kind == "end_of_rest"
    assert len(curve) > 1
