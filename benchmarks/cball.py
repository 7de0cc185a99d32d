"""The hand-written C ball (`ball.c`): compiled here, called through ctypes."""

from __future__ import annotations

import ctypes
import dataclasses
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SOURCE = Path(__file__).with_name("ball.c")

QUANTITIES = ("t", "x", "xdot", "s", "v", "lambda_s", "lambda_v", "residual")
"""The recorded columns, in the order of the enumeration in `ball.c`."""

FLAGS = {
    "-O3": ("-O3",),
    "-O3 -march=native": ("-O3", "-march=native"),
    "-O3 -march=native, fused": ("-O3", "-march=native", "-ffp-contract=fast"),
}
"""Compiler flags by name. ISO C forbids fusing a*b + c unless asked for."""

KAPPA = 0.41
FORCE = -9.81
START = (1.0, 6.0)
"""Initial distance (m) and velocity (m/s)."""


class Problem(ctypes.Structure):
    """`ball_problem` of `ball.c`."""

    _fields_ = (
        *((name, ctypes.c_double) for name in ("t0", "t1", "h", "kappa", "f", "s0", "v0")),
        ("n", ctypes.c_size_t),
    )


Columns = ctypes.POINTER(ctypes.c_double) * len(QUANTITIES)


def problem(t1: float, h: float) -> Problem:
    """Pose the paper's ball over `[0, t1]` (s) with step `h` (s) that divides it."""
    x0, xdot0 = START
    return Problem(0.0, t1, h, KAPPA, FORCE, x0, xdot0 / (1.0 - KAPPA), round(t1 / h))


@dataclasses.dataclass(frozen=True)
class CBall:
    """One build of `ball.c`."""

    flags: str
    library: ctypes.CDLL

    def run(self, posed: Problem) -> ctypes.Array[ctypes.c_void_p]:
        """Record a run into memory that is allocated now; the caller frees it."""
        columns = Columns()
        if not self.library.ball_run(ctypes.byref(posed), columns):
            raise MemoryError("ball_run")
        return columns

    def run_large(self, posed: Problem) -> ctypes.Array[ctypes.c_void_p]:
        """Record a run into one new block with large pages; `free_large` frees it."""
        columns = Columns()
        if not self.library.ball_run_large(ctypes.byref(posed), columns):
            raise MemoryError("ball_run_large")
        return columns

    def free_large(self, columns: ctypes.Array[ctypes.c_void_p]) -> None:
        """Free what `run_large` allocated."""
        self.library.ball_free_large(columns)

    def fill(self, posed: Problem, columns: ctypes.Array[ctypes.c_void_p]) -> None:
        """Record a run into memory that is there already."""
        self.library.ball_fill(ctypes.byref(posed), columns)

    def loop(self, posed: Problem) -> None:
        """Take the steps, record nothing."""
        self.library.ball_loop(ctypes.byref(posed), (ctypes.c_double * 2)())

    def free(self, columns: ctypes.Array[ctypes.c_void_p]) -> None:
        """Free what `run` allocated."""
        self.library.ball_free(columns)

    def arrays(self, posed: Problem) -> dict[str, NDArray[np.float64]]:
        """Run, and copy the columns into NumPy arrays."""
        columns = self.run(posed)
        copies = {
            name: np.ctypeslib.as_array(column, (posed.n + 1,)).copy()
            for name, column in zip(QUANTITIES, columns, strict=True)
        }
        self.free(columns)
        return copies


def compiler() -> str | None:
    """Find the C compiler."""
    return shutil.which(os.environ.get("CC", "cc"))


def build(directory: Path) -> list[CBall]:
    """Compile `ball.c` with each set of `FLAGS` into `directory`."""
    cc = compiler()
    if cc is None:
        raise SystemExit("the benchmarks need a C compiler (cc, or the variable CC)")
    builds = []
    for number, (name, flags) in enumerate(FLAGS.items()):
        target = directory / f"ball{number}.so"
        warnings = ("-Wall", "-Wextra", "-Wpedantic")
        command = (cc, "-std=c99", *warnings, *flags, "-shared", "-fPIC", "-o", target, SOURCE)
        subprocess.run([*command, "-lm"], check=True)
        builds.append(CBall(name, ctypes.CDLL(str(target))))
    return builds
