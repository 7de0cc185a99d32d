"""Derivatives of runs in SciPy's optimisers and in JAX."""

from __future__ import annotations

import math

import numpy as np
import pytest

import zivi
from interrupting import in_own_process
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


STATUS = zivi.OrbitStatus


@pytest.mark.parametrize(
    ("p", "status", "says"),
    [
        ([1.0, 0.5, 1.2], STATUS.OUT_OF_DOMAIN, "e must lie in"),
        ([-1.0, 0.5, 0.5], STATUS.OUT_OF_DOMAIN, "x0 must be"),
        ([1.0, math.nan, 0.5], STATUS.OUT_OF_DOMAIN, "xdot0"),
        ([1.0, 0.5, 0.999], STATUS.NO_EVENT, "zeno time number 0"),
    ],
)
def test_where_there_is_no_result(p, status, says):
    arguments = (zivi.ImpactSystem(-9.81, e=0.5), (0, 9), (1, 0), ("x0", "xdot0", "e"), "zeno_time")
    found = interop.run_function(*arguments).evaluate(p)
    assert (found.value, found.status) == (math.inf, status)
    assert says in found.message
    assert np.isnan(found.derivative).all()
    assert found.derivative.shape == (3,)
    value, derivative = interop.run_function(*arguments, outside="nan")(p)
    assert math.isnan(value)
    assert np.isnan(derivative).all()
    with pytest.raises(ValueError, match=says):
        interop.run_function(*arguments, outside="raise")(p)


def test_a_run_that_ends_early_has_no_final_state_but_the_events_before():
    method = zivi.SwitchedRK(max_impacts=3)
    ball = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, stiffness=0.1), e=0.9)
    ends = interop.run_function(ball, (0, 3), (1, 0), ("e",), method=method)
    found = ends.evaluate([0.9])
    assert found.status is STATUS.RUN_ENDED
    assert np.isposinf(found.value).all()
    assert found.value.shape == (2,)
    first = interop.run_function(ball, (0, 3), (1, 0), ("e",), "impact_speed", method=method)
    assert first([0.9])[0] == pytest.approx(0.9 * math.sqrt(2 * 9.81 + 0.1))
    last = interop.run_function(ball, (0, 3), (1, 0), ("e",), "zeno_time", method=method)
    assert last.evaluate([0.9]).status is STATUS.RUN_ENDED


def test_a_force_without_a_value_is_out_of_the_domain():
    force = zivi.ParametricForce(lambda t, x, v, k: -math.sqrt(k), {"k": 4.0})
    f = interop.run_function(zivi.ImpactSystem(force, e=0.5), (0, 9), (1, 0), ("k",), "zeno_time")
    # x0 = 1, g = sqrt(k): t = 3 sqrt(2/g)
    assert f([4.0])[0] == pytest.approx(3.0)
    found = f.evaluate([-4.0])
    assert found.status is STATUS.OUT_OF_DOMAIN
    assert math.isinf(found.value)


@pytest.mark.parametrize("start", [0.3, 0.8, 0.97])
def test_optimisers_whose_line_search_leaves_the_domain_converge(start):
    optimize = pytest.importorskip("scipy.optimize")
    ball, e = zivi.ImpactSystem(-9.81, e=0.5), 0.95
    wanted = math.sqrt(2 / 9.81) * (1 + e) / (1 - e)
    f = interop.run_function(ball, (0, 200), (1, 0), ("e",), "zeno_time")
    outside = []

    def miss(p):
        value, derivative = f(p)
        outside.append(not math.isfinite(value))
        return (value - wanted) ** 2, 2 * (value - wanted) * derivative

    found = optimize.minimize(miss, [start], jac=True, method="BFGS")
    assert found.success
    assert abs(found.x[0] - e) < 1e-7
    assert any(outside)
    other = optimize.least_squares(lambda p: f.fun(p) - wanted, [start], jac=f.jac)
    assert other.success
    assert abs(other.x[0] - e) < 1e-7


def test_parameters_from_measured_positions():
    # more times than parameters, through the impacts; the first guess is off by 10 %
    optimize = pytest.importorskip("scipy.optimize")
    times = np.linspace(0.05, 1.2, 40)
    arguments = (BALL, (0, 1.5), (1, 0), NAMES)
    f = interop.run_function(*arguments, "positions", times=times)
    true = np.array([1.1, 0.55, 0.12])
    seen = f.fun(true)
    assert f.shape == seen.shape == (40,)
    assert f.jac(true).shape == (40, 3)
    fall = 1.0 - 2.0 * times[:5] ** 2 / 2  # early, without spring and damper
    free = interop.run_function(
        zivi.ImpactSystem(-2.0, e=0.5), (0, 1.5), (1, 0), ("x0",), "positions", times=times[:5]
    )
    np.testing.assert_allclose(free.fun([1.0]), fall, rtol=1e-12)
    found = optimize.least_squares(lambda p: f.fun(p) - seen, 0.9 * true, jac=f.jac)
    assert found.success
    np.testing.assert_allclose(found.x, true, atol=1e-6)


