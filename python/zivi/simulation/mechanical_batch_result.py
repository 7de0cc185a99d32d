"""What a batch of runs of mechanical systems gives."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, MaybeNone
from zivi.base.table import Field, Table
from zivi.simulation.batch_result import Runs
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory

__all__ = ["MechanicalBatch"]

NUMBERS: dict[str, Field] = {
    "first_impact": ("run", "", "time of the first impact, NaN without one"),
    "last_impact": ("run", "", "time of the last impact, NaN without one"),
    "rest_time": ("run", "", "time from which nothing moves, NaN if something does"),
    "n_impacts": ("run", "", "number of impacts"),
    "n_zeno": ("run", "", "number of accumulations"),
    "n_liftoffs": ("run", "", "number of lift-offs"),
    "n_corners": ("run", "", "number of corners"),
    "n_flags": ("run", "", "number of flags"),
    "status": ("run", "", "how the run ended, a zivi.Status"),
    "nfev": ("run", "", "evaluations of the system"),
}
"""Dimensions, unit and meaning of what a batch counts in each run."""
ENDS: dict[str, Field] = {
    "t": ("run", "", "time of the end"),
    "q": (("run", "coordinate"), "", "coordinates at the end"),
    "qdot": (("run", "coordinate"), "", "velocities at the end"),
    "gaps": (("run", "gap"), "", "gaps at the end"),
    "contacts": (("run", "gap"), "", "which gaps are closed at the end"),
}
"""The same for the ends of the runs."""
SAMPLES: dict[str, Field] = {
    "sample_q": (("run", "time", "coordinate"), "", "coordinates"),
    "sample_qdot": (("run", "time", "coordinate"), "", "velocities"),
}
"""The same for samples."""
LABELS: dict[str, Field] = {
    "run": ("run", "", "number of the run"),
    "coordinate": ("coordinate", "", "name of the coordinate"),
    "gap": ("gap", "", "name of the gap"),
}
"""Coordinates of the dataset."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalBatch(Runs):
    """Results of a batch of mechanical systems: an entry for each of N runs.

    Attributes
    ----------
    t : ndarray
        Time at the end of each run, shape (N,).
    q, qdot : ndarray
        Coordinates and velocities there, shape (N, n).
    gaps : ndarray
        Gaps there, shape (N, m).
    contacts : ndarray of bool
        Which gaps are closed there, shape (N, m).
    first_impact, last_impact : ndarray
        Times of the first and the last impact, NaN without one.
    n_impacts, n_zeno, n_liftoffs, n_corners, n_flags : ndarray of int
        Numbers of impacts (down to the part `slowest` of the fastest of the run, whether they were
        computed or skipped by a jump), accumulations, lift-offs, corners and flags.
    rest_time : ndarray
        Time from which nothing moves until the end, NaN if something does.
    status : ndarray of uint8
        How each run ended, the numbers of `Status`.
    nfev : ndarray of int
        Evaluations of the system.
    events : list of dict or None
        With ``save="events"``: the tables ``impacts``, ``zeno``, ``liftoffs``, ``openings``,
        ``corners`` and ``flags`` of each run, with friction also ``transitions`` and ``stick``.
    runs : list of MechanicalTrajectory or None
        With ``save="runs"``: the runs themselves.
    config : dict
        Settings of the batch, as plain values.
    sample_t : ndarray or None
        With ``t_eval``: the times of the samples, shape (k,).
    sample_q, sample_qdot : ndarray or None
        Coordinates and velocities there, shape (N, k, n); NaN where a run ended before.
    """

    t: Array
    q: Array
    qdot: Array
    gaps: Array
    contacts: NDArray[np.bool_]
    first_impact: Array
    last_impact: Array
    n_impacts: NDArray[np.int64]
    n_zeno: NDArray[np.int64]
    n_liftoffs: NDArray[np.int64]
    n_corners: NDArray[np.int64]
    n_flags: NDArray[np.int64]
    status: NDArray[np.uint8]
    nfev: NDArray[np.int64]
    events: list[dict[str, Any]] | MaybeNone
    runs: list[MechanicalTrajectory] | MaybeNone
    config: dict[str, Any]
    sample_t: Array | MaybeNone = None
    sample_q: Array | MaybeNone = None
    sample_qdot: Array | MaybeNone = None
    rest_time: Array = dataclasses.field(default_factory=lambda: np.empty(0))

    def _counted(self) -> str:
        flagged = int(np.count_nonzero(self.n_flags))
        return f"{flagged} with flags" if flagged else ""

    def _table(self) -> Table:
        """Tell the numbers over ``run``, ``coordinate`` and ``gap``, samples over ``time``."""
        fields, coords = ENDS | NUMBERS, dict(LABELS)
        if self.sample_t is not None:
            fields |= SAMPLES
            coords["time"] = "time", "", "times of the samples"
        values = {
            "run": np.arange(len(self)),
            "time": self.sample_t,
            "coordinate": np.array(self.config["coordinates"], dtype=object),
            "gap": np.array(self.config["gaps"], dtype=object),
        }
        return Table("Batch of runs of mechanical systems with impacts", fields, coords, values)
