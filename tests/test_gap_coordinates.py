"""Gaps and what impacts leave alone: identities, against runs and against equations of our own."""

import numpy as np
import pytest

import zivi
import zivi.mechanics


def random_system(source, n, m, at=None, open_by=0.8):
    """A mass matrix that depends on the coordinates, as gaps do in part, so open somewhere."""
    root = source.normal(size=(n, n)) + 2.0 * np.eye(n)
    normals, bend = source.normal(size=(m, n)), 0.2 * source.normal(size=(m, n))
    pull = source.normal(size=n)

    def mass(t, q):
        return root @ np.diag(1.5 + 0.4 * np.sin(q)) @ root.T

    def height(i, q):
        return normals[i] @ q + bend[i] @ (1 - np.cos(q))

    base = [0.0 if at is None else height(i, at) for i in range(m)]
    lift = np.broadcast_to(open_by, m)

    def gap(i):
        return zivi.Gap(
            value=lambda t, q: height(i, q) - base[i] + lift[i],
            gradient=lambda t, q: normals[i] + bend[i] * np.sin(q),
            curvature=lambda t, q, w: bend[i] @ (np.cos(q) * w * w),
            name=f"g{i}",
        )

    def force(t, q, w):
        return -30.0 * normals.T @ np.ones(m) + pull - 0.5 * w

    return zivi.MechanicalSystem(
        mass=mass, force=force, gaps=[gap(i) for i in range(m)], e=source.uniform(0.2, 0.9, m)
    )


def test_velocities_that_keep_gaps_are_at_right_angles_to_impulses():
    source = np.random.default_rng(1)
    for _ in range(60):
        n = int(source.integers(1, 6))
        m = int(source.integers(1, min(n, 3) + 1))
        system = random_system(source, n, m)
        q, w = source.normal(size=n), source.normal(size=n)
        split = zivi.mechanics.gap_coordinates(system, q, w)
        here = system.at(0.0, q, w)
        inverse = np.linalg.inv(here.mass)
        size = np.linalg.norm(split.Z) * np.linalg.norm(inverse @ split.N.T)
        assert np.all(abs(split.Z @ inverse @ split.N.T) <= 1e-13 * max(size, 1.0))
        np.testing.assert_allclose(split.N @ split.T, 0.0, atol=1e-13 * np.abs(split.N).max())
        np.testing.assert_allclose(split.Z @ split.T, np.eye(n - m), atol=1e-12)
        back = inverse @ split.N.T @ np.linalg.solve(split.D, split.gdot) + split.T @ split.w
        np.testing.assert_allclose(back, w, atol=1e-11)
        np.testing.assert_allclose(split.gdot, here.gradients @ w, atol=1e-13)
        cosine = split.D / np.sqrt(np.outer(np.diag(split.D), np.diag(split.D)))
        np.testing.assert_allclose(split.c, cosine, atol=1e-14)


def test_impacts_leave_w_as_it_is():
    source, several = np.random.default_rng(2), 0
    for _ in range(60):
        n = int(source.integers(1, 6))
        m = int(source.integers(1, min(n, 3) + 1))
        q, before = source.normal(size=n), source.normal(size=n)
        hit = source.random(m) < 0.7
        system = random_system(source, n, m, at=q, open_by=np.where(hit, 0.0, 0.5))
        split = zivi.mechanics.gap_coordinates(system, q, before)
        # towards all gaps that are closed
        speeds = np.where(hit, -abs(split.gdot) - 0.1, split.gdot)
        before = before + np.linalg.pinv(split.N) @ (speeds - split.gdot)
        after = zivi.simulate(system, (0, 1e-4), (q, before))(0.0)[1]
        jump = np.abs(after - before).max()
        assert (jump > 1e-3) == hit.any()
        size = np.linalg.norm(split.Z) * max(1.0, jump)
        assert np.all(abs(split.Z @ (after - before)) <= 1e-12 * size)
        several += hit.sum() > 1
    assert several > 10


def test_moving_gaps_have_their_own_rate():
    wall = zivi.HarmonicWall(amplitude=0.1, omega=3.0)
    ball = zivi.MechanicalSystem(
        mass=2.0, force=[-9.81], gaps=[zivi.LinearGap([1.0], 0.0, wall)], e=0.5
    )
    split = zivi.mechanics.gap_coordinates(ball, [1.0], [0.5], t=0.2)
    assert split.gdot[0] == pytest.approx(ball.at(0.2, [1.0], [0.5]).rates[0] + 0.5)
    assert split.w.shape == (0,)
    assert split.D.tolist() == [[0.5]]


def test_gaps_that_depend_on_each_other_are_refused():
    twice = [zivi.LinearGap([1, 0]), zivi.LinearGap([2, 0], 1.0)]
    system = zivi.MechanicalSystem(mass=np.eye(2), force=[0, 0], gaps=twice, e=0.5)
    with pytest.raises(ValueError, match="independent"):
        zivi.mechanics.gap_coordinates(system, [1.0, 0.0], [0.0, 0.0])
