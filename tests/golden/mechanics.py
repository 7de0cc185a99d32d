"""Mechanical runs and their derivatives, as `golden.solvers` traces them.

Gaps and forces are of plain numbers: no library for matrices has a part in them.
"""

import math
import random
import warnings

import numpy as np

import zivi

RUN = [
    "t",
    "q",
    "qdot",
    "gaps",
    "gap_rates",
    "contacts",
    "reactions",
    "impacts",
    "zeno",
    "liftoffs",
    "openings",
    "corners",
    "flags",
    "status",
    "nfev",
    "n_steps",
    "n_rejected",
    "t_events",
    "q_events",
    "qdot_events",
]
DERIVATIVES = ["final", "impacts", "zeno_times", "liftoff_times", "radius", "n_slopes", "status"]
TOLERANCES = {"coarse": {"rtol": 1e-5}, "fine": {"rtol": 1e-9, "order": 5}, "default": {}}


def fields(result, names):
    """Give the named fields of a result."""
    computed = {"impacts": "resolved_impacts"}
    return [(name, getattr(result, computed.get(name, name))) for name in names]


def system(mass, force, gaps, e):
    """Give a system."""
    return zivi.MechanicalSystem(mass=mass, force=force, gaps=gaps, e=e)


def plane(normal, offset=0.0):
    """Give the gap ``normal . q + offset``."""

    def gap(t, q):
        return math.fsum(a * float(b) for a, b in zip(normal, q, strict=True)) + offset

    return zivi.Gap(gap, list(normal), 0.0, 0.0)


def slope(a, k):
    """Give a wavy floor ``y = a sin(k x)``."""
    return zivi.Gap(
        lambda t, q: q[1] - a * math.sin(k * q[0]),
        lambda t, q: np.array([-a * k * math.cos(k * q[0]), 1.0]),
        lambda t, q, w: a * k * k * math.sin(k * q[0]) * w[0] * w[0],
    )


def bar(t, q):
    """Give the mass of a bar whose inertia depends on its angle."""
    c = 0.3 * math.cos(q[1])
    return np.array([[1.5, c], [c, 0.4]])


def push(t, q, w):
    """Give a force that swings to the side."""
    return [2.0 * math.cos(1.5 * t) - 0.1 * w[0], -9.81 - 0.1 * w[1]]


def turn(t, q, w):
    """Give the force on the bar."""
    return [-1.6, -0.5 * math.sin(q[1]) - 0.01 * w[1]]


def pull(t, q, w):
    """Give a force that lifts off walls and floors."""
    return [6.0 * math.sin(2.5 * t) - 4.0, -9.81 + 14.0 * math.sin(3.0 * t)]


FLOOR, WALL = plane([0.0, 1.0]), plane([-1.0, 0.0], 0.8)


def systems():
    """List systems: name, system, end, start."""
    unit = np.eye(2)
    wedge = [plane([math.sin(1.1), math.cos(1.1)]), plane([-math.sin(0.9), math.cos(0.9)])]
    steps = [plane([1.0, 0.0, 0.0]), plane([-1.0, 1.0, 0.0]), plane([0.0, -1.0, 1.0])]
    wall = zivi.HarmonicWall(0.12, 9.0)
    moving = [zivi.LinearGap([1.0], motion=wall), zivi.LinearGap([-1.0], 0.6)]
    ends = [plane([1.0, 1.0]), plane([1.0, -1.0])]
    weights, heavy = np.diag([3.0, 2, 1]), [-29.43, -19.62, -9.81]
    long = np.diag([1.0, 0.3])
    return [
        ("ball", system([[2.0]], [-19.62], [plane([1.0])], 0.5), 2.0, ([1.0], [0.0])),
        ("box", system(unit, push, [FLOOR, WALL], [0.5, 0.3]), 2.5, ([0, 0.5], [0.5, 0])),
        ("lift", system(unit, pull, [FLOOR, WALL], [0.4, 0.6]), 4.0, ([0, 0.3], [0.2, 0])),
        ("sine", system(unit, push, [slope(0.25, 2.0)], 0.3), 2.4, ([0.4, 0.4], [3.6, 0])),
        ("wedge", system(unit, push, wedge, [0.5, 0.4]), 2.0, ([0.1, 1.2], [0.3, 0])),
        ("bar", system(bar, turn, [plane([1.0, 0.0])], 0.6), 4.0, ([0.3, 0.8], [0.0, 0.2])),
        ("tower", system(weights, heavy, steps, [0.3, 0.5, 0.4]), 1.5, ([0.2, 0.5, 0.7], [0] * 3)),
        ("shaker", system([[1.0]], [-6.0], moving, [0.6, 0.5]), 2.0, ([0.3], [0.4])),
        ("flat", system(long, [-9.81, 0], ends, 0.5), 1.5, ([0.5, 0.0], [0, 0])),
        ("tilt", system(long, [-9.81, 0.2], ends, 0.5), 1.5, ([0.5, 0.1], [0, 0])),
        ("hard", system(unit, push, [FLOOR, WALL], [0.97, 0.0]), 1.5, ([0, 0.2], [0.5, 0])),
    ]


