"""Walls that move: the same motions as under the equivalent force in the frame of the wall."""

import math
import re
from operator import attrgetter

import numpy as np
import pytest
from hypothesis import given, strategies as st

import zivi

G = 9.81
METHODS = pytest.mark.parametrize(
    "method",
    [
        zivi.SwitchedRK(rtol=1e-10, atol=1e-10, flights="rk"),
        zivi.SwitchedRK(rtol=1e-10, atol=1e-10, order=5, flights="rk"),
        zivi.ThetaGamma(h=1e-3),
    ],
    ids=["order 8", "order 5", "ThetaGamma"],
)
MILLIMETRES = st.integers(-3000, 3000).map(lambda n: n * 1e-3)
QUIET = {"position": lambda t: 0.0, "velocity": lambda t: 0.0, "acceleration": lambda t: 0.0}


def run(force, wall=None, *, e=0.5, span=(0, 6), state=(0.3, 0), method=None, **more):
    system = zivi.ImpactSystem(force, e=e, wall=wall)
    method = method or zivi.SwitchedRK(rtol=1e-10, atol=1e-10)
    return zivi.simulate(system, span, state, method=method, **more)


def in_the_frame_of(wall, stiffness=0.0, damping=0.0, gravity=0.0):
    """The force that a harmonic wall makes of a spring, a damper and gravity that do not move.

    ``-k (x + w) - c (x' + w') - g - w''``: three cosines of one frequency are one.
    """
    a, omega = wall.amplitude, wall.omega
    swing = complex(a * (omega**2 - stiffness), -damping * a * omega)
    return zivi.LinearForce(
        stiffness=stiffness,
        damping=damping,
        gravity=gravity + stiffness * wall.offset,
        amplitude=abs(swing),
        omega=omega,
        phase=wall.phase + math.atan2(swing.imag, swing.real),
    )


def as_functions(wall):
    names = ("position", "velocity", "acceleration")
    return zivi.MovingWall(*(lambda t, k=k: wall(t)[k] for k in range(len(names))))


def assert_same(one, two, tol):
    """Samples need not be at the same times: the steps may differ by rounding."""
    assert (one.status, two.status) == (0, 0)
    for name in ("zeno_times", "liftoff_times"):
        np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=0, atol=tol)
    few, many = sorted((one.resolved_impacts, two.resolved_impacts), key=len)
    assert len(many) - len(few) <= 2
    for field in ("t", "xdot_before", "xdot_after"):
        np.testing.assert_allclose(few[field][:5], many[field][:5], rtol=0, atol=tol)
    assert one.x[-1] == pytest.approx(two.x[-1], abs=tol)
    times = np.linspace(one.t[0], one.t[-1], 200)
    events = np.concatenate([many["t"], one.zeno_times])
    clear = np.abs(np.subtract.outer(times, events)).min(axis=1, initial=1.0) > 10 * tol
    np.testing.assert_allclose(one(times)[:, clear], two(times)[:, clear], rtol=0, atol=tol)


@METHODS
@pytest.mark.parametrize(
    "force",
    [
        {"gravity": G},
        {"gravity": G, "damping": 0.4},
        {"stiffness": 20.0, "damping": 0.3, "gravity": 4.0},
    ],
    ids=["gravity", "drag", "spring"],
)
@pytest.mark.parametrize(
    "wall",
    [
        zivi.HarmonicWall(0.2, 5.0, phase=0.7),
        zivi.HarmonicWall(-0.03, 2 * np.pi, phase=-1.0, offset=0.2),
    ],
    ids=["high", "low"],
)
def test_harmonic_wall_as_a_force(method, force, wall):
    """SwitchedRK to a hundred tolerances (slow impacts magnify); fixed steps to rounding."""
    moving = run(zivi.LinearForce(**force), wall, method=method)
    frame = run(in_the_frame_of(wall, **force), method=method)
    assert len(frame.zeno_times) > 0
    assert_same(moving, frame, 1e-8)


@METHODS
def test_three_functions_are_the_harmonic_wall(method):
    wall = zivi.HarmonicWall(0.2, 5.0, phase=0.7)
    assert_same(
        run(-G, wall, span=(0, 3), method=method),
        run(-G, as_functions(wall), span=(0, 3), method=method),
        1e-9,
    )


