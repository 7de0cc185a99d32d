"""Random runs with friction in two directions, put back into the equations of motion.

Eight families of bodies in skewed coordinates, whose equations are matrices here: mass, stiffness,
weight, rows of contacts and of constraints. The oracle uses these and the result alone. A campaign:

    python tests/space_families.py 250            each family so many times
    python tests/space_families.py --only table 17
"""

import dataclasses
import math
import sys
from collections.abc import Callable

import numpy as np

import zivi

TOL = 1e-9
"""Relative and absolute tolerance of the runs."""
STATE = 300 * TOL
"""Of gaps, rates and energies, relative to the sizes of states: errors of a run."""
BALANCE = 1e-7
"""Of forces, relative to the sizes of their parts."""


@dataclasses.dataclass
class Model:
    """Matrices in own coordinates ``y = skew q``; a contact has rows, its normal and tangents."""

    mass: np.ndarray
    weight: np.ndarray
    stiffness: np.ndarray
    contacts: list
    mu: list
    e: float
    y: np.ndarray
    v: np.ndarray
    skew: np.ndarray
    offsets: list
    pins: Callable | None = None
    """From ``(t, y)`` to values, gradients, and ``(t, y, v)`` to the rest of ``phi''``, by row."""
    pin_count: int = 0
    is_driven: bool = False
    span: float = 4.0

    def force(self, y):
        return self.weight - self.stiffness @ y

    def energy(self, y, v):
        return 0.5 * v @ self.mass @ v + 0.5 * y @ self.stiffness @ y - self.weight @ y

    def system(self):
        s = self.skew
        gaps = []
        for rows, mu, offset in zip(self.contacts, self.mu, self.offsets, strict=True):
            friction = {} if len(rows) == 1 else {"tangent": np.squeeze(rows[1:] @ s), "mu": mu}
            gaps.append(zivi.LinearGap(rows[0] @ s, offset, **friction))
        pins = []
        for k in range(self.pin_count):
            value = lambda t, q, k=k: float(self.pins(t, s @ q, None)[0][k])  # noqa: E731
            slope = lambda t, q, k=k: self.pins(t, s @ q, None)[1][k] @ s  # noqa: E731
            more = lambda t, q, v, k=k: float(self.pins(t, s @ q, s @ v)[2][k])  # noqa: E731
            rate = lambda t, q, k=k: float(self.pins(t, s @ q, None)[3][k])  # noqa: E731
            pins.append(zivi.Equality(value, slope, curvature=more, rate=rate, name=f"pin{k}"))
        extra = {"equalities": pins} if pins else {}
        return zivi.MechanicalSystem(
            mass=s.T @ self.mass @ s,
            force=lambda t, q, v: s.T @ self.force(s @ q),
            gaps=gaps,
            e=self.e,
            **extra,
        )

    def run(self, tol=TOL):
        start = [np.linalg.solve(self.skew, it) for it in (self.y, self.v)]
        system = self.system()
        if self.pin_count:
            start = zivi.consistent(system, *start)
        return zivi.simulate(system, (0, self.span), start, zivi.SwitchedRK(rtol=tol, atol=tol))


# Families.


def skewed(rng, n):
    """Draw coordinates that are neither orthogonal nor of one scale."""
    turned = np.linalg.qr(rng.normal(size=(n, n)))[0]
    return (
        turned * rng.uniform(0.5, 2, n) @ (np.eye(n) + np.tril(rng.uniform(-0.4, 0.4, (n, n)), -1))
    )


def spd(rng, n, least):
    root = rng.normal(size=(n, n))
    return root @ root.T / n + least * np.eye(n)


def foot(a, b, tangents=2):
    rows = [[0, 0, 1, b, -a, 0], [1, 0, 0, 0, 0, -b], [0, 1, 0, 0, 0, a]]
    return np.array(rows[: 1 + tangents], dtype=float)


