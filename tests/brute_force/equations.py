"""Equations of motion in mpmath, Lagrange's by SymPy, and the problem of an impact."""

import itertools

import sympy as sp
from mpmath import mp, mpf


def solved(matrix, right):
    """X with matrix x = right, by elimination with pivots."""
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
        flat = [
            *itertools.chain(*mass),
            *force,
            *gaps,
            *itertools.chain(*normals),
            *curvatures,
            *rates,
        ]
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
        return (
            mass,
            force,
            gaps,
            normals,
            [next(take) for _ in range(m)],
            [next(take) for _ in range(m)],
        )

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
        """G'' of all gaps."""
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
