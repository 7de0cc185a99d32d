"""A study that outgrows a machine: on a cluster, stopped half-way, continued by the same call.

The time of rest of a ball over restitution and initial speed, 10,000 runs in tasks of 500. Give
the address of a Dask scheduler for a real cluster; without one, two threads stand in for its
workers. Each task is one batch; only this process writes, so the workers share no file system. The
first session ends after eight tasks, as by Ctrl-C; the second computes the rest. Every value is
compared with the closed form, ``(v + sqrt(v^2 + 2 g) (1 + e)/(1 - e))/g``.

Run as ``python examples/cluster_study.py out.png [SCHEDULER:8786]`` (extras `dask` and `plot`).
"""

import concurrent.futures
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import zivi

GRAVITY = 9.81
GRID = {"e": np.linspace(0.05, 0.95, 100), "v": np.linspace(0.0, 4.0, 100)}
CHUNK = 500
TASKS_OF_THE_FIRST_SESSION = 8


def rest_times(e: np.ndarray, v: np.ndarray) -> dict[str, np.ndarray]:
    """Simulate the points of a task in one batch, on one thread of a worker."""
    ball = zivi.ImpactSystem(-GRAVITY, e=0.5)
    starts = np.column_stack([np.ones(len(v)), v])
    batch = zivi.simulate_batch(ball, (0, 60), starts, parameters={"e": e}, threads=1)
    return {"rest_time": batch.rest_time}


def exact(e: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Give the closed form."""
    return (v + np.sqrt(v**2 + 2 * GRAVITY) * (1 + e) / (1 - e)) / GRAVITY


class FirstSession(concurrent.futures.ThreadPoolExecutor):
    """A pool that somebody stops once its first tasks are done."""

    def __init__(self, workers: int) -> None:
        """Count the tasks of the session."""
        super().__init__(workers)
        self.tasks: list[concurrent.futures.Future[Any]] = []

    def submit(self, *call: Any, **named: Any) -> concurrent.futures.Future[Any]:
        """Take a task, unless the session is over."""
        if len(self.tasks) == TASKS_OF_THE_FIRST_SESSION:
            concurrent.futures.wait(self.tasks)
            raise KeyboardInterrupt
        self.tasks.append(super().submit(*call, **named))
        return self.tasks[-1]


def study(folder: Path, executor: Any) -> zivi.Study:
    """Compute what is missing; the same call in every session."""
    return zivi.sweep(
        rest_times,
        GRID,
        vectorized=True,
        chunk=CHUNK,
        out=folder,
        executor=executor,
        units={"v": "m/s", "rest_time": "s"},
    )


def main(out: str, scheduler: str | None = None) -> None:
    """Run both sessions and draw the map."""
    import matplotlib.pyplot as plt

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place, "rest.zarr")
        try:
            with FirstSession(2) as pool:
                study(folder, pool)
        except KeyboardInterrupt:
            begun = zivi.open_study(folder)
            print(f"stopped: {int((begun.status == 1).sum())} of {begun.status.size} points")
        if scheduler:
            from distributed import Client

            with Client(scheduler) as cluster:
                study(folder, cluster)
        else:
            with concurrent.futures.ThreadPoolExecutor(2) as pool:
                study(folder, pool)
        found = zivi.open_study(folder)
        rest = found.rest_time.transpose("e", "v").values
        print(f"continued: {int((found.status == 1).sum())} of {found.status.size} points")
    off = np.abs(rest / exact(*np.meshgrid(GRID["e"], GRID["v"], indexing="ij")) - 1).max()
    print(f"largest relative error: {off:.0e}")

    plt.style.use("zivi.plot.figures")
    figure, ax = plt.subplots(figsize=(6, 4), layout="constrained")
    levels = [0.6, 1, 1.5, 2, 3, 5, 10]
    lines = ax.contour(GRID["v"], GRID["e"], rest, levels, cmap="viridis", norm="log")
    ax.clabel(lines, fmt="%g s")
    ax.set(xlabel="initial speed upwards (m/s)", ylabel="coefficient of restitution $e$")
    ax.set_title("Time of rest of a ball dropped from 1 m", fontsize="medium")
    figure.savefig(out, dpi=150)


if __name__ == "__main__":
    main(*sys.argv[1:])
