"""Systems with dry friction by their numbers, for any arithmetic, and as systems of the library.

A system's function of (t, q, qdot) gives M (its diagonal, or rows), F, the gradients N, the gaps g,
g_t, the numbers h; the tangents B, beta, the numbers k; the limits of joints and their static ones.
"""

import dataclasses
import functools
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import zivi

REFERENCES = json.loads((Path(__file__).parent / "data" / "friction_references.json").read_text())
CASES = {case["name"]: case for case in REFERENCES["cases"]}


@dataclasses.dataclass
class Problem:
    """n coordinates, m gaps, p channels; ``gap_of`` is -1 for a joint."""

    n: int
    m: int
    p: int
    gap_of: list[int]
    mu: list[Any]
    e: list[Any]
    e_t: list[Any]
    numbers: Callable[..., Any]
    mu_static: list[Any]


@dataclasses.dataclass
class Arithmetic:
    """Numbers of a kind, read from strings, and their functions."""

    real: Callable[[Any], Any] = float
    sin: Callable[[Any], Any] = math.sin
    cos: Callable[[Any], Any] = math.cos
    sqrt: Callable[[Any], Any] = math.sqrt


class Families:
    """The families of the references."""

    def __init__(self, numbers: Arithmetic | None = None):
        self.a = numbers or Arithmetic()
        self.zero, self.one, self.g = self.a.real(0), self.a.real(1), self.a.real("9.81")

    def problem(self, n, gap_of, mu, e, e_t, numbers, static=None):
        read = [[self.a.real(x) for x in row] for row in (mu, e, e_t, static or mu)]
        mu, e, e_t, static = read
        return Problem(n, len(e), len(gap_of), gap_of, mu, e, e_t, numbers, static)

    def of(self, *given):
        return [self.a.real(x) for x in given]

    def incline(self, al, mu, e, mus=None, et=0, m=2):
        (al,), one, z = self.of(al), self.one, self.zero
        mass = self.of(m, m)
        force = [mass[0] * self.g * self.a.sin(al), -mass[0] * self.g * self.a.cos(al)]

        def numbers(t, q, w):
            gap = [[z, one]], [q[1]], [z], [z]
            return mass, force, *gap, [[one, z]], [z], [z], [z], [z]

        return self.problem(2, [0], [mu], [e], [et], numbers, [mus or mu])

    def belt(self, k, c, v, Lk, Ls, gam=0, A=0, Om=1):
        k, c, v, held, static, gam, amplitude, omega = self.of(k, c, v, Lk, Ls, gam, A, Om)
        one, z = self.one, self.zero

        def numbers(t, q, w):
            force = -k * q[0] - c * w[0] + amplitude * self.a.cos(omega * t)
            limit = held / (one + gam * abs(w[0] - v))
            return [one], [force], [], [], [], [], [[one]], [-v], [z], [limit], [static]

        return self.problem(1, [-1], [0], [], [0], numbers)

    def belt2(self, k1, k2, k12, v, L1, L2, s1, s2, gam=0):
        k1, k2, k12, v, l1, l2, s1, s2, gam = self.of(k1, k2, k12, v, L1, L2, s1, s2, gam)
        one, z = self.one, self.zero

        def numbers(t, q, w):
            stretch = k12 * (q[0] - q[1])
            force = [-k1 * q[0] - stretch, -k2 * q[1] + stretch]
            limits = [it / (one + gam * abs(u - v)) for it, u in zip((l1, l2), w, strict=True)]
            rows = [[one, z], [z, one]]
            return [one, one], force, [], [], [], [], rows, [-v, -v], [z, z], limits, [s1, s2]

        return self.problem(2, [-1, -1], [0, 0], [], [0, 0], numbers)

    def beltstop(self, k, v, L, Ls, d, e, A=0, Om=1):
        k, v, held, static, d, amplitude, omega = self.of(k, v, L, Ls, d, A, Om)
        one, z = self.one, self.zero

        def numbers(t, q, w):
            force = -k * q[0] + amplitude * self.a.cos(omega * t)
            gap = [[-one]], [d - q[0]], [z], [z]
            return [one], [force], *gap, [[one]], [-v], [z], [held], [static]

        return self.problem(1, [-1], [0], [e], [0], numbers)

    def rod(self, mu, e, et=0, two=False, A=0, Om=0, l=1, m=1):  # noqa: E741
        m, length, amplitude, omega = self.of(m, l, A, Om)
        mass, one, z = [m, m, m * length * length / 3], self.one, self.zero
        ends = [-one, one] if two else [-one]
        count = len(ends)

        def numbers(t, q, w):
            s, c, o2 = self.a.sin(q[2]), self.a.cos(q[2]), w[2] * w[2]
            floor, speed = (
                amplitude * self.a.sin(omega * t),
                amplitude * omega * self.a.cos(omega * t),
            )
            gaps = (
                [[z, one, a * length * c] for a in ends],
                [q[1] + a * length * s - floor for a in ends],
                [-speed] * count,
                [-a * length * s * o2 + omega * omega * floor for a in ends],
            )
            rows = [[one, z, -a * length * s] for a in ends]
            k = [-a * length * c * o2 for a in ends]
            return mass, [z, -m * self.g, z], *gaps, rows, [z] * count, k, [z] * count, [z] * count

        return self.problem(3, list(range(count)), [mu] * count, [e] * count, [et] * count, numbers)

    def rock(self, b, h, mu, e, et=0, A=0, Om=0):
        b, h, amplitude, omega = self.of(b, h, A, Om)
        one, z = self.one, self.zero
        mass, corners = [one, one, (b * b + h * h) / 3], [(-b, -h), (b, -h)]

        def numbers(t, q, w):
            s, c, o2 = self.a.sin(q[2]), self.a.cos(q[2]), w[2] * w[2]
            arms = [(a * c - d * s, a * s + d * c) for a, d in corners]
            speed = amplitude * omega * self.a.cos(omega * t)
            push = -amplitude * omega * omega * self.a.sin(omega * t)
            gaps = (
                [[z, one, x] for x, y in arms],
                [q[1] + y for x, y in arms],
                [z] * 2,
                [-y * o2 for x, y in arms],
            )
            rows, k = [[one, z, -y] for x, y in arms], [-x * o2 - push for x, y in arms]
            return mass, [z, -self.g, z], *gaps, rows, [-speed] * 2, k, [z] * 2, [z] * 2

        return self.problem(3, [0, 1], [mu] * 2, [e] * 2, [et] * 2, numbers)

    def woodpecker(self, mu="0.3", e=("0.5", 0, 0)):
        ms, mm, js, jm, c, g, r0, rm, hm, lm, lg, hs, ls = self.of(
            *(".0045", ".0003", "7e-7", "5e-9", ".0056", "9.81", ".0025", ".0031", ".0058"),
            *(".01", ".015", ".02", ".0201"),
        )
        one, z = self.one, self.zero
        mass = [
            [ms + mm, ms * lm, ms * lg],
            [ms * lm, jm + ms * lm * lm, ms * lm * lg],
            [ms * lg, ms * lm * lg, js + ms * lg * lg],
        ]
        normals = [[z, z, -hs], [z, hm, z], [z, -hm, z]]
        rows = [[one, lm, lg - ls], [one, rm, z], [one, rm, z]]

        def numbers(t, q, w):
            twist = c * (q[1] - q[2])
            force = [-(ms + mm) * g, -twist - ms * lm * g, twist - ms * lg * g]
            gaps = [lm + lg - ls - r0 - hs * q[2], rm - r0 + hm * q[1], rm - r0 - hm * q[1]]
            none = [z] * 3
            return mass, force, normals, gaps, none, none, rows, none, none, none, none

        return self.problem(3, [0, 1, 2], [mu] * 3, e, [0] * 3, numbers)

    def disc(self, mu, e, et, r="0.1", A=0, Om=0, al=0):
        r, amplitude, omega, al = self.of(r, A, Om, al)
        one, z = self.one, self.zero
        mass = [one, one, r * r / 2]
        force = [self.g * self.a.sin(al), -self.g * self.a.cos(al), z]

        def numbers(t, q, w):
            floor, speed = (
                amplitude * self.a.sin(omega * t),
                amplitude * omega * self.a.cos(omega * t),
            )
            gap = [[z, one, z]], [q[1] - r - floor], [-speed], [omega * omega * floor]
            return mass, force, *gap, [[one, z, r]], [z], [z], [z], [z]

        return self.problem(3, [0], [mu], [e], [et], numbers)

    def feeder(self, al, mu, e, A, Om, beta, mus=None):
        al, amplitude, omega, beta = self.of(al, A, Om, beta)
        one, z = self.one, self.zero
        force = [self.g * self.a.sin(al), -self.g * self.a.cos(al)]
        cb, sb = self.a.cos(beta), self.a.sin(beta)

        def numbers(t, q, w):
            x, v = amplitude * self.a.sin(omega * t), amplitude * omega * self.a.cos(omega * t)
            push = omega * omega * x
            gap = [[z, one]], [q[1] - sb * x], [-sb * v], [sb * push]
            return [one, one], force, *gap, [[one, z]], [-cb * v], [cb * push], [z], [z]

        return self.problem(2, [0], [mu], [e], [0], numbers, [mus or mu])

    def bowl(self, mu, e, cd, kappa=1):
        cd, ka = self.of(cd, kappa)
        one, z = self.one, self.zero

        def numbers(t, q, w):
            x, v = q[0], self.a.sqrt(w[0] * w[0] + w[1] * w[1])
            force = [-cd * v * w[0], -self.g - cd * v * w[1]]
            gap = [[-ka * x, one]], [q[1] - ka * x * x / 2], [z], [-ka * w[0] * w[0]]
            return [one, one], force, *gap, [[one, ka * x]], [z], [ka * w[0] * w[1]], [z], [z]

        return self.problem(2, [0], [mu], [e], [0], numbers)


