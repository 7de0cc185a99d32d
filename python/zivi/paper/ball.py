"""Section II of the paper: a ball bounces, accumulates and rests (figures 1 to 4).

The paper gives kappa, the initial state and gravity. The step size is ours.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

import zivi._zivi as _zivi
from zivi import plot
from zivi.paper import step_solvers
from zivi.paper.report import (
    Check,
    PaperFigure,
    draw_sv_plane,
    farthest_from,
    max_abs,
    rest_time_of,
    run_data,
)
from zivi.paper.step_solvers import PROBLEMS, SPEEDS, Array, Solver, Steps, worst_row_residual
from zivi.simulation.method_settings import Method
from zivi.simulation.methods import ExplicitEuler, ThetaGamma
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.mass import ImpactSystem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KAPPA, X0, XDOT0, GRAVITY = 0.41, 1.0, 6.0, 9.81
H, T_END = 1e-3, 3.0


def simulate_ball(method: Method, t_end: float = T_END) -> Trajectory:
    """Simulate the paper's ball up to `t_end` (s)."""
    return simulate(ImpactSystem(-GRAVITY, kappa=KAPPA), (0.0, t_end), (X0, XDOT0), method)


class Exact:
    """The ball in closed form (times in s, speeds in m/s, heights in m)."""

    e = (1 - KAPPA) / (1 + KAPPA)
    speed = math.sqrt(XDOT0**2 + 2 * GRAVITY * X0)
    """Speed just before the first impact."""
    first = (XDOT0 + speed) / GRAVITY
    zeno = first + 2 * e * speed / (GRAVITY * (1 - e))

    @classmethod
    def impact(cls, n: int) -> float:
        """Time of the impact after `n` rebounds."""
        return cls.first + 2 * cls.e * cls.speed * (1 - cls.e**n) / (GRAVITY * (1 - cls.e))

    @classmethod
    def peak(cls, n: int) -> float:
        """Height reached between impacts `n` and `n + 1` (numbered from 1)."""
        return float(cls.e ** (2 * n) * cls.speed**2 / (2 * GRAVITY))


SETTINGS: dict[str, float | str] = {
    "h": H,
    "kappa": KAPPA,
    "g": GRAVITY,
    "x(0)": X0,
    "x'(0)": XDOT0,
}
IMPLICIT: dict[str, float | str] = {"scheme": "implicit Euler"}


def draw_ball(sol: Trajectory) -> Iterator[PaperFigure]:
    """Draw figures 1 to 4."""
    lambdas = ["lambda_s", "lambda_v"]
    pictures = (
        ("fig1_sv_plane", "The ball in the (s, v) plane", _draw_ball_plane, ["s", "v"], ""),
        ("fig2_s_v", "The ball: s and v over time", _draw_lifted, ["s", "v"], ""),
        ("fig3_signs", "The ball: its signs over time", _draw_signs, lambdas, AT_REST),
        ("fig4_x_xdot", "The ball: position and velocity", _draw_physical, ["x", "xdot"], ""),
    )
    for name, title, draw, quantities, remark in pictures:
        data = {"": run_data(sol, quantities)}
        yield PaperFigure(name, title, IMPLICIT | SETTINGS, draw(sol), data, remark)


AT_REST = (
    "At rest lambda_s = 0 is the only value, while lambda_v may be any in [-1, 1]: zivi gives 0, "
    "the paper 1."
)


def _draw_ball_plane(sol: Trajectory) -> Figure:
    return draw_sv_plane(sol.transformed.s, sol.transformed.v, (0.02, 0.45))


def _draw_lifted(sol: Trajectory) -> Figure:
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(layout="constrained", figsize=(6.4, 4.0))
    plot.lifted(sol, ax)
    _mark_rest(sol, ax)
    ax.legend()
    return figure


def _draw_physical(sol: Trajectory) -> Figure:
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(
        2, 1, sharex=True, layout="constrained", figsize=(6.4, 5.0)
    )
    plot.position(sol, above).set(xlabel="")
    plot.velocity(sol, below)
    for ax in (above, below):
        _mark_rest(sol, ax)
    above.legend(*(entries[1:] for entries in above.get_legend_handles_labels()))
    return figure


def _mark_rest(sol: Trajectory, ax: Axes) -> None:
    """Mark the exact Zeno point and the scheme's rest time."""
    rest = rest_time_of(sol)
    exact = f"exact Zeno point, {Exact.zeno:.4f} s"
    ax.axvline(Exact.zeno, color="0.4", ls=":", lw=1.2, label=exact)
    scheme = f"rest of the scheme, {rest:g} s"
    ax.plot(rest, 0, "s", color="black", ms=5, mfc="none", label=scheme)


