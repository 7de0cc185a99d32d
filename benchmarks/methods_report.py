"""The work and precision of the methods as a page of the documentation."""

from __future__ import annotations

import dataclasses
import statistics
import textwrap
from collections.abc import Iterable

import scipy

from methods_careless import Row
from methods_counts import (
    RK5,
    RK8,
    SCIPY,
    Ratios,
    Run,
    at_equal_error,
    at_equal_tolerance,
    cheapest,
)
from methods_problems import Problem
from methods_times import COMPILED, COST_TOL, PYTHON, Beside, Cost
from report import cpu, table, verdict

ERRORS = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)
"""Errors at which the work is compared."""
MOST = {True: 0.5, False: 1.1}
"""Goal: evaluations to those of SciPy, with a Zeno point and without."""
FASTER = {COMPILED: 20.0, PYTHON: 3.0}
"""Goal: how many times less time than SciPy."""
WITH = {True: "with a Zeno point", False: "without"}


@dataclasses.dataclass(frozen=True)
class Figures:
    """All that was measured, by problem."""

    problems: dict[str, Problem]
    runs: dict[str, dict[str, list[Run]]]
    dense: dict[str, dict[str, list[Run]]]
    times: dict[str, list[Beside]]
    fixed_times: dict[str, dict[str, list[float]]]
    careless: list[Row]
    costs: dict[tuple[str, int], Cost]
    other_costs: dict[str, float]

    def ratios(self, key: str) -> dict[str, Ratios | None]:
        """Give evaluations to those of SciPy, by what is equal; None if no error was kept."""
        runs, dense = self.runs[key], self.dense[key]
        return {
            "equal tolerance": at_equal_tolerance(runs[RK8], runs[SCIPY]),
            "equal tolerance, dense output": at_equal_tolerance(dense[RK8], dense[SCIPY]),
            "equal error": at_equal_error(runs[RK8], runs[SCIPY], ERRORS),
        }


def _evaluation_goals(figures: Figures) -> Iterable[tuple[str, ...]]:
    for zeno, most in MOST.items():
        keys = [key for key, problem in figures.problems.items() if problem.zeno is zeno]
        for kind in ("equal tolerance", "equal tolerance, dense output", "equal error"):
            found = {key: figures.ratios(key)[kind] for key in keys}
            for of, title in (("mean", "mean"), ("most", "worst")):
                values = {key: getattr(it, of) for key, it in found.items() if it is not None}
                worst = max(values, key=values.__getitem__)
                what = f"evaluations to SciPy's, {WITH[zeno]}, {kind}, {title}"
                goal = f"at most {most:g}"
                shown = f"{values[worst]:.2f} ({worst})"
                yield what, shown, goal, verdict(values[worst] <= most)


def _goals(figures: Figures) -> str:
    rows = list(_evaluation_goals(figures))
    for kind, least in FASTER.items():
        factors = {
            f"{key}, {it.tol:.0e}": it.faster[kind]
            for key, times in figures.times.items()
            for it in times
        }
        worst = min(factors, key=factors.__getitem__)
        what = f"times less time than SciPy, {kind}, worst"
        shown = f"{factors[worst]:.0f} ({worst})"
        rows.append((what, shown, f"at least {least:g}", verdict(factors[worst] >= least)))
    return table(("ratio", "measured", "goal", "verdict"), rows)


def _ratios(figures: Figures) -> str:
    rows = []
    for key, problem in figures.problems.items():
        cells = [
            "" if it is None else f"{it.least:.2f} / {it.mean:.2f} / {it.most:.2f}"
            for it in figures.ratios(key).values()
        ]
        rows.append((f"{key}, {problem.title}", *cells))
    kinds = next(iter(figures.problems))
    return table(("problem", *figures.ratios(kinds)), rows)


def _at_errors(figures: Figures) -> str:
    methods = list(next(iter(figures.runs.values())))
    rows = []
    for key, runs in figures.runs.items():
        for error in ERRORS:
            counts = [cheapest(runs[name], error) for name in methods]
            cells = ["" if it is None else f"{it:.0f}" for it in counts]
            rows.append((key, f"{error:.0e}", *cells))
    return table(("problem", "error", *methods), rows)


