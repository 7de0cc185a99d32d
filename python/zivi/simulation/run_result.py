"""Base of all results of runs: dense output, tables of events, datasets, plots."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, integer, real_array
from zivi.base.extras import import_attribute
from zivi.base.former import with_resolved_impacts
from zivi.base.habits import Hinted
from zivi.base.status import Status
from zivi.base.table import Field, Tabulated, counted
from zivi.simulation.dense import DenseMotion, LinearPath, LostPath
from zivi.simulation.events import SLOWEST, Rows, down_to, listed, rows_of_events, rows_of_impacts
from zivi.system.impact_law import ImpactLaw, NewtonImpact, Restitutions, restitutions

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas
    import xarray
    from matplotlib.figure import Figure

    from zivi.base.table import ResultTable
    from zivi.simulation.methods import SwitchedRK
    from zivi.system.mass import ImpactSystem
    from zivi.system.mechanism import MechanicalSystem

# Time up to which a run is accurate, by comparison with a run at tighter tolerances.
#
# Tolerances bound the errors of steps. Their growth, ``exp(lambda t)`` in a chaotic motion, shows
# in the time at which a run of much smaller errors departs. The second run is perturbed by a few
# roundings in initial state and restitution, so that rounding errors of exact flights show as well.

Closer: TypeAlias = Callable[[Array], Array]
"""Positions at times, a row for each, of a run with smaller errors; fewer if it ended early."""

MOST = 300.0
"""A run that is off by more is not trusted: relative tolerances of the largest position."""
TIGHTER = 0.01
LEAST_RTOL = 1e-14
ULPS = 4 * 2.0**-52
TIMES = 1000
"""Times of comparison, besides those of the samples."""


def trusted(
    sol: SampledRun, positions: Array, compared: Callable[[Array], Array] = np.asarray
) -> float:
    """Return the last time up to which a run agrees with a closer one.

    Parameters
    ----------
    sol : Trajectory or MechanicalTrajectory
        The run.
    positions : ndarray
        Those of its samples.
    compared : callable
        The numbers to be compared of positions. Default: all.
    """
    closer: Closer | None = sol._closer
    if closer is None:
        raise ValueError(
            "trusted_until needs a run of zivi.SwitchedRK that was computed in this process, not "
            "one of another method or from a file; rerun the simulation"
        )
    times, at = sol.t, positions.reshape(len(sol.t), -1)
    if sol._path is not None and getattr(sol._path, "dense", True):
        between = np.linspace(sol.t[0], sol.t[-1], TIMES)
        times = np.unique(np.concatenate([times, between]))
        at = sol(times)[0].reshape(len(times), -1)
    if len(times) < 2:
        return float(times[-1])
    at, near = compared(at), compared(closer(times))
    settings: Any = sol.config["method"]
    atol = np.broadcast_to(settings["atol"], 2)[0]
    most = MOST * (settings["rtol"] * np.abs(at).max(axis=0) + atol)
    apart = np.flatnonzero((np.abs(at[: len(near)] - near) > most).any(axis=1))
    agree = int(apart[0]) if len(apart) else len(near)
    return float(times[max(agree - 1, 0)])


def trust_note(sol: SampledRun) -> str:
    """Describe until when a run can be trusted, if that is before its end."""
    until = vars(sol).get("trusted_until")
    return "" if until is None or until >= sol.t[-1] else f", trusted until {until:.6g} s"


def closer_mass(
    system: ImpactSystem,
    method: SwitchedRK,
    start: float,
    state: tuple[float, float],
    stops: Array,
    times: Array,
    kicks: Any = None,
) -> Array:
    """Return the positions of the closer run of a mass."""
    near = type(system)(system.force, e=_nearby(system.law), wall=system.wall)
    begin = (state[0] * (1 + ULPS), state[1] * (1 - ULPS))
    x: Array = import_attribute("zivi.simulation.run", "simulate")(
        near,
        (start, float(times[-1])),
        begin,
        _tighter(method),
        t_eval=times,
        dense_output=False,
        progress=False,
        tstops=stops,
        kicks=kicks,
    ).x
    return x[:, None]


def closer_mechanism(
    system: MechanicalSystem,
    method: SwitchedRK,
    start: float,
    state: tuple[Array, Array],
    stops: Array,
    times: Array,
    kicks: Any = None,
) -> Array:
    """Return the coordinates of the closer run of a mechanical system, from the same place."""
    near = object.__new__(type(system))
    vars(near).update(vars(system), _e=_nearby_of_gaps(system._e))
    q, qdot = state
    at: Array = import_attribute("zivi.simulation.run", "simulate")(
        near,
        (start, float(times[-1])),
        (q, qdot * (1 - ULPS)),
        _tighter(method),
        t_eval=times,
        dense_output=False,
        progress=False,
        tstops=stops,
        kicks=kicks,
    ).q
    return at


def _tighter(method: SwitchedRK) -> SwitchedRK:
    rtol = max(method.rtol * TIGHTER, LEAST_RTOL)
    atol = tuple(TIGHTER * np.broadcast_to(method.atol, 2))
    return dataclasses.replace(method, rtol=rtol, atol=atol)


def _nearby(law: ImpactLaw) -> float | ImpactLaw:
    """Move a law by some roundings."""
    if isinstance(law, NewtonImpact):
        moved: float = _perturbed(law.e)
        return moved
    return law._scaled(1 - ULPS)


def _nearby_of_gaps(e: Restitutions) -> Restitutions:
    """Move those of all gaps."""
    if isinstance(e, tuple):
        return restitutions([_nearby(law) for law in e], len(e))
    moved: Array = _perturbed(e)
    return moved


def _perturbed(e: Any) -> Any:
    """Move restitutions by some roundings; 1 stays elastic, 0 plastic."""
    moved = np.where(np.asarray(e) < 1.0, np.asarray(e) * (1 - ULPS), e)
    return float(moved) if moved.ndim == 0 else moved


# Base classes of runs: dense output, event tables, datasets, plots.

Setup: TypeAlias = "dict[str, Any] | Callable[[], dict[str, Any]]"
"""The configuration of a run, or what makes it once it is requested."""

EVENT_FIELDS: dict[str, Field] = {
    "impact_xdot_before": ("impact_time", "m/s", "velocity before the impact"),
    "impact_xdot_after": ("impact_time", "m/s", "velocity after the impact"),
    "zeno_time": ("zeno", "s", "time of a Zeno point"),
    "liftoff_time": ("liftoff", "s", "time of a lift-off"),
}
"""Dimension, unit and meaning of what happens at the wall of a mass."""
EVENT_COORDS: dict[str, Field] = {
    "time": ("time", "s", "time"),
    "impact_time": ("impact_time", "s", "time of an impact"),
}


NO_KICKS = np.zeros(0, dtype=[("t", float), ("dv", float)])
"""The kicks of a run without any."""


KICKS = {
    "t": "time",
    "dv": "change of the velocity",
    **{f"{name}_before": "velocity before" for name in ("xdot", "qdot")},
    **{f"{name}_after": "velocity after" for name in ("xdot", "qdot")},
}
"""Meaning of the fields of kicks."""


def count_of_kicks(count: int) -> str:
    """Return a number of kicks as text."""
    return f"{count} kick{'' if count == 1 else 's'}"


class SampledRun(Hinted, Tabulated):
    """A run: samples, and the motion between them."""

    __dataclass_fields__: ClassVar[dict[str, Any]]
    if TYPE_CHECKING:
        t: Array
        status: Status
        message: str
        nfev: int
        _closer: Any

        @property
        def config(self) -> Mapping[str, Any]: ...  # noqa: D102
        def __call__(self, t: ArrayLike) -> Any: ...  # noqa: D102

        zeno: Any
        liftoffs: Any
        resolved_impacts: Any
        _path: Any

    slowest: float = SLOWEST

    @property
    def kicks(self) -> Rows:
        """Kicks of the run: ``t`` (s), ``dv``, and the velocities before and after.

        The velocities are ``xdot_before`` and ``xdot_after`` of a mass (m/s), ``qdot_before`` and
        ``qdot_after`` of a mechanical system.
        """
        found: Rows = vars(self).get("_kicks", NO_KICKS)
        return found

    def _kicks_text(self) -> str:
        return f", {count_of_kicks(len(self.kicks))}" if len(self.kicks) else ""

    def _as_dataset(self) -> xarray.Dataset:
        dataset = super()._as_dataset()
        for name in self.kicks.dtype.names if len(self.kicks) else ():
            values = self.kicks[name]
            dims = ("kick", "coordinate")[: values.ndim]
            dataset[f"kick_{name}"] = dims, values, {"long_name": f"kicks: {KICKS[name]}"}
        return dataset

    @property
    def success(self) -> bool:
        """Whether the end of the span was reached, or a terminal event."""
        return self.status in (Status.COMPLETED, Status.TERMINATED_BY_EVENT)

    def _known(self) -> Any:
        """Return the motion between the samples."""
        path = self._path
        if isinstance(path, LostPath):
            path.physical()
        if path is None or not getattr(path, "dense", True):
            raise ValueError("sol(t) needs a run with dense_output=True")
        return path

    def _end(self) -> float | None:
        """Return the time up to which the motion was computed (s); None before the first sample."""
        path = self._path
        _, end = (path and path.span) or (None, self.t[-1] if len(self.t) else None)
        return end

    def _extent(self) -> tuple[float, float]:
        """Return the times between which the motion is known."""
        return self._known().span or (np.nan, np.nan)

    def _within(self, t: ArrayLike) -> Array:
        """Read times, which must lie between these."""
        times = real_array("t", t)
        start, end = self._extent()
        if not np.all((times >= start) & (times <= end)):
            raise ValueError(f"t must lie within the computed span [{start}, {end}]")
        return times

    def resample(self, t: ArrayLike | None = None, *, n: int | None = None) -> Self:
        """Report the run at other times.

        Parameters
        ----------
        t : array_like, optional
            Times within the computed span that do not decrease.
        n : int, optional
            So many equidistant times instead, >= 2.

        Returns
        -------
        Trajectory, ClosedLoop or MechanicalTrajectory
            The same run with other samples. Quantities of method steps are those of the step that
            contains the time, NaN if the steps were not stored; controls and signs are held.
            Reactions are NaN if the run was loaded or sent to another process, without its system.

        Raises
        ------
        TypeError
            If not exactly one of `t` and `n` is given.
        ValueError
            If a time lies outside the computed span, or the run kept no dense output.

        Examples
        --------
        >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
        >>> sol = zivi.simulate(ball, (0, 3), (1, 0)).resample(n=7)
        >>> sol.t
        array([0. , 0.5, 1. , 1.5, 2. , 2.5, 3. ])
        """
        return self._resampled(self._within(times_of(self, t, n)))

    def _resampled(self, times: Array) -> Self:
        raise NotImplementedError

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(with_resolved_impacts(state))

    @functools.cached_property
    def impacts(self) -> Rows:
        """The impacts, whether they were computed one by one or skipped by a Zeno extrapolation.

        Those with at least the part ``slowest`` of the largest speed before an impact, at most a
        million of each accumulation.
        """
        return self._listed()

    def _listed(self) -> Rows:
        raise NotImplementedError

    def impacts_down_to(self, speed: float, *, limit: int = 10_000) -> Rows:
        """List the impacts with at least a speed, also those that were extrapolated.

        Parameters
        ----------
        speed : float
            Smallest speed before the impact, > 0 (m/s), the speed that `slowest` counts.
        limit : int
            Maximal number of impacts of each accumulation, >= 1.

        Returns
        -------
        structured ndarray
            As ``impacts``, in the order of time.

        Raises
        ------
        ValueError
            If `speed` or `limit` is out of range, or an older version of zivi stored the run.

        Examples
        --------
        >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
        >>> sol = zivi.simulate(ball, (0, 3), (1, 0))
        >>> len(sol.impacts), len(sol.impacts_down_to(1e-6))
        (10, 23)
        """
        return self._down_to(speed, limit)

    def _down_to(self, speed: float, limit: int) -> Rows:
        raise NotImplementedError

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
        drawn: Figure = import_attribute("zivi.plot", "overview")(self, figure)
        return drawn

    def to_pandas(self, t: ArrayLike | None = None, *, n: int | None = None) -> pandas.DataFrame:
        """Convert the samples to a table, a row for each time.

        Parameters
        ----------
        t, n
            Times instead of the samples' (see `resample`).

        Returns
        -------
        pandas.DataFrame
            The samples by their names, over the index ``time``. Of a mechanical system
            coordinates by name, velocities (``x`` and ``xdot``), gaps by name, reactions
            (``reaction_`` and the gap's name).

        Examples
        --------
        >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
        >>> table = zivi.simulate(ball, (0, 3), (1, 0)).to_pandas(n=4)
        >>> list(table.columns[:2]), table.index.name
        (['x', 'xdot'], 'time')
        """
        return self._at(t, n)._as_frame()

    def to_xarray(self, t: ArrayLike | None = None, *, n: int | None = None) -> xarray.Dataset:
        """Convert to a labelled dataset that can be plotted, selected and saved.

        Parameters
        ----------
        t, n
            Times instead of the samples' (see `resample`).

        Returns
        -------
        xarray.Dataset
            Sampled quantities over ``time`` (signs of a loop over ``sign``, quantities of a
            mechanical system over ``coordinate`` and ``gap``, by their names); what happened at
            walls and gaps over dimensions of its own; units, descriptions and the configuration
            (JSON) in the attributes. With a moving wall also ``x_fixed`` and ``xdot_fixed``, the
            motion in the fixed frame, and ``wall``, that of the wall.

        Examples
        --------
        >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
        >>> sol = zivi.simulate(ball, (0, 3), (1, 0), method=zivi.ThetaGamma(h=1e-3))
        >>> sol.to_xarray().x.attrs["units"]
        'm'
        """
        return self._at(t, n)._as_dataset()

    def _at(self, t: ArrayLike | None, n: int | None) -> Self:
        return self if t is None and n is None else self.resample(t, n=n)


class MassRun(SampledRun):
    """A run of one mass: `Trajectory` and `ClosedLoop`."""

    if TYPE_CHECKING:
        x: Array
        xdot: Array
        zeno_times: Array
        liftoff_times: Array
        rest_time: float | None
        y_events: list[Array]

        def _table(self) -> ResultTable: ...

    def __call__(self, t: ArrayLike) -> Array:
        """Return the state between the samples.

        After `SwitchedRK` it is the dense output of the method, across impacts, through the
        accumulations that were extrapolated (their arcs are computed when they are requested) and
        at rest; exact where the force is constant. After a method of fixed steps ``s`` and ``v``
        are linear between the steps (first order, as the scheme) and are projected. At an impact
        the velocity is the one after it.

        Parameters
        ----------
        t : float or array_like
            Times within the computed span (s).

        Returns
        -------
        ndarray
            ``(x, xdot)``, of shape (2,) for a scalar `t`, (2, n) for n times.

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
        return self._between(self._known(), self._within(t))

    def _between(self, path: DenseMotion | Any, times: Array) -> Array:
        x, xdot = path.physical(times.ravel())
        return np.stack([x.reshape(times.shape), xdot.reshape(times.shape)])

    @functools.cached_property
    def zeno(self) -> Rows:
        """The accumulations: ``t`` (s), ``gap`` (0), and ``closed``, the flag of the wall."""
        return rows_of_events("zeno", self.zeno_times)

    @functools.cached_property
    def liftoffs(self) -> Rows:
        """Where the mass left rest: ``t`` (s), the last instant at rest, and ``gap`` (0)."""
        return rows_of_events("liftoffs", self.liftoff_times)

    @property
    def q_events(self) -> list[Array]:
        """The positions in `y_events`, each of shape (n, 1), as a mechanical run has them."""
        return [states[:, :1] for states in self.y_events]

    @property
    def qdot_events(self) -> list[Array]:
        """The velocities in `y_events`, each of shape (n, 1)."""
        return [states[:, 1:] for states in self.y_events]

    def _listed(self) -> Rows:
        return rows_of_impacts(listed(self.resolved_impacts, self._path, self.slowest))

    def _down_to(self, speed: float, limit: int) -> Rows:
        return rows_of_impacts(down_to(self.resolved_impacts, self._path, speed, limit))

    def _event_values(self) -> dict[str, Any]:
        """Return the events at the wall by their names in a dataset."""
        return {
            "impact_xdot_before": self.impacts["speed_before"],
            "impact_xdot_after": self.impacts["speed_after"],
            "zeno_time": self.zeno_times,
            "liftoff_time": self.liftoff_times,
            "time": self.t,
            "impact_time": self.impacts["t"],
        }

    def _outcome(self) -> dict[str, Any]:
        """Return the dataset attributes that describe the end of the run."""
        return {
            "status": int(self.status),
            "message": self.message,
            "rest_time": np.nan if self.rest_time is None else self.rest_time,
            "nfev": self.nfev,
        }

    def _wall_facts(self) -> dict[str, str]:
        """Return the events at the wall as rows of an HTML page."""
        fast = np.max(np.abs(self.impacts["speed_before"]), initial=0.0)
        rest = "no" if self.rest_time is None else f"from {self.rest_time:.9g} s"
        return {
            "status": f"{self.status.name.lower()}: {self.message}",
            "time": f"{self.t[0]:.6g} to {self.t[-1]:.6g} s" if len(self.t) else "no samples",
            "impacts": f"{len(self.impacts)}, the fastest at {fast:.6g} m/s",
            "Zeno points": ", ".join(f"{t:.9g} s" for t in self.zeno_times[:5]) or "none",
            "at rest at the end": rest,
        }

    def _events_text(self) -> str:
        """Describe impacts, accumulations and rest in a few words."""
        wall = counted(len(self.impacts), "impact")
        if len(self.zeno_times):
            more = ", ..." if len(self.zeno_times) > 1 else ""
            wall += f" that accumulate at {self.zeno_times[0]:.6g}{more} s"
        if self.rest_time is not None:
            wall += f", at rest from {self.rest_time:.6g} s"
        return wall


def times_of(sol: SampledRun, t: ArrayLike | None, n: int | None) -> Array:
    """Return the times that are requested: these, or a number of equidistant ones."""
    if (t is None) == (n is None):
        raise TypeError("exactly one of t and n must be given")
    if n is not None:
        if integer("n", n) < 2:
            raise ValueError(f"n must be >= 2, got {n}")
        return np.linspace(*sol._extent(), n)
    times = np.atleast_1d(real_array("t", t))
    if times.ndim != 1:
        raise ValueError(f"t must be one-dimensional, got shape {times.shape}")
    if np.any(np.diff(times) < 0):
        raise ValueError("t must not decrease")
    return times


# Step quantities of a run at other times.


def between_steps(sol: MassRun, times: Array) -> tuple[Array, ...]:
    """Return transformed state, multipliers and residual at `times` within the span of a run."""
    path = sol._known()
    s, v = path.lifted(times)
    if isinstance(path, LinearPath):
        lambda_s, lambda_v, residual = _of_steps(sol, path, times)
    else:
        # the branch is that of v at the wall; at rest both are zero
        lambda_s, lambda_v = np.where(s == 0.0, np.sign(v), np.sign(s)), np.sign(v)
        residual = np.full(len(times), np.nan)
    return s, v, lambda_s, lambda_v, residual


def _of_steps(sol: Any, path: LinearPath, times: Array) -> list[Array]:
    """Return the values of the steps that contain the times, NaN where they were not stored."""
    if not np.array_equal(sol.t, path.t):
        return [np.full(len(times), np.nan)] * 3
    # the step that contains a time ends at the first sample not before it
    step = np.searchsorted(path.t, times)
    lifted = sol.transformed
    return [row[step] for row in (lifted.lambda_s, lifted.lambda_v, sol.residual)]


# Partial run that an exception ended.

AnyRun = TypeVar("AnyRun", bound=SampledRun)


def as_raised(run: AnyRun) -> AnyRun:
    """Copy a run with the status of one that an exception ended; unread fields stay unread."""
    copied = object.__new__(type(run))
    message = _zivi.STATUS_MESSAGES[Status.RAISED]
    vars(copied).update(vars(run), status=Status.RAISED, message=message)
    return copied


def with_partial(error: BaseException, sol: SampledRun) -> BaseException:
    """Attach what was computed to the exception that ended a run."""
    end = sol._end()
    where = "before its first sample" if end is None else f"at t = {end:.9g} s"
    error.add_note(
        f"zivi: the run stopped {where}; "
        "what was computed is this exception's attribute 'trajectory'."
    )
    with contextlib.suppress(AttributeError):  # an exception class with __slots__
        error.trajectory = sol  # type: ignore[attr-defined]
    return error
