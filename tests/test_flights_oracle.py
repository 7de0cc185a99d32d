"""Flights by power series against quadruple precision, closed forms and the embedded pair.

``tests/data/flights.json`` is of ``benchmarks/flights.py``, which has the large sweeps.
"""

import json
from pathlib import Path
from random import Random

import numpy as np
import pytest

import flight_draws
import zivi

DATA = json.loads((Path(__file__).parent / "data" / "flights.json").read_text())
FIRST, TOUCH = (np.array(DATA[key]) for key in ("first", "touch"))


@pytest.mark.parametrize(("least", "most", "error"), [(-1, 100, 5e-15), (100, 1e7, 1e-13)])
def test_first_impacts(least, most, error):
    """A mass that a damper of 1e3 1/s has stopped arrives so slowly that rounding tells."""
    rows = FIRST[(FIRST[:, 1] >= least) & (FIRST[:, 1] < most)]
    flights, truth = rows[:, :10], rows[:, 10:]
    found = flight_draws.compare(flights, flight_draws.first_impacts(flights), truth)
    assert found.flights > 100
    assert found.impacts > 40
    assert (found.missed, found.invented, found.unknown) == (0, 0, 0)
    assert np.quantile(found.errors, 0.99) < error
    assert found.errors.max() < 1e-12
    assert np.quantile(found.speeds, 0.95) < 1e-13


def test_flights_that_nearly_touch():
    """Whether they do is agreed upon down to a few roundings of the scale."""
    missed, invented, error = flight_draws.compare_touches(TOUCH[:, :10], TOUCH[:, 10:])
    assert len(error) > 20
    assert max(missed, default=0) < 2e-14
    assert max(invented, default=0) < 2e-14
    assert error.max() < 1e-14
    depths = TOUCH[:, -1]
    assert np.sum(np.abs(depths) < 1e-12) > 15
    assert len(missed) < np.sum(depths > 0) / 3


@pytest.mark.parametrize("row", range(0, len(FIRST), 23))
def test_the_oracle_has_the_closed_form(row):
    """The exponential of the matrix of ``(x, x', cos, sin, 1)``."""
    mpmath = pytest.importorskip("mpmath")
    k, c, g, amplitude, w, phi, t0, x0, v0, length, found, tau, rest, speed = map(
        mpmath.mpf, FIRST[row]
    )
    with mpmath.workdps(40):
        matrix = mpmath.matrix(5, 5)
        matrix[0, 1] = 1
        for column, entry in enumerate((-k, -c, amplitude, 0, -g)):
            matrix[1, column] = entry
        matrix[2, 3], matrix[3, 2] = -w, w
        start = mpmath.matrix([x0, v0, mpmath.cos(w * t0 + phi), mpmath.sin(w * t0 + phi), 1])
        state = mpmath.expm(matrix * ((tau + rest) if found else length)) * start
        if not found:
            assert state[0] > 0
            return
        size = x0 + abs(v0) * tau + g * tau**2
        assert abs(state[0]) < 1e-28 * (size + 1)
        assert state[1] == pytest.approx(float(speed), rel=1e-15)
        # nor is there one before, as far as some samples show
        step = mpmath.expm(matrix * (tau + rest) / 16)
        for _ in range(15):
            start = step * start
            assert start[0] > 0


def test_whole_runs_are_those_of_the_pair():
    random = Random(5)
    for _ in range(30):
        case = flight_draws.run(random)
        distance, alike = flight_draws.beside_the_pair(case)
        assert alike, case
        assert distance < 1e-9, case


def test_a_billion_periods_later_the_motion_is_the_same():
    """Phases are exact far from ``t = 0`` too: only the times of the impacts are rounded."""
    mpmath = pytest.importorskip("mpmath")
    numbers = flight_draws.OSCILLATOR
    start = float(1e9 * 2 * np.pi / numbers["omega"])
    with mpmath.workdps(40):
        turns = mpmath.mpf(numbers["omega"]) * mpmath.mpf(start) / (2 * mpmath.pi)
        phase = float(2 * mpmath.pi * (turns - mpmath.nint(turns)))
    early, late = (
        zivi.simulate(
            zivi.ImpactSystem(zivi.LinearForce(**numbers, phase=shift), e=0.8),
            (t0, t0 + 300),
            (1, 0),
            dense_output=False,
        ).impacts
        for shift, t0 in ((phase, 0.0), (0.0, start))
    )
    assert len(early) == len(late) > 40
    assert np.abs(early["xdot_after"] - late["xdot_after"]).max() < 1e-13
    assert np.abs(late["t"] - start - early["t"]).max() <= np.spacing(start)


def test_areas_of_the_impact_map():
    assert flight_draws.errors_of_areas(3000, 1).max() < 1e-13


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize(("flights", "order"), [("series", 8), ("rk", 8), ("rk", 5)])
def test_near_elastic_impacts_come_to_rest_within_the_tolerance(flights, order, rtol):
    error, impacts = flight_draws.near_elastic(flights, rtol, order)
    assert error < rtol
    assert impacts < 80_000
