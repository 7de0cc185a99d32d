"""Other solvers on large sparse problems: semismooth Newton by SciPy, Siconos, Clarabel, HiGHS.

    python benchmarks/vi_sparse_peers.py

Each solve is a process of its own, one thread, ended after 30 s of CPU. What is not installed is
left out: none is required. Clarabel and HiGHS take the problem as a program where the matrix is
symmetric (or, of a linear program, skew), Siconos as a linear complementarity problem, which
its projected Gauss-Seidel takes sparse and its Newton method dense.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np
import scipy.sparse as sp

import siconos_peer
import vi_sparse_problems
from vi_sparse_problems import Array, large_vi

LIMIT = 30.0
TOL = 1e-9
HEAD = ("problem", "unknowns", "solver", "CPU (s)", "residual")
MANY = 1000
"""Unknowns above which dense matrices are left out."""


def linear(name: str) -> large_vi.Linear:
    """Return a linear problem."""
    what, size = name.split()
    if what == "transport":
        return vi_sparse_problems.transport(int(size))
    if what == "discs":
        return large_vi.discs(32, 33)
    problem: large_vi.Linear = getattr(large_vi, what)(int(size))
    return problem


PROBLEMS = (
    "obstacle 30", "obstacle 100", "obstacle 300", "torsion 100", "bearing 100",
    "american_put 20000", "discs 3136", "transport 60", "prices 100",
)  # fmt: skip


def phi(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Return ``a + b - sqrt(a^2 + b^2)`` with its slopes."""
    size = np.hypot(a, b)
    size = np.where(size > 0, size, 1.0)
    return a + b - np.hypot(a, b), 1 - a / size, 1 - b / size


def residuals(x: Array, F: Array, lower: Array, upper: Array) -> tuple[Array, Array, Array]:
    """Return Billups' function of a box with its slopes by `x` and by `F`."""
    value, by_x, by_F = F, np.zeros(len(x)), np.ones(len(x))
    high, low = np.isfinite(upper), np.isfinite(lower)
    inner, one, two = phi(np.where(high, upper - x, 1.0), -F)
    value, by_x, by_F = (np.where(high, *it) for it in ((-inner, F), (one, 0.0), (two, 1.0)))
    outer, one, two = phi(np.where(low, x - lower, 1.0), value)
    return (
        np.where(low, outer, value),
        np.where(low, one + two * by_x, by_x),
        np.where(low, two * by_F, by_F),
    )


def semismooth(F: Any, jac: Any, lower: Array, upper: Array, x: Array) -> Array:
    """Newton's method on the Fischer-Burmeister function with SciPy's SuperLU, Armijo's search."""
    from scipy.sparse.linalg import splu

    for _ in range(300):
        value = F(x)
        r, by_x, by_F = residuals(x, value, lower, upper)
        if np.max(np.abs(np.maximum(x - upper, np.minimum(x - lower, value)))) <= TOL:
            break
        J = sp.csc_array(sp.diags_array(by_x) + sp.diags_array(by_F) @ jac(x))
        gradient, merit = J.T @ r, r @ r / 2
        try:
            step = splu(J, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=1e-3).solve(-r)
        except RuntimeError:
            step = -gradient
        if not np.isfinite(step).all() or gradient @ step > -1e-12 * (step @ step):
            step = -gradient
        t = 1.0
        while t > 1e-12:
            trial = residuals(x + t * step, F(x + t * step), lower, upper)[0]
            if trial @ trial / 2 <= merit + 1e-4 * t * (gradient @ step):
                break
            t /= 2
        x = x + t * step
    return x


def is_linear_program(p: large_vi.Linear) -> bool:
    """Whether the matrix is skew."""
    return bool(abs(p.M + p.M.T).max() == 0)


