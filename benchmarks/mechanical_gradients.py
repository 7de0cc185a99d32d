"""Derivatives of mechanical systems to 12 digits, without any code of zivi's.

``python benchmarks/mechanical_gradients.py out.json`` integrates each case by extrapolation
(Gragg, Bulirsch, Stoer) in 40 digits, with its impacts, Zeno points (the raw sequences of times and
states, powers of e removed), contacts and lift-offs, and takes central differences.
It writes tests/data/mechanical_gradients.json anew; it takes some minutes.
"""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Callable
from typing import Any

import mpmath
import sympy
from mpmath import mp, mpf

mp.dps = 40
ERROR = mpf(10) ** -24
SLOW = mpf(10) ** -5
STEP = mpf(10) ** -9
COLUMNS = 9

CASES: dict[str, dict[str, Any]] = {
    "double_pendulum": {
        "q": "a b",
        "T": "(m1+m2)*l1**2*adot**2/2 + m2*l2**2*bdot**2/2 + m2*l1*l2*adot*bdot*cos(a-b)",
        "V": "-(m1+m2)*g*l1*cos(a) - m2*g*l2*cos(b)",
        "Q": ["-cd*adot", "-cd*bdot"],
        "gaps": ["l1*sin(a) + l2*sin(b) + d"],
        "parameters": {
            "m1": "1",
            "m2": "0.8",
            "l1": "1",
            "l2": "0.7",
            "g": "9.81",
            "cd": "0.02",
            "d": "-0.2",
        },
        "e": ["0.4"],
        "q0": ["0.5", "0.9"],
        "qdot0": ["0", "0"],
        "t": "4.2",
        "by": ["m2", "l2", "d"],
    },
    "bumps": {
        "q": "x y",
        "T": "m*(xdot**2 + ydot**2)/2",
        "V": "m*g*y",
        "Q": ["0", "0"],
        "gaps": ["y - h*sin(k*x)"],
        "parameters": {"m": "1", "g": "9.81", "h": "0.25", "k": "2"},
        "e": ["0.3"],
        "q0": ["0.4", "0.4"],
        "qdot0": ["3.6", "0"],
        "t": "1.6",
        "by": ["g", "h", "k"],
    },
    "wedge": {
        "q": "x y",
        "T": "m*(xdot**2 + ydot**2)/2",
        "V": "m*g*y",
        "Q": ["-cd*xdot", "-cd*ydot"],
        "gaps": ["y*cos(a1) + x*sin(a1)", "y*cos(a2) - x*sin(a2)"],
        "parameters": {"m": "1", "g": "9.81", "a1": "0.6", "a2": "0.4", "cd": "0.1"},
        "e": ["0.3", "0.2"],
        "q0": ["0.2", "0.6"],
        "qdot0": ["0.3", "0"],
        "t": "0.9",
        "by": ["a1", "a2", "g"],
    },
    "dome": {
        "q": "x y",
        "T": "m*(xdot**2 + ydot**2)/2",
        "V": "m*g*y",
        "Q": ["-cd*xdot + f*sin(om*t)", "-cd*ydot"],
        "gaps": ["y + s*x + c*x**2", "d - x"],
        "parameters": {
            "m": "1",
            "g": "9.81",
            "cd": "0.2",
            "f": "6",
            "om": "2.5",
            "s": "0.3",
            "c": "0.1",
            "d": "0.7",
        },
        "e": ["0.4", "0.5"],
        "q0": ["0", "0.4"],
        "qdot0": ["0.3", "0"],
        "t": "2.2",
        "by": ["f", "om", "c", "d"],
    },
}


class System:
    """Functions of one case."""

    def __init__(self, case: dict[str, Any]) -> None:
        t = sympy.Symbol("t")
        q = list(sympy.symbols(case["q"]))
        w = list(sympy.symbols(" ".join(f"{x}dot" for x in q)))
        p = list(sympy.symbols(" ".join(case["parameters"])))
        names = {str(s): s for s in [t, *q, *w, *p]}
        read = lambda text: sympy.sympify(text, locals=names)  # noqa: E731
        lagrangian = read(case["T"]) - read(case["V"])
        momenta = [lagrangian.diff(v) for v in w]
        mass = sympy.Matrix([[momentum.diff(v) for v in w] for momentum in momenta])
        force = [
            read(case["Q"][i])
            + lagrangian.diff(q[i])
            - sum(momenta[i].diff(x) * v for x, v in zip(q, w, strict=True))
            for i in range(len(q))
        ]
        gaps = [read(gap) for gap in case["gaps"]]
        normals = [[gap.diff(x) for x in q] for gap in gaps]
        bends = [
            sum(
                n.diff(x) * v * u
                for n, u in zip(row, w, strict=True)
                for x, v in zip(q, w, strict=True)
            )
            for row in normals
        ]
        everything = [mass, sympy.Matrix(force), gaps, normals, bends]
        self.evaluate = sympy.lambdify([t, q, w, p], everything, "mpmath", cse=True)
        self.n = len(q)


