"""Laws of every run of SwitchedRK, its counts and budgets, bad input and interruption."""

import copy
import ctypes
import math
import os
import pickle
import signal
import sys
from operator import attrgetter

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

import zivi

G = 9.81
BALL = zivi.ImpactSystem(-G, e=0.5)
TABLE = zivi.LinearForce(gravity=G, amplitude=14.715, omega=2 * np.pi, phase=-np.pi / 2)
ORDER = st.sampled_from([8, 5, "series"])
"""Of the Runge-Kutta pair, or flights by power series."""
TOLERANCE = st.sampled_from([1e-5, 1e-8, 1e-11])
RESTITUTION = st.one_of(st.just(0.0), st.floats(0.05, 0.9), st.just(1.0))
# whole millimetres: what is below the tolerances is looked at elsewhere
DISTANCE = st.integers(0, 2000).map(lambda n: n * 1e-3)
VELOCITY = st.integers(-4000, 4000).map(lambda n: n * 1e-3)
FORCE = st.builds(
    zivi.LinearForce,
    stiffness=st.sampled_from([0.0, 1.0, 30.0]),
    damping=st.sampled_from([0.0, 0.1, 1.0]),
    gravity=st.floats(0.5, 12),
    amplitude=st.floats(0, 20),
    omega=st.floats(0.5, 8),
    phase=st.floats(-3, 3),
)
PULL = st.builds(
    zivi.LinearForce, stiffness=st.sampled_from([0.0, 1.0, 30.0]), gravity=st.floats(0.5, 12)
)
COLUMNS = (
    "t",
    "x",
    "xdot",
    "transformed.s",
    "transformed.v",
    "transformed.lambda_s",
    "transformed.lambda_v",
    "residual",
)


def simulate(force, e, span, state, *, tol=1e-9, atol=None, order=8, **more):
    settings = {
        name: more.pop(name)
        for name in ("max_step", "first_step", "max_steps", "max_impacts")
        if name in more
    }
    flights = {"flights": "series"} if order == "series" else {"flights": "rk", "order": order}
    atol = tol if atol is None else atol
    method = zivi.SwitchedRK(rtol=tol, atol=atol, **flights, **settings)
    return zivi.simulate(zivi.ImpactSystem(force, e=e), span, state, method=method, **more)


# laws of every run


@given(force=FORCE, e=RESTITUTION, x0=DISTANCE, xdot0=VELOCITY, order=ORDER, tol=TOLERANCE)
def test_every_run(force, e, x0, xdot0, order, tol):
    """What samples and events have in common, whatever happens."""
    assume(not (e == 1.0 and force.damping))  # impacts would grow denser without an end
    sol = simulate(force, e, (0, 4), (x0, xdot0), tol=tol, order=order)
    assert sol.success, sol.message
    assert (sol.t[0], sol.t[-1]) == (0.0, 4.0)
    assert np.all(np.diff(sol.t) > 0)
    assert len({len(attrgetter(name)(sol)) for name in COLUMNS}) == 1
    assert np.all(sol.x >= 0)
    assert np.all(sol.xdot[sol.x == 0] >= 0), "on the wall the velocity is the one after"
    x, _ = sol(np.linspace(0, 4, 500))
    assert np.all(x >= 0)

    impacts = sol.impacts_down_to(1e-6)
    assert np.all(np.diff(impacts["t"]) >= 0)
    assert np.all(impacts["xdot_before"] < 0)
    speed = -impacts["xdot_before"]
    # kappa is what is kept: e is known to 1e-16, not to 1e-16 of itself
    assert np.all(np.abs(impacts["xdot_after"] - e * speed) <= 4e-16 * speed)

    # rest and flight alternate, and rest is exact
    turns = np.concatenate([sol.zeno_times, sol.liftoff_times])
    kinds = np.concatenate([np.ones(len(sol.zeno_times)), np.zeros(len(sol.liftoff_times))])
    kinds = kinds[np.argsort(turns, kind="stable")]
    assert np.all(np.diff(kinds) != 0)
    assert (sol.rest_time is not None) == (len(kinds) > 0 and kinds[-1] == 1) or x0 == 0
    for start in sol.zeno_times:
        later = sol.liftoff_times[sol.liftoff_times > start]
        end = later[0] if len(later) else 4.0
        assert not sol(np.linspace(start, end, 5)).any()

    # the transform: a branch changes at each impact, and there is no inclusion to leave a residual
    np.testing.assert_array_equal(np.abs(sol.transformed.s), sol.x)
    assert np.all(np.isnan(sol.residual[1:]))
    for n in range(1, len(sol.resolved_impacts)):
        between = (sol.t > sol.resolved_impacts["t"][n - 1]) & (
            sol.t < sol.resolved_impacts["t"][n]
        )
        assert len(np.unique(np.sign(sol.transformed.s[between & (sol.x > 0)]))) <= 1


