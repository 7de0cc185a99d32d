"""The figures of the box-VI solver as a page of the documentation."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Sequence

from report import cpu, table
from vi_counts import Count
from vi_growth import Leak, Size, exponent
from vi_times import BURST, PIVOTAL, SOLVED, Pivots, Ratios

OURS = 1e-9


@dataclasses.dataclass(frozen=True)
class Figures:
    """All that was measured."""

    counts: dict[str, tuple[Count, Count, Count]]
    """By method: published starts, random starts, starts of problems without a solution."""
    ratios: dict[str, Ratios]
    pivots: dict[str, Pivots]
    sizes: Sequence[Size]
    leak: Leak
    lost: float | None


def _of(part: int, whole: int) -> str:
    return f"{part} / {whole}"


def _counts(figures: Figures) -> str:
    head = (
        "method",
        "published, 1e-9",
        "1e-7",
        "random, 1e-9",
        "1e-7",
        "called solved above 1e-7",
        "pivots, median",
        "max",
    )
    rows = []
    for name, (listed, random, _) in figures.counts.items():
        solved = [
            _of(it.solved(tolerance), len(it.ends))
            for it in (listed, random)
            for tolerance in (OURS, SOLVED)
        ]
        ours = name.startswith("zivi")
        pivots = [f"{value:g}" for value in listed.pivots] if ours else ["", ""]
        rows.append((name, *solved, str(listed.false_claims + random.false_claims), *pivots))
    return table(head, rows)


def _names(unsolved: dict[str, int]) -> str:
    return ", ".join(name if n == 1 else f"{name} {n}" for name, n in unsolved.items()) or "none"


def _unsolved(figures: Figures) -> str:
    rows = []
    for name, (listed, random, _) in figures.counts.items():
        tolerance = OURS if name.startswith("zivi") else SOLVED
        rows.append((name, *(_names(it.unsolved(tolerance)) for it in (listed, random))))
    return table(("method", "published starts", "random starts"), rows)


def _unsolvable(figures: Figures) -> str:
    _, _, without = figures.counts["zivi, full"]
    found = [end for (name, _), end in without.ends.items() if name == "nosol_exp"]
    others = [end for (name, _), end in without.ends.items() if name != "nosol_exp"]
    claimed = sum(end.claimed for end in others)
    worst = max(end.residual for end in found)
    return (
        f"Of the {len(others)} starts of two problems without a solution zivi calls {claimed} "
        "solved. On the third, `nosol_exp`, the residual\ntends to 0 at infinity, and "
        f"{sum(end.claimed for end in found)} of {len(found)} starts end as solved with a "
        f"residual of {worst:.1e} (see `convergence_ratio`)."
    )


def _ratios(figures: Figures) -> str:
    rows = [
        (
            f"Siconos {name}",
            str(it.starts),
            *(f"{value:.2f}" for value in (*it.time.values(), it.nfev, it.njev)),
            f"{100 * it.callbacks:.0f} %",
        )
        for name, it in figures.ratios.items()
    ]
    times = list(next(iter(figures.ratios.values())).time)
    head = (
        "zivi to",
        "starts",
        *(f"time, {name}" for name in times),
        "F",
        "Jacobians",
        "of zivi's time in callbacks",
    )
    return table(head, rows)


def _pivots(figures: Figures) -> str:
    def row(name: str, it: Pivots) -> Iterable[str]:
        yield from (name, str(it.n), str(it.zivi))
        for solver in PIVOTAL:
            count, ratio = it.siconos[solver], it.time[solver]
            yield "not solved" if count is None else str(count)
            yield "" if ratio is None else f"{ratio:.2g}"

    theirs = [title for solver in PIVOTAL for title in (solver, "time, zivi to it")]
    rows = [tuple(row(*item)) for item in figures.pivots.items()]
    return table(("problem", "n", "zivi", *theirs), rows)


def _peer(figures: Figures) -> str:
    if not figures.ratios:
        return "Not measured: no Python with `siconos.numerics` was found."
    return f"""\