@pytest.mark.parametrize("output", ["positions", "velocities"])
def test_samples_have_the_derivatives_of_differences(output):
    times = np.array([0.3, 0.9, 1.15, 1.7])
    method = zivi.SwitchedRK(1e-11, 1e-12)
    f = interop.run_function(BALL, (0, 3), (1, 0), NAMES, output, times=times, method=method)
    value, derivative = f(POINT)
    exact = differences(lambda p: f(p)[0], POINT)
    np.testing.assert_allclose(derivative, exact.T, rtol=1e-6, atol=1e-7)
    force = zivi.LinearForce(stiffness=1.0, damping=0.1, gravity=2.0)
    run = zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 3), (1, 0), method)
    of = 0 if output == "positions" else 1
    np.testing.assert_allclose(value, run(times)[of], rtol=1e-9, atol=1e-10)
    s = zivi.sensitivity(BALL, (0, 3), (1, 0), NAMES, method)
    np.testing.assert_allclose(s.jacobian(times, ("position", "velocity")[of]), derivative)
    np.testing.assert_array_equal(s.jacobian(times), s(times)[0].T)


def test_one_run_gives_value_and_derivative(monkeypatch):
    from inside import interop_gradient as gradient

    runs = []
    original = gradient.sensitivity
    monkeypatch.setattr(
        gradient, "sensitivity", lambda *a, **k: runs.append(1) or original(*a, **k)
    )
    f = interop.run_function(BALL, (0, 20), (1, 0), NAMES, "zeno_time")
    f.fun(POINT)
    first = f.jac(POINT)
    first[:] = 0.0  # an optimiser may write into what it got
    assert f.jac(POINT).all()
    assert len(runs) == 1
    f.fun(POINT + 0.01)
    assert len(runs) == 2


def box(**other: float) -> zivi.MechanicalSystem:
    """A mass that falls on a floor while a force pushes it to a wall."""
    values = {"mass": 2.0, "push": 3.0} | other

    def build(mass: float, push: float) -> zivi.MechanicalSystem:
        return zivi.MechanicalSystem(
            mass=mass * np.eye(2),
            force=[push, -9.81 * mass],
            gaps=[zivi.LinearGap([0, 1], name="floor"), zivi.LinearGap([-1, 0], 0.9, name="wall")],
            e=[0.5, 0.7],
            coordinates=["x", "y"],
        )

    return zivi.ParametricSystem(build, values)


MECHANICAL = ("q0.y", "qdot0.x", "mass", "push", "e.floor", "e")
OF_BOX = np.array([1.0, 0.2, 2.0, 3.0, 0.5, 0.7])


@pytest.mark.parametrize("output", ["final", "positions", "velocities", "impact_speed"])
def test_mechanical_systems(output):
    times = {"times": [0.2, 0.6, 0.9]} if output in ("positions", "velocities") else {}
    start = ([0.0, 1.0], [0.2, 0.0])
    method = zivi.SwitchedRK(1e-11, 1e-12)
    arguments = (box(), (0, 1.0), start, MECHANICAL, output)
    f = interop.run_function(*arguments, **times, method=method)
    assert f.wrt == MECHANICAL
    value, derivative = f(OF_BOX)
    assert np.shape(value) == f.shape
    assert derivative.shape == (*f.shape, 6)
    # the same by a system built with the numbers; e moves both coefficients from their largest
    shift, (floor, wall) = 1e-3, (0.5, 0.7)
    moved = OF_BOX + np.array([0, 0, 0.1, 0, 0.02, shift])
    e = [floor + 0.02 + shift, wall + shift]
    plain = box(mass=2.1)._built
    plain = zivi.MechanicalSystem(
        mass=2.1 * np.eye(2), force=[3.0, -9.81 * 2.1], gaps=plain.gaps, e=e
    )
    run = zivi.simulate(plain, (0, 1.0), start, method)
    other = f(moved)[0]
    if output == "final":
        np.testing.assert_allclose(other, [run.q[-1], run.qdot[-1]], atol=1e-9)
    elif output == "impact_speed":
        assert other == pytest.approx(run.resolved_impacts["speed_after"][0], rel=1e-10)
    else:
        both = run(np.array(times["times"]))
        np.testing.assert_allclose(other, both[int(output == "velocities")], atol=1e-9)
    exact = differences(lambda p: np.asarray(f(p)[0]), OF_BOX)
    np.testing.assert_allclose(derivative, np.moveaxis(exact, 0, -1), rtol=1e-5, atol=1e-6)
    assert f.fun(OF_BOX).shape == (np.size(value),)
    assert f.jac(OF_BOX).shape == (np.size(value), 6)
    assert f.evaluate(OF_BOX + 2 * np.eye(6)[4]).status is STATUS.OUT_OF_DOMAIN
    assert f.evaluate(OF_BOX - 2 * np.eye(6)[0]).status is STATUS.OUT_OF_DOMAIN