@METHODS
@pytest.mark.parametrize("speed", [-0.7, 3.0])
def test_a_wall_at_constant_speed(method, speed):
    """Galilei: the same under a number; a drag is that of the relative wind."""
    lift = zivi.MovingWall(lambda t: 2 + speed * t, lambda t: speed, lambda t: 0.0)
    switched = isinstance(method, zivi.SwitchedRK)
    # other steps are taken where the force is known not to depend on time
    force = (lambda t, x, xdot: -G + 0.0 * t) if switched else -G
    still, moving = run(force, method=method), run(-G, lift, method=method)
    # to the last bit, but for rounding of what the wall adds
    close = 1e-13 if switched else 0.0
    for name in ("t", "x", "xdot", "transformed.s", "transformed.v", "zeno_times"):
        np.testing.assert_allclose(attrgetter(name)(moving), attrgetter(name)(still), close, close)
    np.testing.assert_array_equal(moving.impacts["gap"], still.impacts["gap"])
    for name in ("t", "speed_before", "speed_after"):
        np.testing.assert_allclose(moving.impacts[name], still.impacts[name], close, close)
    position, velocity = moving.fixed()
    np.testing.assert_allclose(position, moving.x + 2 + speed * moving.t, rtol=1e-15)
    np.testing.assert_allclose(velocity, moving.xdot + speed, rtol=1e-15)
    drag = run(zivi.LinearForce(gravity=G, damping=0.5), lift, method=method)
    wind = run(zivi.LinearForce(gravity=G + 0.5 * speed, damping=0.5), method=method)
    assert_same(drag, wind, 1e-9)


@given(
    amplitude=st.floats(-0.5, 0.5),
    omega=st.floats(0.2, 12),
    phase=st.floats(-4, 4),
    offset=st.floats(-2, 2),
    e=st.floats(0.0, 0.95),
    x0=MILLIMETRES.map(abs),
    xdot0=MILLIMETRES,
)
def test_laws_of_a_moving_wall(amplitude, omega, phase, offset, e, x0, xdot0):
    """In the fixed frame the mass is never below the wall, and e is that of the relative speed."""
    wall = zivi.HarmonicWall(amplitude, omega, phase=phase, offset=offset)
    sol = run(-G, wall, e=e, span=(-1, 2), state=(x0, xdot0))
    assert sol.success
    position, velocity = sol.fixed()
    w, wdot, _ = wall(sol.t)
    assert np.all(position >= w - 1e-15 * np.abs(w))
    np.testing.assert_allclose(position - w, sol.x, rtol=0, atol=1e-14)
    np.testing.assert_allclose(velocity - wdot, sol.xdot, rtol=0, atol=1e-13)
    impacts = sol.resolved_impacts
    # kappa is what is kept: e is known to 1e-16, not to 1e-16 of itself
    speed = np.abs(impacts["xdot_before"])
    assert np.all(np.abs(impacts["xdot_after"] - e * speed) <= 4e-16 * speed)
    # the ball is thrown in the fixed frame: a parabola from each impact to the next sample
    for impact in impacts:
        k = np.searchsorted(sol.t, impact["t"], side="right")
        if k < len(sol.t) and sol.x[k] > 0:
            tau = sol.t[k] - impact["t"]
            start, rising, _ = wall(impact["t"])
            high = start + (impact["xdot_after"] + rising) * tau - 0.5 * G * tau**2
            assert position[k] == pytest.approx(high, abs=1e-8)


