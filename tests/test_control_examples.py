"""The examples of the controllers run, and their numbers are what the documentation quotes."""

import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]


def example(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


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
    assert np.abs(np.diff(sol.impacts["t"][-100:]) - periodic.PERIOD).max() < 2 * periodic.H
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


def test_nearest_can_lock_out_of_step(periodic):
    assert periodic.statistics(periodic.run("nearest")).largest > 0.4
    assert periodic.statistics(periodic.run("positive")).largest < 1e-3


def test_gains_decide_whether_it_does(periodic):
    assert periodic.out_of_step("positive", periodic.GAINS) == 0
    assert periodic.out_of_step("nearest", periodic.GAINS) == pytest.approx(17, abs=3)
    assert periodic.out_of_step("nearest", periodic.STRONG) == 0


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
    found = resting.statistics(resting.run("positive", sampled=False))
    assert found.liftoffs == resting.PERIODS - resting.CAUGHT
    assert found.error < 1e-15
    assert found.rests == found.rests_ref
    assert found.speed == 0.0


def test_with_e_one_half_it_never_rests_exactly(resting):
    found = resting.statistics(resting.run("positive", 0.5))
    assert found.liftoffs == 0
    assert found.rests == 0.0
    assert found.error < 1e-4


@pytest.mark.parametrize("name", ["periodic_reference", "rest_and_liftoff"])
def test_they_print_and_draw(name, tmp_path, capsys):
    example(name).main(str(tmp_path / "out.png"))
    assert (tmp_path / "out.png").stat().st_size > 1000
    assert "nan" not in capsys.readouterr().out.replace("late nan ms", "")
