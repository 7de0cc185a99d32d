"""The map from impact to impact: against runs, differences and identities."""

import numpy as np
import pytest

import zivi
from references import REFERENCES

OSCILLATOR = {"stiffness": 1.0, "damping": 0.1, "gravity": -1.0, "amplitude": 0.6, "omega": 0.9}


def map_of(e=0.8, wall=None, **changes):
    return zivi.impact_map(
        zivi.ImpactSystem(zivi.LinearForce(**(OSCILLATOR | changes)), e=e, wall=wall)
    )


@pytest.mark.parametrize("name", ["O4_p1_w2.2", "O5_p1n2_w4"])
def test_periodic_motions_are_fixed_points(name):
    case = REFERENCES[name]
    step = zivi.impact_map(zivi.ImpactSystem(zivi.LinearForce(**case["force"]), e=case["e"]))
    phase = case["force"]["omega"] * case["t0"] % (2 * np.pi)
    next_, u, _ = step(phase, case["xdot0"])
    assert (next_, u) == pytest.approx((phase, case["xdot0"]), abs=2e-14)


def test_orbits_are_the_impacts_of_runs():
    wall = zivi.HarmonicWall(amplitude=0.1, omega=0.9, phase=0.4)
    for step in (map_of(), map_of(wall=wall), map_of(omega=-0.9, phase=0.3)):
        method = zivi.SwitchedRK(rtol=1e-13, atol=1e-13, flights="rk")
        sol = zivi.simulate(step.system, (0, 120), (0, 1.5), method=method)
        phase, u = step.orbit(0.0, 1.5, len(sol.resolved_impacts))
        assert len(u) > 15
        expected = 0.9 * sol.resolved_impacts["t"]
        turn = (phase - expected + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(turn).max() < 1e-9
        assert np.abs(u - sol.resolved_impacts["xdot_after"]).max() < 1e-9


def test_jacobians_are_those_of_differences():
    step = map_of()
    rng = np.random.default_rng(3)
    phase, u = rng.uniform(0, 6, 200), rng.uniform(0.3, 3, 200)
    _, after, jacobian = step(phase, u)
    assert jacobian.shape == (200, 2, 2)
    h = 1e-6
    for column, (dp, du) in enumerate([(h, 0), (0, h)]):
        ahead, behind = step(phase + dp, u + du), step(phase - dp, u - du)
        turn = (ahead.phase - behind.phase + np.pi) % (2 * np.pi) - np.pi
        near = np.abs(turn) < 1e-3  # both sides of a touch land elsewhere
        assert near.mean() > 0.95
        scale = 1 + np.abs(jacobian).max(axis=(1, 2)) ** 2
        assert (np.abs(turn / (2 * h) - jacobian[:, 0, column]) / scale)[near].max() < 1e-7
        slope = (ahead.u - behind.u) / (2 * h)
        assert (np.abs(slope - jacobian[:, 1, column]) / scale)[near].max() < 1e-7
    # areas: det J = e^2 (u/u') exp(-c T)
    expected = 0.64 * u / after * np.exp(-0.1 * step.duration(phase, u))
    error = np.abs(np.linalg.det(jacobian) - expected)
    assert (error / (1 + np.abs(jacobian).max(axis=(1, 2)) ** 2)).max() < 1e-14


@pytest.mark.parametrize(
    "name", ["stiffness", "damping", "gravity", "amplitude", "omega", "phase", "e"]
)
def test_derivatives_by_parameters_are_those_of_differences(name):
    values = OSCILLATOR | {"phase": 0.3, "e": 0.8}
    rng = np.random.default_rng(4)
    phase, u = rng.uniform(0, 6, 40), rng.uniform(0.5, 3, 40)
    h = 1e-6
    ahead, behind = (
        map_of(**(values | {name: values[name] + sign * h}))(phase, u) for sign in (1, -1)
    )
    step = map_of(**values)
    found = step.by(phase, u, name)
    assert found.shape == (40, 2)
    turn = (ahead.phase - behind.phase + np.pi) % (2 * np.pi) - np.pi
    near = np.abs(turn) < 1e-3
    assert near.mean() > 0.9
    scale = 1 + np.abs(found).max(axis=1) ** 2
    assert (np.abs(turn / (2 * h) - found[:, 0]) / scale)[near].max() < 1e-7
    assert (np.abs((ahead.u - behind.u) / (2 * h) - found[:, 1]) / scale)[near].max() < 1e-7


def test_shapes_and_threads():
    step = map_of()
    phase, u, jacobian = step(1.0, 1.0)
    assert np.ndim(phase) == np.ndim(u) == 0
    assert jacobian.shape == (2, 2)
    many = step(np.zeros((3, 1)), [1.0, 2.0], threads=2)
    assert many.phase.shape == (3, 2)
    assert many.jacobian.shape == (3, 2, 2, 2)
    both = step.by(0.0, 1.0, ["omega", "e"])
    assert both.shape == (2, 2)
    phases, _ = step.orbit([0.0, 1.0], 1.0, 5, skip=3)
    whole, _ = step.orbit([0.0, 1.0], 1.0, 8)
    assert np.array_equal(phases, whole[:, 3:])


def test_impacts_that_never_come_and_those_that_accumulate():
    away = map_of(stiffness=0.0, damping=0.0, amplitude=0.1)  # pulled off the wall for good
    phase, u, jacobian = away(0.0, 1.0)
    assert np.isnan([phase, u]).all()
    assert np.isnan(jacobian).all()
    ball = map_of(gravity=9.81, e=0.5)
    _, speeds = ball.orbit(0.0, 1.0, 200)
    assert speeds[5] > 0
    assert np.isnan(speeds[-1])


@pytest.mark.parametrize(
    ("system", "words"),
    [
        (zivi.ImpactSystem(-9.81, e=0.5), "omega must"),
        (zivi.ImpactSystem(lambda t, x, v: -1.0, e=0.5), "needs the interpreter"),
        (
            zivi.ImpactSystem(
                zivi.LinearForce(**OSCILLATOR), e=0.5, wall=zivi.HarmonicWall(0.1, 3.0)
            ),
            "omega must be the same",
        ),
    ],
)
def test_systems_without_a_map(system, words):
    with pytest.raises(ValueError, match=words):
        zivi.impact_map(system)


def test_bad_input_is_named():
    step = map_of()
    with pytest.raises(ValueError, match="u must"):
        step(0.0, -1.0)
    with pytest.raises(ValueError, match="phase must"):
        step(np.nan, 1.0)
    with pytest.raises(ValueError, match="parameters must"):
        step.by(0.0, 1.0, "mass")
    with pytest.raises(ValueError, match="n must"):
        step.orbit(0.0, 1.0, 0)
    with pytest.raises(TypeError, match="system must"):
        zivi.impact_map("ball")
