"""Evaluations and errors of the methods on a problem: the same in every run."""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import scipy_events
import zivi
from methods_problems import Problem

RK8, RK5, SCIPY = "SwitchedRK, order 8", "SwitchedRK, order 5", "SciPy, DOP853 with events"
EULER, MOREAU = "ThetaGamma (implicit Euler)", "MoreauJean"

JITTER = (1.0, 1.0137, 1.0311)
"""Factors of the number of fixed steps: an impact falls on another part of a step."""


@dataclasses.dataclass(frozen=True)
class Run:
    """What one run took and how far off it ended."""

    setting: float
    """Tolerance, or number of fixed steps."""
    nfev: float
    error: float


def switched(order: int, tol: float) -> zivi.SwitchedRK:
    """Give the Runge-Kutta pair with equal relative and absolute tolerance."""
    return zivi.SwitchedRK(rtol=tol, atol=tol, order=order, flights="rk")


def follow(problem: Problem, method: Any, force: Any = None, dense: bool = False) -> Any:
    """Run a problem with a method of zivi."""
    return zivi.simulate(
        problem.system(force), problem.span, problem.state, method=method, dense_output=dense
    )


def with_zivi(problem: Problem, order: int, tol: float, dense: bool = False) -> Run:
    """Count one run of `SwitchedRK`."""
    sol = follow(problem, switched(order, tol), dense=dense)
    assert sol.success, sol.message
    return Run(tol, sol.nfev, problem.error(sol.x[-1], sol.xdot[-1], sol.rest_time))


def with_scipy(problem: Problem, tol: float, dense: bool = False) -> Run:
    """Count one run of the script."""
    end = scipy_events.follow(problem, tol, dense=dense)
    return Run(tol, end.nfev, problem.error(end.x, end.xdot, end.rest))


def fixed_methods() -> dict[str, Callable[[float], Any]]:
    """Give the methods of fixed steps that there are, by the step."""
    found: dict[str, Callable[[float], Any]] = {EULER: zivi.ThetaGamma}
    if hasattr(zivi, "MoreauJean"):
        found[MOREAU] = partial(zivi.MoreauJean, theta=0.5)
    return found


def with_fixed_steps(problem: Problem, kind: Callable[[float], Any], steps: int) -> Run:
    """Run with three step sizes close together: root mean square of their errors."""
    squares, counts = [], []
    for factor in JITTER:
        sol = follow(problem, kind(problem.length / round(steps * factor)))
        squares.append(problem.error(sol.x[-1], sol.xdot[-1], sol.rest_time) ** 2)
        # a force that is known to be constant is evaluated once; every step takes its value
        counts.append(max(sol.nfev, sol.n_steps))
    return Run(steps, statistics.mean(counts), math.sqrt(statistics.mean(squares)))


def adaptive(problem: Problem, ladder: Iterable[float]) -> dict[str, list[Run]]:
    """Count the methods with error control at each tolerance."""
    return {
        RK8: [with_zivi(problem, 8, tol) for tol in ladder],
        RK5: [with_zivi(problem, 5, tol) for tol in ladder],
        SCIPY: [with_scipy(problem, tol) for tol in ladder],
    }


def adaptive_dense(problem: Problem, ladder: Iterable[float]) -> dict[str, list[Run]]:
    """Count them again with dense output on both sides."""
    return {
        RK8: [with_zivi(problem, 8, tol, dense=True) for tol in ladder],
        SCIPY: [with_scipy(problem, tol, dense=True) for tol in ladder],
    }


def fixed(problem: Problem, steps: Iterable[int]) -> dict[str, list[Run]]:
    """Count the methods of fixed steps."""
    return {
        name: [with_fixed_steps(problem, kind, n) for n in steps]
        for name, kind in fixed_methods().items()
    }


def cheapest(runs: Iterable[Run], error: float) -> float | None:
    """Give the fewest evaluations with an error no larger than `error`."""
    return min((run.nfev for run in runs if run.error <= error), default=None)


@dataclasses.dataclass(frozen=True)
class Ratios:
    """Evaluations of `SwitchedRK` to those of the script."""

    least: float
    mean: float
    """Geometric."""
    most: float

    @classmethod
    def of(cls, values: Iterable[float]) -> Ratios:
        """Summarise ratios."""
        found = list(values)
        return cls(min(found), statistics.geometric_mean(found), max(found))


def at_equal_tolerance(ours: Iterable[Run], theirs: Iterable[Run]) -> Ratios:
    """Compare run by run."""
    return Ratios.of(a.nfev / b.nfev for a, b in zip(ours, theirs, strict=True))


def at_equal_error(
    ours: Iterable[Run], theirs: Iterable[Run], errors: Iterable[float]
) -> Ratios | None:
    """Compare the cheapest runs that keep an error, for errors that both can keep."""
    ours, theirs = list(ours), list(theirs)
    pairs = [(cheapest(ours, error), cheapest(theirs, error)) for error in errors]
    found = [a / b for a, b in pairs if a is not None and b is not None]
    return Ratios.of(found) if found else None
