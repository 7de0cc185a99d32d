"""Solve steps with Siconos; run by the interpreter that has it, which need not have zivi.

Reads an ``.npz`` from its standard input: the name of a `solver`, the `problem` (of `PROBLEMS`)
with its `parameters`, and the rows of `states` and `starts`. Writes the multipliers of each state,
as doubles, to its standard output. Where the solver raises they are NaN. If one solve takes more
than `TIMEOUT` seconds, the process ends there: what came before has been written.
"""

from __future__ import annotations

import faulthandler
import importlib
import io
import os
import sys
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

TIMEOUT = 2.0
"""Longest that one solve of two unknowns may take (s): Siconos' line searches can be endless."""
ITERATIONS = 1000
TOLERANCE = 1e-12
"""As in zivi's own solvers. Near rest a looser one shows as failures: the rows are scaled by what
the multipliers can do, which is much more there than what is left of the motion."""


class BallStep:
    """The VI of one implicit Euler step, as Siconos wants it.

    ``F(Lambda) = -(s+, v+)`` with ``v+ = v - h lambda_s g / R``, ``s+ = s + h R v+`` and
    ``R = 1 - kappa lambda_s lambda_v``, on ``[-1, 1]^2``. Every solver gets the same scaled rows:
    the one of s divided by ``h (kappa |v| + h g)``, the one of v by ``h g``, which is as much as
    the multipliers can change them.
    """

    signs = 2

    def __init__(self, kappa: float, gravity: float, h: float) -> None:
        self.kappa, self.gravity, self.h = kappa, gravity, h
        self.begin_at(0.0, 0.0)

    def begin_at(self, s: float, v: float) -> None:
        """Set the state from which the next step starts."""
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


class TrackingStep:
    """The VI of one step of the tracker, as Siconos wants it.

    The signs are ``ls, lv, lsr, lvr, les, lev``, and with ``R = 1 - kappa ls lv``,
    ``R_r = 1 - kappa_r lsr lvr``, ``A = lsr F_r / R_r`` and ``C = A - mu1 les - mu2 lev``::

        v_r+ = v_r + h A                                 s_r+ = s_r + h R_r v_r+
        v+ = v + h [ ls^2 C + ls (1 - ls^2) F / R ]      s+ = s + h R v+
        F(Lambda) = -(s+, v+, s_r+, v_r+, s+ - s_r+, v+ - v_r+)    on [-1, 1]^6

    Rows are scaled as those of `BallStep`, by as much as the multipliers can change them.
    """

    signs = 6

    def __init__(
        self,
        mu1: float,
        mu2: float,
        kappa: float,
        kappa_ref: float,
        f: float,
        f_ref: float,
        h: float,
    ) -> None:
        self.mu1, self.mu2, self.kappa, self.kappa_ref = mu1, mu2, kappa, kappa_ref
        self.f, self.f_ref, self.h = f, f_ref, h
        self.begin_at(0.0, 0.0, 0.0, 0.0)

    def begin_at(self, s: float, v: float, s_ref: float, v_ref: float) -> None:
        """Set the state from which the next step starts."""
        self.s, self.v, self.s_ref, self.v_ref = s, v, s_ref, v_ref
        of_ref = self.h * abs(self.f_ref)
        of_v = self.h * (self.mu1 + self.mu2 + abs(self.f)) + of_ref
        of_s = self.h * (self.kappa * abs(v) + of_v)
        of_s_ref = self.h * (self.kappa_ref * abs(v_ref) + of_ref)
        scales = of_s, of_v, of_s_ref, of_ref, of_s + of_s_ref, of_v + of_ref
        self.factors = -1.0 / np.array(scales)

    def compute(self, _: int, multipliers: Any, F: Any) -> None:
        """Write the map."""
        ls, lv, lsr, lvr, les, lev = multipliers.tolist()
        h, r, r_ref = self.h, 1.0 - self.kappa * ls * lv, 1.0 - self.kappa_ref * lsr * lvr
        a = lsr * self.f_ref / r_ref
        c = a - self.mu1 * les - self.mu2 * lev
        v = self.v + h * (ls * ls * c + ls * (1.0 - ls * ls) * self.f / r)
        v_ref = self.v_ref + h * a
        s, s_ref = self.s + h * r * v, self.s_ref + h * r_ref * v_ref
        F[:] = (s, v, s_ref, v_ref, s - s_ref, v - v_ref)
        F *= self.factors

    def jacobian(self, _: int, multipliers: Any, J: Any) -> None:
        """Write its Jacobian."""
        ls, lv, lsr, lvr, les, lev = multipliers.tolist()
        h, r, r_ref = self.h, 1.0 - self.kappa * ls * lv, 1.0 - self.kappa_ref * lsr * lvr
        a_lsr = self.f_ref / (r_ref * r_ref)
        a_lvr = a_lsr * self.kappa_ref * lsr * lsr
        c = lsr * self.f_ref / r_ref - self.mu1 * les - self.mu2 * lev
        square = ls * ls
        bent = self.f * self.kappa * ls * (1.0 - square) / (r * r)
        v = self.v + h * (square * c + ls * (1.0 - square) * self.f / r)
        of_v = (
            h * (2.0 * ls * c + (1.0 - 3.0 * square) * self.f / r + bent * lv),
            h * bent * ls,
            h * square * a_lsr,
            h * square * a_lvr,
            -h * square * self.mu1,
            -h * square * self.mu2,
        )
        of_s = [h * r * entry for entry in of_v]
        of_s[0] -= h * self.kappa * lv * v
        of_s[1] -= h * self.kappa * ls * v
        of_v_ref = (0.0, 0.0, h * a_lsr, h * a_lvr, 0.0, 0.0)
        s_lsr = h * (h * self.f_ref - self.kappa_ref * lvr * self.v_ref)
        of_s_ref = (0.0, 0.0, s_lsr, -h * self.kappa_ref * lsr * self.v_ref, 0.0, 0.0)
        J[:4] = of_s, of_v, of_s_ref, of_v_ref
        J[4:] = J[:2] - J[2:4]
        J *= self.factors[:, np.newaxis]


