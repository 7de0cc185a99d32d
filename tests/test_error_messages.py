"""What an error says: it names the right argument, result or method, above all to SciPy's users."""

import functools
import inspect
import pickle

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
    assert text == "simulate() got an unexpected keyword argument 'teval': did you mean 't_eval'?"
    text = message(TypeError, zivi.simulate, BALL, SPAN, START, kick=zivi.Kick(t=1.0, dv=1.0))
    assert text.endswith("argument 'kick': did you mean 'kicks'?")


def test_what_a_new_user_tries_is_answered():
    text = message(TypeError, zivi.fit, BALL, [0.45], ["e"], y0=START)
    assert text.endswith("got [0.45]; times of impacts are zivi.Bounces(times)")
    text = message(TypeError, zivi.Kick, 1.0, dv=2.0)
    assert text.endswith("write t=1.0, as in zivi.Kick(t=1.0, dv=-2.0)")
    values = {"e": [0.1, 0.2]}
    text = message(TypeError, zivi.simulate_batch, BALL, SPAN, START, **values)
    assert text.endswith("'e': values for the runs are parameters={'e': [...]}")
    text = message(ValueError, zivi.simulate_batch, lambda e: BALL, SPAN, START, parameters=values)
    assert text.endswith("got a function; zivi.sweep calls functions")
    pytest.importorskip("matplotlib")
    text = message(TypeError, zivi.plot.branch, zivi.simulate(BALL, SPAN, START))
    assert text == "b must be a Branch or MechanicalBranch, got Trajectory"


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


def of_state(t, y):
    return -9.81 - 0.3 * y[1] - 2.0 * y[0] + np.sin(t)


def of_numbers(t, x, xdot):
    return -9.81 - 0.3 * xdot - 2.0 * x + np.sin(t)


class Law:
    """A force with two arguments beside itself."""

    def __call__(self, t, y):
        assert y.shape == (2,)
        return of_state(t, y)


def with_parameter(t, y, *, drag=0.3):
    return of_state(t, y) + (0.3 - drag) * y[1]


