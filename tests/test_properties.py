"""Laws that hold for every run, on random systems."""

from operator import attrgetter

import numpy as np
from hypothesis import given, strategies as st

import zivi

RESTITUTION = st.floats(0.05, 1.0)
STEP = st.floats(1e-3, 0.2)
# whole micrometres: scaling is exact only away from subnormal numbers
DISTANCE = st.integers(0, 5_000_000).map(lambda n: n * 1e-6)
VELOCITY = st.integers(-10_000_000, 10_000_000).map(lambda n: n * 1e-6)
POWER_OF_TWO = st.integers(-20, 20).map(lambda n: 2.0**n)


def simulate(force, e, h, state, *, theta=1.0, gamma=1.0, steps=150):
    system = zivi.ImpactSystem(force, e=e)
    method = zivi.ThetaGamma(h=h, theta=theta, gamma=gamma)
    return zivi.simulate(system, (0, steps * h), state, method=method)


@given(
    e=RESTITUTION,
    h=STEP,
    x0=DISTANCE,
    xdot0=VELOCITY,
    gravity=VELOCITY,
    length=POWER_OF_TWO,
    time=POWER_OF_TWO,
)
def test_scaling_of_length_and_time(e, h, x0, xdot0, gravity, length, time):
    """x -> L x, t -> T t maps runs to runs, to the last bit if L and T are powers of two."""
    speed, pull = length / time, length / time**2
    run = simulate(-gravity, e, h, (x0, xdot0))
    scaled = simulate(-gravity * pull, e, h * time, (x0 * length, xdot0 * speed))
    np.testing.assert_array_equal(scaled.t, run.t * time)
    np.testing.assert_array_equal(scaled.transformed.s, run.transformed.s * length)
    np.testing.assert_array_equal(scaled.transformed.v, run.transformed.v * speed)
    np.testing.assert_array_equal(scaled.transformed.lambda_s, run.transformed.lambda_s)
    np.testing.assert_array_equal(scaled.resolved_impacts["t"], run.resolved_impacts["t"] * time)
    np.testing.assert_array_equal(scaled.zeno_times, run.zeno_times * time)


@given(e=RESTITUTION, h=STEP, x0=DISTANCE, xdot0=VELOCITY, k=st.floats(0, 100), c=st.floats(0, 2))
def test_scaling_with_a_force_in_the_state(e, h, x0, xdot0, k, c):
    """The same with a spring and a damper, within the tolerance of the force."""
    system = {"stiffness": k, "damping": c, "gravity": 3.0}
    run = simulate(zivi.LinearForce(**system), e, h, (x0, xdot0))
    scaled_system = {"stiffness": k / 16, "damping": c / 4, "gravity": 3.0 * 8 / 16}
    scaled = simulate(zivi.LinearForce(**scaled_system), e, 4 * h, (8 * x0, 2 * xdot0))
    np.testing.assert_array_equal(scaled.transformed.s, 8 * run.transformed.s)
    np.testing.assert_array_equal(scaled.transformed.v, 2 * run.transformed.v)


@given(
    e=RESTITUTION,
    h=STEP,
    x0=DISTANCE,
    xdot0=VELOCITY,
    gravity=st.floats(-20, 20),
    k=st.floats(0, 50),
    theta=st.sampled_from([0.5, 0.75, 1.0]),
    gamma=st.sampled_from([0.5, 1.0]),
)
def test_the_wall_is_never_passed(e, h, x0, xdot0, gravity, k, theta, gamma):
    force = zivi.LinearForce(gravity=gravity, stiffness=k)
    sol = simulate(force, e, h, (x0, xdot0), theta=theta, gamma=gamma)
    assert np.all(sol.x >= 0)
    assert np.all(sol.xdot[sol.x == 0] >= 0), "on the wall the velocity is the one after"
    between = sol(np.linspace(sol.t[0], sol.t[-1], 1000))
    assert np.all(between[0] >= 0)


def energy(sol, gravity, k):
    return 0.5 * sol.xdot**2 + gravity * sol.x + 0.5 * k * sol.x**2


def slack(sol, gravity, k):
    """Rounding, and what a force that is off by 1e-12 of the largest one adds in a step."""
    speed = np.maximum(np.abs(sol.xdot[1:]), np.abs(sol.xdot[:-1]))
    x = np.maximum(sol.x[1:], sol.x[:-1])
    error = 4e-12 * np.max(np.abs(gravity) + k * sol.x) * np.diff(sol.t)
    return 1e-11 * (speed**2 + abs(gravity) * x + k * x**2) + error * (speed + error) + 1e-300


@given(
    e=RESTITUTION,
    h=STEP,
    x0=DISTANCE,
    xdot0=VELOCITY,
    gravity=st.floats(0, 20),
    k=st.one_of(st.just(0.0), st.floats(0, 1000)),
)
def test_energy_never_increases_under_attraction(e, h, x0, xdot0, gravity, k):
    """Implicit Euler and a convex potential whose force never points away from the wall."""
    sol = simulate(zivi.LinearForce(gravity=gravity, stiffness=k), e, h, (x0, xdot0))
    rise = np.diff(energy(sol, gravity, k))
    assert np.all(rise <= slack(sol, gravity, k))


