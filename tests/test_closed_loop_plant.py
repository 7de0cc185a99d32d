"""The plant between samples: its motion under a held control, and what happens at the wall."""

import numpy as np
import pytest
import scipy.integrate
from hypothesis import assume, given, settings, strategies as st

import zivi
from closed_form import Ball
from control_loops import Scripted, follow, loop


def speed_through_impacts(xdot, e):
    """|v| of the lifted state up to a factor: continuous where an impact falls onto a sample."""
    return np.where(xdot < 0, -e * xdot, xdot)


@settings(max_examples=200)
@given(
    e=st.sampled_from([0.0, 0.1, 0.5, 0.8, 0.95, 1.0]),
    f=st.sampled_from([-9.81, 0.0, 2.0]),
    x0=st.sampled_from([0.0, 0.05, 1.0]),
    xdot0=st.sampled_from([-3.0, 0.0, 2.5]),
    h=st.sampled_from([0.01, 0.1, 0.7]),
    seed=st.integers(0, 10**6),
    # accelerations: free, onto the wall, away from it, none
    kinds=st.lists(st.sampled_from("fdun"), min_size=1, max_size=12),
)
def test_the_motion_is_exact_under_any_held_control(e, f, x0, xdot0, h, seed, kinds):
    """Against flights by closed form, one by one: impacts, Zeno points, rest and lift-off.

    Tolerance: rounding of each flight (1e-16) times the number of flights and the growth of speeds.
    """
    rng = np.random.default_rng(seed)
    size = {"f": 0.0, "d": -rng.uniform(1, 30), "u": rng.uniform(1, 15), "n": -f}
    controls = [size[kind] for kind in kinds]
    (x, xdot), flights = follow(controls, h, x0, xdot0, e=e, f=f)
    assume(len(flights.impacts) < 900)
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(f, e=e), Scripted(controls, h), (0, len(controls) * h), (x0, xdot0)
    )
    assert run.success
    assert len(run.t) == len(controls) + 1
    np.testing.assert_array_equal(run.u[:-1], controls)
    np.testing.assert_allclose(run.x, x, rtol=1e-9, atol=1e-9)
    e_run = run.config["e"]
    seen = speed_through_impacts(run.xdot, e_run)
    np.testing.assert_allclose(seen, speed_through_impacts(xdot, e), rtol=1e-8, atol=2e-7)
    # impacts faster than 0.1 mm/s: where an accumulation breaks off is no property of the motion
    clear = np.array([impact[:2] for impact in flights.impacts if impact[1] < -1e-4])
    before = run.resolved_impacts["xdot_before"]
    found = run.resolved_impacts[before < -1e-4]
    assert len(found) == len(clear)
    if len(found):
        np.testing.assert_allclose(found["t"], clear[:, 0], rtol=0, atol=1e-7)
        np.testing.assert_allclose(found["xdot_before"], clear[:, 1], rtol=1e-7, atol=0)
    np.testing.assert_allclose(
        run.resolved_impacts["xdot_after"], -e_run * before, rtol=1e-15, atol=0
    )
    np.testing.assert_allclose(run.zeno_times, flights.zeno_times, rtol=0, atol=1e-7)
    np.testing.assert_allclose(run.liftoff_times, flights.liftoff_times, rtol=0, atol=1e-7)
    # a rest counts once it has lasted a period
    rested = 0.0 if flights.rest_since is None else run.t[-1] - flights.rest_since
    if rested < h - 1e-7:
        assert run.rest_time is None
    elif rested > h + 1e-7:
        assert abs(run.rest_time - flights.rest_since) <= 1e-7
    assert np.all(run.x >= 0)


def integrate(force, controls, h, x0, xdot0, e):
    """SciPy's DOP853 from impact to impact, at 1e-12."""

    def contact(t, y, u):
        return y[0]

    contact.terminal, contact.direction = True, -1
    t, y, states, impacts = 0.0, [x0, xdot0], [(x0, xdot0)], []
    for k, u in enumerate(controls):
        while t < (k + 1) * h:
            sol = scipy.integrate.solve_ivp(
                lambda t, y, u: [y[1], force(t, *y) + u],
                (t, (k + 1) * h),
                y,
                "DOP853",
                args=(u,),
                events=contact,
                rtol=1e-12,
                atol=1e-14,
            )
            t, y = sol.t[-1], sol.y[:, -1].tolist()
            if sol.status == 1:
                impacts.append((t, y[1]))
                y = [1e-15, -e * y[1]]
        states.append(tuple(y))
    return np.transpose(states), np.array(impacts)


