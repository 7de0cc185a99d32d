"""Arcs that a jump to rest skips, under forces that vary: positions, impacts, events.

The reference follows every impact by Taylor series of the linear equation and uses nothing of zivi.
More of them, up to e = 0.99999: benchmarks/tails.py.
"""

import math

import numpy as np
import pytest

import zivi

V0 = 4.0


class Law:
    """``x'' = -k x - c x' - g + A cos(w t)``."""

    def __init__(self, k=0.0, c=0.0, g=9.81, A=0.0, w=0.0):
        self.k, self.c, self.g, self.A, self.w = k, c, g, A, w

    def linear(self):
        return zivi.LinearForce(
            stiffness=self.k, damping=self.c, gravity=self.g, amplitude=self.A, omega=self.w
        )

    def force(self, t, x, v):
        return -self.k * x - self.c * v - self.g + self.A * math.cos(self.w * t)

    def series(self, t, v, terms=40):
        a, angle, power = [0.0, v], self.w * t, self.A
        for n in range(terms):
            push = power * math.cos(angle + n * math.pi / 2) - (self.g if n == 0 else 0.0)
            a.append((push - self.k * a[n] - self.c * (n + 1) * a[n + 1]) / ((n + 1) * (n + 2)))
            power *= self.w / (n + 1)
        return np.polynomial.Polynomial(a)

    def arcs(self, e, least):
        """Start, end and position of each arc down to a speed, and the speed after it."""
        t, v = 0.0, V0
        while v > least:
            x = self.series(t, v)
            slope, h = x.deriv(), 2 * v / self.g
            for _ in range(50):
                h, before = h - x(h) / slope(h), h
                if abs(h - before) <= 4e-16 * h:
                    break
            after = -e * slope(h)
            yield t, h, x, after
            t, v = t + h, after


LAWS = [
    Law(k=3.0, c=0.05),
    Law(c=0.1),
    Law(A=2.0, w=0.25),
    Law(k=0.5, A=2.0, w=0.27),
]


def one(law, e):
    push = lambda t, q, v: [2 * law.force(t, q[0], v[0])]  # noqa: E731
    return zivi.MechanicalSystem(mass=[[2]], force=push, e=e, gaps=[zivi.LinearGap([1])])


def two(law, e):
    """The sum of both coordinates is the gap, their difference does not move."""
    push = lambda t, q, v: [0.5 * law.force(t, q[0] + q[1], v[0] + v[1])] * 2  # noqa: E731
    return zivi.MechanicalSystem(mass=np.eye(2), force=push, e=e, gaps=[zivi.LinearGap([1, 1])])


def run(law, e, rtol, family, **more):
    """Give a run, its position as a function of time, the time of its last impact and its end."""
    flights = "rk" if family == "rk" else "auto"
    method = zivi.SwitchedRK(rtol=rtol, atol=rtol / 1000, flights=flights)
    span = (0, 3 * V0 / law.g / (1 - e))
    if family in ("one", "two"):
        system = (one if family == "one" else two)(law, e)
        n = 1 if family == "one" else 2
        start = (np.zeros(n), np.full(n, V0 / n))
        sol = zivi.simulate(system, span, start, method, dense_output=True, **more)
        return (
            sol,
            lambda t: sol(t)[0].sum(axis=-1),
            sol.resolved_impacts["t"][-1],
            sol.zeno["t"][0],
        )
    force = law.force if family == "callable" else law.linear()
    sol = zivi.simulate(zivi.ImpactSystem(force, e=e), span, (0, V0), method, **more)
    return sol, lambda t: sol(t)[0], sol.resolved_impacts["t"][-1], sol.rest_time


@pytest.mark.parametrize("family", ["series", "rk", "callable", "one", "two"])
@pytest.mark.parametrize("law", LAWS, ids=range(len(LAWS)))
@pytest.mark.parametrize("rtol", [1e-7, 1e-11])
def test_positions_and_impacts_in_a_tail_under_a_force_that_varies(family, law, rtol):
    e = 0.9
    sol, position, last, zeno = run(law, e, rtol, family)
    arcs = list(law.arcs(e, 1e-3 * V0))
    apex = arcs[0][2](np.linspace(0, arcs[0][1], 99)).max()
    inside = [arc for arc in arcs if last - 1e-6 < arc[0] and arc[0] + arc[1] < zeno]
    assert len(inside) > 10
    parts = np.linspace(0.03, 0.97, 21)
    for t, h, x, _ in inside:
        assert abs(position(t + parts * h) - x(parts * h)).max() <= 5 * rtol * apex
    if family not in ("one", "two"):
        found = sol.impacts_down_to(1e-2 * V0)
        exact = np.array([(t + h, after) for t, h, _, after in arcs])[: len(found)]
        assert len(found) > len(sol.resolved_impacts) or rtol < 1e-9
        off = abs(found["t"] - exact[:, 0]) * exact[:, 1]
        assert off.max() <= 5 * rtol * apex
        assert abs(found["xdot_after"] - exact[:, 1]).max() <= 5 * rtol * V0


@pytest.mark.parametrize("family", ["series", "callable", "one"])
@pytest.mark.parametrize("rtol", [1e-7, 1e-10])
def test_events_in_a_tail_under_a_force_that_varies(family, rtol):
    law, e = LAWS[0], 0.9
    _, _, last, _ = run(law, e, rtol, family)
    arcs = list(law.arcs(e, 1e-3 * V0))
    after = [arc for arc in arcs if last - 1e-6 < arc[0]]
    # half as high as the arcs of the tail are at first
    t, h, x, _ = after[0]
    level = 0.5 * x(h / 2)
    above = lambda t, x, v: x - level  # noqa: E731
    if family == "one":
        above = lambda t, q, v: q[0] - level  # noqa: E731
    sol, *_ = run(law, e, rtol, family, events=[above])
    found = sol.t_events[0][sol.t_events[0] > last]
    exact = []
    for t, h, x, _ in after[:4]:
        for s in (0.1 * h, 0.9 * h):
            for _ in range(40):
                s -= (x(s) - level) / x.deriv()(s)
            exact.append(t + s)
    assert len(found) >= 6
    exact = np.array(exact[: min(len(found), 6)])
    assert abs(found[: len(exact)] - exact).max() * after[0][3] <= 5 * rtol * V0**2 / 2 / law.g


def test_a_plastic_sum_of_coordinates_does_not_drift_in_a_long_tail():
    """Rounding of an acceleration in contact, 1e-15 m/s^2, is a way of 3e-9 m in 8000 s."""
    law, e, rtol = Law(), 0.999, 1e-11
    _, position, _, zeno = run(law, e, rtol, "two")
    t = zeno * np.linspace(0.1, 0.9, 4001)
    k = np.floor(np.log1p(-t / zeno) / math.log(e))
    start, speed = zeno * (1 - e**k), V0 * e**k
    exact = speed * (t - start) - law.g * (t - start) ** 2 / 2
    clear = exact > 1e-6
    assert abs(position(t) - exact)[clear].max() <= 10 * rtol * V0**2 / 2 / law.g
