"""Growth of time and memory with the size of an obstacle problem; memory over many solves."""

from __future__ import annotations

import dataclasses
import json
import math
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import numpy as np

import zivi
from zivi import _zivi

SIDES = (10, 15, 20, 25, 30)
ROUNDS = 5
ENOUGH = 0.5
"""Seconds to repeat small solves for."""
PIVOTING = zivi.VIOptions(active_set=False)
"""With the active set by Newton's method there would be no pivots to time."""
SOLVES = 1_000_000
WARMING_UP = 10_000


Problem: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Matrix, constant and lower bound."""


@dataclasses.dataclass(frozen=True)
class Size:
    """The obstacle problem on one grid."""

    n: int
    seconds: float
    """One solve in a fresh process."""
    pivots: int
    per_pivot: float
    """Seconds that one more pivot takes."""
    residual: float
    memory: int | None
    """Bytes that the first solve takes; None where that cannot be measured."""


def obstacle(side: int) -> Problem:
    """Put a membrane over a bump, on a square grid."""
    ticks = np.arange(1, side + 1) / (side + 1)
    x, y = np.meshgrid(ticks, ticks, indexing="ij")
    bump = np.maximum(0.0, 0.3 - 4 * ((x - 0.5) ** 2 + (y - 0.5) ** 2)).ravel()
    one = 2 * np.eye(side) - np.eye(side, k=1) - np.eye(side, k=-1)
    laplacian = np.kron(one, np.eye(side)) + np.kron(np.eye(side), one)
    return laplacian * (side + 1) ** 2, np.full(side * side, 5.0), bump


def _resident(field: str) -> int | None:
    """Return ``VmRSS`` (now) or ``VmHWM`` (the most so far) in bytes, where Linux tells them."""
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith(field + ":"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    return None


def one(side: int) -> Size:
    """Solve in this process, which should be fresh."""
    matrix, constant, lower = obstacle(side)
    zivi.solve_avi(np.eye(2), np.ones(2), 0, np.inf)
    before = None
    try:
        Path("/proc/self/clear_refs").write_text("5")  # forget the most so far
        before = _resident("VmRSS")
    except OSError:
        pass
    begin = time.perf_counter()
    result = zivi.solve_avi(matrix, constant, lower, np.inf, options=PIVOTING)
    seconds = time.perf_counter() - begin
    most = _resident("VmHWM")
    return Size(
        n=side**2,
        seconds=seconds,
        pivots=result.n_pivots,
        per_pivot=_per_pivot((matrix, constant, lower), result.n_pivots, seconds),
        residual=result.residual,
        memory=None if before is None or most is None else most - before,
    )


def _per_pivot(problem: Problem, needed: int, seconds: float) -> float:
    """Time solves that are stopped after a quarter and after three quarters of their pivots.

    The difference holds pivots only: no set-up, no factorisation at the end. It is small, so it is
    one of the shortest times of many.
    """
    matrix, constant, lower = problem
    shortest, done = [math.inf, math.inf], [0, 0]
    options = [
        zivi.VIOptions(
            total_pivots=budget,
            active_set=False,
            semismooth=False,
            proximal=False,
            descent_steps=False,
            restarts=0,
            enumerate_up_to=0,
        )
        for budget in (needed // 4, 3 * needed // 4)
    ]
    for _ in range(max(ROUNDS, round(ENOUGH / seconds))):
        for k in range(2):
            begin = time.perf_counter()
            result = zivi.solve_avi(matrix, constant, lower, np.inf, options=options[k])
            shortest[k] = min(shortest[k], time.perf_counter() - begin)
            done[k] = result.n_pivots
    return (shortest[1] - shortest[0]) / (done[1] - done[0])


def growth(sides: tuple[int, ...] = SIDES) -> list[Size]:
    """Solve every size in fresh processes, in turn; medians over the rounds."""
    runs: dict[int, list[Size]] = {side: [] for side in sides}
    for _ in range(ROUNDS):
        for side in sides:
            command = [sys.executable, str(Path(__file__).resolve()), str(side)]
            out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
            runs[side].append(Size(**json.loads(out)))
    return [
        dataclasses.replace(
            of[0],
            seconds=statistics.median(size.seconds for size in of),
            per_pivot=statistics.median(size.per_pivot for size in of),
        )
        for of in runs.values()
    ]


def exponent(n: list[int], values: list[float]) -> float:
    """Fit ``values ~ n^exponent``."""
    return float(np.polyfit(np.log(n), np.log(values), 1)[0])


@dataclasses.dataclass(frozen=True)
class Leak:
    """Memory over many small solves, and what a call costs (seconds)."""

    solves: int
    grew: int | None
    """Bytes."""
    extension: float
    """One affine solve by the extension."""
    avi: float
    """The same by `zivi.solve_avi`, which checks its arguments."""
    vi: float
    """The same by `zivi.solve_vi` with callbacks that do nothing but return an array."""
    nfev: int
    njev: int
    """Evaluations in the last."""


def leak(solves: int = SOLVES) -> Leak:
    """Solve an affine VI of two unknowns again and again."""
    matrix, lower, upper = np.array([[2.0, 1.0], [1.0, 2.0]]), np.full(2, -1.0), np.ones(2)
    constant, start, settings = np.array([-1.0, -4.0]), np.zeros(2), {"tol": 1e-9}
    at_start, at_end = constant, matrix @ np.array([0.0, 1.0]) + constant

    def by_extension() -> None:
        _zivi.solve_avi(matrix, constant, lower, upper, start, settings)

    def by_callbacks() -> zivi.VIResult:
        return zivi.solve_vi(
            lambda x: at_end if x[1] else at_start, lower, upper, start, jac=lambda x: matrix
        )

    _repeat(by_extension, WARMING_UP)
    before = _resident("VmRSS")
    extension = _repeat(by_extension, solves)
    after = _resident("VmRSS")
    last = by_callbacks()
    return Leak(
        solves,
        None if before is None or after is None else after - before,
        extension,
        _repeat(lambda: zivi.solve_avi(matrix, constant, lower, upper), WARMING_UP),
        _repeat(by_callbacks, WARMING_UP),
        last.nfev,
        last.njev,
    )


def _repeat(run: Callable[[], object], times: int) -> float:
    begin = time.perf_counter()
    for _ in range(times):
        run()
    return (time.perf_counter() - begin) / times


if __name__ == "__main__":
    print(json.dumps(dataclasses.asdict(one(int(sys.argv[1])))))
