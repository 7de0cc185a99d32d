"""Derivatives of random runs with dry friction against differences of runs.

    python tests/friction_derivatives.py --runs 300 --seed 1        --only 17 shows one of them

Runs of general systems are drawn in skewed coordinates. The columns by the initial state, the
start, restitutions, numbers of friction and of the system are summed along a random direction; runs
that are moved along it are differenced, with Richardson's extrapolation, as long as their events
stay in order.
"""

import argparse
import collections
import dataclasses
import math

import numpy as np

import friction_draws
import metamorphic
import zivi
from inside import friction_numbers, run_of

METHOD = zivi.SwitchedRK(rtol=1e-10, atol=1e-11)
TIGHT = zivi.SwitchedRK(rtol=1e-13, atol=1e-14)
STEPS = [3e-3 / 4**k for k in range(6)]
RESTITUTIONS = {
    "feeder": {2},
    "disc": {1, 2},
    "rod2": {1, 2},
    "rock": {3, 4},
    "corner": {2, 3},
    "servo": {9},
    "guide": {0, 3},
    "beltstop": {5},
    "stack": {3, 4},
    "arm": {2},
}
"""Numbers of families of `friction_draws` that are not moved: restitutions, kinds."""
STATIC = {
    "feeder": [6],
    "disc": [7],
    "rod2": [5],
    "rock": [7],
    "belt2": [6, 7],
    "beltstop": [3],
    "servo": [7],
    "guide": [2],
    "stack": [9, 10],
    "arm": [3, 5],
}
"""Static limits: they are made larger than those in slip."""


def drawn(kind, rng):
    """Draw a system, a span, a start and the names of its parameters."""
    if kind in ("friction", "corners"):
        model = metamorphic.FAMILIES[kind].draw(rng)
        model, _ = metamorphic.skewed(dataclasses.replace(model, law="newton"), rng)

        def build(mass, push, damping):
            parts = {"mass": mass * model.mass, "force": push * model.force}
            return dataclasses.replace(model, **parts, damping=damping * model.damping).system()

        start = model.q, model.v
        return build, {"mass": 1.0, "push": 1.0, "damping": 1.0}, model.span, start
    it = friction_draws.draw(kind, rng)
    for i in STATIC.get(kind, []):
        it.numbers[i] *= 1.1
    kept = {i for i, value in enumerate(it.numbers) if value} - RESTITUTIONS.get(kind, set())

    def build(**moved):
        numbers = list(it.numbers)
        for name, value in moved.items():
            numbers[int(name[1:])] = value
        return friction_draws.SYSTEMS[kind](numbers)

    return build, {f"p{i}": it.numbers[i] for i in sorted(kept)}, (0.0, it.end), (it.q, it.v)


def names_of(system, kind):
    """Give the names of all columns that the run has; no number has two of them."""
    found = ["q0", "qdot0", "t0"]
    found += [f"e.{name}" for name, e in zip(system.gap_names, system.e, strict=True) if 0 < e < 1]
    numbers = friction_numbers(system) if kind in ("friction", "corners") else {}
    for name, it in numbers.items():
        own, field = name.rsplit(".", 1)
        static = numbers.get(f"{own}.static", numbers.get(f"{own}.mu_static"))
        slip = numbers.get(f"{own}.limit", numbers.get(f"{own}.mu"))
        on_bound = field in ("limit", "static", "mu", "mu_static") and (
            it.value == 0.0 or (static and slip and static.value <= 1.05 * slip.value)
        )
        if not (on_bound or (field == "e_t" and not 0.0 < it.value < 1.0)):
            found.append(name)
    return found + list(system.parameters)


def order_of(sol):
    """Give what happens in a run, without times."""
    rows = [
        *((it["t"], 0, int(it["gap"]), 0) for it in sol.resolved_impacts),
        *((it["t"], 1, int(it["channel"]), int(it["after"])) for it in sol.transitions),
        *((it["t"], 2, int(it["gap"]), 0) for it in sol.liftoffs),
    ]
    return [it[1:] for it in sorted(rows)]


