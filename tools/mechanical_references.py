"""References of mechanical systems with impacts, by brute force in 45 digits: tests/data/mechanical_references.json.

Nothing is shared with zivi: own Lagrange equations (SymPy), extrapolated midpoint rule (Gragg, Bulirsch, Stoer), and
every impact is followed until its speed is 1e-19, without any extrapolation of accumulations. It takes minutes:

    python tools/mechanical_references.py [--digits 45] [NAME ...]
"""

import argparse
import itertools
import json
import sys
from pathlib import Path

import sympy as sp
from mpmath import mp, mpf

TARGET = Path(__file__).parents[1] / "tests" / "data" / "mechanical_references.json"
SLOW, CORNER = mpf(10) ** -19, mpf(10) ** -15
"""A gap whose impacts are slower is closed; gaps that all are slower than the second, in a corner."""
ACCURACY = mpf(10) ** -26
LONGEST = mpf(1) / 25
COLUMNS = 16

PLANE = "m*(xdot**2 + ydot**2)/2"
DOUBLE = {
    "q": "a b",
    "T": "(m1 + m2)*l1**2*adot**2/2 + m2*l2**2*bdot**2/2 + m2*l1*l2*adot*bdot*cos(a - b)",
    "V": "-(m1 + m2)*G*l1*cos(a) - m2*G*l2*cos(b)",
    "Q": ["-cd*adot", "-cd*bdot"],
}
CASES = {
    "stop": {  # a driven pendulum and a stop
        "q": "a",
        "T": "m*l**2*adot**2/2",
        "V": "-m*G*l*cos(a)",
        "Q": ["-cd*adot + A*sin(om*t)"],
        "gaps": ["a + d"],
        "parameters": {"m": 1.2, "l": 0.8, "G": 9.81, "cd": 0.1, "A": 6.0, "om": 2.5, "d": -0.35},
        "e": [0.55],
        "start": ([1.1], [0.0]),
        "end": 6,
    },
    "bumps": {  # a mass that slides over a road of bumps and takes off
        "q": "x y",
        "T": PLANE,
        "V": "m*G*y",
        "Q": ["-cd*xdot + f", "-cd*ydot"],
        "gaps": ["y - a*sin(k*x) - b*cos(2*k*x/3)"],
        "parameters": {
            "m": 1.5, "G": 9.81, "cd": 0.15, "f": 2.0, "a": 0.14, "b": 0.11, "k": 3.0
        },
        "e": [0.45],
        "start": ([-0.3, 0.5], [2.6, 0.0]),
        "end": 4,
    },
    "frame": {  # two walls at right angles in a frame that moves
        "q": "x y",
        "T": PLANE,
        "V": "m*G*y + m*fx*x",
        "Q": ["-cd*xdot", "-cd*ydot"],
        "gaps": ["x - A*sin(om*t)", "y - B*cos(2*om*t)"],
        "parameters": {"m": 0.7, "G": 9.81, "fx": 3.0, "cd": 0.05, "A": 0.11, "B": 0.06, "om": 5.0},
        "e": [0.5, 0.35],
        "start": ([0.3, 0.4], [-0.4, 0.2]),
        "end": 3,
    },
    "acute": {  # a ball in a wedge that is not symmetric, with a different law at each wall
        "q": "x y",
        "T": PLANE,
        "V": "m*G*y",
        "Q": ["-cd*xdot", "-cd*ydot"],
        "gaps": ["y*cos(a1) + x*sin(a1)", "y*cos(a2) - x*sin(a2)"],
        "parameters": {"m": 1.0, "G": 9.81, "cd": 0.1, "a1": 1.15, "a2": 0.8},
        "e": [0.3, 0.6],
        "start": ([-0.15, 0.9], [0.5, 0.0]),
        "end": 2.5,
    },
    "obtuse": {
        "q": "x y",
        "T": PLANE,
        "V": "m*G*y",
        "Q": ["-cd*xdot", "-cd*ydot"],
        "gaps": ["y*cos(a1) + x*sin(a1)", "y*cos(a2) - x*sin(a2)"],
        "parameters": {"m": 1.0, "G": 9.81, "cd": 0.2, "a1": 0.55, "a2": 0.7},
        "e": [0.35, 0.5],
        "start": ([0.25, 0.8], [0.1, 0.0]),
        "end": 3.5,
    },
    "tower": {
        "q": "x y z",
        "T": "(m0*xdot**2 + m1*ydot**2 + m2*zdot**2)/2",
        "V": "G*(m0*x + m1*y + m2*z)",
        "gaps": ["x - A*sin(om*t)", "y - x", "z - y"],
        "parameters": {"m0": 1.6, "m1": 0.9, "m2": 0.5, "G": 9.81, "A": 0.03, "om": 11.0},
        "e": [0.4, 0.25, 0.5],
        "start": ([0.3, 0.55, 0.9], [0.0, 0.1, -0.2]),
        "end": 1.6,
    },
    "block": {  # a rocking block of another slenderness, pushed
        "q": "y th",
        "T": "m*ydot**2/2 + J*thdot**2/2",
        "V": "m*G*y",
        "Q": ["A*sin(om*t)", "B*sin(om*t)"],
        "gaps": ["y - hh*cos(th) + b*sin(th)", "y - hh*cos(th) - b*sin(th)"],
        "parameters": {
            "m": 1.3, "J": 0.6, "G": 9.81, "hh": 0.4, "b": 1.1, "A": 8.0, "B": 9.0, "om": 3.0
        },
        "e": [0.4, 0.3],
        "start": ([0.75, 0.12], [0.0, 0.2]),
        "end": 2.5,
    },
    "bar": {  # a bar that falls on a floor and against a wall
        "q": "x y th",
        "T": "m*(xdot**2 + ydot**2)/2 + J*thdot**2/2",
        "V": "m*G*y",
        "Q": ["f", 0, 0],
        "gaps": ["y + l*sin(th)", "y - l*sin(th)", "d - x - l*cos(th)"],
        "parameters": {"m": 1.1, "J": 0.15, "G": 9.81, "l": 0.6, "d": 1.0, "f": 1.3},
        "e": [0.45, 0.3, 0.4],
        "start": ([0.1, 0.6, 0.25], [0.2, 0.0, 0.1]),
        "end": 2.2,
    },
    "rail": {  # a cart with a pendulum between two buffers
        "q": "x phi",
        "T": "(mc + mp)*xdot**2/2 + mp*l**2*phidot**2/2 + mp*l*xdot*phidot*cos(phi)",
        "V": "-mp*G*l*cos(phi)",
        "Q": ["-cx*xdot - f", "-cp*phidot"],
        "gaps": ["x", "d - x"],
        "parameters": {
            "mc": 1.0, "mp": 0.6, "l": 0.5, "G": 9.81, "cx": 0.05, "cp": 0.02, "f": 1.6, "d": 0.35
        },
        "e": [0.4, 0.6],
        "start": ([0.2, 1.6], [0.0, 0.0]),
        "end": 4,
    },
    "bowl": {  # a mass in a bowl, with a wall
        "q": "x y z",
        "T": "m*(xdot**2 + ydot**2 + zdot**2)/2",
        "V": "m*G*z",
        "Q": ["-cd*xdot", "-cd*ydot", "-cd*zdot"],
        "gaps": ["z - c*x**2 - k*y**2", "d - x"],
        "parameters": {"m": 1.0, "G": 9.81, "cd": 0.25, "c": 0.6, "k": 0.4, "d": 0.12},
        "e": [0.5, 0.4],
        "start": ([-0.5, 0.3, 0.9], [0.6, -0.4, 0.0]),
        "end": 3,
    },
    "swing": DOUBLE | {  # a double pendulum and a wall for its tip
        "gaps": ["l1*sin(a) + l2*sin(b) + d"],
        "parameters": {"m1": 0.8, "m2": 1.0, "l1": 0.9, "l2": 0.8, "G": 9.81, "cd": 0.05, "d": -0.1},
        "e": [0.3],
        "start": ([0.7, 0.4], [0.0, 0.3]),
        "end": 4,
    },
    "elbow": DOUBLE | {  # and one for its elbow too
        "gaps": ["l1*sin(a) + l2*sin(b) + d", "l1*sin(a) + c"],
        "parameters": {
            "m1": 1.1, "m2": 0.7, "l1": 1.0, "l2": 0.6, "G": 9.81, "cd": 0.1, "d": -0.15, "c": -0.1
        },
        "e": [0.4, 0.5],
        "start": ([0.8, 0.9], [0.0, 0.0]),
        "end": 3,
    },
    "hang": DOUBLE | {  # that comes to rest in the corner of two walls
        "gaps": ["l1*sin(a) + c", "l1*sin(a) + l2*sin(b) + d"],
        "parameters": {
            "m1": 0.9, "m2": 1.2, "l1": 0.8, "l2": 0.9, "G": 9.81, "cd": 0.15, "d": -0.25, "c": -0.3
        },
        "e": [0.3, 0.45],
        "start": ([0.9, 0.5], [0.0, 0.0]),
        "end": 4,
    },
    "block tall": {
        "q": "y th",
        "T": "m*ydot**2/2 + J*thdot**2/2",
        "V": "m*G*y",
        "gaps": ["y - hh*cos(th) + b*sin(th)", "y - hh*cos(th) - b*sin(th)"],
        "parameters": {"m": 1.0, "J": 0.5, "G": 9.81, "hh": 0.9, "b": 0.45},
        "e": [0.35, 0.5],
        "start": ([1.1, 0.08], [0.0, 0.1]),
        "end": 2.5,
    },
    "leg": {  # a hopper whose leg has a longest and a shortest length
        "q": "y0 y1",
        "T": "mf*y0dot**2/2 + mb*y1dot**2/2",
        "V": "mf*G*y0 + mb*G*y1 + k*(l0 - y1 + y0)**2/2",
        "Q": ["c*(y1dot - y0dot) - A*sin(om*t)", "-c*(y1dot - y0dot) + A*sin(om*t)"],
        "gaps": ["y0", "y1 - y0 - s", "r - y1 + y0"],
        "parameters": {
            "mf": 0.5, "mb": 1.8, "k": 200.0, "c": 2.0, "l0": 0.5, "G": 9.81, "A": 50.0, "om": 6.0,
            "s": 0.36, "r": 0.56,
        },
        "e": [0.3, 0.4, 0.5],
        "start": ([0.15, 0.66], [0.0, 0.0]),
        "end": 2.5,
    },
    "row": {  # two masses on springs between two walls
        "q": "x y",
        "T": "m1*xdot**2/2 + m2*ydot**2/2",
        "V": "k*x**2/2 + k*(y - x - r)**2/2",
        "Q": ["-f + A*sin(om*t) - cd*xdot", "f - cd*ydot"],
        "gaps": ["x", "y - x - s", "d - y"],
        "parameters": {
            "m1": 1.0, "m2": 0.6, "k": 4.0, "r": 0.5, "s": 0.2, "d": 1.0, "f": 5.0, "A": 6.0,
            "om": 2.0, "cd": 0.2,
        },
        "e": [0.35, 0.5, 0.45],
        "start": ([0.3, 0.8], [-1.0, 0.5]),
        "end": 5,
    },
}  # fmt: skip
"""Own cases, none of which is in the other files of references."""