def test_impacts_that_a_jump_skipped_have_derivatives():
    # x = 1, speed v = sqrt(2 g): impact k at v/g (1 + 2 (e + .. + e^k)), then v e^(k+1)
    e, g = 0.5, 9.81
    s = zivi.sensitivity(zivi.ImpactSystem(-g, e=e), (0, 3), (1, 0), ("x0", "e"))
    listed = s.impacts_down_to(1e-2)
    plain = s.trajectory.impacts_down_to(1e-2)
    assert len(s.resolved_impacts) < len(listed) == len(plain)
    np.testing.assert_allclose(listed["t"], plain["t"], rtol=1e-14)
    v, k = math.sqrt(2 * g), np.arange(len(listed))
    powers = np.cumsum(e**k) - 1  # e + .. + e^k
    rates = np.cumsum(k * e ** np.maximum(k - 1.0, 0.0))
    by_e = np.column_stack([(1 + 2 * powers) / v, 2 * v / g * rates])
    np.testing.assert_allclose(listed["dt"], by_e, rtol=1e-11, atol=1e-14)
    by_speed = np.column_stack([g / v * e ** (k + 1), v * (k + 1) * e**k])
    np.testing.assert_allclose(listed["du"], by_speed, rtol=1e-11)
    assert len(s.impacts_down_to(1e-2, limit=3)) == len(s.trajectory.impacts_down_to(1e-2, limit=3))
    with pytest.raises(ValueError, match="speed must be > 0"):
        s.impacts_down_to(0.0)


def test_impacts_of_several_accumulations_are_listed_in_order():
    force = zivi.LinearForce(stiffness=1.0, damping=0.1, gravity=0.4, amplitude=0.9, omega=0.7)
    system = zivi.ImpactSystem(force, e=0.5)
    s = zivi.sensitivity(system, (0, 30), (1, 0), ("amplitude",), zivi.SwitchedRK(1e-11, 1e-12))
    listed, plain = s.impacts_down_to(1e-3), s.trajectory.impacts_down_to(1e-3)
    assert len(s.trajectory.zeno_times) == 3
    assert len(listed) == len(plain) > len(s.impacts_down_to(1e-2))
    np.testing.assert_allclose(listed["t"], plain["t"], rtol=1e-11)
    h, moved = 1e-5, []
    for side in (h, -h):
        other = zivi.LinearForce(
            stiffness=1.0, damping=0.1, gravity=0.4, amplitude=0.9 + side, omega=0.7
        )
        run = zivi.simulate(
            zivi.ImpactSystem(other, e=0.5), (0, 30), (1, 0), zivi.SwitchedRK(1e-11, 1e-12)
        )
        moved.append(run.impacts_down_to(0.9e-3)["t"][: len(listed)])
    if all(len(it) == len(listed) for it in moved):
        by = (moved[0] - moved[1]) / (2 * h)
        np.testing.assert_allclose(listed["dt"][:8, 0], by[:8], rtol=1e-4, atol=1e-5)


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
@pytest.mark.parametrize("program", ["in_jax", "controls_in_jax"])
def test_jax_differentiates(program):
    in_own_process("jax", f"import test_gradients; test_gradients.{program}()")


