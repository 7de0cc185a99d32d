"""Mechanical runs, derivatives, problems of the solver and ticks of controllers.

Each group gives names and functions; a function gives the numbers of its result, field by field.
``python -m golden.solvers --write`` (from ``tests``) makes ``solvers.txt`` anew, as `golden.trace`
does its file.
"""

import argparse
import hashlib
import math
import random
from pathlib import Path

import numpy as np

import zivi
from golden.mechanics import contacts, derivatives, derived, fields, mechanics
from golden.ticks import choices, control, observers
from golden.trace import absorb, libm

FILE = Path(__file__).with_name("solvers.txt")
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

# derivatives


def sensitivities():
    """Derivatives of runs of the mass."""
    wall = zivi.HarmonicWall(0.1, 7.0)
    forces = {
        "gravity": zivi.LinearForce(gravity=9.81),
        "shaken": zivi.LinearForce(gravity=9.81, amplitude=14.0, omega=6.0),
        "spring": zivi.LinearForce(gravity=2.0, stiffness=5.0, damping=0.3),
        "python": lambda t, x, v: -9.81 - 0.3 * v + 14.0 * math.sin(6.0 * t),
    }
    for name, force in forces.items():
        for e in (0.0, 0.5, 0.9):
            system = zivi.ImpactSystem(force, e=e)
            yield f"{name} {e}", lambda s=system: derived(s, 2.3, (1.0, 0.2), rtol=1e-9)
    moving = zivi.ImpactSystem(forces["gravity"], e=0.6, wall=wall)
    yield "wall", lambda: derived(moving, 2.3, (1.0, 0.2), rtol=1e-6)
    loose = zivi.ImpactSystem(forces["shaken"], e=0.4)
    yield "loose", lambda: derived(loose, 2.3, (0.5, -1.0), errsens=False)
    wrt = ("x0", "xdot0", "t0", "e", "amplitude", "omega", "phase", "gravity")
    yield "all", lambda: derived(loose, 2.3, (0.5, -1.0), wrt)
    hit = zivi.ImpactSystem(forces["spring"], e=0.7)
    yield "one arc", lambda: derived(hit, 0.9, (0.0, 3.0), ("x0", "xdot0", "e", "stiffness"))


def maps():
    """The map from impact to impact and its derivatives."""
    draw = random.Random(3)
    table = zivi.HarmonicWall(0.05, 5.0)
    systems = {
        "table": zivi.ImpactSystem(-9.81, e=0.6, wall=table),
        "shaken": zivi.ImpactSystem(zivi.LinearForce(gravity=1.0, amplitude=3.0, omega=2.0), e=0.5),
        "damped": zivi.ImpactSystem(
            zivi.LinearForce(
                stiffness=4.0, damping=0.1, gravity=1.0, amplitude=3.0, omega=2.0, phase=0.4
            ),
            e=0.7,
        ),
        "stiff": zivi.ImpactSystem(
            zivi.LinearForce(stiffness=900.0, damping=0.0, gravity=5.0, amplitude=9.0, omega=4.0),
            e=0.8,
        ),
        "overdamped": zivi.ImpactSystem(
            zivi.LinearForce(stiffness=1.0, damping=5.0, gravity=4.0, amplitude=9.0, omega=3.0),
            e=0.9,
        ),
    }
    for name, system in systems.items():
        phase = [draw.uniform(0, 6.28) for _ in range(40)]
        u = [draw.choice([1e-3, 0.1, 1.0, 4.0]) * (0.1 + draw.random()) for _ in range(40)]

        def numbers(it=system, phase=phase, u=u):
            found = zivi.impact_map(it)
            moved = [] if it.wall else found.by(phase, u, ("e", "gravity"), threads=1)
            return [
                list(found(phase, u, threads=1)),
                found.duration(phase, u, threads=1),
                list(moved),
                list(found.orbit(phase[0], 2.0, 30)),
            ]

        yield name, numbers


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


def smooth(m, q, low, high, **more):
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
    found = [zivi.solve_vi(value, low, high, start, jac=jac, **more) for jac in (slopes, None)]
    return [fields(one, SOLUTION) for one in found]


OPTIONS = {
    "pivots": {"smoothing": False, "active_set": False},
    "ray": {"ray_start_first": True, "active_set": False, "smoothing": False},
    "smoothing": {"josephy_newton": False, "semismooth": False, "proximal": False, "restarts": 0},
    "semismooth": {"josephy_newton": False, "smoothing": False, "restarts": 1},
    "gradient": {"line_search": False, "memory": 1, "descent_steps": False, "restarts": 2},
    "proximal": {"josephy_newton": False, "smoothing": False, "semismooth": False},
    "restarts": {
        "josephy_newton": False,
        "smoothing": False,
        "semismooth": False,
        "proximal": False,
        "restarts": 3,
        "enumerate_up_to": 0,
    },
    "patterns": {"restarts": 0, "max_pivots": 1, "smoothing": False, "stage_iterations": 3},
    "few pivots": {"total_pivots": 8, "max_pivots": 4, "restarts": 1},
    "scaled": {"row_scale": "jacobian"},
}