def plate(rng, places, tangents=None, **more):
    """Draw a plate on springs above a floor: its place, two small tilts, and its turn."""
    count = len(places)
    tangents = tangents or [2] * count
    mass = np.diag([1.0, 1, 1, *rng.uniform(0.3, 0.8, 3)])
    stiffness = np.diag([*rng.uniform(0, 0.8, 2), 0, 0, 0, rng.uniform(0, 0.8)])
    start = np.array([*rng.normal(size=2), 0, 0, 0, rng.normal()])
    settings = {
        "weight": np.array([0.0, 0, -1, 0, 0, 0]),
        "mu": rng.uniform(0.15, 0.5, count).tolist(),
        "e": 0.0,
        "y": start,
        "v": np.array([*rng.normal(size=2), 0, 0, 0, rng.normal()]),
    }
    contacts = [foot(*it, k) for it, k in zip(places, tangents, strict=True)]
    return Model(
        mass, stiffness=stiffness, contacts=contacts, skew=skewed(rng, 6), offsets=[0.0] * count,
        **(settings | more),
    )  # fmt: skip


def around(rng, count):
    angles = 2 * np.pi * (np.arange(count) + rng.uniform(-0.25, 0.25, count)) / count
    return [(r * np.cos(a), r * np.sin(a)) for r, a in zip(rng.uniform(0.7, 1.3, count), angles)]  # noqa: B905


def ball(rng):
    """Draw a ball that is thrown on a slope with spin."""
    m, r, slope = rng.uniform(0.5, 2), rng.uniform(0.1, 0.4), rng.uniform(0, 0.3)
    rows = np.zeros((3, 6))
    rows[0, 2] = rows[1, 0] = rows[2, 1] = 1
    rows[1, 4], rows[2, 3] = -r, r
    weight = 9.81 * m * np.array([np.sin(slope), 0, -np.cos(slope), 0, 0, 0])
    return Model(
        np.diag([m] * 3 + [0.4 * m * r * r] * 3), weight, np.zeros((6, 6)), [rows],
        [rng.uniform(0.05, 0.6)], rng.uniform(0.2, 0.75),
        np.array([0, 0, rng.uniform(0.05, 0.5), 0, 0, 0]),
        np.array([*rng.normal(size=2) * 2, 0, *rng.normal(size=3) * 8]), skewed(rng, 6), [0.0],
    )  # fmt: skip


def coupled(rng):
    """Draw a body whose normal and tangents are coupled by a full mass matrix."""
    mass, v = spd(rng, 3, 0.4), rng.normal(size=3)
    stiffness = np.diag([*rng.uniform(0.3, 1, 2), 0.0])
    return Model(
        mass, np.array([0, 0, -2.0]), stiffness, [np.eye(3)[[2, 0, 1]]], [rng.uniform(0.05, 0.4)],
        rng.uniform(0, 0.5), np.array([*rng.normal(size=2), 0.2]), v, skewed(rng, 3), [0.0],
    )  # fmt: skip


def tripod(rng):
    return plate(rng, around(rng, 3))


def table(rng):
    """Draw a table with four feet, or five, that is dropped."""
    height, tilt = rng.uniform(0.02, 0.3), rng.uniform(-0.1, 0.1, 2) * rng.integers(0, 2)
    model = plate(rng, around(rng, rng.integers(4, 6)), e=float(rng.choice([0.0, 0.3])))
    model.y[2:5] = [height, *(height * tilt)]
    return model


def mixed(rng):
    """Draw feet with two tangents, with one and with none."""
    return plate(rng, around(rng, 3), tangents=rng.permutation([2, 1, 0]).tolist())


def held(rng):
    """Draw a tripod whose place and turn a row relates."""
    row = np.array([*rng.normal(size=2), 0, 0, 0, rng.normal()])
    model = plate(rng, around(rng, 3))
    model.pins = lambda t, y, v: ([row @ y], [row], [0.0], [0.0])
    model.pin_count = 1
    for it in (model.y, model.v):
        it -= row * (row @ it) / (row @ row)
    return model


