"""Siconos as a peer: its steps are true where it is installed, and its absence is no error."""

import subprocess
import sys

import numpy as np
import pytest

from inside import (
    paper__siconos_steps as _siconos_steps,
    paper_step_solvers as step_solvers,
    paper_tracking_steps as tracking_steps,
)

KAPPA, GRAVITY, H = 0.41, 9.81, 1e-3

needs_siconos = pytest.mark.skipif(
    step_solvers.interpreter() is None, reason="no Python with siconos.numerics was found"
)


def ball_solvers():
    return step_solvers.siconos_solvers("ball", KAPPA, GRAVITY, H)


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

    step_solvers._has_siconos.cache_clear()
    monkeypatch.setenv(step_solvers.ENVIRONMENT, "/nonexistent/python")
    monkeypatch.setattr(step_solvers.shutil, "which", lambda name: None)
    monkeypatch.setattr(step_solvers.subprocess, "run", missing)
    yield
    step_solvers._has_siconos.cache_clear()


@needs_siconos
@pytest.mark.parametrize("name", step_solvers.SOLVERS)
def test_away_from_the_wall_and_the_apex_the_signs_stay(name):
    random = np.random.default_rng(1)
    s = random.choice([-1, 1], 50) * random.uniform(0.5, 2, 50)
    v = random.choice([-1, 1], 50) * random.uniform(0.5, 6, 50)
    states = np.column_stack([s, v])
    found = ball_solvers()[f"Siconos {name}"](states, np.sign(states))
    np.testing.assert_array_equal(found, np.sign(states))


@needs_siconos
@pytest.mark.parametrize("name", step_solvers.SOLVERS)
def test_across_the_wall_and_the_apex_the_residual_is_rounding(name):
    # far above the wall at the apex, through the wall, at the wall and hardly moving
    s = np.array([1.0, -0.5, 1e-3, -2e-3, 1e-5])
    v = np.array([2e-3, -1e-3, -4.0, 5.0, 3e-3])
    states = np.column_stack([s, v])
    lambdas = ball_solvers()[f"Siconos {name}"](states, np.sign(states)).T
    assert np.all(np.abs(lambdas) <= 1 + 1e-12)
    assert np.max(np.abs(row_errors(s, v, *lambdas))) < 1e-10


@needs_siconos
@pytest.mark.parametrize("name", step_solvers.SOLVERS)
def test_no_states(name):
    found = ball_solvers()[f"Siconos {name}"](np.zeros((0, 2)), np.zeros((0, 2)))
    assert found.shape == (0, 2)


@needs_siconos
@pytest.mark.parametrize("name", step_solvers.SOLVERS)
def test_it_solves_steps_of_the_tracker(name):
    states = tracking_steps.random_loop_states(1.0, seed=1, problems=50)
    starts = tracking_steps.signs_of(states)
    # the first again, from where its solve has ended
    states, starts = np.vstack([states[:1], states]), np.vstack([starts[:1], starts])
    starts[1] = np.nan
    found = tracking_steps.loop_solvers()[f"Siconos {name}"](states, starts)
    solved = tracking_steps.loop_residual(states, found) < 1e-9
    assert np.mean(solved) > 0.9
    assert solved[0]
    np.testing.assert_allclose(found[1], found[0], atol=1e-12)


STEPS = [
    (_siconos_steps.BallStep(KAPPA, GRAVITY, 1e-2), 2),
    (_siconos_steps.TrackingStep(30.0, 17.0, 0.5, 0.3, -9.81, -19.81, 1e-2), 4),
]


@pytest.mark.parametrize(("step", "size"), STEPS, ids=["ball", "tracking"])
def test_the_jacobian_of_the_script_is_that_of_its_map(step, size):
    random = np.random.default_rng(2)
    n = step.signs
    for _ in range(20):
        step.begin_at(*random.uniform(-1, 1, size).tolist())
        at, J, differences = random.uniform(-1, 1, n), np.zeros((n, n)), np.zeros((n, n))
        step.jacobian(n, at, J)
        for k, shift in enumerate(1e-6 * np.eye(n)):
            above, below = np.zeros(n), np.zeros(n)
            step.compute(n, at + shift, above)
            step.compute(n, at - shift, below)
            differences[:, k] = (above - below) / 2e-6
        np.testing.assert_allclose(J, differences, rtol=1e-7, atol=1e-7)


def test_what_does_not_end_is_not_solved(monkeypatch, tmp_path):
    script = tmp_path / "endless"
    # answers for one state, then hangs; each further run hangs at once
    script.write_text(
        f"#!{sys.executable}\n"
        "import pathlib, signal, struct, sys\n"
        "seen = pathlib.Path(__file__).with_suffix('.seen')\n"
        "sys.stdin.buffer.read()\n"
        "if not seen.exists():\n"
        "    seen.touch()\n"
        "    sys.stdout.buffer.write(struct.pack('3d', 1, -1, 7))\n"
        "    sys.stdout.flush()\n"
        "signal.pause()\n"
    )
    script.chmod(0o755)
    monkeypatch.setattr(step_solvers, "TIMEOUT", 0.5)
    states = np.ones((3, 2))
    parameters = (KAPPA, GRAVITY, H)
    solved = step_solvers._siconos_solve(
        str(script), "VI_BOX_QI", "ball", parameters, states, states
    )
    np.testing.assert_array_equal(solved, [[1, -1], [np.nan] * 2, [np.nan] * 2])


@pytest.mark.usefixtures("nothing_found")
def test_without_siconos_there_are_no_solvers():
    assert step_solvers.interpreter() is None
    assert ball_solvers() == {}


def test_an_interpreter_is_tried_once(monkeypatch, nothing_found):
    tried = []

    def fails(command, **_):
        tried.append(command[0])
        return subprocess.CompletedProcess(command, 1)

    monkeypatch.setattr(step_solvers.subprocess, "run", fails)
    for _ in range(3):
        assert ball_solvers() == {}
    assert tried == list(dict.fromkeys(tried))
    assert tried[0] == "/nonexistent/python"