@given(force=PULL, e=RESTITUTION, x0=DISTANCE, xdot0=VELOCITY, order=ORDER, tol=TOLERANCE)
def test_energy_never_increases(force, e, x0, xdot0, order, tol):
    """A conservative force: kept in flight, lost at impacts, to the tolerance."""
    sol = simulate(force, e, (0, 4), (x0, xdot0), tol=tol, order=order)

    def energy(x, xdot):
        return 0.5 * xdot**2 + force.gravity * x + 0.5 * force.stiffness * x**2

    energies = energy(sol.x, sol.xdot)
    rises = np.diff(energies)
    assert np.all(rises < 100 * tol * (1 + energies[0]))
    impacts = sol.resolved_impacts[
        sol.resolved_impacts["t"] > 0
    ]  # the first sample is after one at the start
    lost = energy(0, impacts["xdot_before"]) - energy(0, impacts["xdot_after"])
    if e == 1.0:
        assert energies[-1] == pytest.approx(energies[0], rel=1e3 * tol, abs=1e3 * tol)
    elif not len(sol.zeno_times):
        assert energies[0] - energies[-1] == pytest.approx(lost.sum(), rel=1e3 * tol, abs=1e3 * tol)


@given(
    e=RESTITUTION,
    x0=DISTANCE,
    xdot0=VELOCITY,
    gravity=st.floats(0.5, 12),
    k=st.sampled_from([0.0, 2.0]),
    power=st.integers(-8, 8),
    order=ORDER,
)
def test_scaling_of_length(e, x0, xdot0, gravity, k, power, order):
    """x -> L x with atol -> L atol maps runs to runs; a time is not scaled with its tolerance."""
    scale = 2.0**power
    force = zivi.LinearForce(gravity=gravity, stiffness=k, amplitude=3.0, omega=2.0)
    large = zivi.LinearForce(gravity=gravity * scale, stiffness=k, amplitude=3.0 * scale, omega=2.0)
    one = simulate(force, e, (0, 3), (x0, xdot0), tol=1e-8, order=order)
    other = simulate(
        large, e, (0, 3), (x0 * scale, xdot0 * scale), tol=1e-8, atol=1e-8 * scale, order=order
    )
    assert len(other.zeno_times) == len(one.zeno_times)
    np.testing.assert_allclose(other.zeno_times, one.zeno_times, rtol=0, atol=1e-6)
    n = min(len(one.resolved_impacts), len(other.resolved_impacts))
    assert n >= min(len(one.resolved_impacts), 3)
    np.testing.assert_allclose(
        other.resolved_impacts["t"][:3], one.resolved_impacts["t"][:3], rtol=0, atol=1e-6
    )
    assert other.x[-1] == pytest.approx(one.x[-1] * scale, abs=1e-5 * scale)


@given(force=PULL, e=st.floats(0.1, 0.9), x0=DISTANCE, xdot0=VELOCITY, time=st.floats(0.1, 10))
def test_scaling_of_time(force, e, x0, xdot0, time):
    """t -> T t: not to the bit, the tolerances of x and x' scale differently."""
    slow = zivi.LinearForce(stiffness=force.stiffness / time**2, gravity=force.gravity / time**2)
    one = simulate(force, e, (0, 3), (x0, xdot0), tol=1e-12)
    other = simulate(slow, e, (0, 3 * time), (x0, xdot0 / time), tol=1e-12)
    assert len(one.zeno_times) == len(other.zeno_times)
    np.testing.assert_allclose(other.zeno_times, one.zeno_times * time, rtol=1e-9)
    n = min(len(one.resolved_impacts), len(other.resolved_impacts), 5)
    np.testing.assert_allclose(
        other.resolved_impacts["t"][:n], one.resolved_impacts["t"][:n] * time, rtol=1e-9
    )


