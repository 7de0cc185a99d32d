"""Explicit and implicit signs in the controller: same gains, same period.

Measured in the sampled loop on the paper's plant while it holds the reference: on a reference that
rises freely, at its apex (where sgn v switches), and on the wall (the paper's tracking problem once
the reference rests). A mass at exact rest does not chatter with any controller, so the last is also
done with 1.5 m/s^2 that the controller does not know of.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np
from rich.table import Table

from zivi import plot
from zivi.control.loop_run import ClosedLoop
from zivi.paper import report
from zivi.paper.closed_loops import FORCE, KAPPA, MU1, MU2, track
from zivi.paper.report import PaperFigure, loop_data, max_abs

CONTROLLERS = ("explicit", "positive", "nearest")
STEPS = (1e-2, 1e-3, 1e-4)
UNMODELLED = 1.5
CASES = (("rising", 0.0), ("apex", 0.0), ("wall", 0.0), ("wall", UNMODELLED))
WINDOWS = {"rising": (0.3, 0.9), "apex": (0.9, 1.2), "wall": (2.0, 3.0)}
"""When it is measured (s); the apex is at 10/9.81 s."""


@dataclasses.dataclass(frozen=True)
class Chattering:
    """One run, over its window.

    Parameters
    ----------
    where : {"rising", "apex", "wall"}
        Where the reference is.
    force_error : float
        What the controller does not know of the force (m/s^2).
    h : float
        Sampling period (s).
    controller : str
        Explicit signs, or implicit ones with the named branch strategy.
    u_range : float
        Largest less smallest control (m/s^2).
    u_variation : float
        Sum of the changes of the control, per second (m/s^3).
    error_range : float
        Largest less smallest ``x - x_r`` (m).
    error_mean : float
        Mean of ``x - x_r`` (m).
    velocity : float
        Largest ``|x' - x_r'|`` (m/s).
    """

    where: str
    force_error: float
    h: float
    controller: str
    u_range: float
    u_variation: float
    error_range: float
    error_mean: float
    velocity: float


def run_case(where: str, force_error: float, h: float, controller: str) -> ClosedLoop:
    """Run one case until the end of its window."""
    force, t_end = FORCE + force_error, WINDOWS[where][1]
    if where == "wall":
        return track(controller, h, force=force, t_end=t_end)
    up = (3.0, 10.0)
    return track(controller, h, start=up, start_ref=up, force=force, force_ref=FORCE, t_end=t_end)


def measure_chattering() -> list[Chattering]:
    """Run all cases."""
    return [
        _measure_case(where, force_error, h, controller)
        for where, force_error in CASES
        for h in STEPS
        for controller in CONTROLLERS
    ]


def _measure_case(where: str, force_error: float, h: float, controller: str) -> Chattering:
    made = run_case(where, force_error, h, controller)
    start, end = WINDOWS[where]
    window = made.t >= start
    u, error = made.u[window], made.error[window]
    return Chattering(
        where=where,
        force_error=force_error,
        h=h,
        controller=controller,
        u_range=float(np.ptp(u)),
        u_variation=float(np.abs(np.diff(u)).sum()) / (end - start),
        error_range=float(np.ptp(error)),
        error_mean=float(error.mean()),
        velocity=max_abs(made.xdot[window] - made.xdot_ref[window]),
    )


def chattering_table(rows: Iterable[Chattering]) -> Table:
    """Format the rows for a terminal."""
    return report.terminal_table(
        "Explicit and implicit signs",
        "sum |du| per second; u in m/s^2, x in m, x' in m/s; dF: outward, unknown",
        ("where", "dF", "h", "signs", "range u", "sum|du|", "range e", "mean e", "max|e'|"),
        [_chattering_cells(row) for row in rows],
    )


def _chattering_cells(row: Chattering) -> tuple[str, ...]:
    where, force_error, h, controller, *measured = dataclasses.astuple(row)
    numbers = (f"{number:.3g}" if 1 <= number < 1e3 else f"{number:.2g}" for number in measured)
    return (where, f"{force_error:g}", f"{h:g}", controller, *numbers)


def draw_chattering() -> PaperFigure:
    """Draw control and error of both: rising and on the wall, with the unknown force."""
    import matplotlib.pyplot as plt

    made: dict[str, ClosedLoop] = {}
    result, axes = plt.subplots(2, 2, layout="constrained", figsize=(8.4, 4.8), sharex="col")
    titles = (("rising", 0.0, "reference in the air"), ("wall", UNMODELLED, TITLE_ON_THE_WALL))
    for (above, below), (where, force_error, title) in zip(axes.T, titles, strict=True):
        start, _ = WINDOWS[where]
        for controller, label in (("explicit", "explicit"), ("positive", "implicit")):
            sol = made[f"{where}_{controller}"] = run_case(where, force_error, 1e-3, controller)
            window = (sol.t >= start) & (sol.t <= start + 0.04)
            color = plot.ORANGE if controller == "explicit" else plot.BLUE
            above.step(sol.t[window], sol.u[window], where="post", color=color, lw=1, label=label)
            below.plot(sol.t[window], sol.error[window] * 1e6, color=color, lw=1)
        above.set_title(title, fontsize="medium")
        below.set_xlabel("time $t$ (s)")
    axes[0, 0].set_ylabel("control $u$ (m/s$^2$)")
    axes[1, 0].set_ylabel(r"error $x - x_r$ ($\mu$m)")
    lines = axes[0, 0].get_legend_handles_labels()
    result.legend(*lines, loc="outside upper center", ncols=2, frameon=False)
    title = "Explicit and implicit signs in the tracker"
    settings: dict[str, float | str] = {
        "h": 1e-3,
        "mu1": MU1,
        "mu2": MU2,
        "kappa": KAPPA,
        "F": FORCE,
    }
    settings |= {"branch": "positive", "loop": "sampled"}
    data = {name: loop_data(sol) for name, sol in made.items()}
    return PaperFigure("chattering", title, settings, result, data)


TITLE_ON_THE_WALL = "reference at rest, 1.5 m/s$^2$ outward unknown"
