"""The derivatives of a run: what they are, how they ended, how far they hold."""

from __future__ import annotations

import dataclasses
import enum
import functools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi import _zivi
from zivi._check import Array, real_array
from zivi._extras import needed
from zivi.trajectory import Trajectory

if TYPE_CHECKING:
    import xarray

    from zivi.sensitivity import _Problem


class OrbitStatus(enum.IntEnum):
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


KINDS = ("impact", "minimum", "zeno", "rest", "liftoff", "end", "stop", "chain")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Sensitivity:
    """A run and its derivatives.

    Calling it, ``s(t)``, gives the derivatives of ``(x, xdot)`` at any time of the run.

    Attributes
    ----------
    trajectory : Trajectory
        The run itself.
    wrt : tuple of str
        What the columns are derivatives by.
    final : ndarray
        Derivatives of ``(x, xdot)`` at the end of the run, at a fixed time, of shape (2, m).
    impacts : structured ndarray
        For each impact that was computed its time ``t`` (s), and the derivatives ``dt`` of the
        time and ``du`` of the speed after it, each of m numbers.
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
    impacts: NDArray[np.void]
    zeno_times: Array
    liftoff_times: Array
    radius: Array
    limits: list[Nearest | None]
    status: OrbitStatus
    n_slopes: int
    _problem: _Problem

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
        return self._problem.with_wrt(("x0", "xdot0")).solve().final

    def __call__(self, t: ArrayLike) -> Array:
        """Give the derivatives of the state at other times; computed on demand, by a run.

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

    def __repr__(self) -> str:
        names = ", ".join(self.wrt)
        return f"<Sensitivity by {names}: {self.status.name.lower()}, {self.trajectory!r}>"

    def to_xarray(self) -> xarray.Dataset:
        """Convert to a labelled dataset.

        Returns
        -------
        xarray.Dataset
            ``final``, ``impact_dt``, ``impact_du``, ``zeno_time``, ``liftoff_time`` and ``radius``
            over ``wrt``.
        """
        needed("xarray", "labelled datasets")
        import xarray

        return xarray.Dataset(
            {
                "final": (("state", "wrt"), self.final),
                "impact_dt": (("impact_time", "wrt"), self.impacts["dt"]),
                "impact_du": (("impact_time", "wrt"), self.impacts["du"]),
                "zeno_time": (("zeno", "wrt"), self.zeno_times),
                "liftoff_time": (("liftoff", "wrt"), self.liftoff_times),
                "radius": ("wrt", self.radius),
            },
            coords={
                "wrt": list(self.wrt),
                "state": ["x", "xdot"],
                "impact_time": ("impact_time", self.impacts["t"], {"units": "s"}),
            },
            attrs={
                "title": "Derivatives of a run with impacts",
                "source": f"zivi {_zivi.__version__}",
                "status": self.status.name,
            },
        )