@given(force=FORCE, e=RESTITUTION, x0=DISTANCE, xdot0=VELOCITY, shift=st.integers(-9, 9))
def test_shift_of_time(force, e, x0, xdot0, shift):
    """The same motion a whole number of periods later, to rounding of the angle."""
    assume(not (e == 1.0 and force.damping))
    force = zivi.LinearForce(
        stiffness=force.stiffness, damping=force.damping, gravity=G, amplitude=5.0, omega=np.pi
    )
    later = 2.0 * shift
    one = simulate(force, e, (0, 3), (x0, xdot0))
    other = simulate(force, e, (later, 3 + later), (x0, xdot0))
    assert len(one.zeno_times) == len(other.zeno_times)
    np.testing.assert_allclose(other.zeno_times - later, one.zeno_times, atol=1e-7)


@given(
    force=PULL,
    e=st.floats(0.1, 0.9),
    x0=DISTANCE,
    xdot0=VELOCITY,
    cut=st.floats(0.01, 2.99),
    order=ORDER,
)
def test_two_runs_are_one(force, e, x0, xdot0, cut, order):
    """Within what the second run begins with: an error of the tolerance, and what a slow impact
    makes of it."""
    whole = simulate(force, e, (0, 3), (x0, xdot0), tol=1e-11, order=order)
    first = simulate(force, e, (0, cut), (x0, xdot0), tol=1e-11, order=order)
    second = simulate(force, e, (cut, 3), (first.x[-1], first.xdot[-1]), tol=1e-11, order=order)
    assert len(first.zeno_times) + len(second.zeno_times) >= len(whole.zeno_times)
    assert (whole.rest_time is None) == (second.rest_time is None)
    assert second.x[-1] == pytest.approx(whole.x[-1], abs=1e-8)
    if whole.rest_time is not None and whole.rest_time > cut:
        assert second.rest_time == pytest.approx(whole.rest_time, abs=1e-8)
    impacts = np.concatenate([first.impacts_down_to(1e-3), second.impacts_down_to(1e-3)])
    expected = whole.impacts_down_to(1e-3)
    if np.min(np.abs(expected["t"] - cut), initial=1.0) > 1e-6 and x0 > 0:
        near = np.abs(expected["xdot_after"] - 1e-3) < 1e-6
        assert abs(len(impacts) - len(expected)) <= near.sum()


@pytest.mark.parametrize("order", [8, 5])
@pytest.mark.parametrize("dense", [True, False])
@pytest.mark.parametrize("watched", [True, False])
def test_evaluations_are_those_of_the_force(order, dense, watched):
    calls = 0

    def force(t, x, xdot):
        nonlocal calls
        calls += 1
        return TABLE(t, x, xdot)

    events = [lambda t, x, xdot: xdot] if watched else None
    sol = simulate(force, 0.5, (0, 8), (0.2, 0), order=order, dense_output=dense, events=events)
    assert sol.nfev == calls
    assert len(sol.liftoff_times) > 3
    compiled = simulate(
        TABLE, 0.5, (0, 8), (0.2, 0), order=order, dense_output=dense, events=events
    )
    np.testing.assert_allclose(compiled.x, sol.x, rtol=0, atol=1e-12)
    # the looks for pulses at rest are left out: a harmonic has none
    assert 0 < calls - compiled.nfev < 100 * len(sol.liftoff_times)
    stages = {8: 11, 5: 6}[order]
    assert calls > stages * (sol.n_steps + sol.n_rejected)


def test_compiled_forces_are_the_same():
    """A number, a LinearForce, a callable, a C function: one motion."""
    signature = ctypes.CFUNCTYPE(ctypes.c_double, *[ctypes.c_double] * 3)
    forces = [
        -G,
        zivi.LinearForce(gravity=G),
        lambda t, x, xdot: -G,
        lambda t, x, xdot: -G + 0.0 * t,
        signature(lambda t, x, xdot: -G),
    ]
    first, linear, plain, timed, compiled = [simulate(it, 0.5, (0, 3), (1, 0)) for it in forces]
    for one, other in [(first, linear), (timed, compiled)]:
        np.testing.assert_array_equal(other.x, one.x)
        np.testing.assert_array_equal(other.zeno_times, one.zeno_times)
    # where other steps are taken, and impacts from the dense output
    np.testing.assert_allclose(plain(first.t)[0], first.x, rtol=0, atol=1e-14)
    np.testing.assert_allclose(timed(first.t)[0], first.x, rtol=0, atol=1e-14)
    for run in (plain, timed):
        np.testing.assert_allclose(run.zeno_times, first.zeno_times, rtol=1e-14)
    # at rest a force that does not depend on time is known not to change
    assert plain.nfev + 50 < timed.nfev == compiled.nfev


