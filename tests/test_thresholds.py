r"""Where the bouncing ball on a vibrating table doubles its period.

A ball that meets a table :math:`a \cos \omega t` once a period exists from
:math:`\Gamma = a \omega^2 / g = \pi (1-e)/(1+e)` on and is stable up to
:math:`\sqrt{(\pi (1-e)/(1+e))^2 + (2 (1+e^2)/(1+e)^2)^2}`, where a multiplier of its return map
passes -1 (J. Guckenheimer, P. Holmes, *J. Sound Vib.* 84, 1982, with the flight as it is).
"""

import math

import numpy as np
import pytest

import zivi

G, OMEGA = 9.81, 2 * math.pi
PERIOD = 2 * math.pi / OMEGA
THRESHOLDS = {0.5: 1.526824, 0.8: 1.070836}
RESTITUTION = pytest.mark.parametrize("e", THRESHOLDS)


def threshold(e):
    born = math.pi * (1 - e) / (1 + e)
    return math.hypot(born, 2 * (1 + e * e) / (1 + e) ** 2)


def table(gamma, e):
    return zivi.ImpactSystem(zivi.LinearForce(gravity=G, amplitude=gamma * G, omega=OMEGA), e=e)


def orbit(gamma, e):
    """Time and relative speed after an impact of the orbit of period one."""
    thrown = G * PERIOD / 2
    rising = thrown * (1 - e) / (1 + e)  # the speed of the table at the impact
    phase = -math.asin(rising * OMEGA / (gamma * G))
    return phase / OMEGA, thrown - rising


def impacts_after(gamma, e, t, u, periods, tol=1e-12, order=8):
    method = zivi.SwitchedRK(rtol=tol, atol=tol, order=order, flights="rk")
    span = (t, t + (periods + 0.5) * PERIOD)
    return zivi.simulate(table(gamma, e), span, (0.0, u), method=method).impacts


def returned(gamma, e, t, u):
    """The next impact, in its period."""
    first = impacts_after(gamma, e, t, u, 1)[0]
    return np.array((first["t"] - PERIOD, first["xdot_after"]))


def multipliers(gamma, e):
    """Eigenvalues of the return map's derivative, by central differences of runs."""
    at, step = np.array(orbit(gamma, e)), 1e-5
    columns = []
    for k in range(2):
        nudge = step * np.eye(2)[k]
        columns.append(returned(gamma, e, *(at + nudge)) - returned(gamma, e, *(at - nudge)))
    return np.sort_complex(np.linalg.eigvals(np.array(columns).T / (2 * step)))


@RESTITUTION
def test_the_formula_has_the_published_numbers(e):
    assert threshold(e) == pytest.approx(THRESHOLDS[e], abs=5e-7)


@RESTITUTION
@pytest.mark.parametrize("order", [8, 5])
def test_the_orbit_is_one(e, order):
    """From the analytic state every impact is a period after the last, at the same speed."""
    gamma = 0.97 * threshold(e)
    t, u = orbit(gamma, e)
    impacts = impacts_after(gamma, e, t, u, 20, tol=1e-11, order=order)
    assert len(impacts) == 20
    np.testing.assert_allclose(impacts["t"], t + PERIOD * np.arange(1, 21), rtol=0, atol=1e-9)
    np.testing.assert_allclose(impacts["xdot_after"], u, rtol=0, atol=1e-9)


@RESTITUTION
def test_a_multiplier_passes_minus_one(e):
    """At the threshold to the accuracy of the differences; on both sides of it with its sign."""
    at = multipliers(threshold(e), e)
    np.testing.assert_allclose(at.imag, 0, atol=1e-7)
    assert at[0].real == pytest.approx(-1, abs=1e-7)
    # area shrinks by e^2 at each impact
    assert at[1].real == pytest.approx(-(e**2), abs=1e-7)
    assert np.all(np.abs(multipliers(0.999 * threshold(e), e)) < 1 - 1e-4)
    assert multipliers(1.001 * threshold(e), e)[0].real < -1 - 1e-4


@RESTITUTION
@pytest.mark.parametrize("gamma", [0.99, 0.999, 1.001, 1.01])
def test_the_multipliers_are_those_of_the_formula(e, gamma):
    """Determinant e^2; the trace has the acceleration of the table at the impact."""
    gamma *= threshold(e)
    t, _ = orbit(gamma, e)
    one, two = multipliers(gamma, e)
    assert (one * two).real == pytest.approx(e * e, abs=1e-7)
    trace = 1 + e * e - (1 + e) ** 2 * gamma * math.cos(OMEGA * t)
    assert (one + two).real == pytest.approx(trace, abs=1e-7)


@RESTITUTION
def test_below_a_perturbed_orbit_comes_back(e):
    gamma = 0.97 * threshold(e)
    t, u = orbit(gamma, e)
    rate = abs(multipliers(gamma, e)).max()
    periods = math.ceil(math.log(1e-5) / math.log(rate)) + 5
    speeds = impacts_after(gamma, e, t, u + 1e-3, periods, tol=1e-10)["xdot_after"]
    assert abs(speeds[0] - u) > 1e-4
    assert np.abs(speeds[-5:] - u).max() < 1e-7


@RESTITUTION
def test_above_the_speeds_alternate(e):
    gamma = 1.02 * threshold(e)
    t, u = orbit(gamma, e)
    impacts = impacts_after(gamma, e, t, u + 1e-3, 600, tol=1e-10)
    assert len(impacts) == 600
    speeds = impacts["xdot_after"][-8:]
    assert np.abs(speeds[2:] - speeds[:-2]).max() < 1e-6
    assert np.abs(np.diff(speeds)).min() > 0.05
    intervals = np.diff(impacts["t"][-9:])
    np.testing.assert_allclose(intervals[1:] + intervals[:-1], 2 * PERIOD, rtol=0, atol=1e-7)
