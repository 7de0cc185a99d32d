"""What is seen, in a sentence or two."""

from __future__ import annotations

from typing import Any

import numpy as np

from zivi.control.closed_loop import ClosedLoop
from zivi.lab.belt import BeltRun
from zivi.lab.runs import Runs
from zivi.simulation.trajectory import Trajectory

__all__ = ["sentence"]

LATE = 0.5
"""The last part of the motion before the rest, if there is one, in which a loop is judged."""
ALIKE = 1.5
"""Changes of the control that differ by less than this factor are called alike."""


def sentence(runs: Runs) -> str:
    """Say what implicit signs do on the screen, and what explicit ones do.

    Parameters
    ----------
    runs : dict
        What `zivi.lab.runs.compute` gave.

    Returns
    -------
    str
        Plain text.
    """
    implicit, explicit = runs["implicit"], runs["explicit"]
    if isinstance(implicit, BeltRun):
        assert isinstance(explicit, BeltRun)
        return _belt(implicit, explicit, runs["high_order"])
    if not isinstance(implicit, ClosedLoop):
        assert isinstance(explicit, Trajectory)
        return _ball(implicit, explicit, runs["high_order"])
    assert isinstance(explicit, ClosedLoop)
    if np.all(np.isnan(implicit.x_ref)):
        return f"The mass is {_rest(implicit)} with implicit signs, {_rest(explicit)} with " + (
            f"explicit ones. {_switching(implicit, explicit)}"
        )
    start, end = _part(implicit, explicit)
    errors = [
        f"{np.abs(run.error[(run.t >= start) & (run.t <= end)]).max():.2g} m"
        for run in (implicit, explicit)
    ]
    return (
        f"From {start:.3g} to {end:.3g} s the mass is at most {errors[0]} off its reference with "
        f"implicit signs, {errors[1]} with explicit ones. {_switching(implicit, explicit)}"
    )


def _ball(implicit: Trajectory, explicit: Trajectory, high_order: Any) -> str:
    said = (
        f"The ball is {_rest(implicit)} with implicit signs, {_rest(explicit)} with explicit ones."
    )
    if isinstance(high_order, Trajectory) and high_order.rest_time is not None:
        said += f" SwitchedRK, to its tolerance: {_rest(high_order)}."
    return said


def _belt(implicit: BeltRun, explicit: BeltRun, high_order: Any) -> str:
    said = f"With the implicit sign the mass sticks {implicit.stuck:.1%} of the time"
    said += f", to the tolerance of SwitchedRK {high_order.stuck:.1%}."
    jumps = np.abs(np.diff(explicit.friction)) > 0.0
    if jumps.any():
        said += f" The explicit sign never sticks: its force jumps {int(jumps.sum())} times."
    return said


def _rest(run: Trajectory | ClosedLoop) -> str:
    if run.rest_time is None:
        return f"not at rest within {run.t[-1]:.4g} s"
    return f"exactly at rest from {run.rest_time:.4g} s"


def _switching(implicit: ClosedLoop, explicit: ClosedLoop) -> str:
    """Compare how much the controls change late in the motion."""
    start, end = _part(implicit, explicit)
    quiet, loud = (
        float(np.abs(np.diff(run.u[(run.t >= start) & (run.t <= end)])).sum())
        for run in (implicit, explicit)
    )
    if max(quiet, loud) == 0.0:
        return "Then neither control changes any more."
    if quiet * ALIKE < loud:
        much = f"{loud / quiet:.3g} times" if quiet > 1e-6 * loud else "more than a million times"
        return f"The explicit control then changes {much} as much as the implicit one."
    if loud * ALIKE < quiet:
        return f"The implicit control then changes {quiet / max(loud, 1e-300):.3g} times as much."
    return "Both controls then change alike."


def _part(*runs: ClosedLoop) -> tuple[float, float]:
    """Give the later part of the time in which a mass moves (s)."""
    first, last = float(runs[0].t[0]), float(runs[0].t[-1])
    ends = [last if run.rest_time is None else float(run.rest_time) for run in runs]
    end = max(ends)
    return end - LATE * (end - first), end
