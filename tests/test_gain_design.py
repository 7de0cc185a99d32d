"""Gains that are computed: what they promise, against closed forms and runs."""

import importlib.util
import pickle
from pathlib import Path

import numpy as np
import pytest

import zivi
from zivi.design import settling

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "gain_synthesis.py"


@pytest.fixture(scope="module")
def synthesis():
    spec = importlib.util.spec_from_file_location("gain_synthesis", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("kind", ["tracker", "regulator"])
def test_what_is_asked_for_is_met(synthesis, kind):
    found = synthesis.measure(kind, 8, 42)
    assert np.all(found <= 1.0)
    assert np.median(found) > 0.4  # and not by gains without measure


def bounce(e, rising, falling, x):
    """Time to rest from x, flight by flight."""
    t, v = np.sqrt(2 * x / falling), np.sqrt(2 * falling * x)
    while v > 1e-12:
        v *= e
        top = v * v / (2 * rising)
        t += v / rising + np.sqrt(2 * top / falling)
        v = np.sqrt(2 * falling * top)
    return t


@pytest.mark.parametrize("e", [0.1, 0.5, 0.9])
def test_the_settling_bound_is_the_time_itself_without_an_unknown_force(e):
    for rising, falling, x in ((11.0, 7.0, 1.0), (20.0, 3.0, 0.3)):
        wanted = bounce(e, rising, falling, x)
        found = float(settling(e, np.array(rising), np.array(falling), 0.0, (x, 0.0)))
        assert found == pytest.approx(wanted, rel=1e-9)
        r = falling / rising
        closed = np.sqrt(2 * x / falling) * (1 + e * r) / (1 - e * np.sqrt(r))
        assert found == pytest.approx(closed, rel=1e-12)
    # upwards with v is as from the top, later by the climb; downwards earlier by the fall
    up = float(settling(e, np.array(11.0), np.array(7.0), 0.0, (1.0, 3.0)))
    top = 1 + 9 / 22
    assert up == pytest.approx(3 / 11 + bounce(e, 11.0, 7.0, top), rel=1e-9)
    down = float(settling(e, np.array(11.0), np.array(7.0), 0.0, (1.0, -3.0)))
    assert down == pytest.approx(bounce(e, 11.0, 7.0, 1 + 9 / 14) - 3 / 7, rel=1e-9)


def test_an_unknown_force_makes_it_no_shorter_and_has_a_condition():
    times = [
        float(settling(0.7, np.array(11.0), np.array(7.0), bound, (1.0, 0.5)))
        for bound in np.linspace(0, 8, 17)
    ]
    assert times == sorted(times)
    # D > M, U > M and e sqrt((D+M)/(U-M)) < 1
    assert np.isfinite(times[3])
    assert not np.isfinite(times[14])


@pytest.mark.parametrize("kind", ["tracker", "regulator"])
@pytest.mark.parametrize("e", [0.2, 1 / 3, 0.5, 0.7, 0.8, 0.9, 0.95])
def test_the_best_ratio_is_the_numeric_minimum(kind, e):
    ratios = np.linspace(0.0, 0.9999, 200_001)
    if kind == "tracker":
        rising, falling = 2 * e * (1 + ratios) / (1 + e), 2 * (1 - ratios) / (1 + e)
    else:
        rising, falling = 1 + ratios, 1 - ratios
    scaled = settling(e, rising, falling, 0.0, (1.0, 0.0)) * np.sqrt(np.maximum(rising, falling))
    assert zivi.best_ratio(e, kind) == pytest.approx(ratios[np.argmin(scaled)], abs=1e-3)


def test_the_best_time_for_the_largest_acceleration():
    """T sqrt(U/2X) of the derivation in control.md."""
    for e, wanted in zip(
        (0.2, 1 / 3, 0.5, 0.7, 0.8, 0.9, 0.95), (1.5, 2, 2.73, 3.58, 4, 4.42, 4.62), strict=True
    ):
        ratio = zivi.best_ratio(e)
        rising, falling = np.array(2 * e * (1 + ratio)), np.array(2 * (1 - ratio))
        time = float(settling(e, rising, falling, 0.0, (1.0, 0.0)))
        assert time * np.sqrt(float(rising) / 2) == pytest.approx(wanted, rel=3e-3)


def test_the_designs_of_the_documentation():
    for design, mu1, mu2 in (
        (zivi.design_tracker(1.5, e=0.5, bound=1.0), 11.39, 6.09),
        (zivi.design_tracker(1.5, e=0.8, bound=1.0), 16.67, 10.53),
        (zivi.design_regulator(1.5, e=0.5, bound=1.0), 9.36, 2.30),
    ):
        assert design.mu1 == pytest.approx(mu1, rel=0.01)
        assert design.mu2 == pytest.approx(mu2, rel=0.02)
        assert design.settling_time <= 1.5 * (1 + 1e-12)
        assert design.controller().settings["mu1"] == design.mu1
        assert pickle.loads(pickle.dumps(design)) == design


@pytest.mark.parametrize("kind", ["tracker", "regulator"])
def test_with_a_delay_it_samples_faster_and_is_in_time(kind):
    make = zivi.design_tracker if kind == "tracker" else zivi.design_regulator
    more = {"y_ref0": (0, 0), "force_model": -9.81} if kind == "tracker" else {}
    force = -9.81 if kind == "tracker" else 0.0
    design = make(1.0, e=0.8, bound=0.5, delay=3, force=force)
    assert design.h == pytest.approx(make(1.0, e=0.8, bound=0.5, force=force).h / 4)
    assert design.controller().ahead == 4
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(force - 0.45, e=0.8),
        design.controller(),
        (0, 1.5),
        (1, 0),
        delay=3,
        **more,
    )
    assert run.rest_time < design.settling_time
    assert np.abs(run.u).max() <= design.peak * (1 + 1e-12)


