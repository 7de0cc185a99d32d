"""What a batch of runs leaves: numbers and samples of each."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zivi import _zivi
from zivi.base.check import Array, MaybeNone
from zivi.base.extras import needed
from zivi.base.plain import text_of
from zivi.base.status import Status

if TYPE_CHECKING:
    import xarray

__all__ = ["MAX_DESCRIBED", "NUMBERS", "Batch", "Runs"]

MAX_DESCRIBED = 100
"""Systems, and states, that are told in ``config``."""

NUMBERS = {
    "t": ("s", "time of the last sample"),
    "x": ("m", "last distance from the wall"),
    "xdot": ("m/s", "last velocity"),
    "rest_time": ("s", "time from which the mass rests, NaN if it does not"),
    "first_impact": ("s", "time of the first impact, NaN without one"),
    "last_impact": ("s", "time of the last impact, NaN without one"),
    "hardest_impact": ("m/s", "largest speed before an impact"),
    "n_impacts": ("1", "number of impacts that were resolved"),
    "n_zeno": ("1", "number of Zeno points"),
    "n_liftoffs": ("1", "number of lift-offs"),
    "status": ("1", "how the run ended, a zivi.Status"),
    "nfev": ("1", "evaluations of the force"),
}
"""Unit and meaning of what every batch has for each run."""
EXTREMES = {
    "x_max": ("m", "largest sampled distance from the wall"),
    "speed_max": ("m/s", "largest sampled speed"),
}
"""The same for what only ``save="statistics"`` has."""


class Runs:
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
        return f"<{type(self).__name__} of {counted}>"


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Batch(Runs):
    """Results of a batch: an entry for each run.

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
        Numbers of impacts that were resolved, of Zeno points and of lift-offs.
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
        With ``save="events"``: for each run a dict with ``impacts`` (structured as those of a
        `Trajectory`), ``zeno_times`` and ``liftoff_times``.
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

    def to_xarray(self) -> xarray.Dataset:
        """Convert to a labelled dataset over ``run`` (and ``time`` for samples).

        Returns
        -------
        xarray.Dataset
            With units, descriptions and the configuration (JSON) in the attributes. Events, which
            differ in number from run to run, are not in it.
        """
        needed("xarray", "labelled datasets")
        import xarray

        def labelled(dims: Any, values: Any, unit: str, meaning: str) -> Any:
            return dims, values, {"units": unit, "long_name": meaning}

        shown = NUMBERS | (EXTREMES if self.x_max is not None else {})
        variables = {
            name: labelled("run", getattr(self, name), unit, meaning)
            for name, (unit, meaning) in shown.items()
        }
        coords: dict[str, Any] = {"run": np.arange(len(self))}
        if self.sample_t is not None:
            coords["time"] = labelled("time", self.sample_t, "s", "time")
            for name, unit in (("sample_x", "m"), ("sample_xdot", "m/s")):
                values = getattr(self, name)
                variables[name] = labelled(("run", "time"), values, unit, "samples")
        attrs = {
            "title": "Batch of runs of mechanical systems with impacts",
            "source": f"zivi {_zivi.__version__}",
            "config": text_of(self.config),
        }
        return xarray.Dataset(variables, coords=coords, attrs=attrs)
