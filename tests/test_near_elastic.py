"""Accumulations at restitutions near 1, where rounding and long chains decide."""

import math

import numpy as np
import pytest

import zivi

SLIGHT_DRAG = zivi.LinearForce(gravity=9.81, damping=0.01)
REST = 1031.1633093359945
"""Of the ball from 1 m with e = 0.9999, the sum of the flight times of all arcs."""


def drop(force, e, t_end, **settings):
    system = zivi.ImpactSystem(force, e=e)
    return zivi.simulate(
        system, (0, t_end), (1, 0), zivi.SwitchedRK(**settings, flights="rk"), dense_output=False
    )


@pytest.mark.parametrize("rtol", [1e-6, 1e-10])
def test_rounding_does_not_pass_for_convergence(rtol):
    """Rounding in neighbouring rows agrees by chance long before the expansion holds."""
    sol = drop(SLIGHT_DRAG, 0.9999, 2000, rtol=rtol, atol=rtol / 1000)
    assert abs(sol.rest_time - REST) < rtol * REST
    assert len(sol.resolved_impacts) < 60_000


G, V0, APEX = 9.81, 4.0, 4.0**2 / (2 * 9.81)


class Ball:
    """Thrown up with `V0` under the constant pull `G`: impacts at ``T (1 - e^k)``."""

    def __init__(self, e):
        self.e, self.zeno = e, 2 * V0 / G / (1 - e)

    def impacts(self, k):
        """Times of the impacts and speeds after them."""
        fallen = np.expm1(k * math.log1p(self.e - 1))
        return -self.zeno * fallen, V0 * (1 + fallen)

    def at(self, t):
        """Positions and velocities."""
        k = np.floor(np.log1p(-t / self.zeno) / math.log1p(self.e - 1))
        start, speed = self.impacts(k)
        return speed * (t - start) - G * (t - start) ** 2 / 2, speed - G * (t - start)

    def looks(self):
        parts = [(0, 0.01), (0.1, 0.12), (0.5, 0.7), (0.9, 0.99)]
        return self.zeno * np.concatenate([np.linspace(*part, 499) for part in parts])


def simulate(force, e, rtol, flights="rk", **more):
    method = zivi.SwitchedRK(rtol=rtol, atol=rtol / 1000, flights=flights)
    span = (0, 1.1 * Ball(e).zeno)
    return zivi.simulate(zivi.ImpactSystem(force, e=e), span, (0, V0), method, **more)


@pytest.mark.parametrize("e", [0.9, 0.995, 0.9995, 0.9999, 0.99999])
@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-11])
@pytest.mark.parametrize("flights", ["series", "rk"])
def test_positions_in_a_tail_under_a_constant_force(e, rtol, flights):
    """One term of the expansion is exact; those fitted to noise are wrong by 1e-2 and more."""
    ball = Ball(e)
    sol = simulate(-G, e, rtol, flights)
    (x, xdot), t = sol(ball.looks()), ball.looks()
    exact, speed = ball.at(t)
    assert abs(x - exact).max() <= 10 * rtol * APEX
    # a velocity jumps at an impact, whose time is known to rounding
    clear = exact > 1e-3 * APEX * (1 - t / ball.zeno) ** 2
    assert abs(xdot - speed)[clear].max() <= 10 * rtol * V0
    assert len(sol.resolved_impacts) == 3


@pytest.mark.parametrize("e", [0.995, 0.9995, 0.9999])
@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-11])
def test_positions_in_a_tail_under_a_force_not_known_to_be_constant(e, rtol):
    ball = Ball(e)
    sol = simulate(lambda t, x, xdot: -G, e, rtol)
    exact, _ = ball.at(ball.looks())
    assert abs(sol(ball.looks())[0] - exact).max() <= 10 * rtol * APEX


@pytest.mark.parametrize("e", [0.995, 0.9999])
@pytest.mark.parametrize("rtol", [1e-6, 1e-11])
def test_positions_in_a_mechanical_tail(e, rtol):
    ball = Ball(e)
    system = zivi.MechanicalSystem(mass=[[2]], force=[-2 * G], e=e, gaps=[zivi.LinearGap([1])])
    method = zivi.SwitchedRK(rtol=rtol, atol=rtol / 1000)
    sol = zivi.simulate(system, (0, 1.1 * ball.zeno), ([0], [V0]), method, dense_output=True)
    exact, _ = ball.at(ball.looks())
    assert abs(sol(ball.looks())[0][:, 0] - exact).max() <= 10 * rtol * APEX


@pytest.mark.parametrize("rtol", [1e-6, 1e-11])
def test_impacts_in_a_tail(rtol):
    ball = Ball(0.9999)
    all_of_them = simulate(-G, ball.e, rtol).impacts_down_to(0.4, limit=30_000)
    t, speed = ball.impacts(np.arange(1, len(all_of_them) + 1))
    assert len(all_of_them) == 1 + math.floor(math.log(0.1) / math.log(ball.e))
    # in parts of the flights
    assert (abs(all_of_them["t"] - t) <= 10 * rtol * speed / G).all()
    assert all_of_them["xdot_after"] == pytest.approx(speed, rel=rtol)
    assert all_of_them["xdot_before"] == pytest.approx(-speed / ball.e, rel=rtol)


@pytest.mark.parametrize("rtol", [1e-6, 1e-11])
def test_events_in_a_tail(rtol):
    """Half the first apex is passed twice by each arc that is higher."""
    ball, level = Ball(0.999), APEX / 2
    found = simulate(-G, ball.e, rtol, events=lambda t, x, xdot: x - level).t_events[0]
    arcs = math.floor(math.log(0.5) / (2 * math.log(ball.e))) + 1
    start, speed = ball.impacts(np.arange(arcs))
    root = np.sqrt(speed**2 - 2 * G * level)
    exact = np.sort(np.concatenate([start + (speed - root) / G, start + (speed + root) / G]))
    assert len(found) == len(exact)
    assert abs(found - exact)[:-2].max() <= 100 * rtol * V0 / G


@pytest.mark.parametrize("force", [-9.81, lambda t, x, v: -9.81], ids=["number", "callable"])
def test_rounding_of_many_impacts_is_not_carried_along(force):
    """A last bit of the first speed moves positions by 9 of these `rtol` of the first apex."""
    mpmath = pytest.importorskip("mpmath")
    e, v0, rtol = 0.99999, 4.0, 1e-11
    with mpmath.workdps(40):
        last = 2 * mpmath.mpf(v0) / mpmath.mpf(9.81) / (1 - mpmath.mpf(e))
        system, span = zivi.ImpactSystem(force, e=e), (0, 1.1 * float(last))
        method = zivi.SwitchedRK(rtol=rtol, atol=rtol / 1000)
        sol = zivi.simulate(system, span, (0, v0), method, dense_output=True)
        assert abs(sol.zeno_times[0] - last) < 1e-14 * last

        def exact(t):
            n = mpmath.floor(mpmath.log(1 - t / last) / mpmath.log(e))
            q = mpmath.mpf(e) ** n
            left = t - last * (1 - q)
            return v0 * q * left - mpmath.mpf(9.81) * left**2 / 2

        times = float(last) * np.concatenate(
            [np.linspace(1e-6, 0.05, 40), np.linspace(0.1, 0.99, 40)]
        )
        off = [abs(sol(t)[0] - exact(mpmath.mpf(t))) for t in times.tolist()]
    assert max(off) < 10 * rtol * v0**2 / 2 / 9.81
    assert sol.nfev < 400_000