# restitution at its ends


@pytest.mark.parametrize("e", [0.0, 5e-324, 1e-12, 1e-6])
def test_nearly_plastic(e):
    """Rest a flight of 2 e V / g after the first impact."""
    sol = simulate(-G, e, (0, 2), (1, 0))
    speed = math.sqrt(2 * G)
    assert sol.zeno_times == pytest.approx([speed / G + 2 * e * speed / G / (1 - e)], abs=1e-14)
    assert sol.resolved_impacts["t"][0] == pytest.approx(speed / G, abs=1e-14)
    assert sol.resolved_impacts["xdot_before"][0] == pytest.approx(-speed, abs=1e-13)


@pytest.mark.parametrize("e", [0.99, 0.999, 0.9999])
@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_nearly_elastic(e, damping):
    """Long accumulations: the Zeno time is that of the closed form or of a run without jumps."""
    force = zivi.LinearForce(gravity=G, damping=damping)
    span = (0, 4 * math.sqrt(2 / G) / (1 - e))
    sol = simulate(force, e, span, (1, 0), tol=1e-8)
    assert sol.success
    assert len(sol.zeno_times) == 1
    if damping == 0.0:
        speed = math.sqrt(2 * G)
        expected = speed / G + 2 * e * speed / G / (1 - e)
        assert sol.zeno_times[0] == pytest.approx(expected, rel=1e-9)
    else:
        better = simulate(force, e, span, (1, 0), tol=1e-12)
        # measured: errors of 300 tolerances at e = 0.9999 after 2000 impacts
        assert sol.zeno_times[0] == pytest.approx(better.zeno_times[0], rel=1e-5)


def test_elastic():
    """A ball comes back to its height for ever."""
    sol = simulate(-G, 1.0, (0, 100), (1, 0), tol=1e-10)
    flight = 2 * math.sqrt(2 / G)
    assert len(sol.zeno_times) == 0
    assert len(sol.resolved_impacts) == int(100 / flight + 0.5)
    np.testing.assert_allclose(np.diff(sol.resolved_impacts["t"]), flight, rtol=0, atol=1e-11)
    np.testing.assert_allclose(sol.resolved_impacts["xdot_after"], math.sqrt(2 * G), rtol=1e-11)


# budgets


@pytest.mark.parametrize("order", [8, 5])
@pytest.mark.parametrize("most", [1, 2, 7, 30])
def test_a_run_out_of_steps_can_be_resumed(order, most):
    """It ends with its status and a valid state; a run from there has the same end."""
    whole = simulate(TABLE, 0.5, (0, 9.6), (0.2, 0), order=order)
    part = simulate(TABLE, 0.5, (0, 9.6), (0.2, 0), order=order, max_steps=most)
    assert part.status == zivi.Status.STEP_BUDGET
    assert not part.success
    assert "max_steps" in part.message
    # a step that is repeated onto its impact is counted twice
    assert most - len(part.resolved_impacts) <= part.n_steps + part.n_rejected <= most
    assert part.t[-1] < 9.6
    assert np.all(part.resolved_impacts["t"] <= part.t[-1])
    x, xdot = whole(part.t[-1])
    assert (part.x[-1], part.xdot[-1]) == (
        pytest.approx(x, abs=1e-7),
        pytest.approx(xdot, abs=1e-6),
    )
    rest = simulate(TABLE, 0.5, (part.t[-1], 9.6), (part.x[-1], part.xdot[-1]), order=order)
    assert rest.x[-1] == pytest.approx(whole.x[-1], abs=1e-7)
    assert rest.zeno_times[-1] == pytest.approx(whole.zeno_times[-1], abs=1e-7)


