"""Steps of the ball of section III: two signs."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

import zivi._zivi as _zivi
from zivi.paper import step_solvers
from zivi.paper.ball import GRAVITY, KAPPA, simulate_ball
from zivi.paper.step_solvers import PROBLEMS, SPEEDS, Array, Solver, Steps, worst_row_residual
from zivi.simulation.methods import ThetaGamma

STEP_SIZES = (1e-2, 1e-3, 1e-4)


def _ball_solver(h: float, solver: str, linearisations: int = 1, fall_backs: bool = True) -> Solver:
    def solve(states: Array, _: Array) -> Array:
        s, v = (np.ascontiguousarray(column) for column in states.T)
        # each solve begins at the signs of its state, as all starts here are
        lambda_s, lambda_v, _solved = _zivi.solve_steps(
            s,
            v,
            np.full_like(s, -GRAVITY),
            kappa=KAPPA,
            h=h,
            solver=solver,
            linearisations=linearisations,
            fall_backs=fall_backs,
        )
        return np.column_stack([lambda_s, lambda_v])

    return solve


def ball_solvers(h: float) -> dict[str, Solver]:
    """Return zivi's general solvers and those of Siconos if it is installed.

    "outer n": at most n linearisations; "inner only": without the fall-backs after Josephy-Newton.
    """
    own = {f"outer {n}": _ball_solver(h, "outer", n) for n in (1, 5, 20)}
    own["inner only"] = _ball_solver(h, "newton", fall_backs=False)
    own["inner"] = _ball_solver(h, "newton")
    return own | step_solvers.siconos_solvers("ball", KAPPA, GRAVITY, h)


@np.errstate(all="ignore")  # a failed solve may have left anything
def ball_residual(h: float, states: Array, multipliers: Array) -> Array:
    """Relative natural residual of the implicit Euler step."""
    (s, v), (lambda_s, lambda_v) = states.T, multipliers.T
    r = 1.0 - KAPPA * lambda_s * lambda_v
    v_new = v - h * lambda_s * GRAVITY / r
    s_new = s + h * r * v_new
    of_v = np.abs(v) + h * GRAVITY / r
    of_s = np.abs(s) + h * r * of_v
    return worst_row_residual([(lambda_s, s_new, of_s), (lambda_v, v_new, of_v)])


def random_ball_states(speed: float, h: float, seed: int) -> Array:
    """States near the wall: ``|v| <= speed``, ``|s| <= h speed``, uniform."""
    random = np.random.default_rng(seed)
    v = speed * random.uniform(-1.0, 1.0, PROBLEMS)
    return np.column_stack([h * speed * random.uniform(-1.0, 1.0, PROBLEMS), v])


def ball_states(h: float) -> Array:
    """Return the states of the paper's ball up to its rest (h in s, speeds in m/s)."""
    sol = simulate_ball(ThetaGamma(h))
    moving = sol.t < (sol.t[-1] if sol.rest_time is None else sol.rest_time)
    return np.column_stack([sol.transformed.s[moving], sol.transformed.v[moving]])


def ball_step_sets() -> Iterator[Steps]:
    """Yield all steps that are measured."""

    def steps(label: str, h: float, states: Array) -> Steps:
        return Steps(
            "ball", label, states, np.sign(states), ball_solvers(h), partial(ball_residual, h)
        )

    for h in STEP_SIZES[:2]:
        yield steps(f"ball, h={h:.0e}", h, ball_states(h))
    for k, h in enumerate(STEP_SIZES):
        for j, speed in enumerate(SPEEDS):
            label = f"random, h={h:.0e}, |v|<={speed:.0e}"
            yield steps(label, h, random_ball_states(speed, h, seed=10 * k + j))
