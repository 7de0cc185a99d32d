"""Section VI of the paper: the mass follows a bouncing reference into its Zeno point (6 to 8).

The paper's data are used, with h = 1e-3 s, which it does not give. What its figures 6 to 8 show
is our choice: 6 positions and velocities with the reference, 7 the errors in ``(s, v)`` over time
and against each other, 8 the control and the six signs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from zivi import plot
from zivi.closed_loop import ClosedLoop
from zivi.methods import ThetaGamma
from zivi.paper.checks import Check
from zivi.paper.closed_loops import (
    FORCE,
    FORCE_REF,
    KAPPA,
    START,
    START_REF,
    H,
    closed_form_zeno,
    largest,
    last_above,
    track,
)
from zivi.simulate import simulate
from zivi.system import ImpactSystem
from zivi.trajectory import Trajectory
from zivi.transform import lift

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["checks", "errors", "figures", "runs", "sampled_and_paper"]

NEAR = 1e-2
"""The reference counts as reached within this distance (m)."""
SETTLED = 1.5
"""From here on both rest (s)."""
UNMODELLED = 1.5
SHOWN = 1.6
"""End of the time axes (s)."""


def runs() -> dict[str, ClosedLoop]:
    """Run both loops with both branch strategies; the first is the paper's."""
    return {
        f"{loop}_{branch}": track(branch, sampled=loop == "sampled")
        for loop in ("paper", "sampled")
        for branch in ("positive", "nearest")
    }