@pytest.mark.parametrize("most", [3, 10, 40])
def test_a_run_out_of_impacts_can_be_resumed(most):
    force, e, end = zivi.LinearForce(gravity=G, damping=0.3), 0.95, 30.0
    whole = simulate(force, e, (0, end), (1, 0))
    t, state, impacts, runs = 0.0, (1.0, 0.0), 0, 0
    while t < end:
        part = simulate(force, e, (t, end), state, max_impacts=most)
        t, state = part.t[-1], (part.x[-1], part.xdot[-1])
        runs += 1
        impacts += len(part.resolved_impacts)
        if part.status == zivi.Status.COMPLETED:
            break
        assert part.status == zivi.Status.ZENO_BUDGET
        assert "max_impacts" in part.message
        assert part.x[-1] == 0.0 < part.xdot[-1]
        assert len(part.resolved_impacts) <= most + 1
    assert 1 < runs <= 200
    assert part.zeno_times[-1] == pytest.approx(whole.zeno_times[0], abs=1e-6)


def test_enough_impacts_are_no_budget():
    sol = simulate(zivi.LinearForce(gravity=G, damping=0.3), 0.95, (0, 30), (1, 0))
    enough = len(sol.resolved_impacts)
    again = simulate(
        zivi.LinearForce(gravity=G, damping=0.3), 0.95, (0, 30), (1, 0), max_impacts=enough + 1
    )
    np.testing.assert_array_equal(again.t, sol.t)


def test_steps_as_asked():
    """max_step bounds every step in flight, first_step is the first one."""
    sol = simulate(TABLE, 0.5, (0, 3), (2, 0), max_step=0.01, samples="steps")
    flying = (sol.x[1:] > 0) & (sol.x[:-1] > 0)
    assert np.diff(sol.t)[flying].max() <= 0.01 * (1 + 1e-12)
    assert simulate(-G, 0.5, (0, 3), (1, 0), first_step=0.05, samples="steps").t[1] == 0.05
    small = simulate(-G, 0.5, (0, 3), (1, 0), first_step=1e-8, samples="steps")
    assert small.t[1] == 1e-8
    assert small.zeno_times == pytest.approx([3 * math.sqrt(2 / G)], abs=1e-12)


# failures


def test_a_force_that_fails_later():
    def nan_later(t, x, xdot):
        return math.nan if t > 0.3 else -G

    sol = simulate(nan_later, 0.5, (0, 1), (1, 0))
    assert sol.status == zivi.Status.FORCE_NOT_FINITE
    # up to the discontinuity, to the smallest step
    assert sol.t[-1] == pytest.approx(0.3, abs=1e-9)
    assert sol.x[-1] == pytest.approx(1 - 0.5 * G * sol.t[-1] ** 2, abs=1e-12)
    assert np.all(np.isfinite(sol(np.linspace(0, sol.t[-1], 10))))


def test_a_singular_force():
    sol = simulate(lambda t, x, xdot: x * x + 1.0, 0.5, (0, 3), (1, 0))
    assert sol.status in (
        zivi.Status.STEP_SIZE_TOO_SMALL,
        zivi.Status.STATE_NOT_FINITE,
        zivi.Status.FORCE_NOT_FINITE,
    )
    assert 2 < sol.t[-1] < 3
    assert np.all(np.isfinite(sol.x))


class MyError(Exception):
    pass


@pytest.mark.parametrize("at", [-1.0, 0.2, 0.7, 1.5])
@pytest.mark.parametrize("t_eval", [None, [], [0.01, 2.5]])
@pytest.mark.parametrize("dense", [True, False])
def test_a_force_that_raises(at, t_eval, dense):
    """At the start, in flight, in the accumulation and at rest; whatever is reported."""

    def force(t, x, xdot):
        if t > at:
            raise MyError
        return -G

    with pytest.raises(MyError) as caught:
        simulate(force, 0.5, (0, 3), (1, 0), t_eval=t_eval, dense_output=dense, max_step=0.05)
    part = caught.value.trajectory
    assert part.status == zivi.Status.RAISED
    assert len(part.t) == len(part.x)
    assert any("the run stopped" in note for note in caught.value.__notes__)
    if t_eval is None:
        assert max(0.0, at - 0.3) <= part.t[-1] <= max(at, 0.0)


@pytest.mark.parametrize("value", [None, "1", 1j, [1.0], np.zeros(2), 10**400], ids=str)
def test_a_force_that_returns_no_float(value):
    with pytest.raises(TypeError, match=r"force\(t, x, xdot\) must return a float"):
        simulate(lambda t, x, xdot: value, 0.5, (0, 1), (1, 0))


