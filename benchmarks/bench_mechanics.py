"""Mechanical systems beside Siconos: error over work (`benchmarks/results/mechanics.md`)."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import time
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import zivi
import zivi.symbolic
from mechanics_problems import PROBLEMS, STEPS, TRUTH
from report import cpu, table
from siconos_peer import TIMEOUT, interpreter

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE = Path(__file__).resolve().parent / "results" / "mechanics.md"
FIGURE = DOCS / "figures" / "work_mechanics.png"
TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
ROUNDS = 5
RK, OWN, PEER = "SwitchedRK, order 8", "zivi's MoreauJean", "Siconos, MoreauJeanOSI"


@dataclasses.dataclass(frozen=True)
class Run:
    """One run: its setting, its work, its time of the processor and its error."""

    setting: float
    work: int
    seconds: float
    error: float


def system(given: Mapping[str, Any]) -> zivi.MechanicalSystem:
    """Give a problem by its energy and forces, compiled."""
    n = range(len(given["force"]))
    q, w = [f"x{i}" for i in n], [f"x{i}dot" for i in n]

    def product(row: Sequence[float], names: Sequence[str]) -> str:
        return " + ".join(f"{a!r}*{name}" for a, name in zip(row, names, strict=True))

    return zivi.symbolic.system(
        q,
        T=" + ".join(f"{w[i]}*({product(given['mass'][i], w)})/2" for i in n),
        Q=[f"{given['force'][i]!r} - ({product(given['damping'][i], w)})" for i in n],
        gaps=[
            f"{product(normal, q)} + {offset!r}"
            for normal, offset in zip(given["normals"], given["offsets"], strict=True)
        ],
        e=given["e"],
    )


def ours(name: str, end: float, method: Any, setting: float) -> Run:
    """Run zivi; the time is the least of some rounds."""
    given = PROBLEMS[name]
    model, took = system(given), []
    for _ in range(ROUNDS):
        begun = time.process_time()
        with warnings.catch_warnings():  # that the e differ
            warnings.simplefilter("ignore", RuntimeWarning)
            sol = zivi.simulate(model, (0, end), given["start"], method, dense_output=False)
        took.append(time.process_time() - begun)
    state = np.concatenate([sol.q[-1], sol.qdot[-1]])
    steps = sol.n_steps if isinstance(method, zivi.MoreauJean) else sol.nfev
    error = float(np.abs(state - TRUTH[name][end]).max())
    return Run(setting, steps, min(took), error)


def theirs(python: str, name: str) -> dict[float, list[Run]]:
    """Run Siconos in the interpreter that has it."""
    found: dict[float, list[Run]] = {end: [] for end in TRUTH[name]}
    for step in STEPS:
        rounds = []
        for _ in range(ROUNDS):
            done = subprocess.run(
                [python, Path(__file__).with_name("siconos_mechanics.py"), name, str(step)],
                capture_output=True,
                text=True,
                timeout=TIMEOUT,
                check=True,
            )
            (line,) = (it for it in done.stdout.splitlines() if it.startswith("FIGURES "))
            rounds.append(json.loads(line.removeprefix("FIGURES ")))
        for k, row in enumerate(rounds[0]):
            took = min(rows[k]["seconds"] for rows in rounds)
            found[row["end"]].append(Run(step, row["steps"], took, row["error"]))
    return found


def measure() -> dict[tuple[str, float], dict[str, list[Run]]]:
    """Run everything."""
    python = interpreter()
    figures: dict[tuple[str, float], dict[str, list[Run]]] = {}
    for name, ends in TRUTH.items():
        peer = None if python is None else theirs(python, name)
        for end in ends:
            runs = {
                RK: [ours(name, end, zivi.SwitchedRK(rtol=t, atol=t), t) for t in TOLERANCES],
                OWN: [ours(name, end, zivi.MoreauJean(h=h), h) for h in STEPS],
            }
            figures[name, end] = runs if peer is None else runs | {PEER: peer[end]}
    return figures


HEAD = """# Mechanical systems beside Siconos

Written by `make bench`; do not edit. One run on a shared machine: {cpu}. Times are of the
processor, the least of {rounds} rounds; steps, evaluations and errors are the same in every run.

