"""Section III of the paper: a ball bounces, accumulates and rests (figures 1 to 4).

The paper gives kappa, the initial state and gravity, but neither the step size nor the end of
the time axis; h = 1e-3 s gives its "about 2.45 s".
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from zivi import plot
from zivi.methods import ExplicitEuler, Method, ThetaGamma
from zivi.paper.checks import Check
from zivi.simulate import simulate
from zivi.system import ImpactSystem
from zivi.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["checks", "explicit_and_implicit", "figures", "run"]

KAPPA, X0, XDOT0, GRAVITY = 0.41, 1.0, 6.0, 9.81
H, T_END = 1e-3, 3.0


def run(method: Method, t_end: float = T_END) -> Trajectory:
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


def figures(sol: Trajectory) -> dict[str, tuple[Figure, list[str]]]:
    """Draw figures 1 to 4; each with the names of the quantities that it shows."""
    import matplotlib.pyplot as plt

    made: dict[str, tuple[Figure, list[str]]] = {}

    figure, ax = plt.subplots(layout="constrained", figsize=(6.4, 3.4))
    plot.lifted(sol, ax)
    made["fig1_transformed_state"] = figure, ["s", "v"]

    figure, (above, below) = plt.subplots(
        2, 1, sharex=True, layout="constrained", figsize=(6.4, 4.6)
    )
    plot.position(sol, above).set(xlabel="")
    plot.velocity(sol, below)
    for ax in (above, below):
        ax.axvline(Exact.zeno, color="0.5", ls=":", lw=1)
    above.text(Exact.zeno, 2.4, f"exact Zeno point {Exact.zeno:.4f} s  ", ha="right")
    made["fig2_position_velocity"] = figure, ["x", "xdot"]

    figure, ax = plt.subplots(layout="constrained", figsize=(6.4, 4.2))
    plot.phase_plane(sol, ax)
    ax.plot([sol.s[0]], [sol.v[0]], "o", color=plot.GREEN, label="start")
    ax.plot([0], [0], "s", color=plot.ORANGE, label="rest")
    ax.legend()
    made["fig3_phase_plane"] = figure, ["s", "v"]

    figure, (whole, zoom) = plt.subplots(2, 1, layout="constrained", figsize=(6.4, 4.6))
    plot.multipliers(sol, whole).legend(loc="lower left")
    plot.multipliers(sol, zoom, marker=".", ms=3).set_xlim(2.37, 2.46)
    zoom.set_title("at the accumulation", fontsize="medium")
    made["fig4_multipliers"] = figure, ["lambda_s", "lambda_v"]
    return made


def explicit_and_implicit() -> tuple[Figure, dict[str, Trajectory]]:
    """Draw both schemes at the accumulation, at the same step size."""
    import matplotlib.pyplot as plt

    runs = {"explicit": run(ExplicitEuler(H)), "implicit": run(ThetaGamma(H))}
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
        above.set_title(f"{name} signs, $h$ = {H:g} s", fontsize="medium")
        below.set_xlabel("time $t$ (s)")
    rows[0, 0].set_ylabel("position $x$ (mm)")
    rows[1, 0].set_ylabel(r"velocity $\dot x$ (m/s)")
    rows[0, 1].text(Exact.zeno, 15, "  exact Zeno point")
    return figure, runs


def checks(sol: Trajectory) -> list[Check]:
    """Hold the run against closed forms and against another implementation of the scheme."""
    rest = _rest(sol)
    at_rest = np.abs([sol.x, sol.xdot, sol.s, sol.v])[:, sol.t >= rest]
    held = sol.lambda_s[sol.t > rest]
    e_measured = -sol.impacts["xdot_after"] / sol.impacts["xdot_before"]
    fine, coarse, limit = (_rest(run(ThetaGamma(h))) for h in (1e-4, 1e-2, 1e-6))
    result = [
        Check("rest time (s)", rest, 2.444, "scheme", 1e-9, "about 2.45"),
        Check("rest time, h=1e-2 (s)", coarse, 2.34, "scheme", 1e-9),
        Check("rest time, h=1e-4 (s)", fine, 2.4626, "scheme", 1e-9),
        Check("rest time, h=1e-6 (s)", limit, Exact.zeno, "exact", 1e-4),
        Check("max |x,x',s,v| at rest", _largest(at_rest), 0.0, "exact", 0.0),
        Check("max |lambda_s| at rest", _largest(held), 0.0, "exact", 0.0),
        Check("restitution e", _farthest(e_measured, Exact.e), Exact.e, "exact", 1e-12),
        Check("largest residual", _largest(sol.residual), 0.0, "exact", 1e-13),
    ]
    for n in range(3):
        result.append(
            Check(f"impact {n + 1} (s)", sol.impacts["t"][n], Exact.impact(n), "exact", 10 * H)
        )
    times = [Exact.impact(0), Exact.impact(1), Exact.impact(2)]
    for n, (left, right) in enumerate(itertools.pairwise(times), start=1):
        peak = sol.x[(sol.t > left + 5 * H) & (sol.t < right - 5 * H)].max()
        result.append(Check(f"peak {n} (m)", peak, Exact.peak(n), "exact", 20 * H))
    return result


def _rest(sol: Trajectory) -> float:
    return math.nan if sol.rest_time is None else sol.rest_time


def _largest(values: np.ndarray) -> float:
    # an empty selection must not pass for zero
    return float(np.max(np.abs(values))) if values.size else math.nan


def _farthest(values: np.ndarray, center: float) -> float:
    return float(values[np.argmax(np.abs(values - center))])