def test_what_the_actuator_cannot_is_told_with_what_it_can():
    for limits in (30.0, (-30.0, 50.0)):
        with pytest.raises(zivi.InfeasibleError, match=r"feasible is settling_time >= ") as raised:
            zivi.design_tracker(0.5, e=0.5, bound=1.0, u_limits=limits)
        feasible = raised.value.settling_time
        assert zivi.design_tracker(feasible, e=0.5, bound=1.0, u_limits=limits).peak <= 30.0
        with pytest.raises(zivi.InfeasibleError):
            zivi.design_tracker(0.99 * feasible, e=0.5, bound=1.0, u_limits=limits)
    with pytest.raises(zivi.InfeasibleError, match="too weak for any") as raised:
        zivi.design_tracker(0.5, e=0.5, bound=15.0, u_limits=30.0)
    assert raised.value.settling_time is None
    again = pickle.loads(pickle.dumps(raised.value))
    assert (str(again), again.peak) == (str(raised.value), raised.value.peak)
    # a reference that moves asks for more
    assert (
        zivi.design_tracker(1.0, e=0.5, force_ref=20.0).peak > zivi.design_tracker(1.0, e=0.5).peak
    )


@pytest.mark.parametrize("make", [zivi.design_tracker, zivi.design_regulator])
def test_bad_input(make):
    for arguments, name in (
        ({"settling_time": 0.0, "e": 0.5}, "settling_time"),
        ({"settling_time": np.nan, "e": 0.5}, "settling_time"),
        ({"settling_time": 1.0, "e": 1.0}, "e must be in"),
        ({"settling_time": 1.0, "e": 0.0}, "e must be in"),
        ({"settling_time": 1.0}, "exactly one of e and kappa"),
        ({"settling_time": 1.0, "e": 0.5, "bound": -1.0}, "bound"),
        ({"settling_time": 1.0, "e": 0.5, "start": (-1.0, 0.0)}, "start"),
        ({"settling_time": 1.0, "e": 0.5, "u_limits": (1.0, 2.0)}, "u_limits"),
        ({"settling_time": 1.0, "e": 0.5, "u_limits": -1.0}, "u_limits"),
        ({"settling_time": 1.0, "e": 0.5, "delay": -1}, "delay"),
        ({"settling_time": 1.0, "e": 0.5, "force": np.inf}, "force"),
    ):
        with pytest.raises(ValueError, match=name):
            make(**arguments)
    with pytest.raises(TypeError):
        make("soon", e=0.5)
    with pytest.raises(ValueError, match="kind"):
        zivi.best_ratio(0.5, "observer")
