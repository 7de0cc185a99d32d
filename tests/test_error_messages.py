"""What an error says: it names the right argument, result or method, above all to SciPy's users."""

import inspect

import numpy as np
import pytest

import zivi

BALL = zivi.ImpactSystem(-9.81, e=0.5)
SPAN, START = (0, 3), (1, 0)


def of_scipy(t, y):
    return [y[1], -9.81]


def message(error, function, *args, **kwargs):
    with pytest.raises(error) as raised:
        function(*args, **kwargs)
    return str(raised.value)


@pytest.mark.parametrize(
    ("setting", "value", "call"),
    [
        ("rtol", 1e-8, "simulate(..., method=zivi.SwitchedRK(rtol=1e-08))"),
        ("atol", 1e-8, "method=zivi.SwitchedRK(atol=1e-08)"),
        ("max_step", 0.1, "method=zivi.SwitchedRK(max_step=0.1)"),
        ("first_step", 0.1, "method=zivi.SwitchedRK(first_step=0.1)"),
        ("h", 1e-3, "method=zivi.ThetaGamma(h=0.001)"),
    ],
)
def test_a_setting_of_a_method_is_sent_there(setting, value, call):
    text = message(TypeError, zivi.simulate, BALL, SPAN, START, **{setting: value})
    assert f"unexpected keyword argument {setting!r}" in text
    assert call in text
    made = eval(call.partition("method=")[2].rstrip(")") + ")", {"zivi": zivi})
    assert zivi.simulate(BALL, SPAN, START, method=made).success  # what it advises works


def test_a_setting_given_to_a_closed_loop_is_sent_to_its_method():
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=0.5)
    text = message(TypeError, zivi.simulate_closed_loop, BALL, tracker, SPAN, START, rtol=1e-6)
    assert "simulate_closed_loop(..., method=zivi.SwitchedRK(rtol=1e-06))" in text


def test_other_arguments_of_solve_ivp_are_told():
    assert "functools.partial" in message(TypeError, zivi.simulate, BALL, SPAN, START, args=(1,))
    assert "zivi.ImpactSystem(force, e=...)" in message(
        TypeError, zivi.simulate, BALL, SPAN, START, e=0.5
    )
    text = message(TypeError, zivi.simulate, BALL, SPAN, START, teval=[1.0])
    assert text == "simulate() got an unexpected keyword argument 'teval'"


@pytest.mark.parametrize(
    ("method", "advice"),
    [
        (zivi.SwitchedRK, "call it, zivi.SwitchedRK()"),
        (zivi.ThetaGamma, "call it, zivi.ThetaGamma(h=1e-3)"),
        ("RK45", "'RK45': the high-order method here is zivi.SwitchedRK(order=5)"),
        ("DOP853", "zivi.SwitchedRK(), of order 8"),
        ("Radau", "'Radau': the high-order method here is zivi.SwitchedRK()"),
        ("switchedrk", "the object is meant, zivi.SwitchedRK()"),
        (zivi.Trajectory, "the class zivi.Trajectory: the high-order method here is"),
        (1e-3, "zivi.SwitchedRK(rtol=1e-6) or zivi.ThetaGamma(h=1e-3), got 0.001"),
    ],
)
def test_a_class_or_a_name_as_method_is_told_the_object(method, advice):
    assert advice in message(TypeError, zivi.simulate, BALL, SPAN, START, method=method)
    assert advice in message(TypeError, zivi.simulate_batch, BALL, SPAN, START, method=method)


def test_a_name_as_method_of_a_closed_loop():
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=0.5)
    loop = zivi.simulate_closed_loop
    text = message(TypeError, loop, BALL, tracker, SPAN, START, method="RK45")
    assert "zivi.SwitchedRK(order=5)" in text


@pytest.mark.parametrize(
    ("first", "advice"),
    [
        (of_scipy, "got a force: the force makes a system with a wall, zivi.simulate(zivi.Impact"),
        (of_scipy, "the acceleration alone, not [xdot, acceleration]"),
        (-9.81, "got the number -9.81: the force makes a system"),
        (SPAN, "got (0, 3): the system is the first argument, the span the second"),
        (np.array(SPAN), "the system is the first argument"),
        (zivi.ImpactSystem, "got the class, not a system"),
        (None, "must be a zivi.ImpactSystem, got NoneType"),
    ],
)
def test_the_order_of_solve_ivp_is_recognised(first, advice):
    rest = (BALL, START) if first is SPAN else (SPAN, START)
    assert advice in message(TypeError, zivi.simulate, first, *rest)


def test_states_may_be_arrays():
    sol = zivi.simulate(BALL, np.array([0.0, 3.0]), np.array([1, 0]))
    assert sol.rest_time == zivi.simulate(BALL, SPAN, START).rest_time
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=0.5)
    run = zivi.simulate_closed_loop(
        BALL, tracker, (0, 0.01), np.array([1, 0]), y_ref0=np.array([1, 0])
    )
    assert run.config["y_ref0"] == [1.0, 0.0]
    y0 = inspect.signature(zivi.simulate).parameters["y0"]
    assert y0.annotation == "ArrayLike"


@pytest.mark.parametrize("name", zivi.__all__)
def test_signatures_are_readable(name):
    """In help() an annotation is as it is written, not a type variable's expansion."""
    thing = getattr(zivi, name)
    if not callable(thing):
        return
    shown = str(inspect.signature(thing))
    assert "ndarray[tuple" not in shown
    assert "numpy._typing" not in shown


def test_linear_force_takes_names_only():
    with pytest.raises(TypeError, match="positional argument"):
        zivi.LinearForce(4.0, 0.1)


def test_the_status_says_that_it_is_not_scipys():
    assert "**not** those of SciPy" in zivi.Status.__doc__
    sol = zivi.simulate(BALL, SPAN, START, events=apex)
    assert sol.success
    assert sol.status == zivi.Status.TERMINATED_BY_EVENT == 9


def apex(t, x, xdot):
    return xdot


apex.terminal = True