def driven(rng):
    """Draw a tripod, a point of which is moved."""
    row, a, omega = np.eye(6)[0] + 0.3 * np.eye(6)[5], rng.uniform(0.1, 0.5), rng.uniform(1, 4)
    model = plate(rng, around(rng, 3), is_driven=True)

    def pins(t, y, v):
        s, c = np.sin(omega * t), np.cos(omega * t)
        return [row @ y - a * s], [row], [a * omega**2 * s], [-a * omega * c]

    model.pins, model.pin_count = pins, 1
    model.y -= row * (row @ model.y) / (row @ row)
    model.v -= row * (row @ model.v - a * omega) / (row @ row)
    return model


def pendulum(rng):
    """Draw a mass on a rod about a ball joint, which swings above a floor."""
    length, turn = rng.uniform(0.8, 1.5), rng.uniform(0, 2 * np.pi)
    polar = rng.uniform(1.0, 1.5)
    y = length * np.array(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), -np.cos(polar)]
    )
    v = np.cross(rng.normal(size=3), y)
    floor = max(length * rng.uniform(0.4, 0.9), 1e-2 - y[2])  # not above the start
    model = Model(
        np.eye(3) * rng.uniform(0.5, 2), np.array([0, 0, -9.81]), np.zeros((3, 3)),
        [np.eye(3)[[2, 0, 1]]], [rng.uniform(0.05, 0.4)], rng.uniform(0, 0.6), y, v,
        skewed(rng, 3), [floor], span=3.0,
    )  # fmt: skip

    def pins(t, y, v):
        rest = 0.0 if v is None else 2 * v @ v
        return [y @ y - length**2], [2 * y], [rest], [0.0]

    model.pins, model.pin_count = pins, 1
    return model


FAMILIES = {it.__name__: it for it in (ball, coupled, tripod, table, mixed, held, driven, pendulum)}


def drawn(family, seed):
    """Draw a model."""
    return FAMILIES[family](np.random.default_rng([41, list(FAMILIES).index(family), seed]))


# The oracle.


def violations(model, sol, seed=0, count=40):
    """Return what a run violates: texts with times and sizes."""
    found = []
    rng = np.random.default_rng(seed)
    s = model.skew
    lists = (
        sol.resolved_impacts,
        sol.zeno,
        sol.liftoffs,
        sol.openings,
        sol.transitions,
        sol.corners,
    )
    events = np.concatenate([[0.0, sol.t[-1]], *(it["t"] for it in lists)])
    times = np.sort(rng.uniform(0, sol.t[-1], count))
    times = times[np.abs(times[:, None] - events).min(axis=1) > 1e-3]
    at = sol.resample(times)
    speed = 1 + np.abs(sol.qdot @ s.T).max() + np.abs(sol.q @ s.T).max()
    step = 2e-5
    for k, t in enumerate(at.t):
        y, v = s @ at.q[k], s @ at.qdot[k]
        parts = [model.force(y)]
        fault = lambda what, size, t=t: found.append(f"t = {t:.6g}: {what} ({size:.3g})")  # noqa: E731
        for i, (rows, mu, offset) in enumerate(
            zip(model.contacts, model.mu, model.offsets, strict=True)
        ):
            first = sum(len(it) - 1 for it in model.contacts[:i])
            load, pull = at.reactions[k, i], at.friction_forces[k, first : first + len(rows) - 1]
            parts += [load * rows[0], *(pull[:, None] * rows[1:])]
            gap, slip = rows[0] @ y + offset, rows[1:] @ v
            friction(fault, (load, pull, mu), (gap, slip), speed)
        if model.pin_count:
            _, slopes, *_ = model.pins(t, y, v)
            parts += [
                force * slope for force, slope in zip(at.constraint_forces[k], slopes, strict=True)
            ]
        a = np.linalg.solve(model.mass, sum(parts))
        size = np.abs(np.array(parts)).max() + 1
        for i, rows in enumerate(model.contacts):
            first = sum(len(it) - 1 for it in model.contacts[:i])
            if at.reactions[k, i] > 0 and abs(rows[0] @ a) > BALANCE * size:
                fault(f"g'' of closed gap {i}", rows[0] @ a)
            sticks = at.reactions[k, i] > 0 and not at.slips[k, first : first + len(rows) - 1].any()
            if sticks and np.abs(rows[1:] @ a).max(initial=0) > BALANCE * size:
                fault(f"w' of sticking contact {i}", np.abs(rows[1:] @ a).max())
        if model.pin_count:
            values, slopes, rest, rates = model.pins(t, y, v)
            for value, slope, more, rate in zip(values, slopes, rest, rates, strict=True):
                if abs(value) > STATE * speed or abs(slope @ v + rate) > STATE * speed:
                    fault("the constraint is open", max(abs(value), abs(slope @ v + rate)))
                if abs(slope @ a + more) > BALANCE * size:
                    fault("phi''", slope @ a + more)
        before, after = (s @ np.array(sol(t + d)[1]) for d in (-step, step))
        off = np.abs((after - before) / (2 * step) - a).max()
        if off > 1e-3 * size + 2e-4 * speed:
            fault("q'' of the dense output", off)
    if not model.is_driven:
        found += losses(model, sol, speed)
    return found


