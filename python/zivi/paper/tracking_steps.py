"""Steps of the tracker of section V, with six simultaneous signs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

import zivi._zivi as _zivi
from zivi.control.closed_loop import simulate_closed_loop
from zivi.control.twisting import TwistingTracker
from zivi.paper import step_solvers
from zivi.paper.closed_loops import (
    FORCE as F,
    FORCE_REF as F_REF,
    KAPPA,
    MU1,
    MU2,
    START,
    START_REF,
    H,
)
from zivi.paper.step_solvers import PROBLEMS, SPEEDS, Array, Solver, Steps, worst_row_residual
from zivi.simulation.methods import ThetaGamma
from zivi.system.mass import ImpactSystem

T_END = 2.0
Branch = Literal["positive", "nearest"]
BRANCHES: tuple[Branch, ...] = ("positive", "nearest")


def _loop_solver(solver: str, linearisations: int = 1, fall_backs: bool = True) -> Solver:
    def solve(states: Array, starts: Array) -> Array:
        signs, _ = _zivi.solve_tracking_steps(
            states,
            starts,
            gains=(MU1, MU2),
            kappa=KAPPA,
            kappa_ref=KAPPA,
            h=H,
            f=F,
            f_ref=F_REF,
            solver=solver,
            linearisations=linearisations,
            fall_backs=fall_backs,
        )
        return signs

    return solve


def loop_solvers() -> dict[str, Solver]:
    """Return zivi's general solvers, the control update, and Siconos' solvers if installed.

    "outer n": at most n linearisations; "inner only": without the fall-backs after Josephy-Newton.
    """
    own = {f"outer {n}": _loop_solver("outer", n) for n in (1, 5, 20, 100)}
    own["inner only"] = _loop_solver("newton", fall_backs=False)
    own["inner"] = _loop_solver("newton")
    own["tick"] = _loop_solver("exact")
    return own | step_solvers.siconos_solvers("tracking", MU1, MU2, KAPPA, KAPPA, F, F_REF, H)


@np.errstate(all="ignore")  # a failed solve may have left anything
def loop_residual(states: Array, multipliers: Array) -> Array:
    """Relative natural residual of the six inclusions."""
    (s, v, s_ref, v_ref), (ls, lv, lsr, lvr, les, lev) = states.T, multipliers.T
    r, r_ref = 1.0 - KAPPA * ls * lv, 1.0 - KAPPA * lsr * lvr
    a = lsr * F_REF / r_ref
    reference_v = v_ref + H * a
    reference_s = s_ref + H * r_ref * reference_v
    held = ls**2 * (a - MU1 * les - MU2 * lev)
    plant_v = v + H * (held + ls * (1.0 - ls**2) * F / r)
    plant_s = s + H * r * plant_v
    of_v = np.abs(v) + H * (MU1 + MU2 + np.abs(a) + np.abs(F) / r)
    of_s = np.abs(s) + H * r * of_v
    of_v_ref = np.abs(v_ref) + H * np.abs(F_REF) / r_ref
    of_s_ref = np.abs(s_ref) + H * r_ref * of_v_ref
    rows = (
        (ls, plant_s, of_s),
        (lv, plant_v, of_v),
        (lsr, reference_s, of_s_ref),
        (lvr, reference_v, of_v_ref),
        (les, plant_s - reference_s, of_s + of_s_ref),
        (lev, plant_v - reference_v, of_v + of_v_ref),
    )
    return worst_row_residual(rows)


def signs_of(states: Array) -> Array:
    """Return the signs of states and of their errors, with which a first solve can begin."""
    s, v, s_ref, v_ref = states.T
    signs: Array = np.sign(np.column_stack([s, v, s_ref, v_ref, s - s_ref, v - v_ref]))
    return signs


def random_loop_states(speed: float, seed: int, problems: int = PROBLEMS) -> Array:
    """States near the wall and near the reference, uniform.

    ``|v|, |v_r - v| <= speed`` and ``|s|, |s_r - s| <= h speed``.
    """
    random = np.random.default_rng(seed)
    within = speed * np.array([H, 1.0])
    z = within * random.uniform(-1.0, 1.0, (problems, 2))
    error = within * random.uniform(-1.0, 1.0, (problems, 2))
    return np.column_stack([z, z + error])


def loop_states(branch: Branch) -> tuple[Array, Array]:
    """Return the lifted states of the paper's loop, and the signs of its ticks."""
    tracker = TwistingTracker(MU1, MU2, h=H, kappa=KAPPA, branch=branch, landing=False)
    tracker.reset(*START_REF)
    run = simulate_closed_loop(
        ImpactSystem(F, kappa=KAPPA),
        tracker,
        (0.0, T_END),
        START,
        force_ref=F_REF,
        method=ThetaGamma(H),
    )
    measured: Array = np.column_stack(_zivi.lift(run.x[:-1], run.xdot[:-1], 1.0, KAPPA))
    references = []
    for x, xdot in zip(run.x[:-1], run.xdot[:-1], strict=True):
        references.append(tracker.state[:2])
        tracker.step(x, xdot, F, F_REF)
    reference = np.array(references)
    if branch == "nearest":
        (s, v), (s_ref, v_ref) = measured.T, reference.T
        # by the energy of the error, mu1 |e_s| + e_v^2/2
        nearer = MU1 * (np.abs(s + s_ref) - np.abs(s - s_ref)) + 2.0 * v * v_ref
        measured[nearer < 0.0] *= -1.0
    return np.column_stack([measured, reference]), run.signs[:-1]


def loop_step_sets() -> Iterator[Steps]:
    """Yield all steps that are measured."""
    available = loop_solvers()

    def steps(label: str, states: Array, starts: Array) -> Steps:
        return Steps("tracking", f"tracking, {label}", states, starts, available, loop_residual)

    for branch in BRANCHES:
        states, signs = loop_states(branch)
        own = signs_of(states)
        first, unknown = own[:1], np.full_like(own[1:], np.nan)
        yield steps(f"{branch}, tick", states, np.vstack([first, signs[:-1]]))
        yield steps(f"{branch}, state", states, own)
        yield steps(f"{branch}, own last", states, np.vstack([first, unknown]))
    for j, speed in enumerate(SPEEDS):
        states = random_loop_states(speed, seed=j)
        yield steps(f"random, |v|<={speed:.0e}", states, signs_of(states))
