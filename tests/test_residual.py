"""Every accepted step put back into the equations of the scheme, written out in NumPy."""

import math

import numpy as np
import pytest

import zivi
from scheme import Steps

MEMBERS = [(t, g) for t in (0.5, 0.55, 0.75, 1.0) for g in (0.5, 1.0)]
FORCES = {
    "gravity": lambda t, x, xdot: -9.81,
    "time": lambda t, x, xdot: -9.81 + 14.7 * math.sin(6.0 * t),
    "spring and damper": zivi.LinearForce(stiffness=40.0, damping=0.4, gravity=2.0),
    "excited": zivi.LinearForce(stiffness=1.0, damping=0.1, amplitude=3.0, omega=2.2),
    "drag": lambda t, x, xdot: -9.81 - 0.2 * xdot * abs(xdot),
    "cubic spring": lambda t, x, xdot: -1.0 - x - 5.0 * x**3,
}
FORCE_TOLERANCE = 1e-12


def run(name, h, theta=1.0, gamma=1.0, e=0.5):
    system = zivi.ImpactSystem(FORCES[name], e=e)
    method = zivi.ThetaGamma(h=h, theta=theta, gamma=gamma)
    sol = zivi.simulate(system, (0, 4), (1.0, 1.0), method=method)
    assert sol.success, sol.message
    return sol, Steps(sol, system, theta=theta, gamma=gamma)


@pytest.mark.parametrize("name", FORCES)
@pytest.mark.parametrize(("theta", "gamma"), MEMBERS)
@pytest.mark.parametrize("h", [0.013, 0.0017])
def test_every_step_solves_the_scheme(name, theta, gamma, h):
    """The force is recomputed at the theta-state, so its tolerance enters the updates, times h.

    The last digits of `s` and `v` allow 1e-14 of the terms, a degenerate case 1e-13; the force is
    consistent to 1e-12 of the largest force (the slope of f over a step adds nothing above that).
    """
    sol, steps = run(name, h, theta, gamma)
    size_s, size_v = steps.scales()
    force_error = FORCE_TOLERANCE * np.abs(steps.f).max() * steps.h / steps.r
    defect_s, defect_v = steps.update_errors()
    assert np.all(defect_v <= 2 * force_error + 2e-13 * size_v)
    assert np.all(defect_s <= 2 * steps.h * force_error + 2e-13 * size_s)
    residual = steps.natural_residual()
    assert residual.max() <= 1e-12
    assert sol.residual[1:].max() <= 1e-13
    assert np.all(np.abs(sol.transformed.lambda_s) <= 1)
    assert np.all(np.abs(sol.transformed.lambda_v) <= 1)


@pytest.mark.parametrize("name", FORCES)
def test_the_force_is_the_one_at_the_end_of_the_step(name):
    """Recovered from the updates, the force of each step is f(t + h, x+, x'+) to 1e-12."""
    _, steps = run(name, 0.01)
    moving = np.abs(steps.ls) == 1
    recovered = ((steps.v1 - steps.v0) * steps.r / steps.h)[moving] * steps.ls[moving]
    rounding = 4e-16 * (np.abs(steps.v0) + np.abs(steps.v1)) * steps.r / steps.h
    allowed = FORCE_TOLERANCE * np.abs(steps.f).max() + rounding[moving]
    assert np.all(np.abs(recovered - steps.f[moving]) <= allowed)
    assert np.count_nonzero(moving) > 50


def test_the_physical_columns_are_the_projection_of_the_lifted_ones():
    sol, _ = run("spring and damper", 0.01)
    system = zivi.ImpactSystem(0.0, e=0.5)
    np.testing.assert_array_equal(sol.x, np.abs(sol.transformed.s))
    sign_s = np.where(
        sol.transformed.s != 0, np.sign(sol.transformed.s), np.sign(sol.transformed.v)
    )
    r = 1 - system.kappa * sign_s * np.sign(sol.transformed.v)
    np.testing.assert_allclose(sol.xdot, r * sol.transformed.v * sign_s, rtol=1e-15)


def test_the_last_step_is_shortened_to_the_end_of_the_span():
    system = zivi.ImpactSystem(FORCES["drag"], e=0.5)
    sol = zivi.simulate(system, (0.1, 1.0), (1, 0), method=zivi.ThetaGamma(h=0.4))
    np.testing.assert_allclose(sol.t, [0.1, 0.5, 0.9, 1.0], rtol=1e-15)
    assert sol.t[-1] == 1.0
    steps = Steps(sol, system)
    assert steps.natural_residual().max() <= 1e-12
    assert steps.update_errors()[0].max() < 1e-12


def test_the_check_can_fail():
    """Negative control: one perturbed sample, multiplier or force is seen."""
    system = zivi.ImpactSystem(FORCES["spring and damper"], e=0.5)
    sol, steps = run("spring and damper", 0.01)
    assert steps.natural_residual().max() < 1e-12
    other = Steps(sol, zivi.ImpactSystem(zivi.LinearForce(stiffness=40.001), e=0.5))
    assert other.update_errors()[1].max() > 1e-6
    sol.transformed.lambda_v[7] *= -1
    assert Steps(sol, system).natural_residual().max() > 1e-3


def test_explicit_steps_satisfy_the_explicit_scheme():
    system = zivi.ImpactSystem(FORCES["drag"], e=0.5)
    sol = zivi.simulate(system, (0, 3), (1, 1), method=zivi.ExplicitEuler(h=0.01))
    s, v, h = sol.transformed.s[:-1], sol.transformed.v[:-1], np.diff(sol.t)
    sign_s, sign_v = np.where(s >= 0, 1.0, -1.0), np.where(v >= 0, 1.0, -1.0)
    r = 1 - system.kappa * sign_s * sign_v
    points = zip(sol.t[:-1], np.abs(s), r * v * sign_s, strict=True)
    force = np.array([system.force(*point) for point in points])
    np.testing.assert_allclose(
        sol.transformed.v[1:], v + h * sign_s * force / r, rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(sol.transformed.s[1:], s + h * r * v, rtol=0, atol=1e-14)
    assert np.all(np.isnan(sol.residual[1:]))