def errors(run: ClosedLoop) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Errors ``e_s = s - s_r`` and ``e_v = v - v_r``, all lifted to ``s >= 0`` as in the paper."""
    s, v = lift(run.x, run.xdot, kappa=KAPPA)
    s_ref, v_ref = lift(run.x_ref, run.xdot_ref, kappa=KAPPA)
    return s - s_ref, v - v_ref


def figures(run: ClosedLoop) -> dict[str, Figure]:
    """Draw figures 6 to 8."""
    return {
        "fig6_tracking": _states(run),
        "fig7_errors": _errors(run),
        "fig8_control_and_signs": _control(run),
    }


def _states(run: ClosedLoop) -> Figure:
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(
        2, 1, sharex=True, layout="constrained", figsize=(6.4, 4.8)
    )
    plot.position(run, above).set(xlabel="")
    plot.velocity(run, below).set_xlim(0, SHOWN)
    above.legend(loc="upper right", bbox_to_anchor=(0.79, 1.0))
    below.legend(loc="lower right")
    zeno = closed_form_zeno(START_REF, FORCE_REF)
    for ax in (above, below):
        ax.axvline(zeno, color="0.5", ls=":", lw=1)
    above.text(zeno, 4.2, f" Zeno point of\n the reference\n {zeno:.4f} s")
    return figure


def _errors(run: ClosedLoop) -> Figure:
    import matplotlib.pyplot as plt

    e_s, e_v = errors(run)
    figure, (left, right) = plt.subplots(1, 2, layout="constrained", figsize=(8.4, 3.6))
    left.plot(run.t, e_s, color=plot.BLUE, label="$e_s$ (m)")
    left.plot(run.t, e_v, color=plot.ORANGE, ls="--", label="$e_v$ (m/s)")
    left.set(xlabel="time $t$ (s)", ylabel="errors in $(s, v)$", xlim=(0, SHOWN))
    left.legend()
    right.plot(e_s, e_v, color=plot.BLUE, lw=1)
    right.plot(e_s[0], e_v[0], "o", color=plot.GREEN, label="start")
    right.plot(0, 0, "s", color=plot.ORANGE, label="end")
    right.set(xlabel="$e_s$ (m)", ylabel="$e_v$ (m/s)")
    right.legend()
    return figure


PAIRS = (
    (r"\lambda_s", r"\lambda_v"),
    (r"\lambda_{s_r}", r"\lambda_{v_r}"),
    (r"\lambda_{e_s}", r"\lambda_{e_v}"),
)
"""The six signs in the order of the columns of a run."""


def _control(run: ClosedLoop) -> Figure:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        4, 1, sharex=True, layout="constrained", figsize=(6.4, 6.4), height_ratios=(2, 1, 1, 1)
    )
    plot.control(run, axes[0]).set(xlabel="", ylabel="$u$ (m/s$^2$)")
    for ax, pair, column in zip(axes[1:], PAIRS, (0, 2, 4), strict=True):
        _pair_of_signs(run, ax, pair, column)
    axes[2].set_ylabel("multipliers (1)")
    axes[3].set(xlabel="time $t$ (s)", xlim=(0, SHOWN))
    return figure


def _pair_of_signs(run: ClosedLoop, ax: Axes, names: tuple[str, str], column: int) -> None:
    looks = ((plot.BLUE, "-"), (plot.ORANGE, "--"))
    for name, (color, style), offset in zip(names, looks, (0, 1), strict=True):
        values = run.signs[:, column + offset]
        ax.step(run.t, values, where="post", color=color, ls=style, lw=1.2, label=f"${name}$")
    ax.set_ylim(-1.2, 1.2)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def sampled_and_paper(made: dict[str, ClosedLoop]) -> Figure:
    """Draw the distance to the reference in both loops, with both branch strategies."""
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(layout="constrained", figsize=(6.4, 3.6))
    looks = ((plot.BLUE, "-"), (plot.GREEN, "--"), (plot.ORANGE, "-"), (plot.PURPLE, "--"))
    for (name, run), (color, style) in zip(made.items(), looks, strict=True):
        loop, branch = name.split("_")
        label = f"{'the paper' + chr(39) + 's' if loop == 'paper' else loop} loop, {branch}"
        distance = np.abs(run.error)
        ax.semilogy(run.t, np.maximum(distance, 1e-9), color=color, ls=style, lw=1, label=label)
    ax.axhline(NEAR, color="0.5", ls=":", lw=1)
    ax.set(xlabel="time $t$ (s)", ylabel="$|x - x_r|$ (m), cut at $10^{-9}$", xlim=(0, SHOWN))
    ax.legend(loc="lower left")
    return figure


def checks(made: dict[str, ClosedLoop]) -> list[Check]:
    """Hold the runs against closed forms and against another implementation."""
    result = [
        _zeno("Zeno point of the reference (s)", START_REF, FORCE_REF),
        _zeno("Zeno point of the free plant (s)", START, FORCE),
    ]
    # by a prototype in Python with the same selection rule
    expected = {"paper_positive": 1.198, "sampled_positive": 1.21, "sampled_nearest": 1.132}
    for name, time in expected.items():
        what = f"last 1 cm off, {_short(name)} (s)"
        result.append(Check(what, last_above(made[name], NEAR), time, "scheme", 2 * H))
    for name, run in made.items():
        after = run.t >= SETTLED
        result += [
            Check(f"max |e|, |x'|, {_short(name)}", _unrest(run, after), 0.0, "exact", 0.0),
            Check(f"u at rest, {_short(name)}", _farthest(run.u[after]), -FORCE, "exact", 0.0),
        ]
    for branch in ("positive", "nearest"):
        run = track(branch, force=FORCE + UNMODELLED)
        after = run.t >= SETTLED
        what = f"force +{UNMODELLED}, {branch}: max"
        result += [
            Check(f"{what} |e| (m)", largest(run.error[after]), 0.0, "bound", 1e-6),
            Check(f"{what} |x'| (m/s)", largest(run.xdot[after]), 0.0, "bound", 2e-3),
        ]
    return result


def _short(name: str) -> str:
    return name.replace("_", " ")


def _unrest(run: ClosedLoop, after: NDArray[np.bool_]) -> float:
    return largest(np.stack([run.error[after], run.xdot[after]]))


def _farthest(u: NDArray[np.float64]) -> float:
    return float(u[np.argmax(np.abs(u + FORCE))])


def _zeno(what: str, state: tuple[float, float], force: float) -> Check:
    exact = closed_form_zeno(state, force)
    sol: Trajectory = simulate(
        ImpactSystem(force, kappa=KAPPA), (0.0, exact + 0.1), state, ThetaGamma(1e-6)
    )
    measured = float(sol.zeno_times[0]) if len(sol.zeno_times) else float("nan")
    return Check(what, measured, exact, "exact", 1e-4)
