"""Section V.A of the paper measured: how often linearisations of the step's VI fail.

*Outer* linearisation solves affine VIs one after another, each linearised at the solution of the
last, without a merit function; *inner* linearisation leaves the nonlinear VI to a solver that
linearises inside and searches along a merit function. The paper advises against the outer one,
which in its experiments often found no solution. A step counts as solved when its recomputed
residual is at most `TOLERANCE`.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from rich.console import Group
from rich.table import Table

from zivi.paper import ball, report, tracker

TOLERANCE = 1e-9


@dataclasses.dataclass(frozen=True)
class Rate:
    """Failures of one solver on one set of steps.

    Parameters
    ----------
    problem : {"ball", "tracking"}
        Whose steps.
    solver : str
        Which solver.
    steps : str
        Which steps.
    failed, total : int
        How many of them were not solved.
    """

    problem: str
    solver: str
    steps: str
    failed: int
    total: int

    @property
    def percent(self) -> float:
        """Failures in percent."""
        return 100.0 * self.failed / self.total


CAPTIONS = {
    "ball": "Outer n: at most n affine VIs; inner only: one solver, inner: with its fall-backs. "
    "Each solve starts from the signs of its state. "
    "AVI LSA and QI: VI_BOX_AVI_LSA and VI_BOX_QI of Siconos.",
    "tracking": "The same for the six signs of the tracker; tick: its own solution. "
    "Steps of the paper's loop on either branch, started from the signs of the last tick, from "
    "those of the state, or from the solver's own last result; random ones from those of the "
    "state.",
}


def measure_failures() -> list[Rate]:
    """Measure zivi's solvers and, where a Python with Siconos is found, those of Siconos."""
    rates = []
    for steps in (*ball.ball_step_sets(), *tracker.loop_step_sets()):
        for name, solve in steps.solvers.items():
            found = steps.residual(steps.states, solve(steps.states, steps.starts))
            failed = int(np.sum(found > TOLERANCE))
            rates.append(Rate(steps.problem, name, steps.label, failed, len(found)))
    return rates


def failure_tables(rates: Iterable[Rate]) -> Group:
    """Tabulate the failures in percent: a table per problem with solvers in columns."""
    rates = list(rates)
    problems = dict.fromkeys(rate.problem for rate in rates)
    each = ([rate for rate in rates if rate.problem == problem] for problem in problems)
    return Group(*map(_failure_table, each))


def _failure_table(rates: list[Rate]) -> Table:
    problem = rates[0].problem
    solvers = list(dict.fromkeys(rate.solver for rate in rates))
    title = f"Section V.A, {problem}: steps not solved, in percent"
    result = report.empty(title, CAPTIONS[problem])
    result.add_column("steps", no_wrap=True)
    for solver in solvers:
        heading = solver.removeprefix("Siconos VI_BOX_").replace("_", " ").replace(" ", "\n")
        result.add_column(heading, justify="right", no_wrap=True)
    for steps in dict.fromkeys(rate.steps for rate in rates):
        cells = {rate.solver: _percent_text(rate.percent) for rate in rates if rate.steps == steps}
        result.add_row(steps.removeprefix("tracking, "), *(cells[it] for it in solvers))
    return result


def _percent_text(percent: float) -> str:
    return f"{percent:.3g}" if percent >= 1.0 else f"{round(percent, 2):g}"


def save_rates(rates: Iterable[Rate], path: Path) -> None:
    """Write the rates as CSV."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("problem", "solver", "steps", "failed", "total", "percent"))
        for rate in rates:
            rows.writerow((*dataclasses.astuple(rate), f"{rate.percent:.4g}"))
