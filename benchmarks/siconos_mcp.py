"""Solve published problems with Siconos, in the interpreter that has it: one per line.

Reads requests from standard input, one JSON object a line: the name of a `solver`, the name of a
`problem`, its `start`, and how often to `repeat` the solve. Answers each with one line: the point
`x`, the solver's own flag `info`, `seconds` of every repetition, evaluations `nfev` and `njev` and
`iterations` (pivots for an LCP) of the last one, and by how many bytes the process `grew`. Where
the solver raises or cannot pose the problem, the answer is an object with an `error`.

Usage: python3 siconos_mcp.py FOLDER, where FOLDER holds the package `mcp`.
"""

# ruff: noqa: N802 (the names of the methods are those of Siconos)

import json
import os
import resource
import sys
import time

import numpy as np

sys.path.insert(0, sys.argv[1])
from mcp import BY_NAME

TOLERANCE, ITERATIONS, PIVOTS = 1e-9, 1000, 100_000
FAR = 1e7
"""Stands for an infinite bound in the box solvers, which solve much less with infinite ones."""


class Counted:
    """The map of a problem and its Jacobian as Siconos calls them, on other coordinates.

    ``z = (x - offset)[order]``, and the rows in the same order.
    """

    def __init__(self, problem, order=None, offset=0.0):
        self.problem, self.order, self.offset = problem, order, offset
        self.nfev = self.njev = 0
        self.inverse = None if order is None else np.argsort(order)

    def point(self, z):
        """Return x."""
        return z if self.order is None else z[self.inverse] + self.offset

    def F(self, _, z, F):
        """Write the map."""
        self.nfev += 1
        value = self.problem.F(self.point(z))
        F[:] = value if self.order is None else value[self.order]

    def jac(self, _, z, J):
        """Write its Jacobian."""
        self.njev += 1
        value = self.problem.jac(self.point(z))
        J[:] = value if self.order is None else value[np.ix_(self.order, self.order)]


def settings(numerics, name):
    options = numerics.SolverOptions(getattr(numerics, "SICONOS_" + name))
    linear = name.startswith("LCP")
    options.iparam[0] = PIVOTS if linear else ITERATIONS
    options.dparam[0] = TOLERANCE
    if not linear:
        # the smallest step of the line search: 0 by default in VI_BOX_AVI_LSA, may never end
        options.dparam[2] = 1e-16
    return options


def box(numerics, name, problem):
    """Pose a problem to one of the solvers on boxes."""
    # not the general driver: it calls a projection that a box from Python does not have
    run = {
        "VI_BOX_AVI_LSA": numerics.vi_box_AVI_LSA,
        "VI_BOX_QI": numerics.variationalInequality_box_newton_QiLSA,
    }[name]
    counted = Counted(problem)
    # all of them named and returned, because the problem keeps bare pointers to them
    F, jac = counted.F, counted.jac
    bounds = np.maximum(problem.lower, -FAR), np.minimum(problem.upper, FAR)
    posed = numerics.VI(problem.n, F)
    posed.set_compute_nabla_F(jac)
    posed.set_box_constraints(*bounds)
    return run, posed, counted, (F, jac, bounds)


def complementarity(numerics, name, problem):
    """Pose a problem without upper bounds to the semismooth Newton solver: free unknowns first."""
    if np.any(np.isfinite(problem.upper)):
        raise ValueError("it has upper bounds")
    free = np.isinf(problem.lower)
    order = np.argsort(~free, kind="stable")
    counted = Counted(problem, order, np.where(free, 0.0, problem.lower))
    F, jac = counted.F, counted.jac
    posed = numerics.MCP(int(free.sum()), int((~free).sum()), F, jac)
    return numerics.mcp_newton_FB_FBLSA, posed, counted, (F, jac)


def linear(numerics, name, problem):
    """Pose a linear complementarity problem to a pivotal solver."""
    run = {
        "LCP_LEMKE": numerics.lcp_lexicolemke,
        "LCP_AVI_CAOFERRIS": numerics.lcp_avi_caoferris,
    }[name]
    matrix, constant = problem.jac(np.zeros(problem.n)), problem.F(np.zeros(problem.n))
    return run, numerics.LCP(matrix, constant), Counted(problem), (matrix, constant)


def solve(numerics, name, problem, start, repeat):
    pose = {"VI": box, "MC": complementarity, "LC": linear}[name[:2]]
    run, posed, counted, _kept = pose(numerics, name, problem)
    options = settings(numerics, name)
    start = np.clip(start, problem.lower, problem.upper)
    if counted.order is not None:
        start = (start - counted.offset)[counted.order]
    seconds = np.ones(repeat)  # written to before memory is looked at
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for k in range(repeat):
        z, w = start.copy(), np.zeros(problem.n)
        counted.nfev = counted.njev = 0
        begin = time.perf_counter()
        info = run(posed, z, w, options)
        seconds[k] = time.perf_counter() - begin
    grew = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return {
        "x": counted.point(z).tolist(),
        "info": int(info),
        "seconds": seconds.tolist(),
        "nfev": counted.nfev,
        "njev": counted.njev,
        "iterations": int(options.iparam[1]),
        "grew": grew * 1024,
    }


def main():
    import siconos.numerics as numerics

    np.seterr(all="ignore")
    # what the C code prints must not mix with the answers
    with os.fdopen(os.dup(1), "w") as out, open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
        for line in sys.stdin:
            asked = json.loads(line)
            problem, start = BY_NAME[asked["problem"]], np.array(asked["start"], float)
            try:
                answer = solve(numerics, asked["solver"], problem, start, asked["repeat"])
            except Exception as error:
                answer = {"error": str(error)}
            out.write(json.dumps(answer) + "\n")
            out.flush()


if __name__ == "__main__":
    main()
