"""Forces that do not depend on time: longer first steps, and impacts by integrated residuals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import zivi

G, E = 9.81, 0.5
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8, 3e-9, 1e-9)


def drag(_, x, xdot):
    return -G - 0.1 * xdot


def spring(_, x, xdot):
    return -G - 2.0 * x - 0.3 * xdot


def stiff_spring(_, x, xdot):
    return -G - 10.0 * x - xdot


FORCES = {drag: (0.0, 0.1), spring: (2.0, 0.3), stiff_spring: (10.0, 1.0)}


def timed(force):
    """Give the same force, of which nothing says that it does not depend on time."""
    return lambda t, x, xdot: force(t, x, xdot) + 0.0 * t


def flight(stiffness, damping, x, xdot):
    """Solve ``x'' = -g - k x - c x'``: position and velocity after a time."""
    half = damping / 2
    if stiffness == 0.0:
        # x' = -g/c + (x'_0 + g/c) exp(-c t)
        fall, start = G / damping, xdot + G / damping

        def at(t):
            decay = -math.expm1(-damping * t)
            return x - fall * t + start * decay / damping, xdot - start * decay

        return at
    rest, omega = -G / stiffness, math.sqrt(stiffness - half * half)
    a, b = x - rest, (xdot + half * (x - rest)) / omega

    def at(t):
        decay, c, s = math.exp(-half * t), math.cos(omega * t), math.sin(omega * t)
        position = decay * (a * c + b * s)
        return rest + position, -half * position + omega * decay * (b * c - a * s)

    return at


def impacts(law, count):
    """Times of impacts and speeds before them in closed form."""
    t, x, xdot, found = 0.0, 1.0, 0.0, []
    for _ in range(count):
        at = flight(*law, x, xdot)
        upper = 1.1 * (xdot + math.sqrt(xdot * xdot + 2 * G * x)) / G
        lower = 1e-3 * upper if x == 0.0 else 0.0
        length = brentq(lambda s, at=at: at(s)[0], lower, upper, xtol=1e-16, rtol=1e-15)
        t, incoming = t + length, at(length)[1]
        found.append((t, -incoming))
        x, xdot = 0.0, -E * incoming
    return np.array(found).T


def simulate(force, tolerance, **options):
    method = zivi.SwitchedRK(rtol=tolerance, atol=tolerance)
    return zivi.simulate(zivi.ImpactSystem(force, e=E), (0, 4), (1, 0), method, **options)


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("force", FORCES)
def test_impacts_are_those_of_the_closed_form(force, tolerance):
    times, speeds = impacts(FORCES[force], 4)
    for given in (force, timed(force)):
        run = simulate(given, tolerance)
        found = run.impacts
        assert abs(found["t"][0] - times[0]) < 0.01 * tolerance + 1e-14
        assert abs(found["speed_before"][0] + speeds[0]) < 0.15 * tolerance + 1e-13
        assert np.abs(found["t"][:4] - times).max() < 0.2 * tolerance
        assert np.abs(found["speed_before"][:4] + speeds).max() < 0.5 * tolerance
        # on the way to the first impact, too
        inside = np.linspace(0.0, times[0], 23)[:-1]
        law = flight(*FORCES[force], 1.0, 0.0)
        exact = np.array([law(t) for t in inside]).T
        assert np.abs(run(inside)[:2] - exact).max() < 5.0 * tolerance


@pytest.mark.parametrize("force", FORCES)
def test_they_take_fewer_evaluations_than_forces_that_may_depend_on_time(force):
    for tolerance in TOLERANCES:
        knows, does_not = (
            simulate(it, tolerance, samples="steps", dense_output=False)
            for it in (force, timed(force))
        )
        assert knows.nfev < does_not.nfev - 80


def by_hand(force, tolerance):
    """DOP853 up to the first impact below the root of the tolerance, and the geometric series."""
    nfev, (t, x, xdot) = 0, (0.0, 1.0, 0.0)

    def wall(_, y):
        return y[0]

    wall.terminal, wall.direction = True, -1
    options = {"rtol": tolerance, "atol": tolerance, "method": "DOP853", "events": wall}
    while True:
        run = solve_ivp(lambda t, y: (y[1], force(t, *y)), (t, 4.0), (x, xdot), **options)
        nfev += run.nfev
        t, x, xdot = run.t[-1], 0.0, -E * run.y_events[0][0][1]
        if xdot < math.sqrt(tolerance):
            return nfev + 1, t - 2.0 * xdot / (force(t, 0.0, 0.0) * (1.0 - E))


@pytest.mark.parametrize("force", [drag, spring])
def test_a_run_to_rest_takes_a_third_of_the_evaluations_of_a_careful_script(force):
    zeno = simulate(force, 1e-13).zeno["t"][0]
    scripts = [by_hand(force, 10.0**-k) for k in range(3, 13)]
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8):
        run = simulate(force, tolerance, samples="steps", dense_output=False)
        error = abs(run.zeno["t"][0] - zeno)
        assert run.nfev <= 0.3 * min(nfev for nfev, t in scripts if abs(t - zeno) <= error)


def test_a_jump_in_position_is_seen_in_the_first_fall():
    # twice the pull below h: t = sqrt(2 (1 - h)/g) and from there with the speed sqrt(2 g (1 - h))
    for h in (0.15, 0.3, 0.45, 0.6, 0.75, 0.9):
        system = zivi.ImpactSystem(lambda _, x, xdot, h=h: -G if x > h else -2.0 * G, e=E)
        run = zivi.simulate(system, (0, 1), (1, 0), zivi.SwitchedRK(rtol=1e-6, atol=1e-6))
        speed = math.sqrt(2.0 * G * (1.0 - h))
        incoming = math.sqrt(speed * speed + 4.0 * G * h)
        expected = speed / G + (incoming - speed) / (2.0 * G)
        assert run.impacts["t"][0] == pytest.approx(expected, abs=2e-6)
        assert -run.impacts["speed_before"][0] == pytest.approx(incoming, abs=1e-4)
