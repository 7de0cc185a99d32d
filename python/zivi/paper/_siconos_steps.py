"""Solve steps with Siconos; run by the interpreter that has it, which need not have zivi.

Reads an ``.npz`` with ``kappa``, ``gravity``, ``h``, ``s``, ``v`` and the name of a `solver` from
its standard input and writes two doubles for each state, the multipliers, to its standard output.
Where the solver raises they are NaN. If one solve takes more than `TIMEOUT` seconds, the process
ends there: what came before has been written.
"""

from __future__ import annotations

import faulthandler
import importlib
import io
import os
import sys
from typing import Any, BinaryIO

import numpy as np

TIMEOUT = 2.0
"""Longest that one solve of two unknowns may take (s): Siconos' line searches can be endless."""
ITERATIONS = 1000
TOLERANCE = 1e-12
"""As in zivi's own solvers. Near rest a looser one shows as failures: the rows are scaled by what
the multipliers can do, which is much more there than what is left of the motion."""


class Step:
    """The VI of one implicit Euler step, as Siconos wants it.

    ``F(Lambda) = -(s+, v+)`` with ``v+ = v - h lambda_s g / R``, ``s+ = s + h R v+`` and
    ``R = 1 - kappa lambda_s lambda_v``, on ``[-1, 1]^2``. Every solver gets the same scaled rows:
    the one of s divided by ``h (kappa |v| + h g)``, the one of v by ``h g``, which is as much as
    the multipliers can change them.
    """

    def __init__(self, kappa: float, gravity: float, h: float) -> None:
        self.kappa, self.gravity, self.h = kappa, gravity, h
        self.begin_at(0.0, 0.0)

    def begin_at(self, s: float, v: float) -> None:
        """Take the next step from here."""
        self.s, self.v = s, v
        self.scale_v = self.h * self.gravity
        self.scale_s = self.h * (self.kappa * abs(v) + self.scale_v)

    def compute(self, _: int, multipliers: Any, F: Any) -> None:
        """Write the map."""
        ls, lv = multipliers
        r = 1.0 - self.kappa * ls * lv
        v = self.v - self.h * ls * self.gravity / r
        F[0] = -(self.s + self.h * r * v) / self.scale_s
        F[1] = -v / self.scale_v

    def jacobian(self, _: int, multipliers: Any, J: Any) -> None:
        """Write its Jacobian."""
        ls, lv = multipliers
        r = 1.0 - self.kappa * ls * lv
        gain = self.h * self.gravity / (r * r) / self.scale_v
        J[0, 0] = self.h * (self.kappa * lv * self.v + self.h * self.gravity) / self.scale_s
        J[0, 1] = self.h * self.kappa * ls * self.v / self.scale_s
        J[1, 0] = gain
        J[1, 1] = gain * self.kappa * ls * ls


def options(numerics: Any, solver: str) -> Any:
    """Return the settings that the solvers share."""
    settings = numerics.SolverOptions(getattr(numerics, "SICONOS_" + solver))
    settings.iparam[0] = ITERATIONS
    settings.dparam[0] = TOLERANCE
    # the smallest step of the line search: 0 by default in VI_BOX_AVI_LSA, which may never end
    settings.dparam[2] = 1e-16
    return settings


def solve(out: BinaryIO, solver: str, step: Step, states: list[list[float]]) -> None:
    """Write the multipliers of all states to `out`, each solve started from the signs."""
    numerics = importlib.import_module("siconos.numerics")
    # not the general driver: it calls a projection that a box from Python does not have
    run = {
        "VI_BOX_AVI_LSA": numerics.vi_box_AVI_LSA,
        "VI_BOX_QI": numerics.variationalInequality_box_newton_QiLSA,
    }[solver]
    # all of them named, because the problem keeps bare pointers to them
    compute, jacobian = step.compute, step.jacobian
    lower, upper = np.full(2, -1.0), np.full(2, 1.0)
    problem = numerics.VI(2, compute)
    problem.set_compute_nabla_F(jacobian)
    problem.set_box_constraints(lower, upper)
    settings = options(numerics, solver)
    for s, v in states:
        step.begin_at(s, v)
        multipliers = np.sign([s, v])
        faulthandler.dump_traceback_later(TIMEOUT, exit=True)
        try:
            run(problem, multipliers, np.zeros(2), settings)
        except Exception:
            multipliers[:] = np.nan
        faulthandler.cancel_dump_traceback_later()
        out.write(multipliers.tobytes())
        out.flush()


def main() -> None:
    """Solve what standard input asks for; nothing else, C's messages included, is written."""
    del sys.path[0]  # this folder, whose siconos.py would stand in for Siconos
    asked = np.load(io.BytesIO(sys.stdin.buffer.read()))
    step = Step(*(float(asked[name]) for name in ("kappa", "gravity", "h")))
    states = np.column_stack([asked["s"], asked["v"]]).tolist()
    with os.fdopen(os.dup(1), "wb") as out, open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
        solve(out, str(asked["solver"]), step, states)


if __name__ == "__main__":
    main()
