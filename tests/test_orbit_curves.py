"""Points of branches, located events, the parts of an orbit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import zivi
from orbit_tables import MODES, TURN, frame, residual, single, table
from zivi.orbits import least_period
from zivi.orbits.curve import Curve, locate, locate_near
from zivi.orbits.find import why_not
from zivi.orbits.follow import _weight
from zivi.orbits.secant import secant
from zivi.orbits.sequence import equations

STATUS = zivi.OrbitStatus


def curve(name: str = "amplitude", y: np.ndarray | None = None, system: Any = None) -> Curve:
    return Curve(system or table(), frame(), name, single() if y is None else y, 0.7)


def test_points_of_a_curve():
    own = curve()
    here = own.start(single(), 1.3)
    assert here is not None
    np.testing.assert_allclose(here.z * own.scale, [*single()[0], 1.3])
    assert (here.value, here.corrections) == (1.3, 0)
    assert here.tangent[-1] > 0
    assert np.linalg.norm(here.tangent) == pytest.approx(1)
    assert own.flights == 1
    # the tangent is that of the closed form
    by = (single(1.3 + 1e-6) - single(1.3 - 1e-6))[0] / 2e-6
    ratio = here.tangent * own.scale
    np.testing.assert_allclose(ratio[:2] / ratio[2], by, rtol=1e-6, atol=1e-9)
    assert here.least_speed == pytest.approx(single()[0, 1] / 0.5)
    assert here.least_push == pytest.approx(-1 + 1.3 * math.sin(single()[0, 0]))
    m = here.at.monodromy
    assert here.doubling == pytest.approx(1 + np.trace(m) + np.linalg.det(m))
    assert own.scale[-1] == 0.7
    assert own.scale[0] == pytest.approx(TURN)


def test_the_derivative_of_a_curve():
    own = curve()
    z = own.scaled(single() * 1.01, 1.31)
    _, value, matrix = own.evaluate(z)
    h, columns = 1e-6, []
    for i in range(3):
        step = h * (np.arange(3) == i)
        columns.append((own.evaluate(z + step)[1] - own.evaluate(z - step)[1]) / (2 * h))
    np.testing.assert_allclose(matrix, np.array(columns).T, rtol=1e-5, atol=1e-7)
    raw = residual(table(1.31), frame(), single() * 1.01)
    np.testing.assert_allclose(value, raw / own.sizes)


def test_corrections_stay_in_their_plane():
    own = curve()
    here = own.start(single(), 1.3)
    guess = here.z + 0.05 * here.tangent
    found = own.correct(guess, here.tangent)
    assert found is not None
    assert abs(here.tangent @ (found.z - guess)) < 1e-12
    amplitude = found.value
    np.testing.assert_allclose(found.at.y, single(amplitude), rtol=1e-9)
    assert np.linalg.norm(found.tangent) == pytest.approx(1)
    assert 1 <= found.corrections <= 4
    assert own.correct(here.z - 2.0 * here.tangent, here.tangent) is None
    assert own.correct(np.array([math.nan, 1.0, 1.0]), here.tangent) is None


def test_events_are_located_to_rounding():
    own = curve()
    one = own.start(single(), 1.3)
    other = own.correct(own.scaled(single(1.6), 1.6), np.array([0, 0, 1.0]))
    doubling = math.hypot(math.pi / 3, 10 / 9)
    for found in (
        locate(own, one, other, lambda point: point.doubling),
        locate(own, other, one, lambda point: point.doubling),
        locate_near(own, one, lambda point: point.doubling),
    ):
        assert found is not None
        assert abs(found.value / doubling - 1) < 1e-12
    assert locate(own, one, one_like(own, 1.4), lambda point: point.doubling) is None


def one_like(own: Curve, amplitude: float) -> Any:
    return own.correct(own.scaled(single(amplitude), amplitude), np.array([0, 0, 1.0]))


def test_secants_within_a_bracket():
    assert secant((1.0, 2.0), (0.0, -2.0), 0.0, 1.0) == 0.5
    assert secant((0.75, 1.0), (0.25, -2.0), 0.2, 0.9) == pytest.approx(0.25 + 1 / 3)
    # without a slope, or outside: the middle
    assert secant((1.0, 2.0), (0.0, 2.0), 0.2, 0.6) == pytest.approx(0.4)
    assert secant((1.0, 2.0), (0.0, 1.0), 0.2, 0.6) == pytest.approx(0.4)
    assert secant((1.0, math.inf), (0.0, 1.0), 0.2, 0.6) == pytest.approx(0.4)
    assert secant((1.0, 2.0), (0.0, -2.0), 0.5, 0.9) == pytest.approx(0.7)


def test_the_end_that_needs_attention_is_the_status():
    order = ["COMPLETED", "RANGE_END", "LEFT_ADMISSIBLE", "MAX_POINTS", "NOT_CONVERGED"]
    assert [_weight(STATUS[name]) for name in order] == [0, 1, 2, 3, 4]


def test_why_an_orbit_is_no_motion():
    assert why_not(table(), equations(table(), frame(), single(), minima=True)) is None
    behind = equations(table(), frame(), np.array([[0.6, -0.3]]), minima=True)
    assert "t = 0.6 s would leave the wall at -0.3 m/s" in str(why_not(table(), behind))
    low = equations(MODES.system(0.9), frame(), np.array([0.5, 0.0]), minima=True)
    assert low.lowest[0] < 0
    assert f"to {low.lowest[0]:.3g} m at t = {low.lowest[1]:.9g} s" in str(
        why_not(MODES.system(0.9), low)
    )
    held = equations(table(e=0.0), frame(), np.array([[4.0, 0.0]]), minima=True)
    assert "t = 4 s the force holds the mass" in str(why_not(table(e=0.0), held))
    # by rounding it is one
    object.__setattr__(behind, "y", np.array([[0.6, -1e-13]]))
    assert "leave the wall" not in str(why_not(table(), behind))


# the least period


def test_parts_of_orbits():
    assert least_period._prime_factors(1) == least_period._prime_factors(0) == []
    assert least_period._prime_factors(12) == [2, 3]
    assert least_period._prime_factors(49) == [7]
    rows = np.tile(single(), (4, 1))
    rows += np.array([[0.0, 0.0], [TURN, 0.1], [2 * TURN, 0.0], [3 * TURN, 0.1]])
    assert least_period._most_parts(frame(4), rows) == 4
    assert least_period._most_parts(frame(6), rows) == 2
    assert least_period._most_parts(frame(3), rows) == 1
    assert least_period._most_parts(frame(free=True), rows) == 4
    assert least_period._most_parts(frame(6), np.zeros(2)) == 6
    half = least_period.half_difference(table(), frame(4), rows)
    np.testing.assert_allclose(half, 0, atol=1e-14)
    rows[:, 0] += [0.0, 0.0, 0.2, 0.2]
    half = least_period.half_difference(table(), frame(4), rows)
    np.testing.assert_allclose(half, [[0.1, 0], [0.1, 0]], atol=1e-14)
    mean = least_period.mean_half(table(), frame(4), rows)
    np.testing.assert_allclose(mean, rows[:2] + np.array([0.1, 0.0]), atol=1e-14)
    assert least_period.half_difference(table(), frame(4), np.zeros(2)) is None
    assert least_period.half_difference(table(), frame(4), rows[:3]) is None
    assert least_period.half_frame(frame(4)).multiple == 2
    assert least_period.half_frame(frame(free=True)).multiple == 1
    assert least_period._apart(table(), frame(4), rows, 2.0, 2) == pytest.approx(0.2 / TURN)
    rows[:, 1] += [0.0, 0.0, 0.6, 0.0]
    assert least_period._apart(table(), frame(4), rows, 2.0, 2) == pytest.approx(0.3)


def test_rows_of_a_run_that_alternates_still():
    rows = np.vstack([single(), single() + np.array([TURN, 0.0])])
    alternating = rows + np.array([[1e-3, 1e-3], [-1e-3, -1e-3]])
    multiple, least = least_period.least_rows(table(), TURN, alternating, 2)
    assert multiple == 1
    np.testing.assert_allclose(least, single(), rtol=1e-9)
    # far from it, nothing is solved
    apart = rows + np.array([[0.2, 0.3], [-0.2, -0.3]])
    assert least_period.least_rows(table(), TURN, apart, 2)[1] is apart
    once = least_period.least_rows(table(), TURN, single() * 1.01, 1)
    np.testing.assert_array_equal(once[1], single() * 1.01)