def solved(matrix, right):
    """x with matrix x = right, by elimination with pivots."""
    n = len(right)
    rows = [[*row, b] for row, b in zip(matrix, right, strict=True)]
    for k in range(n):
        p = max(range(k, n), key=lambda i: abs(rows[i][k]))
        rows[k], rows[p] = rows[p], rows[k]
        for i in range(k + 1, n):
            factor = rows[i][k] / rows[k][k]
            if factor:
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    x = [mpf(0)] * n
    for k in reversed(range(n)):
        x[k] = (rows[k][n] - sum(rows[k][j] * x[j] for j in range(k + 1, n))) / rows[k][k]
    return x


def dot(a, b):
    return mp.fsum(x * y for x, y in zip(a, b, strict=True) if x and y)


class System:
    """M, F, gaps, gradients, curvatures and rates in mpmath, by Lagrange's equations."""

    def __init__(self, case):
        t = sp.Symbol("t")
        q = sp.symbols(case["q"], seq=True)
        w = [sp.Symbol(f"{x.name}dot") for x in q]
        self.n, self.m = len(q), len(case["gaps"])
        exact = {key: sp.Rational(str(value)) for key, value in case["parameters"].items()}
        names = {x.name: x for x in [t, *q, *w]}
        kinetic, potential = (
            sp.sympify(case.get(part, 0), names).subs(exact) for part in ("T", "V")
        )
        forces = [sp.sympify(x, names).subs(exact) for x in case.get("Q", [0] * self.n)]
        mass = [[sp.diff(kinetic, a, b) for b in w] for a in w]
        force = []
        for i in range(self.n):
            momentum = sp.diff(kinetic, w[i])
            drift = sp.diff(momentum, t) + sum(
                sp.diff(momentum, x) * v for x, v in zip(q, w, strict=True)
            )
            force.append(forces[i] + sp.diff(kinetic - potential, q[i]) - drift)
        gaps = [sp.sympify(g, names).subs(exact) for g in case["gaps"]]
        normals = [[sp.diff(g, x) for x in q] for g in gaps]
        rates = [sp.diff(g, t) for g in gaps]
        speeds = [
            sum(n * v for n, v in zip(row, w, strict=True)) + r
            for row, r in zip(normals, rates, strict=True)
        ]
        curvatures = [
            sp.diff(s, t) + sum(sp.diff(s, x) * v for x, v in zip(q, w, strict=True))
            for s in speeds
        ]
        flat = [*itertools.chain(*mass), *force, *gaps, *itertools.chain(*normals), *curvatures, *rates]
        self.function = sp.lambdify([t, *q, *w], flat, modules="mpmath", cse=True)
        self.e = [mpf(str(e)) for e in case["e"]]

    def at(self, t, q, w):
        """M, F, g, N, h, g_t."""
        n, m = self.n, self.m
        flat = [mp.mpf(x) for x in self.function(t, *q, *w)]
        take = iter(flat)
        mass = [[next(take) for _ in range(n)] for _ in range(n)]
        force, gaps = [next(take) for _ in range(n)], [next(take) for _ in range(m)]
        normals = [[next(take) for _ in range(n)] for _ in range(m)]
        return mass, force, gaps, normals, [next(take) for _ in range(m)], [next(take) for _ in range(m)]

    def motion(self, t, q, w, closed):
        """Accelerations and contact forces with closed gaps."""
        mass, force, _, normals, curvature, _ = self.at(t, q, w)
        free = solved(mass, force)
        if not closed:
            return free, {}
        ways = {i: solved(mass, normals[i]) for i in closed}
        matrix = [[dot(normals[i], ways[j]) for j in closed] for i in closed]
        right = [-dot(normals[i], free) - curvature[i] for i in closed]
        forces = dict(zip(closed, solved(matrix, right), strict=True))
        for i, size in forces.items():
            free = [a + size * d for a, d in zip(free, ways[i], strict=True)]
        return free, forces

    def gaps(self, t, q, w):
        _, _, gaps, normals, _, rates = self.at(t, q, w)
        return gaps, [dot(n, w) + r for n, r in zip(normals, rates, strict=True)]

    def second(self, t, q, w, closed):
        """g'' of all gaps."""
        acceleration, _ = self.motion(t, q, w, closed)
        _, _, _, normals, curvature, _ = self.at(t, q, w)
        return [dot(n, acceleration) + h for n, h in zip(normals, curvature, strict=True)]


