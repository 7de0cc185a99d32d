"""The derivatives of a run: what they are, how they ended, how far they hold."""

from __future__ import annotations

import dataclasses
import functools
import pickle
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi.base.check import Array, real_array
from zivi.base.former import with_resolved_impacts
from zivi.base.habits import attribute_error
from zivi.base.status import NamedStatus
from zivi.base.table import Field, ResultTable, Tabulated
from zivi.simulation.trajectory import Trajectory


class Problem(Protocol):
    """A run with its parameters, from which derivatives are recomputed."""

    @property
    def span(self) -> tuple[float, float]:
        """The span of the run (s)."""

    @property
    def sizes(self) -> Array:
        """The sizes of the parameters, by which distances to events are compared."""

    @property
    def codes(self) -> Any:
        """The parameter codes of the core."""

    def at(self, times: Array) -> Array:
        """Return the derivatives of positions and velocities at times."""

    def with_wrt(self, wrt: Any) -> Any:
        """Return the same problem for other parameters."""

    def ending_within(self, t: float, zeno: float) -> Any:
        """Return the derivatives of a run that ends between an impact and its Zeno point."""


class OrbitStatus(NamedStatus):
    """How the analysis of a motion ended: of `sensitivity`, of orbits, of branches.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> zivi.sensitivity(ball, (0, 3), (1, 0), wrt=("e",)).status
    <OrbitStatus.COMPLETED: 0>
    """

    COMPLETED = 0
    """What was asked for is there."""
    GRAZING = 1
    """An impact, or the want of one, is decided by the tolerances: derivatives are those of the
    run as it was computed."""
    RUN_ENDED = 2
    """The run ended early: its own ``status`` says why."""
    NOT_CONVERGED = 3
    """Newton's iteration did not converge."""
    LEFT_ADMISSIBLE = 4
    """The orbit needs an impact of a negative speed, or a motion behind the wall."""
    RESTS = 5
    """The motion comes to rest for good."""
    RANGE_END = 6
    """The branch reached an end of its range."""
    MAX_POINTS = 7
    """The branch has as many points as were allowed."""
    NOT_DIFFERENTIABLE = 8
    """Some derivative does not exist: a corner, or impacts on coupled gaps at once."""
    OUT_OF_DOMAIN = 9
    """There is no run: a parameter is out of its range, or the force has no value."""
    NO_EVENT = 10
    """The run has no such event."""
    SIMULTANEOUS = 11
    """The branch came to where two events happen at once."""
    CLOSED = 12
    """The branch came back to a point of its own."""
    RETRACED = 13
    """The branch of a doubled orbit came to the single one, from where it would retrace itself."""


class Nearest(NamedTuple):
    """The event that limits a derivative: what it is, when, and how far the run is from it."""

    kind: str
    """``impact`` (one may vanish), ``minimum`` (one may appear), ``zeno``, ``rest``, ``liftoff``,
    ``end`` (an event may pass the end of the run), ``stop`` (one of `tstops`) or ``chain`` (the
    speed after an impact, or the pull at it, may vanish)."""
    t: float
    """When (s)."""
    depth: float
    """A height (m) for impacts and minima, a time (s) at the end and at stops, in a chain a speed
    (m/s) or a force, else a force (m/s^2)."""


@dataclasses.dataclass(frozen=True, eq=False)
class _Gone:
    """Stands for a problem whose functions could not be stored."""

    sizes: Array

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise ValueError(
            "the functions of this system could not be stored with its derivatives: call "
            "zivi.sensitivity again for derivatives between events or for other parameters"
        )


