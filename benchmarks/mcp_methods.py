"""The published MCP set: what each part of the solver is worth, beside Siconos where it is.

Success is counted by a residual computed here, never by a flag: at most 1e-9 for zivi, 1e-7 for
Siconos, whose solvers are given tolerance 1e-9 and 1000 iterations.
"""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import siconos_peer
import zivi

ROOT = Path(__file__).resolve().parent.parent
TESTS = ROOT / "tests"
PAGE = ROOT / "docs" / "benchmarks_vi.md"
sys.path.insert(0, str(TESTS))

from mcp import PROBLEMS  # noqa: E402
from mcp.linear import laplacian  # noqa: E402

SOLVABLE = [problem for problem in PROBLEMS if problem.solvable]
RANDOM_STARTS = 10
SICONOS_TOLERANCE = 1e-7

ONLY = {"semismooth": False, "proximal": False, "restarts": 0, "enumerate_up_to": 0}
METHODS = {
    "Josephy-Newton, undamped": {**ONLY, "line_search": False, "descent_steps": False},
    "semismooth Newton only": {**ONLY, "josephy_newton": False, "semismooth": True},
    "S0, monotone search": {**ONLY, "memory": 1},
    "S0: Josephy-Newton": ONLY,
    "S0, ray start first": {**ONLY, "ray_start_first": True},
    "all but the line search": {"line_search": False},
    "all but descent steps": {"descent_steps": False},
    "all but S0": {"josephy_newton": False},
    "all but S1": {"semismooth": False},
    "all but S2": {"proximal": False},
    "all but restarts": {"restarts": 0},
    "all but enumeration": {"enumerate_up_to": 0},
    "all": {},
}


@dataclasses.dataclass(frozen=True)
class Count:
    """How one method did over a family of starts."""

    solved: int
    starts: int
    iterations: np.ndarray
    pivots: np.ndarray
    evaluations: np.ndarray
    unsolved: dict[str, int]
    seconds: float


def starts(kind: str) -> Iterator[tuple[object, np.ndarray]]:
    """Yield problems with their published, or with ten random starts each."""
    rng = np.random.default_rng(0)
    for problem in SOLVABLE:
        if kind == "published":
            yield from ((problem, start) for start in problem.starts)
            continue
        for _ in range(RANDOM_STARTS):
            near = problem.starts[rng.integers(len(problem.starts))]
            yield problem, near + 10 ** rng.uniform(-1, 2) * rng.uniform(-1, 1, problem.n)


def count(options: dict[str, object], kind: str) -> Count:
    """Run one method."""
    work, unsolved, total = [], {}, 0
    began = time.perf_counter()
    for problem, start in starts(kind):
        total += 1
        res = zivi.solve_vi(
            problem.F,
            problem.lower,
            problem.upper,
            start,
            jac=problem.jac,
            options=zivi.VIOptions(**options),
        )
        residual = problem.residual(res.x)
        if res.success and not residual <= 1e-9:
            raise AssertionError(f"false success on {problem.name}: {residual}")
        if res.success:
            work.append((res.n_iter, res.n_pivots, res.nfev))
        else:
            unsolved[problem.name] = unsolved.get(problem.name, 0) + 1
    iterations, pivots, evaluations = np.array(work).T
    seconds = time.perf_counter() - began
    return Count(len(work), total, iterations, pivots, evaluations, unsolved, seconds)


def _row(name: str, published: Count, scattered: Count) -> str:
    def spread(values: np.ndarray) -> str:
        return f"{np.median(values):.0f} / {np.percentile(values, 95):.0f}"

    cells = [
        name,
        f"{published.solved}/{published.starts}",
        f"{scattered.solved}/{scattered.starts}",
        spread(published.iterations),
        f"{np.median(published.pivots):.0f} / {published.pivots.max()}",
        spread(published.evaluations),
        _listed(published.unsolved),
    ]
    return "| " + " | ".join(cells) + " |"