FORMS = {
    "a function": of_state,
    "a method": Law().__call__,
    "an object": Law(),
    "a parameter by keyword": with_parameter,
    "a partial": functools.partial(lambda t, y, k: of_state(t, y) + k * y[1], k=0.0),
    "three": of_numbers,
    "three and a default": lambda t, x, xdot, k=2.0: of_numbers(t, x, xdot) + (2.0 - k) * x,
    "any number": lambda *state: of_numbers(*state),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_force_of_time_and_state(form):
    """All forms are one force: not a bit differs."""
    expected = zivi.simulate(zivi.ImpactSystem(of_numbers, e=0.5), SPAN, START)
    sol = zivi.simulate(zivi.ImpactSystem(FORMS[form], e=0.5), SPAN, START)
    np.testing.assert_array_equal(sol.x, expected.x)
    np.testing.assert_array_equal(sol.xdot, expected.xdot)


def test_forces_of_a_closed_loop_take_a_state_too():
    tracker = zivi.TwistingTracker(30, 17, h=1e-2, e=0.5)
    settings = {"t_span": (0, 0.2), "y0": (1, 0), "y_ref0": (1, 0)}
    plants = (zivi.ImpactSystem(force, e=0.5) for force in (of_state, of_numbers))
    one, other = (
        zivi.simulate_closed_loop(plant, tracker, **settings, force_model=f, force_ref=f)
        for plant, f in zip(plants, (of_state, of_numbers), strict=True)
    )
    np.testing.assert_array_equal(one.u, other.u)


@pytest.mark.parametrize(
    "wrong", [lambda t: -9.81, lambda t, x, xdot, u: -9.81, lambda: 0.0, lambda t, y, *, k: k]
)
def test_a_function_of_other_arguments_is_told_what_is_expected(wrong):
    for text in (
        message(TypeError, zivi.ImpactSystem, wrong, e=0.5),
        message(TypeError, zivi.simulate, BALL, SPAN, START, events=wrong),
    ):
        assert "must be a function of (t, x, xdot), or of (t, y) with y = [x, xdot]" in text
        assert "got a lambda(" in text


def test_an_optional_third_argument_is_not_guessed():
    text = message(TypeError, zivi.ImpactSystem, lambda t, y, g=9.81: -g, e=0.5)
    assert "functools.partial" in text
    partial = functools.partial(lambda t, y, g: -g, g=9.81)
    assert zivi.simulate(zivi.ImpactSystem(partial, e=0.5), SPAN, START).rest_time is not None


def test_a_force_that_returns_the_derivative_of_the_state_is_told():
    text = message(TypeError, zivi.simulate, zivi.ImpactSystem(of_scipy, e=0.5), SPAN, START)
    assert "got <class 'list'>: the acceleration alone, not [xdot, acceleration]" in text


def test_a_system_with_a_force_of_a_state_can_be_pickled():
    system = zivi.ImpactSystem(of_state, e=0.3, wall=zivi.HarmonicWall(0.01, 60.0))
    twin = pickle.loads(pickle.dumps(system))
    assert (twin.force, twin.e, twin.kappa, twin.wall) == (
        *(system.force, system.e, system.kappa),
        system.wall,
    )
    expected = zivi.simulate(system, SPAN, START)
    np.testing.assert_array_equal(zivi.simulate(twin, SPAN, START).x, expected.x)


@pytest.mark.slow
def test_functions_of_numba_are_compiled():
    numba = pytest.importorskip("numba")
    three, state = numba.njit(of_numbers), numba.njit(of_state)
    expected = zivi.simulate(zivi.ImpactSystem(of_numbers, e=0.5), SPAN, START)
    for force in (three, state):
        system = zivi.ImpactSystem(force, e=0.5)
        assert system._spec.is_compiled
        again = zivi.ImpactSystem(force, e=0.2)
        assert system._spec.address == again._spec.address  # compiled once
        sol = zivi.simulate(system, SPAN, START)
        assert sol.rest_time == pytest.approx(expected.rest_time, abs=1e-12)
        # a batch takes compiled forces only
        assert zivi.simulate_batch(system, SPAN, [START], method=zivi.SwitchedRK()).nfev[0] > 0
    assert not zivi.ImpactSystem(force.py_func, e=0.5)._spec.is_native

    @numba.njit
    def raising(t, x, xdot):
        if t > 0.2:
            raise ValueError("beyond the table")
        return -9.81

    with pytest.raises(ValueError, match="beyond the table") as raised:
        zivi.simulate(zivi.ImpactSystem(raising, e=0.5), SPAN, START)
    assert 0.0 < raised.value.trajectory.t[-1] <= 0.2

    @numba.njit
    def pair(t, y):
        return y[1], -9.81

    text = message(TypeError, zivi.ImpactSystem, pair, e=0.5)
    assert "numba cannot compile force to float64(float64" in text
    assert "No conversion from UniTuple" in text
    assert "force.py_func" in text
    with pytest.raises(TypeError, match="must be a function of"):
        zivi.ImpactSystem(numba.njit(lambda t: -9.81), e=0.5)


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
    if not callable(thing) or (inspect.isclass(thing) and issubclass(thing, Exception)):
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


TRACKER = zivi.TwistingTracker(30, 17, h=1e-2, e=0.5)
RUNS = {
    "trajectory": lambda: zivi.simulate(BALL, SPAN, START),
    "loop": lambda: zivi.simulate_closed_loop(BALL, TRACKER, (0, 0.1), START),
    "batch": lambda: zivi.simulate_batch(BALL, SPAN, [START], method=zivi.SwitchedRK()),
    "list": lambda: [zivi.simulate(BALL, SPAN, START)],
    "array": lambda: np.zeros(3),
}


@pytest.mark.parametrize(
    ("plot", "run", "text"),
    [
        ("signs", "batch", "draws a zivi.Trajectory or a zivi.ClosedLoop, got Batch: a batch"),
        ("control", "trajectory", "got Trajectory: a trajectory does not have a control; use zi"),
        ("multipliers", "loop", "draws a zivi.Branch, got ClosedLoop: use zivi.plot.signs for the"),
        ("position", "batch", "zivi.Trajectory or a zivi.ClosedLoop, got Batch: a batch keeps no"),
        ("overview", "batch", "zivi.plot.overview draws a"),
        ("animate", "batch", "zivi.plot.animate draws a"),
        ("velocity", "list", "got list: draw one run after the other into the same axes, ax="),
        ("phase_plane", "array", "zivi.plot.phase_plane draws a zivi.Trajectory or a zivi.Closed"),
        ("lifted", "array", "zivi.plot.lifted draws a zivi.Trajectory or a zivi.ClosedLoop"),
    ],
)
def test_a_plot_of_the_wrong_result_names_the_right_one(plot, run, text):
    import matplotlib.pyplot as plt

    more = {"period": 1.0} if plot == "poincare" else {}
    assert text in message(TypeError, getattr(zivi.plot, plot), RUNS[run](), **more)
    assert not plt.get_fignums()  # refused before a figure is opened


def test_what_a_plot_advises_works():
    trajectory, loop = RUNS["trajectory"](), RUNS["loop"]()
    zivi.plot.signs(trajectory)
    zivi.plot.signs(loop)
    falling = zivi.simulate_closed_loop(BALL, TRACKER, (0, 1), START)
    zivi.plot.poincare(falling, 0.1, section="impacts")


class Spring:
    """A controller of the user without a reference."""

    h = 1e-2

    def step(self, x, xdot, force):
        return 40.0 * (0.5 - x) - 6.0 * xdot - force


class Timed(Spring):
    def __init__(self):
        self.times = []

    def step(self, x, xdot, force, t):
        self.times.append(t)
        return super().step(x, xdot, force)


class TimedByName(Timed):
    def step(self, x, xdot, force, *, t=-1.0):
        return super().step(x, xdot, force, t)


class PositionOnly(Spring):
    """It has a reference, of which it tells the position alone."""

    x_ref = 0.5


class Following(PositionOnly):
    xdot_ref = 0.25

    def step(self, x, xdot, force, force_ref, t):
        return super().step(x, xdot, force) + 1e-3 * force_ref + 1e-4 * t


def loop_of(controller, t_span=(2, 3), **given):
    plant = given.pop("plant", BALL)
    return zivi.simulate_closed_loop(plant, controller, t_span, START, **given)


@pytest.mark.parametrize("kind", [Timed, TimedByName])
def test_a_controller_is_given_the_time_if_it_asks(kind):
    controller = kind()
    run = loop_of(controller)
    np.testing.assert_array_equal(controller.times, run.t[: len(controller.times)])
    assert len(controller.times) in (len(run.t), len(run.t) - 1)
    np.testing.assert_array_equal(run.u, loop_of(Spring()).u)


def test_a_reference_may_tell_its_position_alone():
    run = loop_of(PositionOnly())
    assert np.all(run.x_ref == 0.5)
    assert np.all(np.isnan(run.xdot_ref))
    np.testing.assert_array_equal(run.u, loop_of(Spring()).u)
    zivi.plot.overview(run)
    # the force on the reference, which no one wants, is not evaluated at a velocity of NaN
    drag = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, damping=0.1), e=0.5)
    assert loop_of(PositionOnly(), plant=drag).success


