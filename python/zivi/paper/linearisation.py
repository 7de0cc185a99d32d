"""Section V.A of the paper measured: how often linearisations of the step's VI fail.

*Outer* linearisation solves affine VIs one after another, each linearised at the solution of the
last, without a merit function; *inner* linearisation leaves the nonlinear VI to a solver that
linearises inside and searches along a merit function. The paper says that the outer one "often
fails". A step counts as solved when its residual, computed anew, is at most `TOLERANCE`.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.table import Table

from zivi import _zivi
from zivi.methods import ThetaGamma
from zivi.paper import siconos
from zivi.paper.ball import GRAVITY, KAPPA, run

__all__ = ["Rate", "measure", "save", "table"]

Array = NDArray[np.float64]

TOLERANCE = 1e-9
SPEEDS = (1.0, 1e-1, 1e-2, 1e-3, 1e-4)
STEPS = (1e-2, 1e-3, 1e-4)
PROBLEMS = 500
"""Random problems for each speed and step size."""


@dataclasses.dataclass(frozen=True)
class Rate:
    """Failures of one solver on one set of steps.

    Parameters
    ----------
    solver : str
        Which solver.
    steps : str
        Which steps.
    failed, total : int
        How many of them were not solved.
    """

    solver: str
    steps: str
    failed: int
    total: int

    @property
    def percent(self) -> float:
        """Failures in percent."""
        return 100.0 * self.failed / self.total


CAPTION = (
    "outer n: at most n affine VIs; inner only: one solver, inner: with its fall-backs. "
    "Random steps start from the signs of their state."
)

Solver = Callable[[Array, Array, float], tuple[Array, Array]]
"""Multipliers for states ``s``, ``v`` and a step size, each solve started from their signs."""


def _own(solver: str, linearisations: int = 1, fall_backs: bool = True) -> Solver:
    def solve(s: Array, v: Array, h: float) -> tuple[Array, Array]:
        lambda_s, lambda_v, _ = _zivi.solve_steps(
            s,
            v,
            np.full_like(s, -GRAVITY),
            kappa=KAPPA,
            h=h,
            solver=solver,
            linearisations=linearisations,
            fall_backs=fall_backs,
        )
        return lambda_s, lambda_v

    return solve


# "outer n": at most n linearisations; "inner only": without the fall-backs behind Josephy-Newton
OWN: dict[str, Solver] = {
    "outer 1": _own("outer", 1),
    "outer 5": _own("outer", 5),
    "outer 20": _own("outer", 20),
    "inner only": _own("newton", fall_backs=False),
    "inner": _own("newton"),
}


def residual(s: Array, v: Array, h: float, lambda_s: Array, lambda_v: Array) -> Array:
    """Relative natural residual of the implicit Euler step, written apart from the solvers.

    Rows are divided by the size of their terms; 0 where ``lambda in sgn(z+)`` holds exactly.
    """
    r = 1.0 - KAPPA * lambda_s * lambda_v
    kick = -h * lambda_s * GRAVITY / r
    v_new = v + kick
    s_new = s + h * r * v_new
    largest = h * GRAVITY / r
    scales = np.abs(s) + h * r * (np.abs(v) + largest), np.abs(v) + largest
    rows = []
    for lam, z, scale in zip((lambda_s, lambda_v), (s_new, v_new), scales, strict=True):
        rows.append(np.abs(np.maximum(lam - 1.0, np.minimum(lam + 1.0, -z / scale))))
    worst = np.maximum(*rows)
    return np.where(np.isnan(worst), np.inf, worst)


def random_states(speed: float, h: float, seed: int) -> tuple[Array, Array]:
    """States near the wall: ``|v| <= speed``, ``|s| <= h speed``, uniform."""
    random = np.random.default_rng(seed)
    v = speed * random.uniform(-1.0, 1.0, PROBLEMS)
    return h * speed * random.uniform(-1.0, 1.0, PROBLEMS), v


def ball_states(h: float) -> tuple[Array, Array]:
    """Return the states of the paper's ball up to its rest (h in s, speeds in m/s)."""
    sol = run(ThetaGamma(h))
    moving = sol.t < (sol.t[-1] if sol.rest_time is None else sol.rest_time)
    return sol.s[moving], sol.v[moving]


def measure() -> list[Rate]:
    """Measure zivi's solvers and, where a Python with Siconos is found, those of Siconos."""
    rates = []
    for name, solve in (OWN | siconos.solvers(KAPPA, GRAVITY)).items():
        for label, s, v, h in _sets():
            bad = residual(s, v, h, *solve(s, v, h)) > TOLERANCE
            rates.append(Rate(name, label, int(np.sum(bad)), len(s)))
    return rates


def _sets() -> Iterable[tuple[str, Array, Array, float]]:
    for h in STEPS[:2]:
        yield f"ball, h={h:.0e}", *ball_states(h), h
    for k, h in enumerate(STEPS):
        for j, speed in enumerate(SPEEDS):
            label = f"random, h={h:.0e}, |v|<={speed:.0e}"
            yield label, *random_states(speed, h, seed=10 * k + j), h


def table(rates: Iterable[Rate]) -> Table:
    """Lay out the failures in percent, solvers in columns."""
    rates = list(rates)
    solvers = list(dict.fromkeys(rate.solver for rate in rates))
    result = Table(
        title="Section V.A: steps not solved, in percent",
        caption=CAPTION,
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )
    result.add_column("steps", no_wrap=True)
    for solver in solvers:
        result.add_column(solver, justify="right")
    for steps in dict.fromkeys(rate.steps for rate in rates):
        cells = {rate.solver: f"{rate.percent:.2f}" for rate in rates if rate.steps == steps}
        result.add_row(steps, *(cells[solver] for solver in solvers))
    return result


def save(rates: Iterable[Rate], path: Path) -> None:
    """Write the rates as CSV."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("solver", "steps", "failed", "total", "percent"))
        for rate in rates:
            rows.writerow((*dataclasses.astuple(rate), f"{rate.percent:.4g}"))