def siconos_rows() -> list[str]:
    """Run Siconos' solvers in the interpreter that has them; none is an empty list."""
    python = siconos_peer.interpreter()
    if python is None:
        return []
    script = Path(__file__).with_name("siconos_mcp.py")
    try:
        run = subprocess.run(
            [python, str(script), str(TESTS)], capture_output=True, text=True, timeout=600
        )
    except subprocess.TimeoutExpired:
        return ["| Siconos | no answer within ten minutes | | | | | |"]
    if run.returncode != 0:
        return [f"| Siconos | failed: {run.stderr.strip().splitlines()[-1:]} | | | | | |"]
    ours = own_seconds()
    rows = []
    for name, ends in json.loads(run.stdout).items():
        fails: dict[str, int] = {}
        ratios = []
        # some solvers take a part of the set only
        taken = {problem for problem, *_ in ends}
        own = [seconds for problem, seconds in ours if problem in taken]
        for (problem, residual, seconds), of_zivi in zip(ends, own, strict=True):
            if residual is None or not residual <= SICONOS_TOLERANCE:
                fails[problem] = fails.get(problem, 0) + 1
            else:
                ratios.append(of_zivi / seconds)
        solved = f"{len(ratios)}/{len(ends)}"
        rows.append(f"| Siconos {name} | {solved} | | | | | {_listed(fails)} |")
        quartiles = ", ".join(f"{q:.2f}" for q in np.percentile(ratios, [25, 50, 75]))
        rows.append(f"| time of zivi to it, where it solves: quartiles | {quartiles} | | | | | |")
    return rows


def own_seconds() -> list[tuple[str, float]]:
    """Return the time of each published start, the shortest of three."""
    shortest = []
    for problem, start in starts("published"):
        seconds = []
        for _ in range(3):
            began = time.perf_counter()
            zivi.solve_vi(problem.F, problem.lower, problem.upper, start, jac=problem.jac)
            seconds.append(time.perf_counter() - began)
        shortest.append((problem.name, min(seconds)))
    return shortest


def _listed(fails: dict[str, int]) -> str:
    return ", ".join(f"{k} {v}" if v > 1 else k for k, v in fails.items()) or "none"


def table() -> str:
    """Return the table of all methods."""
    head = "method|published|random|iterations median / 95 %|pivots median / max|F median / 95 %"
    columns = [*head.split("|"), "published starts not solved"]
    lines = ["| " + " | ".join(columns) + " |", "|---|" + "---:|" * 5 + "---|"]
    with np.errstate(all="ignore"):
        for name, options in METHODS.items():
            lines.append(_row(name, count(options, "published"), count(options, "random")))
    return "\n".join(lines + siconos_rows())


def growth() -> str:
    """Return time and memory of one affine solve, the obstacle problem on finer and finer grids."""
    lines = [
        "| grid | unknowns | pivots | time (s) | time / (pivots n^2) (ns) | workspace (MB) |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for m in (10, 15, 20, 25, 30):
        n = m * m
        M, q = laplacian(m), np.full(n, -10.0)
        seconds = []
        for _ in range(3):
            began = time.perf_counter()
            res = zivi.solve_avi(M, q, 0, 0.5)
            seconds.append(time.perf_counter() - began)
        if not res.success or res.n_iter != 1:
            raise AssertionError(f"the obstacle problem took {res.n_iter} affine solves")
        unit = min(seconds) / res.n_pivots / n**2 * 1e9
        megabytes = 8 * (2 * n * n + 22 * n) / 1e6
        cells = [f"{m} x {m}", n, res.n_pivots, f"{min(seconds):.2g}", f"{unit:.2f}"]
        lines.append("| " + " | ".join(map(str, [*cells, f"{megabytes:.1f}"])) + " |")
    return "\n".join(lines)


def leak(solves: int = 1_000_000) -> int:
    """Return by how many bytes the process grows over many solves, affine and with callbacks."""
    M, q = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-5.0, -6.0])

    def resident() -> int:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE")

    def run(count: int) -> None:
        for _ in range(count // 2):
            zivi.solve_avi(M, q, -1, 1)
            zivi.solve_vi(lambda x: M @ x + q, -1, 1, [0.0, 0.0], jac=M)

    run(2000)
    before = resident()
    run(solves)
    return resident() - before


def page() -> str:
    """Return the page of the documentation."""
    grown = leak() if Path("/proc/self/statm").exists() else None
    growing = "not measured here" if grown is None else f"{grown / 1e3:.0f} kB"
    return f"""# The MCP solver, measured

Written by `make bench`. 48 solvable problems from the literature (`tests/mcp`): their 129 published
starts, and 480 random ones. Success is counted by a residual computed apart from the solver:
at most 1e-9 for zivi. The solvers of Siconos were given the tolerance 1e-9 and 1000 iterations, and
are counted at 1e-7; infinite bounds became 1e7 for its box solvers, its MCP solver takes only
problems without upper bounds. F and its Jacobian are the same Python functions for all.

{table()}

## Growth

One affine solve of the obstacle problem, `-Lap u = 10`, `0 <= u <= 0.5`.

{growth()}

## Memory

Growth of the process over a million solves, half of them with callbacks: {growing}.
"""


if __name__ == "__main__":
    PAGE.write_text(page())
    print(PAGE.read_text())
