"""Mechanical systems in detail: what errors name, unknown forces, tables of derivatives."""

import numpy as np
import pytest

import zivi
from inside import STEP, differenced, forces_at, summary_rows


def test_forces_that_nobody_can_tell_are_nan_where_there_is_one():
    modes = np.array([[0, 1, 2, -1], [2, 2, 2, 2]], dtype=np.int8)
    contacts = np.array([[True, False], [False, False]])
    states = np.zeros(2), np.zeros((2, 3)), np.zeros((2, 3))
    reactions, friction, _ = forces_at(None, states, contacts, modes)
    np.testing.assert_array_equal(reactions, [[np.nan, 0.0], [0.0, 0.0]])
    # 2 is a gap that is open
    np.testing.assert_array_equal(friction, [[np.nan, np.nan, 0.0, np.nan], [0.0] * 4])


@pytest.mark.parametrize("speed", [0.0, 0.7, 1.6, 40.0])
def test_a_curvature_is_differenced_over_steps_of_the_motion(speed):
    seen = []

    def gradient(t, q):
        seen.append((t, q[0]))
        return np.array([np.cos(q[0])])

    curvature = differenced(gradient, np.zeros(()))
    found = curvature(2.0, np.array([0.3]), np.array([speed]))
    # along q + s q' the derivative of cos(q) q' is -sin(q) q'^2
    assert found == pytest.approx(-np.sin(0.3) * speed**2, rel=1e-9, abs=1e-9)
    farthest = max(abs(t - 2.0) for t, _ in seen)
    assert farthest == pytest.approx(3 * STEP / max(1.0, speed), rel=1e-9)
    assert max(abs(q - 0.3) for _, q in seen) <= 3 * STEP * (1 + 1e-9)


def test_a_summary_tells_when_friction_sticks():
    # thrown with 1 m/s, braked by 0.5 m/s^2: sticks from 2 s on, where the pull is 0.2
    guide = zivi.DryFriction([1.0], limit=0.7, name="guide")
    system = zivi.MechanicalSystem(mass=[[1.0]], force=[0.2], friction=[guide])
    run = zivi.simulate(system, (0, 3), ([0.0], [1.0]))
    assert summary_rows(run)["sticks"] == "guide 2 .. 3"


def test_errors_name_parts_of_gaps():
    with pytest.raises((TypeError, ValueError), match=r"^normal "):
        zivi.LinearGap("up")
    with pytest.raises((TypeError, ValueError), match=r"^mu of gap "):
        zivi.LinearGap([0.0, 1.0], tangent=[1.0, 0.0], mu=-1.0)
    gap = zivi.Gap(
        lambda t, q: q[1],
        lambda t, q: [0.0, 1.0],
        lambda t, q, qdot: 0.0,
        name="floor",
        tangent=[1.0, 0.0],
        tangent_velocity=lambda t, q: [1.0, 2.0],
        tangent_curvature=lambda t, q, qdot: 0.0,
        mu=0.3,
    )
    system = zivi.MechanicalSystem(mass=np.eye(2), force=[0.0, -9.81], gaps=[gap])
    with pytest.raises(ValueError, match="tangent_velocity of gap 'floor' must be one number"):
        zivi.simulate(system, (0, 1), ([0.0, 1.0], [0.0, 0.0]))


def test_errors_name_parts_of_friction_that_are_no_numbers():
    guide = zivi.DryFriction(lambda t, q: [np.nan], curvature=0.0, limit=0.7, name="guide")
    system = zivi.MechanicalSystem(mass=[[1.0]], force=[0.2], friction=[guide])
    with pytest.raises(ValueError, match="direction of friction 'guide' must be finite at the sta"):
        zivi.simulate(system, (0, 3), ([0.0], [1.0]))


@pytest.fixture(scope="module")
def jumped():
    """Derivatives of a ball that comes to rest within the run."""
    ball = zivi.MechanicalSystem(mass=[[1.0]], force=[-9.81], gaps=[zivi.LinearGap([1.0])], e=0.5)
    return zivi.sensitivity(ball, (0, 3), ([1.0], [0.0]), ("qdot0", "q0"))


def test_impacts_have_derivatives_also_where_they_were_jumped(jumped):
    """From 1 m the first is at sqrt(2 x/g), the n-th at (1 + 2 e (1 - e^(n-1))/(1 - e)) that."""
    rows = jumped.impacts
    assert len(rows) == len(jumped.trajectory.impacts) > 5
    first = np.sqrt(2.0 / 9.81)
    # e = 1/2: 1 + 2 (1 - e^(n - 1))
    share = 3.0 - 2.0 * 0.5 ** np.arange(len(rows))
    assert np.asarray(rows["t"]) == pytest.approx(share * first, rel=1e-8)
    # by x0: dt/dx = t/(2 x)
    assert rows["dt"][:, 1] == pytest.approx(0.5 * share * first, rel=1e-7)


def test_tables_of_derivatives_are_over_what_they_are_by(jumped):
    pytest.importorskip("xarray")
    assert jumped.to_pandas().index.name == "wrt"
    assert list(jumped.to_pandas().index) == list(jumped.wrt)


def test_columns_have_the_names_that_they_are_asked_by():
    ball = zivi.MechanicalSystem(mass=[[1.0]], force=[-9.81], gaps=[zivi.LinearGap([1.0])], e=0.5)
    found = zivi.sensitivity(ball, (0, 0.2), ([1.0], [0.0]), ("t0", "e"))
    assert found.wrt == ("t0", "e")
