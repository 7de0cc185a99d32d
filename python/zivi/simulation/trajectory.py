"""The result of a run."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi import _zivi
from zivi.base.check import Array, MaybeNone, real_array
from zivi.base.extras import late
from zivi.base.status import Status
from zivi.simulation.dense import LostPath, Path
from zivi.simulation.describe import configuration_of
from zivi.simulation.impacts import IMPACT, down_to, impacts_of
from zivi.simulation.labelled import QUANTITIES, dataset_of, html_of, table_of
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.resample import resampled, times_of
from zivi.simulation.trust import Closer, closer_mass, told, trusted

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

    from zivi.simulation.methods import Method
    from zivi.system.mass import ImpactSystem
    from zivi.system.wall import HarmonicWall, MovingWall

__all__ = ["IMPACT", "NO_STOPS", "Trajectory"]

NO_STOPS = np.empty(0)
"""No times at which a force jumps."""
NO_STOPS.flags.writeable = False

Setup: TypeAlias = "dict[str, Any] | Callable[[], dict[str, Any]]"
"""The configuration of a run, or what makes it once it is asked for."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """Samples and events of one run.

    Calling it, ``sol(t)``, gives ``(x, xdot)`` between the samples.

    Attributes
    ----------
    t : ndarray
        Times of the samples (s); all sampled arrays have its length.
    x, xdot : ndarray
        Distance from the wall (m) and velocity (m/s); at the wall, the velocity after an impact.
    s, v : ndarray
        Transformed position (m) and velocity (m/s), ``x = |s|``.
    lambda_s, lambda_v : ndarray
        Multipliers in ``sgn s`` and ``sgn v`` of the step that ends at the sample; for the first
        sample the signs of the initial state.
    residual : ndarray
        Natural residual of that step, its rows divided by the size of their terms, recomputed
        from the inclusion: at rounding level (1e-13 at most, where a degenerate case was taken)
        if the step is solved. For `e` below about 1e-2 the rounding of ``R``, which may be as
        small as `e`, shows: 3e-12 at ``e = 1e-6``. 0 at the first sample; NaN for methods
        that solve no inclusion.
    impacts : structured ndarray
        Fields ``t`` (s), ``xdot_before`` and ``xdot_after`` (m/s): the impacts that the steps
        resolve, finitely many before a Zeno point.
    zeno_times : ndarray
        Times at which rest was reached through impacts (s).
    liftoff_times : ndarray
        Times at which the mass left rest (s), the last instant at rest.
    rest_time : float or None
        Time from which the mass stays at rest until the end of the run (s).
    failed_steps : ndarray of int
        Numbers of the steps (1 is the first) that the chosen solver did not solve and the exact
        one took instead; empty for ``solver="exact"``.
    status : Status
        How the run ended, 0 for success.
    success : bool
        Whether the end of the span was reached, or a terminal event.
    message : str
        What happened, and what to try.
    nfev : int
        Number of force evaluations.
    n_steps : int
        Number of steps, those that were accepted.
    n_rejected : int
        Steps that were tried and given up for smaller ones.
    t_events : list of ndarray
        For each event of the user the times at which it happened (s).
    y_events : list of ndarray
        The states ``(x, xdot)`` there, each of shape (n, 2).
    config : dict
        System, method, span and initial state, as plain values.
    """

    t: Array
    x: Array
    xdot: Array
    s: Array
    v: Array
    lambda_s: Array
    lambda_v: Array
    residual: Array
    impacts: NDArray[np.void]
    zeno_times: Array
    liftoff_times: Array
    rest_time: float | MaybeNone
    failed_steps: NDArray[np.int64]
    status: Status
    message: str
    nfev: int
    n_steps: int
    _setup: Setup
    n_rejected: int = 0
    t_events: list[Array] = dataclasses.field(default_factory=list)
    y_events: list[Array] = dataclasses.field(default_factory=list)
    _path: Path | None = dataclasses.field(repr=False, default=None)
    _wall: HarmonicWall | MovingWall | None = dataclasses.field(repr=False, default=None)
    _closer: Closer | None = dataclasses.field(repr=False, default=None)

    @functools.cached_property
    def config(self) -> dict[str, Any]:
        """System, method, span and initial state, as plain values."""
        return self._setup() if callable(self._setup) else self._setup

    def __getstate__(self) -> dict[str, Any]:
        # plain values can be copied and sent where a force cannot
        return self.__dict__ | {"_setup": self.config, "_closer": None}

    @property
    def success(self) -> bool:
        """Whether the end of the span was reached, or a terminal event."""
        return self.status in (Status.COMPLETED, Status.TERMINATED_BY_EVENT)

    @functools.cached_property
    def trusted_until(self) -> float:
        """Time up to which the run is near the motion, the end if all of it is (s).

        The tolerances bound the errors of steps; in a chaotic motion these grow until the run is
        another one. The same run at a hundredth of the tolerances, restitution and start moved by
        some roundings, tells when: up to here both agree in `x` to 300 times what `rtol` and
        `atol` allow. It is made when this is first asked for, takes about twice the time of
        the run, and calls its force again.

        Raises
        ------
        ValueError
            For a method of fixed steps, and for a run that was loaded or sent to another process
            before it was asked.

        Examples
        --------
        A ball on a table that vibrates with three times its weight:

        >>> table = zivi.LinearForce(gravity=1, amplitude=3, omega=1)
        >>> ball = zivi.ImpactSystem(table, e=0.8)
        >>> sol = zivi.simulate(ball, (0, 300), (1, 0), zivi.SwitchedRK(flights="rk"))
        >>> sol.success, 50 < sol.trusted_until < 150
        (True, True)
        """
        return trusted(self, self.x)

    @classmethod
    def _from_record(
        cls,
        record: _zivi.RunRecord,
        system: ImpactSystem,
        method: Method,
        span: tuple[float, float],
        state: tuple[float, float],
        stops: Array = NO_STOPS,
    ) -> Trajectory:
        t, *sampled = record.columns[:, : record.n_samples]
        samples = dict(zip(QUANTITIES, sampled, strict=True))
        sol = object.__new__(cls)
        # as the class would, at a quarter of the cost: short runs are called by the million
        vars(sol).update(
            t=t,
            **samples,
            impacts=impacts_of(record),
            zeno_times=record.zeno_times,
            liftoff_times=record.liftoff_times,
            rest_time=record.rest_time,
            failed_steps=record.failed_steps,
            status=Status(record.status),
            message=record.message,
            nfev=record.nfev,
            n_steps=record.n_steps,
            n_rejected=record.n_rejected,
            _setup=functools.partial(configuration_of, system, method, span, state),
            t_events=[hits.t for hits in record.hits],
            y_events=[np.hstack([hits.q, hits.qdot]) for hits in record.hits],
            _path=record.path or method._path(system.kappa, t, samples),  # type: ignore[attr-defined]
            _wall=system.wall,
        )
        if isinstance(method, SwitchedRK):
            vars(sol)["_closer"] = functools.partial(
                closer_mass, system, method, span[0], state, stops
            )
        return sol

    def __call__(self, t: ArrayLike) -> Array:
        """Give the state between the samples.

        After `SwitchedRK` it is the dense output of the method, across impacts, through the
        accumulations that were extrapolated (their arcs are computed when they are asked for) and
        at rest. After a method of fixed steps ``s`` and ``v`` are linear between the steps (first
        order, as the scheme) and are projected. At an impact the velocity is the one after it.

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
        """
        times = real_array("t", t)
        path = self._known()
        start, end = self._span()
        if not np.all((times >= start) & (times <= end)):
            raise ValueError(f"t must lie within the computed span [{start}, {end}]")
        x, xdot = path.physical(times.ravel())
        return np.stack([x.reshape(times.shape), xdot.reshape(times.shape)])

    def _known(self) -> Path:
        path = self._path
        if isinstance(path, LostPath):
            path.physical()
        if path is None or not path.dense:
            raise ValueError("sol(t) needs a run with dense_output=True")
        return path

    def _span(self) -> tuple[float, float]:
        """Give the times between which the motion is known."""
        return self._known().span or (np.nan, np.nan)

    def resample(self, t: ArrayLike | None = None, *, n: int | None = None) -> Trajectory:
        """Report the run at other times.

        Parameters
        ----------
        t : array_like, optional
            Times within the computed span that do not decrease (s).
        n : int, optional
            So many equidistant times instead, >= 2.

        Returns
        -------
        Trajectory
            The same run with other samples. Multipliers and residuals of a method of fixed steps
            are those of the step that contains the time, NaN if the run did not keep its steps.

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
        return resampled(self, times_of(self, t, n))

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
            If `speed` or `limit` is out of range, or an older version of zivi stored the run.

        Examples
        --------
        >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
        >>> sol = zivi.simulate(ball, (0, 3), (1, 0))
        >>> len(sol.impacts), len(sol.impacts_down_to(1e-6))
        (3, 22)
        """
        return down_to(self.impacts, self._path, speed, limit)

    def fixed(self, t: ArrayLike | None = None) -> tuple[Array, Array]:
        """Give the motion in the fixed frame, where a moving wall moves.

        Parameters
        ----------
        t : float or array_like, optional
            Times within the computed span (s); by default those of the samples.

        Returns
        -------
        X, Xdot : ndarray
            ``x + w(t)`` (m) and ``xdot + w'(t)`` (m/s); `x` and `xdot` if the wall does not move.

        Examples
        --------
        >>> table = zivi.HarmonicWall(amplitude=0.1, omega=10.0)
        >>> ball = zivi.ImpactSystem(-9.81, e=0.5, wall=table)
        >>> sol = zivi.simulate(ball, (0, 1), (1, 0), method=zivi.ThetaGamma(h=1e-3))
        >>> position, velocity = sol.fixed()
        >>> float(position[0])  # one metre above the table, which is up
        1.1
        """
        x, xdot = (self.x, self.xdot) if t is None else self(t)
        if self._wall is None:
            return x, xdot
        w, wdot, _ = self._wall(self.t if t is None else t)
        return x + w, xdot + wdot

    def __repr__(self) -> str:
        wall = f"{len(self.impacts)} impacts"
        if self.rest_time is not None:
            wall += f", at rest from {self.rest_time:.6g} s"
        span = f"{self.t[0]:.6g} .. {self.t[-1]:.6g} s" if len(self.t) else "no samples"
        steps = f"{self.n_steps} steps"
        if len(self.failed_steps):
            steps += f" ({len(self.failed_steps)} not solved by the chosen solver)"
        return f"<Trajectory {span}, {steps}, {wall}{told(self)}: {self.status.name.lower()}>"

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

    def _repr_html_(self) -> str:
        """Show the run as a table, in a notebook."""
        return html_of(self)

    def to_pandas(self, t: ArrayLike | None = None, *, n: int | None = None) -> pandas.DataFrame:
        """Convert the samples to a table, a row for each time.

        Parameters
        ----------
        t, n
            Other times than those of the samples, as in `resample`.

        Returns
        -------
        pandas.DataFrame
            ``x`` to ``residual``, over the index ``time``.

        Examples
        --------
        >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
        >>> table = zivi.simulate(ball, (0, 3), (1, 0)).to_pandas(n=4)
        >>> list(table.columns[:2]), table.index.name
        (['x', 'xdot'], 'time')
        """
        return table_of(self if t is None and n is None else self.resample(t, n=n))

    def to_xarray(self, t: ArrayLike | None = None, *, n: int | None = None) -> xarray.Dataset:
        """Convert to a labelled dataset that can be plotted, selected and saved.

        Parameters
        ----------
        t, n
            Other times than those of the samples, as in `resample`.

        Returns
        -------
        xarray.Dataset
            The sampled quantities over ``time``, the impacts over ``impact_time``, Zeno and
            lift-off times, with units, descriptions and the configuration (JSON) in the attributes.
            With a moving wall also ``x_fixed`` and ``xdot_fixed``, the motion in the fixed frame,
            and ``wall``, that of the wall.

        Examples
        --------
        >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
        >>> sol = zivi.simulate(ball, (0, 3), (1, 0), method=zivi.ThetaGamma(h=1e-3))
        >>> sol.to_xarray().x.attrs["units"]
        'm'
        """
        return dataset_of(self if t is None and n is None else self.resample(t, n=n))