def clarabel(p: large_vi.Linear) -> Array:
    """Solve the program by Clarabel's interior point."""
    import clarabel as solver

    n = len(p.q)
    settings = solver.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOL
    if is_linear_program(p):
        k = int(np.sqrt(n + 1) - 1)
        A = p.M[k * k :, : k * k]
        rows = sp.csc_matrix(sp.vstack([-A, -sp.eye_array(k * k)]))
        b = np.append(p.q[k * k :], np.zeros(k * k))
        P, q = sp.csc_matrix((k * k, k * k)), p.q[: k * k]
        found = solver.DefaultSolver(
            P, q, rows, b, [solver.NonnegativeConeT(len(b))], settings
        ).solve()
        return np.append(found.x, found.z[: 2 * k])
    up = np.isfinite(p.upper)
    rows = sp.csc_matrix(sp.vstack([-sp.eye_array(n), sp.eye_array(n, format="csr")[up]]))
    b = np.append(-p.lower, p.upper[up])
    P = sp.csc_matrix(sp.triu(p.M))
    found = solver.DefaultSolver(
        P, p.q, rows, b, [solver.NonnegativeConeT(len(b))], settings
    ).solve()
    return np.asarray(found.x)


def highs(p: large_vi.Linear) -> Array:
    """Solve the program by HiGHS: linear ones by its choice, quadratic ones on the active set."""
    import highspy

    h = highspy.Highs()
    h.silent()
    for name, value in (("primal_feasibility_tolerance", TOL), ("dual_feasibility_tolerance", TOL)):
        h.setOptionValue(name, value)
    h.setOptionValue("threads", 1)
    model = highspy.HighsModel()
    n = len(p.q)
    if is_linear_program(p):
        k = int(np.sqrt(n + 1) - 1)
        n, A = k * k, sp.csr_array(p.M[k * k :, : k * k])
        model.lp_.num_row_ = len(p.q) - n
        model.lp_.row_lower_, model.lp_.row_upper_ = -p.q[n:], np.full(len(p.q) - n, np.inf)
        model.lp_.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
        model.lp_.a_matrix_.start_, model.lp_.a_matrix_.index_ = A.indptr, A.indices
        model.lp_.a_matrix_.value_ = A.data
    else:
        P = sp.csc_array(sp.tril(p.M))
        model.hessian_.dim_ = n
        model.hessian_.format_ = highspy.HessianFormat.kTriangular
        model.hessian_.start_, model.hessian_.index_ = P.indptr, P.indices
        model.hessian_.value_ = P.data
    model.lp_.num_col_ = n
    model.lp_.col_cost_ = p.q[:n]
    model.lp_.col_lower_, model.lp_.col_upper_ = p.lower[:n], p.upper[:n]
    h.passModel(model)
    h.run()
    found = h.getSolution()
    x = np.array(found.col_value)
    return np.append(x, found.row_dual) if is_linear_program(p) else x


SICONOS = """
import sys, time
import numpy as np, scipy.sparse as sp
import siconos.numerics as N
d = np.load(sys.argv[1])
M, q, name = sp.csc_matrix((d["data"], d["indices"], d["indptr"])), d["q"], sys.argv[2]
z, w = np.zeros(len(q)), np.zeros(len(q))
kind = {"lcp_pgs": "PGS", "lcp_newton_FB": "NEWTON_FB_FBLSA"}[name]
options = N.SolverOptions(getattr(N, "SICONOS_LCP_" + kind))
options.iparam[0], options.dparam[0] = 10**6 if name == "lcp_pgs" else 1000, 1e-9
problem = N.LCP(M if name == "lcp_pgs" else M.toarray(), q)
began = time.process_time()
getattr(N, name)(problem, z, w, options)
np.savez(sys.argv[1], z=z, took=time.process_time() - began)
"""


