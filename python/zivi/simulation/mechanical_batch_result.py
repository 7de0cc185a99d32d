"""What a batch of runs of mechanical systems gives."""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zivi import _zivi
from zivi.base.check import Array, MaybeNone
from zivi.base.extras import needed
from zivi.base.status import Status
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory

if TYPE_CHECKING:
    import xarray

__all__ = ["MechanicalBatch"]

NUMBERS = {
    "first_impact": "time of the first impact, NaN without one",
    "last_impact": "time of the last impact, NaN without one",
    "n_impacts": "number of impacts that were resolved",
    "n_zeno": "number of accumulations",
    "n_liftoffs": "number of lift-offs",
    "n_corners": "number of corners",
    "n_flags": "number of flags",
    "status": "how the run ended, a zivi.Status",
    "nfev": "evaluations of the system",
}


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalBatch:
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
        Numbers of impacts that were resolved, accumulations, lift-offs, corners and flags.
    status : ndarray of uint8
        How each run ended, the numbers of `Status`.
    nfev : ndarray of int
        Evaluations of the system.
    events : list of dict or None
        With ``save="events"``: the tables ``impacts``, ``zeno``, ``liftoffs``, ``openings``,
        ``corners`` and ``flags`` of each run.
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

    def __len__(self) -> int:
        return len(self.status)

    @property
    def success(self) -> NDArray[np.bool_]:
        """Which runs reached the end of the span."""
        return np.equal(self.status, Status.COMPLETED)

    def __repr__(self) -> str:
        return f"<MechanicalBatch of {len(self)} runs: {int(np.sum(self.success))} completed>"

    def to_xarray(self) -> xarray.Dataset:
        """Convert to a labelled dataset over ``run``, ``coordinate`` and ``gap``."""
        needed("xarray", "labelled datasets")
        import xarray

        ends = {
            "t": (("run",), "time of the end"),
            "q": (("run", "coordinate"), "coordinates at the end"),
            "qdot": (("run", "coordinate"), "velocities at the end"),
            "gaps": (("run", "gap"), "gaps at the end"),
            "contacts": (("run", "gap"), "which gaps are closed at the end"),
        }
        told = ends | {name: (("run",), meaning) for name, meaning in NUMBERS.items()}
        coords: dict[str, Any] = {}
        if self.sample_t is not None:
            dims = ("run", "time", "coordinate")
            told |= {"sample_q": (dims, "coordinates"), "sample_qdot": (dims, "velocities")}
            coords["time"] = "time", self.sample_t, {"long_name": "times of the samples"}
        return xarray.Dataset(
            {
                name: (dims, getattr(self, name), {"long_name": meaning})
                for name, (dims, meaning) in told.items()
            },
            coords=coords
            | {
                "run": np.arange(len(self)),
                "coordinate": ("coordinate", np.array(self.config["coordinates"], dtype=object)),
                "gap": ("gap", np.array(self.config["gaps"], dtype=object)),
            },
            attrs={
                "title": "Batch of runs of mechanical systems with impacts",
                "source": f"zivi {_zivi.__version__}",
                "config": json.dumps(self.config),
            },
        )
