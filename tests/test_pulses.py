"""Pulses and square waves: tables whose edges are steps."""

import pickle

import numpy as np
import pytest

import zivi


def test_no_pulse_is_missed():
    push = zivi.Pulse(60.0, 1e-3, 3.0)
    system = zivi.ImpactSystem(zivi.LinearForce(excitation=push), e=0.5)
    sol = zivi.simulate(system, (0, 100), (1, 0))
    # x = 1 + a w (t - 60 - w/2)
    assert abs(sol.xdot[-1] - 3e-3) < 1e-14
    assert abs(sol.x[-1] - (1.0 + 3e-3 * (40.0 - 0.5e-3))) < 1e-12


def test_pulses_lift_a_mass_from_rest():
    push = zivi.Pulse([1.0, 4.0], 0.5, 20.0)
    force = zivi.LinearForce(gravity=10.0, excitation=push)
    sol = zivi.simulate(zivi.ImpactSystem(force, e=0.0), (0, 7), (0, 0))
    # up for 0.5 s with 10 m/s^2, then free: v = 5, x = 1.25, lands (1 + sqrt(1.5))/2 later
    lands = 1.5 + (1.0 + np.sqrt(2.0)) / 2.0
    assert np.abs(sol.liftoff_times - [1.0, 4.0]).max() < 1e-12
    assert np.abs(sol.impacts["t"] - [lands, lands + 3.0]).max() < 1e-9


def test_a_square_wave_is_the_function():
    wave = zivi.Square(2.0, 0.25, 3.0, start=0.5)
    t = np.linspace(-5.0, 9.0, 1407)
    phase = np.mod(t - 0.5, 2.0)
    clear = (np.abs(phase - 0.5) > 1e-9) & (phase > 1e-9) & (phase < 2.0 - 1e-9)
    assert np.array_equal(wave(t)[clear], np.where(phase < 0.5, 3.0, 0.0)[clear])
    system = zivi.ImpactSystem(zivi.LinearForce(excitation=wave), e=0.5)
    sol = zivi.simulate(system, (0, 100), (1, 0))
    assert abs(sol.xdot[-1] - 50 * 0.5 * 3.0) < 1e-11


def test_inputs_of_mechanisms_are_pulses():
    push = zivi.Pulse(60.0, 0.5, 2.0)
    system = zivi.LinearSystem([[2.0]], [[0.0]], [[0.0]], gaps=[], excitation=push)
    sol = zivi.simulate(system, (0, 100), ([0.0], [0.0]))
    assert abs(sol.qdot[-1, 0] - 0.5) < 1e-12


def test_pulses_are_shown_and_kept():
    for it in (zivi.Pulse(1.0, 0.5), zivi.Square(2.0, 0.25, start=1.0)):
        again = pickle.loads(pickle.dumps(it))
        assert again == it
        assert repr(again) == repr(it)
    assert repr(zivi.Pulse(1.0, 0.5)) == "Pulse(1.0, width=0.5, height=1)"
    assert repr(zivi.Square(2.0)) == "Square(2, duty=0.5, height=1, start=0)"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: zivi.Pulse(1.0, 0.0), "width must be > 0"),
        (lambda: zivi.Pulse([1.0, 1.5], 0.5), "t must have differences > width"),
        (lambda: zivi.Pulse([], 0.5), "t must be one finite time"),
        (lambda: zivi.Pulse(np.nan, 0.5), "t must be one finite time"),
        (lambda: zivi.Square(0.0), "period must be > 0"),
        (lambda: zivi.Square(1.0, 1.0), r"duty must be in \(0, 1\)"),
        (lambda: zivi.Square(1.0, 0.5, np.inf), "height"),
    ],
)
def test_what_is_out_of_range_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
