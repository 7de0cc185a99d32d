"""A few of the branches of `benchmarks/orbit_branches.py`, which follows 50."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
orbit_branches = pytest.importorskip("orbit_branches")
orbit_cuts = pytest.importorskip("orbit_cuts")
orbits_found = pytest.importorskip("orbits_found")


@pytest.mark.slow
def test_random_branches_have_the_multipliers_and_words_of_another_map():
    seen = orbit_branches.campaign(3, seed=1, points=20)
    assert seen.points > 30
    assert seen.worst < 1e-8
    assert seen.off < 1e-9
    assert not seen.other_words
    assert seen.steps <= 3


@pytest.mark.slow
def test_nearly_all_motions_that_runs_settle_on_are_found():
    seen = orbits_found.campaign(60, seed=1)
    assert seen.settled > 40
    assert not seen.missed
    assert not seen.other_states


@pytest.mark.parametrize(
    ("draw", "numbers"), [(orbit_cuts.draw_mass, (6, 39, 40)), (orbit_cuts.draw_mechanism, (9, 43))]
)
def test_orbits_do_not_depend_on_where_the_run_ends(draw, numbers):
    seen = orbit_cuts.campaign(numbers, 1, draw)
    assert seen.systems == len(numbers)
    assert seen.resting
    assert seen.cuts == orbit_cuts.CUTS * len(numbers)
    assert not seen.wrong
