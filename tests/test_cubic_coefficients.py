"""The cubic coefficient of period doublings, against orbits of twice the period."""

import numpy as np
import pytest

import zivi
from inside import Path, doubled, evaluate, sizes_of
from orbit_systems import chain2, listed, rest2


def multiplier_law(event, name, cubic):
    r"""Give (1 - mu) / (4 c a^2) of a doubled orbit, whose multiplier is mu = 1 - 4 c a^2 + ..."""
    terms = evaluate(event.orbit._frame, event.orbit._y)
    frame, y, direction = doubled(terms)
    path = Path(frame, name, y, 1.0)
    normal = np.append(direction / path.scale[:-1], 0.0)
    normal /= np.linalg.norm(normal)
    # the scale of the orbit that doubles
    scale = np.tile(sizes_of(terms)[0], 2)
    length = 0.01 / np.sqrt(abs(cubic))
    part = length / np.linalg.norm(normal[:-1] * path.scale[:-1] / scale)
    point = path.correct(path.scaled(y, event.value) + part * normal, normal)
    near = point.multipliers[np.argmin(np.abs(point.multipliers - 1.0))].real
    # of both halves, moved to either side
    return (1.0 - near) / (4.0 * cubic * 0.5 * length**2)


@pytest.fixture(scope="module")
def chart():
    given = (["I stop"] * 4, listed("two_dof_four_impacts", "t"))
    return zivi.continue_orbit(zivi.periodic_orbit(chain2(), given), "omega", (0.88, 1.52))


def test_doubled_orbits_have_the_stability_of_the_cubic_coefficient(chart):
    doublings = chart.of_kind("period_doubling")
    assert len(doublings) >= 8
    for event in doublings:
        assert abs(multiplier_law(event, "omega", event.cubic) - 1.0) < 0.05
    assert min(event.cubic for event in doublings) < 0.0 < max(event.cubic for event in doublings)
    assert chart.of_kind("fold")[0].cubic is None


def test_of_orbits_that_rest_and_of_halves():
    orbit = zivi.periodic_orbit(rest2(), zivi.simulate(rest2(), (0, 200), ([2, 2], [0, 0])))
    branch = zivi.continue_orbit(orbit, "road.amplitude", (1.2, 1.62), step=0.1)
    (event,) = branch.of_kind("period_doubling")
    assert event.cubic > 0.0
    assert abs(multiplier_law(event, "road.amplitude", event.cubic) - 1.0) < 0.01


@pytest.mark.slow
def test_a_curve_of_doublings_tells_where_they_change(chart):
    event = next(it for it in chart.of_kind("period_doubling") if it.cubic < 0.0)
    spans = ((1.27, 1.3), (0.9, 2.3))
    curve = zivi.continue_curve(event, ("omega", "F"), spans, step=0.05)
    (point,) = curve.of_kind("generalized_period_doubling")
    assert np.all(np.abs(point.values - [1.28279065, 2.17962897]) < 1e-7)
    # doubled orbits on its two sides, each continued over F: stable on one
    k = int(np.argmin(np.abs(curve.values[:, 1] - point.values[1])))
    signs = []
    for i in (k - 2, k + 2):
        orbit = curve.orbits(i)
        value = curve.values[i, 1]
        beside = zivi.MechanicalEvent("period_doubling", float(value), orbit, name="F")
        signs.append(np.sign(multiplier_law(beside, "F", 1.0)))
    assert sorted(signs) == [-1.0, 1.0]
