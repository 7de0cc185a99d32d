"""What a batch of runs leaves: numbers and samples of each."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, MaybeNone
from zivi.base.status import Status
from zivi.base.table import Field, Table, Tabulated

__all__ = ["MAX_DESCRIBED", "NUMBERS", "Batch", "Runs"]

MAX_DESCRIBED = 100
"""Systems, and states, that are told in ``config``."""

NUMBERS: dict[str, Field] = {
    "t": ("run", "s", "time of the last sample"),
    "x": ("run", "m", "last distance from the wall"),
    "xdot": ("run", "m/s", "last velocity"),
    "rest_time": ("run", "s", "time from which the mass rests, NaN if it does not"),
    "first_impact": ("run", "s", "time of the first impact, NaN without one"),
    "last_impact": ("run", "s", "time of the last impact, NaN without one"),
    "hardest_impact": ("run", "m/s", "largest speed before an impact"),
    "n_impacts": ("run", "1", "number of impacts"),
    "n_zeno": ("run", "1", "number of Zeno points"),
    "n_liftoffs": ("run", "1", "number of lift-offs"),
    "status": ("run", "1", "how the run ended, a zivi.Status"),
    "nfev": ("run", "1", "evaluations of the force"),
}
"""Dimensions, unit and meaning of what every batch has for each run."""
EXTREMES: dict[str, Field] = {
    "x_max": ("run", "m", "largest sampled distance from the wall"),
    "speed_max": ("run", "m/s", "largest sampled speed"),
}
"""The same for what only ``save="statistics"`` has."""
SAMPLES: dict[str, Field] = {
    "sample_x": (("run", "time"), "m", "samples"),
    "sample_xdot": (("run", "time"), "m/s", "samples"),
}
"""The same for samples."""


class Runs(Tabulated):
    """What all batches have."""

    if TYPE_CHECKING:
        status: NDArray[np.uint8]
        rest_time: Array

    _called = "runs"

    def __len__(self) -> int:
        return len(self.status)

    @property
    def success(self) -> NDArray[np.bool_]:
        """Which runs reached the end of the span."""
        return np.equal(self.status, Status.COMPLETED)

    def __repr__(self) -> str:
        done, rests = int(np.sum(self.success)), int(np.sum(~np.isnan(self.rest_time)))
        counted = f"{len(self)} {self._called}: {done} completed, {rests} at rest"
        for number, count in zip(*np.unique(self.status, return_counts=True), strict=True):
            if number != Status.COMPLETED:
                counted += f", {count} {Status(int(number)).name.lower()}"
        if more := self._counted():
            counted += f"; {more}"
        return f"<{type(self).__name__} of {counted}>"

    def _counted(self) -> str:
        """Say what else failed in the runs, nothing if nothing did."""
        return ""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Batch(Runs):
    """Results of a batch: an entry for each run.

    In all batches a plain name is the value at the end of each run, ``sample_`` its samples.

    Attributes
    ----------
    t, x, xdot : ndarray
        Time (s), distance from the wall (m) and velocity (m/s) at the end of each run.
    rest_time : ndarray
        Time from which the mass rests until the end (s), NaN if it does not.
    first_impact, last_impact : ndarray
        Times of the first and of the last impact (s), NaN without one.
    hardest_impact : ndarray
        Largest speed before an impact (m/s), 0 without one.
    n_impacts, n_zeno, n_liftoffs : ndarray of int
        Numbers of impacts (down to the part `slowest` of the fastest of the run, whether they were
        computed or skipped by a jump to rest), of Zeno points and of lift-offs.
    n_resolved, last_resolved : ndarray or None
        Number of the impacts that were resolved, and the time of the last of them (s).
    status : ndarray of uint8
        How each run ended, the numbers of `Status`.
    nfev : ndarray of int
        Evaluations of the force.
    x_max, speed_max : ndarray or None
        Largest sampled distance (m) and speed (m/s), with ``save="statistics"``.
    grazing : ndarray of bool or None
        With ``save="grazing"``: whether the run passed a grazing, an impact or the want of one that
        its tolerances decided.
    events : list or None
        With ``save="events"``: for each run a dict with the tables ``impacts``, ``zeno``,
        ``liftoffs`` and ``resolved_impacts`` of a `Trajectory`, and ``zeno_times`` and
        ``liftoff_times``, their names of version 0.1.
    sample_t : ndarray or None
        With ``save=k`` or ``t_eval``: the times of the samples (s).
    sample_x, sample_xdot : ndarray or None
        The samples, a row for each run; NaN after the end of a run that ended early.
    config : dict
        Settings of the batch, as plain values: systems and initial states of the first 100.
    """

    t: Array
    x: Array
    xdot: Array
    rest_time: Array
    first_impact: Array
    last_impact: Array
    hardest_impact: Array
    n_impacts: NDArray[np.uint64]
    n_zeno: NDArray[np.uint64]
    n_liftoffs: NDArray[np.uint64]
    status: NDArray[np.uint8]
    nfev: NDArray[np.uint64]
    x_max: Array | MaybeNone
    speed_max: Array | MaybeNone
    grazing: NDArray[np.bool_] | MaybeNone
    events: list[dict[str, Any]] | MaybeNone
    sample_t: Array | MaybeNone
    sample_x: Array | MaybeNone
    sample_xdot: Array | MaybeNone
    config: dict[str, Any]
    n_resolved: NDArray[np.uint64] | MaybeNone = None
    last_resolved: Array | MaybeNone = None

    def _table(self) -> Table:
        """Tell the numbers over ``run``, samples over ``time``; events differ in their number."""
        fields = NUMBERS | (EXTREMES if self.x_max is not None else {})
        coords: dict[str, Field] = {"run": ("run", "", "number of the run")}
        if self.sample_t is not None:
            fields, coords = fields | SAMPLES, coords | {"time": ("time", "s", "time")}
        values = {"run": np.arange(len(self)), "time": self.sample_t}
        return Table("Batch of runs of mechanical systems with impacts", fields, coords, values)