def _runs(figures: Figures) -> str:
    rows = []
    for key, runs in figures.runs.items():
        tolerances = [it.tol for it in figures.times[key]]
        for tol in tolerances:
            cells = []
            for name in (RK8, RK5, SCIPY):
                run = at_setting(runs[name], tol)
                cells += [f"{run.nfev:.0f}", f"{run.error:.1e}"]
            rows.append((key, f"{tol:.0e}", *cells))
    head = [name for method in (RK8, RK5, SCIPY) for name in (f"{method}: evaluations", "error")]
    return table(("problem", "tolerance", *head), rows)


def at_setting(runs: Iterable[Run], setting: float) -> Run:
    """Give the run with that setting."""
    return min(runs, key=lambda run: abs(run.setting / setting - 1.0))


def _micro(seconds: float | None) -> str:
    return "" if seconds is None else f"{seconds * 1e6:,.0f}"


def _times(figures: Figures) -> str:
    columns = [
        (RK8, COMPILED),
        (RK8, PYTHON),
        (RK5, COMPILED),
        (SCIPY, PYTHON),
        (SCIPY, COMPILED),
    ]
    rows = [
        (
            key,
            f"{it.tol:.0e}",
            *(_micro(it.seconds.get(column)) for column in columns),
            f"{it.faster[COMPILED]:.0f}",
            f"{it.faster[PYTHON]:.0f}",
        )
        for key, times in figures.times.items()
        for it in times
    ]
    head = [
        "problem",
        "tolerance",
        "order 8, compiled (us)",
        "order 8, Python (us)",
        "order 5, compiled (us)",
        "SciPy, Python (us)",
        "SciPy, numba (us)",
        "SciPy to order 8, compiled",
        "SciPy to order 8, Python",
    ]
    return table(head, rows)


def _fixed(figures: Figures) -> str:
    rows, counts = [], []
    for key, times in figures.fixed_times.items():
        for name, seconds in times.items():
            runs = figures.runs[key][name]
            counts = [run.setting for run in runs]
            pairs = zip(runs, seconds, strict=True)
            cells = [f"{run.error:.1e}, {_micro(took)}" for run, took in pairs]
            rows.append((key, name, *cells))
    head = [f"{steps:,.0f} steps: error, us" for steps in counts]
    return table(("problem", "method", *head), rows)


