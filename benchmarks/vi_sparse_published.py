"""The published problems with sparse Jacobians, beside the dense solver, and with wrong slopes.

    python benchmarks/vi_sparse_published.py [starts]

Each from its own starts and from random ones (6 by default). An end counts as false where it is
called solved and the natural residual, written anew, is above the tolerance.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

import zivi

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
from mcp import PROBLEMS, Problem

SPARSE = zivi.VIOptions(linear_algebra="sparse")
WRONG = zivi.VIOptions(linear_algebra="sparse", restarts=0)
LIMIT = 20.0


@dataclasses.dataclass
class Count:
    """Over starts: solved by the dense and by the sparse solver, and with slopes that are wrong."""

    starts: int = 0
    dense: int = 0
    sparse: int = 0
    lost: int = 0
    """Solved by the dense solver alone."""
    wrong: int = 0
    """Called solved with wrong slopes."""
    false: int = 0
    """Of all these, called solved without being it."""


def starts(problem: Problem, random: int, rng: Any) -> Iterator[np.ndarray]:
    """Return a problem's own starts, then random ones around them."""
    own = [np.asarray(x, float) for x in problem.starts]
    yield from own
    for k in range(random):
        far = 10 ** rng.uniform(-1, 2) * rng.normal(size=problem.n)
        yield np.clip(own[k % len(own)] + far, problem.lower, problem.upper)


def is_false(problem: Problem, res: zivi.VIResult) -> bool:
    """Whether an end is called solved and is not."""
    return res.success and not problem.residual(res.x) <= 1.01 * max(res.tolerance, 1e-9)


def campaign(problems: list[Problem], random: int, seed: int = 0) -> Count:
    """Solve all."""
    rng, count = np.random.default_rng(seed), Count()
    for p in problems:
        for x0 in starts(p, random, rng):
            off = 1 + 10 ** rng.uniform(-2, 1) * rng.normal(size=(p.n, p.n))

            def wrong(x: np.ndarray, p: Problem = p, off: np.ndarray = off) -> Any:
                return sp.csr_array(p.jac(x) * off)

            def right(x: np.ndarray, p: Problem = p) -> Any:
                return sp.csr_array(p.jac(x))

            box = p.F, p.lower, p.upper, x0
            with np.errstate(all="ignore"):
                dense = zivi.solve_vi(*box, jac=p.jac, time_limit=LIMIT)
                sparse = zivi.solve_vi(*box, jac=right, options=SPARSE, time_limit=LIMIT)
                misled = zivi.solve_vi(*box, jac=wrong, options=WRONG, time_limit=LIMIT)
                count.false += sum(is_false(p, it) for it in (dense, sparse, misled))
            count.starts += 1
            count.dense += dense.success
            count.sparse += sparse.success
            count.lost += dense.success and not sparse.success
            count.wrong += misled.success
    return count


if __name__ == "__main__":
    print(campaign(PROBLEMS, int(sys.argv[1]) if len(sys.argv) > 1 else 6))