class Remembered:
    """The numbers of a problem, computed once for each state that is asked for."""

    def __init__(self, problem):
        self.problem, self.still = problem, [0.0] * problem.n
        self.at, self.known = None, None

    def __call__(self, t, q, qdot=None):
        state = t, q.tobytes(), None if qdot is None else qdot.tobytes()
        if state != self.at:
            w = self.still if qdot is None else qdot.tolist()
            self.at, self.known = state, self.problem.numbers(t, q.tolist(), w)
        return self.known


def mechanism(problem, **more):
    """Give a problem as a system of the library, every part a function."""
    at, moving = Remembered(problem), Remembered(problem)
    mass = problem.numbers(0.0, [0.1] * problem.n, [0.1] * problem.n)[0]
    mass = np.diag(mass) if np.ndim(mass) == 1 else np.array(mass)

    def part(place, i, of_speed=False):
        if of_speed:
            return lambda t, q, qdot: moving(t, q, qdot)[place][i]
        return lambda t, q: at(t, q)[place][i]

    gaps, joints = [], []
    channel_of = {gap: c for c, gap in enumerate(problem.gap_of) if gap >= 0}
    for i in range(problem.m):
        rubbing = {}
        if (c := channel_of.get(i)) is not None:
            rubbing = {
                "tangent": part(6, c),
                "tangent_velocity": part(7, c),
                "tangent_curvature": part(8, c, of_speed=True),
                "mu": problem.mu[c],
                "mu_static": problem.mu_static[c],
                "e_t": problem.e_t[c],
            }
        gap = zivi.Gap(part(3, i), part(2, i), part(5, i, of_speed=True), part(4, i), **rubbing)
        gaps.append(gap)
    for c in [c for c, gap in enumerate(problem.gap_of) if gap < 0]:
        beta = part(7, c)
        joint = zivi.DryFriction(
            part(6, c),
            limit=part(9, c, of_speed=True),
            static=part(10, c, of_speed=True),
            velocity=lambda t, q, beta=beta: -beta(t, q),
            curvature=part(8, c, of_speed=True),
        )
        joints.append(joint)
    force = lambda t, q, qdot: moving(t, q, qdot)[1]  # noqa: E731
    e = problem.e or 0.0
    return zivi.MechanicalSystem(mass=mass, force=force, gaps=gaps, e=e, friction=joints, **more)


@functools.cache
def reference(name):
    """Give the system, the span and the start of a reference."""
    case = CASES[name]
    problem = getattr(Families(), case["family"])(**case["parameters"])
    span = float(case["t0"]), float(case["T"])
    state = [np.array(case[key], dtype=float) for key in ("q0", "qdot0")]
    return mechanism(problem), span, tuple(state)