def test_a_raising_run_is_freed():
    """The exception, its frames and the record of the run do not keep one another alive."""
    import gc
    import weakref

    class Force:
        def __call__(self, t, x, xdot):
            raise MyError

    for method in (zivi.SwitchedRK(), zivi.ThetaGamma(h=0.1)):
        force = Force()
        gone = weakref.ref(force)
        with pytest.raises(MyError):
            zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 1), (1, 0), method=method)
        del force
        gc.collect()
        assert gone() is None


@pytest.mark.skipif(os.name != "posix", reason="sets a timer")
@pytest.mark.parametrize("force", [-G, TABLE, lambda t, x, xdot: -G])
@pytest.mark.parametrize("watched", [False, True])
def test_an_interrupt_stops_the_run(force, watched):
    """A signal is looked at, as Ctrl-C is, and what was computed is handed over."""

    def stop(*_):
        raise KeyboardInterrupt

    events = (lambda t, x, xdot: xdot) if watched else None
    e = 1.0 if force is not TABLE else 0.5
    before = signal.signal(signal.SIGALRM, stop)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        with pytest.raises(KeyboardInterrupt) as caught:
            simulate(
                force, e, (0, 1e8), (1, 0), max_steps=10**12, events=events, dense_output=False
            )
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    part = caught.value.trajectory
    assert part.status == zivi.Status.RAISED
    assert len(part.t) > 10
    assert len(part.resolved_impacts) > 10
    assert np.all(np.diff(part.t) > 0)


def test_progress_is_told_as_parts_of_the_span(monkeypatch):
    """Ascending, to the whole; the result does not depend on it."""
    seen = []

    class Recorder(zivi.base.progress.ProgressBar):
        @property
        def report(self):
            return lambda done, of: seen.append(done / of)

    plain = simulate(TABLE, 0.5, (0, 5000), (0.2, 0), progress=False)
    monkeypatch.setattr(sys.modules["zivi.simulation.run"], "ProgressBar", Recorder)
    told = simulate(TABLE, 0.5, (0, 5000), (0.2, 0), progress=True)
    np.testing.assert_array_equal(told.x, plain.x)
    assert told.nfev == plain.nfev
    assert len(seen) > 3
    assert seen == sorted(set(seen))
    assert 0 < seen[0] < 0.5
    assert seen[-1] == 1


# bad input


SETTINGS = {
    "rtol": [0, -1, 1, 2.0, 9e-15, math.nan, math.inf, True, 10**400],
    "atol": [0, -1e-9, math.nan, math.inf, 10**400],
    "order": [0, 4, 7, 10**30, -8],
    "max_step": [0, -1, math.nan, -math.inf],
    "first_step": [0, -1, math.nan, math.inf],
    "max_steps": [0, -1, 10**30],
    "max_impacts": [2, 0, -5, 10**30],
    "flights": ["RK", "", "rk8", None, 1],
}
KINDS = {
    "rtol": ["a", None, 1j, [1e-6]],
    "atol": ["a", None, 1j, np.array([1e-6])],
    "order": [8.0, "8", None, True],
    "max_step": ["a", None, 1j],
    "first_step": ["a", 1j, [1]],
    "max_steps": [1.5, None, True, "9"],
    "max_impacts": [1e5, None, False],
}


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [(name, value, ValueError) for name, values in SETTINGS.items() for value in values]
    + [(name, value, TypeError) for name, values in KINDS.items() for value in values],
)
def test_settings_are_named(name, value, error):
    with pytest.raises(error, match=rf"(?<![\w.]){name} must"):
        zivi.SwitchedRK(**{name: value})


def test_settings_of_all_kinds():
    method = zivi.SwitchedRK(
        rtol=np.float64(1e-6),
        atol=1,
        order=np.int64(5),
        max_step=np.float32(0.5),
        first_step=1,
        max_steps=np.int32(5),
    )
    assert (method.order, method.max_step, method.first_step) == (5, 0.5, 1.0)
    assert zivi.SwitchedRK() == zivi.SwitchedRK(1e-6, 1e-9, 8)
    assert hash(zivi.SwitchedRK()) == hash(zivi.SwitchedRK())
    assert pickle.loads(pickle.dumps(method)) == copy.deepcopy(method) == method
    with pytest.raises(AttributeError):
        method.rtol = 1e-3
    with pytest.raises(TypeError):
        zivi.SwitchedRK(tol=1e-3)


