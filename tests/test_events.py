"""Events of the user: zeros of g(t, x, x') along a run, by every kind of method."""

import functools
import itertools
import math
from operator import attrgetter

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import solve_ivp

import zivi
from closed_form import Ball
from scheme import fitted_order, jittered

G = 9.81
BALL = zivi.ImpactSystem(-G, e=0.5)
EXACT = Ball(1, 0, e=0.5, g=G)
TABLE = zivi.LinearForce(gravity=G, amplitude=14.715, omega=2 * np.pi, phase=-np.pi / 2)
FINE = zivi.SwitchedRK(rtol=1e-11, atol=1e-11)
BOTH = pytest.mark.parametrize(
    "method", [FINE, zivi.ThetaGamma(h=1e-3)], ids=["SwitchedRK", "ThetaGamma"]
)


def event(function, **attributes):
    for name, value in attributes.items():
        setattr(function, name, value)
    return function


def velocity(**attributes):
    return event(lambda t, x, xdot: xdot, **attributes)


def follow(events, system=BALL, span=(0, 3), state=(1, 0), method=FINE, **more):
    return zivi.simulate(system, span, state, method=method, events=events, **more)


def times_of(events, **more):
    return [t.tolist() for t in follow(events, **more).t_events]


def impacts_of_ball(n):
    return [EXACT.impact(k)[0] for k in range(n)]


def test_apexes():
    """Every one that is looked at, in the tail too: half a flight after an impact."""
    sol = follow(velocity(direction=-1))
    starts = np.array(impacts_of_ball(31))
    apexes = 0.5 * (starts[1:] + starts[:-1])
    assert len(sol.resolved_impacts) < 12
    assert len(sol.t_events[0]) >= 30
    np.testing.assert_allclose(sol.t_events[0][:30], apexes, rtol=0, atol=1e-12)
    heights = [(0.5**n) ** 2 for n in range(1, 31)]
    np.testing.assert_allclose(sol.y_events[0][:30, 0], heights, rtol=1e-8, atol=1e-16)
    np.testing.assert_allclose(sol.y_events[0][:, 1], 0.0, atol=1e-12)
    # the last ones are those of the tail as a whole, none after the Zeno point
    assert sol.t_events[0][-1] <= sol.zeno_times[0]


def test_impacts_as_rising_velocity():
    """A velocity that changes its sign by an impact is an event then, with the state after it."""
    sol = follow(velocity(direction=1))
    n = len(sol.resolved_impacts)
    np.testing.assert_array_equal(sol.t_events[0][:n], sol.resolved_impacts["t"])
    np.testing.assert_array_equal(sol.y_events[0][:n, 1], sol.resolved_impacts["xdot_after"])
    np.testing.assert_array_equal(sol.y_events[0][:n, 0], 0.0)
    np.testing.assert_allclose(sol.t_events[0][:25], impacts_of_ball(25), rtol=0, atol=1e-12)


def test_touchdown_is_one_falling_event():
    """``g = x`` is zero at the impact and reached once, with the state before it."""
    for direction, expected in ((0, 2), (-1, 2), (1, 0)):
        sol = follow(event(lambda t, x, xdot: x, direction=direction), span=(0, 1.05))
        assert len(sol.t_events[0]) == expected
    sol = follow(lambda t, x, xdot: x, span=(0, 1.05))
    np.testing.assert_allclose(sol.t_events[0], sol.resolved_impacts["t"], rtol=0, atol=1e-14)
    np.testing.assert_array_equal(sol.y_events[0][:, 0], 0.0)
    np.testing.assert_array_equal(sol.y_events[0][:, 1], sol.resolved_impacts["xdot_before"])
    down = [follow(lambda t, x, xdot: x, span=(0, end)).t_events[0] for end in (1.35, 3)]
    assert len(down[0]) == 8
    assert len(down[1]) > 25