def friction(fault, forces, state, speed):
    """Signorini's and Coulomb's laws at a contact."""
    (load, pull, mu), (gap, slip) = forces, state
    if load < 0:
        fault("a reaction pulls", load)
    if gap < -STATE * speed or (load > 0 and gap > STATE * speed):
        fault("a gap", gap)
    if math.hypot(*pull) > mu * load * (1 + 1e-9) + 1e-12:
        fault("friction beyond its limit", math.hypot(*pull) - mu * load)
    rate = math.hypot(*slip)
    if load > 0 and rate > 1e-4:
        off = np.abs(pull + mu * load * slip / rate).max()
        if off > 1e-4 * mu * load:
            fault("friction is not opposite to the slip", off)


def losses(model, sol, speed):
    """The energy is what friction and impacts leave; of extrapolated impacts by their ratio."""
    s, rows = model.skew, sol.resolved_impacts
    energy = [model.energy(s @ q, s @ v) for q, v in zip(sol.q, sol.qdot, strict=True)]
    lost = -rows["impulse"] * (rows["speed_before"] + rows["speed_after"]) / 2
    start = model.energy(model.y, model.v)
    if model.pin_count:
        # projected onto the rows
        start = energy[0]
    left = start - energy[-1] - sol.dissipated[-1] - lost.sum()
    ahead = 0.0
    if model.e:
        for end in sol.zeno:
            last = lost[(rows["gap"] == end["gap"]) & (rows["t"] < end["t"])]
            ahead += 2 * (last[-1] if len(last) else 0) * model.e**2 / (1 - model.e**2)
    allowed = STATE * (1 + np.abs(energy).max())
    if not -allowed <= left <= ahead + allowed:
        return [f"energy: {left:.3g} is left, {ahead:.3g} by extrapolated impacts"]
    return []


def judged(family, seed):
    """Run a model: its status and what it violates."""
    model = drawn(family, seed)
    sol = model.run()
    return sol.status.name, violations(model, sol, seed)


def campaign(count, families=FAMILIES, first=0):
    """Print, by family, how many runs were complete, and all that violate something."""
    for family in families:
        ends, wrong = {}, 0
        for seed in range(first, first + count):
            status, found = judged(family, seed)
            ends[status] = ends.get(status, 0) + 1
            if found or status != "COMPLETED":
                wrong += bool(found)
                print(f"{family} {seed}: {status}", *found[:3], sep="\n    ", flush=True)
        print(f"{family}: {ends}, {wrong} with violations", flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "--only":
        print(*judged(sys.argv[2], int(sys.argv[3])), sep="\n")
    else:
        campaign(int(sys.argv[1]), sys.argv[2].split(",") if len(sys.argv) > 2 else FAMILIES)
