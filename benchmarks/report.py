"""The measured figures as a page of the documentation."""

from __future__ import annotations

import dataclasses
import platform
from collections.abc import Iterable, Sequence
from pathlib import Path

import cball
from bench_ball import STEPS, Agreement, Scene
from instructions import CASES
from siconos_peer import ROUTES, Peer

GOAL_C, GOAL_SICONOS = 1.5, 500.0


@dataclasses.dataclass(frozen=True)
class Figures:
    """All that was measured."""

    agreements: Sequence[Agreement]
    scenes: dict[str, Scene]
    forces: dict[str, tuple[float, float]]
    peers: dict[str, Peer | str]
    zivi_beside: float
    instructions: dict[str, float] | str
    compiler: str


def cpu() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    # the first column is text, the others are figures
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def verdict(met: bool) -> str:
    return "met" if met else "**not met**"


def _goals(figures: Figures) -> str:
    rows = [
        (
            f"time per step to the C loop{pages}, {name}",
            f"{ratio:.2f}",
            f"at most {GOAL_C:g}",
            verdict(ratio <= GOAL_C),
        )
        for name, scene in figures.scenes.items()
        for pages, ratio in (("", scene.ratio), (" with large pages", scene.ratio_large))
    ]
    for route, peer in figures.peers.items():
        name = f"times faster than {ROUTES[route]}"
        if isinstance(peer, str):
            rows.append((name, peer, f"at least {GOAL_SICONOS:g}", "not measured"))
        else:
            faster = peer.ns_per_step / figures.zivi_beside
            met = verdict(faster >= GOAL_SICONOS)
            rows.append((name, f"{faster:.0f}", f"at least {GOAL_SICONOS:g}", met))
    return table(("ratio", "measured", "goal", "verdict"), rows)


def _scenes(figures: Figures) -> str:
    names = list(figures.scenes)
    scenes = list(figures.scenes.values())

    def row(title: str, values: Iterable[float]) -> tuple[str, ...]:
        return (title, *(f"{value:.1f}" for value in values))

    rows = [row("zivi.simulation.run", (scene.zivi for scene in scenes))]
    for title, attribute in (
        ("C, the same eight arrays, fresh memory", "recording"),
        ("C, one block with large pages", "large"),
        ("C, into memory used before", "warm"),
        ("C, steps only", "bare"),
    ):
        for flags in cball.FLAGS:
            values = (getattr(scene, attribute)[flags] for scene in scenes)
            rows.append(row(f"{title}, {flags}", values))
    head = [
        f"ns per step, {name} (T = {scene.t1:g} s)"
        for name, scene in zip(names, scenes, strict=True)
    ]
    used = "; ".join(f"{name}: {scene.fastest}" for name, scene in figures.scenes.items())
    return (
        table(("", *head), rows) + f"\n\nThe ratios are to the fastest recording C loop ({used})."
    )


def _agreements(figures: Figures) -> str:
    def rest(value: float | None) -> str:
        return "moving" if value is None else f"{value:.9g}"

    rows = [
        (
            f"{it.h:.3g}",
            rest(it.rest_zivi),
            rest(it.rest_c),
            f"{it.position:.1e}",
            f"{it.before_the_end:.1e}",
            f"{it.velocity:.1e}",
        )
        for it in figures.agreements
    ]
    head = ("h", "rest, zivi", "rest, C", "x, s", "x', v before the end", "x', v throughout")
    return table(head, rows)


def _peers(figures: Figures) -> str:
    rows = [("zivi.simulate, the same run", f"{figures.zivi_beside / 1e3:.3f}", "0", "2.444", "")]
    for route, peer in figures.peers.items():
        if isinstance(peer, str):
            rows.append((ROUTES[route], peer, "", "", ""))
        else:
            rest = "never" if peer.rest_time is None else f"{peer.rest_time:.6g}"
            took = f"{peer.ns_per_step / 1e3:.2f}"
            rows.append((ROUTES[route], took, str(peer.failures), rest, f"{peer.apart:.0e}"))
    head = ("", "us per step", "failed steps", "rest (s)", "largest difference of s from C")
    return table(head, rows)


def _instructions(figures: Figures) -> str:
    if isinstance(figures.instructions, str):
        return f"Not counted: {figures.instructions}."
    rows = [(CASES[case], f"{count:.0f}") for case, count in figures.instructions.items()]
    return table(("step", "instructions"), rows)


def page(figures: Figures) -> str:
    """Write the page."""
    forces = table(
        ("force", "ns per step", "evaluations per step"),
        [(name, f"{ns:.1f}", f"{n:.2f}") for name, (ns, n) in figures.forces.items()],
    )
    return f"""\
# Benchmarks

Written by `make bench`; do not edit. One run on a shared machine: {cpu()}, {figures.compiler}.
Times drift with what else the machine does, so the contenders of a table run in turn, round after
round; a figure is a median over the rounds, a ratio the median of the ratios within a round.

The run: the paper's ball (kappa = {cball.KAPPA}, x0 = 1 m, x0' = 6 m/s, f = {cball.FORCE} m/s^2),
theta = gamma = 1, {STEPS:,} steps, through `zivi.simulate`, all eight arrays recorded (t, x, x', s,
v, both multipliers, the residual of every step).

## Goals

{_goals(figures)}

## Beside a hand-written C loop

`benchmarks/ball.c` is the same scheme for this one problem: closed-form cases, constant force,
theta and gamma built in, the same eight arrays with the same residual. Both sides allocate with the
C library's allocator within the timed call, and before every repetition freed memory is given back
to the system: each pays for fresh pages, as the first run of a user's program does. That costs more
than the steps. zivi asks the system for large pages behind its record; C does so in the rows that
say it.

{_scenes(figures)}

Both compute the same. Largest differences over the run, states in SI units; "before the end"
leaves out the last 1e-4 of the time to rest, where a velocity is a quotient of vanishing numbers
and shows the rounding of either side:

{_agreements(figures)}

## Kinds of force

The moving ball under each kind of force. A force that depends on the state makes the step
implicit in it.

{forces}

## Beside Siconos

4,000 steps, h = 1e-3, T = 4 s; Siconos runs in an interpreter of its own, its start not counted.
The first route is one solver call per step driven from Python, the second the simulation interface
that its own example of this ball uses. Correct: at rest from 2.444 s.

{_peers(figures)}

## Instructions of one step

Counted by callgrind on `crates/zivi/examples/step_cost.rs` as the difference of two runs, less an
empty call.

{_instructions(figures)}
"""