KINDS = ("impact", "minimum", "zeno", "rest", "liftoff", "end", "stop", "chain")
EVENTS: dict[str, Field] = {
    "zeno_time": (("zeno", "wrt"), "", "derivatives of the Zeno times"),
    "liftoff_time": (("liftoff", "wrt"), "", "derivatives of the times of lift-off"),
    "radius": ("wrt", "", "how far the parameter may be moved"),
}
"""Dimensions, unit and meaning of what the datasets of all derivatives hold."""
FIELDS: dict[str, Field] = {
    "final": (("state", "wrt"), "", "derivatives of the state at the end"),
    "impact_dt": (("impact_time", "wrt"), "", "derivatives of the times of impacts"),
    "impact_du": (("impact_time", "wrt"), "", "derivatives of the speeds after impacts"),
    **EVENTS,
}
COORDS: dict[str, Field] = {
    "wrt": ("wrt", "", "parameter"),
    "state": ("state", "", "component of the state"),
    "impact_time": ("impact_time", "s", "time of an impact"),
}
"""The same for those of one mass."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Sensitivity(Tabulated):
    """A run and its derivatives.

    Calling it, ``s(t)``, returns the derivatives of ``(x, xdot)`` at any time of the run.

    Attributes
    ----------
    trajectory : Trajectory
        The run itself.
    wrt : tuple of str
        What the columns are derivatives by.
    final : ndarray
        Derivatives of ``(x, xdot)`` at the end of the run, at a fixed time, of shape (2, m).
    resolved_impacts : structured ndarray
        For each impact that was computed its time ``t`` (s), and the derivatives ``dt`` of the
        time and ``du`` of the speed after it, each of m numbers. ``impacts`` has them for those of
        ``trajectory.impacts``.
    zeno_times : ndarray
        Derivatives of ``trajectory.zeno_times``, of shape (n, m).
    liftoff_times : ndarray
        Derivatives of ``trajectory.liftoff_times``, of shape (n, m). They depend on the
        parameters of the force alone.
    radius : ndarray
        For each column how far its parameter may be moved, to first order, before an impact, a
        Zeno point or a lift-off appears or disappears: an estimate, never a guarantee. Of shape
        (m,), in units of the parameter, infinite where nothing limits it.
    limits : list of Nearest or None
        For each column the event that the radius belongs to.
    status : OrbitStatus
        ``COMPLETED``; ``GRAZING`` when an impact is decided by the tolerances; ``RUN_ENDED``.
    n_slopes : int
        How often the partial derivatives of the force were evaluated.
    """

    trajectory: Trajectory
    wrt: tuple[str, ...]
    final: Array
    resolved_impacts: NDArray[np.void]
    zeno_times: Array
    liftoff_times: Array
    radius: Array
    limits: list[Nearest | None]
    status: OrbitStatus
    n_slopes: int
    _problem: Problem

    if not TYPE_CHECKING:  # which would take any name for granted

        def __getattr__(self, name):
            raise attribute_error("sensitivity", self, name, part="trajectory")

    def __getstate__(self) -> dict[str, Any]:
        """Return the pickled state, with the problem if its functions can be pickled."""
        try:
            pickle.dumps(self._problem)
        except (pickle.PicklingError, AttributeError, TypeError, ValueError):
            return self.__dict__ | {"_problem": _Gone(self._problem.sizes)}
        return self.__dict__

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(with_resolved_impacts(state))

    @functools.cached_property
    def impacts(self) -> NDArray[np.void]:
        """Derivatives of ``trajectory.impacts``, with the fields of `resolved_impacts`.

        Where a jump skipped some, a run that goes from one to the next is made.
        """
        return self._at_impacts(self.trajectory.impacts["t"])

    @property
    def success(self) -> bool:
        """Whether the run went to its end without a grazing."""
        return self.status is OrbitStatus.COMPLETED

    @property
    def nearest(self) -> Nearest | None:
        """The event that limits the derivatives most, relative to the sizes of the parameters."""
        relative = self.radius / self._problem.sizes
        return self.limits[int(np.argmin(relative))] if len(relative) else None

    @functools.cached_property
    def monodromy(self) -> Array:
        """Derivative of the final state by the initial one, of shape (2, 2).

        Taken from the run where ``x0`` and ``xdot0`` are among its columns, else computed once.
        """
        if "x0" in self.wrt and "xdot0" in self.wrt:
            columns = [self.wrt.index("x0"), self.wrt.index("xdot0")]
            return self.final[:, columns]
        final: Array = self._problem.with_wrt(("x0", "xdot0")).solve().final
        return final

    def __call__(self, t: ArrayLike) -> Array:
        """Return the derivatives of the state at other times; computed on demand, by a run.

        Parameters
        ----------
        t : float or array_like
            Times within the run (s). At an impact the derivatives are those after it.

        Returns
        -------
        ndarray
            Derivatives of ``(x, xdot)`` at the fixed time, of shape (2, m) for a scalar `t`, of
            shape (2, m, n) for n times.

        Raises
        ------
        ValueError
            If a time lies outside of the run.
        """
        times = real_array("t", t)
        start, end = self._problem.span
        last = min(end, self.trajectory.t[-1] if len(self.trajectory.t) else start)
        if not np.all((times >= start) & (times <= last)):
            raise ValueError(f"t must lie within the run, [{start}, {last}]")
        columns = self._problem.at(times.ravel())
        return columns.reshape(*self.final.shape, *times.shape)

    def jacobian(self, t: ArrayLike, of: Literal["position", "velocity"] = "position") -> Array:
        """Return the derivatives of samples as a Jacobian for `scipy.optimize.least_squares`.

        Parameters
        ----------
        t : array_like
            n times within the run (s).
        of : {"position", "velocity"}
            What is sampled.

        Returns
        -------
        ndarray
            Of shape (n, m): a row for each time, a column for each of `wrt`. Of a mechanical
            system with nq coordinates (n, nq, m). ``s(t)`` has the same numbers as (2, m, n) or
            (2, nq, m, n).

        Raises
        ------
        ValueError
            If a time lies outside of the run.

        Examples
        --------
        >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
        >>> s = zivi.sensitivity(ball, (0, 3), (1, 0), wrt=("x0", "e"))
        >>> s.jacobian([0.1, 0.2, 0.5]).round(3)
        array([[ 1.   ,  0.   ],
               [ 1.   ,  0.   ],
               [-0.339,  0.215]])
        """
        if of not in ("position", "velocity"):
            raise ValueError(f"of must be 'position' or 'velocity', got {of!r}")
        columns = self(np.atleast_1d(real_array("t", t)))
        return np.ascontiguousarray(np.moveaxis(columns[int(of == "velocity")], -1, 0))

    def impacts_down_to(self, speed: float, *, limit: int = 10_000) -> NDArray[np.void]:
        """List the impacts with at least a speed, also those that a Zeno extrapolation skipped.

        Parameters
        ----------
        speed : float
            Smallest speed before the impact, > 0 (m/s).
        limit : int
            Maximal number of impacts of each accumulation, >= 1.

        Returns
        -------
        structured ndarray
            As `impacts`, for the impacts of ``trajectory.impacts_down_to(speed)``. Where a jump
            skipped some, a run that goes from one to the next is made up to the last of them.

        Raises
        ------
        ValueError
            If `speed` or `limit` is out of range.

        Examples
        --------
        >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
        >>> s = zivi.sensitivity(ball, (0, 3), (1, 0), wrt=("e",))
        >>> len(s.impacts), len(s.impacts_down_to(1e-2))
        (10, 9)
        """
        return self._at_impacts(self.trajectory.impacts_down_to(speed, limit=limit)["t"])

    def _at_impacts(self, wanted: Array) -> NDArray[np.void]:
        """Return the derivatives of the impacts at these times."""
        own = self.resolved_impacts
        kept = [own[np.isin(own["t"], wanted)]]
        # each accumulation is passed impact by impact by a run that ends within it
        for zeno in self.trajectory.zeno_times[: len(self.zeno_times)]:
            before = own["t"][own["t"] < zeno]
            last = before[-1] if len(before) else self._problem.span[0]
            skipped = wanted[(wanted > last) & (wanted < zeno)]
            if len(skipped):
                run = self._problem.ending_within(float(skipped[-1]), float(zeno)).resolved_impacts
                kept.append(run[(run["t"] > last) & (run["t"] <= 0.5 * (skipped[-1] + zeno))])
                kept[-1] = kept[-1][: len(skipped)]
        return np.sort(np.concatenate(kept), order="t", kind="stable")

    def __repr__(self) -> str:
        names = ", ".join(self.wrt)
        return (
            f"<{type(self).__name__} by {names}: {self.status.name.lower()}, {self.trajectory!r}>"
        )

    def _table(self) -> ResultTable:
        """Describe the dataset: derivatives over ``wrt``."""
        values = {**self._values(), "state": ["x", "xdot"], "impact_time": self.impacts["t"]}
        title, attrs = "Derivatives of a run with impacts", {"status": self.status.name}
        return ResultTable(title, FIELDS, COORDS, values, attrs, rows="wrt")

    def _values(self) -> dict[str, Any]:
        """Return the values whose name in the dataset differs from the attribute."""
        return {
            "impact_dt": self.impacts["dt"],
            "impact_du": self.impacts["du"],
            "zeno_time": self.zeno_times,
            "liftoff_time": self.liftoff_times,
            "wrt": list(self.wrt),
        }