PROBLEMS: dict[str, Any] = {"ball": BallStep, "tracking": TrackingStep}


def options(numerics: Any, solver: str) -> Any:
    """Return the settings that the solvers share."""
    settings = numerics.SolverOptions(getattr(numerics, "SICONOS_" + solver))
    settings.iparam[0] = ITERATIONS
    settings.dparam[0] = TOLERANCE
    # the smallest step of the line search: 0 by default in VI_BOX_AVI_LSA, which may never end
    settings.dparam[2] = 1e-16
    return settings


def write_solutions(
    out: BinaryIO,
    solver: str,
    step: BallStep | TrackingStep,
    states: list[list[float]],
    starts: NDArray[np.float64],
) -> None:
    """Write the multipliers of all states to `out`, each solve begun at its start."""
    numerics = importlib.import_module("siconos.numerics")
    # not the general driver: it calls a projection that a box from Python does not have
    run = {
        "VI_BOX_AVI_LSA": numerics.vi_box_AVI_LSA,
        "VI_BOX_QI": numerics.variationalInequality_box_newton_QiLSA,
    }[solver]
    # all of them named, because the problem keeps bare pointers to them
    compute, jacobian = step.compute, step.jacobian
    lower, upper = np.full(step.signs, -1.0), np.full(step.signs, 1.0)
    problem = numerics.VI(step.signs, compute)
    problem.set_compute_nabla_F(jacobian)
    problem.set_box_constraints(lower, upper)
    settings = options(numerics, solver)
    multipliers = np.zeros(step.signs)
    for state, start in zip(states, starts, strict=True):
        step.begin_at(*state)
        # an unknown start is where the last solve has ended, whether it has solved anything or not
        multipliers = np.where(np.isnan(start), np.nan_to_num(multipliers), start)
        faulthandler.dump_traceback_later(TIMEOUT, exit=True)
        try:
            run(problem, multipliers, np.zeros(step.signs), settings)
        except Exception:
            multipliers[:] = np.nan
        faulthandler.cancel_dump_traceback_later()
        out.write(multipliers.tobytes())
        out.flush()


def solve_request() -> None:
    """Solve the problems on standard input; only results are written, no messages of C."""
    del sys.path[0]  # this folder, whose siconos.py would stand in for Siconos
    asked = np.load(io.BytesIO(sys.stdin.buffer.read()))
    step = PROBLEMS[str(asked["problem"])](*asked["parameters"].tolist())
    with os.fdopen(os.dup(1), "wb") as out, open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
        write_solutions(out, str(asked["solver"]), step, asked["states"].tolist(), asked["starts"])


if __name__ == "__main__":
    solve_request()
