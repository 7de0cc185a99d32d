"""What users wait for, beside what they would use instead: `python benchmarks/waits.py`.

Every row is a ratio of two times of the processor that were measured in turns in one run; below 1
zivi is the faster one. SciPy's `solve_ivp` restarts at events and gets stuck at a Zeno point: it is
compared where there is none.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.integrate

import zivi

PAGE = Path(__file__).with_name("results") / "waits.md"
ROUNDS = 15
HEAD = """# What users wait for

Written by `make bench` (alone: `python benchmarks/waits.py`); do not edit. Ratios of times of the
processor, measured in turns in one run, the median of the rounds; below 1 zivi is faster.

| what | zivi | beside | zivi (ms) | beside (ms) | ratio |
| --- | --- | --- | ---: | ---: | ---: |
"""


class Row(NamedTuple):
    """A pair of functions that do the same."""

    what: str
    ours: str
    theirs: str
    run: Callable[[], Any]
    beside: Callable[[], Any]
    times: int


def _fall() -> Row:
    """Let a ball fall to its first impact."""
    ball = zivi.ImpactSystem(lambda t, x, v: -9.81 - 0.1 * v, e=0.5)

    def lands(t: float, y: Any) -> float:
        return float(y[0])

    lands.terminal = True  # type: ignore[attr-defined]
    lands.direction = -1  # type: ignore[attr-defined]

    def beside() -> Any:
        return scipy.integrate.solve_ivp(
            lambda t, y: [y[1], -9.81 - 0.1 * y[1]],
            (0, 0.6),
            (1, 0),
            "DOP853",
            events=lands,
            rtol=1e-6,
            atol=1e-9,
        )

    return Row(
        "a ball with drag, one impact, a force in Python",
        "`simulate`",
        "`solve_ivp`, DOP853, one event, without the flight after it",
        lambda: zivi.simulate(ball, (0, 0.6), (1, 0)),
        beside,
        20,
    )


def _pendulum() -> Row:
    """Swing a double pendulum that meets nothing."""
    system = zivi.symbolic.system(
        "a b",
        T="adot**2 + bdot**2/2 + adot*bdot*cos(a - b)",
        V="-2*g*cos(a) - g*cos(b)",
        gaps={"wall": "sin(a) + sin(b) + 10"},
        parameters={"g": 9.81},
        e=0.5,
    )

    def slopes(t: float, y: Any) -> Any:
        a, b, u, w = y
        c, s = np.cos(a - b), np.sin(a - b)
        mass = np.array([[2.0, c], [c, 1.0]])
        force = [-s * w**2 - 2 * 9.81 * np.sin(a), s * u**2 - 9.81 * np.sin(b)]
        return [u, w, *np.linalg.solve(mass, force)]

    return Row(
        "a double pendulum, 1 s",
        "`simulate`, from its energies, compiled",
        "`solve_ivp`, DOP853, its equations by hand in NumPy",
        lambda: zivi.simulate(system, (0, 1), ([0.5, 0.5], [0, 0])),
        lambda: scipy.integrate.solve_ivp(
            slopes, (0, 1), (0.5, 0.5, 0, 0), "DOP853", rtol=1e-6, atol=1e-9
        ),
        5,
    )


def _drawn() -> Row:
    """Sample a motion so that lines draw it."""
    force = zivi.LinearForce(stiffness=1, damping=0.05, gravity=0.2, amplitude=0.6, omega=0.9)
    system = zivi.ImpactSystem(force, e=0.7)
    return Row(
        "50 periods of an oscillator, drawn",
        "`simulate`",
        'the same with `samples="steps"`, `dense_output=False`',
        lambda: zivi.simulate(system, (0, 349), (1, 0)),
        lambda: zivi.simulate(system, (0, 349), (1, 0), samples="steps", dense_output=False),
        10,
    )


def _diagram() -> Row:
    """Make values of a bifurcation diagram."""
    table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    values = np.linspace(1.1, 1.5, 40)
    systems = [
        zivi.ImpactSystem(
            zivi.LinearForce(gravity=1.0, amplitude=float(a), phase=-np.pi / 2), e=0.5
        )
        for a in values
    ]
    starts = np.tile([0.3, 1.9], (len(values), 1))
    return Row(
        "40 values of a bifurcation diagram, 364 periods each",
        "`bifurcation_diagram`",
        "`simulate_batch` over the same periods, the ends alone",
        lambda: zivi.bifurcation_diagram(
            zivi.ImpactSystem(table, e=0.5),
            "amplitude",
            values,
            starts=(0.3, 1.9),
            threads=1,
            progress=False,
        ),
        lambda: zivi.simulate_batch(systems, (0, 364 * 2 * np.pi), starts, threads=1),
        2,
    )


def _loop() -> Row:
    """Close a loop, and do the same by hand."""
    plant = zivi.ImpactSystem(-9.81, e=1 / 3)
    h, n = 1e-3, 2000

    def tracker() -> Any:
        return zivi.TwistingTracker(30, 17, h=h, e=1 / 3)

    def by_hand() -> None:
        controller = tracker()
        controller.reset(3.0, 3.0)
        x, v = 6.0, 5.0
        for _ in range(n):
            u = controller.step(x, v, force=-9.81, force_ref=-19.81)
            x, v = x + h * v, v + h * (u - 9.81)
            if x < 0.0 and v < 0.0:
                x, v = 0.0, -v / 3

    return Row(
        "2000 periods of a closed loop",
        "`simulate_closed_loop`, exact flights",
        "a loop in Python around `step`, Euler's step for the plant",
        lambda: zivi.simulate_closed_loop(
            plant, tracker(), (0, n * h), (6, 5), y_ref0=(3, 3), force_ref=-19.81
        ),
        by_hand,
        5,
    )


def _avi() -> Row:
    """Solve a complementarity problem, and one linear system of its size."""
    source = np.random.default_rng(1)
    a = source.standard_normal((400, 400))
    M, q = a @ a.T / 400 + np.eye(400), source.standard_normal(400)
    return Row(
        "a complementarity problem, n = 400, half of it active",
        "`solve_lcp`",
        "`numpy.linalg.solve` of the whole matrix, one thread",
        lambda: zivi.solve_lcp(M, q),
        lambda: np.linalg.solve(M, q),
        3,
    )


def _import(other: str) -> Row:
    def start(program: str) -> Callable[[], Any]:
        return lambda: subprocess.run([sys.executable, "-c", program], check=True)

    ours, theirs = "from zivi import simulate", f"import {other}"
    return Row(f"`{ours}`", "a fresh process", f"`{theirs}`", start(ours), start(theirs), 1)


def _help() -> Row:
    program = [sys.executable, "-m", "zivi", "--help"]
    return Row(
        "`zivi --help`",
        "a fresh process",
        "`import numpy`",
        lambda: subprocess.run(program, check=True, stdout=subprocess.DEVNULL),
        lambda: subprocess.run([sys.executable, "-c", "import numpy"], check=True),
        1,
    )


def measured(row: Row) -> tuple[float, float, float]:
    """Give both times (ms) and the median of the ratios."""
    children = row.ours == "a fresh process"
    clock = _of_children if children else time.process_time
    pairs = []
    for k in range(ROUNDS + 1):
        times = []
        for run in (row.run, row.beside):
            start = clock()
            for _ in range(row.times):
                run()
            times.append((clock() - start) / row.times)
        if k:
            pairs.append(times)
    ours, theirs = (1e3 * min(column) for column in zip(*pairs, strict=True))
    return ours, theirs, statistics.median(a / b for a, b in pairs)


def _of_children() -> float:
    import resource

    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def write() -> str:
    """Measure every row into the page of results."""
    rows = [_fall(), _pendulum(), _drawn(), _diagram(), _loop(), _avi()]
    rows += [_import("numpy"), _import("scipy.integrate"), _help()]
    text = HEAD
    for row in rows:
        ours, theirs, ratio = measured(row)
        line = f"| {row.what} | {row.ours} | {row.theirs} "
        text += f"{line}| {ours:.3g} | {theirs:.3g} | {ratio:.2g} |\n"
        print(f"{row.what}: {ours:.3g} ms, {theirs:.3g} ms, {ratio:.2g}", flush=True)
    PAGE.write_text(text)
    return text


if __name__ == "__main__":
    write()
