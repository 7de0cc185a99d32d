"""A force in the state is found with the end of the step, however stiff; otherwise a status."""

import math

import numpy as np
import pytest

import zivi
from scheme import Steps


def run(force, e, h, state, steps=150, **settings):
    system = zivi.ImpactSystem(force, e=e)
    method = zivi.ThetaGamma(h=h, **settings)
    return system, zivi.simulate(system, (0, steps * h), state, method=method)


def random_linear(rng):
    """Stiffness to 1e6, damping to 1e4, a pull to either side, half of them excited."""
    return zivi.LinearForce(
        stiffness=10 ** rng.uniform(-2, 6) * (rng.random() < 0.8),
        damping=10 ** rng.uniform(-2, 4) * (rng.random() < 0.7),
        gravity=rng.uniform(-20, 20),
        amplitude=rng.uniform(0, 50) * (rng.random() < 0.5),
        omega=10 ** rng.uniform(-1, 2),
    )


def test_implicit_euler_solves_every_linear_force():
    rng = np.random.default_rng(4)
    evaluations = []
    for _ in range(500):
        force, e, h = random_linear(rng), rng.uniform(0.02, 1), 10 ** rng.uniform(-5, 0)
        state = rng.uniform(0, 2) * (rng.random() < 0.8), 5 * rng.normal()
        _, sol = run(force, e, h, state)
        assert sol.success, (force, e, h, state, sol.message)
        assert np.nanmax(sol.residual) < 1e-12
        evaluations.append(sol.nfev / sol.n_steps)
    assert np.median(evaluations) < 3
    assert max(evaluations) < 100


# f > 0 while the mass comes down: the sign pattern that solves the frozen force changes with it
APEX = {
    "spring": (zivi.LinearForce(stiffness=9.7, gravity=-13.7), 0.26, 0.134, (0.9887, -0.53)),
    "stiffer": (
        zivi.LinearForce(stiffness=711.46, damping=0.124, gravity=-13.885),
        *(0.37003, 0.0112546, (0.0148320, -0.0364815)),
    ),
    "damper": (
        zivi.LinearForce(damping=5741.5, gravity=-14.442, amplitude=39.158, phase=10.012),
        *(0.48437, 0.25432, (0.268, -0.0031634)),
    ),
    "three solutions": (
        zivi.LinearForce(stiffness=286.74, gravity=-13.893, amplitude=4.3236, phase=951.363),
        *(0.96986, 0.29105, (0.0357101, -0.0564219)),
    ),
    "cancellation": (
        zivi.LinearForce(
            stiffness=515836.65, damping=0.569, gravity=6.4004, amplitude=8.3442, omega=24.188
        ),
        *(0.51101, 0.34578, (0.0, 6.458)),
    ),
}


@pytest.mark.parametrize("name", APEX)
def test_one_step_where_the_pattern_depends_on_the_force(name):
    force, e, h, state = APEX[name]
    system, sol = run(force, e, h, state, steps=1)
    assert sol.success, sol.message
    steps = Steps(sol, system)
    assert steps.natural_residual().max() < 1e-12
    size_s, size_v = steps.scales()
    stiffness = force.stiffness * size_s + force.damping * size_v * steps.r
    # the force is known to 1e-12 and to the rounding of the state that it is taken at
    error = 1e-12 * np.abs(steps.f) + 1e-14 * stiffness
    assert np.all(steps.update_errors()[1] < 4 * h * error / steps.r + 1e-13 * size_v)


NONLINEAR = {
    "cubic spring": lambda a, g: lambda t, x, xdot: -a * x**3 - g,
    "quadratic drag": lambda a, g: lambda t, x, xdot: -a * xdot * abs(xdot) - g,
    "preload": lambda a, g: lambda t, x, xdot: abs(g) - a * x,
    "regularised friction": lambda a, g: lambda t, x, xdot: -a * math.tanh(xdot / 1e-3) - g,
}


@pytest.mark.parametrize("name", NONLINEAR)
def test_implicit_euler_solves_monotone_forces(name):
    """Forces that never grow with x or x': the coupled step has a solution, and it is found."""
    rng = np.random.default_rng(5)
    for _ in range(60):
        a, g = 10 ** rng.uniform(-2, 3), rng.uniform(-20, 20)
        e, h, state = rng.uniform(0.02, 1), 10 ** rng.uniform(-4, 0), (rng.uniform(0, 2), 2.0)
        _, sol = run(NONLINEAR[name](a, g), e, h, state)
        assert sol.success, (a, g, e, h, state, sol.message)
        assert sol.residual.max() < 1e-12


def test_other_members_and_forces_that_grow_end_with_a_status():
    """No solution is promised for theta < 1 or an unstable spring; what was computed is kept."""
    rng = np.random.default_rng(6)
    for _ in range(300):
        force = random_linear(rng)
        if rng.random() < 0.3:
            force = zivi.LinearForce(stiffness=-rng.uniform(1, 50), gravity=force.gravity)
        theta, gamma = rng.choice([0.5, 0.55, 0.75, 1.0]), rng.choice([0.5, 1.0])
        h, state = 10 ** rng.uniform(-4, 0), (rng.uniform(0, 2), 5 * rng.normal())
        _, sol = run(force, rng.uniform(0.02, 1), h, state, theta=theta, gamma=gamma)
        assert sol.status != zivi.Status.STEP_NOT_SOLVED
        assert sol.success == (sol.t[-1] == 150 * h)
        assert np.all(np.isfinite(sol.transformed.s) & np.isfinite(sol.transformed.v))
        assert sol.residual.max() < 1e-12


def test_the_tolerance_follows_a_decaying_motion():
    """After thirty impacts with e = 0.3 the peaks are 1e-16 of the first, and it still bounces."""
    _, sol = run(zivi.LinearForce(stiffness=1.0), 0.3, 1e-3, (1, 0), steps=100_000)
    assert sol.rest_time is None
    assert len(sol.resolved_impacts) == 32
    np.testing.assert_allclose(np.diff(sol.resolved_impacts["t"]), np.pi, atol=2e-3)
    ratio = sol.resolved_impacts["xdot_before"][1:] / sol.resolved_impacts["xdot_before"][:-1]
    np.testing.assert_allclose(ratio, 0.3, rtol=0.01)
