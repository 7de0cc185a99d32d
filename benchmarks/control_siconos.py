"""The six-sign VI of the tracker's step by Siconos, with F and its Jacobian in C, beside zivi."""

from __future__ import annotations

import dataclasses
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import cball
import instructions
from zivi.paper import tracking_steps
from zivi.paper.step_solvers import Array, Solver

SOURCE = Path(__file__).with_name("siconos_tracking.c")
HEADERS = Path("/usr/include/siconos")
TIMEOUT = 300.0
TOLERANCE = 1e-9
PASSES = 21
"""Over all steps within one run of the Rust program, which gives their median."""


@dataclasses.dataclass(frozen=True)
class Beside:
    """One set of steps by both. Times are of one step, in ns, medians over the rounds."""

    label: str
    steps: int
    tick: float
    """zivi's mean."""
    inner: float
    """The mean of zivi's general solver."""
    median: float
    mean: float
    """Siconos'."""
    ratio: float
    """Siconos' median to zivi's mean, in one round."""
    ratio_of_means: float
    failed: float
    """Steps that Siconos does not solve, in percent."""
    failed_tick: float
    failed_inner: float
    nfev: float
    """Median of the evaluations of F."""


def build(folder: Path) -> Path | str:
    """Compile the program, or say why not."""
    cc = cball.compiler()
    if cc is None:
        return "no C compiler"
    if not HEADERS.is_dir():
        return "libsiconos-numerics-dev is not installed"
    program = folder / "siconos_tracking"
    include = (f"-I{HEADERS}", f"-I{HEADERS / 'numerics'}")
    command = (cc, "-std=c99", "-Wall", "-Wextra", "-O3", *include, SOURCE, "-o", program)
    made = subprocess.run([*command, "-lsiconos_numerics", "-lm"], capture_output=True, text=True)
    return program if made.returncode == 0 else "its C program does not compile"


def _asked(states: Array, rows: Array) -> bytes:
    """Write the scheme, the number of steps and their rows, as both programs read them."""
    scheme = (
        tracking_steps.MU1,
        tracking_steps.MU2,
        tracking_steps.KAPPA,
        tracking_steps.KAPPA,
        tracking_steps.F,
        tracking_steps.F_REF,
        tracking_steps.H,
        len(states),
    )
    return np.concatenate([scheme, rows.ravel()]).tobytes()


def _siconos(program: Path, states: Array, starts: Array) -> Array:
    """Return the rows that the program writes."""
    asked = _asked(states, np.column_stack([states, starts]))
    run = subprocess.run(
        [program], input=asked, stdout=subprocess.PIPE, timeout=TIMEOUT, check=True
    )
    return np.frombuffer(run.stdout).reshape(len(states), -1)


def _tick(states: Array) -> float:
    """Return zivi's mean time (ns), measured within a Rust process on the same steps."""
    program = instructions.example("zivi-core", "tick_time")
    asked = _asked(states, states)
    command = (program, "steps", str(PASSES))
    run = subprocess.run(command, input=asked, stdout=subprocess.PIPE, check=True)
    return float(run.stdout)


def _inner(solve: Solver, states: Array, starts: Array) -> float:
    """Return the mean time of zivi's general solver (ns), called for all steps at once."""
    begin = time.perf_counter()
    solve(states, starts)
    return (time.perf_counter() - begin) / len(states) * 1e9


def _sets(problems: int) -> Iterator[tuple[str, Array, Array]]:
    states, signs = tracking_steps.loop_states("positive")
    own = tracking_steps.signs_of(states)
    yield "the paper's loop, last signs", states, np.vstack([own[:1], signs[:-1]])
    yield "the paper's loop, signs of the state", states, own
    for j, speed in enumerate(tracking_steps.SPEEDS):
        states = tracking_steps.random_loop_states(speed, seed=j, problems=problems)
        yield f"random, up to {speed:g} m/s", states, tracking_steps.signs_of(states)


def _percent(states: Array, signs: Array) -> float:
    return float(np.mean(tracking_steps.loop_residual(states, signs) > TOLERANCE) * 100.0)


def _beside(program: Path, label: str, states: Array, starts: Array, rounds: int) -> Beside:
    solvers = tracking_steps.loop_solvers()
    signs = {name: solvers[name](states, starts) for name in ("tick", "inner")}
    ticks, inner, theirs = [], [], []
    for _ in range(rounds):
        ticks.append(_tick(states))
        theirs.append(_siconos(program, states, starts))
        inner.append(_inner(solvers["inner"], states, starts))
    medians = [float(np.median(rows[:, 6])) for rows in theirs]
    averages = [float(np.mean(rows[:, 6])) for rows in theirs]
    last = theirs[-1]

    def ratio(values: list[float]) -> float:
        pairs = zip(values, ticks, strict=True)
        return float(np.median([other / own for other, own in pairs]))

    return Beside(
        label=label,
        steps=len(states),
        tick=float(np.median(ticks)),
        inner=float(np.median(inner)),
        median=float(np.median(medians)),
        mean=float(np.median(averages)),
        ratio=ratio(medians),
        ratio_of_means=ratio(averages),
        failed=_percent(states, last[:, :6]),
        failed_tick=_percent(states, signs["tick"]),
        failed_inner=_percent(states, signs["inner"]),
        nfev=float(np.median(last[:, 7])),
    )


def measure(problems: int, rounds: int) -> list[Beside] | str:
    """Solve every set with both, in turn, or say why not."""
    with tempfile.TemporaryDirectory() as folder:
        program = build(Path(folder))
        if isinstance(program, str):
            return program
        return [_beside(program, *it, rounds) for it in _sets(problems)]