Published starts that both solve to 1e-7. The problems and their callbacks are the same Python
code in both; Siconos runs in an interpreter of its own, so its NumPy may be another version. The
two take turns start by start, {BURST} solves at a time. Ratios of one start are medians over the
rounds; given are their quantiles over the starts, and the ratio of the sums. F and Jacobians:
evaluations, ratio of the sums. Siconos does not tell the pivots inside these solvers. The time in
callbacks is the number of evaluations times the time of one at the solution.

{_ratios(figures)}

Pivots on linear complementarity problems from zero, and the time without callbacks and without
the checks of `solve_avi`, zivi over Siconos:

{_pivots(figures)}"""


def _sizes(figures: Figures) -> str:
    def row(size: Size, before: Size | None) -> tuple[str, ...]:
        memory = "" if size.memory is None else f"{size.memory / 2**20:.1f}"
        local = ""
        if before is not None:
            local = f"{math.log(size.per_pivot / before.per_pivot, size.n / before.n):.2f}"
        return (
            str(size.n),
            str(size.pivots),
            f"{size.seconds * 1e3:.2f}",
            f"{size.per_pivot * 1e6:.1f}",
            local,
            memory,
            "" if size.memory is None else f"{size.memory / (8 * size.n**2):.1f}",
            f"{size.residual:.0e}",
        )

    head = ("n", "pivots", "ms", "us per pivot", "exponent to the row above")
    head += ("MiB", "matrices of n x n", "residual")
    befores = [None, *figures.sizes]
    return table(head, itertools.starmap(row, zip(figures.sizes, befores, strict=False)))


def _fits(figures: Figures) -> str:
    n = [size.n for size in figures.sizes]
    pivot = exponent(n, [size.per_pivot for size in figures.sizes])
    whole = exponent(n, [size.seconds for size in figures.sizes])
    return (
        f"Fitted: time per pivot ~ n^{pivot:.2f} (n^2 is what it should cost), "
        f"the whole solve ~ n^{whole:.2f}."
    )


def _leak(figures: Figures) -> str:
    it = figures.leak
    grew = "not measured" if it.grew is None else f"{it.grew:,} bytes"
    lost = "" if figures.lost is None else f" Siconos' VI_BOX_AVI_LSA: {figures.lost:.0f} a solve."
    return f"""\
{it.solves:,} affine solves of two unknowns by the extension, after warming up: resident memory grew
by {grew}.{lost}

One such solve takes {it.extension * 1e6:.1f} us in the extension, {it.avi * 1e6:.0f} us by
`zivi.solve_avi` and {it.vi * 1e6:.0f} us by `zivi.solve_vi` ({it.nfev} evaluations of F and
{it.njev} of its Jacobian that cost next to nothing). On small problems most of the time goes into
checking arguments and building the result in Python."""


def page(figures: Figures) -> str:
    """Write the page."""
    return f"""\
# Benchmarks of the box-VI solver

Written by `make bench`; do not edit. One run on a shared machine: {cpu()}. Times drift with what
else the machine does.

## Starts solved

The published problems of `tests/mcp`: their own starts, and random ones at distances from 0.1 to
100 of them (fixed seed). A start is solved when the natural residual, recomputed at the returned
point, is within the tolerance at the head of the column; zivi stops at 1e-9. Siconos: tolerance
1e-9, 1000 iterations, infinite bounds replaced by 1e7 in the box solvers, the smallest step of the
line search set to 1e-16 (by default its search may never end), starts moved into the box, solves
without an end within 5 s not solved. MCP_NEWTON_FB_FBLSA takes no upper bounds: fewer starts.

{_counts(figures)}

{_unsolvable(figures)}

Not solved, with the number of starts where it is more than one; to 1e-9 by zivi, to 1e-7 by
Siconos:

{_unsolved(figures)}

## Time and work beside Siconos

{_peer(figures)}

## Growth with the number of unknowns

Membrane over a bump on a square grid, five-point Laplacian, weight 5, by `zivi.solve_avi` from the
default start, by pivoting alone (`active_set=False`; with it these take no pivots). The time of a
whole solve is the first in a fresh process; the time of a pivot is the difference of solves stopped
after a quarter and after three quarters of the pivots (each the shortest of many), which holds no
set-up. Memory is what the first solve adds at its peak; the
smallest fits into memory that the process had already.

{_sizes(figures)}

{_fits(figures)}

## Many solves

{_leak(figures)}
"""
