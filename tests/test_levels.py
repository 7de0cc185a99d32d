"""Crossings of a level are found like impacts: none is missed."""

import math

import numpy as np
import pytest

import zivi

G = 9.81
ORDERS = [5, 8]


def arcs(e, x0, t_end):
    """Start and speed of the arcs of the ball from rest at `x0`."""
    t, u = math.sqrt(2 * x0 / G), e * math.sqrt(2 * G * x0)
    while t < t_end and u > 1e-6:
        yield t, u
        t, u = t + 2 * u / G, e * u


@pytest.mark.parametrize("order", ORDERS)
def test_every_crossing_is_found_however_short_the_motion_stays_beyond(order):
    e = 0.9
    for below in (1e-2, 1e-4, 1e-8, 1e-12):
        (first, u), *_ = arcs(e, 1.0, 3.0)
        c = u * u / (2 * G) * (1 - below)
        levels = [zivi.Level(x=c), zivi.Level(x=c, direction=1), zivi.Level(x=c, direction=-1)]
        ball = zivi.ImpactSystem(lambda t, x, v: -G, e=e)
        sol = zivi.simulate(ball, (0, 3), (1, 0), zivi.SwitchedRK(order=order), events=levels)
        half = math.sqrt(u * u - 2 * G * c) / G
        apex, fall = first + u / G, math.sqrt(2 * (1 - c) / G)
        tol = 1e-13 / half
        assert sol.t_events[0] == pytest.approx([fall, apex - half, apex + half], abs=tol)
        assert sol.t_events[1] == pytest.approx([apex - half], abs=tol)
        assert sol.t_events[2] == pytest.approx([fall, apex + half], abs=tol)
        assert sol.y_events[0][:, 0] == pytest.approx([c] * 3, abs=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_levels_in_the_extrapolated_arcs(order):
    e, n = 0.5, 20
    ball = zivi.ImpactSystem(lambda t, x, v: -G, e=e)
    apexes = zivi.Level(xdot=0.0, direction=-1)
    high = zivi.Level(x=1e-6)
    method = zivi.SwitchedRK(order=order)
    sol = zivi.simulate(ball, (0, 3), (1, 0), method, events=[apexes, high])
    exact = [(t + u / G, u * u / (2 * G)) for t, u in arcs(e, 1.0, 3.0)]
    assert sol.t_events[0][:n] == pytest.approx([t for t, _ in exact][:n], abs=1e-9)
    assert len(sol.t_events[1]) == 1 + 2 * sum(height > 1e-6 for _, height in exact)
    last = zivi.Level(xdot=0.0, direction=-1, terminal=12)
    sol = zivi.simulate(ball, (0, 3), (1, 0), method, events=last)
    assert sol.status is zivi.Status.TERMINATED_BY_EVENT
    assert sol.t[-1] == pytest.approx(exact[11][0], abs=1e-9)


def test_the_level_of_the_review_and_the_impacts_as_one():
    # two zeros between two looks of a function: 0.8 m on an arc of 0.8155 m
    start, u = 0.3, math.sqrt(2 * G * 0.8155)
    ball = zivi.ImpactSystem(-G, e=0.9)
    sol = zivi.simulate(ball, (start, start + 1), (0, u), events=zivi.Level(x=0.8))
    half = math.sqrt(2 * 0.0155 / G)
    assert sol.t_events[0] == pytest.approx([start + u / G - half, start + u / G + half], abs=1e-12)
    wall = zivi.Level(x=0.0, direction=-1)
    sol = zivi.simulate(ball, (0, 2), (1, 0), events=wall)
    assert np.array_equal(sol.t_events[0], sol.resolved_impacts["t"])


def test_levels_with_fixed_steps_and_bad_ones():
    ball = zivi.ImpactSystem(-G, e=0.5)
    level = zivi.Level(x=0.5, terminal=True)
    sol = zivi.simulate(ball, (0, 1), (1, 0), zivi.ThetaGamma(1e-3), events=level)
    assert sol.t[-1] == pytest.approx(math.sqrt(1 / G), abs=2e-3)
    assert repr(level) == "Level(x=0.5, terminal=True, direction=0)"
    for bad in ({}, {"x": 1.0, "xdot": 1.0}, {"x": math.nan}, {"xdot": "a"}):
        with pytest.raises((ValueError, TypeError), match="x"):
            zivi.Level(**bad)
