"""Work and precision of the methods; write `benchmarks/results/methods.md` and its figure.

With --quick: a smaller run, printed only.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path

import methods_careless
import methods_counts
import methods_figure
import methods_report
import methods_times
from methods_problems import problems

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE = Path(__file__).resolve().parent / "results" / "methods.md"
PICTURE = DOCS / "figures" / "work_precision.png"


@dataclasses.dataclass(frozen=True)
class Effort:
    """How much is measured."""

    ladder: tuple[float, ...] = tuple(10.0 ** (-half / 2) for half in range(6, 25))
    """Tolerances of the counts: 1e-3 to 1e-12, two in a decade."""
    timed: tuple[float, ...] = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
    steps: tuple[int, ...] = (1_000, 10_000, 100_000, 1_000_000)
    rounds: int = 5


QUICK = Effort(ladder=(1e-4, 1e-6, 1e-8), timed=(1e-4, 1e-8), steps=(1_000, 10_000), rounds=1)


def _say(what: str) -> None:
    print(f"bench: {what} ...", file=sys.stderr, flush=True)


def measure(effort: Effort) -> methods_report.Figures:
    """Measure everything."""
    posed = problems()
    runs, dense, times, fixed_times = {}, {}, {}, {}
    for key, problem in posed.items():
        _say(f"work and precision, {problem.title}")
        runs[key] = methods_counts.adaptive(problem, effort.ladder)
        dense[key] = methods_counts.adaptive_dense(problem, effort.ladder)
        times[key] = methods_times.beside_scipy(problem, effort.timed, effort.rounds)
        runs[key] |= methods_counts.fixed(problem, effort.steps)
        fixed_times[key] = methods_times.fixed_steps(problem, effort.steps, effort.rounds)
    _say("leaving out precautions")
    careless = methods_careless.rows(posed["B1"], posed["T4"])
    _say("timing runs and steps")
    return methods_report.Figures(
        problems=posed,
        runs=runs,
        dense=dense,
        times=times,
        fixed_times=fixed_times,
        careless=careless,
        costs=methods_times.costs(posed, effort.rounds),
        other_costs=methods_times.other_costs(posed, effort.rounds),
    )


def write(effort: Effort | None = None) -> str:
    """Measure all of it, write the page and draw the figure; returns the page."""
    figures = measure(effort or Effort())
    page = methods_report.page(figures)
    PAGE.write_text(page)
    methods_figure.draw(figures, PICTURE)
    return page


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a smaller run, printed only")
    if parser.parse_args().quick:
        print(methods_report.page(measure(QUICK)))
    else:
        print(write())


if __name__ == "__main__":
    main()
