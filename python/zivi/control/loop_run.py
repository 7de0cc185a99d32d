"""The result of a closed loop."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi import _zivi
from zivi.base.check import Array, MaybeNone
from zivi.base.status import Status
from zivi.base.table import Field, Table
from zivi.control.loop_path import Reference, on_side, sides
from zivi.control.updates import NONE, Updated, Updates, with_updates
from zivi.simulation.dense import Path
from zivi.simulation.impacts import SLOWEST
from zivi.simulation.run_result import EVENT_COORDS, EVENT_FIELDS, MassRun
from zivi.simulation.trajectory import FormerName, Transformed

__all__ = ["ESTIMATES", "QUANTITIES", "SIGNS", "ClosedLoop"]

QUANTITIES: dict[str, Field] = {
    "x": ("time", "m", "distance from the wall"),
    "xdot": ("time", "m/s", "velocity"),
    "x_ref": ("time", "m", "distance of the reference from its wall"),
    "xdot_ref": ("time", "m/s", "velocity of the reference"),
    "u": ("time", "m/s^2", "control, held from the sample on"),
}
"""Unit and meaning of each sampled quantity, in the order of the record's rows after time."""
ESTIMATES: dict[str, Field] = {
    "x_est": ("time", "m", "estimated distance from the wall"),
    "xdot_est": ("time", "m/s", "estimated velocity"),
    "d_est": ("time", "m/s^2", "estimated unknown force"),
}
"""What an observer thinks at the samples."""
TICKS: dict[str, Field] = {
    "s": ("time", "m", "transformed position"),
    "v": ("time", "m/s", "transformed velocity"),
    "signs": (("time", "sign"), "1", "multipliers of the tick"),
    "tick_status": ("time", "1", "bits of TickStatus"),
}
"""What else there is at the samples."""
SIGNS = ("lambda_s", "lambda_v", "lambda_sr", "lambda_vr", "lambda_es", "lambda_ev")
"""Names of the columns of ``signs``."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ClosedLoop(Updated, MassRun):
    """Samples and events of one closed loop.

    Calling it, ``run(t)``, gives ``(x, xdot)`` between the samples. ``impacts``, ``zeno`` and
    ``liftoffs`` are tables, as in a `Trajectory`.

    Attributes
    ----------
    t : ndarray
        Times of the samples (s); all sampled arrays have its length.
    x, xdot : ndarray
        The plant: distance from the wall (m) and velocity (m/s).
    x_ref, xdot_ref : ndarray
        The reference, NaN for a controller without one.
    u : ndarray
        Control that acts on the plant from the sample on (m/s^2); the last one is repeated.
    signs : ndarray, shape (n, 6)
        ``ls, lv, lsr, lvr, les, lev`` of the tick at the sample, NaN where a controller has none.
    tick_status : ndarray of uint8
        What was done at the sample, as the bits of `TickStatus`.
    resolved_impacts : structured ndarray
        Fields ``t`` (s), ``xdot_before`` and ``xdot_after`` (m/s): the impacts that were computed,
        however slow; of an accumulation within a period at most 1000.
    zeno_times : ndarray
        Times at which the plant came to rest through impacts (s): ``zeno["t"]`` by its name of
        version 0.1.
    liftoff_times : ndarray
        Times at which it left rest (s): ``liftoffs["t"]`` by its name of version 0.1.
    rest_time : float or None
        Time from which it stays at rest until the end (s), for a whole period at least: the
        control of the next sample could still lift it.
    status : Status
        How the run ended.
    message : str
        The same in words, with advice.
    nfev : int
        Evaluations of the true force.
    config : dict
        Settings of the run, with the seed of its noise.
    t_events : list of ndarray
        For each event of the user the times at which it happened (s).
    y_events : list of ndarray
        The states ``(x, xdot)`` of the plant there, each of shape (n, 2).
    updates : Updates
        Counts of the control updates: all, rejected, saturated; ``n_updates``, ``n_refused`` and
        ``n_saturated`` are the same. Where a sample or a control is rejected the last control is
        held.
    x_est, xdot_est, d_est : ndarray or None
        What the observer thought of position (m), velocity (m/s) and unknown force (m/s^2) at the
        samples; None without one.
    transformed : Transformed
        The plant in transformed coordinates (m, m/s), ``x = |s|``, and the first two of ``signs``;
        the branch changes at each impact. ``run.s`` and ``run.v`` are deprecated.
    slowest : float
        The slowest of ``impacts``, as a part of the fastest.
    """

    _habits: ClassVar[str] = "loop"

    t: Array
    x: Array
    xdot: Array
    x_ref: Array
    xdot_ref: Array
    u: Array
    signs: Array
    tick_status: NDArray[np.uint8]
    resolved_impacts: np.ndarray
    zeno_times: Array
    liftoff_times: Array
    rest_time: float | MaybeNone
    status: Status
    message: str
    nfev: int
    config: dict[str, Any]
    updates: Updates = NONE
    t_events: list[Array] = dataclasses.field(default_factory=list)
    y_events: list[Array] = dataclasses.field(default_factory=list)
    x_est: Array | MaybeNone = None
    xdot_est: Array | MaybeNone = None
    d_est: Array | MaybeNone = None
    _path: Path | None = None
    _reference: Reference | None = None
    _span: tuple[float, float] | None = None
    slowest: float = SLOWEST
    _ticks: dict[str, Array] | None = None
    """What was held from each sample on, of a run that is reported at other times."""

    s, v = FormerName(), FormerName()

    def __post_init__(self) -> None:
        own = vars(self)
        if isinstance(own["signs"], _zivi.LoopSigns):
            own["_packed"] = own.pop("signs")

    if not TYPE_CHECKING:  # which would take any name for granted

        def __getattr__(self, name):
            packed = vars(self).get("_packed") if name == "signs" else None
            if packed is None:
                return super().__getattr__(name)
            # six numbers a sample, which most runs are not asked for
            return vars(self).setdefault("signs", packed.rows())

    def __getstate__(self) -> dict[str, Any]:
        signs = self.signs
        return {k: it for k, it in vars(self).items() if k != "_packed"} | {"signs": signs}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(with_updates(state))

    @functools.cached_property
    def _lifted(self) -> tuple[Array, Array]:
        if self._path is not None and len(self.t):
            return self._path.lifted(self.t)
        side = sides(self.t, self.resolved_impacts["t"])
        return on_side(self.x, self.xdot, side, self.config["kappa"])

    @property
    def transformed(self) -> Transformed:
        """The plant in transformed coordinates; the branch changes at each impact."""
        return Transformed(*self._lifted, *self.signs.T[:2])

    def reference(self, t: ArrayLike) -> Array:
        """Give the state of the reference between the samples.

        One that the controller advances is known at the samples: ``s_r`` and ``v_r`` are linear
        between them, as in its implicit Euler steps. The velocity is NaN where it is not known.

        Parameters
        ----------
        t : float or array_like
            Times within the computed span (s).

        Returns
        -------
        ndarray
            ``(x_ref, xdot_ref)``, of shape (2,) for a scalar `t`, (2, n) for n times.

        Raises
        ------
        ValueError
            If a time lies outside the computed span, or the controller follows no reference.
        """
        if self._reference is None:
            raise ValueError("run.reference(t) needs a controller that follows a reference")
        return self._between(self._reference, self._within(t))

    def _extent(self) -> tuple[float, float]:
        return self._span or (np.nan, np.nan)

    def _resampled(self, times: Array) -> ClosedLoop:
        names = ("t", "u", "signs", "tick_status", *(ESTIMATES if self.x_est is not None else ()))
        ticks = self._ticks or {name: getattr(self, name) for name in names}
        k = np.maximum(np.searchsorted(ticks["t"], times, side="right") - 1, 0)
        held: dict[str, Any] = {name: ticks[name][k] for name in names[1:]}
        unknown = np.full((2, len(times)), np.nan)
        x, xdot = self(times)
        x_ref, xdot_ref = unknown if self._reference is None else self.reference(times)
        known = {"t": times, "x": x, "xdot": xdot, "x_ref": x_ref, "xdot_ref": xdot_ref}
        return dataclasses.replace(self, **known, **held, _ticks=ticks)

    @property
    def error(self) -> Array:
        """Position error ``x - x_ref`` (m), NaN without a reference."""
        return self.x - self.x_ref

    def __repr__(self) -> str:
        name = self.config["controller"]["name"]
        span = f"{self.t[0]:.6g} .. {self.t[-1]:.6g} s" if len(self.t) else "no samples"
        what = f"{self._events_text()}{self._failed_text()}"
        return f"<ClosedLoop {name}, {span}, {what}: {self.status.name.lower()}>"

    def _facts(self) -> dict[str, str]:
        work = f"{len(self.t)} samples{self._failed_text()}, {self.nfev} evaluations"
        return {**self._wall_facts(), "controller": self.config["controller"]["name"], "work": work}

    def _table(self) -> Table:
        seen, (s, v) = ESTIMATES if self.x_est is not None else {}, self._lifted
        coords: dict[str, Field] = {**EVENT_COORDS, "sign": ("sign", "", "name of the multiplier")}
        return Table(
            "Closed loop of a mechanical system with impacts",
            {**QUANTITIES, **TICKS, **seen, **EVENT_FIELDS},
            coords,
            self._event_values() | {"s": s, "v": v, "sign": list(SIGNS)},
            self._outcome() | self.updates.attrs(),
        )
