"""Large sparse VIs at full size: factorisations, time, residual, memory.

    python benchmarks/vi_sparse.py [--small] [--write]

Grids of 300 x 300 from afar, of 700 x 700 by a cascade, an option, prices and a pile of discs, all
of ``examples/large_vi.py``, each in a process of its own; ``--small`` takes a tenth of each side,
``--write`` makes ``benchmarks/results/vi_sparse.md``.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu

import zivi
from report import cpu, table

sys.path.append(str(Path(__file__).parents[1] / "examples"))
import large_vi

PAGE = Path(__file__).resolve().parent / "results" / "vi_sparse.md"
NAMES = (
    "obstacle", "torsion", "bearing", "american_put", "discs", "prices",
    "obstacle, cascade", "torsion, cascade",
)  # fmt: skip
HEAD = (
    "problem", "unknowns", "status", "stage", "factorisations", "CPU (s)", "of one factorisation",
    "residual", "factors (MiB)", "added at the peak (MiB)",
)  # fmt: skip
TEXT = """# Large sparse variational inequalities

Written by `python benchmarks/vi_sparse.py --write`; do not edit. One run, one thread, on a shared
machine: {cpu}. Counts do not depend on the machine, times do.

Grids of 300 x 300 from the default start, and of 700 x 700 from the solution on one of 350 x 350
(the factorisations are those on the finest grid). The residual has its rows scaled to 1 and is
written anew. "Of one factorisation" is the time of the solve over that of one factorisation of the
whole matrix at the start by SuperLU; factors are 16 bytes an entry; the memory is what the solve
adds to the peak of its process.

{table}
"""


def peak() -> float:
    """Return the most memory that the process has had (MiB)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def scaled_residual(M: Any, F: Any, x: Any, lower: Any, upper: Any) -> float:
    """Return the natural residual with the rows scaled to 1, written anew."""
    F = F / abs(M).max(axis=1).toarray().ravel()
    return float(np.max(np.abs(np.maximum(x - upper, np.minimum(x - lower, F)))))


def solved(name: str, part: int) -> tuple[str, ...]:
    """Solve one, and return its row of the table."""
    start = None
    if name == "prices":
        market = large_vi.Prices(100 // part, 100 // part)
        loss, jac, start = market.problem()
        M, lower, upper = jac(start), 0.0, np.inf
    else:
        p = affine(name, part)
        if name.endswith("cascade"):
            problem = getattr(large_vi, name.split(",")[0])
            sides = [side // part for side in (43, 87, 175, 350)]
            start = large_vi.finer(large_vi.cascade(problem, sides)[-1].x, 700 // part)
        M, lower, upper = p.M, p.lower, p.upper
    before, began = peak(), time.process_time()
    res = zivi.solve_ncp(loss, start, jac=jac) if name == "prices" else zivi.solve_avi(*p, start)
    took, most = time.process_time() - began, peak()
    began = time.process_time()
    splu(
        M.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    one = time.process_time() - began
    if name == "prices":
        M = jac(res.x)
    residual = scaled_residual(M, res.F, res.x, lower, upper)
    return (
        name, f"{len(res.x)}", res.status.name, res.stage, f"{res.n_factorisations}",
        f"{took:.2f}", f"{took / one:.0f}", f"{residual:.1e}", f"{16 * res.fill / 2**20:.1f}",
        f"{most - before:.0f}",
    )  # fmt: skip


def affine(name: str, part: int) -> large_vi.Linear:
    """Return an affine problem at its size."""
    if name == "discs":
        return large_vi.discs(32 // min(part, 4), 33 // min(part, 4))
    if name == "american_put":
        return large_vi.american_put(100_000 // part)
    side = 700 if name.endswith("cascade") else 300
    return getattr(large_vi, name.split(",")[0])(side // part)


def main() -> None:
    """Print a line for each problem, and write the page."""
    part = 10 if "--small" in sys.argv else 1
    if "--only" in sys.argv:
        print("\t".join(solved(sys.argv[sys.argv.index("--only") + 1], part)))
        return
    alone = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    rows = []
    for name in NAMES:
        run = [sys.executable, __file__, "--only", name, *sys.argv[1:]]
        told = subprocess.run(
            run, capture_output=True, text=True, check=True, env=os.environ | alone
        )
        rows.append(tuple(told.stdout.strip().split("\t")))
        print(*rows[-1], sep="  ", flush=True)
    if "--write" in sys.argv:
        PAGE.write_text(TEXT.format(cpu=cpu(), table=table(HEAD, rows)))


if __name__ == "__main__":
    main()
