"""The equations of linear systems in impulses: against segments, differences, closed forms."""

import dataclasses
import pickle

import numpy as np
import pytest

import zivi
from inside import ImpulseTerms, evaluate, newton, of_segments
from orbit_systems import chain2, chain3, chain4, listed, numbers

rng = np.random.default_rng(26)
CASES = {
    "two_dof_four_impacts": (chain2(), ["I stop"] * 4),
    "three_dof_w1.1": (chain3(**numbers("three_dof_w1.1")), ["I a", "I b"]),
    "four_dof_w0.95": (chain4(**numbers("four_dof_w0.95")), ["I b", "I a", "I a"]),
}


def orbit_of(name):
    system, word = CASES[name]
    return zivi.periodic_orbit(system, (word, listed(name, "t")))


@pytest.fixture(params=CASES)
def at(request):
    """Equations beside an orbit: every term of the derivatives counts."""
    orbit = orbit_of(request.param)
    return evaluate(orbit._frame, orbit._y + 0.05 * rng.normal(size=len(orbit._y)))


def differences(function, y, h=1e-5):
    rows = [(function(y + h * one) - function(y - h * one)) / (2 * h) for one in np.eye(len(y))]
    return np.array(rows).T


def test_the_jacobian_is_that_of_differences(at):
    assert isinstance(at, ImpulseTerms)
    known = differences(lambda y: evaluate(at.frame, y).residual, at.y)
    assert np.max(np.abs(at.matrix() - known)) < 1e-8 * np.max(np.abs(known))
    for s in range(len(at.rates)):
        own = differences(lambda y, s=s: evaluate(at.frame, y).rates[s : s + 1], at.y)
        assert np.max(np.abs(at.rate_gradient(s) - own)) < 1e-8 * np.max(np.abs(own))


@pytest.mark.parametrize("count", [2, 3, 5])
def test_disturbances_that_turn_are_those_of_a_longer_word(at, count):
    factor = np.exp(2j * np.pi / count)
    frame = at.frame
    longer = dataclasses.replace(frame, word=frame.word * count, length=count * frame.length)
    y = np.tile(at.y.reshape(-1, 2), (count, 1))
    y[:, 1] += np.repeat(np.arange(count) * frame.length, len(frame.word))
    whole = evaluate(longer, y.ravel()).matrix()
    v = rng.normal(size=len(at.y)) + 1j * rng.normal(size=len(at.y))
    powers = factor ** np.arange(count)
    there = whole @ np.kron(powers, v)
    real = factor.real if count == 2 else factor
    assert (
        np.max(np.abs(there - np.kron(powers, at.matrix(real) @ v))) < 1e-11 * np.abs(there).max()
    )


@pytest.mark.parametrize("kappa", [1.0, 0.3, -0.7, -1.0])
def test_how_the_matrices_change(at, kappa):
    n = len(at.y)
    w, v = rng.normal(size=(2 * n, 2)), rng.normal(size=(2 * n, 2))
    if abs(kappa) == 1.0:
        known = differences(
            lambda y: np.array([w[:n, 0] @ evaluate(at.frame, y).matrix(kappa) @ v[:n, 0]]), at.y
        )
        own = at.curvature(kappa, w[:n, 0], v[:n, 0])
        assert np.max(np.abs(own - known)) < 1e-7 * np.max(np.abs(known))
    known = differences(lambda y: (w.T @ evaluate(at.frame, y).turned(kappa)[0] @ v).ravel(), at.y)
    own = np.array(at.turned_curvature(kappa, w, v))
    assert np.max(np.abs(own - known)) < 1e-7 * np.max(np.abs(known))


@pytest.mark.parametrize("name", CASES)
def test_impulses_and_segments_have_the_same_orbits(name):
    orbit = orbit_of(name)
    terms = evaluate(orbit._frame, orbit._y)
    assert np.max(np.abs(terms.residual)) < 1e-13
    segments = terms.segments
    assert np.max(np.abs(segments.residual)) < 2e-13
    # all derivatives agree: the determinants vanish where multipliers lie
    assert np.max(np.abs(segments.impulses - terms.y[::2][:, None])) < 1e-13
    assert np.max(np.abs(segments.rates - terms.rates)) < 1e-13
    # and what the unknowns are made of
    again = orbit._frame.joined(*orbit._frame.split(orbit._y))
    assert np.max(np.abs(again - orbit._y)) < 1e-13
    copy = pickle.loads(pickle.dumps(orbit))
    assert np.array_equal(copy.monodromy(1.0), orbit.monodromy(1.0))


