"""What the force does within an accumulation, where SwitchedRK could jump over it."""

import dataclasses
import math
from random import Random

import numpy as np
import pytest
from scipy.integrate import quad

import zivi
from arc_by_arc import Force, first_rest, harmonic, pulse, step

G = 9.81


def simulate(force, e, t_end, y0=(1, 0), **settings):
    system = zivi.ImpactSystem(force, e=e)
    return zivi.simulate(system, (0, t_end), y0, zivi.SwitchedRK(**settings))


def of_time(force):
    return lambda t, x, xdot: force.at(t)


def test_the_oracle_has_the_closed_form():
    """A ball, before and after a step of the pull at an apex."""
    e = 0.6
    fall, u = math.sqrt(2 / G), e * math.sqrt(2 * G)
    impacts, rest = first_rest(step(G, 0.0, 1.0), e, (0, 9), (1, 0))
    assert impacts[0] == pytest.approx((fall, u), abs=1e-15)
    assert rest == pytest.approx(fall + 2 * u / G / (1 - e), abs=1e-13)
    apex = fall + u / G
    down = math.sqrt(u * u / G / (2 * G))
    _, rest = first_rest(step(G, -G, apex), e, (0, 9), (1, 0))
    assert rest == pytest.approx(apex + down + 2 * e * down / (1 - e), abs=1e-13)


