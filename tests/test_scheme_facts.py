"""The example that measures the family of schemes, at reduced size, and the claims made of it."""

import csv
import importlib.util
import math
import sys
from pathlib import Path

import pytest

from closed_form import Ball

EXAMPLE = Path(__file__).parents[1] / "examples" / "scheme_facts.py"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("scheme_facts", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "scheme_facts", module)
        spec.loader.exec_module(module)
        yield module


@pytest.fixture(scope="module")
def facts(example, tmp_path_factory):
    out = tmp_path_factory.mktemp("facts") / "facts.csv"
    rows = example.main(["--levels", "3", "--out", str(out)])
    with out.open() as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 3 * len(rows) == 24
    assert float(lines[-1]["theta"]) == float(lines[-1]["gamma"]) == 1.0
    return {(row.theta, row.gamma): row for row in rows}


def test_its_exact_solution_is_the_ball(example):
    ball = Ball.of_kappa(1.0, 6.0, kappa=0.41)
    for t in (0.0, 0.5, 1.0, 1.5, 2.1, 2.4, 2.6):
        assert example.exact_distance(t) == pytest.approx(ball.state(t)[0], abs=1e-14)


def test_implicit_euler_always_rests_exactly(facts):
    assert facts[1.0, 1.0].at_rest == [7, 7, 7]
    assert facts[1.0, 1.0].chatter == [0.0, 0.0, 0.0]


def test_no_other_member_always_rests(facts):
    for member, row in facts.items():
        if member != (1.0, 1.0):
            assert sum(row.at_rest) < 21, member


@pytest.mark.parametrize("member", [(0.5, 0.5), (0.55, 0.5), (0.75, 0.5), (1.0, 0.5), (0.5, 1.0)])
def test_these_chatter_in_proportion_to_the_step(facts, member):
    """Two decades of h: the slope over them lies within what 7 runs scatter."""
    coarse, *_, fine = facts[member].chatter
    assert 0.6 < math.log(coarse / fine) / math.log(100) < 1.4
    assert fine > 1e-6
    if member[1] == 0.5:
        assert facts[member].at_rest == [0, 0, 0]


@pytest.mark.parametrize("theta", [0.55, 0.75])
def test_these_decay_without_resting(facts, theta):
    row = facts[theta, 1.0]
    assert row.chatter[0] < 1e-6
    assert max(row.chatter[1:]) < 1e-60
    assert row.chatter[0] > 0


def test_only_the_midpoint_is_exact_before_the_apex_and_none_after(facts):
    for (theta, _), row in facts.items():
        before, after_apex, *after_impacts = row.orders
        assert math.isnan(before) if theta == 0.5 else before == pytest.approx(1.0, abs=0.05)
        assert after_apex == pytest.approx(1.0, abs=0.15)
        assert after_impacts[:2] == pytest.approx([1.0, 1.0], abs=0.25)