class Run:
    """One motion, in high precision."""

    def __init__(self, system: System, e: list[Any], p: list[Any], q: list[Any], w: list[Any]):
        self.system, self.e, self.p = system, e, p
        self.t, self.y, self.closed = mpf(0), [*q, *w], ()
        self.zeno: list[Any] = []
        self.lift: list[Any] = []
        self.chain: list[Any] = []

    def at(self, t: Any, y: list[Any]) -> Any:
        """Give mass, force, gaps, normals and curvatures."""
        n = self.system.n
        return self.system.evaluate(t, y[:n], y[n:], self.p)

    def forces(self, t: Any, y: list[Any], closed: tuple[int, ...]) -> tuple[Any, Any]:
        """Give accelerations, and the forces of contacts."""
        mass, force, _, normals, bends = self.at(t, y)
        free = mp.lu_solve(mass, force)
        if not closed:
            return free, []
        rows = mp.matrix([normals[i] for i in closed])
        to = mp.lu_solve_many(mass, rows.T)
        right = -(rows * free + mp.matrix([bends[i] for i in closed]))
        pressed = mp.lu_solve(rows * to, right)
        return free + to * pressed, pressed

    def rates(self, t: Any, y: list[Any]) -> list[Any]:
        """Give the right side of the equations of motion."""
        n = self.system.n
        return [*y[n:], *self.forces(t, y, self.closed)[0]]

    def step(self, h: Any) -> list[Any]:
        """Extrapolate the modified midpoint rule."""
        first = self.rates(self.t, self.y)
        rows: list[list[Any]] = []
        for j in range(1, 16):
            number = 2 * j
            part = h / number
            before, now = self.y, add(self.y, first, part)
            for k in range(1, number):
                slope = self.rates(self.t + k * part, now)
                before, now = now, add(before, slope, 2 * part)
            last = self.rates(self.t + h, now)
            ends = zip(before, now, last, strict=True)
            row = [[(b + a + part * s) / 2 for b, a, s in ends]]
            for i in range(1, j):
                factor = (mpf(j) / (j - i)) ** 2 - 1
                pairs = zip(row[i - 1], rows[-1][i - 1], strict=True)
                row.append([a + (a - b) / factor for a, b in pairs])
            if rows and max(abs(a - b) for a, b in zip(row[-1], rows[-1][-1], strict=True)) < ERROR:
                return row[-1]
            rows.append(row)
        raise ArithmeticError("step too long")

    def watched(self, t: Any, y: list[Any]) -> dict[int, Any]:
        """Give what must stay positive: open gaps, forces of contacts."""
        gaps = self.at(t, y)[2]
        found = {i: gap for i, gap in enumerate(gaps) if i not in self.closed}
        for i, force in zip(self.closed, self.forces(t, y, self.closed)[1], strict=True):
            found[i] = force
        return found

    def go(self, end: Any) -> None:
        """Move on up to a time."""
        h, quiet = mpf("0.03"), None
        while self.t < end:
            length = min(h, end - self.t)
            if quiet is not None:
                length = min(length, quiet)
            y = self.step(length)
            low = [i for i, value in self.watched(self.t + length, y).items() if value < 0]
            if not low:
                self.t, self.y, quiet = self.t + length, y, None
                continue
            times = {i: self.root(i, length) for i in low}
            gap = min(times, key=times.__getitem__)
            self.y = self.step(times[gap])
            self.t += times[gap]
            if gap in self.closed:
                self.closed = tuple(i for i in self.closed if i != gap)
                self.lift.append(self.t)
                quiet = mpf("0.02")
            else:
                quiet = self.strike(gap)

    def root(self, gap: int, length: Any) -> Any:
        """Find where a watched number vanishes, by the Illinois rule, away from zero."""
        value = lambda h: self.watched(self.t + h, self.step(h))[gap]  # noqa: E731
        low, high = length / 100, length
        while value(low) <= 0:
            low /= 10
        return mpmath.findroot(value, (low, high), solver="anderson", tol=mpf(10) ** -46)

    def strike(self, gap: int) -> Any:
        """Apply the impact; give a time within which the next one of this gap may come."""
        n, active = self.system.n, (*self.closed, gap)
        mass, _, _, normals, _ = self.at(self.t, self.y)
        rows, w = mp.matrix([normals[i] for i in active]), mp.matrix(self.y[n:])
        to = mp.lu_solve_many(mass, rows.T)
        speeds = rows * w
        before = speeds[len(active) - 1]
        u = -self.e[gap] * before
        wanted = mp.matrix([*[0] * len(self.closed), u]) - speeds
        impulses = mp.lu_solve(rows * to, wanted)
        if min(impulses) < 0:
            # the impact opens the contacts
            assert len(active) == 2
            self.closed, self.chain = (), []
            return self.strike(gap)
        self.y[n:] = list(w + to * impulses)
        still = mp.lu_solve(rows * to, -speeds)
        rest = [self.t, *self.y[:n], *(w + to * still)]
        accelerations, _ = self.forces(self.t, rest[1:], self.closed)
        bend = self.at(self.t, rest[1:])[4][gap]
        pull = -(mp.matrix([normals[gap]]) * accelerations)[0] - bend
        chain = self.chain and self.chain[-1][0] == gap
        self.chain = [*(self.chain if chain else []), (gap, rest)]
        if u < SLOW and pull > 0:
            self.close(gap)
            return None
        return 2 * u / pull * mpf("1.3") if pull > 0 else mpf("0.02")

    def close(self, gap: int) -> None:
        """Jump to the Zeno point: the powers of e are removed from times and states."""
        rows = [row for _, row in self.chain[-COLUMNS - 1 :]]
        power = mpf(1)
        while len(rows) > 1:
            power *= self.e[gap]
            rows = [
                [(b - power * a) / (1 - power) for a, b in zip(one, two, strict=True)]
                for one, two in itertools.pairwise(rows)
            ]
        self.t, self.y = rows[0][0], rows[0][1:]
        self.closed, self.chain = (*self.closed, gap), []
        self.zeno.append(self.t)