def siconos(p: large_vi.Linear, name: str, python: str) -> tuple[Array, float]:
    """Solve by Siconos in its own interpreter."""
    M = sp.csc_array(p.M)
    with tempfile.NamedTemporaryFile(suffix=".npz") as file:
        q = p.q + p.M @ p.lower
        np.savez(file.name, data=M.data, indices=M.indices, indptr=M.indptr, q=q)
        subprocess.run(
            [python, "-c", SICONOS, file.name, name],
            check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        with np.load(file.name) as found:
            return p.lower + found["z"], float(found["took"])


def solved(name: str, solver: str) -> tuple[str, ...]:
    """Solve one problem by one solver, and return its row."""
    began = time.process_time()
    if name.startswith("prices"):
        F, jac, x0 = large_vi.Prices(100, 100).problem()
        lower, upper = np.zeros(len(x0)), np.full(len(x0), np.inf)
    else:
        p = linear(name)
        F, jac, lower, upper = lambda x: p.M @ x + p.q, lambda x: p.M, p.lower, p.upper
        x0 = np.clip(np.zeros(len(p.q)), lower, upper)
    took = None
    began = time.process_time()
    if solver == "zivi":
        import zivi

        zivi.solve_lcp(sp.eye_array(400, format="csr"), np.linspace(-1, 1, 400))  # imports
        began = time.process_time()
        x = zivi.solve_ncp(F, x0, jac=jac).x if "prices" in name else zivi.solve_avi(*p).x
    elif solver == "semismooth Newton":
        x = semismooth(F, jac, lower, upper, x0)
    elif solver in ("Clarabel", "HiGHS"):
        x = {"Clarabel": clarabel, "HiGHS": highs}[solver](p)
    else:
        python = siconos_peer.interpreter()
        if python is None:
            raise ImportError("siconos")
        kind = "lcp_newton_FB" if "Newton" in solver else "lcp_pgs"
        x, took = siconos(p, kind, python)
    took = time.process_time() - began if took is None else took
    x = np.clip(x, lower, upper)
    value = F(x) / abs(jac(x)).max(axis=1).toarray().ravel()
    found = np.max(np.abs(np.maximum(x - upper, np.minimum(x - lower, value))))
    return name, f"{len(x)}", solver, f"{took:.2f}", f"{found:.1e}"


def limited() -> None:
    """Let the process, and what it starts, have so much time of the processor."""
    resource.setrlimit(resource.RLIMIT_CPU, (int(LIMIT), int(LIMIT)))


def solvers(name: str) -> list[str]:
    """Return what takes a problem."""
    chosen = ["zivi", "semismooth Newton"]
    if name.startswith("prices"):
        return chosen
    p = linear(name)
    if not np.isfinite(p.upper).any():
        chosen += ["Siconos, Gauss-Seidel"] if np.all(p.M.diagonal() > 0) else []
        chosen += ["Siconos, Newton"] if len(p.q) <= MANY else []
    # a product is symmetric up to rounding
    if is_linear_program(p) or abs(p.M - p.M.T).max() <= 1e-15 * abs(p.M).max():
        chosen += ["Clarabel", "HiGHS"]
    return chosen


def rows() -> list[tuple[str, ...]]:
    """Run all, and return a row for each that there is."""
    alone = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    found = []
    for name in PROBLEMS:
        for solver in solvers(name):
            run = [sys.executable, __file__, name, solver]
            told = subprocess.run(
                run, capture_output=True, text=True, env=alone, check=False, preexec_fn=limited
            )
            if "ImportError" in told.stderr or "ModuleNotFoundError" in told.stderr:
                continue
            over = told.returncode < 0 or "SIG" in told.stderr
            row: tuple[str, ...] = (name, "", solver, f"> {LIMIT:.0f}" if over else "failed", "")
            if told.returncode == 0:
                row = tuple(told.stdout.splitlines()[-1].split("\t"))
            print(*row, sep="  ", flush=True)
            found.append(row)
    return found


if __name__ == "__main__":
    if len(sys.argv) > 2:
        print("\t".join(solved(*sys.argv[1:3])))
    else:
        rows()