def _careless(figures: Figures) -> str:
    rows = [dataclasses.astuple(row) for row in figures.careless]
    head = ("variant", "problem", "events", "ended at t (s)", "x there (m)", "")
    lines = [head, ("---", "---", "---:", "---:", "---:", "---"), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _costs(figures: Figures) -> str:
    rows = []
    for (key, order), cost in figures.costs.items():
        without, dense = cost.seconds[False], cost.seconds[True]
        rows.append(
            (
                f"{key}, order {order}",
                str(cost.nfev),
                str(cost.steps),
                f"{without * 1e6:.1f}",
                f"{dense * 1e6:.1f}",
                f"{without * 1e9 / cost.steps:.0f}",
                f"{dense * 1e9 / cost.steps:.0f}",
            )
        )
    head = ("run", "evaluations", "steps tried", "us", "us, dense", "ns per step", "ns, dense")
    return table(head, rows)


def _others(figures: Figures) -> str:
    rows = [(name, f"{seconds * 1e9:,.0f}") for name, seconds in figures.other_costs.items()]
    return table(("", "ns"), rows)


def _why(figures: Figures) -> str:
    """Say which tolerances miss the goal, and why."""
    missed = []
    for key, problem in figures.problems.items():
        runs = figures.runs[key]
        for a, b in zip(runs[RK8], runs[SCIPY], strict=True):
            if a.nfev > MOST[problem.zeno] * b.nfev:
                missed.append(f"{key} at {a.setting:.0e}: {a.nfev:.0f} to {b.nfev:.0f}")
    if not missed:
        return "Every single tolerance keeps the goal."
    text = (
        f"Single tolerances that miss it at equal tolerance: {'; '.join(missed)}. "
        "An impact that its dense output does not tell to the tolerance costs zivi twelve "
        "evaluations for the step that is repeated onto it (SciPy takes its interpolant "
        "everywhere); the rest are rejected steps, which in a periodic motion "
        "are the same in every period and so do not average out: the ratio goes up and down from "
        "one tolerance to the next by a quarter."
    )
    return textwrap.fill(text, 100)


def page(figures: Figures) -> str:
    """Write the page."""
    names = "\n".join(f"- {key}: {it.title}" for key, it in figures.problems.items())
    median = statistics.median(it.faster[COMPILED] for its in figures.times.values() for it in its)
    return f"""\
# Work and precision

Written by `make bench`; do not edit. One run on a shared machine: {cpu()}, SciPy
{scipy.__version__}. Times are of the processor: what others do on the machine is not counted, what
they do to its caches is. The contenders run in turn, round after round; a figure is a median over
the rounds, a ratio the median of the ratios within a round.
Evaluation counts and errors are the same in every run.

Problems, all of x'' = -k x - c x' - g + A cos(w t + p) above a wall at x = 0:

{names}

Impacts accumulate in B1, T1, T3 and O2, and the mass rests and (T1, T3, O2) lifts off
again; in O4 and T4 it bounces once in every period. The truth is the 25-digit reference of
`tests/data/reference_trajectories.json`, for T4 the closed form in
`benchmarks/methods_problems.py`. The error is the larger of the errors in x (m) and x' (m/s) at
the final time, for B1, which ends at rest, also of the time of rest (s).

SciPy is driven as a competent user's script drives it (`benchmarks/scipy_events.py`):
`solve_ivp(method="DOP853")` with a terminal event x = 0, direction -1; at an impact x := 0,
x' := -e x', and half of the next arc, at most {0.02:g} s, is flown without the event; a speed below
max(tolerance, 1e-9) m/s under a pull inward is rest; at rest the force at the wall is looked at
twenty times in a period and `brentq` finds the lift-off. Relative and absolute tolerance are the
same number for both. `solve_ivp` can only call Python; a force that numba compiled is still
called from there.

![Error over evaluations and over time](../../docs/figures/work_precision.png)

## Goals

"Mean" is the geometric mean over the tolerances from 1e-3 to 1e-12, two in a decade (or over the
errors), "worst" the largest ratio among them, of the problem where it is largest. Dense output is
off on both sides unless the row says so. At equal error the cheapest run of each side that keeps
the error counts.

{_goals(figures)}

{_why(figures)}

## Evaluations to those of SciPy

SwitchedRK of order 8: least / mean / most.

{_ratios(figures)}

## Evaluations for an error

Cheapest run whose error is no larger. Empty: not reached with up to a million fixed steps. Fixed
steps: root mean square of the errors of three step sizes close together; a step whose force is
known to be constant counts as one evaluation.

{_at_errors(figures)}

## Evaluations and errors by tolerance

{_runs(figures)}

## Time

Whole runs through `zivi.simulate` and through the script. Compiled: `zivi.LinearForce`. The
last two columns say how many times as long SciPy takes, with a compiled force against the quicker
of its two forces; the median of the first of them is {median:.0f}. A force that numba compiled
gains SciPy nothing: nearly all of its time is its own Python.

{_times(figures)}

The methods of fixed steps, compiled force:

{_fixed(figures)}

## SciPy without a precaution

The ball B1 to t = 3 s, correct: at rest from 2.46584663 s; T4 for the arc that is not watched.
Tolerance 1e-10. No variant raises an error or warns. Runs that do not end are cut off after 300
events; those that did not advance the time are not counted.

{_careless(figures)}

## Cost of a run and of a step

SwitchedRK, compiled force, tolerance {COST_TOL:g}, dense output off and on. Steps tried: taken,
rejected, and repeated onto an impact.

{_costs(figures)}

Other things:

{_others(figures)}
"""
