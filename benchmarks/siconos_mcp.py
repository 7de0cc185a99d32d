"""Solve the published MCP set with Siconos; run by the interpreter that has it.

Usage: siconos_mcp.py FOLDER, the folder of the package `mcp`. Writes, as JSON, for each solver the
natural residual reached from every published start (null where it raised, crashed or took more
than `TIMEOUT` seconds) and the shortest time of `REPEATS` solves. Each start has a process of its
own, because some solves never end.

Infinite bounds become 1e7: with infinite ones the solvers of Siconos give up or fail. Residuals
are those of the original problem.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
import time
from typing import Any

import numpy as np

TIMEOUT = 5
REPEATS = 3
ITERATIONS = 1000
TOLERANCE = 1e-9
INFINITE = 1e7
MCP = "MCP_NEWTON_FB_FBLSA"


def _settings(numerics: Any, solver: str) -> Any:
    settings = numerics.SolverOptions(getattr(numerics, "SICONOS_" + solver))
    settings.iparam[0] = ITERATIONS
    settings.dparam[0] = TOLERANCE
    settings.dparam[2] = 1e-16  # the smallest step: 0 by default, which may never end
    return settings


def has_form(solver: str, problem: Any) -> bool:
    """Tell whether a solver takes the problem: its MCPs have no upper bounds."""
    return solver != MCP or not np.any(np.isfinite(problem.upper))


def solve_mcp(numerics: Any, problem: Any, start: np.ndarray) -> np.ndarray:
    """Return where the Fischer-Burmeister solver ends: free unknowns first, then those >= 0."""
    is_free = np.isinf(problem.lower)
    order = np.r_[np.flatnonzero(is_free), np.flatnonzero(~is_free)]
    shift = np.where(is_free, 0.0, problem.lower)

    def back(z: Any) -> np.ndarray:
        x = np.empty(problem.n)
        x[order] = z
        return x + shift

    def compute(_: int, z: Any, F: Any) -> None:
        F[:] = problem.F(back(z))[order]

    def jacobian(_: int, z: Any, J: Any) -> None:
        J[:, :] = problem.jac(back(z))[np.ix_(order, order)]

    mcp = numerics.MCP(int(is_free.sum()), int((~is_free).sum()), compute, jacobian)
    z = np.array((start - shift)[order], float)
    numerics.mcp_newton_FB_FBLSA(mcp, z, np.zeros(problem.n), _settings(numerics, MCP))
    return np.maximum(back(z), problem.lower)


def solve(numerics: Any, solver: str, problem: Any, start: np.ndarray) -> np.ndarray:
    """Return where Siconos ends."""
    if solver == MCP:
        return solve_mcp(numerics, problem, start)

    def compute(_: int, z: Any, F: Any) -> None:
        F[:] = problem.F(np.array(z))

    def jacobian(_: int, z: Any, J: Any) -> None:
        J[:, :] = problem.jac(np.array(z))

    # not the general driver: it calls a projection that a box from Python does not have
    run = {
        "VI_BOX_AVI_LSA": numerics.vi_box_AVI_LSA,
        "VI_BOX_QI": numerics.variationalInequality_box_newton_QiLSA,
    }[solver]
    lower = np.maximum(problem.lower, -INFINITE)
    upper = np.minimum(problem.upper, INFINITE)
    vi = numerics.VI(problem.n, compute)
    vi.set_compute_nabla_F(jacobian)
    vi.set_box_constraints(lower, upper)
    z = np.array(start, float)
    run(vi, z, np.zeros(problem.n), _settings(numerics, solver))
    return np.clip(z, problem.lower, problem.upper)


def in_a_child(
    numerics: Any, solver: str, problem: Any, start: np.ndarray
) -> tuple[float | None, float]:
    """Return the residual that is reached, or None, and the time it took."""
    with tempfile.TemporaryFile() as answer:
        child = os.fork()
        if child == 0:
            signal.alarm(TIMEOUT)
            try:
                seconds = []
                for _ in range(REPEATS):
                    began = time.perf_counter()
                    z = solve(numerics, solver, problem, start)
                    seconds.append(time.perf_counter() - began)
                answer.write(json.dumps([problem.residual(z), min(seconds)]).encode())
                answer.flush()
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        answer.seek(0)
        written = answer.read().decode()
    residual, seconds = json.loads(written) if written else (np.nan, np.nan)
    return (residual, seconds) if np.isfinite(residual) else (None, 0.0)


def main() -> None:
    """Run all solvers over all starts; C's messages go nowhere."""
    sys.path[0] = sys.argv[1]
    import siconos.numerics as numerics

    from mcp import PROBLEMS

    np.seterr(all="ignore")
    with os.fdopen(os.dup(1), "w") as out, open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
        answers = {
            solver: [
                (problem.name, *in_a_child(numerics, solver, problem, start))
                for problem in PROBLEMS
                if problem.solvable and has_form(solver, problem)
                for start in problem.starts
            ]
            for solver in ("VI_BOX_AVI_LSA", "VI_BOX_QI", MCP)
        }
        json.dump(answers, out)


if __name__ == "__main__":
    main()
