"""What a batch of closed loops leaves: numbers and samples of each."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zivi import _zivi
from zivi.base.check import Array, MaybeNone
from zivi.base.extras import needed
from zivi.base.plain import text_of
from zivi.simulation.batch_result import Runs

if TYPE_CHECKING:
    import xarray

__all__ = ["NUMBERS", "ClosedLoopBatch"]

NUMBERS = {
    "t": ("s", "time of the last sample"),
    "x": ("m", "last distance from the wall"),
    "xdot": ("m/s", "last velocity"),
    "x_ref": ("m", "last distance of the reference"),
    "xdot_ref": ("m/s", "last velocity of the reference"),
    "settling_time": ("s", "time from which the position error stays within, NaN if it does not"),
    "error_max": ("m", "largest position error"),
    "error_rms": ("m", "root mean square of the position error"),
    "u_max": ("m/s^2", "largest control"),
    "u_rms": ("m/s^2", "root mean square of the control"),
    "u_variation": ("m/s^2", "total variation of the control"),
    "rest_time": ("s", "time from which the plant rests, NaN if it does not"),
    "n_impacts": ("1", "number of impacts"),
    "n_refused": ("1", "number of samples that were refused"),
    "status": ("1", "how the run ended, a zivi.Status"),
}
"""Unit and meaning of what a batch has for each loop."""


SAMPLED = {"sample_x": "m", "sample_xdot": "m/s", "sample_x_ref": "m", "sample_u": "m/s^2"}
"""Unit of what is kept of the loops' motions."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ClosedLoopBatch(Runs):
    """Results of a batch of closed loops: an entry for each.

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
    n_impacts, n_refused : ndarray of int
        Numbers of impacts and of refused samples.
    status : ndarray of uint8
        How each run ended, the numbers of `Status`.
    sample_x, sample_x_ref, sample_u : ndarray or None
        With ``save=k``: positions (m), reference positions (m) and controls (m/s^2) of the first
        and every so many samples after it, a row for each loop. With ``t_eval`` those at its times,
        NaN after the end of a loop that stopped early.
    sample_t, sample_xdot : ndarray or None
        With ``t_eval``: its times (s), and the velocities there (m/s).
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
    n_refused: NDArray[np.uint64]
    status: NDArray[np.uint8]
    sample_x: Array | MaybeNone
    sample_x_ref: Array | MaybeNone
    sample_u: Array | MaybeNone
    config: dict[str, Any]
    sample_t: Array | MaybeNone = None
    sample_xdot: Array | MaybeNone = None

    _called = "loops"

    def to_xarray(self) -> xarray.Dataset:
        """Convert to a labelled dataset over ``run`` (and ``sample``).

        Returns
        -------
        xarray.Dataset
            With units, descriptions and the configuration (JSON) in the attributes.
        """
        needed("xarray", "labelled datasets")
        import xarray

        variables: dict[str, Any] = {
            name: ("run", getattr(self, name), {"units": unit, "long_name": meaning})
            for name, (unit, meaning) in NUMBERS.items()
        }
        for name, unit in SAMPLED.items():
            if (values := getattr(self, name)) is not None:
                variables[name] = (("run", "sample"), values, {"units": unit})
        if self.sample_t is not None:
            variables["sample_t"] = ("sample", self.sample_t, {"units": "s"})
        attrs = {
            "title": "Batch of closed loops of mechanical systems with impacts",
            "source": f"zivi {_zivi.__version__}",
            "config": text_of(self.config),
        }
        return xarray.Dataset(variables, coords={"run": np.arange(len(self))}, attrs=attrs)
