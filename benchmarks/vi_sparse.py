"""Large sparse VIs at full size: factorisations, time, residual, memory; other solvers; sets.

    python benchmarks/vi_sparse.py [--small] [--write]

Grids of 300 x 300 from afar, of 700 x 700 from afar and by a cascade, an option, discs, markets, a
transport problem, each in a process of its own; ``--small`` takes a tenth of each side. ``--write``
adds the other solvers and the sets of problems and makes ``benchmarks/results/vi_sparse.md``.
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
import scipy.sparse as sp
from scipy.sparse.linalg import splu

import vi_families
import vi_sparse_factors
import vi_sparse_peers
import vi_sparse_problems
import vi_sparse_published
import zivi
from report import cpu, table
from vi_sparse_problems import large_vi

PAGE = Path(__file__).resolve().parent / "results" / "vi_sparse.md"
NAMES = (
    "obstacle", "torsion", "bearing", "american_put", "discs", "two_sided", "prices", "cournot",
    "transport", "obstacle, fine", "torsion, fine", "bearing, fine",
    "obstacle, cascade", "torsion, cascade", "bearing, cascade",
)  # fmt: skip
HEAD = (
    "problem", "unknowns", "status", "stage", "factorisations", "CPU (s)", "of one factorisation",
    "residual", "factors (MiB)", "one adds (MiB)", "the solve adds (MiB)",
)  # fmt: skip
TEXT = """# Large sparse variational inequalities

Written by `python benchmarks/vi_sparse.py --write`; do not edit. One run, one thread, on a shared
machine: {cpu}. Counts do not depend on the machine, times do.

Grids of 300 x 300 from the default start, of 700 x 700 from there ("fine") and from the solution on
one of 350 x 350, smoothed ("cascade", the factorisations are those on the finest grid). The
residual has its rows scaled to 1 and is written anew. "Of one factorisation" is the time of the
solve over that of one factorisation of the whole matrix by SuperLU with a diagonal that makes it
regular; factors are 16 bytes an entry; "one adds" is what that factorisation adds to the peak of
its process, which for little fill is far more than its entries; then what the solve adds. These two
are of a second run, in which freed memory goes back to the system at once, at the cost of time
(`MALLOC_MMAP_THRESHOLD_=131072`): by default glibc keeps some, which shows where little fills in.

{table}

## Other solvers

CPU seconds and the residual, written anew with the rows scaled to 1, at the point that is returned
(moved into the box). All were asked for 1e-9 within 30 s. Semismooth Newton is 40 lines on
the Fischer-Burmeister function with SciPy's SuperLU. Siconos' Newton method takes dense matrices
only, its Gauss-Seidel sparse ones, both without upper bounds. Clarabel and HiGHS take
symmetric matrices as quadratic programs, the transport problem as a linear one.

{peers}

## Factors

What an LDL' with AMD would gain on the symmetric form (`vi_sparse_factors.py`): CPU seconds of the
first factorisation, of one with other values on the same pattern, of a solve, and the entries of
the factors, of L alone for LDL'. "Alone" SuperLU finds an order of minimum degree anew each time;
here it is given one by AMD, which is kept, and its solves estimate their error.

{factors}

SuperLU was chosen: it comes with SciPy, takes matrices that are not symmetric, and works on dense
blocks. LDL' has half the entries and is up to twice as fast for ten thousand unknowns of a grid; at
90,000 the blocks have made up for that, and beyond SuperLU is faster.

## Sets of problems

The published problems of `tests/mcp` from their own starts and two random ones each
(`vi_sparse_published.py`): of {sets.starts} starts the dense solver solves {sets.dense}, the sparse
one {sets.sparse}; {sets.lost} are solved by the dense one alone. With slopes that are wrong by a
factor {sets.wrong} are called solved. {sets.false} of all these are false.

Random problems of the families of `vi_families.py`, eight of each size: with dense matrices, the
same without the smoothing Newton method before pivots, with sparse matrices.

