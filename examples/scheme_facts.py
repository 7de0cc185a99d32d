"""Measured facts about the theta-gamma family on a bouncing ball.

For each member the fitted order of convergence of the distance before and after the apex and the
first impacts, the number of runs that come to rest exactly, and what is left of the velocity after
the Zeno point. Only implicit Euler, theta = gamma = 1, always rests.

    python examples/scheme_facts.py --out facts.csv
"""

import argparse
import csv
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rich.box
from rich.console import Console
from rich.table import Table

import zivi

GRAVITY, KAPPA, START = 9.81, 0.41, (1.0, 6.0)
E = (1 - KAPPA) / (1 + KAPPA)
MEMBERS = [(theta, gamma) for theta in (0.5, 0.55, 0.75, 1.0) for gamma in (0.5, 1.0)]
TIMES = (0.5, 1.0, 1.5, 2.1, 2.4)
STEPS = (1e-2, 1e-3, 1e-4, 1e-5)
T_END, SETTLED = 4.0, 3.5
ROUNDING = 1e-10


@dataclasses.dataclass(frozen=True)
class Facts:
    """What was measured for one member of the family.

    Attributes
    ----------
    theta, gamma : float
        The member.
    errors : ndarray, shape (len(steps), len(TIMES))
        Root mean square error of the distance (m).
    orders : list of float
        Fitted order at each of `TIMES`; NaN where the error is rounding.
    at_rest : list of int
        Runs at rest exactly at the end, for each step size.
    chatter : list of float
        Largest velocity abs(v) after the Zeno point over all runs, for each step size (m/s).
    """

    theta: float
    gamma: float
    errors: np.ndarray
    orders: list[float]
    at_rest: list[int]
    chatter: list[float]


def exact_distance(t: float) -> float:
    """Distance of the ball from the wall in closed form.

    Parameters
    ----------
    t : float
        Time (s).

    Returns
    -------
    float
        Distance (m).
    """
    x0, xdot0 = START
    speed = math.sqrt(xdot0**2 + 2 * GRAVITY * x0)
    impact = (xdot0 + speed) / GRAVITY
    if t >= impact + 2 * E * speed / (GRAVITY * (1 - E)):
        return 0.0
    if t < impact:
        return x0 + xdot0 * t - GRAVITY * t**2 / 2
    speed *= E
    while t >= impact + 2 * speed / GRAVITY:
        impact += 2 * speed / GRAVITY
        speed *= E
    return speed * (t - impact) - GRAVITY * (t - impact) ** 2 / 2


def jittered(h: float, runs: int) -> np.ndarray:
    """Step sizes about `h` whose grids contain all multiples of 0.1 s.

    A single step size may happen to hit an event; the mean over several does not.

    Parameters
    ----------
    h : float
        Middle step size (s).
    runs : int
        Number of step sizes.

    Returns
    -------
    ndarray
        Step sizes (s), within a factor 1.35 of `h`.
    """
    return 0.1 / np.round(0.1 / h * 1.35 ** np.linspace(-1, 1, runs))


def measure(theta: float, gamma: float, steps: Sequence[float], runs: int) -> Facts:
    """Measure one member of the family.

    Parameters
    ----------
    theta, gamma : float
        The member.
    steps : sequence of float
        Middle step sizes (s).
    runs : int
        Runs with different step sizes about each of `steps`.

    Returns
    -------
    Facts
    """
    ball = zivi.ImpactSystem(-GRAVITY, kappa=KAPPA)
    exact = np.array([exact_distance(t) for t in TIMES])
    errors, at_rest, chatter = [], [], []
    for h in steps:
        methods = [zivi.ThetaGamma(h=step, theta=theta, gamma=gamma) for step in jittered(h, runs)]
        sols = [zivi.simulate(ball, (0, T_END), START, method=method) for method in methods]
        distances = np.array([sol(TIMES)[0] for sol in sols])
        errors.append(np.sqrt(np.mean((distances - exact) ** 2, axis=0)))
        at_rest.append(sum(sol.rest_time is not None for sol in sols))
        chatter.append(max(float(np.abs(sol.transformed.v[sol.t > SETTLED]).max()) for sol in sols))
    table = np.array(errors)
    orders = [
        float(np.polyfit(np.log(steps), np.log(column), 1)[0])
        if column.max() > ROUNDING
        else math.nan
        for column in table.T
    ]
    return Facts(theta, gamma, table, orders, at_rest, chatter)


