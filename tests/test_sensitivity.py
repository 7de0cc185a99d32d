"""Derivatives of runs, against references of high precision, closed forms and identities."""

from __future__ import annotations

import ctypes
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import orbit_data
import zivi

TABLE = zivi.LinearForce(gravity=1.0, amplitude=0.8, phase=-math.pi / 2)
STICKING = zivi.LinearForce(stiffness=1.0, damping=0.1, gravity=0.4, amplitude=0.9, omega=0.7)


def tight(tol: float = 1e-10) -> zivi.SwitchedRK:
    return zivi.SwitchedRK(rtol=tol, atol=tol)


def solved(name: str, tol: float, errsens: bool) -> tuple[dict, list[str], zivi.Sensitivity]:
    it = orbit_data.references()[name]
    system, names = orbit_data.system_of(it["parameters"])
    span = (float(it["t0"]), float(it["t_end"]))
    columns = list(it["d"])
    wrt = [names[q] for q in columns]
    y0 = (float(it["x0"]), float(it["v0"]))
    return it, columns, zivi.sensitivity(system, span, y0, wrt, tight(tol), errsens=errsens)


def errors(it: dict, columns: list[str], s: zivi.Sensitivity) -> tuple[float, float]:
    """Largest relative errors: of everything but lift-offs, of lift-offs."""
    zeno, lift = iter(s.zeno_times), iter(s.liftoff_times)
    worst = {"lift": 0.0, "other": 0.0}
    for i, label in enumerate(it["labels"]):
        row = {"x(T)": lambda: s.final[0], "v(T)": lambda: s.final[1]}.get(
            label, lambda which=label: next(lift if which == "lift" else zeno)
        )()
        for q, value in zip(columns, row, strict=True):
            exact = float(it["d"][q][i])
            error = abs(value - exact) / (abs(exact) or 1.0)
            kind = "lift" if label == "lift" else "other"
            worst[kind] = max(worst[kind], error)
    return worst["other"], worst["lift"]


@pytest.mark.parametrize("tol", [1e-8, 1e-10])
@pytest.mark.parametrize("name", orbit_data.of_kind("sensitivity"))
def test_derivatives_are_those_of_high_precision(name, tol):
    worst, lift = errors(*solved(name, tol, errsens=True))
    assert worst <= 15 * tol
    assert lift <= 1e-14
    worst, lift = errors(*solved(name, tol, errsens=False))
    assert worst <= 50 * tol
    assert lift <= 1e-14


@pytest.mark.parametrize("name", orbit_data.of_kind("sensitivity"))
def test_control_of_the_columns_costs_few_steps(name):
    *_, with_columns = solved(name, 1e-8, errsens=True)
    *_, without = solved(name, 1e-8, errsens=False)
    assert with_columns.trajectory.n_steps <= 1.5 * without.trajectory.n_steps


def table_of(s: zivi.Sensitivity, g: float, e: float, moving: bool) -> float:
    """The derivative of the Zeno time by e from the impacts, by a table of four columns."""
    t, dt, du = (
        s.resolved_impacts["t"],
        s.resolved_impacts["dt"][:, 0],
        s.resolved_impacts["du"][:, 0],
    )
    u = s.trajectory.resolved_impacts["xdot_after"]
    q = 2 / (g * (1 - e))
    values, rates = t + q * u, dt + q * du + q * u / (1 - e)
    for j in range(1, min(6, len(t))):
        r = e ** (j + 1)
        new = (values[1:] - r * values[:-1]) / (1 - r)
        rates = (rates[1:] - r * rates[:-1]) / (1 - r)
        if moving:
            rates = rates + (j + 1) * e**j / (1 - r) * (new - values[:-1])
        values = new
    return float(rates[-1])


