"""A run as lines that can be drawn: smooth between samples, broken at impacts."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from zivi.base.check import Array

if TYPE_CHECKING:
    from zivi.control.closed_loop import ClosedLoop
    from zivi.simulation.trajectory import Trajectory

__all__ = ["Line", "line_of", "reference_of"]

PARTS = 24
"""Points of a step, or of what an impact leaves of it, where a method has a dense output."""
FINEST = 1e-3
"""Smallest arc of an extrapolated accumulation that is drawn, as a part of the fastest impact."""


@dataclasses.dataclass(frozen=True)
class Line:
    """Points to draw, and where impacts separate them.

    Parameters
    ----------
    t, x, xdot : ndarray
        Times (s), positions (m) and velocities (m/s).
    s, v : ndarray
        The transformed state, empty if the run has none.
    impacts : ndarray
        Indices of the first points after impacts.
    """

    t: Array
    x: Array
    xdot: Array
    s: Array
    v: Array
    impacts: np.ndarray

    def broken(self, values: Array) -> Array:
        """Insert NaN where an impact separates two points."""
        return np.insert(values, self.impacts, np.nan)


def line_of(run: Trajectory | ClosedLoop) -> Line:
    """Give the points of a run: its samples, refined where the method knows more."""
    path: Any = getattr(run, "_path", None)
    held = hasattr(run, "u")  # a closed loop is drawn at its samples
    if held or not (hasattr(path, "tails") and path.dense and len(run.t) > 1):
        s, v = run.transformed.s, run.transformed.v
        return Line(run.t, run.x, run.xdot, s, v, _after(run.t, run.resolved_impacts["t"]))
    times, impacts = _times(run, path.starts())  # type: ignore[arg-type]
    x, xdot = path.physical(times)
    s, v = path.lifted(times)
    return Line(times, x, xdot, s, v, _after(times, impacts))


def reference_of(run: ClosedLoop) -> Line:
    """Give the samples of a reference, broken where it turns within a step of the wall."""
    x, xdot = run.x_ref, run.xdot_ref
    turned = (xdot[:-1] < 0.0) & (xdot[1:] > 0.0)
    reach = 2.0 * np.diff(run.t) * np.abs(xdot[:-1])
    after = np.flatnonzero(turned & (x[:-1] <= reach)) + 1
    return Line(run.t, x, xdot, np.empty(0), np.empty(0), after)


def _times(sol: Trajectory, begun: Array) -> tuple[Array, Array]:
    """Choose times that show every arc, with the last moment before each impact."""
    fastest = float(np.max(sol.impacts["xdot_after"], initial=0.0))
    known = sol.impacts_down_to(FINEST * fastest)["t"] if fastest > 0.0 else sol.impacts["t"]
    impacts = known[(known > sol.t[0]) & (known <= sol.t[-1])]
    within = begun[(begun > sol.t[0]) & (begun < sol.t[-1])]
    corners = np.union1d(np.append(within, sol.t[[0, -1]]), impacts)
    parts = np.arange(PARTS) / PARTS
    inner = (corners[:-1, None] + parts * np.diff(corners)[:, None]).ravel()
    return np.unique(np.concatenate([inner, sol.t, np.nextafter(impacts, -np.inf)])), impacts


def _after(t: Array, impacts: Array) -> np.ndarray:
    after = np.searchsorted(t, impacts, side="left")
    return np.unique(after[(after > 0) & (after < len(t))])
