"""Results of closed loops, single and in batches."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, MaybeNone
from zivi.base.status import Status, warn
from zivi.base.table import Field, ResultTable
from zivi.control.component import TickStatus
from zivi.simulation.batch_result import BatchRuns
from zivi.simulation.dense import DenseMotion, LinearPath
from zivi.simulation.events import SLOWEST
from zivi.simulation.run_result import EVENT_COORDS, EVENT_FIELDS, MassRun
from zivi.simulation.trajectory import FormerName, Transformed
from zivi.system.mass import lift, project

# What happened at the control updates of a loop: one count for every kind of loop.

SHARE = 0.1
"""Share of the control updates above which rejections or saturations are warned of."""
NAMES = ("n_updates", "n_refused", "n_saturated", "n_unsolved", "n_lost")
"""What datasets call the counts."""
ADVICE = {
    "rejected": "the last control was held; controls must be finite, measurements within depth",
    "saturated": "the controller cannot do what it plans within its limits",
}


@dataclasses.dataclass(frozen=True)
class Updates:
    """Counts of the control updates of a closed loop.

    Parameters
    ----------
    total : int
        Control updates.
    rejected : int
        Those whose sample or control was rejected: the last control was held.
    saturated : int
        Those whose control was cut to its limits.
    unsolved : int
        Those for which the general solver found no signs.
    lost : int
        Those at which a contact opened that the controller held.

    Examples
    --------
    >>> plant = zivi.ImpactSystem(-9.81, e=0.5)
    >>> tracker = zivi.TwistingTracker(30, 17, h=1e-2, e=0.5, u_limits=(-40, 40))
    >>> run = zivi.simulate_closed_loop(plant, tracker, (0, 2), (0.2, 0), y_ref0=(0.2, 0))
    >>> run.updates.total, run.updates.rejected
    (200, 0)
    """

    total: int = 0
    rejected: int = 0
    saturated: int = 0
    unsolved: int = 0
    lost: int = 0

    @classmethod
    def of_bits(cls, bits: NDArray[np.uint8]) -> Self:
        """Count the bits of `TickStatus` of all updates."""
        counted = (
            TickStatus.REFUSED,
            TickStatus.SATURATED,
            TickStatus.UNSOLVED,
            TickStatus.LATCH_LOST,
        )
        return cls(len(bits), *(int(np.count_nonzero(bits & int(it))) for it in counted))

    def attrs(self) -> dict[str, int]:
        """Return the counts by the names that datasets have."""
        return dict(zip(NAMES, dataclasses.astuple(self), strict=True))

    @classmethod
    def of_attrs(cls, attrs: Mapping[str, Any], bits: NDArray[np.uint8]) -> Self:
        """Return what `attrs` gave; of older datasets what the bits at the samples tell."""
        if NAMES[0] in attrs:
            return cls(*(int(attrs[name]) for name in NAMES))
        return cls.of_bits(bits[:-1])

    def __str__(self) -> str:
        """Describe the failures; "" if there are none."""
        if not (self.rejected or self.saturated or self.unsolved or self.lost):
            return ""
        of_all = f" of {self.total}" if self.total else ""  # older versions did not count them
        text = f"{self.rejected}{of_all} control updates rejected, "
        text += f"{self.saturated} saturated"
        text += f", {self.unsolved} unsolved" if self.unsolved else ""
        return text + (f", {self.lost} with a lost contact" if self.lost else "")

    def added_to(self, message: str) -> str:
        """Return the message of a run with its failures."""
        return f"{message} {self}." if str(self) else message

    def warn(self, name: str) -> None:
        """Warn of a loop in which much failed."""
        for what, advice in ADVICE.items():
            count = getattr(self, what)
            if count > SHARE * self.total:
                text = f"{count} of {self.total} control updates of {name} were {what}: {advice}"
                warn(text)


NONE = Updates()


class Updated:
    """The counts of a loop by the names that batches have."""

    updates: Updates
    if TYPE_CHECKING:
        _ticks: dict[str, Array] | None

    @property
    def n_updates(self) -> int:
        """Number of control updates."""
        return self.updates.total

    @property
    def n_refused(self) -> int:
        """Number of control updates that were rejected; the last control was held."""
        return self.updates.rejected

    @property
    def n_saturated(self) -> int:
        """Number of control updates whose control was cut to its limits."""
        return self.updates.saturated

    def _failed_text(self) -> str:
        """Describe the failures after a comma; "" if there are none."""
        return f", {self.updates}" if str(self.updates) else ""

    def _held(
        self, names: tuple[str, ...], times: Array
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Return the columns at the samples, ``t`` first, and those held at other times."""
        ticks = self._ticks or {name: getattr(self, name) for name in names}
        k = np.maximum(np.searchsorted(ticks["t"], times, side="right") - 1, 0)
        return ticks, {name: ticks[name][k] for name in names[1:]}


def with_updates(state: dict[str, Any]) -> dict[str, Any]:
    """Return the state of a loop that an older version pickled its counts."""
    if "updates" in state:
        return state
    kept = {name: it for name, it in state.items() if name != "n_refused"}
    return kept | {"updates": Updates.of_bits(state["tick_status"][:-1])}