def test_the_ratios_of_the_table_move_with_e():
    # a spring makes the expansion have all its powers, and g is constant
    spring = zivi.LinearForce(stiffness=1.0, damping=0.3, gravity=2.0)
    s = zivi.sensitivity(zivi.ImpactSystem(spring, e=0.5), (0, 9), (1, 0), ("e",), tight(1e-11))
    exact = float(s.zeno_times[0, 0])
    assert abs(table_of(s, 2.0, 0.5, moving=True) - exact) < 1e-8
    assert abs(table_of(s, 2.0, 0.5, moving=False) - exact) > 1e3 * 1e-10 * exact


@pytest.mark.parametrize("e", [0.0, 0.3, 0.9])
def test_a_ball_has_the_derivatives_of_its_closed_form(e):
    # t = v/g + (v' /g) (1 + e)/(1 - e) with the first impact at the speed v' = sqrt(2 g x + v^2)
    g, x, v = 9.81, 1.2, 0.7
    ball = zivi.ImpactSystem(-g, e=e)
    s = zivi.sensitivity(ball, (0, 20), (x, v), ("x0", "xdot0", "e", "force"), tight(1e-11))
    speed, factor = math.sqrt(2 * g * x + v * v), (1 + e) / (1 - e)
    by_g = -v / g**2 + factor * (x / (speed * g) - speed / g**2)
    exact = [factor / speed, 1 / g + factor * v / speed / g, 2 * speed / (g * (1 - e) ** 2), -by_g]
    np.testing.assert_allclose(s.zeno_times[0], exact, rtol=3e-10)
    assert not s.final.any()
    assert s.success
    assert math.isclose(s.trajectory.zeno_times[0], (v + factor * speed) / g, rel_tol=1e-10)


def test_the_determinant_is_that_of_the_flow_and_the_impacts():
    force = zivi.LinearForce(stiffness=1.0, damping=0.1, gravity=-1.0, amplitude=1.2, omega=0.9)
    s = zivi.sensitivity(zivi.ImpactSystem(force, e=0.8), (0, 20), (1.5, 0), method=tight())
    k = len(s.trajectory.resolved_impacts)
    assert k >= 3
    assert s.trajectory.rest_time is None
    assert math.isclose(np.linalg.det(s.monodromy), 0.8 ** (2 * k) * math.exp(-2), rel_tol=1e-9)


def test_the_time_of_the_start_moves_the_state_along_the_motion():
    system = zivi.ImpactSystem(STICKING, e=0.5)
    s = zivi.sensitivity(system, (0, 12), (1.0, 0.3), ("x0", "xdot0", "t0"), tight())
    start = np.array([0.3, STICKING(0, 1.0, 0.3)])
    by_t0 = -s.resolved_impacts["dt"][:, :2] @ start
    np.testing.assert_allclose(s.resolved_impacts["dt"][:, 2], by_t0, rtol=1e-10)
    np.testing.assert_allclose(s.zeno_times[0, 2], -s.zeno_times[0, :2] @ start, rtol=1e-9)


@pytest.mark.parametrize(("d", "within"), [(1e-2, 0.02), (1e-4, 1e-3)])
def test_the_radius_is_the_distance_to_a_grazing(d, within):
    spring = zivi.ImpactSystem(zivi.LinearForce(stiffness=1, gravity=-1), e=0.5)
    for sign, kind in ((1, "impact"), (-1, "minimum")):
        s = zivi.sensitivity(spring, (0, 5), (2 + sign * d, 0), ("x0",), tight(1e-12))
        assert abs(s.radius[0] / d - 1) < within
        assert s.nearest.kind == kind
        assert s.status is zivi.OrbitStatus.COMPLETED
    # the impact at arccos(-1/(1 + d)), and it is gone beyond the radius
    beyond = zivi.simulate(spring, (0, 5), (2 + d - 1.05 * s.radius[0], 0), tight(1e-12))
    assert len(beyond.impacts) == 0


