"""Points of branches, located events, the parts of an orbit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from inside import (
    Margins,
    Path,
    Point,
    least_rows,
    located,
    located_near,
    orbits_mechanical_find as find,
    rows_along,
    secant,
)
from orbit_tables import MODES, TURN, as_rows, as_word, equations, frame, single, table


def curve(y: np.ndarray | None = None, system: Any = None) -> Path:
    word, unknowns = as_word(system or table(), frame(), single() if y is None else y)
    return Path(word, "amplitude", unknowns, 0.7)


def scaled(own: Path, amplitude: float) -> np.ndarray:
    return own.scaled(as_word(table(), frame(), single(amplitude))[1], amplitude)


def doubling(point: Point) -> float:
    """1 + tr M + det M: zero where a multiplier is -1."""
    return float(np.real(np.prod(1.0 + point.multipliers)))


def test_points_of_a_curve():
    own = curve()
    y = as_word(table(), frame(), single())[1]
    here = own.start(y, 1.3)
    # times, and impulses (1 + e)/e times the speeds
    np.testing.assert_allclose(here.z * own.scale, [3.0 * single()[0, 1], single()[0, 0], 1.3])
    assert (here.value, here.corrections) == (1.3, 0)
    assert here.tangent[-1] > 0
    assert np.linalg.norm(here.tangent) == pytest.approx(1)
    # the tangent is that of the closed form
    by = (single(1.3 + 1e-6) - single(1.3 - 1e-6))[0] / 2e-6
    ratio = here.tangent * own.scale
    moved = rows_along(here.terms, ratio[:2] / ratio[2])
    np.testing.assert_allclose(moved, [by], rtol=1e-6, atol=1e-9)
    trace = 1 + 0.25 - 2.25 * 1.3 * math.sin(single()[0, 0])
    assert doubling(here) == pytest.approx(1 + trace + 0.25)
    assert np.sign(doubling(here)) == np.sign(here.doubling * np.linalg.det(own_matrix(here)))
    assert own.scale[-1] == 0.7
    assert own.scale[1] == pytest.approx(TURN)


def own_matrix(point: Point) -> np.ndarray:
    """The derivative by the impulse and the time alone, without that of a period ago."""
    return 0.5 * (point.terms.matrix(1.0) + point.terms.matrix(-1.0))


def test_the_derivative_of_a_curve():
    own = curve()
    z = scaled(own, 1.3) + np.array([0.02, 0.01, 0.01])
    terms, value = own.evaluate(z)
    matrix = own.matrix(terms, own.column(terms))
    h, columns = 1e-6, []
    for i in range(3):
        step = h * (np.arange(3) == i)
        columns.append((own.evaluate(z + step)[1] - own.evaluate(z - step)[1]) / (2 * h))
    np.testing.assert_allclose(matrix, np.array(columns).T, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(value, terms.residual / own.sizes)


def test_corrections_stay_in_their_plane():
    own = curve()
    here = own.start(as_word(table(), frame(), single())[1], 1.3)
    guess = here.z + 0.05 * here.tangent
    found = own.correct(guess, here.tangent)
    assert found is not None
    assert abs(here.tangent @ (found.z - guess)) < 1e-12
    np.testing.assert_allclose(as_rows(found.terms), single(found.value), rtol=1e-9)
    assert np.linalg.norm(found.tangent) == pytest.approx(1)
    assert 1 <= found.corrections <= 4
    assert own.correct(here.z - 2.0 * here.tangent, here.tangent) is None
    assert own.correct(np.array([math.nan, 1.0, 1.0]), here.tangent) is None


def test_events_are_located_to_rounding():
    own = curve()
    one = own.start(as_word(table(), frame(), single())[1], 1.3)
    other, nearer = (own.at_value(scaled(own, value), value) for value in (1.6, 1.4))
    exact = math.hypot(math.pi / 3, 10 / 9)
    for found in (
        located(own, one, other, doubling),
        located(own, other, one, doubling),
        located_near(own, one, doubling),
    ):
        assert found is not None
        assert abs(found.value / exact - 1) < 1e-12
        assert found.tangent @ one.tangent > 0
    assert located(own, one, nearer, doubling) is None


def test_secants_within_a_bracket():
    assert secant((1.0, 2.0), (0.0, -2.0), 0.0, 1.0) == 0.5
    assert secant((0.75, 1.0), (0.25, -2.0), 0.2, 0.9) == pytest.approx(0.25 + 1 / 3)
    # without a slope, or outside: the middle
    assert secant((1.0, 2.0), (0.0, 2.0), 0.2, 0.6) == pytest.approx(0.4)
    assert secant((1.0, 2.0), (0.0, 1.0), 0.2, 0.6) == pytest.approx(0.4)
    assert secant((1.0, math.inf), (0.0, 1.0), 0.2, 0.6) == pytest.approx(0.4)
    assert secant((1.0, 2.0), (0.0, -2.0), 0.5, 0.9) == pytest.approx(0.7)


def test_why_an_orbit_is_no_motion():
    assert Margins(equations(table(), frame(), single())).why_not() is None
    behind = equations(table(), frame(), np.array([[0.6, -0.3]]))
    object.__setattr__(behind, "rates", np.array([0.6]))
    assert "t = 0.6 s would leave the wall at -0.3 m/s" in str(Margins(behind).why_not())
    low = equations(MODES.system(0.9), frame(), np.array([0.5, 0.0]))
    ((t, height),) = low.flights.lows
    assert height < 0
    assert f"to {height:.3g} m at t = {t:.9g} s" in str(Margins(low).why_not())
    held = equations(table(e=0.0), frame(), np.array([[4.0, 0.0]]))
    assert "t = 4 s the force holds the mass" in str(Margins(held).why_not())
    # by rounding it is one
    object.__setattr__(behind, "rates", np.array([1e-13]))
    assert "leave the wall" not in str(Margins(behind).why_not())


# the least period


def test_parts_of_orbits():
    assert find._primes(1) == find._primes(0) == []
    assert find._primes(12) == [2, 3]
    assert find._primes(49) == [7]
    rows = np.tile(single(), (4, 1))
    rows += np.array([[0.0, 0.0], [TURN, 0.1], [2 * TURN, 0.0], [3 * TURN, 0.1]])
    terms = equations(table(), frame(4), rows)
    apart, mean = find._equal_parts(terms.frame, terms.y, 2, terms)
    assert apart == pytest.approx(0.0, abs=1e-14)
    np.testing.assert_allclose(mean, terms.x[:2], atol=1e-14)
    rows[:, 0] += [0.0, 0.0, 0.2, 0.2]
    terms = equations(table(), frame(4), rows)
    # times relative to half of the four periods
    assert find._equal_parts(terms.frame, terms.y, 2, terms)[0] == pytest.approx(0.2 / (2 * TURN))


def test_rows_of_a_run_that_alternates_still():
    rows = np.vstack([single(), single() + np.array([TURN, 0.0])])
    alternating = rows + np.array([[1e-3, 1e-3], [-1e-3, -1e-3]])
    multiple, least = least_rows(table(), TURN, alternating, 2)
    assert multiple == 1
    np.testing.assert_allclose(least, single(), rtol=1e-9)
    # far from it, nothing is solved
    apart = rows + np.array([[0.2, 0.3], [-0.2, -0.3]])
    assert least_rows(table(), TURN, apart, 2)[1] is apart
    once = least_rows(table(), TURN, single() * 1.01, 1)
    np.testing.assert_array_equal(once[1], single() * 1.01)
