"""Arms with controls, and what references they follow, for tests of control."""

import functools

import numpy as np

import zivi

START = np.array([0.5, -1.2])
H = 1e-3
PADDLE = zivi.MechanicalSystem(
    mass=np.diag([0.2, 1.0]),
    force=[-0.2 * 9.81, -9.81],
    gaps=[zivi.LinearGap([1, -1], name="racket")],
    e=0.6,
    coordinates=["ball", "paddle"],
    inputs=[[0.0], [1.0]],
)
"""A ball above a racket that is moved up and down."""


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


def turning_mass(**gaps):
    """A mass of 2 kg whose two controls turn with its place."""
    return zivi.symbolic.system(
        "x y",
        T="m*(xdot**2 + ydot**2)/2",
        V="m*g*y",
        gaps=gaps,
        parameters={"m": 2.0, "g": 9.81},
        e=[0.5, 0.6],
        inputs={"along": ["cos(x)", "sin(x)"], "across": ["-sin(x)", "cos(x)"]},
    )


def swinging(t):
    """A posture that goes on swinging in contact, with its derivatives."""
    s, c = np.sin(2 * t), np.cos(2 * t)
    return np.array([[0.4 + 0.2 * s, -1.2 - 0.2 * s], [0.4 * c, -0.4 * c], [-0.8 * s, 0.8 * s]])


def angles(x, y):
    """The angles with the tip of the two links at a place, the elbow below."""
    b = np.arccos((x * x + y * y - 0.5**2 - 0.45**2) / (2 * 0.5 * 0.45))
    return np.array([np.arctan2(y, x) - np.arctan2(0.45 * np.sin(b), 0.5 + 0.45 * np.cos(b)), b])


def swinging_tip(t):
    """The posture with the tip on the table at a place that swings, with its derivatives."""
    x = 0.35 + 0.15 * np.sin(4 * t)
    a, b = angles(x, -0.3)
    speed = np.array([0.6 * np.cos(4 * t), 0.0])
    pull = np.array([-2.4 * np.sin(4 * t), 0.0])
    first, second = (
        length * np.array([np.cos(it), np.sin(it)]) for length, it in ((0.5, a), (0.45, a + b))
    )
    across = np.array([[0.0, -1.0], [1.0, 0.0]])
    jacobian = np.stack([across @ (first + second), across @ second], axis=1)
    rate = np.linalg.solve(jacobian, speed)
    turning = first * rate[0] ** 2 + second * rate.sum() ** 2
    return np.array([[a, b], rate, np.linalg.solve(jacobian, pull + turning)])


@functools.cache
def tapping_tip():
    """A run of the arm whose tip bounces and swings along the table."""
    span, start = (0.0, 1.7), (angles(0.35, -0.05), np.zeros(2))
    virtual = {"floor": -9.81}
    return zivi.reference_run(two_links(), span, start, virtual=virtual, posture=swinging_tip)


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


def positions_only(seed):
    """A loop by measured angles alone, with masses, restitution and friction unknown."""
    source = np.random.default_rng(seed)
    m1, m2 = np.array([1.0, 0.8]) * (1 + source.uniform(-0.1, 0.1, 2))
    believed = two_links().replace(m1=m1, m2=m2, e=0.6 + source.uniform(-0.05, 0.05))
    friction = source.uniform(0, 0.3, 2)
    return zivi.simulate_closed_loop(
        two_links(),
        tracker(system=believed, horizon=3.0),
        (0, 1.5),
        (START, np.zeros(2)),
        reference=tapping(),
        noise=(1e-5, 0.0),
        quantization=1e-5,
        seed=seed,
        observer=zivi.JointObserver(believed, noise=1e-5),
        disturbance=lambda t, q, qdot: -friction * qdot,
        method=zivi.RKPeriod(),
    )


def bouncing_error(run):
    """The root mean square error of the gap while it bounces."""
    part = (run.t > 0.4) & (run.t < 1.0)
    return float(np.sqrt(np.mean(run.error_gaps[part] ** 2)))


def is_pressed(run, force, within):
    """Whether the end is exact contact, pressed by so much for the last tenth of the run."""
    late = run.reactions[-len(run.t) // 10 :]
    at_rest = np.all(run.contacts[-1]) and np.all(run.gaps[-1] == 0.0)
    return bool(at_rest and np.all(abs(late - force) <= within))