def test_rest_on_a_wall_is_riding_it():
    """Until the wall falls away faster than gravity: ``w'' = -g``."""
    wall = zivi.HarmonicWall(0.3, 6.0, phase=np.pi)  # from its lowest point upwards
    sol = run(-G, wall, state=(0, 0), span=(0, 0.55))
    left = math.acos(-G / (0.3 * 36)) / 6.0  # -a w^2 cos(w t + pi) = -g
    assert sol.liftoff_times == pytest.approx([left], abs=1e-13)
    position, velocity = sol.fixed()
    riding = sol.t <= left
    np.testing.assert_allclose(position[riding], wall(sol.t[riding])[0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(velocity[riding], wall(sol.t[riding])[1], rtol=0, atol=1e-15)
    w, wdot, _ = wall(left)
    t = sol.t[~riding]
    free = w + wdot * (t - left) - 0.5 * G * (t - left) ** 2
    np.testing.assert_allclose(position[~riding], free, rtol=0, atol=1e-8)


def test_fixed_frame_without_a_wall():
    sol = run(-G)
    position, velocity = sol.fixed()
    np.testing.assert_array_equal(position, sol.x)
    np.testing.assert_array_equal(velocity, sol.xdot)


@pytest.mark.parametrize("kind", [zivi.TwistingRegulator, zivi.TwistingTracker])
@pytest.mark.parametrize("functions", [False, True], ids=["harmonic", "functions"])
def test_a_closed_loop_in_the_frame_of_the_wall(kind, functions):
    """It measures the distance from the wall, and is told the force in its frame."""
    wall = zivi.HarmonicWall(0.1, 4.0, phase=0.3)
    tracks = kind is zivi.TwistingTracker
    more = {"y_ref0": (0.5, 0.0), "force_ref": -G} if tracks else {}

    def loop(force, over):
        controller = kind(30, 17, h=1e-2, e=0.5)
        system = zivi.ImpactSystem(force, e=0.5, wall=over)
        return zivi.simulate_closed_loop(system, controller, (0, 1), (1, 0.5), **more)

    moving = loop(-G, as_functions(wall) if functions else wall)
    frame = loop(in_the_frame_of(wall, gravity=G), None)
    assert moving.success
    assert len(moving.t) == len(frame.t)
    assert np.ptp(moving.u) > 1
    for name in ("x", "xdot", "u"):
        np.testing.assert_allclose(getattr(moving, name), getattr(frame, name), rtol=0, atol=1e-6)
    # the regulator brings the mass to the wall and rides on it
    assert tracks or abs(moving.x[-1]) < 1e-2


@METHODS
@pytest.mark.parametrize("name", QUIET)
def test_a_function_that_raises(method, name):
    def late(t):
        if t > 0.4:
            raise ZeroDivisionError("mine")
        return 0.0

    wall = zivi.MovingWall(**(QUIET | {name: late}))
    with pytest.raises(ZeroDivisionError, match="mine") as caught:
        run(-G, wall, state=(2, 0), method=method)
    partial = caught.value.trajectory
    assert partial.status == zivi.Status.RAISED
    assert 0.0 <= partial.t[-1] <= 0.41
    assert len(partial.x) == len(partial.t) >= 1


@METHODS
@pytest.mark.parametrize("name", QUIET)
@pytest.mark.parametrize("value", [None, "0", 1j, [0.0]], ids=str)
def test_a_function_that_returns_no_number_is_named(method, name, value):
    wall = zivi.MovingWall(**(QUIET | {name: lambda t: value}))
    with pytest.raises(TypeError, match=rf"{name}\(t\) of the wall must return a float"):
        run(-G, wall, method=method)
    with pytest.raises(TypeError, match=rf"{name}\(t\) of the wall must return a float"):
        wall(0.0)


@METHODS
def test_an_acceleration_that_is_not_finite(method):
    wall = zivi.MovingWall(**(QUIET | {"acceleration": lambda t: math.nan if t > 1 else 0.0}))
    sol = run(-G, wall, method=method)
    assert sol.status == zivi.Status.FORCE_NOT_FINITE
    assert not sol.success
    assert sol.t[-1] == pytest.approx(1, abs=2e-3)
    assert np.all(np.isfinite((sol.x, sol.xdot)))


@pytest.mark.parametrize(
    ("name", "values"),
    [("amplitude*omega^2", (1e300, 1e10)), ("omega", (1e300, 1e300)), ("omega", (1e-300, 1e200))],
)
def test_a_wall_that_vibrates_beyond_all_numbers(name, values):
    with pytest.raises(ValueError, match=f"^{re.escape(name)} must"):
        zivi.HarmonicWall(*values)
    w, wdot, wddot = zivi.HarmonicWall(1e-300, 1e150)(np.array([0.0, 1.0]))
    assert np.all(np.isfinite([w, wdot, wddot]))


@pytest.mark.parametrize("wall", [3, zivi.HarmonicWall, lambda t: 0.0, (0, 0, 0), "wall"])
def test_no_wall(wall):
    with pytest.raises(
        TypeError, match=r"wall must be None, a zivi\.HarmonicWall, a zivi\.MovingWall or"
    ):
        zivi.ImpactSystem(-G, e=0.5, wall=wall)


@pytest.mark.parametrize("name", ["amplitude", "omega", "phase", "offset"])
def test_harmonic_values_are_named(name):
    for value in (math.nan, math.inf):
        with pytest.raises(ValueError, match=rf"^{name} must be finite"):
            zivi.HarmonicWall(**({"amplitude": 0.1, "omega": 1.0} | {name: value}))
    for value in ("a", None, 1j, [0.1]):
        with pytest.raises(TypeError, match=rf"^{name} must be a real number"):
            zivi.HarmonicWall(**({"amplitude": 0.1, "omega": 1.0} | {name: value}))


@pytest.mark.parametrize("name", QUIET)
def test_functions_are_named(name):
    with pytest.raises(TypeError, match=rf"^{name} must be a function of time"):
        zivi.MovingWall(**(QUIET | {name: 3.0}))


def test_a_wall_can_be_asked():
    wall = zivi.HarmonicWall(0.3, 2.0, phase=0.4, offset=1.0)
    times = np.linspace(-3, 3, 41).reshape(1, 41)
    for mine, functions in zip(wall(times), as_functions(wall)(times), strict=True):
        assert mine.shape == functions.shape == times.shape
        np.testing.assert_array_equal(mine, functions)
    step = 1e-5
    for k in range(2):
        slope = (wall(times + step)[k] - wall(times - step)[k]) / (2 * step)
        np.testing.assert_allclose(slope, wall(times)[k + 1], rtol=0, atol=1e-9)
    for t in ("a", None, 1j):
        with pytest.raises(TypeError, match=r"^t must hold real numbers"):
            wall(t)