def _draw_signs(sol: Trajectory) -> Figure:
    import matplotlib.pyplot as plt

    figure, (whole, zoom) = plt.subplots(2, 1, layout="constrained", figsize=(6.4, 4.8))
    plot.signs(sol, whole).legend(loc="lower left")
    plot.signs(sol, zoom, marker=".", ms=3).set_xlim(2.37, 2.46)
    zoom.set_title("at the accumulation", fontsize="medium")
    zoom.get_legend().remove()
    whole.set_xlabel("")
    return figure


def explicit_and_implicit() -> PaperFigure:
    """Draw both schemes at the accumulation, at the same step size."""
    import matplotlib.pyplot as plt

    runs = {"explicit": simulate_ball(ExplicitEuler(H)), "implicit": simulate_ball(ThetaGamma(H))}
    figure, rows = plt.subplots(
        2, 2, sharex=True, sharey="row", layout="constrained", figsize=(7.2, 4.6)
    )
    for column, (name, sol) in enumerate(runs.items()):
        window = (sol.t >= 2.35) & (sol.t <= 2.6)
        above, below = rows[:, column]
        above.plot(sol.t[window], sol.x[window] * 1e3, color=plot.BLUE, lw=1)
        below.plot(sol.t[window], sol.xdot[window], color=plot.ORANGE, lw=1)
        for ax in (above, below):
            ax.axvline(Exact.zeno, color="0.5", ls=":", lw=1)
        above.set_title(f"{name} signs", fontsize="medium")
        below.set_xlabel("time $t$ (s)")
    rows[0, 0].set_ylabel("position $x$ (mm)")
    rows[1, 0].set_ylabel(r"velocity $\dot x$ (m/s)")
    rows[0, 1].text(Exact.zeno, 15, "  exact Zeno point")
    title = "The ball at its accumulation, explicit and implicit signs"
    data = {name: run_data(sol, ["x", "xdot", "s", "v"]) for name, sol in runs.items()}
    return PaperFigure("explicit_and_implicit", title, SETTINGS, figure, data)


def check_ball(sol: Trajectory) -> list[Check]:
    """Hold the run against closed forms and against another implementation of the scheme."""
    rest = rest_time_of(sol)
    at_rest = np.abs([sol.x, sol.xdot, sol.transformed.s, sol.transformed.v])[:, sol.t >= rest]
    held = sol.transformed.lambda_s[sol.t > rest]
    e_measured = -sol.resolved_impacts["xdot_after"] / sol.resolved_impacts["xdot_before"]
    fine, coarse, limit = (rest_time_of(simulate_ball(ThetaGamma(h))) for h in (1e-4, 1e-2, 1e-6))
    result = [
        Check("impacts accumulate (s)", rest, 2.45, "paper", 1e-2, "about 2.45"),
        Check("rest time, h=1e-3 (s)", rest, 2.444, "scheme", 1e-9),
        Check("rest time, h=1e-2 (s)", coarse, 2.34, "scheme", 1e-9),
        Check("rest time, h=1e-4 (s)", fine, 2.4626, "scheme", 1e-9),
        Check("rest time, h=1e-6 (s)", limit, Exact.zeno, "exact", 1e-4),
        Check("max |x,x',s,v| at rest", max_abs(at_rest), 0.0, "exact", 0.0),
        Check("max |lambda_s| at rest", max_abs(held), 0.0, "exact", 0.0),
        Check("restitution e", farthest_from(e_measured, Exact.e), Exact.e, "exact", 1e-12),
        Check("largest residual", max_abs(sol.residual), 0.0, "exact", 1e-13),
    ]
    for n in range(3):
        result.append(
            Check(
                f"impact {n + 1} (s)",
                sol.resolved_impacts["t"][n],
                Exact.impact(n),
                "exact",
                10 * H,
            )
        )
    times = [Exact.impact(0), Exact.impact(1), Exact.impact(2)]
    for n, (left, right) in enumerate(itertools.pairwise(times), start=1):
        peak = sol.x[(sol.t > left + 5 * H) & (sol.t < right - 5 * H)].max()
        result.append(Check(f"peak {n} (m)", peak, Exact.peak(n), "exact", 20 * H))
    return result


# Steps of the ball of section III: two signs.


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