@dataclasses.dataclass
class Problem:
    """A feature within the tail that `SwitchedRK` would skip if there were none."""

    e: float
    start: tuple
    settings: dict
    force: Force
    t_end: float
    kind: str
    left: float
    """What is left of the tail where the feature begins."""
    width: float
    """Of the feature, in arcs of the tail there."""
    plain: float
    """Zeno time without the feature."""

    @classmethod
    def random(cls, random, number):
        e = random.uniform(*[(0.3, 0.75), (0.75, 0.95)][number % 2])
        start = (random.uniform(0.3, 1.5), random.uniform(-1, 1))
        rtol, order = (1e-4, 1e-6, 1e-8)[number % 3], (8, 5)[number // 2 % 2]
        settings = {"rtol": rtol, "atol": rtol / 1000, "order": order}
        plain = simulate(lambda t, x, xdot: -G, e, 200, start, **settings)
        begin, zeno = plain.resolved_impacts["t"][-1], plain.zeno_times[0]
        left = random.uniform(0.02, 1)
        at = float(zeno - left * (zeno - begin))
        first = e ** math.floor(math.log(left) / math.log(e))
        arc = (1 - e) * first * (zeno - begin)
        width = math.exp(random.uniform(math.log(0.2), math.log(5)))
        length = float(width * arc)
        a = G * random.choice([-1, 1]) * math.exp(random.uniform(math.log(0.01), math.log(3)))
        kinds = {
            "step": lambda: step(G, a, at),
            "smooth step": lambda: step(G, a, at, length / 2),
            "pulse": lambda: pulse(G, a, at, length),
            "smooth pulse": lambda: pulse(G, a, at, length, length / 4),
            "harmonic": lambda: harmonic(
                G, min(max(a, -0.9 * G), 0.9 * G), at, 2 * math.pi / length
            ),
        }
        kind = random.choice(list(kinds))
        t_end = zeno + 3 * max(length, arc) + 0.5 * (zeno - begin)
        return cls(e, start, settings, kinds[kind](), t_end, kind, left, width, zeno)

    @property
    def is_seen(self):
        """As documented."""
        lasting = self.kind in ("step", "smooth step", "harmonic")
        return lasting or self.width > (0.2 if self.left > 0.5 else 0.6 if self.left > 0.15 else 4)

    def rest(self, span, start):
        return first_rest(self.force, self.e, span, start)

    def error(self):
        """Of the Zeno time, in tolerances, and what an error of the flights makes of it."""
        sol = simulate(of_time(self.force), self.e, self.t_end, self.start, **self.settings)
        assert sol.success
        impacts, rest = self.rest((0, self.t_end), self.start)
        found = sol.zeno_times[0] if len(sol.zeno_times) else None
        rtol, flights = self.settings["rtol"], 0.0
        tol = rtol / 1000 + rtol * ((rest or self.t_end) - impacts[0][0])
        if distance(found, rest) > 30 * tol:
            for t, u in impacts[:: max(1, len(impacts) // 12)]:
                nudged = self.rest((t, self.t_end), (0, u * (1 + rtol)))[1]
                flights = max(flights, distance(nudged, rest))
        return distance(found, rest) / tol, flights / tol


def distance(one, other):
    if one is None or other is None:
        return 0.0 if one is other else math.inf
    return abs(one - other)


def test_random_features_within_the_tail_are_seen():
    """2000 of them: benchmarks/tail_features.py.

    The flights over a jump of the force have errors of some tolerances, which later impacts
    magnify: an error above 30 tolerances of the Zeno time has to be one of those.
    """
    random = Random(4)
    problems = (Problem.random(random, number) for number in range(80))
    seen = moved = 0
    for problem in problems:
        if problem.is_seen:
            error, flights = problem.error()
            assert error < 30 + 30 * flights, problem
            seen += 1
            moved += flights == 0.0
    assert seen > 60
    assert moved > 50


@pytest.mark.parametrize(
    "force",
    [
        step(G, 9.81 - 14.715, 4.0, 0.2),
        step(G, 9.81 - 30.0, 3.0),
        pulse(G, -40.0, 4.9, 0.2, 0.05),
        pulse(G, 49.81, 5.0, 0.1),
    ],
    ids=["smooth step", "step", "pulse", "outward pulse"],
)
@pytest.mark.parametrize("rtol", [1e-5, 1e-9])
def test_long_tails(force, rtol):
    """The chain of e = 0.9 is known after 1.5 s; it goes on for 7 s."""
    sol = simulate(of_time(force), 0.9, 12, rtol=rtol)
    _, rest = first_rest(force, 0.9, (0, 12), (1, 0))
    assert sol.zeno_times[:1] == pytest.approx([rest] if rest else [], abs=300 * rtol)


def test_short_pulses_are_seen_with_max_step():
    """A tenth of an arc long, they lie between two looks, mostly; never with `max_step`."""
    overlooked = 0
    for start in np.linspace(6.6, 7.4, 9):
        force = pulse(G, -40.0, start, 0.02)
        _, rest = first_rest(force, 0.9, (0, 12), (1, 0))
        overlooked += abs(simulate(of_time(force), 0.9, 12).rest_time - rest) > 0.01
        closely = simulate(of_time(force), 0.9, 12, max_step=0.02, rtol=1e-7)
        assert abs(closely.rest_time - rest) < 3e-5
    assert overlooked > 4


def ramped_table(t, x, xdot):
    """The table is switched on at 2 s, smoothly within 0.5 s."""
    s, a, w = min(max((t - 2) / 0.5, 0), 1), 0.0083, 30.0
    on = s**3 * (10 - 15 * s + 6 * s * s)
    rate, bend = 60 * s * s * (1 - s) ** 2, 240 * s * (1 - s) * (1 - 2 * s)
    sin, cos = math.sin(w * t), math.cos(w * t)
    return -G - a * (bend * sin + 2 * rate * w * cos - on * w * w * sin)


def test_the_answer_does_not_depend_on_the_end():
    """A Zeno point behind the end is not looked at, one before it is not believed."""
    times = np.linspace(0, 3.9, 40)
    runs = [simulate(ramped_table, 0.8, t_end, rtol=1e-10, atol=1e-13) for t_end in (4, 6)]
    (x, _), (x_long, _) = (sol(times) for sol in runs)
    assert x[-1] > 5e-3
    np.testing.assert_allclose(x, x_long, rtol=0, atol=1e-7)


def test_a_force_that_changes_close_to_the_wall():
    """A layer of 0.1 mm pulls twice as strong: the chain is above it, the tail within it."""
    e, layer = 0.7, 1e-4

    def arc(u):
        """Duration: energy is conserved; the height is ``x = top (1 - s^2)``."""
        potential = lambda x: G * (x + layer * -math.expm1(-x / layer))  # noqa: E731
        low, high = 0.0, u * u / (2 * G)
        for _ in range(60):
            top = 0.5 * (low + high)
            low, high = (top, high) if potential(top) < u * u / 2 else (low, top)

        def slowness(s):
            x = top * (1 - s * s)
            fall = G * (
                top * s * s + layer * math.exp(-x / layer) * -math.expm1(-top * s * s / layer)
            )
            return 2 * top * s / math.sqrt(2 * fall) if s else math.sqrt(2 * top / G)

        knee = min(1.0, 3 * math.sqrt(layer / top))
        edge = math.sqrt(max(0.0, 1 - 10 * layer / top))
        whole = quad(slowness, 0, 1, points=sorted({knee, edge} - {0.0, 1.0}), epsabs=1e-14)
        return 2 * whole[0]

    # from the wall with 1 m/s
    rest = sum(arc(e**k) for k in range(80))
    for order in (5, 8):
        force = lambda t, x, xdot: -G * (1 + math.exp(min(-x / layer, 3)))  # noqa: E731
        sol = simulate(force, e, 3, (0, 1), order=order, rtol=1e-7)
        assert abs(sol.rest_time - rest) < 30e-7
