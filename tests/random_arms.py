"""Random planar arms that land with their tip on one plane or in a corner of two."""

import functools

import numpy as np
import sympy

import zivi
import zivi.mechanics

H = 1e-3


@functools.cache
def chain(n, m):
    """A chain of n links with masses at their ends and inertias, and m planes before its tip."""
    angles, lengths, masses = (sympy.symbols(f"{it}1:{n + 1}") for it in "qlm")
    rates = [sympy.Symbol(f"{it}dot") for it in angles]
    x = y = turn = sympy.Integer(0)
    kinetic = potential = sympy.Integer(0)
    for k in range(n):
        turn += angles[k]
        x += lengths[k] * sympy.cos(turn)
        y += lengths[k] * sympy.sin(turn)
        speeds = [
            sum(z.diff(q) * w for q, w in zip(angles, rates, strict=True)) for z in (x, y, turn)
        ]
        kinetic += masses[k] * (speeds[0] ** 2 + speeds[1] ** 2) / 2 + 0.02 * speeds[2] ** 2 / 2
        potential += 9.81 * masses[k] * y
    planes = [sympy.symbols(f"a{i} b{i} d{i}") for i in range(m)]
    numbers = [*lengths, *masses, *(it for plane in planes for it in plane)]
    return zivi.symbolic.system(
        list(map(str, angles)),
        T=kinetic,
        V=potential,
        gaps={f"plane{i}": a * x + b * y + d for i, (a, b, d) in enumerate(planes)},
        parameters=dict.fromkeys(map(str, numbers), 0.4),
        e=0.5,
        inputs={f"t{k}": np.eye(n, dtype=int)[k].tolist() for k in range(n)},
    )


def draw(seed):
    """An arm, the posture in which it touches, a start, and the source of what follows."""
    source = np.random.default_rng(seed)
    n, m = int(source.integers(2, 5)), int(source.integers(1, 3))
    while True:
        numbers = {f"l{k + 1}": source.uniform(0.2, 0.5) for k in range(n)}
        numbers |= {f"m{k + 1}": source.uniform(0.2, 1.2) for k in range(n)}
        goal = np.append(source.uniform(-1, 1), source.choice([-1, 1], n - 1))
        goal[1:] *= source.uniform(0.5, 1.6, n - 1)
        turns = np.cumsum(goal)
        length = np.array([numbers[f"l{k + 1}"] for k in range(n)])
        tip = np.array([length @ np.cos(turns), length @ np.sin(turns)])
        first = source.uniform(0, 2 * np.pi)
        for i, phi in enumerate((first, first + source.uniform(0.6, np.pi - 0.6))[:m]):
            a, b = np.cos(phi), np.sin(phi)
            numbers |= {f"a{i}": a, f"b{i}": b, f"d{i}": -a * tip[0] - b * tip[1]}
        arm = chain(n, m).replace(**numbers, e=list(source.uniform(0.2, 0.85, m)))
        start, speed = goal + source.uniform(-0.4, 0.4, n), source.uniform(-1, 1, n)
        states = [(goal, 0 * goal), (start, speed), (0.5 * (start + goal), 0 * goal)]
        split = [zivi.mechanics.gap_coordinates(arm, *it) for it in states]
        coupled = max(abs(it.c - np.eye(m)).max() for it in split)
        pliant = min(np.linalg.eigvalsh(it.N @ it.N.T)[0] for it in split)
        near = split[1].g
        if coupled < 0.7 and pliant > 0.02 and near.min() > 0.01 and near.max() < 0.25:
            return arm, goal, (start, speed), source


def land(seed, wrong=1.0, end=2.0):
    """The loop of an arm that lands, its model wrong by up to 10 % in masses, 0.03 in e, or right.

    The posture's accelerations are large: what wrong masses make of them may exceed the press.
    """
    arm, goal, start, source = draw(seed)
    believed = arm.replace(
        **{
            name: it * (1.0 + wrong * source.uniform(-0.1, 0.1))
            for name, it in arm.parameters.items()
            if name.startswith("m")
        },
        e=list(arm.e + wrong * source.uniform(-0.03, 0.03, arm.m)),
    )
    gains = dict.fromkeys(arm.gap_names, (40, 22))
    return zivi.simulate_closed_loop(
        arm,
        zivi.GapTracker(believed, h=H, gains=gains),
        (0, end),
        start,
        reference=dict.fromkeys(arm.gap_names, "rest") | {"posture": goal},
        method=zivi.RKPeriod(),
    )


def closed_since(run):
    """The time from which all gaps are closed, NaN if they are not in the end."""
    closed = run.contacts.all(axis=1)
    return float(run.t[len(closed) - np.argmin(closed[::-1])]) if closed[-1] else np.nan
