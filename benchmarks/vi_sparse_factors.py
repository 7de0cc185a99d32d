"""SuperLU beside an LDL' with AMD (QDLDL, as in Clarabel) on the symmetric form of both stages.

    python benchmarks/vi_sparse_factors.py

CPU seconds of the first factorisation, of one with other values on the same pattern, of a solve,
and the entries of the factors, L alone for LDL'. SuperLU with an order of minimum degree of its
own, found each time, and as zivi uses it, by AMD once, with the error of each solve estimated.
Needs the package `qdldl`, which is not required.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from vi_sparse_problems import large_vi
from zivi.vi.factorisation import Factoriser

HEAD = ("matrix", "factors", "first (s)", "again (s)", "solve (s)", "entries", "backward error")
SIZES = (100, 200, 300, 500)

Found = TypeVar("Found")


def timed(work: Callable[[], Found]) -> tuple[Found, float]:
    """Return what `work` returns, and the CPU seconds that it took."""
    began = time.process_time()
    found = work()
    return found, time.process_time() - began


def compared(name: str, M: Any) -> list[tuple[str, ...]]:
    """Return a row for each library."""
    import qdldl

    rng = np.random.default_rng(0)
    c = np.ravel(abs(M).max(axis=1).toarray())
    one, other = (
        sp.csc_matrix(M + sp.diags_array(c * 10 ** rng.uniform(-6, 6, len(c)))) for _ in range(2)
    )
    b = rng.normal(size=len(c))
    how: dict[str, Any] = {
        "permc_spec": "MMD_AT_PLUS_A",
        "diag_pivot_thresh": 0.0,
        "options": {"SymmetricMode": True},
    }

    def row(library: str, x: Any, entries: int, *seconds: float) -> tuple[str, ...]:
        error = np.max(np.abs(one @ x - b) / (abs(one) @ np.abs(x) + np.abs(b)))
        return name, library, *(f"{it:.3f}" for it in seconds), f"{entries}", f"{error:.0e}"

    lu, first = timed(lambda: splu(one, **how))
    again = timed(lambda: splu(other, **how))[1]
    x, solve = timed(lambda: lu.solve(b))
    rows = [row("SuperLU alone", x, lu.nnz, first, again, solve)]
    factoriser = Factoriser(lambda: None)
    factoriser.see_pattern(one.tocsr())
    factors, first = timed(lambda: factoriser.factors_of(one))
    x, solve = timed(lambda: factors.solve(b))
    again = timed(lambda: factoriser.factors_of(other))[1]
    rows.append(row("SuperLU", x, factoriser.fill, first, again, solve))
    ldl, first = timed(lambda: qdldl.Solver(one))
    x, solve = timed(lambda: ldl.solve(b))
    again = timed(lambda: ldl.update(other))[1]
    return [*rows, row("QDLDL", x, ldl.factors()[0].nnz, first, again, solve)]


def rows() -> list[tuple[str, ...]]:
    """Return all rows; none without `qdldl`."""
    if importlib.util.find_spec("qdldl") is None:
        return []
    found = []
    for side in SIZES:
        found += compared(f"obstacle {side}", large_vi.obstacle(side).M)
    return found + compared("discs 3136", large_vi.discs(32, 33).M)


if __name__ == "__main__":
    for it in rows():
        print(*it, sep="  ")
