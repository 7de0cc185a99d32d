"""The experiments that studies can name, against closed forms."""

import math

import numpy as np
import pytest

import zivi
from zivi.study import EXPERIMENTS


def test_the_list_of_experiments():
    assert list(EXPERIMENTS) == ["ball_rest_time", "table_period", "tracker_gains"]
    assert all(function.units for function in EXPERIMENTS.values())


def test_rest_times_follow_the_formula():
    study = zivi.sweep("ball_rest_time", {"e": [0.2, 0.5, 0.8], "v0": [-1.0, 0.0, 3.0]})
    assert np.max(np.abs(study.error)) < 1e-7
    assert study.rest_time.attrs["units"] == "s"
    assert study.e.attrs["units"] == "1"
    # the seed paper's ball
    paper = EXPERIMENTS["ball_rest_time"](e=0.59 / 1.41, v0=6.0)
    assert paper["exact"] == pytest.approx(2.4658466, abs=1e-7)


def test_the_error_of_fixed_steps_shrinks_with_the_step():
    study = zivi.sweep("ball_rest_time", {"h": [1e-2, 1e-3, 1e-4]}, fixed={"e": 0.5})
    errors = np.abs(study.error.values)
    assert errors[0] > 5 * errors[1] > 25 * errors[2] > 0


@pytest.mark.parametrize("e", [0.5, 0.8])
def test_the_period_doubles_where_the_formula_says(e):
    """Stable between the saddle-node and the period doubling of the orbit of period 1."""
    node = math.pi * (1 - e) / (1 + e)
    double = math.hypot(node, 2 * (1 + e**2) / (1 + e) ** 2)
    assert double == pytest.approx({0.5: 1.526824, 0.8: 1.070836}[e], abs=1e-6)
    inside = [node + part * (double - node) for part in (0.1, 0.5, 0.95)]
    study = zivi.sweep("table_period", {"Gamma": [*inside, 1.02 * double]}, fixed={"e": e})
    assert study.period.values.tolist() == [1.0, 1.0, 1.0, 2.0]
    # a flight lasts a period: relative speed g T (n = 1), of which the table gives its part
    assert study.impacts.values.tolist() == [16.0] * 4


def test_no_period_is_longer_than_what_is_looked_for():
    found = [EXPERIMENTS["table_period"](Gamma=1.56, longest=k)["period"] for k in (1, 2)]
    np.testing.assert_array_equal(found, [np.nan, 2.0])


def test_a_table_that_is_too_slow_carries_the_ball():
    found = EXPERIMENTS["table_period"](Gamma=0.9)
    assert found["speed"] == 0.0
    assert found["period"] == 1.0


def test_more_gain_settles_sooner_and_costs_more():
    study = zivi.sweep("tracker_gains", {"mu1": [25.0, 30.0, 60.0]})
    assert np.all(study.error == 0.0)
    assert np.all(np.diff(study.effort) != 0.0)
    assert float(study.settling_time[2]) <= float(study.settling_time[0])
    assert study.settling_time.attrs["units"] == "s"


def test_a_tracker_that_is_too_weak_does_not_settle():
    weak = EXPERIMENTS["tracker_gains"](mu1=0.5, mu2=0.4)
    assert math.isnan(weak["settling_time"])


@pytest.mark.parametrize(
    ("name", "arguments", "text"),
    [
        ("ball_rest_time", {"e": 1.0}, "0 < e < 1"),
        ("table_period", {"Gamma": 0.0}, "Gamma must be > 0"),
        ("table_period", {"longest": 0}, "longest >= 1"),
        ("tracker_gains", {"mu1": -1.0}, "mu1"),
    ],
)
def test_wrong_arguments_fail_at_their_points(name, arguments, text):
    with pytest.raises(ValueError, match=text):
        EXPERIMENTS[name](**arguments)