[Siconos](https://nonsmooth.gricad-pages.univ-grenoble-alpes.fr/siconos/) {version}steps in
time with Moreau and Jean's scheme (`MoreauJeanOSI(0.5)`, `NewtonImpactNSL`, `LCP`), as its own
examples do; `zivi.MoreauJean` is the same scheme. All take the coefficients of restitution as
they are given, one for each gap. Problems (`benchmarks/mechanics_problems.py`):

{problems}

The error is the largest of all coordinates and velocities at a time between impacts, where the
order and the times of all impacts before count, and at a time after the last accumulation, where
all is at rest. The truth was computed by brute force with 45 digits (`tests/brute_force`). zivi
integrates a compiled system (`zivi.symbolic`); its compilation is not counted.

MuJoCo and Drake were not used: their contacts are soft, or have no coefficient of restitution,
and solve another problem.

![Error over the time of the processor](../../docs/figures/work_mechanics.png)

Between the impacts both motions are polynomials or nearly so: a Runge-Kutta pair of order 8 has
next to no error there, and what is seen is how impacts and accumulations are passed. A step of the
time stepping that contains an impact is wrong by the order of its length. That the errors of
`zivi.MoreauJean` are those of Siconos says that both solve the same steps.
"""


def version(python: str | None) -> str:
    """Give the version of Siconos, with a blank."""
    if python is None:
        return ""
    done = subprocess.run(
        ["dpkg-query", "-W", "-f", "${Version}", "python3-siconos"], capture_output=True, text=True
    )
    return f"({done.stdout.partition('+')[0]}, Debian) " if done.returncode == 0 else ""


def page(figures: Mapping[tuple[str, float], Mapping[str, Sequence[Run]]]) -> str:
    """Write the page."""
    problems = "\n".join(f"- {name}: {given['what']}" for name, given in PROBLEMS.items())
    parts = [
        HEAD.format(cpu=cpu(), rounds=ROUNDS, version=version(interpreter()), problems=problems)
    ]
    for (name, end), runs in figures.items():
        rest = not any(TRUTH[name][end])
        rows = [
            (
                method,
                f"{run.setting:g}",
                f"{run.work}",
                f"{1e3 * run.seconds:.2f}",
                "0" if run.error == 0.0 else f"{run.error:.1e}",
            )
            for method, them in runs.items()
            for run in them
        ]
        parts.append(f"## {name}, t = {end:g} s{', at rest' if rest else ''}\n")
        parts.append(
            table(("", "tolerance or step (s)", "evaluations or steps", "ms", "error"), rows)
        )
        parts.append("")
    if not any(PEER in runs for runs in figures.values()):
        parts.append("Siconos was not found.\n")
    return "\n".join(parts)


def draw(figures: Mapping[tuple[str, float], Mapping[str, Sequence[Run]]]) -> None:
    """Draw error over time, between impacts."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    shown = {key: runs for key, runs in figures.items() if any(TRUTH[key[0]][key[1]])}
    styles = {RK: (zivi.plot.BLUE, "o"), OWN: (zivi.plot.ORANGE, "v"), PEER: (zivi.plot.GREEN, "s")}
    figure, axes = plt.subplots(1, len(shown), layout="constrained", figsize=(9.6, 3.6))
    for ax, ((name, end), runs) in zip(axes, shown.items(), strict=True):
        for method, them in runs.items():
            colour, marker = styles[method]
            times, errors = zip(
                *((1e3 * it.seconds, max(it.error, 1e-17)) for it in them), strict=True
            )
            ax.loglog(times, errors, color=colour, marker=marker, label=method)
        ax.set(title=f"{name}, t = {end:g} s", xlabel="processor time (ms)")
    axes[0].set_ylabel("error of the state (m, m/s)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    figure.savefig(FIGURE, dpi=140)
    plt.close(figure)


def write() -> str:
    """Measure, draw and write the page."""
    figures = measure()
    draw(figures)
    text = page(figures)
    PAGE.write_text(text)
    return text


if __name__ == "__main__":
    print(write())
