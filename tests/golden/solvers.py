"""Runs of several coordinates, derivatives, problems of the solver and ticks of controllers.

Each group gives names and functions; a function gives the numbers of its result, field by field.
``python -m golden.solvers --write`` (from ``tests``) makes ``solvers.txt`` anew, as `golden.trace`
does its file. Forces are of plain numbers: no library for matrices has a part in them.
"""

import argparse
import hashlib
import math
import random
import warnings
from pathlib import Path

import numpy as np

import zivi
from golden.trace import absorb, libm

FILE = Path(__file__).with_name("solvers.txt")
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
SOLUTION = [
    "x",
    "F",
    "residual",
    "status",
    "n_iter",
    "nfev",
    "njev",
    "n_pivots",
    "n_semismooth_steps",
    "n_gradient_steps",
    "n_restarts",
    "stage",
    "tolerance",
    "projected",
]
TOLERANCES = {"coarse": {"rtol": 1e-5}, "fine": {"rtol": 1e-9, "order": 5}, "default": {}}


def fields(result, names):
    """Give the named fields of a result."""
    return [(name, getattr(result, name)) for name in names]


def between(run, ends):
    """Give a run and its derivatives at times that are no samples."""
    return [run(t) for t in np.linspace(*ends, 19)[1:-1]]


# mechanical systems


def slope(a, k):
    """A wavy floor ``y = a sin(k x)``."""
    return zivi.Gap(
        lambda t, q: q[1] - a * math.sin(k * q[0]),
        lambda t, q: np.array([-a * k * math.cos(k * q[0]), 1.0]),
        lambda t, q, w: a * k * k * math.sin(k * q[0]) * w[0] * w[0],
    )


def bar(t, q):
    """Give the mass of a bar whose inertia depends on its angle."""
    c = 0.3 * math.cos(q[1])
    return np.array([[1.5, c], [c, 0.4]])


def systems():
    """List systems: name, system, end, start."""
    gap, plane = zivi.LinearGap, np.eye(2)
    floor, wall = gap([0, 1]), gap([-1, 0], 0.8)
    wedge = [gap([math.sin(1.1), math.cos(1.1)]), gap([-math.sin(0.9), math.cos(0.9)])]
    steps = [gap([1.0, 0, 0]), gap([-1.0, 1, 0]), gap([0, -1.0, 1])]
    moving = [gap([1.0], motion=zivi.HarmonicWall(0.12, 9.0)), gap([-1.0], 0.6)]
    ends = [gap([1.0, 1.0]), gap([1.0, -1.0])]

    def push(t, q, w):
        return [2.0 * math.cos(1.5 * t) - 0.1 * w[0], -9.81 - 0.1 * w[1]]

    def turn(t, q, w):
        return [-1.6, -0.5 * math.sin(q[1]) - 0.01 * w[1]]

    def pull(t, q, w):
        return [6.0 * math.sin(2.5 * t) - 4.0, -9.81 + 14.0 * math.sin(3.0 * t)]

    def system(mass, force, gaps, e):
        return zivi.MechanicalSystem(mass=mass, force=force, gaps=gaps, e=e)

    hinge = gap([1.0, 0.0])
    return [
        ("ball", system([[2.0]], [-19.62], [gap([1.0])], 0.5), 2.0, ([1.0], [0.0])),
        ("box", system(plane, push, [floor, wall], [0.5, 0.3]), 2.5, ([0, 0.5], [0.5, 0])),
        ("lift", system(plane, pull, [floor, wall], [0.4, 0.6]), 4.0, ([0, 0.3], [0.2, 0])),
        ("sine", system(plane, push, [slope(0.25, 2.0)], 0.3), 2.4, ([0.4, 0.4], [3.6, 0])),
        ("wedge", system(plane, push, wedge, [0.5, 0.4]), 2.0, ([0.1, 1.2], [0.3, 0])),
        ("bar", system(bar, turn, [hinge], 0.6), 4.0, ([0.3, 0.8], [0.0, 0.2])),
        (
            "tower",
            system(np.diag([3.0, 2, 1]), [-29.43, -19.62, -9.81], steps, [0.3, 0.5, 0.4]),
            1.5,
            ([0.2, 0.5, 0.7], [0, 0, 0]),
        ),
        ("shaker", system([[1.0]], [-6.0], moving, [0.6, 0.5]), 2.0, ([0.3], [0.4])),
        ("flat", system(np.diag([1.0, 0.3]), [-9.81, 0], ends, 0.5), 1.5, ([0.5, 0.0], [0, 0])),
        ("tilt", system(np.diag([1.0, 0.3]), [-9.81, 0.2], ends, 0.5), 1.5, ([0.5, 0.1], [0, 0])),
        ("hard", system(plane, push, [floor, wall], [0.97, 0.0]), 1.5, ([0, 0.2], [0.5, 0])),
    ]


