"""The result of a closed loop."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi import _zivi
from zivi.base.check import Array, MaybeNone, real_array
from zivi.base.extras import late, needed
from zivi.base.plain import text_of
from zivi.base.status import Status
from zivi.control.loop_path import Reference, on_side, sides
from zivi.simulation.dense import Path
from zivi.simulation.impacts import down_to

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

__all__ = ["ESTIMATES", "QUANTITIES", "SIGNS", "ClosedLoop"]

QUANTITIES = {
    "x": ("m", "distance from the wall"),
    "xdot": ("m/s", "velocity"),
    "x_ref": ("m", "distance of the reference from its wall"),
    "xdot_ref": ("m/s", "velocity of the reference"),
    "u": ("m/s^2", "control, held from the sample on"),
}
"""Unit and meaning of each sampled quantity, in the order of the record's rows after time."""
ESTIMATES = ("x_est", "xdot_est", "d_est")
"""What an observer thinks at the samples."""
SIGNS = ("lambda_s", "lambda_v", "lambda_sr", "lambda_vr", "lambda_es", "lambda_ev")
"""Names of the columns of ``signs``."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ClosedLoop:
    """Samples and events of one closed loop.

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
    impacts : structured ndarray
        Fields ``t`` (s), ``xdot_before`` and ``xdot_after`` (m/s); of an accumulation within a
        period at most 1000.
    zeno_times : ndarray
        Times at which the plant came to rest through impacts (s).
    liftoff_times : ndarray
        Times at which it left rest (s).
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
    n_refused : int
        Samples that the controller refused; the last control was held.
    x_est, xdot_est, d_est : ndarray or None
        What the observer thought of position (m), velocity (m/s) and unknown force (m/s^2) at the
        samples; None without one.
    s, v : ndarray
        The plant in transformed coordinates (m, m/s), ``x = |s|``; the branch changes at each
        impact.
    """

    t: Array
    x: Array
    xdot: Array
    x_ref: Array
    xdot_ref: Array
    u: Array
    signs: Array
    tick_status: NDArray[np.uint8]
    impacts: np.ndarray
    zeno_times: Array
    liftoff_times: Array
    rest_time: float | MaybeNone
    status: Status
    message: str
    nfev: int
    config: dict[str, Any]
    n_refused: int = 0
    t_events: list[Array] = dataclasses.field(default_factory=list)
    y_events: list[Array] = dataclasses.field(default_factory=list)
    x_est: Array | MaybeNone = None
    xdot_est: Array | MaybeNone = None
    d_est: Array | MaybeNone = None
    _path: Path | None = None
    _reference: Reference | None = None
    _span: tuple[float, float] | None = None

    @property
    def success(self) -> bool:
        """Whether the end of ``t_span`` was reached, or a terminal event."""
        return self.status in (Status.COMPLETED, Status.TERMINATED_BY_EVENT)

    @functools.cached_property
    def _lifted(self) -> tuple[Array, Array]:
        if self._path is not None and len(self.t):
            return self._path.lifted(self.t)
        side = sides(self.t, self.impacts["t"])
        return on_side(self.x, self.xdot, side, self.config["kappa"])

    @property
    def s(self) -> Array:
        """Transformed position of the plant (m)."""
        return self._lifted[0]

    @property
    def v(self) -> Array:
        """Transformed velocity of the plant (m/s)."""
        return self._lifted[1]

    def __call__(self, t: ArrayLike) -> Array:
        """Give the state of the plant between the samples.

        Exact where its force is constant, else the dense output of `SwitchedRK`, across impacts
        and Zeno points. With `ThetaGamma` ``s`` and ``v`` are linear between the samples.

        Parameters
        ----------
        t : float or array_like
            Times within the computed span (s).

        Returns
        -------
        ndarray
            ``(x, xdot)``, of shape (2,) for a scalar `t`, (2, n) for n times; at the time of an
            impact the velocity after it.

        Raises
        ------
        ValueError
            If a time lies outside the computed span, or the run kept no dense output.

        Examples
        --------
        >>> plant = zivi.ImpactSystem(-9.81, e=0.5)
        >>> tracker = zivi.TwistingTracker(30, 17, h=1e-2, e=0.5)
        >>> run = zivi.simulate_closed_loop(plant, tracker, (0, 1), (0.2, 0), y_ref0=(0.2, 0))
        >>> x, xdot = run([0.5, 0.50025, 0.505])
        >>> float(x[0]) == float(run.x[50])
        True
        """
        if self._path is None:
            raise ValueError("run(t) needs a run with dense_output=True")
        return self._between(t, self._path)

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
        return self._between(t, self._reference)

    def _between(self, t: ArrayLike, path: Path | Reference) -> Array:
        times = real_array("t", t)
        start, end = self._span or (np.nan, np.nan)
        if not np.all((times >= start) & (times <= end)):
            raise ValueError(f"t must lie within the computed span [{start}, {end}]")
        x, xdot = path.physical(times.ravel())
        return np.stack([x.reshape(times.shape), xdot.reshape(times.shape)])

    def impacts_down_to(self, speed: float, *, limit: int = 10_000) -> NDArray[np.void]:
        """List the impacts with at least a speed, also those that were extrapolated.

        Parameters
        ----------
        speed : float
            Smallest speed after the impact, > 0 (m/s).
        limit : int
            At most so many impacts of each accumulation, >= 1.

        Returns
        -------
        structured ndarray
            As ``impacts``, in the order of time.

        Raises
        ------
        ValueError
            If `speed` or `limit` is out of range.

        Examples
        --------
        >>> plant = zivi.ImpactSystem(-9.81, e=0.999)
        >>> regulator = zivi.TwistingRegulator(30, 25, h=0.1, e=0.999)
        >>> run = zivi.simulate_closed_loop(plant, regulator, (0, 9), (1, 0))
        >>> len(run.impacts) <= len(run.impacts_down_to(1e-9))
        True
        """
        impacts = down_to(self.impacts, self._path, speed, limit)
        return impacts if self._span is None else impacts[impacts["t"] <= self._span[1]]

    def plot(self, figure: Figure | None = None) -> Figure:
        """Plot the run as a whole, `zivi.plot.overview`.

        Parameters
        ----------
        figure : matplotlib.figure.Figure, optional
            Where to draw; a new figure by default.

        Returns
        -------
        matplotlib.figure.Figure
        """
        drawn: Figure = late("zivi.plot", "overview")(self, figure)
        return drawn

    @property
    def error(self) -> Array:
        """Position error ``x - x_ref`` (m), NaN without a reference."""
        return self.x - self.x_ref

    def __repr__(self) -> str:
        wall = f"{len(self.impacts)} impacts"
        if self.rest_time is not None:
            wall += f", at rest from {self.rest_time:.6g} s"
        name = self.config["controller"]["name"]
        span = f"{self.t[0]:.6g} .. {self.t[-1]:.6g} s" if len(self.t) else "no samples"
        return f"<ClosedLoop {name}, {span}, {wall}: {self.status.name.lower()}>"

    def to_xarray(self) -> xarray.Dataset:
        """Convert to a labelled dataset that can be plotted, selected and saved.

        Returns
        -------
        xarray.Dataset
            The sampled quantities over ``time``, the signs over ``time`` and ``sign``, the
            impacts over ``impact_time``, with units, descriptions and the configuration (JSON)
            in the attributes.
        """
        needed("xarray", "labelled datasets")
        import xarray

        def labelled(dims: Any, values: Any, unit: str, meaning: str) -> Any:
            return dims, values, {"units": unit, "long_name": meaning}

        return xarray.Dataset(
            {
                name: labelled("time", getattr(self, name), unit, meaning)
                for name, (unit, meaning) in QUANTITIES.items()
            }
            | {
                "s": labelled("time", self.s, "m", "transformed position"),
                "v": labelled("time", self.v, "m/s", "transformed velocity"),
                "signs": labelled(("time", "sign"), self.signs, "1", "multipliers of the tick"),
                "tick_status": labelled("time", self.tick_status, "1", "bits of TickStatus"),
                "zeno_time": labelled("zeno", self.zeno_times, "s", "time of a Zeno point"),
                "liftoff_time": labelled("liftoff", self.liftoff_times, "s", "time of a lift-off"),
            }
            | {
                f"impact_{field}": labelled("impact_time", self.impacts[field], "m/s", meaning)
                for field, meaning in (
                    ("xdot_before", "velocity before the impact"),
                    ("xdot_after", "velocity after the impact"),
                )
            },
            coords={
                "time": labelled("time", self.t, "s", "time"),
                "sign": list(SIGNS),
                "impact_time": labelled("impact_time", self.impacts["t"], "s", "time of an impact"),
            },
            attrs={
                "title": "Closed loop of a mechanical system with impacts",
                "source": f"zivi {_zivi.__version__}",
                "config": text_of(self.config),
                "status": int(self.status),
                "message": self.message,
                "rest_time": np.nan if self.rest_time is None else self.rest_time,
                "nfev": self.nfev,
                "n_refused": self.n_refused,
            },
        )