class UpdatedBatch(BatchRuns):
    """The counts of control updates of a batch of loops."""

    _called = "loops"

    def __setstate__(self, state: dict[str, Any]) -> None:
        # counts that the version that pickled the batch did not have are 0
        unknown = np.zeros(len(state["status"]), np.int64)
        self.__dict__.update(dict.fromkeys(NAMES, unknown) | state)

    def _counted(self) -> str:
        """Describe the failures in the loops; "" if there are none."""
        return str(Updates(*(int(np.sum(getattr(self, name))) for name in NAMES[:3])))


def warn_of_batch(batch: Any) -> None:
    """Warn of the loops of a batch in which much failed."""
    most = SHARE * batch.n_updates
    failed = int(np.count_nonzero((batch.n_refused > most) | (batch.n_saturated > most)))
    if failed:
        warn(
            f"more than {SHARE:.0%} of the control updates of {failed} of {len(batch)} loops were "
            "rejected or saturated: n_refused and n_saturated tell which"
        )


# The motion of a closed loop between its samples: that of the plant, and that of the reference.

LISTED = 1000
"""Impacts that a period lists; further ones are skipped in closed form."""


def branches_at(times: Array, impacts: Array) -> Array:
    """Return the branch at `times`, which increase: 1, and the other after each impact."""
    ends = np.concatenate(([0], np.searchsorted(times, impacts), [len(times)]))
    branches = np.ones(len(impacts) + 1)
    branches[1::2] = -1.0
    return np.repeat(branches, np.diff(ends))


@dataclasses.dataclass(frozen=True)
class BallisticPath:
    """Exact motion from each sample under an acceleration that is held.

    Parameters
    ----------
    t, x, xdot : ndarray
        The samples (s, m, m/s).
    net : ndarray
        The acceleration from each sample on (m/s^2).
    side : ndarray
        The branch at each sample.
    wall : (float, float)
        `e` and `kappa`.
    full : ndarray, shape (n, 3)
        Periods that list no more impacts: number, time and speed of the last one that is listed.
    """

    t: Array
    x: Array
    xdot: Array
    net: Array
    side: Array
    wall: tuple[float, float]
    full: Array
    dense: bool = True

    @property
    def span(self) -> tuple[float, float]:
        """The times of the first and the last sample (s)."""
        return float(self.t[0]), float(self.t[-1])

    def _at(self, times: Array) -> tuple[Array, Array, Array]:
        k = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, len(self.t) - 1)
        rows = np.column_stack([self.x[k], self.xdot[k], self.net[k], times - self.t[k]])
        end = _zivi.ballistic_motion(rows, _zivi.Restitution.of_both(*self.wall))
        return end.x, end.xdot, self.side[k] * (1.0 - 2.0 * (end.n_impacts % 2))

    def physical(self, times: Array) -> tuple[Array, Array]:
        """Return ``(x, xdot)``; at an impact, the state after it."""
        return self._at(times)[:2]

    def lifted(self, times: Array) -> tuple[Array, Array]:
        """Return ``(s, v)``."""
        x, xdot, side = self._at(times)
        return on_side(x, xdot, side, self.wall[1])

    def skipped_impacts(self, speed: float, at_most: int) -> tuple[Array, Array, Array]:
        """Return the unlisted impacts of each period: a geometric series."""
        e = self.wall[0]
        found: list[Array] = [np.empty((0, 3))]
        for number, t, u in self.full:
            k = int(number)
            n = np.arange(1.0, _impacts_down_to(speed, u, e, at_most) + 1.0)
            # impact n is 2 u (1 + e + ... + e^(n-1))/-f later, and e^n as fast
            times = t + np.cumsum(2.0 * u * e ** (n - 1.0) / -self.net[k])
            rows = np.column_stack([times, -u * e ** (n - 1.0), u * e**n])
            found.append(rows[(times <= self.t[k + 1]) & (rows[:, 2] >= speed)])
        t, before, after = np.concatenate(found).T
        return t, before, after


def _impacts_down_to(speed: float, u: float, e: float, at_most: int) -> int:
    """Bound the impacts after one that leaves `u` which leave `speed`, by ``u e^n >= speed``."""
    if not 0.0 < speed < u or not 0.0 < e < 1.0:
        return at_most if speed <= u else 0
    return min(at_most, math.ceil(math.log(speed / u) / math.log(e)))


def on_side(x: Array, xdot: Array, side: Array, kappa: float) -> tuple[Array, Array]:
    """Lift states to the branches on which they are."""
    s, v = lift(x, xdot, kappa=kappa)
    # no negative zeros
    return side * s + 0.0, side * v + 0.0