def mechanics():
    """Runs by every method."""
    for name, system, end, start in systems():
        for which, settings in TOLERANCES.items():
            method = zivi.SwitchedRK(**settings)
            yield f"{name} {which}", lambda s=system, e=end, y=start, m=method: run(s, e, y, m)
        for method in (zivi.MoreauJean(h=2e-2), zivi.MoreauJean(h=1e-2, theta=0.8)):
            key = f"{name} moreau-jean {method.theta}"
            yield key, lambda s=system, e=end, y=start, m=method: fixed(s, e, y, m)
        method = zivi.ThetaGamma(2e-2)
        if name in ("ball", "box", "lift", "sine", "bar"):
            key = f"{name} theta-gamma"
            yield key, lambda s=system, e=end, y=start, m=method: fixed(s, e, y, m)


def run(system, end, start, method):
    """Give the numbers of a run with an event and dense output."""

    def height(t, q, w):
        return q[-1] - 0.1

    sol = zivi.simulate(system, (0, end), start, method, events=height, dense_output=True)
    at = np.linspace(0, end, 12)
    sampled = zivi.simulate(system, (0, end), start, method, t_eval=at)
    ends = (float(sol.t[0]), float(sol.t[-1]))
    return fields(sol, RUN), between(sol, ends), fields(sampled, RUN)


def fixed(system, end, start, method):
    """Give the numbers of a run with fixed steps."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where coefficients differ the energy may rise
        return fields(zivi.simulate(system, (0, end), start, method), RUN)


# derivatives


def derivatives():
    """Derivatives of mechanical runs and of those of the mass."""
    for name, system, end, start in systems():
        if name in ("ball", "shaker", "sine"):
            yield f"gaps {name}", lambda s=system, e=end, y=start: derived(s, e, y)
    forces = {
        "gravity": zivi.LinearForce(gravity=9.81),
        "shaken": zivi.LinearForce(gravity=9.81, amplitude=14.0, omega=6.0),
        "spring": zivi.LinearForce(gravity=2.0, stiffness=5.0, damping=0.3),
        "python": lambda t, x, v: -9.81 - 0.3 * v + 14.0 * math.sin(6.0 * t),
    }
    for name, force in forces.items():
        for e in (0.0, 0.5, 0.9):
            system = zivi.ImpactSystem(force, e=e)
            yield f"mass {name} {e}", lambda s=system: derived(s, 2.3, (1.0, 0.2))


def derived(system, end, start):
    """Give the numbers of a run's derivatives."""
    found = zivi.sensitivity(system, (0, end), start)
    sizes = [(one.kind, one.t) if one else None for one in found.limits]
    return fields(found, DERIVATIVES), between(found, (0, end)), str(sizes)


# the solver


def matrix(draw, n, kind):
    """Give a matrix of small numbers."""
    a = [[float(draw.randint(-4, 4)) for _ in range(n)] for _ in range(n)]
    if kind == "definite":
        a = [
            [sum(a[k][i] * a[k][j] for k in range(n)) + (i == j) for j in range(n)]
            for i in range(n)
        ]
    elif kind == "skew":
        a = [[a[i][j] - a[j][i] for j in range(n)] for i in range(n)]
    return np.array(a)


def solver():
    """Affine and smooth problems, some degenerate, some without a solution."""
    draw = random.Random(5)
    for number in range(90):
        kind, n = ("definite", "skew", "any")[number % 3], 2 + number % 9
        m = matrix(draw, n, kind)
        q = np.array([float(draw.randint(-6, 6)) for _ in range(n)])
        low = np.array([draw.choice([-np.inf, 0.0, 0.0, -1.0]) for _ in range(n)])
        high = np.array([draw.choice([np.inf, np.inf, 2.0]) for _ in range(n)])
        yield (
            f"affine {kind} {number}",
            lambda m=m, q=q, low=low, high=high: fields(zivi.solve_avi(m, q, low, high), SOLUTION),
        )
        yield (
            f"smooth {kind} {number}",
            lambda m=m, q=q, low=low, high=high: smooth(m, q, low, high),
        )