@given(
    e=RESTITUTION,
    h=st.floats(1e-3, 0.5),
    x0=st.floats(0, 1),
    xdot0=st.floats(-5, 1),
    push=st.floats(0.1, 20),
    k=st.one_of(st.just(0.0), st.floats(0, 50)),
)
def test_energy_rises_only_at_the_wall_under_repulsion(e, h, x0, xdot0, push, k):
    """Where f > 0 a step that meets the wall may gain 2 h f (|x'| + h f): a first-order error.

    The multiplier of such a step counts the force over the whole step with one sign. All other
    steps lose energy or keep it.
    """
    sol = simulate(zivi.LinearForce(gravity=-push, stiffness=k), e, h, (x0, xdot0))
    rise = np.diff(energy(sol, -push, k))
    meets_wall = sol.transformed.s[1:] * sol.transformed.s[:-1] <= 0
    assert np.all(rise[~meets_wall] <= slack(sol, push, k)[~meets_wall])
    impulse = h * np.maximum(np.abs(push - k * sol.x[1:]), push)
    speed = np.maximum(np.abs(sol.xdot[1:]), np.abs(sol.xdot[:-1]))
    assert np.all(rise <= 2 * impulse * (speed + impulse))


def test_other_members_gain_energy_at_the_apex():
    """Negative control: v keeps its size where R changes."""
    rises = [
        np.diff(energy(simulate(-9.81, 0.1, h, (1, 6), theta=0.75, gamma=0.5), 9.81, 0)).max()
        for h in np.linspace(0.011, 0.013, 20)
    ]
    assert max(rises) > 0.1


@given(
    x=st.floats(0, 1e300),
    xdot=st.floats(-1e300, 1e300),
    kappa=st.floats(0, 0.999),
    branch=st.sampled_from(["positive", "negative"]),
)
def test_lift_then_project_is_the_identity(x, xdot, kappa, branch):
    s, v = zivi.lift(x, xdot, kappa=kappa, branch=branch)
    back = zivi.project(s, v, kappa=kappa)
    if x == 0 and xdot < 0:  # at the wall the velocity after the impact comes back
        xdot *= -(1 - kappa) / (1 + kappa)
    np.testing.assert_allclose(back, (x, xdot), rtol=1e-14, atol=1e-320)
    assert np.sign(s) == (np.sign(x) if branch == "positive" else -np.sign(x))


@given(s=st.floats(-1e100, 1e100), v=st.floats(-1e100, 1e100), e=st.floats(0.01, 1))
def test_both_branches_are_one_state(s, v, e):
    np.testing.assert_array_equal(zivi.project(s, v, e=e), zivi.project(-s, -v, e=e))
    x, xdot = zivi.project(s, v, e=e)
    again = zivi.lift(x, xdot, e=e, branch="positive" if s >= 0 else "negative")
    np.testing.assert_allclose(np.abs(again), np.abs((s, v)), rtol=1e-14, atol=1e-320)


@given(e=RESTITUTION, h=STEP, every=st.integers(1, 9), k=st.floats(0, 10))
def test_reported_times_on_the_grid_are_the_samples(e, h, every, k):
    force = zivi.LinearForce(gravity=9.81, stiffness=k)
    full = simulate(force, e, h, (1, 0))
    system, method = zivi.ImpactSystem(force, e=e), zivi.ThetaGamma(h=h)
    span = (0, 150 * h)
    some = zivi.simulate(system, span, (1, 0), method=method, t_eval=full.t[::every])
    for name in (
        "t",
        "x",
        "xdot",
        "transformed.s",
        "transformed.v",
        "transformed.lambda_s",
        "transformed.lambda_v",
        "residual",
    ):
        np.testing.assert_array_equal(attrgetter(name)(some), attrgetter(name)(full)[::every], name)
    np.testing.assert_array_equal(some.impacts, full.impacts)
    assert some.n_steps == full.n_steps
    np.testing.assert_array_equal(some(full.t), (full.x, full.xdot))


@given(e=RESTITUTION, h=STEP, x0=DISTANCE, xdot0=VELOCITY, split=st.integers(1, 149))
def test_a_run_does_not_know_its_end(e, h, x0, xdot0, split):
    """Non-anticipative: a shorter span gives the same samples."""
    whole = simulate(-9.81, e, h, (x0, xdot0))
    part = simulate(-9.81, e, h, (x0, xdot0), steps=split)
    np.testing.assert_array_equal(part.transformed.s[:split], whole.transformed.s[:split])
    np.testing.assert_allclose(
        part.transformed.s[split], whole.transformed.s[split], rtol=1e-9, atol=1e-9
    )
