"""Pushes on a mass or a mechanical system at rest are seen."""

import math

import numpy as np
import pytest

import zivi
from rest_pushes import SYSTEMS, problems


def test_a_ripple_does_not_hide_a_push():
    def force(t, x, v):
        return -9.81 + 1e-4 * math.sin(37 * t) + (40.0 if 7.2 < t < 8.2 else 0.0)

    sol = zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 10), (0, 0))
    assert sol.success
    assert sol.liftoff_times[:1] == pytest.approx([7.2], abs=1e-9)


def test_a_push_from_the_start_on_is_seen():
    def force(t, x, v):
        return 40.0 if 0 < t < 0.26 else -9.81

    def later(t, x, v):
        return force(t - 1, x, v)

    sol = zivi.simulate(zivi.ImpactSystem(later, e=0.5), (1, 11), (0, 0))
    assert sol.success
    assert sol.liftoff_times[:1] == pytest.approx([1], abs=1e-9)
    # at t = 0 there is no shortest time but that of the span
    sol = zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 10), (0, 0))
    assert sol.success
    assert sol.liftoff_times[:1] == pytest.approx([0], abs=1e-14)


@pytest.mark.parametrize("t0", [0.0, -2.0, 3.0])
@pytest.mark.parametrize("masses", [[1], [1, 2]])
def test_a_force_that_jumps_at_the_start_lifts_off_there(t0, masses):
    """In one second `5 m/s^2` move a mass by 2.5 m."""

    def force(t, x, v):
        return -9.81 if t <= t0 else 5.0

    span, n = (t0, t0 + 1), len(masses)
    sol = zivi.simulate(zivi.ImpactSystem(force, e=0.5), span, (0, 0))
    assert sol.success
    assert sol.liftoff_times == pytest.approx([t0], abs=1e-9)
    assert sol.x[-1] == pytest.approx(2.5, abs=1e-9)
    # a stack that is thrown up as a whole
    gaps = [zivi.LinearGap(row) for row in np.eye(n) - np.eye(n, k=-1)]
    push = lambda t, q, w: [m * force(t, 0, 0) for m in masses]  # noqa: E731
    stack = zivi.MechanicalSystem(mass=np.diag(masses), force=push, gaps=gaps, e=0.5)
    sol = zivi.simulate(stack, span, (np.zeros(n), np.zeros(n)))
    assert sol.success
    assert sol.liftoffs["t"][:1] == pytest.approx([t0], abs=1e-9)
    assert sol.q[-1] == pytest.approx(np.full(n, 2.5), abs=1e-9)


def test_a_push_along_a_floor_is_seen():
    """It lifts nothing off: the motion shows it."""

    def force(t, q, w):
        return [1.0 if 7.2 < t < 7.6 else 0.0, -9.81]

    system = zivi.MechanicalSystem(
        mass=[[1, 0], [0, 1]], force=force, gaps=[zivi.LinearGap([0, 1])], e=0.5
    )
    sol = zivi.simulate(system, (0, 10), ([0, 0], [0, 0]))
    assert sol.q[-1, 0] == pytest.approx(0.4 * (0.2 + 2.4), rel=1e-5)


@pytest.mark.parametrize("system", SYSTEMS)
def test_no_push_of_three_percent_of_the_span_is_overlooked(system):
    of_this = [it for it in problems(48, 5) if it.system == system]
    errors = [problem.error()[0] for problem in of_this]
    assert max(errors) < 1e-6, of_this[errors.index(max(errors))]


def test_constant_arrays_are_not_probed():
    """As a function they are: nobody knows that it is constant."""
    gaps = [zivi.LinearGap([1])]
    given = ([-9.81], lambda t, q, w: [-9.81])
    constant, function = (
        zivi.simulate(
            zivi.MechanicalSystem(mass=1.0, force=force, gaps=gaps), (0, 10), ([0], [0])
        ).nfev
        for force in given
    )
    assert constant < function - 40
    moving = [zivi.LinearGap([1], motion=zivi.HarmonicWall(1e-3, 1.0))]
    table = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=moving)
    assert not table._is_steady()
