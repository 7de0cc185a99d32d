"""The result of a closed loop of a mechanical system."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.base.table import Field, Table
from zivi.control.updates import NONE, Updated, Updates, with_updates
from zivi.simulation import mechanical_labelled as labelled
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory

if TYPE_CHECKING:
    import pandas

__all__ = ["LOOP_COORDS", "LOOP_FIELDS", "MechanicalClosedLoop"]

LOOP_FIELDS: dict[str, Field] = {
    "u": (("time", "control"), "", "controls, held from the sample on"),
    "error_gaps": (("time", "gap"), "", "gaps less those of the reference"),
    "latched": (("time", "gap"), "", "which contacts the controller holds"),
    "tick_status": ("time", "1", "bits of TickStatus"),
    "q_ref": (("time", "coordinate"), "", "coordinates of the reference"),
    "q_est": (("time", "coordinate"), "", "estimated coordinates"),
    "qdot_est": (("time", "coordinate"), "", "estimated velocities"),
}
"""What a loop has at its samples beside a run: dimensions, unit, meaning."""
LOOP_COORDS: dict[str, Field] = {"control": ("control", "", "name of the control")}


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalClosedLoop(Updated, MechanicalTrajectory):
    """Samples and events of one closed loop of a mechanical system.

    All that a `MechanicalTrajectory` has, at the samples of the controller: there also the contact
    forces are those under the control that begins.

    Attributes
    ----------
    u : ndarray
        Controls that act from the sample on, shape (k, r); the last ones are repeated.
    error_gaps : ndarray
        Gaps less those of the reference, shape (k, m); NaN without one.
    latched : ndarray of bool
        Which contacts the controller holds, shape (k, m).
    tick_status : ndarray of uint8
        What was done at the samples, as bits of `TickStatus`; 0 at the last one, which has none.
    updates : Updates
        Counts of the control updates: all, rejected, saturated, with a lost contact; ``n_updates``,
        ``n_refused`` and ``n_saturated`` are the same. Where a sample or a control is rejected the
        last controls are held.
    q_ref : ndarray
        Coordinates of the reference, shape (k, n); NaN without one.
    q_est, qdot_est : ndarray
        What the observer thought, shape (k, n); what was measured without one.
    control_names : tuple of str
        Names of the controls.
    """

    u: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    error_gaps: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    latched: NDArray[np.bool_] = dataclasses.field(default_factory=lambda: np.empty((0, 0), bool))
    tick_status: NDArray[np.uint8] = dataclasses.field(
        default_factory=lambda: np.empty(0, np.uint8)
    )
    q_ref: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    q_est: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    qdot_est: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    control_names: tuple[str, ...] = ()
    updates: Updates = NONE
    _ticks: dict[str, Array] | None = None
    """What was held from each sample on, of a run that is reported at other times."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(with_updates(state))

    def _resampled(self, times: Array) -> MechanicalClosedLoop:
        names = ("t", *LOOP_FIELDS)
        ticks = self._ticks or {name: getattr(self, name) for name in names}
        k = np.maximum(np.searchsorted(ticks["t"], times, side="right") - 1, 0)
        held: dict[str, Any] = {name: ticks[name][k] for name in names[1:]}
        held["error_gaps"] = np.where(
            np.isin(times, ticks["t"])[:, None], held["error_gaps"], np.nan
        )
        moved: Any = super()._resampled(times)
        known: MechanicalClosedLoop = dataclasses.replace(moved, **held, _ticks=ticks)
        return known

    def __repr__(self) -> str:
        name = self.config["controller"]["name"]
        inner = super().__repr__()[len("<MechanicalTrajectory ") :]
        events, _, ended = inner.rpartition(": ")
        return f"<MechanicalClosedLoop {name}, {events}{self._failed_text()}: {ended}"

    def _facts(self) -> dict[str, str]:
        held = self.latched[-1] if len(self.t) else []
        names = [name for name, it in zip(self.gap_names, held, strict=False) if it]
        return {
            **super()._facts(),
            "controller": self.config["controller"]["name"],
            "held at the end": ", ".join(names) or "none",
            "control updates": f"{self.n_updates}{self._failed_text()}",
        }

    def _as_frame(self) -> pandas.DataFrame:
        table = super()._as_frame()
        for j, name in enumerate(self.control_names):
            table[f"u_{name}"] = self.u[:, j]
        for i, name in enumerate(self.gap_names):
            table[f"error_{name}"] = self.error_gaps[:, i]
        return table

    def _table(self) -> Table:
        table = labelled.labels_of(self)
        return dataclasses.replace(
            table,
            title="Closed loop of a mechanical system with impacts",
            fields={**table.fields, **LOOP_FIELDS},
            coords={**table.coords, **LOOP_COORDS},
            attrs={**table.attrs, **self.updates.attrs()},
            values={**table.values, "control": np.array(self.control_names, dtype=object)},
        )