def show(facts: Sequence[Facts], steps: Sequence[float], runs: int) -> Table:
    """Arrange the facts in a table for the terminal.

    Parameters
    ----------
    facts : sequence of Facts
        One row each.
    steps : sequence of float
        Middle step sizes (s).
    runs : int
        Runs for each of `steps`.

    Returns
    -------
    rich.table.Table
    """
    table = Table(
        title=f"theta-gamma on a ball, h = {steps[0]:g} .. {steps[-1]:g} s, {runs} runs each",
        caption="Order of convergence at the times in the heading; runs at rest for each h;\n"
        f"largest |v| after {SETTLED} s for the largest and the smallest h (m/s)",
        box=rich.box.SIMPLE_HEAD,
        padding=0,
        collapse_padding=True,
    )
    for heading in ("theta", "gamma", *(f"{t:g} s" for t in TIMES)):
        table.add_column(heading, justify="right", no_wrap=True, min_width=6)
    for heading in ("at rest", "max |v|", "max |v|"):
        table.add_column(heading, justify="right", no_wrap=True, min_width=8)
    for row in facts:
        orders = ["exact" if math.isnan(order) else f"{order:.2f}" for order in row.orders]
        rest = " ".join(map(str, row.at_rest))
        chatter = (f"{row.chatter[k]:.0e}" for k in (0, -1))
        style = "bold" if min(row.at_rest) == runs else ""
        table.add_row(f"{row.theta:g}", f"{row.gamma:g}", *orders, rest, *chatter, style=style)
    return table


def write(path: Path, facts: Sequence[Facts], steps: Sequence[float]) -> None:
    """Write the facts as CSV, one line for each member and step size.

    Parameters
    ----------
    path : Path
        Where to write.
    facts : sequence of Facts
        The members.
    steps : sequence of float
        Middle step sizes (s).
    """
    names = [f"error at {t:g} s (m)" for t in TIMES] + [f"order at {t:g} s" for t in TIMES]
    with path.open("w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(["theta", "gamma", "h (s)", *names, "runs at rest", "max |v| (m/s)"])
        for row in facts:
            for k, h in enumerate(steps):
                numbers = (*row.errors[k], *row.orders, row.at_rest[k], row.chatter[k])
                lines.writerow([row.theta, row.gamma, h, *numbers])


def main(arguments: Sequence[str] | None = None) -> list[Facts]:
    """Measure all members, print the table and write it if asked.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command line, by default the program's own.

    Returns
    -------
    list of Facts
    """
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, help="also write the numbers as CSV")
    parser.add_argument("--runs", type=int, default=7, help="step sizes about each h (default 7)")
    parser.add_argument(
        "--levels", type=int, default=len(STEPS), help="how many of h = 1e-2 .. 1e-5 (default all)"
    )
    options = parser.parse_args(arguments)
    if not 2 <= options.levels <= len(STEPS):
        parser.error(f"--levels must be 2 to {len(STEPS)}, got {options.levels}")
    if options.runs < 1:
        parser.error(f"--runs must be at least 1, got {options.runs}")
    steps = STEPS[: options.levels]
    facts = [measure(theta, gamma, steps, options.runs) for theta, gamma in MEMBERS]
    Console().print(show(facts, steps, options.runs))
    if options.out is not None:
        write(options.out, facts, steps)
    return facts


if __name__ == "__main__":
    main()
