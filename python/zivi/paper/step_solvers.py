"""Sets of steps, their solvers (zivi, Siconos), and the residual for comparison."""

from __future__ import annotations

import dataclasses
import functools
import io
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

# Siconos' solvers for the step's VI, where a Python that has Siconos is found.
#
# Siconos is never required: without it there are no solvers here. It runs in processes of its own,
# because it may be installed for another interpreter, and because its solvers may not terminate.

Array = NDArray[np.float64]

SPEEDS = (1.0, 1e-1, 1e-2, 1e-3, 1e-4)
PROBLEMS = 500
"""Random problems for each speed (and step size)."""

SOLVERS = ("VI_BOX_AVI_LSA", "VI_BOX_QI")
ENVIRONMENT = "ZIVI_SICONOS_PYTHON"
"""Names the Python to try first."""

PROBE_TIMEOUT = 20.0
TIMEOUT = 120.0
"""Longest that one set of states may take (s)."""
ENDLESS_SOLVES = 10
"""Solves without an end after which the rest of a set counts as not solved."""


Solver = Callable[[Array, Array], Array]
"""Multipliers, row by row, for rows of states, each solve begun at its row of the starts. NaN where
the solver raised, crashed or did not end."""


def siconos_solvers(problem: str, *parameters: float) -> dict[str, Solver]:
    """Return Siconos' solvers of a step, by name; none without Siconos.

    Parameters
    ----------
    problem : {"ball", "tracking"}
        Which step.
    *parameters : float
        What its class in `PROBLEMS` of ``_siconos_steps.py`` is made from.
    """
    python = interpreter()
    if python is None:
        return {}

    def solver(name: str) -> Solver:
        return functools.partial(_siconos_solve, python, name, problem, parameters)

    return {f"Siconos {name}": solver(name) for name in SOLVERS}


def interpreter() -> str | None:
    """Find a Python that imports ``siconos.numerics``; each one is tried once per process."""
    names = (
        os.environ.get(ENVIRONMENT),
        "/usr/bin/python3",
        shutil.which("python3"),
        sys.executable,
    )
    return next((name for name in dict.fromkeys(names) if name and _has_siconos(name)), None)


@functools.cache
def _has_siconos(python: str) -> bool:
    try:
        probe = subprocess.run(
            [python, "-c", "import siconos.numerics"],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=PROBE_TIMEOUT,
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return probe.returncode == 0


def _siconos_solve(
    python: str,
    solver: str,
    problem: str,
    parameters: tuple[float, ...],
    states: Array,
    starts: Array,
) -> Array:
    """Solve for all states; continue after one that crashed the process."""
    multipliers = np.full_like(starts, np.nan)
    posed = {"solver": solver, "problem": problem, "parameters": np.array(parameters)}
    done = 0
    for _ in range(ENDLESS_SOLVES):
        asked = io.BytesIO()
        np.savez(asked, states=states[done:], starts=starts[done:], **posed)  # type: ignore[arg-type]
        written = _run_siconos_script(python, asked.getvalue(), starts.shape[1])
        multipliers[done : done + len(written)] = written
        done += len(written) + 1
        if done >= len(states):
            break
    return multipliers


def _run_siconos_script(python: str, asked: bytes, columns: int) -> Array:
    """Return the whole rows of doubles that the script wrote until it ended or was ended."""
    script = Path(__file__).with_name("_siconos_steps.py")
    # its dense algebra is 6 x 6 at most: more threads than one only get in each other's way
    alone = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        written = subprocess.run(
            [python, str(script)],
            input=asked,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=TIMEOUT,
            env=os.environ | alone,
        ).stdout
    except subprocess.TimeoutExpired as late:
        written = late.stdout or b""
    row = columns * np.dtype(np.float64).itemsize
    return np.frombuffer(written[: len(written) // row * row]).reshape(-1, columns)


# A set of steps to be solved by several solvers, and the residual that judges them all.


@dataclasses.dataclass(frozen=True)
class Steps:
    """Steps that are solved one by one.

    Parameters
    ----------
    problem : str
        Whose steps they are.
    label : str
        Which of them.
    states : ndarray
        What each starts from, row by row.
    starts : ndarray
        Where each solve begins; NaN where the last one has ended.
    solvers : dict
        By name.
    residual : callable
        Relative natural residual of multipliers for states, independent of the solvers.
    """

    problem: str
    label: str
    states: Array
    starts: Array
    solvers: dict[str, Solver]
    residual: Callable[[Array, Array], Array]


def worst_row_residual(rows: Iterable[tuple[Array, Array, Array]]) -> Array:
    """Return the worst row of ``lambda in sgn(z)``: 0 where all of them hold exactly.

    Each row is ``lambda``, ``z`` and the size of the terms of ``z``.
    """
    each = [np.maximum(lam - 1.0, np.minimum(lam + 1.0, -z / size)) for lam, z, size in rows]
    worst = np.max(np.abs(each), axis=0)
    return np.where(np.isnan(worst), np.inf, worst)