{families}
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
    zivi.solve_lcp(sp.eye_array(400, format="csr"), np.linspace(-1, 1, 400))  # imports
    start = None
    if name in ("prices", "cournot"):
        loss, jac, lower, start = market(name, 100 // part)
        M, upper = jac(start), np.inf
    else:
        p = affine(name, part)
        if name.endswith("cascade"):
            problem = getattr(large_vi, name.split(",")[0])
            sides = [side // part for side in (43, 87, 175, 350)]
            start = large_vi.finer(large_vi.cascade(problem, sides)[-1].x, 700 // part)
            start = large_vi.smooth(p, start)
        M, lower, upper = p.M, p.lower, p.upper
    before, began = peak(), time.process_time()
    factors = splu(
        (M + sp.diags_array(abs(M).max(axis=1).toarray().ravel())).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    one, adds = time.process_time() - began, peak() - before
    del factors
    began = time.process_time()
    if name in ("prices", "cournot"):
        res = zivi.solve_vi(loss, lower, upper, start, jac=jac)
        M = jac(res.x)
    else:
        res = zivi.solve_avi(*p, start)
    took, most = time.process_time() - began, peak()
    residual = scaled_residual(M, res.F, res.x, lower, upper)
    return (
        name, f"{len(res.x)}", res.status.name, res.stage, f"{res.n_factorisations}",
        f"{took:.2f}", f"{took / one:.0f}", f"{residual:.1e}", f"{16 * res.fill / 2**20:.1f}",
        f"{adds:.0f}", f"{most - before:.0f}",
    )  # fmt: skip


def market(name: str, size: int) -> tuple[Any, Any, Any, Any]:
    """Return a map, its Jacobian, lower bounds and a start."""
    if name == "cournot":
        return vi_sparse_problems.cournot(size, size)
    loss, jac, start = large_vi.Prices(size, size).problem()
    return loss, jac, np.zeros(len(start)), start


def affine(name: str, part: int) -> large_vi.Linear:
    """Return an affine problem at its size."""
    if name == "discs":
        return large_vi.discs(32 // min(part, 4), 33 // min(part, 4))
    if name == "american_put":
        return large_vi.american_put(100_000 // part)
    if name == "transport":
        return vi_sparse_problems.transport(60 // part)
    if name == "two_sided":
        return vi_sparse_problems.two_sided(24)
    side = 700 if "," in name else 300
    return getattr(large_vi, name.split(",")[0])(side // part)


def families(each: int) -> str:
    """Return the table of the families."""
    ways: tuple[dict[str, Any], ...] = ({}, {"smoothing": False}, {"linear_algebra": "sparse"})
    rows = []
    for name in vi_families.FAMILIES:
        counts = [vi_families.counted(name, each, **way) for way in ways]
        solved_by = (f"{it.solved}" for it in counts)
        false = f"{sum(it.false for it in counts)}"
        rows.append((name, f"{counts[0].drawn}", *solved_by, false))
        print(*rows[-1], sep="  ", flush=True)
    head = ("family", "drawn", "dense", "without smoothing", "sparse", "false")
    return table(head, rows)


def run(name: str, **environment: str) -> tuple[str, ...]:
    """Solve one in a process of its own."""
    alone = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"} | environment
    command = [sys.executable, __file__, "--only", name, *sys.argv[1:]]
    told = subprocess.run(
        command, capture_output=True, text=True, check=True, env=os.environ | alone
    )
    return tuple(told.stdout.strip().split("\t"))


def main() -> None:
    """Print a line for each problem, and write the page."""
    part = 10 if "--small" in sys.argv else 1
    if "--only" in sys.argv:
        print("\t".join(solved(sys.argv[sys.argv.index("--only") + 1], part)))
        return
    rows = []
    for name in NAMES:
        times = run(name)
        memory = run(name, MALLOC_MMAP_THRESHOLD_="131072")
        rows.append((*times[:-2], *memory[-2:]))
        print(*rows[-1], sep="  ", flush=True)
    if "--write" in sys.argv:
        peers = table(vi_sparse_peers.HEAD, vi_sparse_peers.rows())
        sets = vi_sparse_published.campaign(vi_sparse_published.PROBLEMS, 2)
        parts = {"table": table(HEAD, rows), "peers": peers, "sets": sets}
        parts["factors"] = table(vi_sparse_factors.HEAD, vi_sparse_factors.rows())
        PAGE.write_text(TEXT.format(cpu=cpu(), families=families(8), **parts))


if __name__ == "__main__":
    main()
