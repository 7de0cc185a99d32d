"""Siconos as a peer: its steps are true where it is installed, and its absence is no error."""

import subprocess
import sys

import numpy as np
import pytest

from zivi.paper import _siconos_steps, siconos

KAPPA, GRAVITY, H = 0.41, 9.81, 1e-3

needs_siconos = pytest.mark.skipif(
    siconos.interpreter() is None, reason="no Python with siconos.numerics was found"
)


def row_errors(s, v, lambda_s, lambda_v):
    """The natural residual of both rows over the size of their terms."""
    r = 1 - KAPPA * lambda_s * lambda_v
    v_new = v - H * GRAVITY * lambda_s / r
    s_new = s + H * r * v_new
    rows = (lambda_s, s_new / np.abs(s)), (lambda_v, v_new / np.abs(v))
    return [np.maximum(lam - 1, np.minimum(lam + 1, -z)) for lam, z in rows]


@pytest.fixture
def nothing_found(monkeypatch):
    """No interpreter can be started, whatever it is called."""

    def missing(command, **_):
        raise FileNotFoundError(command[0])

    siconos._has_siconos.cache_clear()
    monkeypatch.setenv(siconos.ENVIRONMENT, "/nonexistent/python")
    monkeypatch.setattr(siconos.shutil, "which", lambda name: None)
    monkeypatch.setattr(siconos.subprocess, "run", missing)
    yield
    siconos._has_siconos.cache_clear()


@needs_siconos
@pytest.mark.parametrize("name", siconos.SOLVERS)
def test_away_from_the_wall_and_the_apex_the_signs_stay(name):
    random = np.random.default_rng(1)
    s = random.choice([-1, 1], 50) * random.uniform(0.5, 2, 50)
    v = random.choice([-1, 1], 50) * random.uniform(0.5, 6, 50)
    lambda_s, lambda_v = siconos.solvers(KAPPA, GRAVITY)[f"Siconos {name}"](s, v, H)
    np.testing.assert_array_equal(lambda_s, np.sign(s))
    np.testing.assert_array_equal(lambda_v, np.sign(v))


@needs_siconos
@pytest.mark.parametrize("name", siconos.SOLVERS)
def test_across_the_wall_and_the_apex_the_residual_is_rounding(name):
    # far above the wall at the apex, through the wall, at the wall and hardly moving
    s = np.array([1.0, -0.5, 1e-3, -2e-3, 1e-5])
    v = np.array([2e-3, -1e-3, -4.0, 5.0, 3e-3])
    lambdas = siconos.solvers(KAPPA, GRAVITY)[f"Siconos {name}"](s, v, H)
    assert np.all(np.abs(lambdas) <= 1 + 1e-12)
    assert np.max(np.abs(row_errors(s, v, *lambdas))) < 1e-10


@needs_siconos
@pytest.mark.parametrize("name", siconos.SOLVERS)
def test_no_states(name):
    lambda_s, lambda_v = siconos.solvers(KAPPA, GRAVITY)[f"Siconos {name}"](*np.zeros((2, 0)), H)
    assert len(lambda_s) == len(lambda_v) == 0


def test_the_jacobian_of_the_script_is_that_of_its_map():
    step = _siconos_steps.Step(KAPPA, GRAVITY, 1e-2)
    random = np.random.default_rng(2)
    for _ in range(20):
        step.begin_at(*random.uniform(-1, 1, 2))
        at, J, differences = random.uniform(-1, 1, 2), np.zeros((2, 2)), np.zeros((2, 2))
        step.jacobian(2, at, J)
        for k, shift in enumerate(1e-6 * np.eye(2)):
            above, below = np.zeros(2), np.zeros(2)
            step.compute(2, at + shift, above)
            step.compute(2, at - shift, below)
            differences[:, k] = (above - below) / 2e-6
        np.testing.assert_allclose(J, differences, rtol=1e-7, atol=1e-7)


def test_what_does_not_end_is_not_solved(monkeypatch, tmp_path):
    script = tmp_path / "endless"
    # answers for one state, then hangs; each further run hangs at once
    script.write_text(
        f"#!{sys.executable}\n"
        "import pathlib, struct, sys, time\n"
        "seen = pathlib.Path(__file__).with_suffix('.seen')\n"
        "sys.stdin.buffer.read()\n"
        "if not seen.exists():\n"
        "    seen.touch()\n"
        "    sys.stdout.buffer.write(struct.pack('3d', 1, -1, 7))\n"
        "    sys.stdout.flush()\n"
        "time.sleep(60)\n"
    )
    script.chmod(0o755)
    monkeypatch.setattr(siconos, "TIMEOUT", 0.5)
    states = np.ones((3, 2))
    solved = siconos._solve(str(script), "VI_BOX_QI", states, KAPPA, GRAVITY, H)
    np.testing.assert_array_equal(solved, [[1, -1], [np.nan] * 2, [np.nan] * 2])


@pytest.mark.usefixtures("nothing_found")
def test_without_siconos_there_are_no_solvers():
    assert siconos.interpreter() is None
    assert siconos.solvers(KAPPA, GRAVITY) == {}


def test_an_interpreter_is_tried_once(monkeypatch, nothing_found):
    tried = []

    def fails(command, **_):
        tried.append(command[0])
        return subprocess.CompletedProcess(command, 1)

    monkeypatch.setattr(siconos.subprocess, "run", fails)
    for _ in range(3):
        assert siconos.solvers(KAPPA, GRAVITY) == {}
    assert tried == list(dict.fromkeys(tried))
    assert tried[0] == "/nonexistent/python"