def add(y: list[Any], slope: list[Any], h: Any) -> list[Any]:
    return [a + h * b for a, b in zip(y, slope, strict=True)]


def lu_solve_many(mass: Any, right: Any) -> Any:
    columns = [mp.lu_solve(mass, right[:, j]) for j in range(right.cols)]
    return mp.matrix([[columns[j][i] for j in range(right.cols)] for i in range(right.rows)])


mp.lu_solve_many = lu_solve_many


def quantities(system: System, case: dict[str, Any], name: str, h: Any) -> list[Any]:
    """Give the state at the end, the Zeno times, the lift-off times, with one number moved."""
    number = {key: [mpf(v) for v in case[key]] for key in ("e", "q0", "qdot0")}
    p = {key: mpf(v) for key, v in case["parameters"].items()}
    if name in p:
        p[name] += h
    elif name:
        key, _, i = name.partition("[")
        number[key][int(i[:-1])] += h
    run = Run(system, number["e"], list(p.values()), number["q0"], number["qdot0"])
    run.go(mpf(case["t"]))
    return [*run.y, *run.zeno, *run.lift]


def derivatives(case: dict[str, Any], say: Callable[[str], object] = print) -> dict[str, Any]:
    system = System(case)
    n = system.n
    names = [f"{key}[{i}]" for key in ("q0", "qdot0") for i in range(n)]
    names += [f"e[{i}]" for i in range(len(case["e"]))] + case["by"]
    values = quantities(system, case, "", mpf(0))
    say(f"values {[mpmath.nstr(v, 12) for v in values]}")
    found = {}
    for name in names:
        one = [quantities(system, case, name, k * STEP) for k in (-1, 1)]
        rows = zip(*one, strict=True)
        found[name] = [mpmath.nstr((b - a) / (2 * STEP), 17) for a, b in rows]
        say(f"{name} {found[name]}")
    told = [mpmath.nstr(value, 17) for value in values]
    return case | {"values": told, "derivatives": found}


if __name__ == "__main__":
    chosen = sys.argv[2:] or list(CASES)
    data = {name: derivatives(CASES[name]) for name in chosen}
    with open(sys.argv[1], "w", encoding="ascii") as file:
        json.dump(data, file, indent=1)
        file.write("\n")
