"""Measure batches and write `benchmarks/results/batch.md`."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import bench_batch_memory as memory
import bench_batch_times as batch
import cball
from report import cpu, table, verdict

PAGE = Path(__file__).resolve().parent / "results" / "batch.md"
GOAL = 1.5


def _say(what: str) -> None:
    print(f"bench: {what} ...", file=sys.stderr, flush=True)


def _goals(times: dict[str, batch.Times], fastest: str) -> str:
    rows = []
    for name, found in times.items():
        for flags in dict.fromkeys((batch.PLAIN, fastest)):
            ratio = found.ratio[flags]
            row = (f"{name}: to C, {flags}", f"{ratio:.2f}", f"at most {GOAL:g}")
            rows.append((*row, verdict(ratio <= GOAL)))
    return table(("ratio of the time per ball and step", "measured", "goal", "verdict"), rows)


def _times(times: dict[str, batch.Times], builds: list[batch.CBatch]) -> str:
    found = list(times.values())

    def row(title: str, values: list[float]) -> tuple[str, ...]:
        return title, *(f"{value:.2f}" for value in values)

    rows = [row("zivi.simulate_batch, one thread", [it.zivi for it in found])]
    rows += [row(f"batch.c, {it.flags}", [of.c[it.flags] for of in found]) for it in builds]
    rows.append(row(f"ball.c, ball after ball, {batch.PLAIN}", [it.one_by_one for it in found]))
    ratios = [it.ratio_one_by_one for it in found]
    rows.append(row("ratio of zivi to the last", ratios))
    return table(("ns per ball and step", *times), rows)


def _driven(found: batch.DrivenTimes) -> str:
    def row(title: str, values: dict[str, float]) -> tuple[str, ...]:
        return title, *(f"{values[it]:.1f}" if it in values else "" for it in batch.DRIVEN)

    rows = [
        row("zivi.simulate_batch, one thread", found.zivi),
        row(f"batch.c, {batch.PLAIN}", found.c),
        row("ratio", found.ratio),
        row("zivi, every ball with a frequency of its own", found.own_waves),
        row("zivi, `MoreauJean(h)`", found.moreau),
    ]
    return table(("ns per ball and step", *batch.DRIVEN), rows)


def _memory(cases: list[memory.Case]) -> str:
    rows = [
        (
            f"{it.runs:,} runs",
            f"{it.steps:,}",
            f"every {it.save}th sample" if isinstance(it.save, int) else it.save,
            f"{it.result / it.runs:.0f}",
            f"{it.peak / it.runs:.0f}",
        )
        for it in cases
    ]
    head = ("", "steps", "saved", "bytes a run in the result", "bytes a run at the peak")
    return table(head, rows)


def measure() -> str:
    """Measure all of it; returns the page."""
    with tempfile.TemporaryDirectory() as directory:
        _say("compiling the C loops of batches")
        builds = batch.build(Path(directory))
        single = next(it for it in cball.build(Path(directory)) if it.flags == batch.PLAIN)
        _say("comparing batches")
        agreement = batch.agreement(builds[0])
        agreement.check()
        times = {}
        for name, scene in batch.SCENES.items():
            _say(f"timing batches, {name}")
            times[name] = batch.times(builds, single, scene)
        _say("timing linear forces")
        driven = batch.driven(next(it for it in builds if it.flags == batch.PLAIN))
        _say("timing threads")
        scaling = batch.scaling(builds[0])
    _say("measuring the memory of batches")
    cases = memory.measure()
    vectorised = [build.flags for build in builds if build.vectorised]
    assert batch.PLAIN in vectorised, vectorised
    middle = next(reversed(times.values()))
    fastest = min(middle.c, key=middle.c.__getitem__)
    first, last = agreement.rest_times
    return f"""\
# Benchmarks of batches

Written by `make bench`; do not edit. One run on a shared machine: {cpu()}. The contenders of a
table run in turn, round after round; a figure is a median over the rounds, a ratio the median of
the ratios of neighbours within a round.

The run: {batch.BALLS} of the paper's balls (kappa = {cball.KAPPA}, f = {cball.FORCE} m/s^2) thrown
up at 6 m/s from 1 to 1.4 m, {batch.STEPS} steps with `ThetaGamma(h)`, `save="final"`, one thread.
With h = 1e-3 s all come to rest, the first at {first:g} s, the last at {last:g} s: zivi stops to
compute when all balls that are moved together rest, the C loops do not. With h = 6e-4 s all move
all the time; in random order the impacts of neighbours do not coincide.

## Goal

{_goals(times, fastest)}

## Beside hand-written C loops

`benchmarks/batch.c` is the same scheme for this one problem, in closed form and without a branch:
the compiler reports its loop over the balls as vectorised (asserted). It returns states only; zivi
also gives counts of events, rest times and the times and speeds of impacts. `ball.c` takes ball
after ball, with branches.

{_times(times, builds)}

Both compute the same: {agreement.same} of {batch.BALLS} balls come to rest in the same step here
and there (at most {agreement.steps_apart} steps apart), positions at 0.5 and 1.2 s differ by at
most {agreement.position:.0e} m. Eight of the balls end as `zivi.simulate` ends them, to the
last bit, and one and two threads give the same bits.

## Under linear forces

Gravity of 9.81 m/s^2 with a wave of 5 m/s^2 and 7 rad/s, with a spring of 20 1/s^2 and a damper of
0.3 1/s, and with both; h = 6e-4 s, the balls move all the time. The C loop solves the linear
equation of a free step in closed form, zivi takes the trials of `zivi.simulate`, whose bits it has;
where balls share frequency and phase they share the cosine. At 0.5 s positions differ by at most
{driven.apart:.0e} m (the step over an apex is another one).

{_driven(driven)}

`MoreauJean(h)` under the constant force, run by run: {driven.moreau_constant:.1f} ns.

## Threads

Two threads take {1 / scaling.zivi:.2f} of the time of one (0.5 is linear); two C loops side by
side, without anything shared, {1 / scaling.c:.2f}: that is what the machine gave at the time. The
processor time of two threads together is {scaling.work:.2f} of that of one: threads add no work.

## Memory

What the process grows by while the batch runs, from processes of their own; two threads or more.

{_memory(cases)}

Steps cost nothing. A run costs some {cases[2].peak / cases[2].runs:.0f} bytes until it is handed
over; samples and events are there twice at the peak, once as they are collected and once in
the arrays that are returned.
"""


def write() -> str:
    """Measure all of it and write the page; returns it."""
    page = measure()
    PAGE.write_text(page)
    return page


if __name__ == "__main__":
    print(write())
