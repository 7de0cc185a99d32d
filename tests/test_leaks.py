"""Whatever ends in an exception is freed with it."""

import ctypes
import gc
import os
import signal
import weakref

import numpy as np
import pytest

import zivi
from interrupting import collector_off


class Broken(Exception):  # noqa: N818 - the name of an exception of a user
    """What a user's function raises."""


def raising(after, value):
    """A function that returns a value until it has been called so often, then raises."""
    calls = 0

    def function(*_):
        nonlocal calls
        calls += 1
        if calls > after:
            raise Broken
        return value

    return function


def interrupting(value):
    """A function that sends Ctrl-C to the process."""

    def function(*_):
        os.kill(os.getpid(), signal.SIGINT)
        return value

    return function


def mass(force, **more):
    return zivi.ImpactSystem(force, e=0.5, **more)


def mechanism(force=(-9.81,), mass=1.0, gaps=(zivi.LinearGap([1.0]),), **more):  # noqa: B008
    given = force if callable(force) else list(force)
    return zivi.MechanicalSystem(mass=mass, force=given, gaps=list(gaps), e=0.5, **more)


def linear():
    return zivi.LinearSystem([[1.0]], [[0.1]], [[1.0]], gaps=[zivi.LinearGap([1.0], -0.5)], e=0.5)


class Tick:
    """A controller of one mass that raises."""

    def __init__(self):
        self.h, self.step = 1e-2, raising(3, 0.0)


BALL, START = mass(-9.81), ([1.0], [0.0])
SPAN, STATE = (0.0, 1.0), (1.0, 0.0)
FORCE = ctypes.CFUNCTYPE(*4 * [ctypes.c_double])


def zero(_):
    return 0.0


def gap():
    breaks = raising(40, None)
    return zivi.Gap(lambda t, q: breaks() or q[0], lambda t, q: np.array([1.0]))


def moving():
    return zivi.LinearGap([1.0], motion=zivi.MovingWall(raising(40, 0.0), zero, zero))


def run(system, start=STATE, **more):
    return zivi.simulate(system, SPAN, start, **more)


RAISE = {
    "force": lambda: run(mass(raising(9, -9.81))),
    "force, fixed steps": lambda: run(mass(raising(9, -9.81)), method=zivi.ThetaGamma(1e-2)),
    "force, samples": lambda: run(
        mass(raising(9, -9.81)), method=zivi.ThetaGamma(1e-2), t_eval=[0.0, 0.01]
    ),
    "compiled force": lambda: run(mass(FORCE(raising(9, -9.81)))),
    "event": lambda: run(BALL, events=raising(9, 1.0)),
    "wall": lambda: run(mass(-9.81, wall=zivi.MovingWall(raising(9, 0.0), zero, zero))),
    "ctrl-c": lambda: run(mass(interrupting(-9.81))),
    "ctrl-c, a number": lambda: run(BALL, events=interrupting(1.0), method=zivi.ThetaGamma(1e-5)),
    "mechanical force": lambda: run(mechanism(raising(40, np.array([-9.81]))), START),
    "mechanical force, fixed steps": lambda: run(
        mechanism(raising(40, np.array([-9.81]))), START, method=zivi.MoreauJean(1e-2)
    ),
    "mechanical mass": lambda: run(mechanism(mass=raising(40, np.eye(1))), START),
    "mechanical gap": lambda: run(mechanism(gaps=[gap()]), START),
    "mechanical wall": lambda: run(mechanism(gaps=[moving()]), START),
    "mechanical event": lambda: run(mechanism(), START, events=raising(9, 1.0)),
    "mechanical ctrl-c": lambda: run(mechanism(interrupting(np.array([-9.81]))), START),
    "linear event": lambda: run(linear(), START, events=raising(9, 1.0)),
    "rubbing event": lambda: run(
        mechanism(friction=[zivi.DryFriction(limit=1.0)]), START, events=raising(9, 1.0)
    ),
    "mass with friction": lambda: run(
        mass(raising(40, -9.81), friction=zivi.DryFriction(limit=1.0))
    ),
    "sensitivity": lambda: zivi.sensitivity(mass(raising(40, -9.81)), SPAN, STATE),
    "mechanical sensitivity": lambda: zivi.sensitivity(
        mechanism(raising(40, np.array([-9.81]))), SPAN, START
    ),
    "loop": lambda: zivi.simulate_closed_loop(BALL, Tick(), SPAN, STATE),
    "loop, plant": lambda: zivi.simulate_closed_loop(
        mass(raising(40, -9.81)), zivi.TwistingTracker(30, 17, h=1e-2, e=0.5), SPAN, STATE
    ),
    "loop, event": lambda: zivi.simulate_closed_loop(
        BALL,
        zivi.TwistingTracker(30, 17, h=1e-2, e=0.5),
        SPAN,
        STATE,
        events=raising(9, 1.0),
    ),
    "mechanical loop": lambda: zivi.simulate_closed_loop(
        mechanism(), raising_controller(), SPAN, START
    ),
    "mechanical batch": lambda: zivi.simulate_batch(
        mechanism(raising(40, np.array([-9.81]))), SPAN, (np.ones((2, 1)), np.zeros((2, 1)))
    ),
    "box VI": lambda: zivi.solve_vi(
        raising(3, np.zeros(2)), np.zeros(2), np.ones(2), np.full(2, 0.5)
    ),
    "box VI, Jacobian": lambda: zivi.solve_vi(
        lambda x: x - 0.3, np.zeros(2), np.ones(2), np.zeros(2), jac=raising(0, np.eye(2))
    ),
}


def raising_controller():
    tick = raising(3, np.zeros(1))
    return type("Controller", (), {"h": 1e-2, "step": lambda _, t, q, qdot: tick()})()


@pytest.fixture(scope="module", autouse=True)
def _collector_sees_the_tests_of_this_file_alone():
    """What other tests have left makes each collection take half a second."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def interruptible():
    """A background shell ignores Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("name", RAISE)
def test_what_raised_is_freed(name, interruptible):
    known = []

    def once():
        try:
            with collector_off():
                RAISE[name]()
        except Broken as error:
            known.append(weakref.ref(error))
        except KeyboardInterrupt:
            pass
        else:
            pytest.fail("nothing was raised")

    def objects():
        gc.collect()
        assert not any(it() is not None for it in known)
        known.clear()
        return len(gc.get_objects())

    for _ in range(3):  # what is made once
        once()
    before = objects()
    for _ in range(30):
        once()
    assert objects() - before < 10