@pytest.mark.parametrize(("damping", "has"), [(0.0, False), (0.1, True)])
def test_what_resonates_with_its_impulses_has_segments(damping, has):
    # without damping four of its own periods are one of the load: impulses would add up
    system = zivi.LinearSystem(
        [[1.0]],
        [[damping]],
        [[1.0]],
        excitation=zivi.Harmonic([0.5], 0.25),
        gaps=[zivi.LinearGap([-1.0], 0.2, name="stop")],
        e=0.6,
    )
    frame = zivi.periodic_orbit(system, (["I stop"], [0.1]))._frame
    assert (frame.impulses is not None) == has


def closed(system, w):
    """One impact a period: R, h0, c of F(P)^2 R^2 = (d + P h0)^2 + (P c/w)^2."""
    n, e, d = 2, float(system.e[0]), 0.3
    load = np.array([0.0, 1.0])
    response = np.linalg.solve(system.K - w * w * system.M + 1j * w * system.C, load)
    whole = np.zeros((4, 4))
    whole[:n, n:] = np.eye(n)
    whole[n:] = -np.linalg.solve(system.M, np.hstack([system.K, system.C]))
    values, vectors = np.linalg.eig(whole)
    normal = np.array([-1.0, 0.0])
    push = np.linalg.solve(vectors, np.append(np.zeros(2), np.linalg.solve(system.M, normal)))
    seen = (normal @ vectors[:n]) * push
    T = 2 * np.pi / w
    h0 = np.sum(seen / (1 - np.exp(values * T)) * np.exp(values * T)).real
    g1 = np.sum(values * seen / (1 - np.exp(values * T)) * np.exp(values * T)).real
    mobility = normal @ np.linalg.solve(system.M, normal)
    c = ((g1 + mobility) + e * g1) / (1 + e)
    return abs(normal @ response), h0, c, d


@pytest.mark.parametrize("w", [0.7, 0.9, 1.2, 1.4])
def test_one_impact_a_period_is_its_closed_form(w):
    R, h0, c, d = closed(chain2(w=w), w)
    for P in (0.3, 0.8, 1.5):
        F = np.hypot(d + P * h0, P * c / w) / R
        system = chain2(w=w, F=F)
        frame = zivi.periodic_orbit(system, (["I stop"], [0.3]))._frame
        guesses = [newton(frame, np.array([P, t])) for t in np.linspace(0, 2 * np.pi / w, 9)]
        found = [it for it in guesses if it.converged and abs(it.terms.y[0] - P) < 1e-10]
        assert found
        # multipliers of a matrix that shares nothing with impulses
        assert min(abs(it.terms.y[0] - P) for it in found) < 1e-12


def test_a_grazing_is_regular():
    w = 1.2
    R, _, _, d = closed(chain2(w=w), w)
    frame = zivi.periodic_orbit(chain2(w=w, F=d / R), (["I stop"], [0.3]))._frame
    motion = frame.split(np.array([0.0, 0.0]))[0]
    # the phase at which the gap is least: there the smooth motion grazes
    times = np.linspace(0, 2 * np.pi / w, 100001)
    path = frame.flow.path((), 0.0, motion[0, 1:-1], times)
    lowest = times[np.argmin(frame.flow.gaps(times, path)[0][:, 0])]
    found = newton(frame, np.array([0.0, lowest]))
    assert found.converged
    assert abs(found.terms.y[0]) < 1e-12
    assert np.linalg.svd(found.terms.matrix(), compute_uv=False)[-1] > 1e-2


def test_the_equations_in_segments_are_those_of_the_orbit():
    orbit = orbit_of("two_dof_four_impacts")
    x, length = orbit._frame.split(orbit._y)
    x[1, -1] += 1e-3
    assert np.max(np.abs(of_segments(orbit._frame, orbit._y, x, length).residual)) > 1e-4