def stages():
    """The stages of the solver one by one."""
    draw = random.Random(23)
    for number in range(12):
        n = 2 + number % 5
        m = matrix(draw, n, ("any", "skew", "any", "definite")[number % 4])
        q = np.array([draw.uniform(-4, 4) for _ in range(n)])
        low = np.array([draw.choice([-np.inf, 0.0, -1.0, 0.5]) for _ in range(n)])
        wide = [draw.choice([np.inf, 2.0, 0.0]) for _ in range(n)]
        pairs = zip(low.tolist(), wide, strict=True)
        high = np.array([a + b if math.isfinite(a) else np.inf for a, b in pairs])
        for name, options in OPTIONS.items():
            yield (
                f"{name} {number}",
                lambda m=m, q=q, low=low, high=high, o=options: [
                    fields(zivi.solve_avi(m, q, low, high, tol=1e-9, options=o), SOLUTION),
                    smooth(m, q, low, high, tol=1e-8, options=o, max_iter=60),
                ],
            )
        if number % 3 == 0:
            yield f"time {number}", lambda m=m, q=q: tight(m, q)


def tight(m, q):
    """Solve a problem under limits, in small units, and one without a solution."""
    n = len(q)
    none = m.copy()
    none[0] = 0.0
    less = np.array([-1.0, *q[1:]])
    twins = m.copy()
    twins[1] = -twins[0]
    found = [
        zivi.solve_avi(1e-7 * m, 1e-5 * q, 0.0, np.inf, tol=1e-16, rtol=1e-9),
        zivi.solve_avi(m, q, 0.0, np.inf, tol=1e-9, max_iter=1),
        zivi.solve_avi(none, less, 0.0, np.inf, tol=1e-9),
        zivi.solve_avi(twins, np.array([-3.0, 1.0, *q[2:]]), -np.inf, np.inf, tol=1e-9),
        zivi.solve_avi(m, q, -1.0, 1.0, np.full(n, 0.3), rtol=1e-3),
    ]
    return [fields(one, SOLUTION) for one in found]


def infeasible():
    """Affine problems of which some rows exclude each other, and some that can be solved.

    The rows are those of components without an upper (or a lower) bound, and weighted they add up
    to a number of the wrong sign, or to a form that has it in the box.
    """
    draw = random.Random(37)
    for number in range(48):
        n = 3 + number % 8
        rows = 2 + number % min(4, n - 1)
        m = matrix(draw, n, "any")
        q = np.array([float(draw.randint(-4, 4)) for _ in range(n)])
        weights = [draw.uniform(0.3, 3.0) for _ in range(rows - 1)]
        boxed = draw.random() < 0.4
        last = [-math.fsum(w * m[i, j] for i, w in enumerate(weights)) for j in range(n)]
        if boxed:
            last[n - 1] += 0.25
        m[rows - 1] = last
        missing = draw.choice([-1.0, -1e-3, -30.0, 0.5])
        q[rows - 1] = missing - math.fsum(w * q[i] for i, w in enumerate(weights))
        low = np.array([draw.choice([0.0, -2.0, 0.5]) for _ in range(n)])
        high = np.full(n, np.inf)
        if rows < n:
            high[n - 1] = low[n - 1] + 2.0
        if number % 3 == 1:  # the same with the other signs
            low, high, q = -high, -low, -q
        for name, options in (
            ("all", {}),
            ("pivots", {"smoothing": False, "restarts": 1, "enumerate_up_to": 0}),
        ):
            yield (
                f"{name} {number}",
                lambda m=m, q=q, low=low, high=high, o=options: fields(
                    zivi.solve_avi(m, q, low, high, tol=1e-9, options=o), SOLUTION
                ),
            )


def games():
    """Lemke and Howson's paths; costs may be equal, so that several variables could leave."""
    draw = random.Random(29)
    for number in range(40):
        m, n = draw.randint(1, 9), draw.randint(1, 9)
        whole = number % 2 == 0
        a, b = (
            np.array(
                [
                    [float(draw.randint(1, 3)) if whole else draw.uniform(1, 2) for _ in range(n)]
                    for _ in range(m)
                ]
            )
            for _ in range(2)
        )
        limit = 5 if number % 7 == 0 else 1000
        yield f"{number}", lambda a=a, b=b, limit=limit: path_of(a, b, limit)


def path_of(a, b, limit):
    """Give the ends of the paths."""
    found = zivi._zivi.lemke_howson(a, b, limit)
    return None if found is None else list(found)


GROUPS = {
    "mechanics": mechanics,
    "contacts": contacts,
    "derivatives": derivatives,
    "sensitivities": sensitivities,
    "maps": maps,
    "solver": solver,
    "stages": stages,
    "infeasible": infeasible,
    "games": games,
    "control": control,
    "choices": choices,
    "observers": observers,
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