def difference(run, base, way, steps=STEPS):
    """Give the derivative along a direction, and by how much two extrapolations differ."""

    def end(size):
        try:
            system, span, start = run.at(base + size * way)
            sol = zivi.simulate(system, span, start, TIGHT)
        except ValueError:  # out of range, or a gap that is not open
            return [], np.zeros(1), False
        return order_of(sol), np.concatenate([sol.q[-1], sol.qdot[-1]]), sol.success

    middle, best = end(0.0)[0], None
    for h in steps:
        values, fits = [], True
        for part in (1.0, 0.5, 0.25):
            one, other = end(part * h), end(-part * h)
            fits &= one[2] and other[2] and len(one[0]) == len(other[0]) == len(middle)
            values.append((one[1] - other[1]) / (2 * part * h))
        first = [(4 * values[k + 1] - values[k]) / 3 for k in (0, 1)]
        found = (16 * first[1] - first[0]) / 15
        size = np.abs(found - first[1]).max()
        if fits and (best is None or size < best[1]):
            best = found, size
        if best is not None and best[1] <= 1e-8 * (1 + np.abs(best[0]).max()):
            break
    return best


def verdict(kind, rng, per_column=False):
    """Give the outcome of a run: its kind, its error relative to the differences."""
    build, parameters, span, start = drawn(kind, rng)
    try:
        system = zivi.ParametricSystem(build, parameters)
        names = names_of(system, kind)
        gaps = system.at(span[0], *start).gaps
        if len(gaps) and gaps.min() < 1e-9:  # a start in contact stays there
            names = names[3:]
        s = zivi.sensitivity(system, span, start, wrt=names, method=METHOD)
    except NotImplementedError as error:
        return "refused: " + str(error), 0.0, None
    except ValueError as error:
        return "no start: " + str(error)[:40], 0.0, None
    if s.status.name != "COMPLETED":
        more = "" if s.trajectory.success else " " + s.trajectory.message[:50]
        return s.status.name + more, 0.0, s
    run = run_of(system, span, start, s.wrt)
    base = np.array([column.value for column in run.columns])
    sizes = np.where(base == 0.0, 1.0, np.abs(base))
    ways = np.eye(len(base)) if per_column else rng.normal(size=(1, len(base)))
    worst = 0.0
    for way in ways * sizes:
        # a number on its bound does not move
        known = difference(run, base, way)
        if known is None:
            return "order changes", 0.0, s
        found = (s.final @ way).ravel()
        scale = np.abs(known[0]).max() + 1e-3 * math.sqrt(len(base))
        if known[1] > 1e-7 * scale:
            return "differences too coarse", 0.0, s
        error = np.abs(found - known[0]).max() / scale
        if per_column:
            print(s.wrt[int(np.argmax(way != 0))], error, found, known[0], known[1])
        worst = max(worst, error)
    return "compared", worst, s


FAMILIES = ("friction", "corners", *STATIC, "corner")


def campaign(runs, seed, families=FAMILIES, tell=lambda *it: None):
    """Give what became of random runs, and the worst error of those that were compared."""
    found, worst = collections.Counter(), 0.0
    for index in range(runs):
        kind = families[index % len(families)]
        outcome, error, s = verdict(kind, np.random.default_rng([seed, index]))
        found[outcome] += 1
        worst = max(worst, error)
        tell(index, kind, outcome, error, s)
    return found, worst


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int)
    args = parser.parse_args()
    if args.only is not None:
        kind = FAMILIES[args.only % len(FAMILIES)]
        print(*verdict(kind, np.random.default_rng([args.seed, args.only]), per_column=True))
        return

    def tell(index, kind, outcome, error, s):
        if error > 1e-6 or outcome not in ("compared",):
            print(index, kind, outcome, f"{error:.1e}", s, flush=True)

    print(*campaign(args.runs, args.seed, tell=tell))


if __name__ == "__main__":
    main()