def test_a_grazing_is_flagged_and_chains_are_not():
    spring = zivi.ImpactSystem(zivi.LinearForce(stiffness=1, gravity=-1), e=0.5)
    for depth in (1e-8, -1e-8):
        s = zivi.sensitivity(spring, (0, 5), (2 + depth, 0), ("x0",), tight(1e-9))
        assert s.status is zivi.OrbitStatus.GRAZING
        assert not s.success
        assert np.isfinite(s.final).all()
    for force in (TABLE, STICKING):
        s = zivi.sensitivity(zivi.ImpactSystem(force, e=0.7), (0, 30), (1, 0), ("e",), tight(1e-8))
        assert s.status is zivi.OrbitStatus.COMPLETED
        assert len(s.zeno_times)


def test_derivatives_at_any_time_through_a_rest():
    system, wrt = zivi.ImpactSystem(STICKING, e=0.5), ("x0", "amplitude")
    s = zivi.sensitivity(system, (0, 22), (1, 0), wrt, tight())
    times = np.array([0.0, 1.0, 3.5, 5.0, 8.0, 12.0, 22.0])
    columns = s(times)
    assert columns.shape == (2, 2, 7)
    assert s(1.0).shape == (2, 2)
    np.testing.assert_array_equal(columns[:, :, 0], [[1, 0], [0, 0]])
    assert not columns[:, :, 3].any()  # at rest
    # rates of 2 times the rounding of the time
    np.testing.assert_allclose(columns[:, :, -1], s.final, rtol=1e-14, atol=2 * np.spacing(22.0))
    for k in (1, 2, 4, 5):
        shorter = zivi.sensitivity(system, (0, times[k]), (1, 0), wrt, tight())
        np.testing.assert_allclose(columns[:, :, k], shorter.final, rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize("order", [5, 8])
def test_derivatives_between_steps_by_all_parameters(order):
    # parameters whose forces depend on the motion, at times within the steps of a longer run
    force = zivi.LinearForce(
        stiffness=1.0, damping=0.1, gravity=2.0, amplitude=0.5, omega=2.0, phase=0.3
    )
    names = ("stiffness", "damping", "gravity", "amplitude", "omega", "phase", "x0", "xdot0", "e")
    system, method = zivi.ImpactSystem(force, e=0.5), zivi.SwitchedRK(1e-11, 1e-12, order=order)
    s = zivi.sensitivity(system, (0, 2.0), (1, 0), names, method)
    times = np.array([0.1, 0.3, 0.7, 1.3, 1.6])
    between = s(times)
    for k, t in enumerate(times):
        shorter = zivi.sensitivity(system, (0, t), (1, 0), names, method)
        np.testing.assert_allclose(between[:, :, k], shorter.final, rtol=1e-9, atol=1e-10)


def test_derivatives_within_an_accumulation():
    # the ball of the closed form, between its impacts 20 and 21, that a jump to rest skips
    e, v = 0.5, math.sqrt(2 * 9.81)
    first = v / 9.81
    start = first * (1 + 2 * sum(e**k for k in range(1, 20)))
    t = start + 0.3 * 2 * first * e**20
    s = zivi.sensitivity(zivi.ImpactSystem(-9.81, e=e), (0, 3), (1, 0), ("x0",), tight(1e-13))
    # x = u tau - g tau^2/2, tau = t - start; everything scales with v, dv/dx0 = g/v
    u, tau = v * e**20, t - start
    by_v = (e**20 * tau - u * start / v + 9.81 * tau * start / v, e**20 + 9.81 * start / v)
    got = s(t)[:, 0] / (9.81 / v)
    np.testing.assert_allclose(got, by_v, rtol=1e-6)


def test_a_moving_wall_is_a_force_in_its_frame():
    # w = a cos(w t + ph): the force -g - w'' = -g + a w^2 cos
    a, omega, phase = 0.05, 6.0, 0.3
    wall = zivi.HarmonicWall(a, omega, phase)
    moving = zivi.ImpactSystem(-9.81, e=0.6, wall=wall)
    force = zivi.LinearForce(gravity=9.81, amplitude=a * omega**2, omega=omega, phase=phase)
    own = ("force", "wall.amplitude", "wall.omega", "wall.phase", "e")
    same = ("gravity", "amplitude", "omega", "phase", "e")
    left = zivi.sensitivity(moving, (0, 1.5), (1, 0), own, tight(1e-11))
    right = zivi.sensitivity(zivi.ImpactSystem(force, e=0.6), (0, 1.5), (1, 0), same, tight(1e-11))
    by_g, by_a, by_omega, by_phase, by_e = right.resolved_impacts["dt"].T
    exact = [-by_g, omega**2 * by_a, 2 * a * omega * by_a + by_omega, by_phase, by_e]
    assert len(left.resolved_impacts) > 3
    np.testing.assert_allclose(
        left.resolved_impacts["dt"], np.transpose(exact), rtol=1e-7, atol=1e-9
    )


def law(t, x, v, k, c):
    return -k * x - c * v - 1.0


@ctypes.CFUNCTYPE(ctypes.c_double, *[ctypes.c_double] * 5)
def compiled(t, x, v, k, c):
    return -k * x - c * v - 1.0


@pytest.mark.parametrize("kind", ["python", "jacobian", "compiled", "wall"])
def test_a_parametric_force_is_the_linear_force(kind):
    values = {"k": 1.5, "c": 0.2}
    jacobian = {"jacobian": lambda t, x, v, k, c: (0.0, -k, -c, -x, -v)}
    f = compiled if kind == "compiled" else law
    force = zivi.ParametricForce(f, values, **(jacobian if kind == "jacobian" else {}))
    linear = zivi.LinearForce(stiffness=1.5, damping=0.2, gravity=1.0)
    wall = zivi.HarmonicWall(0.05, 2.0) if kind == "wall" else None
    systems = [zivi.ImpactSystem(it, e=0.5, wall=wall) for it in (force, linear)]
    names = (("k", "c", "x0", "e"), ("stiffness", "damping", "x0", "e"))
    one, other = (
        zivi.sensitivity(system, (0, 3), (1, 0), wrt, tight(1e-9))
        for system, wrt in zip(systems, names, strict=True)
    )
    n = min(len(one.resolved_impacts), len(other.resolved_impacts), 4)
    for field in ("dt", "du"):
        np.testing.assert_allclose(
            one.resolved_impacts[field][:n], other.resolved_impacts[field][:n], rtol=1e-7
        )
    assert force(0.0, 1.0, 2.0) == pytest.approx(-2.9)


def test_a_plain_callable_has_a_start_and_e_but_no_parameters():
    system = zivi.ImpactSystem(lambda t, x, v: -1.5 * x - 1.0, e=0.5)
    linear = zivi.ImpactSystem(zivi.LinearForce(stiffness=1.5, gravity=1.0), e=0.5)
    one, other = (
        zivi.sensitivity(it, (0, 6), (1, 0), ("x0", "e"), tight(1e-9)) for it in (system, linear)
    )
    np.testing.assert_allclose(one.zeno_times, other.zeno_times, rtol=1e-7)
    with pytest.raises(ValueError, match="ParametricForce"):
        zivi.sensitivity(system, (0, 6), (1, 0), ("stiffness",))


def test_bad_input():
    ball = zivi.ImpactSystem(TABLE, e=0.5)
    with pytest.raises(
        ValueError, match="unknown parameter 'mass'; the parameters are x0, xdot0, t0, e, stiff"
    ):
        zivi.sensitivity(ball, (0, 1), (1, 0), ("mass",))
    with pytest.raises(TypeError, match="SwitchedRK"):
        zivi.sensitivity(ball, (0, 1), (1, 0), method=zivi.ThetaGamma(h=0.1))
    with pytest.raises(ValueError, match="different names"):
        zivi.sensitivity(ball, (0, 1), (1, 0), ("e", "e"))
    with pytest.raises(ValueError, match="t_span"):
        zivi.sensitivity(ball, (1, 0), (1, 0))
    with pytest.raises(ValueError, match="t must lie within"):
        zivi.sensitivity(ball, (0, 1), (1, 0))(2.0)
    for parameters, match in (({"e": 1.0}, "'e' cannot be a name"), ({"k": math.nan}, "finite")):
        with pytest.raises(ValueError, match=match):
            zivi.ParametricForce(law, parameters)
    with pytest.raises(TypeError, match="take 4 of them"):
        zivi.ImpactSystem(zivi.ParametricForce(compiled, {"k": 1.0}), e=0.5)
    short = zivi.ParametricForce(law, {"k": 1.0, "c": 0.0}, lambda *_: (0.0, 0.0))
    with pytest.raises(TypeError, match="jacobian must return 5 numbers"):
        zivi.sensitivity(zivi.ImpactSystem(short, e=0.5), (0, 1), (1, 0))


def test_what_the_force_raises_reaches_the_caller():
    def late(t, x, v, k):
        if t > 0.5:
            raise ArithmeticError("late")
        return -k

    system = zivi.ImpactSystem(zivi.ParametricForce(late, {"k": 9.81}), e=0.5)
    with pytest.raises(ArithmeticError) as caught:
        zivi.sensitivity(system, (0, 1), (1, 0), ("k",))
    assert caught.value.trajectory.status is zivi.Status.RAISED


def test_a_run_without_progress_in_its_budget_keeps_what_it_has():
    s = zivi.sensitivity(
        zivi.ImpactSystem(TABLE, e=0.7), (0, 30), (1, 0), method=zivi.SwitchedRK(max_steps=12)
    )
    assert s.status is zivi.OrbitStatus.RUN_ENDED
    assert s.trajectory.status is zivi.Status.STEP_BUDGET
    assert len(s.resolved_impacts) == len(s.trajectory.resolved_impacts) > 0


def test_as_a_dataset():
    s = zivi.sensitivity(zivi.ImpactSystem(TABLE, e=0.7), (0, 12), (1, 0), ("x0", "amplitude"))
    data = s.to_xarray()
    assert data.impact_dt.shape == (len(s.impacts), 2)
    assert float(data.zeno_time.sel(wrt="amplitude")[0]) == s.zeno_times[0, 1]


def kicked(t: float, x: float, xdot: float, pull: float) -> float:
    """A spring; from t = 2 on a pull more."""
    return -1.0 - 4.0 * x - 0.1 * xdot + (pull if t >= 2.0 else 0.0)


def test_a_plastic_impact_under_an_outward_force_moves_what_follows():
    """``x = x0 + v0 t + t^2/2`` up to the wall, from there on ``(t - t1)^2/2``."""
    system = zivi.ImpactSystem(zivi.LinearForce(gravity=-1.0), e=0.0)
    s = zivi.sensitivity(system, (0, 2), (0.5, -2.0), ("x0", "xdot0"))
    t1, speed = 2 - math.sqrt(3), -math.sqrt(3)
    dt1 = np.array([-1.0, -t1]) / speed
    np.testing.assert_allclose(s.final, [-(2 - t1) * dt1, -dt1], rtol=1e-13)


@pytest.mark.parametrize("t1", [2.45, 2.55])
def test_the_nearest_of_several_jumps_bounds_the_radius(t1):
    """A fall of ``t1 = x0^(1/2)`` seconds, which may come to pass the jump at 2.5."""
    stops = [0.5, 1.5, 2.5, 3.3]
    s = zivi.sensitivity(
        zivi.ImpactSystem(-2.0, e=0.5), (0, 3.9), (t1**2, 0), ("x0",), tstops=stops
    )
    assert s.nearest is not None
    assert s.nearest.kind == "stop"
    assert s.radius[0] == pytest.approx(0.05 * 2 * t1, rel=1e-9)


def test_the_derivatives_across_a_jump_are_the_product_of_those_on_its_sides():
    # an impact shortly before the jump of the force, and some after it
    force = zivi.ParametricForce(kicked, {"pull": -0.7})
    system = zivi.ImpactSystem(force, e=0.8)
    s = zivi.sensitivity(system, (0, 4), (1, 0.2), tstops=[2.0], method=tight(1e-11))
    k = int(np.sum(s.trajectory.resolved_impacts["t"] < 2))
    assert 1 <= k < len(s.trajectory.resolved_impacts)
    sides, state = [], (1.0, 0.2)
    for span, pull in (((0, 2), 0.0), ((2, 4), -0.7)):
        linear = zivi.LinearForce(stiffness=4.0, damping=0.1, gravity=1.0 - pull)
        side = zivi.sensitivity(zivi.ImpactSystem(linear, e=0.8), span, state, method=tight(1e-11))
        sides.append(side.monodromy)
        state = (side.trajectory.x[-1], side.trajectory.xdot[-1])
    np.testing.assert_allclose(s.monodromy, sides[1] @ sides[0], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(s(2.0), sides[0], rtol=1e-8, atol=1e-8)
    # one that is not told of the jump is far off, or takes far more steps
    blind = zivi.sensitivity(system, (0, 4), (1, 0.2), method=tight(1e-11))
    assert blind.trajectory.nfev > 1.3 * s.trajectory.nfev


def test_a_jump_that_throws_a_resting_mass_off_is_at_a_fixed_time():
    force = zivi.ParametricForce(lambda t, x, v, p: -9.81 if t < 2.0 else p, {"p": 2.0})
    s = zivi.sensitivity(zivi.ImpactSystem(force, e=0.5), (0, 3), (1, 0), ("x0", "p"), tstops=[2.0])
    assert s.trajectory.liftoff_times.tolist() == [2.0]
    assert not s.liftoff_times.any()
    np.testing.assert_allclose(s.final, [[0, 0.5], [0, 1.0]], atol=1e-9)
    # the Zeno point, at 1.35 s, may be moved to the jump
    zeno = s.trajectory.zeno_times[0]
    assert s.limits[0].kind == "stop"
    assert math.isclose(s.radius[0], (2.0 - zeno) / s.zeno_times[0, 0], rel_tol=1e-9)
    with pytest.raises(ValueError, match="tstops must"):
        zivi.sensitivity(zivi.ImpactSystem(force, e=0.5), (0, 4), (1, 0), tstops=[math.nan])


def test_random_runs_keep_their_events_within_the_radius():
    # few draws of benchmarks/sensitivity_radius.py, which makes 60
    sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
    import sensitivity_radius

    told = sensitivity_radius.sweep(6, seed=2)
    assert len(told[0.3]) >= 40
    assert np.mean(told[0.3]) >= 0.95
    assert np.mean(told[0.3] + told[0.8]) >= 0.9


def test_the_work_of_long_accumulations_grows_with_their_impacts():
    """A tail whose derivatives are not accurate yet is not examined again at every impact."""
    ball = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, damping=7.2), e=0.9997)
    of_e = zivi.sensitivity(ball, (0, 5), (1, 0), wrt=("e",))
    assert of_e.success
    assert of_e.trajectory.nfev < 20 * len(of_e.trajectory.t)
    h, fine = 1e-7, zivi.SwitchedRK(rtol=1e-13)
    ends = [
        zivi.simulate(ball.replace(e=e), (0, 5), (1, 0), fine).rest_time
        for e in (0.9997 - h, 0.9997 + h)
    ]
    assert of_e.zeno_times[0, 0] == pytest.approx((ends[1] - ends[0]) / (2 * h), rel=1e-6)
