"""Derivatives of runs with kicks and dry friction, against differences in skewed coordinates."""

import numpy as np
import pytest

import zivi

TIGHT = zivi.SwitchedRK(rtol=1e-12, atol=1e-13)
SKEW = np.array([[1.0, 0.4], [-0.3, 1.2]])
BACK = np.linalg.inv(SKEW)


def box(mu):
    """A mass on a floor with friction, pulled back by a spring; the coordinates are skewed."""
    floor = zivi.LinearGap(SKEW[1], tangent=SKEW[0], mu=mu, name="floor")

    def force(t, q, qdot):
        return SKEW.T @ [-3.0 * (SKEW @ q)[0], -9.81]

    return zivi.MechanicalSystem(mass=SKEW.T @ SKEW, force=force, gaps=[floor], e=0.5)


def kick(t, along, up):
    """An impulse that depends on the state."""

    def impulse(t, q, qdot):
        return SKEW.T @ [along + 0.1 * (SKEW @ q)[0], up - 0.2 * (SKEW @ qdot)[0]]

    return zivi.Kick(t=t, impulse=impulse)


@pytest.mark.parametrize(
    "kicks",
    [
        [kick(0.2, 0.8, 0.0)],  # while it slips
        [kick([0.2, 0.9], 0.8, 0.5), zivi.Kick(t=1.2, dv=BACK @ [0.4, 0.1])],  # off the floor
        [kick(0.2, 0.3, -0.6)],  # into the floor
        [kick(1.2, 0.9, 0.0)],  # out of sticking
        [zivi.Kick(t=1.2, dv=[0.0, 0.0])],  # it goes on sticking
    ],
)
def test_derivatives_through_kicks_with_friction(kicks):
    def end(speed, mu):
        start = BACK @ [0.3, 0.0], BACK @ [speed, 0.0]
        sol = zivi.simulate(box(mu), (0, 1.9), start, TIGHT, kicks=kicks)
        return np.concatenate([sol.q[-1], sol.qdot[-1], sol.transitions["t"]])

    def slope(of, h=2e-4):
        wide, narrow = of(h) - of(-h), of(h / 2) - of(-h / 2)
        return (8 * narrow - wide) / (6 * h)

    start = BACK @ [0.3, 0.0], BACK @ [1.0, 0.0]
    wrt = "qdot0", "floor.mu"
    s = zivi.sensitivity(box(0.2), (0, 1.9), start, wrt, TIGHT, kicks=kicks)
    assert s.success
    found = np.concatenate([s.final.reshape(4, 3), s.transition_times])
    by_speed = slope(lambda h: end(1.0 + h, 0.2))
    assert np.abs(found[:, :2] @ BACK[:, 0] - by_speed).max() < 1e-9
    assert np.abs(found[:, 2] - slope(lambda h: end(1.0, 0.2 + h))).max() < 1e-9
    # times of kicks are fixed
    kicked = np.isin(s.trajectory.transitions["t"], s.trajectory.kicks["t"])
    assert not s.transition_times[kicked].any()
