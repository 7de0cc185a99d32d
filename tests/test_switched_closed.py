"""SwitchedRK on motions that are known otherwise: closed forms, and SciPy restarted at impacts."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import zivi
from closed_form import bouncing_oscillator, rest_then_lift

METHODS = pytest.mark.parametrize(
    ("order", "tol"), [(8, 1e-6), (8, 1e-10), (8, 1e-12), (5, 1e-6), (5, 1e-10)]
)


def run(force, e, span, state, order=8, tol=1e-10, **more):
    method = zivi.SwitchedRK(rtol=tol, atol=tol, order=order, flights="rk")
    return zivi.simulate(zivi.ImpactSystem(force, e=e), span, state, method=method, **more)


@METHODS
@pytest.mark.parametrize("kind", ["linear", "callable"])
def test_rocking_block(order, tol, kind):
    """x'' = x - a: from a/2 it falls in acosh 2, then rocks for 2 artanh(e^n sqrt(3)/2) each."""
    a, e = 0.2, 1 - 1.5 * math.sin(0.2) ** 2
    force = {
        "linear": zivi.LinearForce(stiffness=-1.0, gravity=a),
        "callable": lambda t, x, xdot: x - a,
    }[kind]
    sol = run(force, e, (0, 40), (a / 2, 0), order, tol)
    flights = [2 * math.atanh(e**n * math.sqrt(3) / 2) for n in range(1, 900)]
    impacts = np.cumsum([math.acosh(2), *flights])
    assert impacts[-1] == pytest.approx(31.902716, abs=5e-7)
    # what is left takes 2 u / (a (1 - e)): an error of u becomes 170 times that in time, and those
    # of 30 steps add up (measured: 12 to 28 tolerances of u at order 5, 0.3 at order 8)
    bound = {8: 2, 5: 60}[order] * 2 / (a * (1 - e)) * tol
    assert sol.rest_time == pytest.approx(impacts[-1], abs=bound)
    n = len(sol.resolved_impacts)
    assert n > 20
    np.testing.assert_allclose(sol.resolved_impacts["t"], impacts[:n], rtol=0, atol=bound)
    speeds = a * math.sqrt(3) / 2 * e ** np.arange(1, n + 1)
    np.testing.assert_allclose(sol.resolved_impacts["xdot_after"], speeds, rtol=0, atol=100 * tol)
    listed = sol.impacts_down_to(1e-9)["xdot_after"]
    assert len(listed) == 1 + math.floor(math.log(1e-9 / (a * math.sqrt(3) / 2)) / math.log(e))


@METHODS
@pytest.mark.parametrize("e", [0.3, 0.7, 0.95])
@pytest.mark.parametrize("z", [0.0, 0.05])
def test_an_oscillator_on_its_wall_has_no_zeno_point(e, z, order, tol):
    """Flights of equal length for ever: never taken for an accumulation, however low they are."""
    sol = run(zivi.LinearForce(stiffness=1.0, damping=2 * z), e, (0, 40), (1, 0), order, tol)
    flight = np.pi / np.sqrt(1 - z * z)
    first = np.pi / 2 if z == 0 else (np.pi - np.arccos(z)) / np.sqrt(1 - z * z)
    assert sol.rest_time is None
    assert len(sol.zeno_times) == len(sol.liftoff_times) == 0
    # speeds far above the tolerance; what is below may be anything
    n = int(1 + (40 - first) // flight)
    speeds = sol.resolved_impacts["xdot_after"]
    expected = e * np.exp(-z * first) * (e * np.exp(-z * flight)) ** np.arange(n)
    assert np.sum(speeds > 30 * tol) == np.sum(expected > 30 * tol)
    clear = min(len(speeds), int(np.sum(expected > 30 * tol)))
    np.testing.assert_allclose(
        sol.resolved_impacts["t"][:clear],
        (first + flight * np.arange(n))[:clear],
        rtol=0,
        atol=1e-2,
    )
    assert tol > 1e-8 or len(speeds) == n
    times = np.linspace(0, 40, 700)
    exact = np.array([bouncing_oscillator(t, e=e, x0=1.0, damping_ratio=z) for t in times])
    assert np.abs(sol(times)[0] - exact).max() < 50 * tol


@METHODS
@pytest.mark.parametrize(("g", "c"), [(2.0, 4.0), (1e-3, 1e-2), (9.81, 100.0)])
def test_rest_then_lift_off(g, c, order, tol):
    """f = -g + c t: off at t = g/c, then x = c (t - g/c)^3 / 6."""
    sol = run(lambda t, x, xdot: -g + c * t, 0.5, (0, 3 * g / c), (0, 0), order, tol)
    assert sol.liftoff_times == pytest.approx([g / c], rel=1e-13)
    exact = np.array([rest_then_lift(t, g=g, c=c) for t in sol.t])
    np.testing.assert_allclose(sol.x, exact, rtol=0, atol=10 * tol)
    assert sol.rest_time is None


def by_scipy(force, e, span, state, impacts):
    """Times and speeds after impacts, by solve_ivp and its events, restarted."""
    (t, end), y, found = span, state, []

    def wall(t, y):
        return y[0]

    wall.terminal, wall.direction = True, -1
    while len(found) < impacts:
        arc = solve_ivp(
            lambda t, y: (y[1], force(t, *y)),
            (t, end),
            y,
            method="DOP853",
            rtol=1e-13,
            atol=1e-14,
            events=wall,
            max_step=0.05,
        )
        if arc.status != 1:
            break
        t, after = arc.t_events[0][0], -e * arc.y_events[0][0, 1]
        found.append((t, after))
        # on the new arc a little above the wall: solve_ivp would find its start
        small = 1e-7
        f = force(t, 0.0, after)
        y = (after * small + 0.5 * f * small**2, after + f * small)
        t += small
    return np.array(found)


NONLINEAR = {
    "quadratic drag": lambda t, x, xdot: -9.81 - 0.3 * xdot * abs(xdot) + 4 * math.sin(5 * t),
    "hardening": lambda t, x, xdot: -3.0 - 2 * x - 40 * x**3 - 0.1 * xdot + 2 * math.cos(3 * t),
    "pendulum": lambda t, x, xdot: -4 * math.sin(x + 0.4) + 0.5 * math.sin(t),
    "attraction": lambda t, x, xdot: -1.0 / (0.2 + x) ** 2,
}


@METHODS
@pytest.mark.parametrize("name", NONLINEAR)
def test_nonlinear_forces_as_by_scipy(name, order, tol):
    """The first eight impacts; a factor 100 for what they magnify."""
    force = NONLINEAR[name]
    expected = by_scipy(force, 0.7, (0.0, 8.0), (0.5, 0.3), 8)
    assert len(expected) >= 5
    sol = run(force, 0.7, (0, 8), (0.5, 0.3), order, tol)
    impacts = sol.impacts_down_to(1e-6)[: len(expected)]
    bound = 100 * tol + 1e-11
    np.testing.assert_allclose(impacts["t"], expected[:, 0], rtol=0, atol=bound)
    np.testing.assert_allclose(impacts["xdot_after"], expected[:, 1], rtol=0, atol=bound)


def test_a_factor_that_is_off_would_be_seen():
    """Negative control: one per million of drag."""
    force = NONLINEAR["quadratic drag"]
    off = lambda t, x, xdot: force(t, x, xdot) * (1 + 1e-6)  # noqa: E731
    one, other = (run(f, 0.7, (0, 8), (0.5, 0.3)).impacts["t"][:5] for f in (force, off))
    assert np.abs(one - other).max() > 1e3 * 1e-10
