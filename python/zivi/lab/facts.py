"""What the runs come to, in numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from zivi.control.closed_loop import ClosedLoop
from zivi.lab.belt import BeltRun
from zivi.lab.runs import Runs
from zivi.simulation.trajectory import Trajectory

__all__ = ["NAMES", "facts", "warnings"]

NAMES = {
    "implicit": "implicit signs",
    "explicit": "explicit signs",
    "high_order": "SwitchedRK",
}
"""How the page calls the runs."""


def facts(runs: Runs, window: tuple[float, float] | None = None) -> list[dict[str, str]]:
    """Give a row for each run: rest and impacts, and what a closed loop does while it is shown.

    Parameters
    ----------
    runs : dict
        What `zivi.lab.runs.compute` gave.
    window : (float, float), optional
        Times that are shown (s); all by default.

    Returns
    -------
    list of dict
        From a column's title to its text.
    """
    if any(isinstance(run, BeltRun) for run in runs.values()):
        return [{"": NAMES[name]} | _belt(run, window) for name, run in runs.items()]
    others: dict[str, Any] = {**runs}
    return [
        {"": NAMES[name]} | _wall(name, run) | _control(run, window) for name, run in others.items()
    ]


def _belt(run: Any, window: tuple[float, float] | None) -> dict[str, str]:
    start, end = window or (run.t[0], run.t[-1])
    part = (run.t >= start) & (run.t <= end)
    jumps = np.abs(np.diff(run.friction[part])).sum()
    return {
        "sticks": f"{run.stuck:.1%} of the time",
        "caught": f"{run.catches} times",
        "largest |x| (m)": f"{np.abs(run.x[part]).max(initial=0.0):.4g}",
        "Σ|Δ friction| (N)": f"{jumps:.4g}",
    }


def _wall(name: str, run: Trajectory | ClosedLoop) -> dict[str, str]:
    rest = "no" if run.rest_time is None else f"from {run.rest_time:.6g} s"
    infinite = name == "high_order" and len(run.zeno_times) > 0
    impacts = "infinitely many" if infinite else str(len(run.impacts))
    return {"at rest at the end": rest, "impacts": impacts}


def _control(run: Trajectory | ClosedLoop, window: tuple[float, float] | None) -> dict[str, str]:
    if not isinstance(run, ClosedLoop):
        return {}
    start, end = window or (run.t[0], run.t[-1])
    part = (run.t >= start) & (run.t <= end)
    u = run.u[part]
    if len(u) < 2:
        return {}
    variation = float(np.abs(np.diff(u)).sum())
    row = {
        "u (m/s²)": f"{u.min():.4g} .. {u.max():.4g}",
        "Σ|Δu| (m/s²)": f"{variation:.4g}",
        "Σ|Δu| a second (m/s² per s)": f"{variation / (end - start):.3g}",
    }
    if not np.all(np.isnan(run.x_ref)):
        row["largest |x - x_r| (m)"] = f"{float(np.abs(run.error[part]).max()):.2g}"
    if run.xdot_est is not None:
        off = float(np.sqrt(np.mean((run.xdot_est[part] - run.xdot[part]) ** 2)))
        row["observed velocity off by, rms (m/s)"] = f"{off:.2g}"
    return row


def warnings(runs: Runs) -> list[str]:
    """Say what did not go as asked: runs that ended early, control updates that failed."""
    said = [f"{NAMES[name]}: {run.message}" for name, run in runs.items() if not run.success]
    counts = {name: str(getattr(run, "updates", "")) for name, run in runs.items()}
    said += [f"{NAMES[name]}: {count}" for name, count in counts.items() if count]
    return said
