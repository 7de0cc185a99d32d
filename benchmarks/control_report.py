"""The figures of the controllers as a page of the documentation."""

from __future__ import annotations

import dataclasses

from control_counts import CASES, Count
from control_siconos import Beside
from control_times import Calls, Tick
from report import cpu, table, verdict

GOAL_TICK, GOAL_CALL, GOAL_SICONOS = 150.0, 1000.0, 20.0


@dataclasses.dataclass(frozen=True)
class Figures:
    """All that was measured."""

    ticks: dict[str, Tick]
    counts: dict[str, Count] | str
    beside: list[Beside] | str
    calls: Calls
    loops: dict[str, float]
    foreign: float


def _goals(figures: Figures) -> str:
    mean = figures.ticks["loop"].mean
    call = figures.calls.step
    rows = [
        (
            "mean time of a tick in Rust, the paper's loop",
            f"{mean:.0f} ns",
            f"at most {GOAL_TICK:g} ns",
            verdict(mean <= GOAL_TICK),
        ),
        (
            "time of a call of `tracker.step` in Python",
            f"{call / 1e3:.2f} us",
            f"at most {GOAL_CALL / 1e3:g} us",
            verdict(call <= GOAL_CALL),
        ),
    ]
    if isinstance(figures.beside, str):
        rows.append(("times faster than Siconos", figures.beside, "", "not measured"))
        return table(("figure", "measured", "goal", "verdict"), rows)
    for it in figures.beside:
        name = f"times faster than Siconos at its median, {it.label}"
        goal = f"at least {GOAL_SICONOS:g}"
        rows.append((name, f"{it.ratio:.1f}", goal, verdict(it.ratio >= GOAL_SICONOS)))
    ours = max(it.failed_tick for it in figures.beside)
    theirs = [it.failed for it in figures.beside]
    failed = f"{ours:g} % (Siconos: {min(theirs):.2g} to {max(theirs):.2g} %)"
    rows.append(("steps that the tick fails on", failed, "0 %", verdict(ours == 0.0)))
    return table(("figure", "measured", "goal", "verdict"), rows)


def _ticks(figures: Figures) -> str:
    rows = [
        (CASES[case], *(f"{value:.0f}" for value in dataclasses.astuple(it)))
        for case, it in figures.ticks.items()
    ]
    head = ("ticks", "mean (ns)", "median", "99.9 %", "99.9 %, the system's pauses included")
    return table(head, rows)


def _counts(figures: Figures) -> str:
    if isinstance(figures.counts, str):
        return f"Not counted: {figures.counts}."
    rows = [
        (CASES[case], str(it.ticks), f"{it.mean:.0f}", str(it.most))
        for case, it in figures.counts.items()
    ]
    return table(("ticks", "number", "mean", "most"), rows)


def _beside(figures: Figures) -> str:
    if isinstance(figures.beside, str):
        return f"Not measured: {figures.beside}."
    rows = [
        (
            it.label,
            f"{it.tick:.0f}",
            f"{it.inner:.0f}",
            f"{it.median:.0f}",
            f"{it.mean:.0f}",
            f"{it.nfev:.0f}",
            f"{it.ratio:.1f}",
            f"{it.ratio_of_means:.1f}",
            f"{it.failed_tick:.2g}",
            f"{it.failed_inner:.2g}",
            f"{it.failed:.2g}",
        )
        for it in figures.beside
    ]
    head = (
        "steps",
        "tick, mean (ns)",
        "zivi's general solver, mean",
        "Siconos, median",
        "Siconos, mean",
        "evaluations, median",
        "Siconos' median to the tick's mean",
        "mean to mean",
        "failed (%), tick",
        "general solver",
        "Siconos",
    )
    return table(head, rows)


def page(figures: Figures) -> str:
    """Write the page."""
    calls = figures.calls
    loops = table(
        ("closed loop", "ns per period"),
        [
            *((name, f"{ns:.0f}") for name, ns in figures.loops.items()),
            ("a controller written in Python, h = 1e-3 s", f"{figures.foreign:.0f}"),
        ],
    )
    return f"""\
# Benchmarks of the controllers

Written by `make bench`; do not edit. One run on a shared machine: {cpu()}. Times drift with what
else the machine does, so contenders run in turn, round after round; a figure is a median over the
rounds, a ratio the median of the ratios within a round. A ratio means the same on another machine,
and so does a number of instructions; a goal in nanoseconds does not.

The paper's loop: mu1 = 30, mu2 = 17, kappa = 0.5 for the plant and for the reference, starts
(6, 5) and (3, 3), forces -9.81 and -19.81 m/s^2, h = 1e-3 s, 2 s. The random draws of a tick:
gains, walls, forces and periods from 1e-5 to 0.1 s at random; states anywhere (wide), within some
steps of the wall and of the reference (near), or about to cross the wall (fast crossing).

## Goals

{_goals(figures)}

## Time of a tick in Rust

Everything a tick does: the sample checked and lifted, the reference advanced, the plant's four
signs solved, the control bounded (`crates/zivi-core/examples/tick_time.rs`, one process). The mean
is taken over rounds without a clock between the ticks. For the quantiles each tick is timed by
itself, less the time of two looks at the clock, whose own resolution is some ten nanoseconds; a
tick counts with the shortest of its times over the rounds, in the last column with all of them.

{_ticks(figures)}

## Instructions of a tick

Counted by callgrind tick by tick (`crates/zivi-core/examples/tick_cost.rs`). The last row is a
search for the worst case.

{_counts(figures)}

## Beside Siconos

The same step as one VI of six signs, solved by Siconos' VI_BOX_AVI_LSA: F and its Jacobian in C
(`benchmarks/siconos_tracking.c`), rows scaled, tolerance 1e-12, 1000 iterations, the smallest step
of its line search set to 1e-16 (by default the search may never end). On the loop it starts from
the signs of the last tick or of the state, at random from the signs of the state. Random steps are
near the wall and near the reference, |v|, |v_r - v| up to the speed and |s|, |s_r - s| up to h
times it. A step has failed when its relative residual, recomputed apart from both, is above 1e-9.
Siconos' steps are timed one by one, less the clock's own time; of the tick, reference included, the
mean over all steps of a set is taken, within a Rust process. The two take turns.

{_beside(figures)}

On most steps of the loop no sign changes: Siconos finds its start solved after one evaluation of F,
and its median is the time to find that out. Its mean holds the steps that take iterations, and its
failures. The general solver of zivi is the like of Siconos' (inner linearisation, with fall-backs),
called from Python for all steps at once; it is there for checking and is not what a tick uses.

## From Python

On the samples of the paper's loop a call of `tracker.step(x, xdot, force, force_ref)` takes
{calls.step:.0f} ns, the loop around it included: {calls.ratio:.1f} times what `math.hypot` of four
numbers takes ({calls.hypot:.0f} ns), which is about the least for such a call. Samples, events and
controls of a whole loop are recorded without the interpreter:

{loops}
"""
