"""Evaluations of SwitchedRK beside SciPy's event script: counts, the same in every run."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("scipy")

sys.path.append(str(Path(__file__).resolve().parent.parent / "benchmarks"))

import methods_counts
import methods_problems
import scipy_events

PROBLEMS = methods_problems.problems()
WITH_ZENO, WITHOUT = PROBLEMS["T1"], PROBLEMS["T4"]
DECADES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)


def both(problem, tol, **settings):
    ours = methods_counts.with_zivi(problem, 8, tol, **settings)
    return ours, methods_counts.with_scipy(problem, tol, **settings)


@pytest.mark.parametrize("dense", [False, True])
def test_past_zeno_points_half_of_scipys_evaluations_do(dense):
    ours, theirs = both(WITH_ZENO, 1e-6, dense=dense)
    assert ours.nfev <= 0.5 * theirs.nfev
    assert ours.error <= 1.1 * theirs.error < 1e-5


@pytest.mark.parametrize("dense", [False, True])
def test_without_a_zeno_point_scipys_evaluations_do(dense):
    # the mean over tolerances: at a single one either side may be lucky with its steps
    runs = [both(WITHOUT, tol, dense=dense) for tol in DECADES]
    ours, theirs = zip(*runs, strict=True)
    assert methods_counts.at_equal_tolerance(ours, theirs).mean <= 1.1
    assert ours[-1].error <= theirs[-1].error < 1e-12


def test_the_script_finds_every_impact_of_the_periodic_motion():
    assert scipy_events.follow(WITHOUT, 1e-6).impacts == 8


@pytest.mark.parametrize("key", PROBLEMS)
def test_both_end_where_the_reference_does(key):
    ours, theirs = both(PROBLEMS[key], 1e-8)
    assert ours.error < 1e-7
    assert theirs.error < 1e-7


def test_the_closed_form_of_the_periodic_motion_repeats_itself():
    turns = [methods_problems.period_one(n + 0.25).end for n in (1, 4)]
    assert turns[0] == turns[1]
    nearly = methods_problems.period_one(1.0 - 1e-12)
    assert nearly.end[0] == pytest.approx(0.0, abs=1e-10)
    assert -nearly.e * nearly.end[1] == pytest.approx(nearly.state[1], abs=1e-10)


@pytest.mark.parametrize(
    ("carelessness", "floor"),
    [
        ({}, None),
        ({"direction": 0.0}, None),
        ({"put_on_wall": False}, -1.0),
        ({"direction": 0.0, "put_on_wall": False}, -1.0),
        ({"terminal": False}, -1.0),
    ],
)
def test_a_script_without_a_precaution_is_stuck_or_falls_through_the_floor(carelessness, floor):
    fate = scipy_events.careless(PROBLEMS["B1"], 1e-10, most=100, **carelessness)
    if floor is None:
        assert fate.standing > 50
        assert not fate.finished
    else:
        assert fate.finished
        assert fate.x < floor