def test_a_reference_with_its_force_and_the_time():
    run = loop_of(Following(), force_ref=-3.0)
    expected = 40.0 * (0.5 - run.x) - 6.0 * run.xdot + 9.81 - 3e-3 + 1e-4 * run.t
    np.testing.assert_allclose(run.u[:-1], expected[:-1], rtol=0, atol=1e-13)
    assert np.all(run.xdot_ref == 0.25)


def test_what_a_controller_of_the_user_lacks_is_told():
    assert "force_ref must be None: the step of PositionOnly has no argument for it" in message(
        TypeError, loop_of, PositionOnly(), force_ref=-9.81
    )
    assert "Following does not have a method reset(x_ref, xdot_ref)" in message(
        TypeError, loop_of, Following(), y_ref0=(1, 0)
    )

    class Blind(Spring):
        x_ref = 0.5

        def step(self, x, xdot, force, force_ref):
            return -force

    assert loop_of(Blind()).success  # a constant force needs no velocity
    drag = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, damping=0.1), e=0.5)
    assert "Blind does not have xdot_ref" in message(TypeError, loop_of, Blind(), plant=drag)

    class Short(Spring):
        def step(self, x, xdot):
            return 0.0

    class Long(Spring):
        def step(self, x, xdot, force, force_ref):
            return 0.0

    for kind in (Short, Long):
        text = message(TypeError, loop_of, kind())
        assert "controller.step must take (x, xdot, force), then force_ref if it has an at" in text
        assert f"that of {kind.__name__} takes (x, xdot" in text


def test_a_start_without_its_time_or_with_another_size_is_told_the_right_form():
    chain = zivi.LinearSystem(
        np.eye(2), 0.1 * np.eye(2), np.eye(2), excitation=zivi.Harmonic([1.0, 0.0], 2.0)
    )
    for start in (([0.0, 0.0], [0.0, 0.0]), (np.zeros(2), np.zeros(2))):
        assert "(t0, (q, qdot))" in message(TypeError, zivi.periodic_orbit, chain, start)
    ball = zivi.mechanics.Body("ball", kind="free", mass=1.0, inertia=0.1)
    text = message(ValueError, zivi.simulate, zivi.Tree([ball]), SPAN, ([0, 0, 1], [0, 0, 0]))
    assert "(qpos, qvel) with 7 and 6 numbers" in text


def test_an_orbit_is_drawn_by_its_trajectory():
    shaken = zivi.ImpactSystem(zivi.LinearForce(gravity=1, amplitude=1.3), e=0.5)
    orbit = zivi.periodic_orbit(shaken, (0, (2, 2)))
    assert message(TypeError, zivi.plot.position, orbit).endswith("draw its attribute trajectory")
    assert len(zivi.plot.position(orbit.trajectory).lines) > 0


def test_controllers_of_one_mass_are_sent_to_the_c_library():
    regulator = zivi.TwistingRegulator(10, 5, h=1e-3, e=0.5)
    text = message(TypeError, zivi.native.gap_tracker_source, regulator)
    assert "zivi.native.prefix()" in text
