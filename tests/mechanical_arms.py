"""Arms with controls, and what references they follow, for tests of control."""

import functools

import numpy as np

import zivi

START = np.array([0.5, -1.2])
H = 1e-3


@functools.cache
def two_links():
    """Two links with point masses above a table; torques at both joints."""
    return zivi.symbolic.system(
        "a b",
        T="m1*l1**2*adot**2/2 + m2*(l1**2*adot**2 + l2**2*(adot + bdot)**2"
        " + 2*l1*l2*adot*(adot + bdot)*cos(b))/2",
        V="m1*g*l1*sin(a) + m2*g*(l1*sin(a) + l2*sin(a + b))",
        gaps={"floor": "l1*sin(a) + l2*sin(a + b) + d"},
        parameters={"m1": 1.0, "m2": 0.8, "l1": 0.5, "l2": 0.45, "g": 9.81, "d": 0.3},
        e=0.6,
        inputs={"ta": [1, 0], "tb": [0, 1]},
    )


def swinging(t):
    """A posture that goes on swinging in contact, with its derivatives."""
    s, c = np.sin(2 * t), np.cos(2 * t)
    return np.array([[0.4 + 0.2 * s, -1.2 - 0.2 * s], [0.4 * c, -0.4 * c], [-0.8 * s, 0.8 * s]])


@functools.cache
def tapping(end=1.6):
    """A run of the arm whose tip falls on the table like a ball."""
    span, start = (0.0, end), (START, np.zeros(2))
    return zivi.reference_run(two_links(), span, start, virtual={"floor": -9.81}, posture=swinging)


def tracker(system=None, **settings):
    settings = {"h": H, "gains": {"floor": (40, 22)}, "force": {"floor": 10.0}} | settings
    return zivi.GapTracker(two_links() if system is None else system, **settings)


def follow(controller, end=1.5, **asked):
    """A loop of the arm, from beside the reference."""
    start = (START + np.array([0.03, -0.02]), np.array([0.1, -0.1]))
    asked = {"reference": tapping(), "method": zivi.RKPeriod()} | asked
    return zivi.simulate_closed_loop(two_links(), controller, (0, end), start, **asked)


def bouncing_error(run):
    """The root mean square error of the gap while it bounces."""
    part = (run.t > 0.4) & (run.t < 1.0)
    return float(np.sqrt(np.mean(run.error_gaps[part] ** 2)))


def is_pressed(run, force, within):
    """Whether the end is exact contact, pressed by so much for the last tenth of the run."""
    late = run.reactions[-len(run.t) // 10 :]
    at_rest = np.all(run.contacts[-1]) and np.all(run.gaps[-1] == 0.0)
    return bool(at_rest and np.all(abs(late - force) <= within))
