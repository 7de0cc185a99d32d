"""How many starts of the published problems every method solves."""

from __future__ import annotations

import dataclasses
import statistics
import sys
from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeAlias

import numpy as np

import zivi
from vi_peer import TESTS, Peer

sys.path.insert(0, str(TESTS))
from mcp import PROBLEMS, Problem

SOLVABLE = [problem for problem in PROBLEMS if problem.solvable]
UNSOLVABLE = [problem for problem in PROBLEMS if not problem.solvable]
SEED = 0

_ONE_STAGE = {
    "smoothing": False,
    "semismooth": False,
    "proximal": False,
    "restarts": 0,
    "enumerate_up_to": 0,
}
FULL = "full"
METHODS = {
    FULL: zivi.VIOptions(),
    "without S0 (Josephy-Newton)": zivi.VIOptions(josephy_newton=False),
    "without SM (smoothing Newton)": zivi.VIOptions(smoothing=False),
    "without S1 (semismooth Newton)": zivi.VIOptions(semismooth=False),
    "without S2 (proximal, ray start)": zivi.VIOptions(proximal=False),
    "without restarts": zivi.VIOptions(restarts=0),
    "without enumeration": zivi.VIOptions(enumerate_up_to=0),
    "without restarts and enumeration": zivi.VIOptions(restarts=0, enumerate_up_to=0),
    "without semismooth and gradient steps": zivi.VIOptions(descent_steps=False),
    "monotone search": zivi.VIOptions(memory=1),
    "ray start first": zivi.VIOptions(ray_start_first=True),
    "without the active set": zivi.VIOptions(active_set=False),
    "S0 only": zivi.VIOptions(**_ONE_STAGE),
    "S0 only, monotone search": zivi.VIOptions(**_ONE_STAGE, memory=1),
    "S0 only, ray start first": zivi.VIOptions(**_ONE_STAGE, ray_start_first=True),
    "S0 only, undamped": zivi.VIOptions(**_ONE_STAGE, line_search=False, descent_steps=False),
    "S1 only": zivi.VIOptions(**_ONE_STAGE | {"semismooth": True}, josephy_newton=False),
}
PEERS = ("VI_BOX_AVI_LSA", "VI_BOX_QI", "MCP_NEWTON_FB_FBLSA")

Start: TypeAlias = tuple[Problem, np.ndarray]
Solver: TypeAlias = Callable[[Problem, np.ndarray], "End | None"]


@dataclasses.dataclass(frozen=True)
class End:
    """How one solve ended."""

    residual: float
    """Recomputed at the returned point."""
    claimed: bool
    pivots: int = 0


@dataclasses.dataclass(frozen=True)
class Count:
    """How the starts of one set ended, of those that can be posed to the solver at all."""

    ends: dict[tuple[str, int], End]

    def solved(self, tolerance: float) -> int:
        """Count the residuals within the tolerance."""
        return sum(end.residual <= tolerance for end in self.ends.values())

    def unsolved(self, tolerance: float) -> dict[str, int]:
        """Return the problems with starts that were not solved, and how many."""
        names = [name for (name, _), end in self.ends.items() if end.residual > tolerance]
        return {name: names.count(name) for name in dict.fromkeys(names)}

    @property
    def false_claims(self) -> int:
        """Count what was called solved with a residual above 1e-7."""
        return sum(end.claimed and end.residual > 1e-7 for end in self.ends.values())

    @property
    def pivots(self) -> tuple[float, int]:
        """Median and maximum."""
        pivots = [end.pivots for end in self.ends.values()]
        return statistics.median(pivots), max(pivots)


def listed(problems: Iterable[Problem] = SOLVABLE) -> list[Start]:
    """Return the published starts."""
    return [(problem, start) for problem in problems for start in problem.starts]


def random(per_problem: int) -> list[Start]:
    """Return starts at distances from 0.1 to 100 of the published ones (as in the tests)."""
    generator = np.random.default_rng(SEED)
    starts = []
    for problem in SOLVABLE:
        for _ in range(per_problem):
            near = problem.starts[generator.integers(len(problem.starts))]
            spread = 10 ** generator.uniform(-1, 2)
            starts.append((problem, near + spread * generator.uniform(-1, 1, problem.n)))
    return starts


def residual(problem: Problem, x: np.ndarray) -> float:
    """Return the natural residual, infinite where it is undefined."""
    value = problem.residual(x)
    return np.inf if np.isnan(value) else value


def own(options: zivi.VIOptions, problem: Problem, start: np.ndarray) -> End:
    """Solve with zivi."""
    result = zivi.solve_vi(
        problem.F, problem.lower, problem.upper, start, jac=problem.jac, options=options
    )
    return End(residual(problem, result.x), result.success, result.n_pivots)


def theirs(peer: Peer, solver: str, problem: Problem, start: np.ndarray) -> End | None:
    """Solve with Siconos; None where the problem cannot be posed to the solver."""
    if solver.startswith("MCP") and np.any(np.isfinite(problem.upper)):
        return None
    answer = peer.ask(solver, problem.name, start)
    if answer is None:
        return End(np.inf, False)
    return End(residual(problem, np.array(answer["x"])), answer["info"] == 0)


def count(solve: Solver, starts: list[Start]) -> Count:
    """Solve from all starts."""
    ends = {}
    with np.errstate(all="ignore"):
        for k, (problem, start) in enumerate(starts):
            end = solve(problem, start)
            if end is not None:
                ends[problem.name, k] = end
    return Count(ends)


def solvers(peer: Peer | None) -> dict[str, Solver]:
    """Return all methods by name."""
    methods: dict[str, Solver] = {
        f"zivi, {name}": partial(own, options) for name, options in METHODS.items()
    }
    if peer is not None:
        methods |= {f"Siconos {name}": partial(theirs, peer, name) for name in PEERS}
    return methods