@pytest.mark.parametrize("height", [0.9, 0.5, 0.2, 0.05, 1e-3])
def test_thresholds(height):
    """Crossed downwards and upwards on every arc that is higher."""
    sol = follow(lambda t, x, xdot: x - height)
    expected = [math.sqrt(2 * (1 - height) / G)]
    for n in range(40):
        t, before = EXACT.impact(n)
        up = 0.5 * before
        if up**2 / (2 * G) > height:
            root = math.sqrt(up**2 - 2 * G * height)
            expected += [t + (up - root) / G, t + (up + root) / G]
    np.testing.assert_allclose(sol.t_events[0], expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(sol.y_events[0][:, 0], height, rtol=0, atol=1e-12)
    rising = times_of(event(lambda t, x, xdot: x - height, direction=1))[0]
    falling = times_of(event(lambda t, x, xdot: x - height, direction=-1))[0]
    assert sorted(rising + falling) == sol.t_events[0].tolist()
    assert rising == sol.t_events[0].tolist()[1::2]


@BOTH
def test_direction_by_every_method(method):
    """Of the threshold at 0.2 m: down, up and down again; of the velocity, at impacts up."""
    height = [event(lambda t, x, xdot: x - 0.2, direction=d) for d in (-1, 0, 1)]
    down, both, up = times_of(height, method=method)
    assert (len(down), len(both), len(up)) == (2, 3, 1)
    assert sorted(down + up) == both
    assert down[0] < up[0] < down[1]
    falling, rising = times_of([velocity(direction=d) for d in (-1, 1)], method=method)
    np.testing.assert_allclose(rising[:3], impacts_of_ball(3), rtol=0, atol=1e-2)
    apexes = [0.5 * (a + b) for a, b in itertools.pairwise(impacts_of_ball(3))]
    np.testing.assert_allclose(falling[:2], apexes, rtol=0, atol=1e-2)


@pytest.mark.parametrize("order", [8, 5])
def test_stroboscopic_section(order):
    """States once in a period, by ``sin(w t)`` rising: times exact, states those of sol(t)."""
    method = zivi.SwitchedRK(rtol=1e-9, atol=1e-9, order=order, max_step=0.3)
    section = event(lambda t, x, xdot: math.sin(2 * math.pi * t), direction=1)
    sol = follow(section, zivi.ImpactSystem(TABLE, e=0.5), (0.5, 30.2), (0.2, 0), method)
    np.testing.assert_allclose(sol.t_events[0], np.arange(1, 31), rtol=0, atol=1e-12)
    np.testing.assert_allclose(sol.y_events[0].T, sol(sol.t_events[0]), rtol=1e-9, atol=1e-12)
    # at rest at these moments, as the reference of this table says
    assert not sol.y_events[0][1:].any()


@BOTH
@pytest.mark.parametrize(
    "function",
    [
        lambda t, x, xdot: x > 0.5,
        lambda t, x, xdot: max(x - 0.5, 0.0),
        lambda t, x, xdot: 1.0 if x > 0.5 else -1.0,
    ],
    ids=["bool", "zero beyond", "jump"],
)
def test_functions_that_are_not_smooth(method, function):
    """The first point at which they are zero, or of the other sign."""
    sol = follow(function, method=method)
    error = 1e-12 if method is FINE else 1e-3
    assert sol.t_events[0] == pytest.approx([math.sqrt(1 / G)], abs=error)


def test_events_during_rest():
    sol = follow(lambda t, x, xdot: t - 2.25)
    assert sol.rest_time < 2
    assert sol.t_events[0] == pytest.approx([2.25], abs=1e-14)
    assert sol.y_events[0].tolist() == [[0.0, 0.0]]


def test_the_form_of_scipy_is_the_same():
    """``g(t, y)`` by its number of parameters, also where it hides behind a default."""
    forms = [
        lambda t, x, xdot: x - 0.3 + 0.01 * xdot,
        lambda t, y: y[0] - 0.3 + 0.01 * y[1],
        lambda t, y, height=0.3: y[0] - height + 0.01 * y[1],
        lambda t, x, xdot, height=0.3: x - height + 0.01 * xdot,
        functools.partial(lambda height, t, x, xdot: x - height + 0.01 * xdot, 0.3),
        lambda *args: args[1] - 0.3 + 0.01 * args[2],
    ]
    expected, *others = times_of(forms, system=zivi.ImpactSystem(-G, e=0.9))
    assert len(expected) > 2
    for other in others:
        np.testing.assert_allclose(other, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("method", ["DOP853", "RK45"])
def test_as_scipy_where_nothing_is_hit(method):
    """Same functions, same attributes, same numbers of events at the same times."""

    def force(t, x, xdot):
        return -4.0 * (x - 5.0) - 0.1 * xdot + np.sin(2 * t)

    events = [
        lambda t, y: y[1],
        event(lambda t, y: y[0] - 5.1, direction=1),
        event(lambda t, y: y[0] - 5.1, direction=-1),
        lambda t, y: math.sin(3 * t + 0.3),
        event(lambda t, y: math.sin(t) - 0.5, terminal=5),
    ]
    theirs = solve_ivp(
        lambda t, y: (y[1], force(t, *y)),
        (0, 20),
        (6.0, 0.5),
        method=method,
        rtol=1e-11,
        atol=1e-11,
        events=events,
        max_step=0.3,
    )
    ours = follow(
        events,
        zivi.ImpactSystem(force, e=0.5),
        (0, 20),
        (6.0, 0.5),
        zivi.SwitchedRK(rtol=1e-11, atol=1e-11, order=8 if method == "DOP853" else 5, max_step=0.3),
    )
    assert theirs.status == 1
    assert ours.status == zivi.Status.TERMINATED_BY_EVENT
    assert ours.t[-1] == pytest.approx(theirs.t[-1], abs=1e-8)
    for k in range(len(events)):
        assert len(ours.t_events[k]) == len(theirs.t_events[k]) > 0
        np.testing.assert_allclose(ours.t_events[k], theirs.t_events[k], rtol=0, atol=1e-8)
        np.testing.assert_allclose(ours.y_events[k], theirs.y_events[k], rtol=0, atol=1e-8)


@BOTH
@pytest.mark.parametrize("terminal", [True, np.True_, 1, 2, 3, np.int64(4), 5.0])
def test_a_terminal_event_ends_the_run_there(method, terminal):
    watch = velocity(terminal=terminal)
    sol = follow(watch, method=method)
    count = int(terminal)
    assert len(sol.t_events[0]) == count
    assert sol.status == zivi.Status.TERMINATED_BY_EVENT
    assert sol.success
    assert sol.message == "A terminal event ended the run." or "event" in sol.message
    assert sol.t[-1] == sol.t_events[0][-1]
    np.testing.assert_allclose((sol.x[-1], sol.xdot[-1]), sol.y_events[0][-1], atol=1e-13)
    np.testing.assert_allclose(sol(sol.t[-1]), sol.y_events[0][-1], atol=1e-13)
    with pytest.raises(ValueError, match="computed span"):
        sol(sol.t[-1] + 1e-6)
    assert np.all(sol.resolved_impacts["t"] <= sol.t[-1])
    assert len(sol.resolved_impacts) == (count + 1) // 2
    assert len(sol.zeno_times) == len(sol.liftoff_times) == 0
    assert sol.rest_time is None
    whole = follow(velocity(), method=method)
    np.testing.assert_allclose(sol.t_events[0], whole.t_events[0][:count], rtol=0, atol=1e-14)


@BOTH
@pytest.mark.parametrize("terminal", [False, np.False_, 0, None])
def test_not_terminal(method, terminal):
    sol = follow(velocity(terminal=terminal), method=method)
    assert sol.status == zivi.Status.COMPLETED
    assert sol.t[-1] == 3
    assert len(sol.t_events[0]) > 6


@BOTH
def test_a_terminal_event_in_a_tail_or_at_rest(method):
    for end, resting in ((EXACT.zeno - 1e-5, False), (2.0, True)):
        sol = follow(event(lambda t, x, xdot, end=end: t - end, terminal=True), method=method)
        assert sol.t[-1] == pytest.approx(end, abs=1e-14)
        # the scheme rests a bit earlier
        assert (sol.rest_time is not None) == (resting or method is not FINE)


@pytest.mark.parametrize("tol", [1e-6, 1e-9, 1e-11])
def test_a_terminal_touchdown_can_be_resumed(tol):
    """The run ends before the impact, and the next one begins with it."""
    method = zivi.SwitchedRK(rtol=tol, atol=tol)
    sol = follow(event(lambda t, x, xdot: x, terminal=True), method=method)
    assert len(sol.resolved_impacts) == 0
    assert (sol.t[-1], sol.x[-1]) == (pytest.approx(EXACT.first, abs=1e-12), 0.0)
    assert sol.xdot[-1] == pytest.approx(-EXACT.speed, abs=1e-12)
    on = follow(None, span=(sol.t[-1], 3), state=(sol.x[-1], sol.xdot[-1]))
    assert on.impacts["t"][0] == sol.t[-1]
    assert on.zeno_times == pytest.approx([EXACT.zeno], abs=1e-12)


@BOTH
def test_order_of_simultaneous_events(method):
    """The first of two terminal events at one time ends the run; the other one is not recorded."""
    late, early = (lambda t, x, xdot: t - 0.3), event(lambda t, x, xdot: t - 0.2, terminal=True)
    sol = follow([late, early], method=method)
    assert [len(t) for t in sol.t_events] == [0, 1]
    same = [event(lambda t, x, xdot: t - 0.2, terminal=True) for _ in range(2)]
    sol = follow(same, method=method)
    assert [len(t) for t in sol.t_events] == [1, 0]
    both = [lambda t, x, xdot: t - 0.2, *same]
    assert [len(t) for t in follow(both, method=method).t_events] == [1, 1, 0]


@BOTH
@pytest.mark.parametrize("direction", [1, -1])
def test_a_zero_that_is_reached_and_not_crossed_is_one(method, direction):
    """The same at every look after it: the event is where the function gets there."""
    reached = [
        event(lambda t, x, xdot: direction * min(t - 0.25, 0.0), direction=d)
        for d in (direction, -direction, 0)
    ]
    times = times_of(reached, method=method)
    assert [len(t) for t in times] == [1, 0, 1]
    assert times[0] == times[2] == [pytest.approx(0.25, abs=1e-14)]


@BOTH
def test_functions_of_time_have_their_zeros_to_rounding(method):
    times = times_of([lambda t, x, xdot: t - 0.20037, lambda t, x, xdot: 0.7 - t], method=method)
    np.testing.assert_allclose(times, [[0.20037], [0.7]], rtol=0, atol=1e-15)


@BOTH
def test_no_events(method):
    for none in (None, [], ()):
        assert follow(none, method=method).t_events == []
    quiet = [lambda t, x, xdot: 0.0, lambda t, x, xdot: 1.0, lambda t, x, xdot: x + 1]
    sol = follow(quiet, method=method)
    assert [t.shape for t in sol.t_events] == [(0,)] * 3
    assert [y.shape for y in sol.y_events] == [(0, 2)] * 3
    # a zero at the start is none
    assert times_of(lambda t, x, xdot: x - 1.0, method=method) == [[]]


@BOTH
def test_events_do_not_change_the_run(method):
    plain = follow(None, method=method)
    watched = follow([velocity(), lambda t, y: y[0] - 0.3], method=method)
    for name in ("t", "x", "xdot", "transformed.s", "transformed.v", "impacts", "zeno_times"):
        np.testing.assert_array_equal(attrgetter(name)(watched), attrgetter(name)(plain))
    bare = follow([velocity(), lambda t, y: y[0] - 0.3], method=method, dense_output=False)
    for t, same in zip(watched.t_events, bare.t_events, strict=True):
        np.testing.assert_array_equal(t, same)


@pytest.mark.parametrize("height", [0.6, 0.2])
def test_fixed_steps_find_events_to_first_order(height):
    """Of a threshold on the first two arcs, of apexes and of impacts."""
    steps = (1e-2, 1e-3, 1e-4)
    events = [lambda t, x, xdot: x - height, velocity(), lambda t, x, xdot: x]
    exact = follow(events, method=FINE)
    errors = []
    for middle in steps:
        row = []
        for h in jittered(middle, 5):
            sol = follow(events, method=zivi.ThetaGamma(h=h))
            pairs = zip(sol.t_events, exact.t_events, strict=True)
            row.append(max(np.abs(mine[:1] - true[:1]).max() for mine, true in pairs))
        errors.append(np.sqrt(np.mean(np.square(row))))
    assert 0.85 < fitted_order(steps, errors) < 1.15
    assert errors[-1] < 5e-4


def test_touchdown_by_fixed_steps():
    """``x`` is zero only between two steps: seen at the crossing of ``s``."""
    sol = follow(lambda t, x, xdot: x, method=zivi.ThetaGamma(h=1e-4))
    np.testing.assert_allclose(sol.t_events[0][:3], impacts_of_ball(3), rtol=0, atol=2e-3)
    np.testing.assert_allclose(sol.y_events[0][:3, 0], 0.0, atol=1e-12)


@given(
    heights=st.lists(st.floats(0.01, 1.4), min_size=1, max_size=4),
    direction=st.sampled_from([-1, 0, 1]),
    e=st.floats(0.1, 0.9),
    xdot0=st.floats(-3, 3),
)
def test_events_are_zeros_of_their_functions(heights, direction, e, xdot0):
    """Times ascend, the state is that of sol(t) and a zero, and neighbours alternate."""
    events = [
        event(lambda t, x, xdot, height=height: x - height, direction=direction)
        for height in heights
    ]
    sol = follow(events, zivi.ImpactSystem(TABLE, e=e), (0, 4), (1, xdot0))
    for height, t, y in zip(heights, sol.t_events, sol.y_events, strict=True):
        assert np.all(np.diff(t) > 0)
        np.testing.assert_allclose(y[:, 0], height, rtol=0, atol=1e-11)
        if t.size:
            np.testing.assert_allclose(sol(t), y.T, rtol=1e-9, atol=1e-11)
        signs = np.sign(y[:, 1])
        if direction:
            assert np.all(signs == direction)
        else:
            assert np.all(signs[1:] == -signs[:-1])


@BOTH
def test_an_event_that_raises(method):
    def late(t, x, xdot):
        if t > 0.6:
            raise KeyError("mine")
        return 1.0

    with pytest.raises(KeyError, match="mine") as caught:
        follow(late, method=method)
    partial = caught.value.trajectory
    assert partial.status == zivi.Status.RAISED
    assert not partial.success
    assert len(partial.t) == len(partial.x) > 1
    assert any("zivi: the run stopped" in note for note in caught.value.__notes__)
    for t in ([], [0.1], [2.0]):  # also where no sample is left
        with pytest.raises(KeyError, match="mine"):
            follow(late, method=method, t_eval=t)


@BOTH
@pytest.mark.parametrize("value", [None, "1", 1j, [1.0], np.zeros(2)], ids=str)
def test_an_event_that_returns_no_number(method, value):
    with pytest.raises(TypeError, match="an event function must return a float"):
        follow(lambda t, x, xdot: value, method=method)


@BOTH
def test_nan_is_no_event(method):
    sol = follow(lambda t, x, xdot: math.nan if t > 0.3 else t - 0.2, method=method)
    assert sol.success
    assert sol.t_events[0] == pytest.approx([0.2], abs=1e-12)


@pytest.mark.parametrize(
    ("events", "error", "name"),
    [
        (3, TypeError, r"events must be a function"),
        ([velocity(), None], TypeError, r"events\[1\]"),
        ("ab", TypeError, r"events\[0\]"),
        *(
            (velocity(terminal=v), ValueError, r"events\[0\].terminal .*2\*\*63")
            for v in (-1, 1.5, math.nan, math.inf, "yes", 10**30, [1])
        ),
        *(
            ([velocity(), velocity(direction=v)], ValueError, r"events\[1\].direction")
            for v in (math.nan, "up", None, 1j)
        ),
    ],
)
def test_bad_events_are_named(events, error, name):
    calls = []

    def force(t, x, xdot):
        calls.append(t)
        return -G

    with pytest.raises(error, match=name):
        follow(events, zivi.ImpactSystem(force, e=0.5))
    assert calls == []


@pytest.mark.parametrize("direction", [True, np.float64(0.1), 10**400, math.inf])
def test_any_positive_direction_is_rising(direction):
    assert times_of(velocity(direction=direction)) == times_of(velocity(direction=1))


def test_wrong_number_of_parameters():
    for wrong in (lambda: 0.0, lambda t: t, lambda a, b, c, d: a):
        with pytest.raises(TypeError, match=r"events\[0\] must be a function of \(t, x, xdot\)"):
            follow(wrong)


def waves(t, *state):
    return math.sin(t)


TENS = math.pi * np.arange(1, 11)
"""Its zeros up to 33 s."""


@pytest.mark.parametrize(
    "method",
    [
        zivi.SwitchedRK(),
        zivi.SwitchedRK(max_step=5.0),
        zivi.ThetaGamma(h=3.3),
        zivi.MoreauJean(h=3.3),
        zivi.ExplicitEuler(h=3.3),
    ],
    ids=["SwitchedRK", "max_step", "ThetaGamma", "MoreauJean", "ExplicitEuler"],
)
@pytest.mark.parametrize(
    "force", [-G, lambda t, x, xdot: -G, zivi.LinearForce(gravity=G)], ids=["number", "f", "linear"]
)
def test_at_rest_no_zero_of_a_slow_function_is_overlooked(force, method):
    for x0 in (0, 1e-3):
        system = zivi.ImpactSystem(force, e=0.5)
        sol = zivi.simulate(system, (0, 33), (x0, 0), method, events=waves)
        assert sol.t_events[0] == pytest.approx(TENS, abs=1e-12)


@pytest.mark.parametrize(
    "method", [zivi.SwitchedRK(), zivi.ThetaGamma(h=3.3), zivi.MoreauJean(h=3.3)], ids=repr
)
@pytest.mark.parametrize("gaps", [[], [zivi.LinearGap([1])]], ids=["free", "at rest"])
def test_nor_is_one_of_a_mechanical_system(method, gaps):
    system = zivi.MechanicalSystem(mass=1.0, force=[-G if gaps else 0.0], gaps=gaps, e=0.5)
    sol = zivi.simulate(system, (0, 33), ([0], [0]), method, events=waves)
    assert sol.t_events[0] == pytest.approx(TENS, abs=1e-12)


def test_nor_is_one_along_a_free_flight():
    sol = follow(waves, zivi.ImpactSystem(0, e=0.5), (0, 33), (1, 1))
    assert sol.t_events[0] == pytest.approx(TENS, abs=1e-12)


def test_nor_is_one_in_long_periods_of_a_closed_loop():
    regulator = zivi.TwistingRegulator(mu1=30, mu2=17, h=1.65, e=0.5)
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(-G, e=0.5), regulator, (0, 33), (0, 0), events=waves
    )
    assert run.t_events[0] == pytest.approx(TENS, abs=1e-12)


def test_the_decorator_gives_what_is_set_by_hand():
    @zivi.event(terminal=2, direction=-1)
    def apex(t, x, xdot):
        return xdot

    assert (apex.terminal, apex.direction) == (2, -1)
    assert times_of(apex) == times_of(velocity(terminal=2, direction=-1))
    assert zivi.event()(lambda t, x, xdot: x).terminal is False
    with pytest.raises(ValueError, match=r"terminal must be a bool or a count .* got -1"):
        zivi.event(terminal=-1)
    with pytest.raises(ValueError, match="direction must be a number, got nan"):
        zivi.event(direction=math.nan)
