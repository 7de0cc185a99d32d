"""What a batch of closed loops leaves: numbers and samples of each."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, MaybeNone
from zivi.base.table import Field, Table
from zivi.control.updates import batch_text
from zivi.simulation.batch_result import Runs

__all__ = ["NUMBERS", "ClosedLoopBatch"]

NUMBERS: dict[str, Field] = {
    "t": ("run", "s", "time of the last sample"),
    "x": ("run", "m", "last distance from the wall"),
    "xdot": ("run", "m/s", "last velocity"),
    "x_ref": ("run", "m", "last distance of the reference"),
    "xdot_ref": ("run", "m/s", "last velocity of the reference"),
    "settling_time": (
        "run",
        "s",
        "time from which the position error stays within, NaN if it does not",
    ),
    "error_max": ("run", "m", "largest position error"),
    "error_rms": ("run", "m", "root mean square of the position error"),
    "u_max": ("run", "m/s^2", "largest control"),
    "u_rms": ("run", "m/s^2", "root mean square of the control"),
    "u_variation": ("run", "m/s^2", "total variation of the control"),
    "rest_time": ("run", "s", "time from which the plant rests, NaN if it does not"),
    "n_impacts": ("run", "1", "number of impacts"),
    "n_updates": ("run", "1", "number of control updates"),
    "n_refused": ("run", "1", "number of control updates that were rejected"),
    "n_saturated": ("run", "1", "number of control updates that were saturated"),
    "n_unsolved": ("run", "1", "number of control updates without signs of the general solver"),
    "status": ("run", "1", "how the run ended, a zivi.Status"),
}
"""Dimensions, unit and meaning of what a batch has for each loop."""

SAMPLED: dict[str, Field] = {
    "sample_x": (("run", "sample"), "m", "distances from the wall"),
    "sample_xdot": (("run", "sample"), "m/s", "velocities"),
    "sample_x_ref": (("run", "sample"), "m", "distances of the references"),
    "sample_u": (("run", "sample"), "m/s^2", "controls"),
    "sample_t": ("sample", "s", "times of the samples"),
}
"""The same for what may be kept of the loops' motions."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ClosedLoopBatch(Runs):
    """Results of a batch of closed loops: an entry for each.

    As in all batches a plain name is the value at the end of each run, ``sample_`` its samples:
    ``x`` of a batch is ``x[-1]`` of a `ClosedLoop`, ``sample_x`` is ``x``.

    Attributes
    ----------
    t, x, xdot : ndarray
        Time (s), distance from the wall (m) and velocity (m/s) at the end of each run.
    x_ref, xdot_ref : ndarray
        The reference at the end, NaN without one.
    settling_time : ndarray
        First sample from which ``|x - x_ref| <= within`` until the last one (s): that of the start
        if it always is, NaN if it is not at the end, or without a reference.
    error_max, error_rms : ndarray
        Largest and root mean square position error (m), NaN without a reference.
    u_max, u_rms, u_variation : ndarray
        Largest control, its root mean square and its total variation (m/s^2).
    rest_time : ndarray
        Time from which the plant rests until the end, for a whole period at least (s), NaN if it
        does not.
    n_impacts : ndarray of int
        Numbers of impacts.
    n_updates, n_refused, n_saturated, n_unsolved : ndarray of int
        Numbers of control updates, of those that were rejected, of those whose control was cut to
        its limits, and of those for which the general solver found no signs.
    status : ndarray of uint8
        How each run ended, the numbers of `Status`.
    sample_x, sample_x_ref, sample_u : ndarray or None
        With ``save=k``: positions (m), reference positions (m) and controls (m/s^2) of the first
        and every so many samples after it, a row for each loop. With ``t_eval`` those at its times,
        NaN after the end of a loop that stopped early.
    sample_t : ndarray or None
        Times of the samples (s), None where the controllers differ in `h`.
    sample_xdot : ndarray or None
        With ``t_eval``: the velocities there (m/s).
    config : dict
        Settings of the batch, as plain values: systems, controllers and states of the first 100.
    """

    t: Array
    x: Array
    xdot: Array
    x_ref: Array
    xdot_ref: Array
    settling_time: Array
    error_max: Array
    error_rms: Array
    u_max: Array
    u_rms: Array
    u_variation: Array
    rest_time: Array
    n_impacts: NDArray[np.uint64]
    n_updates: NDArray[np.uint64]
    n_refused: NDArray[np.uint64]
    n_saturated: NDArray[np.uint64]
    n_unsolved: NDArray[np.uint64]
    status: NDArray[np.uint8]
    sample_x: Array | MaybeNone
    sample_x_ref: Array | MaybeNone
    sample_u: Array | MaybeNone
    config: dict[str, Any]
    sample_t: Array | MaybeNone = None
    sample_xdot: Array | MaybeNone = None

    _called = "loops"

    def _counted(self) -> str:
        return batch_text(self)

    def _table(self) -> Table:
        """Tell the numbers over ``run``, samples over ``sample``."""
        kept = {name: it for name, it in SAMPLED.items() if getattr(self, name) is not None}
        coords: dict[str, Field] = {"run": ("run", "", "number of the loop")}
        title = "Batch of closed loops of mechanical systems with impacts"
        return Table(title, NUMBERS | kept, coords, {"run": np.arange(len(self))})
