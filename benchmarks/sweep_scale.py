"""Studies of many points: `python benchmarks/sweep_scale.py [points of the coordinator]`.

What a ball costs in a vectorized study beside the batch alone, in one run; files, opening and
memory of a million points; and the coordinator of a billion points, whose workers are simulated:
they hand over made-up results at once, so that all time is that of the coordinator.
"""

from __future__ import annotations

import concurrent.futures
import pickle
import resource
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import zivi
from zivi.study.outcome import Piece, Schema
from zivi.study.store import Chunks

BALLS, ROUNDS = 200_000, 5
BILLION = 10**9
RESULTS = 14
"""Numbers that a batch gives for a run."""


def balls(h: Any) -> Any:
    """Let balls fall from heights, in one thread."""
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    return zivi.simulate_batch(ball, (0, 3), np.column_stack([h, 0 * h]), threads=1)


def seconds(work: Callable[[], Any]) -> float:
    """Give the processor time of this process."""
    start = time.process_time()
    work()
    return time.process_time() - start


def ratios() -> None:
    """Compare a study with the batch in it, round by round."""
    heights = np.linspace(0.5, 1.5, BALLS)
    points = {"h": heights}
    found: list[tuple[float, float, float]] = []
    balls(heights)
    for _ in range(ROUNDS):
        folder = Path(tempfile.mkdtemp())
        alone = seconds(lambda: balls(heights))
        memory = seconds(lambda: zivi.sweep(balls, points, vectorized=True))
        stored = seconds(lambda f=folder: zivi.sweep(balls, points, vectorized=True, out=f / "a"))
        found.append((alone / BALLS * 1e6, memory / alone, stored / alone))
        shutil.rmtree(folder)
    alone_us, in_memory, in_folder = (statistics.median(it) for it in zip(*found, strict=True))
    print(f"the batch alone: {alone_us:.1f} us a ball")
    print(f"vectorized study: {in_memory:.2f} times that in memory, {in_folder:.2f} in a folder")


class Simulated(concurrent.futures.Executor):
    """Workers that have results at once; they come as from another process."""

    def __init__(self) -> None:
        numbers = np.random.default_rng(1).random(2**17)
        self._values = {f"r{k}": numbers for k in range(RESULTS)}
        self._schema = Schema(dict.fromkeys(self._values, ()), False, {})

    def submit(self, _: Any, /, job: Any, points: Any, columns: Any) -> Any:
        """Hand over what a task of these points would give."""
        values = {name: column[: len(points)] for name, column in self._values.items()}
        piece = Piece(self._schema, points, values, None, {}, points[:0], False, 0.5)
        done: concurrent.futures.Future[Piece] = concurrent.futures.Future()
        done.set_result(pickle.loads(pickle.dumps(piece)))
        return done


def nothing(a: Any, b: Any) -> Any:
    """Stand for a function that is not called."""
    raise AssertionError


def coordinator(number: int) -> None:
    """Drive a study and tell what a billion points would take."""
    side = round(number**0.5)
    points = {"a": np.arange(side, dtype=float), "b": np.arange(side, dtype=float)}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "a"
        took = seconds(
            lambda: zivi.sweep(
                nothing,
                points,
                vectorized=True,
                out=out,
                executor=Simulated(),
                in_flight=64,
                chunk=None,
            )
        )
        files = sum(it.is_file() for it in out.rglob("*"))
        start = time.perf_counter()
        zivi.open_study(out)
        opened = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    a_point = took / side**2
    shards = len(Chunks((1000, 1000, 1000), sharded=True, size=8 * RESULTS))
    print(
        f"coordinator, {side**2:,} points: {files} files, opened in {opened:.2f} s, "
        f"{a_point * 1e6:.2f} us a point, peak of the process {peak:.0f} MB"
    )
    print(
        f"a billion points: {shards * (RESULTS + 1):,} files of results, "
        f"{BILLION * a_point:.0f} s of the coordinator"
    )


if __name__ == "__main__":
    ratios()
    for size in (10**6, int(float(sys.argv[1])) if len(sys.argv) > 1 else 10**7):
        coordinator(size)
