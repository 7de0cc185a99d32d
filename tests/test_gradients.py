"""Derivatives of runs in SciPy's optimisers and in JAX."""

from __future__ import annotations

import importlib.util
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import zivi
from zivi import interop

BALL = zivi.ImpactSystem(zivi.LinearForce(stiffness=1.0, damping=0.1, gravity=2.0), e=0.5)
NAMES = ("x0", "e", "damping")
POINT = np.array([1.0, 0.5, 0.1])


def zeno(p: np.ndarray) -> float:
    """The Zeno time by a plain run."""
    force = zivi.LinearForce(stiffness=1.0, damping=p[2], gravity=2.0)
    run = zivi.simulate(
        zivi.ImpactSystem(force, e=p[1]), (0, 20), (p[0], 0), zivi.SwitchedRK(1e-12, 1e-13)
    )
    return float(run.zeno_times[0])


def differences(function, p: np.ndarray, h: float = 1e-4) -> np.ndarray:
    """Central differences of fourth order."""
    rows = []
    for i in range(len(p)):
        step = np.eye(len(p))[i] * h
        near, far = (function(p + k * step) - function(p - k * step) for k in (1, 2))
        rows.append((8 * near - far) / (12 * h))
    return np.array(rows)


@pytest.mark.parametrize("output", ["zeno_time", "impact_time", "impact_speed", "final"])
def test_values_and_derivatives(output):
    f = interop.run_function(BALL, (0, 3.3), (1, 0), NAMES, output, method=zivi.SwitchedRK(1e-11))
    value, derivative = f(POINT)
    assert np.shape(value) == f.shape
    exact = differences(lambda p: np.asarray(f(p)[0]), POINT)
    np.testing.assert_allclose(derivative, np.moveaxis(exact, 0, -1), rtol=1e-6, atol=1e-8)
    if output == "zeno_time":
        assert abs(value - zeno(POINT)) < 1e-8


def test_an_event_that_there_is_not_is_nan():
    value, derivative = interop.run_function(BALL, (0, 0.1), (1, 0), ("e",), "zeno_time")([0.5])
    assert math.isnan(value)
    assert np.isnan(derivative).all()


def test_scipy_finds_the_restitution_of_a_settling_time():
    optimize = pytest.importorskip("scipy.optimize")
    f = interop.run_function(BALL, (0, 30), (1, 0), ("e", "x0"), "zeno_time")
    wanted = f([0.62, 1.3])[0]

    def miss(p):
        value, derivative = f(p)
        return (value - wanted) ** 2, 2 * (value - wanted) * derivative

    found = optimize.minimize(
        lambda e: (miss([e[0], 1.3])[0], miss([e[0], 1.3])[1][:1]),
        [0.4],
        jac=True,
        method="L-BFGS-B",
        bounds=[(0.05, 0.9)],
        options={"ftol": 1e-16},
    )
    assert abs(found.x[0] - 0.62) < 1e-6


def in_jax():
    """Check runs in programs of JAX, which is to be alone in its process: it has threads."""
    import jax

    with jax.enable_x64(True):
        rest = interop.run_function(BALL, (0, 20), (1, 0), NAMES, "zeno_time")
        f = interop.jax_function(rest)

        # a JAX program around the run: chain rule on both sides
        def program(q):
            return jax.numpy.sin(f(q * jax.numpy.array([1.0, 0.5, 0.1])))

        by_q = np.asarray(jax.grad(program)(jax.numpy.ones(3)))
        exact = differences(lambda q: math.sin(zeno(q * POINT)), np.ones(3))
        np.testing.assert_allclose(by_q, exact, rtol=1e-7, atol=1e-9)
        forward = np.asarray(jax.jacfwd(program)(jax.numpy.ones(3)))
        np.testing.assert_allclose(forward, by_q, rtol=1e-12)
        compiled = jax.jit(jax.vmap(program))(jax.numpy.ones((2, 3)))
        np.testing.assert_allclose(compiled, math.sin(zeno(POINT)), rtol=1e-8)
        end = interop.jax_function(interop.run_function(BALL, (0, 1.5), (1, 0), NAMES))
        assert jax.jacobian(end)(jax.numpy.asarray(POINT)).shape == (2, 3)
        with pytest.raises(ValueError, match="shape"):
            f(jax.numpy.ones(2))


@pytest.mark.slow
def test_jax_differentiates_through_a_run():
    if importlib.util.find_spec("jax") is None:
        pytest.skip("jax is not installed: it comes with the extra jax")
    done = subprocess.run(
        [sys.executable, "-c", "import test_gradients; test_gradients.in_jax()"],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]


def test_bad_input():
    with pytest.raises(ValueError, match="output must be one of"):
        interop.run_function(BALL, (0, 3), (1, 0), NAMES, "energy")
    with pytest.raises(ValueError, match="'mass'"):
        interop.run_function(BALL, (0, 3), (1, 0), ("mass",))
    with pytest.raises(TypeError, match="RunFunction"):
        interop.jax_function(math.sin)