def complementary(matrix, right):
    """0 <= z, matrix z + right >= 0, one of them zero: the pattern that violates least."""
    k, best = len(right), None
    for pattern in itertools.product([False, True], repeat=k):
        on = [i for i in range(k) if pattern[i]]
        z = [mpf(0)] * k
        part = solved([[matrix[i][j] for j in on] for i in on], [-right[i] for i in on])
        for i, x in zip(on, part, strict=True):
            z[i] = x
        left = [dot(matrix[i], z) + right[i] for i in range(k)]
        worst = min([*z, *[left[i] for i in range(k) if not pattern[i]]], default=mpf(0))
        if best is None or worst > best[0]:
            best = (worst, z, pattern)
    return best[1], best[2]


class Run:
    def __init__(self, case):
        self.system = System(case)
        self.t = mpf(0)
        self.q, self.w = ([mpf(str(x)) for x in part] for part in case["start"])
        self.end = mpf(str(case["end"]))
        self.closed = ()
        self.events = []
        self.impacts = 0
        self.struck = []
        self.length = LONGEST

    # --- steps

    def step(self, h):
        """The state after h, by the extrapolated midpoint rule, and whether it is accurate."""
        n, size = self.system.n, 2 * self.system.n
        y0 = [*self.q, *self.w]
        limit = ACCURACY * (1 + max(abs(y) for y in y0))

        def slope(t, y):
            return [*y[n:], *self.system.motion(t, y[:n], y[n:], self.closed)[0]]

        first = slope(self.t, y0)
        table = []
        for k in range(1, COLUMNS + 1):
            parts = 2 * k
            d = h / parts
            before, now = y0, [a + d * b for a, b in zip(y0, first, strict=True)]
            for i in range(1, parts):
                f = slope(self.t + i * d, now)
                before, now = now, [a + 2 * d * b for a, b in zip(before, f, strict=True)]
            row = [now]
            for j, old in enumerate(table, start=1):
                factor = mpf(1) / ((mpf(k) / (k - j)) ** 2 - 1)
                row.append([a + (a - b) * factor for a, b in zip(row[-1], old, strict=True)])
            if k > 2:
                error = max(abs(row[-1][i] - row[-2][i]) for i in range(size))
                if error < limit:
                    return row[-1], True
            table = row
        return row[-1], False

    def set(self, h, y):
        self.t += h
        self.q, self.w = y[: self.system.n], y[self.system.n :]

    def project(self, closed):
        """Coordinates and velocities along the impulses onto closed gaps."""
        for _ in range(3):
            mass, _, gaps, normals, _, rates = self.system.at(self.t, self.q, self.w)
            ways = {i: solved(mass, normals[i]) for i in closed}
            matrix = [[dot(normals[i], ways[j]) for j in closed] for i in closed]
            for name, off in (
                ("q", [-gaps[i] for i in closed]),
                ("w", [-dot(normals[i], self.w) - rates[i] for i in closed]),
            ):
                value = getattr(self, name)
                for i, size in zip(closed, solved(matrix, off), strict=True):
                    value = [a + size * b for a, b in zip(value, ways[i], strict=True)]
                setattr(self, name, value)

    def state(self):
        return [mp.nstr(x, 26) for x in (*self.q, *self.w)]

    def note(self, kind, gaps):
        self.events.append([kind, mp.nstr(self.t, 26), list(gaps), self.state()])

    # --- what is seen in a step of length h that ends in y

    def lowest(self, h, y):
        """Where a gap first is below zero: by the quintic through both ends, at many points."""
        n, s = self.system.n, self.system
        g0, v0 = s.gaps(self.t, self.q, self.w)
        a0 = s.second(self.t, self.q, self.w, self.closed)
        g1, v1 = s.gaps(self.t + h, y[:n], y[n:])
        a1 = s.second(self.t + h, y[:n], y[n:], self.closed)
        first = None
        for i in range(s.m):
            if i in self.closed:
                continue
            b = [g0[i], g0[i] + h * v0[i] / 5, 0, 0, g1[i] - h * v1[i] / 5, g1[i]]
            b[2] = 2 * b[1] - b[0] + h * h * a0[i] / 20
            b[3] = 2 * b[4] - b[5] + h * h * a1[i] / 20
            if all(x > 0 for x in b[1:]):
                continue
            for k in range(1, 65):
                x = mpf(k) / 64
                row = b
                while len(row) > 1:
                    row = [(1 - x) * p + x * r for p, r in zip(row, row[1:], strict=False)]
                if row[0] < 0:
                    if first is None or x < first[0]:
                        first = (x, i)
                    break
        return first

    def below(self, h, y, hit):
        """Another open gap that is below zero."""
        n = self.system.n
        gaps, _ = self.system.gaps(self.t + h, y[:n], y[n:])
        others = (i for i in range(self.system.m) if i not in (*self.closed, hit))
        return next((i for i in others if gaps[i] < -(mpf(10) ** -30)), None)

    def hit(self, i, h):
        """Newton's iteration for the time of an impact near h."""
        n = self.system.n
        low = mpf(0)
        g, v = (part[i] for part in self.system.gaps(self.t, self.q, self.w))
        if abs(g) < mpf(10) ** -36:  # from an impact: the other root
            a = self.system.second(self.t, self.q, self.w, self.closed)[i]
            guess = -2 * v / a if a < 0 else h
            low = guess / 2 if guess < h else low
            h = min(h, guess) if guess > 0 else h
        for _ in range(60):
            y, _ = self.step(h)
            g, v = (part[i] for part in self.system.gaps(self.t + h, y[:n], y[n:]))
            if v < 0:
                change = -g / v
            else:
                change = h * mpf("-0.1") if g < 0 else h * mpf("0.05")
            h = max(h + change, (low + h) / 2)
            if abs(change) < mpf(10) ** -32 + mpf(10) ** -22 * h:
                break
        y, _ = self.step(h)
        return h, y

    def released(self, h, y):
        """The closed gap whose force vanishes in a step, and when."""
        n = self.system.n
        after = self.system.motion(self.t + h, y[:n], y[n:], self.closed)[1]
        negative = [i for i in self.closed if after[i] < 0]
        if not negative:
            return None
        best = None
        for i in negative:
            a, fa = mpf(0), self.system.motion(self.t, self.q, self.w, self.closed)[1][i]
            b, fb = h, after[i]
            for _ in range(100):
                x = b - fb * (b - a) / (fb - fa)
                if not 0 <= x <= h:
                    x = (a + b) / 2
                z, _ = self.step(x)
                a, fa = b, fb
                b, fb = x, self.system.motion(self.t + x, z[:n], z[n:], self.closed)[1][i]
                if abs(b - a) < mpf(10) ** -24 or fb == fa:
                    break
            if best is None or b < best[0]:
                best = (b, i)
        return best

    # --- events

    def strike(self, i):
        s = self.system
        gaps, speeds = s.gaps(self.t, self.q, self.w)
        touched = sorted({*self.closed, i})
        mass, _, _, normals, _, _ = s.at(self.t, self.q, self.w)
        ways = {j: solved(mass, normals[j]) for j in touched}
        matrix = [[dot(normals[j], ways[k]) for k in touched] for j in touched]
        before = [mpf(0) if j in self.closed else speeds[j] for j in touched]
        right = [(1 + s.e[j]) * v for j, v in zip(touched, before, strict=True)]
        p, positive = complementary(matrix, right)
        for j, size in zip(touched, p, strict=True):
            self.w = [a + size * b for a, b in zip(self.w, ways[j], strict=True)]
        self.impacts += 1
        if -speeds[i] > mpf("1e-3"):
            self.events.append(["impact", mp.nstr(self.t, 26), [i], [mp.nstr(-speeds[i], 26)]])
        stays = []
        for j, pushed in zip(touched, positive, strict=True):
            after = s.gaps(self.t, self.q, self.w)[1][j]
            resting = j != i and pushed
            slow = j == i and after < SLOW
            if resting or slow or after < mpf(10) ** -30:
                stays.append(j)
        opened = [j for j in self.closed if j not in stays]
        self.struck = [*self.struck[-7:], i]
        self.close(stays)
        if opened:
            self.note("open", opened)
        self.corner()

    def close(self, stays):
        """The gaps that stay closed, as far as the forces press on them."""
        before = self.closed
        self.project(stays) if stays else None
        mass, force, _, normals, curvature, _ = self.system.at(self.t, self.q, self.w)
        free = solved(mass, force)
        ways = {j: solved(mass, normals[j]) for j in stays}
        matrix = [[dot(normals[j], ways[k]) for k in stays] for j in stays]
        right = [dot(normals[j], free) + curvature[j] for j in stays]
        _, positive = complementary(matrix, right)
        self.closed = tuple(j for j, on in zip(stays, positive, strict=True) if on)
        new = [j for j in self.closed if j not in before]
        for j in new:
            self.note("zeno", [j])
        if new:
            self.struck = []

    def corner(self):
        """Whether several gaps accumulate together and are as good as closed."""
        s = self.system
        gaps, speeds = s.gaps(self.t, self.q, self.w)
        near = [
            j
            for j in range(s.m)
            if j in self.closed or (abs(speeds[j]) < CORNER and abs(gaps[j]) < CORNER * CORNER)
        ]
        if len([j for j in near if j not in self.closed]) < 1 or len(near) < 2:
            return
        opened = any(set(e[2]) & set(near) for e in self.events[-30:] if e[0] == "open")
        if not opened and len(set(self.struck) & set(near)) < 2:
            return
        forces = s.motion(self.t, self.q, self.w, tuple(near))[1]
        if all(force > 0 for force in forces.values()):
            self.closed = tuple(near)
            self.project(near)
            self.note("corner", near)

    def go(self):
        while self.t < self.end:
            h = min(self.length, self.end - self.t)
            y, accurate = self.step(h)
            if not accurate:
                self.length = h / 2
                continue
            hit = self.lowest(h, y)
            release = self.released(h, y) if self.closed else None
            if hit is not None:
                gap, (length, y) = hit[1], self.hit(hit[1], hit[0] * h)
                while (other := self.below(length, y, gap)) is not None:  # it was hit before
                    gap, (length, y) = other, self.hit(other, length)
                if length > h * mpf("1.01"):
                    raise RuntimeError(f"impact outside of the step: {length} {h}")
                if release is None or length <= release[0]:
                    if self.t + length >= self.end:
                        raise RuntimeError("the run ends near an impact")
                    self.set(length, y)
                    self.strike(gap)
                    self.length = LONGEST
                    continue
            if release is not None:
                length, i = release
                y, _ = self.step(length)
                self.set(length, y)
                self.project(self.closed)
                self.closed = tuple(j for j in self.closed if j != i)
                self.note("lift", [i])
                # off the root at zero, where all vanish
                y, _ = self.step(mpf("1e-3"))
                self.set(mpf("1e-3"), y)
                continue
            self.set(h, y)
            if self.closed:
                self.project(self.closed)
            self.length = LONGEST

    def result(self):
        return {
            "state": self.state(),
            "active": list(self.closed),
            "n_impacts": self.impacts,
            "events": together(self.events),
        }


def together(events):
    """Accumulations of several gaps in turn end in one corner: their closings are one event."""
    found = []
    for event in events:
        last = found[-1] if found else ["", "0"]
        same = abs(mpf(event[1]) - mpf(last[1])) < mpf(10) ** -13
        if event[0] == "zeno" and last[0] in ("zeno", "corner") and same:
            found[-1] = ["corner", event[1], sorted([*last[2], *event[2]]), event[3]]
        else:
            found.append(event)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--digits", type=int, default=45)
    parser.add_argument("--to", type=Path, default=TARGET)
    asked = parser.parse_args()
    mp.dps = asked.digits
    known = json.loads(asked.to.read_text()) if asked.to.exists() else {}
    for name in asked.names or CASES:
        run = Run(CASES[name])
        run.go()
        known[name] = CASES[name] | run.result()
        told = [(e[0], e[1][:12], e[2]) for e in run.events if e[0] != "impact"]
        sys.stderr.write(f"{name}: {run.impacts} impacts {told}\n")
        asked.to.write_text(json.dumps(known, indent=1) + "\n")


if __name__ == "__main__":
    main()