def test_bad_input():
    with pytest.raises(ValueError, match="output must be one of"):
        interop.run_function(BALL, (0, 3), (1, 0), NAMES, "energy")
    for bad, match in (
        ({"number": -1}, "number must be >= 0"),
        ({"outside": "zero"}, "outside must be 'inf', 'nan' or 'raise', got 'zero'"),
        ({"times": [0.1]}, "times are those of 'positions' or 'velocities', not of 'zeno_time'"),
    ):
        with pytest.raises(ValueError, match=match):
            interop.run_function(BALL, (0, 3), (1, 0), NAMES, "zeno_time", **bad)
    for times in ([], [0.2, 0.1], [0.1, 3.1], [-0.1], None):
        with pytest.raises(ValueError, match="times must be"):
            interop.run_function(BALL, (0, 3), (1, 0), NAMES, "positions", times=times)
    with pytest.raises(TypeError, match="SwitchedRK"):
        interop.run_function(BALL, (0, 3), (1, 0), NAMES, method=zivi.ThetaGamma(0.1))
    with pytest.raises(ValueError, match="p must have 3 entries, got 2"):
        interop.run_function(BALL, (0, 3), (1, 0), NAMES)([1.0, 0.5])
    with pytest.raises(ValueError, match="'mass'"):
        interop.run_function(BALL, (0, 3), (1, 0), ("mass",))
    with pytest.raises(TypeError, match="RunFunction"):
        interop.jax_function(math.sin)


EDGES = np.linspace(0.0, 1.5, 5)
FINE = zivi.SwitchedRK(rtol=1e-11, atol=1e-13)


def test_controls_have_the_columns_of_one_run_with_a_parameter_for_each():
    def pushed(t, x, v, u0, u1, u2, u3):
        return (u0, u1, u2, u3)[min(int(np.searchsorted(EDGES, t, side="right")) - 1, 3)] - 9.81

    u = np.linspace(-3.0, 3.0, 4)
    names = ("u0", "u1", "u2", "u3")
    force = zivi.ParametricForce(pushed, dict(zip(names, u, strict=True)))
    whole = zivi.ImpactSystem(force, e=0.7)
    s = zivi.sensitivity(whole, (0, 1.5), (1, 0), names, FINE, tstops=EDGES[1:-1])
    one = zivi.ImpactSystem(zivi.ParametricForce(lambda t, x, v, u: u - 9.81, {"u": 0.0}), e=0.7)
    f = zivi.interop.controlled_function(one, EDGES, (1, 0), "u", method=FINE)
    value, slopes = f(u)
    np.testing.assert_allclose(value, [s.trajectory.x[-1], s.trajectory.xdot[-1]], atol=1e-9)
    np.testing.assert_allclose(slopes, s.final, atol=1e-8)
    np.testing.assert_allclose(f.gradient(u, [1.0, 2.0]), slopes[0] + 2 * slopes[1], rtol=1e-14)


def test_controls_do_nothing_to_a_body_that_rests_at_the_end():
    ball = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81), e=0.5)
    f = zivi.interop.controlled_function(ball, np.linspace(0, 4, 9), (1, 0), "gravity")
    value, slopes = f(np.full(8, 9.81))
    assert not value.any()
    assert not slopes.any()
    assert np.isinf(f.evaluate(np.full(8, np.nan)).value).all()


def test_controls_of_mechanisms_follow_the_closed_form():
    def cart(u):
        return zivi.MechanicalSystem(mass=2.0, force=[u], gaps=[zivi.LinearGap([1.0])], e=0.5)

    system = zivi.ParametricSystem(cart, {"u": 0.0})
    f = zivi.interop.controlled_function(system, [0.0, 0.5, 1.0], ([3.0], [0.0]), ["u"])
    value, slopes = f([2.0, -1.0])
    assert value.shape == (2, 1)
    assert slopes.shape == (2, 1, 2)
    # x'' = u/2: (0.5^2/2 + 0.5 0.5)/2 and 0.5^2/2/2, 0.5/2 each
    np.testing.assert_allclose(slopes[:, 0], [[0.1875, 0.0625], [0.25, 0.25]], rtol=1e-7)


@pytest.mark.parametrize(
    ("edges", "controls", "words"),
    [([0.0], "u", "edges must be"), ([0, 1, 1], "u", "edges must be"), ([0, 1], (), "controls")],
)
def test_bad_controls_are_named(edges, controls, words):
    force = zivi.ParametricForce(lambda t, x, v, u: u, {"u": 0.0})
    ball = zivi.ImpactSystem(force, e=0.5)
    with pytest.raises(ValueError, match=words):
        zivi.interop.controlled_function(ball, edges, (1, 0), controls)


def controls_in_jax():
    """Check derivatives by controls in JAX, which is to be alone in its process."""
    import jax

    ball = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81), e=0.5)
    f = zivi.interop.controlled_function(ball, np.linspace(0, 0.4, 5), (1, 0), "gravity")
    height = zivi.interop.jax_function(f)
    slopes = jax.grad(lambda u: height(u)[0])(jax.numpy.full(4, 9.81))
    # before the impact: of -int int g
    np.testing.assert_allclose(slopes, -0.01 * (3.5 - np.arange(4)), rtol=1e-4)
