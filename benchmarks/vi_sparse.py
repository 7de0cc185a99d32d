"""Large sparse VIs at full size: factorisations, time, residual, memory.

    python benchmarks/vi_sparse.py [--small]

Grids of 300 x 300 from afar and by a cascade, of 700 x 700 by a cascade, an option, prices and a
pile of discs, all of ``examples/large_vi.py``; ``--small`` takes a tenth of each side.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import zivi

sys.path.append(str(Path(__file__).parents[1] / "examples"))
import large_vi


def scaled_residual(M: Any, F: Any, x: Any, lower: Any, upper: Any) -> float:
    """Return the natural residual with the rows scaled to 1, written anew."""
    F = F / abs(M).max(axis=1).toarray().ravel()
    return float(np.max(np.abs(np.maximum(x - upper, np.minimum(x - lower, F)))))


def line(name: str, solve: Callable[[], zivi.VIResult], check: Callable[[Any], float]) -> None:
    """Solve, and print what it took; the memory is the most that the process has had so far."""
    began = time.process_time()
    res = solve()
    took = time.process_time() - began
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{name:24} {len(res.x):8d} {res.status.name:20} {res.stage:3} {res.n_factorisations:4d} "
        f"{took:8.2f} s {check(res.x):9.1e} {16 * res.fill / 2**20:7.0f} {most:7.0f} MiB",
        flush=True,
    )


def affine(name: str, p: large_vi.Linear, start: Any = None) -> None:
    """Solve an affine problem."""
    line(
        name,
        lambda: zivi.solve_avi(*p, start),
        lambda x: scaled_residual(p.M, p.M @ x + p.q, x, p.lower, p.upper),
    )


def main() -> None:
    """Print a line for each problem."""
    part = 10 if "--small" in sys.argv else 1
    side = 300 // part
    print("problem, unknowns, status, stage, factorisations, CPU, residual, factors, most memory")
    for problem in (large_vi.obstacle, large_vi.torsion, large_vi.bearing):
        affine(problem.__name__, problem(side))
    affine("american_put", large_vi.american_put(100_000 // part))
    affine("discs", large_vi.discs(32 // min(part, 4), 33 // min(part, 4)))
    market = large_vi.Prices(100 // part, 100 // part)
    loss, jac, start = market.problem()
    line(
        "prices",
        lambda: zivi.solve_ncp(loss, start, jac=jac),
        lambda x: scaled_residual(jac(x), loss(x), x, 0.0, np.inf),
    )
    for problem in (large_vi.obstacle, large_vi.torsion):
        sides = [43 // part, 87 // part, 175 // part, 350 // part, 700 // part]
        coarse = large_vi.cascade(problem, sides[:-1])[-1]
        fine = large_vi.finer(coarse.x, sides[-1])
        affine(f"{problem.__name__}, cascade", problem(sides[-1]), fine)


if __name__ == "__main__":
    main()
