"""The examples of the controllers run, and their numbers are what the documentation quotes."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from example_scripts import example

ROOT = Path(__file__).parents[1]
PAGE = " ".join((ROOT / "benchmarks" / "results" / "loops.md").read_text().split())


@pytest.fixture(scope="module")
def periodic():
    return example("periodic_reference")


@pytest.fixture(scope="module")
def resting():
    return example("rest_and_liftoff")


def test_the_orbit_is_one_of_the_table(periodic):
    # flight from the table back to the table, both in the frame of the floor
    amplitude = periodic.EXCITATION * periodic.GRAVITY / periodic.OMEGA**2
    t0 = periodic.PHASE / periodic.OMEGA
    table = amplitude * math.sin(periodic.OMEGA * t0)
    rise = amplitude * periodic.OMEGA * math.cos(periodic.PHASE)
    up, period = rise + periodic.LAUNCH, periodic.PERIOD
    landed = table + up * period - periodic.GRAVITY * period**2 / 2
    assert landed == pytest.approx(table, abs=1e-12)
    arriving = up - periodic.GRAVITY * period - rise
    assert pytest.approx(-periodic.E * arriving, abs=1e-12) == periodic.LAUNCH


def test_the_reference_stays_on_the_orbit(periodic):
    late, off = periodic.reference_is_the_orbit(periodic.run("positive", periodic.STRONG))
    assert late <= periodic.H + 1e-9
    assert off < 0.02


@pytest.mark.parametrize("branch", ["positive", "nearest"])
def test_the_mass_follows_for_hundreds_of_impacts(periodic, branch):
    sol = periodic.run(branch, periodic.STRONG)
    found = periodic.statistics(sol)
    assert sol.success
    assert found.impacts in (400, 401)
    assert found.largest < 1e-3
    assert found.rms < 1e-4
    assert found.away < 1e-4
    # one impact a period, with it
    assert (
        np.abs(np.diff(sol.resolved_impacts["t"][-100:]) - periodic.PERIOD).max() < 2 * periodic.H
    )
    explicit = periodic.statistics(periodic.run("explicit", periodic.STRONG))
    assert explicit.variation > 20 * found.variation
    assert explicit.away > 4 * found.away


def test_the_mass_may_be_on_the_table_itself(periodic):
    sol = periodic.run("positive", periodic.STRONG, force=periodic.FORCE_REF)
    found = periodic.statistics(sol)
    assert found.impacts == 400
    assert found.largest < 1e-3
    assert found.rms < 1e-4
    # nothing is left to do between the impacts
    since = (sol.t - sol.t[0]) % periodic.PERIOD
    late = (sol.t > 100) & (since > 0.1) & (since < 0.25)
    assert np.abs(sol.u[late]).max() < 0.2


def test_no_start_locks_out_of_step(periodic):
    for branch in periodic.BRANCHES:
        assert periodic.statistics(periodic.run(branch)).largest < 1e-3
        assert periodic.out_of_step(branch, periodic.GAINS) == 0


def test_a_wrong_restitution_costs_millimetres(periodic):
    errors = {e: found["positive"].largest for e, found in periodic.wrong_restitution().items()}
    assert max(errors.values()) < 2.5e-3
    assert errors[0.6] > 2 * errors[0.5]


def test_every_liftoff_is_followed(resting):
    for branch in ("positive", "nearest"):
        found = resting.statistics(resting.run(branch))
        assert found.liftoffs == resting.PERIODS - resting.CAUGHT
        # the reference leaves with the first sample after the exact time
        assert found.late < resting.H
        assert found.error < 2e-4
        assert 0.25 < found.rests < found.rests_ref


def test_the_papers_own_loop_is_exact_on_it(resting):
    found = resting.statistics(resting.run("positive", sampled=False, landing=False))
    assert found.liftoffs == resting.PERIODS - resting.CAUGHT
    assert found.error < 1e-15
    assert found.rests == found.rests_ref
    assert found.speed == 0.0


def test_with_e_one_half_it_lands_too(resting):
    found = resting.statistics(resting.run("positive", 0.5))
    assert found.liftoffs == resting.PERIODS - resting.CAUGHT
    assert found.late < resting.H
    assert found.rests == pytest.approx(0.408, abs=1e-3)
    assert found.error < 1e-4


def test_with_e_one_half_the_papers_law_never_rests_exactly(resting):
    found = resting.statistics(resting.run("positive", 0.5, landing=False))
    assert found.liftoffs == 0
    assert found.rests == 0.0
    assert found.error < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["periodic_reference", "rest_and_liftoff"])
def test_they_print_and_draw(name, tmp_path, capsys):
    example(name).main(str(tmp_path / "out.png"))
    assert (tmp_path / "out.png").stat().st_size > 1000
    assert "nan" not in capsys.readouterr().out.replace("late nan ms", "")


def test_the_page_on_the_periodic_orbit(periodic):
    assert f"all {periodic.STARTS} random starts" in PAGE
    pattern = r"error is (\S+) mm at the right `e`, (\S+) mm at (\S+) and (\S+) mm at (\S+)\."
    ((right, low, e_low, high, e_high),) = re.findall(pattern, PAGE)
    found = {e: 1e3 * row["positive"].largest for e, row in periodic.wrong_restitution().items()}
    for e, printed in ((0.5, right), (float(e_low), low), (float(e_high), high)):
        assert found[e] == pytest.approx(float(printed), rel=0.1)


def test_the_page_on_rest_and_liftoff(resting):
    ((count, late, error),) = re.findall(
        r"all (\d+) lift-offs come within (\S+) ms .*? mass is within (\S+) mm", PAGE
    )
    for e in (1 / 3, 1 / 2):
        found = resting.statistics(resting.run("positive", e))
        assert found.liftoffs == int(count)
        assert 1e3 * found.late <= float(late) + 5e-3
    assert 1e3 * found.error <= float(error)
    shares = re.findall(r"in (0\.\d+) of the time, the reference in (0\.\d+)\.", PAGE)
    assert shares == [(f"{found.rests:.3f}", f"{found.rests_ref:.3f}")]


def test_the_picture_of_the_readme_is_drawn(tmp_path):
    outputs = tmp_path / "tracking.png", tmp_path / "chattering.png"
    example("readme_tracking").main(*map(str, outputs))
    assert all(output.stat().st_size > 1000 for output in outputs)
