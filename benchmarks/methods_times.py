"""Times of the methods, next to each other in one run.

Processor time: on an idle machine that is what the clock on the wall shows, and on a shared one it
leaves out what others took. Runs of zivi are so short that a round's figure is the median of many.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, TypeAlias, TypeVar

import scipy_events
import zivi
from methods_counts import RK5, RK8, SCIPY, fixed_methods, follow, switched
from methods_problems import Problem

COMPILED, PYTHON = "compiled force", "Python force"
COST_TOL = 1e-8
BATCH = {COMPILED: 15, PYTHON: 7}
"""Runs of zivi in a round."""

Run: TypeAlias = Callable[[], Any]
Key = TypeVar("Key")


@dataclasses.dataclass(frozen=True)
class Beside:
    """Times at one tolerance."""

    tol: float
    seconds: dict[tuple[str, str], float]
    """By method and kind of force."""
    faster: dict[str, float]
    """How many times less time `SwitchedRK` of order 8 takes than the script, by kind of force."""


@dataclasses.dataclass(frozen=True)
class Cost:
    """What a run of a problem costs."""

    steps: int
    """Steps tried: taken, given up, and those repeated onto an impact."""
    nfev: int
    seconds: dict[bool, float]
    """Without and with dense output."""


def _median_time(run: Run, times: int) -> float:
    taken = []
    for _ in range(times):
        start = time.process_time()
        result = run()
        taken.append(time.process_time() - start)
        del result
    return statistics.median(taken)


def interleaved(runs: Mapping[Key, tuple[Run, int]], rounds: int) -> dict[Key, list[float]]:
    """Time all runs in turn, round after round, each so many times in a round (s)."""
    for run, _ in runs.values():
        run()
    found: dict[Key, list[float]] = {key: [] for key in runs}
    for _ in range(rounds):
        for key, (run, times) in runs.items():
            found[key].append(_median_time(run, times))
    return found


def _ours(problem: Problem, tol: float) -> dict[tuple[str, str], tuple[Run, int]]:
    forces = {COMPILED: problem.force, PYTHON: problem.python_force()}
    return {
        (name, kind): (partial(follow, problem, switched(order, tol), force), BATCH[kind])
        for name, order in ((RK8, 8), (RK5, 5))
        for kind, force in forces.items()
    }


def _theirs(problem: Problem, tol: float) -> dict[tuple[str, str], tuple[Run, int]]:
    fields = {
        PYTHON: scipy_events.field(problem),
        COMPILED: scipy_events.compiled_field(problem),
    }
    return {
        (SCIPY, kind): (partial(scipy_events.follow, problem, tol, rhs), 1)
        for kind, rhs in fields.items()
        if rhs is not None
    }


def _faster(times: dict[tuple[str, str], list[float]], kind: str) -> float:
    # where SciPy has no compiled force, or none that helps it, its Python one stands
    theirs = [times[key] for key in times if key[0] == SCIPY and key[1] in (kind, PYTHON)]
    best = min(theirs, key=statistics.median)
    return statistics.median(b / a for a, b in zip(times[RK8, kind], best, strict=True))


def beside_scipy(problem: Problem, tolerances: Iterable[float], rounds: int) -> list[Beside]:
    """Time `SwitchedRK` and the script in turn."""
    found = []
    for tol in tolerances:
        times = interleaved(_ours(problem, tol) | _theirs(problem, tol), rounds)
        medians = {key: statistics.median(values) for key, values in times.items()}
        faster = {kind: _faster(times, kind) for kind in (COMPILED, PYTHON)}
        found.append(Beside(tol, medians, faster))
    return found


def fixed_steps(problem: Problem, counts: Iterable[int], rounds: int) -> dict[str, list[float]]:
    """Time the methods of fixed steps, compiled force (s)."""
    found: dict[str, list[float]] = {name: [] for name in fixed_methods()}
    for steps in counts:
        h = problem.length / steps
        runs = {
            name: (partial(follow, problem, kind(h)), 1) for name, kind in fixed_methods().items()
        }
        for name, values in interleaved(runs, rounds).items():
            found[name].append(statistics.median(values))
    return found


def costs(posed: dict[str, Problem], rounds: int) -> dict[tuple[str, int], Cost]:
    """Time runs without and with dense output, compiled force."""
    found = {}
    for key, problem in posed.items():
        for order in (8, 5):
            run = partial(follow, problem, switched(order, COST_TOL), None)
            runs = {dense: (partial(run, dense), BATCH[COMPILED]) for dense in (False, True)}
            times = interleaved(runs, rounds)
            sol = run(False)
            found[key, order] = Cost(
                steps=sol.n_steps + sol.n_rejected + len(sol.impacts),
                nfev=sol.nfev,
                seconds={dense: statistics.median(values) for dense, values in times.items()},
            )
    return found


def _sampled(force: Any, periods: int) -> zivi.ClosedLoop:
    regulator = zivi.TwistingRegulator(3.0, 2.0, h=1e-3, kappa=0.5, bound=0.9)
    system = zivi.ImpactSystem(force, kappa=0.5)
    return zivi.simulate_closed_loop(system, regulator, (0.0, periods * 1e-3), (1.0, 0.0))


def other_costs(posed: dict[str, Problem], rounds: int) -> dict[str, float]:
    """Time other things (s): the call itself, fixed steps, sampled driving."""
    ball, orbit = posed["B1"], posed["O4"]
    steps, periods = 100_000, 10_000
    short = dataclasses.replace(ball, span=(0.0, 1e-3))
    wave = zivi.LinearForce(amplitude=0.5, omega=3.0)
    runs: dict[str, tuple[Run, int]] = {
        "a run of one step, SwitchedRK: the calls of ImpactSystem and simulate": (
            partial(follow, short, switched(8, 1e-8)),
            50,
        )
    }
    pieces = {}
    for problem in (ball, orbit):
        for name, kind in fixed_methods().items():
            what = f"a step of {name}, {problem.title}"
            runs[what] = (partial(follow, problem, kind(problem.length / steps)), 1)
            pieces[what] = steps
    for title, force in {
        "constant force (exact motion)": 0.0,
        "force of time (SwitchedRK)": wave,
    }.items():
        what = f"a period of sampled control, {title}"
        runs[what] = (partial(_sampled, force, periods), 1)
        pieces[what] = periods
    times = interleaved(runs, rounds)
    return {name: statistics.median(values) / pieces.get(name, 1) for name, values in times.items()}