@pytest.mark.parametrize(
    ("arguments", "error", "name"),
    [
        *(
            ({"t_eval": v}, ValueError, "t_eval")
            for v in ([1, 0], [0, 4], [-1e-9], [math.nan], [[0.5]], 0.5, [1, 1])
        ),
        *(({"t_eval": v}, TypeError, "t_eval") for v in ("ab", [1j], [None], [[1], [1, 2]])),
        *(
            ({"dense_output": v}, TypeError, "dense_output must be True or False")
            for v in (None, 0, 1, "no")
        ),
        *(({"t_span": v}, ValueError, "t_span") for v in ((0, 0), (1, 0), (0, math.inf))),
        *(({"t_span": v}, TypeError, "t_span") for v in (1, (0,), (0, 1, 2), "ab")),
        *(({"y0": v}, ValueError, "x") for v in ((-1e-300, 0), (math.nan, 0), (0, math.inf))),
        *(({"y0": v}, TypeError, "y0") for v in (1, (0,), (0, None), "ab")),
        *(({"method": v}, TypeError, "method") for v in (8, "RK45", zivi.SwitchedRK, None)),
        ({"system": -G}, TypeError, "system"),
    ],
)
def test_arguments_are_named(arguments, error, name):
    calls = []

    def force(t, x, xdot):
        calls.append(t)
        return -G

    given = {"system": zivi.ImpactSystem(force, e=0.5), "t_span": (0, 3), "y0": (1, 0)}
    with pytest.raises(error, match=rf"(?<![\w.]){name}"):
        zivi.simulate(**(given | arguments))
    assert calls == [], "nothing is computed before"


@pytest.mark.parametrize("force", [-1e-200, -1e-300, 5e-324, 1e-160])
@pytest.mark.parametrize("order", [8, 5])
def test_forces_that_hardly_act(force, order):
    """Squares of errors underflow."""
    sol = simulate(force, 0.5, (0, 3), (1, -0.2), order=order)
    assert sol.success
    assert sol.n_steps < 20
    assert (sol.x[-1], sol.xdot[-1]) == (pytest.approx(0.4, abs=1e-15), -0.2)


def test_tolerances_that_ask_for_nothing():
    for order in (8, 5):
        sol = simulate(-G, 0.5, (0, 3), (1, 0), tol=0.9, atol=1e300, order=order)
        assert sol.success
        assert sol.n_steps < 50


@pytest.mark.parametrize(
    "span", [(0, 5e-324), (0, 1e-300), (1, 1 + 2**-52), (1e15, 1e15 + 4), (0, 1e300)]
)
def test_spans_of_all_lengths(span):
    sol = zivi.simulate(BALL, span, (1, 0))
    assert sol.success
    assert (sol.t[0], sol.t[-1]) == span


@pytest.mark.parametrize(
    "state",
    [(0, 0), (0.0, -1.0), (0, 1), (1e-16, 1e-16), (1e-12, 0), (1e-40, 0), (1e-30, 1e-20)],
)
def test_starts_at_the_wall(state):
    sol = zivi.simulate(BALL, (0, 3), state)
    speed = math.sqrt(state[1] ** 2 + 2 * G * state[0])
    first = (state[1] + speed) / G
    assert sol.success
    assert sol.rest_time == pytest.approx(first + 2 * 0.5 * speed / (G * 0.5), rel=1e-9)
    assert len(sol.zeno_times) == any(state)


def test_the_default_method():
    sol = zivi.simulate(BALL, (0, 3), (1, 0))
    assert sol.config["method"]["name"] == "SwitchedRK"
    assert sol.config["method"]["order"] == 8
    assert sol.zeno_times == pytest.approx([3 * math.sqrt(2 / G)], abs=1e-12)


@pytest.mark.parametrize(
    "method", [zivi.SwitchedRK(), zivi.ThetaGamma(1e-3), zivi.MoreauJean(1e-3)]
)
@pytest.mark.parametrize("e", [1e-15, 1e-9, 1.0 / 3.0])
def test_impacts_have_the_ratio_that_was_given(method, e):
    # e = 1e-15 is lost in kappa = 1 - 2e-15
    sol = zivi.simulate(zivi.ImpactSystem(-9.81, e=e), (0, 0.6), (1, 0), method)
    ratio = -sol.resolved_impacts["xdot_after"] / sol.resolved_impacts["xdot_before"]
    assert len(ratio)
    assert np.all(np.abs(ratio / e - 1.0) < 1e-15)