def smooth(m, q, low, high):
    """Solve ``m x + q + x^3/4 + tanh(x_next)`` by plain numbers, with and without slopes."""
    rows, n = m.tolist(), len(q)

    def value(x):
        x = [float(number) for number in x]
        return [
            math.fsum(a * b for a, b in zip(rows[i], x, strict=True))
            + q[i]
            + x[i] ** 3 / 4
            + math.tanh(x[(i + 1) % n])
            for i in range(n)
        ]

    def slopes(x):
        out = [row[:] for row in rows]
        for i in range(n):
            out[i][i] += 0.75 * float(x[i]) ** 2
            out[i][(i + 1) % n] += 1 - math.tanh(float(x[(i + 1) % n])) ** 2
        return out

    start = np.full(n, 0.5)
    found = [zivi.solve_vi(value, low, high, start, jac=jac) for jac in (slopes, None)]
    return [fields(one, SOLUTION) for one in found]


# controllers


def control():
    """Ticks on drawn samples, and what an observer makes of them."""
    for h in (1e-3, 1e-2):
        for e in (0.1, 0.5, 0.9):
            yield (
                f"regulator {h} {e}",
                lambda h=h, e=e: ticks(zivi.TwistingRegulator(30, 17, h=h, e=e), h),
            )
            for settings in ({}, {"branch": "nearest"}, {"horizon": 3.0}, {"shift": True}):
                key = f"tracker {h} {e} {settings}"
                yield (
                    key,
                    lambda h=h, e=e, settings=settings: ticks(
                        zivi.TwistingTracker(30, 17, h=h, e=e, **settings), h, reference=True
                    ),
                )
            yield (
                f"explicit {h} {e}",
                lambda h=h, e=e: ticks(zivi.ExplicitTwisting(30, 17, h=h, e=e), h, reference=True),
            )
            for only in (True, False):
                yield f"observer {h} {e} {only}", lambda h=h, e=e, only=only: seen(h, e, only)


def ticks(it, h, *, reference=False):
    """Give the controls of drawn samples, the last ones near the wall and on it."""
    draw, found = random.Random(7), []
    if reference:
        it.reset(1.0, 0.5)
    for k in range(300):
        size = 1.0 if k < 120 else 30.0 * h * h * draw.choice([0.0, 0.3, 1.0, 5.0])
        x = size * draw.random()
        xdot = draw.uniform(-1, 1) * (3.0 if k < 120 else 40.0 * h)
        if k > 280:
            x = xdot = 0.0
        force = -9.81 + draw.uniform(-2, 2)
        more = (draw.choice([-9.81, -9.81, 3.0]),) if reference else ()
        found.append(it.step(x, xdot, force, *more))
        found.append(list(it._signs))
    return found


def seen(h, e, only):
    """Give what an observer makes of a bouncing mass with noise, outliers and a kick."""
    draw = random.Random(9)
    start = zivi.ImpactSystem(-9.0, e=e)
    sol = zivi.simulate(start, (0, 400 * h), (0.3 * 100 * h, 0.0), t_eval=np.arange(400) * h)
    noise = (1e-4, 1e-2)
    x = [max(0.0, value + noise[0] * draw.gauss(0, 1)) for value in sol.x]
    v = [value + noise[1] * draw.gauss(0, 1) for value in sol.xdot]
    for k in range(50, 400, 37):
        x[k] += draw.uniform(0, 0.3)
    settings = {"noise": noise[0], "position_only": True} if only else {"noise": noise}
    given = (sol.t, x) if only else (sol.t, x, v)
    found = zivi.ImpactObserver(e, h, **settings).observe(*given, force=-9.81)
    return [found.x, found.xdot, found.d, found.std, found.refused, found.e, found.std_e]


GROUPS = {
    "mechanics": mechanics,
    "derivatives": derivatives,
    "solver": solver,
    "control": control,
}


def trace(numbers):
    """Give the digest of the numbers of a result."""
    digest = hashlib.sha256()
    absorb(digest, numbers)
    return digest.hexdigest()[:20]


def read():
    """Give the library the digests were made with, and them by name."""
    first, *lines = FILE.read_text().splitlines()
    return first.split()[-1], dict(line.split(" | ") for line in lines)


def write():
    """Make the file."""
    lines = [f"# libm {libm()}"]
    for group, runs in GROUPS.items():
        lines += [f"{group} {name} | {trace(run())}" for name, run in runs()]
    FILE.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", required=True, help="make the file anew")
    parser.parse_args()
    write()