@pytest.mark.parametrize(
    ("force", "tolerance"),
    [
        # exact motion: what is left is SciPy's
        (-9.81, 1e-8),
        # the default between samples is SwitchedRK at 1e-9 a step
        (zivi.LinearForce(gravity=9.81, stiffness=4.0, damping=0.3), 1e-6),
        (lambda t, x, xdot: -9.81 + 2 * np.sin(3 * t) - 0.2 * x, 1e-6),
    ],
    ids=["constant", "linear", "callable"],
)
def test_the_plant_agrees_with_an_integrator_and_its_events(force, tolerance):
    def plain(t, x, xdot):
        if callable(force) and not isinstance(force, zivi.LinearForce):
            return force(t, x, xdot)
        if isinstance(force, zivi.LinearForce):
            return -4.0 * x - 0.3 * xdot - 9.81
        return force

    controls = [0.0, -12.0, 6.0, 0.0, -5.0, 8.0, -1.0, 3.0]
    (x, xdot), impacts = integrate(plain, controls, 0.35, 0.6, 1.0, 0.8)
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(force, e=0.8), Scripted(controls, 0.35), (0, 2.8), (0.6, 1.0)
    )
    assert len(run.resolved_impacts) == len(impacts) >= 4
    np.testing.assert_allclose(run.x, x, rtol=0, atol=tolerance)
    np.testing.assert_allclose(run.xdot, xdot, rtol=0, atol=10 * tolerance)
    np.testing.assert_allclose(run.resolved_impacts["t"], impacts[:, 0], rtol=0, atol=tolerance)
    np.testing.assert_allclose(
        run.resolved_impacts["xdot_before"], impacts[:, 1], atol=10 * tolerance
    )


@pytest.mark.parametrize("e", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("h", [1e-2, 0.3, 5.0, 100.0])
def test_no_control_makes_the_ball(e, h):
    """Through the Zeno point, sampled often or seldom: the closed form to 1e-12."""
    ball = Ball(1.0, 2.0, e=e)
    end = max(1.5 * ball.zeno, h)
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(-9.81, e=e), Scripted([0.0], h), (0, end), (1, 2)
    )
    expected = np.array([ball.state(t) for t in run.t])
    # the tail of the accumulation: what is left of it when its flights are told no more apart
    clear = (run.t < ball.zeno - 1e-3) | (run.t > ball.zeno + 1e-3)
    np.testing.assert_allclose(run.x[clear], expected[clear, 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.xdot[clear], expected[clear, 1], rtol=0, atol=1e-10)
    assert len(run.zeno_times) == 1
    np.testing.assert_allclose(run.zeno_times, ball.zeno, rtol=1e-12)
    # a rest counts once it has lasted a period
    assert run.rest_time == (run.zeno_times[0] if end - run.zeno_times[0] >= h else None)
    assert np.all(run.x[run.t > run.zeno_times[0]] == 0)
    for n in range(12):
        t, speed = ball.impact(n)
        assert abs(run.resolved_impacts["t"][n] - t) <= 1e-12 * ball.zeno
        assert abs(run.resolved_impacts["xdot_before"][n] + speed) <= 1e-12 * ball.speed


@pytest.mark.parametrize("h", [0.01, 3.0, 400.0])
def test_an_elastic_wall_keeps_the_energy(h):
    """More than 1000 bounces in one period at the largest h: those are skipped in closed form."""
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(-9.81, e=1.0), Scripted([0.0], h), (0, max(h, 60.0)), (0.1, 0.0)
    )
    energy = run.xdot**2 / 2 + 9.81 * run.x
    # the speed is that of the start, bit by bit; the sum rounds
    np.testing.assert_allclose(energy, 0.981, rtol=1e-13)
    assert np.ptp(run.resolved_impacts["xdot_before"]) <= 1e-13
    assert run.rest_time is None
    assert len(run.resolved_impacts) == (
        1000 if h == 400 else round(60 / (2 * np.sqrt(0.2 / 9.81)))
    )


@pytest.mark.parametrize("lost", [1e-3, 1e-6, 1e-9, 1e-12, 0.0])
def test_skipped_bounces_are_those_that_were_not_taken(lost):
    """One long period against short ones: thousands of bounces on walls that are almost elastic.

    The short ones round each bounce, which moves the phase by up to 1e-12 per flight.
    """
    system = zivi.ImpactSystem(-1.0, e=1 - lost)
    long, short = (
        zivi.simulate_closed_loop(system, Scripted([0.0], h), (0, 20.0), (1e-6, 0))
        for h in (20.0, 0.1)
    )
    assert len(long.resolved_impacts) == 1000
    if lost <= 1e-6:
        assert len(short.resolved_impacts) > 7000
    speed = np.sqrt(2e-6)
    np.testing.assert_allclose(long.x[-1], short.x[-1], rtol=0, atol=1e-6 * 1e-6)
    e = system.e
    seen = speed_through_impacts(long.xdot[-1], e), speed_through_impacts(short.xdot[-1], e)
    np.testing.assert_allclose(*seen, rtol=0, atol=1e-6 * speed)


