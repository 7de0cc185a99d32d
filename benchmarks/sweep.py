"""What a study costs beside a bare loop: `python benchmarks/sweep.py [repetitions]`."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import zivi
from zivi.study import EXPERIMENTS

WORKERS = 2


def product(x: float, y: float) -> float:
    return x * y


def bounces(x: float, y: float) -> dict[str, float]:
    """Four seconds of a ball in 20,000 steps."""
    return EXPERIMENTS["ball_rest_time"](e=0.3 + 0.2 * x, v0=y, h=1e-4)


def points(number: int) -> dict[str, Any]:
    """Make a square grid of so many points."""
    side = round(number**0.5)
    return {"x": np.linspace(0.0, 1.0, side), "y": np.linspace(0.0, 1.0, side)}


def bare(function: Callable[..., Any], grid: dict[str, Any]) -> float:
    """Time the loop that one would write by hand, results in a list."""
    xs, ys = (grid[name].tolist() for name in ("x", "y"))
    start = time.perf_counter()
    results = [function(x, y) for x in xs for y in ys]
    took = time.perf_counter() - start
    assert len(results) == len(xs) * len(ys)
    return took


def swept(function: Callable[..., Any], grid: dict[str, Any], **how: Any) -> float:
    """Time a study, from the call to the results."""
    start = time.perf_counter()
    study = zivi.sweep(function, grid, **how)
    took = time.perf_counter() - start
    assert np.all(study.status == 1)
    return took


@contextmanager
def executors() -> Iterator[dict[str, dict[str, Any]]]:
    """Who computes; the cluster is there before the clock starts."""
    kinds: dict[str, dict[str, Any]] = {
        "this thread": {},
        f"{WORKERS} threads": {"executor": "threads", "workers": WORKERS},
        f"{WORKERS} processes, with their start": {"executor": "processes", "workers": WORKERS},
    }
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        yield kinds
        return
    with (
        LocalCluster(
            n_workers=WORKERS, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        Client(cluster) as client,
    ):
        client.run(lambda: __import__("zivi"))
        yield kinds | {f"Dask, {WORKERS} worker processes": {"executor": client}}


def measure(function: Callable[..., Any], number: int, repetitions: int) -> list[tuple[str, ...]]:
    """Time all in turn; the best round counts, since others use the machine."""
    grid = points(number)
    times: dict[str, list[float]] = {}
    with executors() as kinds, tempfile.TemporaryDirectory() as folder:
        for repetition in range(repetitions):
            times.setdefault("bare loop", []).append(bare(function, grid))
            times.setdefault("this thread, in memory", []).append(swept(function, grid))
            for name, how in kinds.items():
                out = Path(folder) / f"{name} {repetition}".replace(" ", "_")
                took = swept(function, grid, out=out, **how)
                times.setdefault(f"{name}, into a folder", []).append(took)
    loop = min(times["bare loop"])
    return [
        (
            name,
            f"{number / (took := min(values)):,.0f}",
            f"{took / loop:.2f}",
            f"{(took - loop) / number * 1e6:+.1f}",
        )
        for name, values in times.items()
    ]


def main() -> None:
    repetitions = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    for title, function, number in (
        ("10,000 products", product, 10_000),
        ("250,000 products", product, 250_000),
        ("2,500 balls", bounces, 2_500),
    ):
        print(f"\n{title}\n")
        head = ("who", "points/s", "time to the bare loop", "more per point (us)")
        rows = [head, ("---", "---:", "---:", "---:"), *measure(function, number, repetitions)]
        print("\n".join("| " + " | ".join(row) + " |" for row in rows), flush=True)


if __name__ == "__main__":
    main()
