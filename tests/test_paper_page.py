"""benchmarks/results/paper.md: its tests exist, nothing of the paper is left out."""

import re
from pathlib import Path

import numpy as np
import pytest

import zivi
from references import REFERENCES

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "benchmarks" / "results" / "paper.md").read_text()
METHODS = " ".join((ROOT / "benchmarks" / "results" / "accuracy.md").read_text().split())
SCHEME = " ".join((ROOT / "docs" / "scheme.md").read_text().split())


def test_the_tests_that_it_names_exist():
    python = re.findall(r"`tests/(\w+\.py)(?:::(\w+))?`", PAGE)
    rust = re.findall(r"`([\w/]+\.rs)::(\w+)`", PAGE)
    assert len(python) >= 20
    assert len(rust) >= 6
    for name, test in python:
        text = (ROOT / "tests" / name).read_text()
        assert f"def {test}" in text, (name, test)
    for name, test in rust:
        text = (ROOT / "crates" / "zivi-core" / "tests" / name).read_text()
        assert f"fn {test}(" in text, (name, test)


def test_every_equation_statement_and_figure_is_on_it():
    for first, last in re.findall(r"\((\d+)\)(?:(?:-|, | and )\((\d+)\))?", PAGE):
        assert int(first) <= int(last or first) <= 29
    named = {int(k) for k in re.findall(r"\((\d+)[ab]?\)", PAGE)}
    for first, last in re.findall(r"\((\d+)\)-\((\d+)\)", PAGE):
        named |= set(range(int(first), int(last) + 1))
    assert named == set(range(1, 30))
    for words in ("Lemma 1", "Corollary 1", "Remark 1", "Definition 1"):
        assert words in PAGE
    assert "figures 1 to 4" in PAGE
    assert "figure 5" in PAGE
    assert "figures 6 to 8" in PAGE


def test_what_the_methods_say_of_the_errors_of_the_table():
    """At another step the order is the other one; over the run the scheme is nearer."""
    case = REFERENCES["T1_tab_G1.5"] | {"t_end": 3.7}
    system = zivi.ImpactSystem(zivi.LinearForce(**case["force"]), e=case["e"])
    start = (case["x0"], case["xdot0"])
    exact = zivi.simulate(system, (0, 3.7), start)
    t = np.linspace(0.2, 3.7, 701)

    def errors(method):
        x, _ = zivi.simulate(system, (0, 3.7), start, method)(t)
        off = x - exact(t)[0]
        return abs(off[-1]), np.sqrt(np.mean(off**2))

    pattern = r"`h` = 5e-5 it is (\S+) against (\S+); .*? errors are (\S+) and (\S+) m at 1e-4"
    ((ours, euler, rms, euler_rms),) = re.findall(pattern, METHODS)
    methods = zivi.ThetaGamma, zivi.ExplicitEuler
    for method, printed in zip(methods, (ours, euler), strict=True):
        assert errors(method(5e-5))[0] == pytest.approx(float(printed), rel=0.2)
    for method, printed in zip(methods, (rms, euler_rms), strict=True):
        assert errors(method(1e-4))[1] == pytest.approx(float(printed), rel=0.1)


def test_the_scheme_rests_early_near_one():
    (percent,) = re.findall(r"`e` = 0\.95 rests (\d+) % too early with `h` = 1e-3", SCHEME)
    ball = zivi.ImpactSystem(-9.81, e=0.95)
    exact, scheme = (
        zivi.simulate(ball, (0, 30), (1, 0), method).rest_time
        for method in (zivi.SwitchedRK(), zivi.ThetaGamma(1e-3))
    )
    assert 100 * (1 - scheme / exact) == pytest.approx(float(percent), abs=0.6)