def corners():
    """List systems whose gaps come to rest together, are squeezed, or are hit at once."""
    for e in (0.05, 0.15, 0.3):
        for number, angle in enumerate((0.15, 0.45)):
            # an obtuse wedge: the two sides are hit by turns, faster and faster
            sides = [plane([math.sin(a), math.cos(a)]) for a in (angle, -1.1 * angle)]
            ball = system(np.eye(2), [0.3, -9.81], sides, [e, 0.8 * e])
            yield f"wedge {e} {number}", ball, 1.6, ([0.1, 0.4], [0.4, 0.1])
        between = [plane([-1.0, 1.0]), plane([0.0, -1.0], 1.0)]
        pair = system(np.diag([1.0, 2.0]), [-0.5, -0.5], between, e)
        yield f"pulled {e}", pair, 2.0, ([0.5, 0.5], [1.0, 1.0])
        squeezed = system(np.diag([1.0, 0.7]), lambda t, q, w: [4.0 - t, -5.0 * q[1]], between, e)
        yield f"squeezed {e}", squeezed, 2.0, ([0.2, 0.6], [0.0, 0.3])
    for e in (0.0, 0.5, 1.0):
        chain = [plane([float(j == i + 1) - float(j == i) for j in range(4)]) for i in range(3)]
        cradle = system(np.diag([1.0, 2, 1, 0.5]), lambda t, q, w: [-9.81 * x for x in q], chain, e)
        yield f"cradle {e}", cradle, 2.5, ([-0.3, 0.02, 0.04, 0.1], [0.0] * 4)
        joint = system([[1.0, 0.4], [0.4, 1.0]], [-3.0, -4.0], [plane([1, 0]), plane([0, 1])], e)
        yield f"joint {e}", joint, 2.0, ([0.3, 0.3], [0.0, 0.1])


def planes(draw, n, m):
    """Give gaps of random normals that are open at the origin, and a point behind them."""
    gaps, behind = [], [0.0] * n
    for _ in range(m):
        normal = [draw.uniform(-1, 1) for _ in range(n)]
        gaps.append(plane(normal, draw.uniform(0.1, 0.6)))
        behind = [b - 2.0 * a for a, b in zip(normal, behind, strict=True)]
    return gaps, behind


def drawn():
    """List random systems that are drawn towards a point behind all their gaps."""
    draw = random.Random(17)
    for number in range(24):
        n = 1 + number % 3
        gaps, behind = planes(draw, n, draw.randint(1, min(n + 1, 4)))
        a = [[draw.uniform(-1, 1) for _ in range(n)] for _ in range(n)]
        mass = [
            [math.fsum(a[k][i] * a[k][j] for k in range(n)) + 0.5 * float(i == j) for j in range(n)]
            for i in range(n)
        ]
        stiff, damp = draw.uniform(2.0, 8.0), draw.choice([0.0, 0.2])
        shake, omega = draw.choice([0.0, 0.0, 3.0]), draw.uniform(2.0, 9.0)
        e = [draw.choice([0.0, 0.2, 0.5, 0.8, 0.97]) for _ in gaps]

        def force(t, q, w, k=stiff, c=damp, b=behind, s=shake, o=omega):
            wave = s * math.sin(o * t)
            return [
                k * (y - float(x)) - c * float(v) + wave for x, v, y in zip(q, w, b, strict=True)
            ]

        start = ([0.0] * n, [draw.uniform(-1.5, 1.5) for _ in range(n)])
        yield f"drawn {number}", system(mass, force, gaps, e), 1.6, start


def mechanics():
    """Runs by every method."""
    for name, it, end, start in systems():
        for which, settings in TOLERANCES.items():
            method = zivi.SwitchedRK(**settings)
            yield f"{name} {which}", lambda s=it, e=end, y=start, m=method: run(s, e, y, m)
        for method in (zivi.MoreauJean(h=2e-2), zivi.MoreauJean(h=1e-2, theta=0.8)):
            key = f"{name} moreau-jean {method.theta}"
            yield key, lambda s=it, e=end, y=start, m=method: fixed(s, e, y, m)
        method = zivi.ThetaGamma(2e-2)
        if name in ("ball", "box", "lift", "sine", "bar", "wedge"):
            key = f"{name} theta-gamma"
            yield key, lambda s=it, e=end, y=start, m=method: fixed(s, e, y, m)
    for name, more in LIMITS.items():
        for of_system, it, end, start in systems():
            if of_system in ("box", "lift", "wedge", "shaker"):
                key = f"{of_system} {name}"
                yield key, lambda s=it, e=end, y=start, o=more: limited(s, e, y, **o)