def test_a_plastic_wall_stops_at_once():
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(-2.0, e=0.0), Scripted([0, 0, 3, 0, 0, 0], 1.0), (0, 6), (1, 0)
    )
    # lifts off under 3 - 2 = 1, at 3 s in 0.5 m with 1 m/s, then down under -2
    np.testing.assert_allclose(run.resolved_impacts["t"], [1, 3 + (1 + np.sqrt(3)) / 2], rtol=1e-14)
    np.testing.assert_array_equal(run.resolved_impacts["xdot_after"], [0, 0])
    np.testing.assert_array_equal(run.liftoff_times, [2.0])
    assert run.zeno_times[0] == 1.0
    # upwards from the wall: v = x'/(1 - kappa) has no image, but the motion has
    up = zivi.simulate_closed_loop(
        zivi.ImpactSystem(-2.0, e=0.0), Scripted([0.0], 0.5), (0, 2), (0, 1)
    )
    assert abs(up.rest_time - 1.0) < 1e-15
    assert up.x[1] == 0.25


def test_rest_lift_off_and_rest_again():
    """Under 0: stays. Under +1 for a period: leaves at the sample. Then the ball's closed form."""
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(-1.0, e=0.5),
        Scripted([0, 1, 2, 0, 0, 0, 0, 0, 0, 0], 1.0),
        (0, 10),
        (0, 0),
    )
    np.testing.assert_array_equal(run.x[:3], [0, 0, 0])  # f + u = 0 does not lift
    np.testing.assert_array_equal(run.liftoff_times, [2.0])
    assert run.x[3] == 0.5
    ball = Ball(0.5, 1.0, e=0.5, g=1.0)
    np.testing.assert_allclose(run.zeno_times, [3 + ball.zeno], rtol=1e-12)
    assert run.rest_time == run.zeno_times[0]


def test_an_impact_at_the_start_and_a_start_at_rest():
    hit = loop(Scripted([0.0]), y0=(0, -3))
    assert hit.impacts[0]["t"] == 0
    assert hit.impacts[0]["xdot_before"] == -3
    assert hit.impacts[0]["xdot_after"] == pytest.approx(1)
    still = loop(Scripted([0.0]), y0=(0, 0))
    assert still.rest_time == 0
    assert len(still.impacts) == len(still.zeno_times) == 0


def test_the_plant_may_be_integrated_instead():
    exact = loop(y0=(1, 0), t_span=(0, 0.6))
    rk = loop(y0=(1, 0), t_span=(0, 0.6), method=zivi.SwitchedRK(rtol=1e-10, atol=1e-13))
    np.testing.assert_allclose(rk.x, exact.x, rtol=0, atol=1e-7)
    assert exact.nfev == 1  # a constant force is asked once


def test_the_last_period_may_be_shorter():
    run = loop(Scripted([1.0], 0.1), t_span=(2, 2.25))
    np.testing.assert_allclose(run.t, [2, 2.1, 2.2, 2.25])
    assert run.t[-1] == 2.25
    assert len(run.u) == 4
    only = loop(Scripted([1.0], 50.0), t_span=(0, 0.5), y0=(6, 5))
    np.testing.assert_array_equal(only.t, [0, 0.5])
    assert only.x[-1] == 6 + 2.5 + (1 - 9.81) / 8


def test_impacts_of_a_long_period_are_listed_down_to_the_speed_that_is_asked_for():
    """Beyond the thousand that a period keeps; each speed is e times the one before."""

    class Off:
        h = 100.0

        def step(self, x, xdot, force):
            return 0.0

    e, g = 0.99, 9.81
    first = np.sqrt(2 * g)  # from 1 m
    for slowest in (0.3, 1e-3, 1e-6):
        run = zivi.simulate_closed_loop(
            zivi.ImpactSystem(-g, e=e), Off(), (0, 100), (1, 0), slowest=slowest
        )
        # each leaves e times its speed, at least this part of what the first leaves
        n = np.arange(1, 2 + np.floor(np.log(slowest) / np.log(e)))
        assert len(run.impacts) == len(n)
        np.testing.assert_allclose(run.impacts["xdot_after"], first * e**n, rtol=1e-9)
        # the sum of the flights 2 v e^n/g
        times = first / g + 2 * first / g * e * (1 - e ** (n - 1)) / (1 - e)
        np.testing.assert_allclose(run.impacts["t"], times, rtol=1e-12)
