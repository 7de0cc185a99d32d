"""Exact flights of a linear system that a table shakes, beside the embedded pair.

    python benchmarks/linear_table.py

20 s of a chain of 3 masses between two stops, shaken by a table of 100 values a second: time of
the processor of a run (the best of 20), evaluations of the pair at 1e-6, and by how much its first
ten impacts differ. None has to be told of the knots.
"""

import time

import numpy as np

import zivi
from linear_gain import chain

OFFSETS = (0.05, 0.3, 3.0)


def excitation() -> tuple[np.ndarray, np.ndarray]:
    """Return the times, and loads that wander and have no mean over a second."""
    t = np.arange(0, 20.005, 0.01)
    load = np.cumsum(np.random.default_rng(3).normal(size=len(t))) * 2
    load -= np.convolve(load, np.ones(100) / 100, "same")
    return t, np.outer(load, np.ones(3))


def row(kind: str, offset: float) -> str:
    """Tell a line of the table."""
    last, free = np.eye(3)[-1], chain(3, 1.0)
    gaps = [zivi.LinearGap(-last, offset), zivi.LinearGap(last, offset)]
    table = zivi.Table(*excitation(), kind=kind)
    system = zivi.LinearSystem(free.M, free.C, free.K, excitation=table, gaps=gaps, e=0.6)
    rest, best = (np.zeros(3), np.zeros(3)), np.inf
    for _ in range(20):
        began = time.process_time()
        exact = zivi.simulate(system, (0, 20), rest, t_eval=[20.0], dense_output=False)
        best = min(best, time.process_time() - began)
    method = zivi.SwitchedRK(flights="rk", rtol=1e-6, atol=1e-6)
    pair = zivi.simulate(system, (0, 20), rest, method, dense_output=False)
    times = [run.resolved_impacts["t"][:10] for run in (exact, pair)]
    apart = f"{np.abs(times[0] - times[1]).max():.1e} s" if len(times[0]) else "none"
    return (
        f"{kind}, stops at {offset} m: {1e3 * best:.2f} ms, {exact.n_steps} steps, "
        f"{len(exact.resolved_impacts)} impacts; pair {pair.nfev} evaluations, apart {apart}"
    )


if __name__ == "__main__":
    for kind in ("linear", "cubic"):
        for offset in OFFSETS:
            print(row(kind, offset), flush=True)
