"""The overturning chart of the examples against Housner's equation, integrated here."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import zivi
from example_scripts import example

pytest.importorskip("sympy")

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("mechanical models")]

chart = example("mechanics_overturning")
ALPHA, P = math.atan2(chart.B, chart.H), math.sqrt(3 * 9.81 / (4 * math.hypot(chart.B, chart.H)))
TIGHT = zivi.SwitchedRK(rtol=1e-11, atol=1e-12)


def housner(ratio, beta, end, impacts_at_most=1000, alpha=ALPHA):
    """Angle over ``p t`` and impacts of a block that lifts off once, by arcs between impacts.

    Without an angle it falls. ``theta'' = -sin(s alpha - theta) + tan(alpha) beta sin(ratio t)
    cos(s alpha - theta)`` of Zhang and Makris (2001), whose angle has the other sign; s is the
    sign of theta.
    """

    def field(t, y, side, shaken):
        push = beta * math.tan(alpha) * math.sin(ratio * t) if shaken else 0.0
        arm = side * alpha - y[0]
        return [y[1], push * math.cos(arm) - math.sin(arm)]

    def upright(t, y, side, shaken):
        return y[0] if t > start else side * 1e-300

    def fallen(t, y, side, shaken):
        return abs(y[0]) - math.pi / 2

    upright.terminal = fallen.terminal = True
    pulse = 2 * math.pi / ratio
    start, y, side, arcs, impacts = math.asin(1 / beta) / ratio, [0.0, 0.0], 1, [], []
    lifts = start
    while start < end and len(impacts) < impacts_at_most:
        shaken = start < pulse
        upright.direction = -side
        arc = solve_ivp(
            field,
            (start, pulse if shaken else end),
            y,
            "DOP853",
            rtol=1e-13,
            atol=1e-15,
            max_step=0.5,
            dense_output=True,
            events=[upright, fallen],
            args=(side, shaken),
        )
        arcs.append((start, arc.t[-1], arc.sol))
        start, y = arc.t[-1], arc.y[:, -1]
        if len(arc.t_events[1]):
            return None, np.array(impacts)
        if arc.status == 1:
            impacts.append(start)
            side, y = -side, [0.0, (1 - 1.5 * math.sin(alpha) ** 2) * y[1]]

    def angle(t):
        if t <= lifts:
            return 0.0
        return next(sol(t)[0] for a, b, sol in arcs if a <= t <= b)

    return angle, np.array(impacts)


def linear(ratio, beta):
    """Whether a slender block overturns without an impact: ``x'' = x - 1 + beta sin(ratio t)``.

    In closed form, ``x = 1 + c cosh + d sinh - beta sin(ratio t)/(1 + ratio^2)`` in the pulse.
    """
    lifts, pulse = math.asin(1 / beta) / ratio, 2 * math.pi / ratio
    share = beta / (1 + ratio**2)
    c = -1 + share * math.sin(ratio * lifts)
    d = share * ratio * math.cos(ratio * lifts)
    t = np.linspace(0, pulse - lifts, 4001)
    x = 1 + c * np.cosh(t) + d * np.sinh(t) - share * np.sin(ratio * (lifts + t))
    rate = c * math.sinh(t[-1]) + d * math.cosh(t[-1]) - share * ratio
    # from the end of the pulse on x = 1 + (...) e^t + (...) e^-t
    return x.min() > -1e-12 and x[-1] - 1 + rate > 0


def halved(fails, holds, decide):
    for _ in range(38):
        middle = (fails + holds) / 2
        fails, holds = (fails, middle) if decide(middle) else (middle, holds)
    return holds


def test_it_lifts_off_when_the_floor_accelerates_by_g_tan_alpha():
    for ratio, beta in itertools.product((0.7, 3.0, 6.0), (1.01, 1.5, 4.0)):
        sol = chart.run(ratio, beta, 0.0, method=TIGHT)
        first = sol.liftoffs[0]
        assert first["gap"] == chart.FEET.index("right")
        # also short below the peak
        assert beta * math.sin(ratio * P * first["t"]) == pytest.approx(1, abs=1e-13)


@pytest.mark.parametrize("ratio", [0.5, 4.0, 8.0])
def test_it_rocks_from_g_tan_alpha(ratio):
    ratios, betas = np.full(4, ratio), [0.5, 1 - 1e-9, 1 + 1e-8, 1.01]
    stands = chart.outcomes(ratios, betas, method=TIGHT) == chart.STANDS
    assert stands.tolist() == [True, True, False, False]


@pytest.mark.parametrize("ratio", [0.6, 1.5, 3.0, 4.5, 6.5])
def test_it_overturns_without_an_impact_where_housner_says(ratio):
    def falls(beta):
        angle, impacts = housner(ratio, beta, 2 * math.pi / ratio + 30, 1)
        return angle is None and not len(impacts)

    near = chart.slender(ratio)
    expected = halved(1 + (near - 1) / 2, 1 + 1.2 * (near - 1), falls)
    assert chart.by_housner(ratio) == pytest.approx(expected, abs=1e-9)
    # the runs on both sides of it
    betas = expected + np.array([-1e-7, 1e-7]) * expected
    found = chart.outcomes([ratio, ratio], betas, free=24, method=TIGHT)
    assert found[0] in (chart.SURVIVES, chart.AFTER_IMPACT)
    assert found[1] == chart.WITHOUT_IMPACT


@pytest.mark.parametrize("ratio", [0.6, 1.5, 3.0, 4.5, 6.5])
def test_the_formula_of_a_slender_block(ratio):
    near = chart.slender(ratio)
    expected = halved(1 + (near - 1) / 2, 1.3 * near, lambda beta: linear(ratio, beta))
    assert near == pytest.approx(expected, abs=1e-10)


def test_slender_blocks_approach_their_formula_with_the_square_of_their_angle():
    ratio, off = 3.0, []
    for width in (0.08, 0.04, 0.02):
        found = chart.least(
            chart.WITHOUT_IMPACT,
            [ratio],
            [3.0],
            [4.0],
            30,
            b=width,
            h=2.0,
            free=24,
            method=TIGHT,
        )
        off.append(found[0] - chart.slender(ratio))
    assert abs(off[-1]) < 1e-4
    assert np.divide(off[:-1], off[1:]) == pytest.approx([4, 4], rel=0.02)


@pytest.mark.parametrize(("ratio", "beta"), [(5.0, 2.8), (3.0, 1.3), (7.0, 12.0)])
def test_the_angle_of_a_block_that_survives(ratio, beta):
    end = 2 * math.pi / ratio + 20
    sol = chart.run(ratio, beta, 20, method=TIGHT)
    angle, impacts = housner(ratio, beta, end)
    assert chart.outcome({"liftoffs": sol.liftoffs}, False) == chart.SURVIVES
    assert len(impacts) >= 4
    feet = sol.resolved_impacts[np.isin(sol.resolved_impacts["gap"], (0, 1))]
    assert feet["t"] * P == pytest.approx(impacts, abs=1e-7)
    assert feet["gap"].tolist() == [(1 + k) % 2 for k in range(len(impacts))]
    times = np.linspace(0, end, 1001)
    expected = [angle(t) for t in times]
    assert np.abs(expected).max() > 0.3 * ALPHA
    assert sol(times / P)[0][:, 2] == pytest.approx(expected, abs=1e-7)
    # no foot has moved sideways while it stood
    assert np.all(feet["sticks"])


def test_the_angle_of_a_block_that_rocks_to_rest_in_each_half_of_the_shock():
    ratio, beta = 3.0, 1.01
    sol = chart.run(ratio, beta, 0.0, method=TIGHT)
    assert sol.success, sol.message
    assert [chart.FEET[row["gap"]] for row in sol.liftoffs] == ["right", "left"]
    half = math.pi / ratio
    angle, impacts = housner(ratio, beta, half, 60)
    times = np.linspace(0, impacts[-1], 300)
    expected = [angle(t) for t in times]
    assert np.abs(expected).max() > 1e-5
    assert sol(times / P)[0][:, 2] == pytest.approx(expected, abs=1e-10)
    # the second half is the first in a mirror
    assert sol((times + half) / P)[0][:, 2] == pytest.approx(-np.array(expected), abs=1e-10)
    for end in (half, 2 * half):
        q, v = sol(end / P)
        assert q == pytest.approx([0, chart.H, 0], abs=1e-11)
        assert v == pytest.approx([0, 0, 0], abs=1e-14)


def test_the_chart():
    found, betas, ratios = chart.chart(2, 3), chart.ACCELERATIONS[::2], chart.FREQUENCIES[::3]
    assert np.unique(found).tolist() == [0, 1, 2, 3]
    assert np.all((found == chart.STANDS) == (betas < 1)[:, None])
    compared = np.zeros(4, dtype=int)
    for row, column in itertools.product(range(2, 18, 2), range(1, 14, 2)):
        ratio, beta = ratios[column], betas[row]
        angle, impacts = housner(ratio, beta, 2 * math.pi / ratio + 10, 6)
        expected = chart.SURVIVES
        if angle is None:
            expected = chart.AFTER_IMPACT if len(impacts) else chart.WITHOUT_IMPACT
        assert found[row, column] == expected, (ratio, beta)
        compared[expected] += 1
    assert compared[1:].min() >= 10
