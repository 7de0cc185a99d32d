"""Ticks with a reference that is given at the sample and at the next one."""

import numpy as np
import pytest

import zivi
from control_oracle import EPS

F, H, E = -9.81, 1e-3, 0.5
BRANCHES = ["positive", "nearest"]


def tracker(**settings):
    return zivi.TwistingTracker(30, 17, **{"h": H, "e": E, "landing": True} | settings)


class Given:
    """A loop's controller whose reference is a function: t to (x, xdot, branch, acceleration)."""

    h = H

    def __init__(self, reference, **settings):
        self.reference, self.inner, self.x_ref = reference, tracker(**settings), np.nan

    def step(self, x, xdot, force, t):
        *now, acceleration = self.reference(t)
        following = self.reference(t + H)[:3]
        u = self.inner.step_to(x, xdot, force, tuple(now), following, acceleration)
        self.x_ref = self.inner.x_ref
        return u


def swinging(t):
    return 1 + 0.3 * np.sin(3 * t), 0.9 * np.cos(3 * t), 1, None


def bouncing(t, g=19.81, x0=1.0):
    """A mass dropped from x0: its flights from the sums of their geometric series."""
    first = np.sqrt(2 * x0 / g)
    if t < first:
        return x0 - g * t * t / 2, -g * t, 1, -g
    left = 1 - (t - first) / (2 * first * E / (1 - E))
    if left <= 0:
        return 0, 0, 1, 0
    n = int(np.floor(np.log(left) / np.log(E)))
    start = first + 2 * first * E * (1 - E**n) / (1 - E)
    v, s = E ** (n + 1) * np.sqrt(2 * g * x0), t - start
    return max(0.0, v * s - g * s * s / 2), v - g * s, (-1) ** (n + 1), -g


@pytest.mark.parametrize("branch", BRANCHES)
def test_a_mass_on_the_reference_is_given_its_acceleration(branch):
    rng = np.random.default_rng(1)
    for _ in range(200):
        a, xdot, side = rng.normal(0, 5), rng.normal(0, 2), rng.choice([-1, 1])
        x = 1 + rng.uniform()
        following = x + H * xdot + H * H * a / 2, xdot + H * a, side
        for acceleration in (a, None):
            it = tracker(branch=branch)
            u = it.step_to(x, xdot, F, (x, xdot, side), following, acceleration)
            # rounding of x divided by h^2
            assert abs(u - (a - F)) <= 4 * EPS * x / H**2
            # projected, xdot = R (xdot/R)
            assert (it.x_ref, it.xdot_ref) == pytest.approx(following[:2], rel=4 * EPS)


@pytest.mark.parametrize("branch", BRANCHES)
def test_a_smooth_reference_is_followed_without_drift(branch):
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(F, e=E), Given(swinging, branch=branch), (0, 20), (1, 0.9)
    )
    # t + h is rounded
    np.testing.assert_allclose(run.x_ref[1:], swinging(run.t[1:])[0], atol=20 * 20 * EPS)
    # 0.7 h^2 where the velocity changes its sign, 1e-9 elsewhere
    assert np.abs(run.error[1:]).max() < H**2
    assert np.median(np.abs(run.error[1:])) < 1e-8


@pytest.mark.parametrize("branch", BRANCHES)
def test_a_bouncing_reference_is_followed_to_rest(branch):
    """Below the error of a reference that is advanced by implicit Euler, 6e-5 rms."""
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(F, e=E), Given(bouncing, branch=branch), (0, 2), (1, 0)
    )
    early = (run.t > 0) & (run.t < 0.9)
    assert np.sqrt(np.mean(run.error[early] ** 2)) < 2e-6
    assert run.rest_time is not None
    assert run.rest_time < 1.1
    d = 2 * (30 - 17) / (1 + E)
    np.testing.assert_allclose(run.u[-100:], -F - d)


def test_what_is_refused_changes_nothing():
    it, here = tracker(), (1.0, 0.0, 1)
    it.step_to(1.1, 0, F, here, here)
    before = it.state
    for arguments, message in (
        ((1.1, 0, F, (1, 0, 0), here), r"branch of now must be 1 or -1, got 0\.0"),
        ((1.1, 0, F, here, (1, 0, 2)), r"branch of next must be 1 or -1, got 2\.0"),
        ((1.1, 0, F, (-1, 0, 1), here), "x_ref must be a finite distance >= 0"),
        ((1.1, 0, F, here, (1, np.nan, 1)), "xdot_ref must be a finite velocity"),
        ((np.inf, 0, F, here, here), "x must be"),
        ((1.1, 0, F, here, here, np.inf), "acceleration must be a finite force"),
    ):
        with pytest.raises(ValueError, match=message):
            it.step_to(*arguments)
        assert it.state == before
