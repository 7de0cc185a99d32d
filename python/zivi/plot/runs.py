"""Which runs a plot can draw; the error for another names the plot that can."""

from __future__ import annotations

from typing import Any

__all__ = ["check_run"]

MOTION = ("t", "x", "xdot", "impacts")
"""What every run has."""

ADVICE = {
    "control": "a trajectory has no control, zivi.simulate_closed_loop gives runs that have one",
    "multipliers": "use zivi.plot.signs for a closed loop",
    "signs": "use zivi.plot.multipliers for a trajectory",
}
"""What to do with a run of the other kind."""


def check_run(plot: str, run: Any, *, needs: str | None = None, of: str | None = None) -> None:
    """Raise a TypeError for what a plot cannot draw.

    Parameters
    ----------
    plot : str
        Name of the plot.
    run : object
        What it was given.
    needs : str, optional
        An attribute that it draws, which only one kind of run has.
    of : str, optional
        Name of this kind.
    """
    if not all(hasattr(run, name) for name in MOTION):
        kinds = "zivi.Trajectory or a zivi.ClosedLoop" if of is None else f"zivi.{of}"
        advice = _instead(run)
    elif needs is None or hasattr(run, needs):
        return
    else:
        kinds, advice = f"zivi.{of}", f": {ADVICE[plot]}"
    raise TypeError(f"zivi.plot.{plot} draws a {kinds}, got {type(run).__name__}{advice}")


def _instead(run: Any) -> str:
    if hasattr(run, "gaps"):
        return ": of a mechanical system draw zivi.plot.gaps, reactions, coordinates, configuration"
    if hasattr(run, "n_impacts"):
        return ": a batch keeps no motion, simulate the run that is to be drawn by itself"
    if isinstance(run, list | tuple):
        return ": draw one run after the other into the same axes, ax="
    return ""