def path_of(record: _zivi.LoopRecord, impacts: NDArray[np.void], wall: tuple[float, float]) -> Any:
    """Return the motion of the plant between its samples; None if not stored."""
    t, x, xdot, _, _, u = record.columns
    if record.own_force is not None:
        side, net = branches_at(t, impacts["t"]), record.own_force + u
        return BallisticPath(t, x, xdot, net, side, wall, _full(t, impacts))
    if record.lifted is not None:
        s, v = record.lifted.s[: len(t)], record.lifted.v[: len(t)]
        return LinearPath(t, s, v, wall[1])
    return record.path


def _full(t: Array, impacts: NDArray[np.void]) -> Array:
    """Find the periods that list as many impacts as they may."""
    if len(impacts) < LISTED:
        return np.empty((0, 3))
    ends = np.searchsorted(impacts["t"], t, side="right")
    k = np.flatnonzero(np.diff(ends) >= LISTED)
    last = impacts[ends[k + 1] - 1]
    return np.column_stack([k, last["t"], last["xdot_after"]])


class Reference(Protocol):
    """The motion of a reference."""

    def lifted(self, times: Array) -> tuple[Array, Array]:
        """``(s_r, v_r)`` at `times`."""

    def physical(self, times: Array) -> tuple[Array, Array]:
        """``(x_r, xdot_r)`` at `times`."""


@dataclasses.dataclass(frozen=True)
class SampledReference:
    """A reference that is known at the samples: ``s_r`` and ``v_r`` are linear between them.

    Parameters
    ----------
    t, x, xdot : ndarray
        The samples (s, m, m/s); the velocity may be unknown, NaN.
    kappa : float
        Of the wall of the reference.
    """

    t: Array
    x: Array
    xdot: Array
    kappa: float

    @functools.cached_property
    def _path(self) -> LinearPath:
        h, x, end = np.diff(self.t), self.x, self.xdot[1:]
        # s+ = s + h R v+ of the implicit step: on the other branch it is x+ + x = h xdot+
        through = np.abs(x[1:] + x[:-1] - h * end) < np.abs(x[1:] - x[:-1] - h * end)
        side = np.cumprod(np.append(1.0, np.where(through, -1.0, 1.0)))
        s, v = on_side(x, self.xdot, side, self.kappa)
        return LinearPath(self.t, s, v, self.kappa)

    def lifted(self, times: Array) -> tuple[Array, Array]:
        """Return ``(s_r, v_r)``."""
        return self._path.lifted(times)

    def physical(self, times: Array) -> tuple[Array, Array]:
        """Return ``(x_r, xdot_r)``."""
        if np.isnan(self.xdot).all():
            return np.interp(times, self.t, self.x), np.full(times.shape, np.nan)
        s, v = self.lifted(times)
        return project(s, v, kappa=self.kappa)


# The result of a closed loop.

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
    ``liftoffs`` are tables (see `Trajectory`).

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
    _path: DenseMotion | None = None
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
        side = branches_at(self.t, self.resolved_impacts["t"])
        return on_side(self.x, self.xdot, side, self.config["kappa"])

    @property
    def transformed(self) -> Transformed:
        """The plant in transformed coordinates; the branch changes at each impact."""
        return Transformed(*self._lifted, *self.signs.T[:2])

    def reference(self, t: ArrayLike) -> Array:
        """Return the state of the reference between the samples.

        One that the controller advances is known at the samples: ``s_r`` and ``v_r`` are linear
        between them (implicit Euler steps). The velocity is NaN where unknown.

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
        ticks, held = self._held(names, times)
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

    def _table(self) -> ResultTable:
        seen, (s, v) = ESTIMATES if self.x_est is not None else {}, self._lifted
        coords: dict[str, Field] = {**EVENT_COORDS, "sign": ("sign", "", "name of the multiplier")}
        return ResultTable(
            "Closed loop of a mechanical system with impacts",
            {**QUANTITIES, **TICKS, **seen, **EVENT_FIELDS},
            coords,
            self._event_values() | {"s": s, "v": v, "sign": list(SIGNS)},
            self._outcome() | self.updates.attrs(),
        )


# What a batch of closed loops leaves: numbers and samples of each.

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
class ClosedLoopBatch(UpdatedBatch):
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
        First sample from which ``|x - x_ref| <= within`` until the end (s): the initial time if it
        always holds, NaN if it does not hold at the end or without a reference.
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
        Numbers of control updates, of rejected updates, of updates with a saturated control, and of
        updates for which the general solver failed.
    status : ndarray of uint8
        Status of each run, as an integer of `Status`.
    sample_x, sample_x_ref, sample_u : ndarray or None
        With ``save=k``: positions (m), reference positions (m) and controls (m/s^2) of the first
        and every k-th sample after it, one row per loop. With ``t_eval`` those at its times, NaN
        after the end of a loop that stopped early.
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

    def _table(self) -> ResultTable:
        """Describe the dataset: numbers over ``run``, samples over ``sample``."""
        kept = {name: it for name, it in SAMPLED.items() if getattr(self, name) is not None}
        coords: dict[str, Field] = {"run": ("run", "", "number of the loop")}
        title = "Batch of closed loops of mechanical systems with impacts"
        return ResultTable(title, NUMBERS | kept, coords, {"run": np.arange(len(self))})
