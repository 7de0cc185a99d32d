"""The folder that others use without the library: its data, its adapters, what it imports."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
FOLDER = BENCHMARKS / "zeno"
FILES = sorted((FOLDER / "problems").glob("*.json"))
SMALL = {"ball": 1e-8, "table_3g": 1e-9, "hopper": 3e-8}


@pytest.fixture
def zeno(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import zeno.adapters.scipy_restarts
    import zeno.adapters.zivi_switched
    import zeno.problem

    return zeno


def test_every_file_has_what_the_schema_asks(zeno):
    schema = json.loads((FOLDER / "schema.json").read_text())
    assert len(FILES) >= 20
    for path in FILES:
        given = json.loads(path.read_text())
        assert given["id"] == path.stem
        assert set(schema["required"]) <= set(given) <= set(schema["properties"])
        gap_keys = schema["properties"]["gaps"]["items"]
        for gap in given["gaps"]:
            assert set(gap_keys["required"]) <= set(gap) <= set(gap_keys["properties"])
        problem = zeno.problem.load(path.stem)
        q, v = problem.q0, problem.v0
        assert len(problem.mass(0.1, q, v)) == len(problem.force(0.1, q, v)) == problem.n
        for key in ("value", "rate", "curvature"):
            assert len(problem.part(key)(0.1, q, v)) == len(problem.gaps)
        for state in given["truth"]["states"]:
            assert len(state["q"]) == len(state["qdot"]) == problem.n
        assert 14 <= given["truth"]["digits"] <= 28


def test_rates_and_curvatures_are_derivatives_of_the_gaps(zeno):
    h = 1e-4
    for path in FILES:
        problem = zeno.problem.load(path.stem)
        q, v, t = [0.3 + 0.1 * i for i in range(problem.n)], [0.7] * problem.n, 0.2
        g = problem.part("value")
        along = [
            g(t + s * h, [a + s * h * b for a, b in zip(q, v, strict=True)], v) for s in (-1, 0, 1)
        ]
        rows, rates = problem.part("gradient")(t, q, v), problem.part("rate")(t, q, v)
        bends = problem.part("curvature")(t, q, v)
        for i in range(len(problem.gaps)):
            speed = sum(a * b for a, b in zip(rows[i], v, strict=True)) + rates[i]
            below, at, above = (values[i] for values in along)
            assert (above - below) / (2 * h) == pytest.approx(speed, abs=1e-6)
            assert (above - 2 * at + below) / h**2 == pytest.approx(bends[i], rel=1e-4, abs=1e-4)


def test_formulas_are_arithmetic_only(zeno):
    for formula in ("__import__('os')", "x.real", "(lambda: 1)()", "open('x')", "'a'"):
        with pytest.raises(ValueError, match="not allowed"):
            zeno.problem.check(formula)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_zivi_reaches_the_true_motion(zeno, path):
    adapter, problem = zeno.adapters.zivi_switched, zeno.problem.load(path.stem)
    state, times = zeno.problem.errors(problem, adapter.run(problem, 1e-12))
    assert state < 5e-11
    assert times is None or times < 1e-11


@pytest.mark.parametrize("name", SMALL)
def test_scipy_reaches_the_true_motion(zeno, name):
    adapter, problem = zeno.adapters.scipy_restarts, zeno.problem.load(name)
    assert adapter.refuses(problem) is None
    state, times = zeno.problem.errors(problem, adapter.run(problem, 1e-11))
    assert state < SMALL[name]
    assert times < SMALL[name]


def test_an_error_is_seen(zeno):
    problem = zeno.problem.load("ball")
    motion = zeno.adapters.zivi_switched.run(problem, 1e-12)
    motion.states[0][0][0] += 1e-6
    assert zeno.problem.errors(problem, motion)[0] == pytest.approx(1e-6, rel=1e-4)
    motion.states[1] = None
    assert zeno.problem.errors(problem, motion)[0] == float("inf")


def test_only_its_adapter_knows_the_library():
    for path in FOLDER.rglob("*.py"):
        if path.name != "zivi_switched.py":
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, (ast.Import, ast.ImportFrom)):
                    names = [alias.name for alias in node.names]
                    assert "zivi" not in [*names, getattr(node, "module", "")], path


def test_a_tool_that_is_missing_is_left_out_with_a_word(tmp_path):
    (tmp_path / "siconos.py").write_text("raise ImportError('no such tool')")
    script = (
        f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(BENCHMARKS)!r}];"
        "sys.argv = ['worker', 'siconos_moreau', '--problems', 'ball'];"
        "from zeno.worker import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert "missing" in json.loads(done.stdout)