def contacts():
    """Runs with several contacts."""
    for name, it, end, start in [*corners(), *drawn()]:
        for settings in ({"rtol": 1e-4}, {"rtol": 1e-6, "order": 5}):
            method = zivi.SwitchedRK(**settings)
            key = f"{name} {method.order}"
            yield key, lambda s=it, e=end, y=start, m=method: run(s, e, y, m)
        method = zivi.MoreauJean(h=1e-2, theta=0.7)
        key = f"{name} moreau-jean"
        yield key, lambda s=it, e=end, y=start, m=method: fixed(s, e, y, m)


LIMITS = {
    "few impacts": {"max_impacts": 3},
    "few steps": {"max_steps": 12},
    "short steps": {"max_step": 0.05, "rtol": 1e-4},
    "first step": {"first_step": 1e-3},
    "rough": {"rtol": 0.5, "max_step": 0.05},
}


def limited(it, end, start, **settings):
    """Give the numbers of a run with a knot, and an event that ends it."""

    def high(t, q, w):
        return q[-1] - 0.05

    high.terminal, high.direction = 5, -1
    method = zivi.SwitchedRK(**settings)
    sol = zivi.simulate(it, (0, end), start, method, events=high, tstops=[0.3, 0.31])
    return fields(sol, RUN), near_ends(sol)


def near_ends(sol):
    """Give a run shortly before its accumulations, corners and its end."""
    first, last = float(sol.t[0]), float(sol.t[-1])
    ends = [*sol.zeno["t"].tolist()[:3], *sol.corners["t"].tolist()[:2], last]
    times = sorted({max(first, end - 0.2 * 0.4**k) for end in ends for k in range(15)})
    again = sol.resample(np.array(times))
    return [fields(again, ["q", "qdot", "gaps", "gap_rates", "contacts"])]


def between(result, ends):
    """Give a result at times that are no samples."""
    return [result(t) for t in np.linspace(*ends, 19)[1:-1]]


def run(it, end, start, method):
    """Give the numbers of a run with an event and dense output."""

    def height(t, q, w):
        return q[-1] - 0.1

    sol = zivi.simulate(it, (0, end), start, method, events=height, dense_output=True)
    at = np.linspace(0, end, 12)
    sampled = zivi.simulate(it, (0, end), start, method, t_eval=at)
    ends = (float(sol.t[0]), float(sol.t[-1]))
    return fields(sol, RUN), between(sol, ends), near_ends(sol), fields(sampled, RUN)


def fixed(it, end, start, method):
    """Give the numbers of a run with fixed steps, or what is said against it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where coefficients differ the energy may rise
        try:
            return fields(zivi.simulate(it, (0, end), start, method), RUN)
        except ValueError as error:
            return str(error)


def derivatives():
    """Derivatives of mechanical runs."""
    ends = {"ball": 2.0, "shaker": 0.6, "sine": 0.4, "box": 0.5, "lift": 0.9, "bar": 0.7}
    for name, it, _, start in systems():
        if name in ends:
            yield name, lambda s=it, e=ends[name], y=start: derived(s, e, y)
        if name in ("sine", "bar"):  # whose columns are less exact than the run
            more = {"rtol": 1e-6, "order": 5, "first_step": 0.2}
            key = f"{name} by columns"
            yield key, lambda s=it, e=ends[name], y=start, o=more: derived(s, e, y, **o)
    for name, it, _, start in [*corners(), *list(drawn())[3:13]]:
        if "cradle" not in name:
            yield name, lambda s=it, y=start: derived(s, 0.9, y, errsens=False)


def derived(it, end, start, wrt=None, errsens=True, **settings):
    """Give the numbers of a run's derivatives."""
    if isinstance(it, zivi.MechanicalSystem):
        wrt = ("q0", "qdot0", "t0", "e")
    method = zivi.SwitchedRK(**{"rtol": 1e-4} | settings)
    found = zivi.sensitivity(it, (0, end), start, wrt, method, errsens=errsens)
    run = found.trajectory
    sizes = [(one.kind, one.t) if one else None for one in found.limits]
    inside = found(np.linspace(0, end, 19)[1:-1]) if run.success else []
    counts = fields(run, ["t", "nfev", "n_steps", "n_rejected"])
    return fields(found, DERIVATIVES), counts, inside, str(sizes)
