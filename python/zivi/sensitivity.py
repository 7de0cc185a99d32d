"""Derivatives of a run by its initial state, the coefficient of restitution and parameters."""

from __future__ import annotations

import dataclasses
import enum
import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi import _zivi
from zivi._check import Array, real_array
from zivi._compiled import listening
from zivi._extras import needed
from zivi._misplaced import told
from zivi._parameters import INITIAL, check_differentiable, codes_of, parameter
from zivi._progress import ProgressBar
from zivi.mechanics.system import MechanicalSystem
from zivi.methods import SwitchedRK
from zivi.simulate import as_raised, pair, stop_times, with_partial
from zivi.system import ImpactSystem
from zivi.trajectory import Trajectory

if TYPE_CHECKING:
    import xarray

    from zivi.mechanics.sensitivity import MechanicalSensitivity

__all__ = ["Nearest", "OrbitStatus", "Sensitivity", "sensitivity"]


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
DEFAULT = SwitchedRK()


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


@dataclasses.dataclass(frozen=True, eq=False)
class _Problem:
    """What is differentiated by what."""

    system: ImpactSystem
    span: tuple[float, float]
    state: tuple[float, float]
    wrt: tuple[str, ...]
    method: SwitchedRK
    errsens: bool
    stops: Array
    codes: list[int]
    sizes: Array

    @classmethod
    def of(
        cls,
        system: ImpactSystem,
        span: tuple[float, float],
        state: tuple[float, float],
        wrt: tuple[str, ...],
        method: SwitchedRK,
        errsens: bool,
        stops: Array,
    ) -> _Problem:
        codes = codes_of(system, wrt)
        starts = {"x0": state[0], "xdot0": state[1], "t0": span[1] - span[0]}
        values = [starts[name] if name in INITIAL else parameter(system, name) for name in wrt]
        sizes = np.array([abs(value) or 1.0 for value in values])
        return cls(system, span, state, wrt, method, errsens, stops, codes, sizes)

    def with_wrt(self, wrt: tuple[str, ...]) -> _Problem:
        system, span, state, method = self.system, self.span, self.state, self.method
        return _Problem.of(system, span, state, wrt, method, self.errsens, self.stops)

    def record(
        self, span: tuple[float, float], times: Array, dense: bool, progress: bool | None = False
    ) -> _zivi.SensitivityRecord:
        with ProgressBar(progress, "sensitivity") as bar:
            return _zivi.sensitivity(
                self.system._core,
                self.method._core,
                span,
                _zivi.State(*self.state),
                wrt=self.codes,
                sizes=self.sizes,
                controlled=self.errsens,
                dense=dense,
                drawn=dense,
                tstops=self.stops,
                times=times,
                progress=bar.report,
            )

    def solve(self, dense: bool = False, progress: bool | None = False) -> Sensitivity:
        with listening([self.system._spec]) as ear:
            record = self.record(self.span, np.empty(0), dense, progress)
        run = record.run
        sol = Trajectory._from_record(run, self.system, self.method, self.span, self.state)
        error = run.raised
        if error is None and (error := ear.ends(sol.success)):
            sol = as_raised(sol)
        if error is not None:
            raise with_partial(error, sol)
        return self._result(record, sol)

    def _result(self, record: _zivi.SensitivityRecord, sol: Trajectory) -> Sensitivity:
        m = len(self.wrt)
        dt, du = record.impact_dt.reshape(-1, m), record.impact_du.reshape(-1, m)
        # of a run that ended early the last event may lack its derivatives
        n = min(len(dt), len(sol.impacts))
        impacts = np.empty(n, [("t", "f8"), ("dt", "f8", (m,)), ("du", "f8", (m,))])
        impacts["t"], impacts["dt"], impacts["du"] = sol.impacts["t"][:n], dt[:n], du[:n]
        limits = [it and Nearest(KINDS[it.limit], it.t, it.depth) for it in record.nearest]
        status = OrbitStatus.GRAZING if record.grazing else OrbitStatus.COMPLETED
        return Sensitivity(
            trajectory=sol,
            wrt=self.wrt,
            final=np.stack([record.x, record.xdot]),
            impacts=impacts,
            zeno_times=record.zeno_times.reshape(-1, m),
            liftoff_times=record.liftoff_times.reshape(-1, m),
            radius=record.radius,
            limits=limits,
            status=status if sol.success else OrbitStatus.RUN_ENDED,
            n_slopes=record.n_slopes,
            _problem=self,
        )

    def at(self, times: Array) -> Array:
        """Give derivatives at times, of shape (2, m, n)."""
        m = len(self.wrt)
        record = self.record(self.span, times, dense=False)
        columns = record.samples.reshape(len(times), 2, m).transpose(1, 2, 0).copy()
        for k in np.flatnonzero(np.isnan(columns).any(axis=(0, 1))):
            # where the impacts accumulate the run goes from one to the next, up to there
            columns[:, :, k] = self._ending_at(float(times[k]))
        return columns

    def _ending_at(self, t: float) -> Array:
        record = self.record((self.span[0], t), np.empty(0), dense=False)
        return np.stack([record.x, record.xdot])


@overload
def sensitivity(
    system: MechanicalSystem,
    t_span: Sequence[float],
    y0: Any,
    wrt: Sequence[str] | None = None,
    method: SwitchedRK = DEFAULT,
    *,
    errsens: bool = True,
    dense_output: bool = True,
    tstops: ArrayLike | None = None,
    progress: bool | None = None,
) -> MechanicalSensitivity: ...


@overload
def sensitivity(
    system: ImpactSystem,
    t_span: Sequence[float],
    y0: ArrayLike,
    wrt: Sequence[str] | None = None,
    method: SwitchedRK = DEFAULT,
    *,
    errsens: bool = True,
    dense_output: bool = True,
    tstops: ArrayLike | None = None,
    progress: bool | None = None,
) -> Sensitivity: ...


def sensitivity(
    system: ImpactSystem | MechanicalSystem,
    t_span: Sequence[float],
    y0: Any,
    wrt: Sequence[str] | None = None,
    method: SwitchedRK = DEFAULT,
    *,
    errsens: bool = True,
    dense_output: bool = True,
    tstops: ArrayLike | None = None,
    progress: bool | None = None,
) -> Sensitivity:
    r"""Simulate a system with the derivatives of the run, through impacts and Zeno points.

    The variational equations are solved in the steps of the run. At an impact

    .. math::

        dt &= -\frac{X^-}{\dot x^-}, \qquad dv^- = V^- + a^- dt, \qquad
        du = -e\,dv^- - \dot x^-\,de \\
        X^+ &= -u\,dt, \qquad V^+ = du - a^+ dt

    (the saltation matrix, with :math:`X = dx/dq`, :math:`V = d\dot x/dq`), a Zeno time has the
    derivative of its extrapolation, rest ends all columns and a lift-off starts them anew.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        The force and the wall. The force is a number, a `LinearForce`, a `ParametricForce`, or any
        callable, whose derivatives by time and state are central differences then. Of a
        `MechanicalSystem` the derivatives are those that SymPy derives (`zivi.symbolic.system`), or
        central differences.
    t_span : (float, float)
        Start and end (s).
    y0 : (float, float)
        Initial distance from the wall (m) and velocity (m/s); of a `MechanicalSystem`
        ``(q0, qdot0)``.
    wrt : sequence of str, optional
        Names of the columns: ``"x0"``, ``"xdot0"``, ``"t0"`` (the start moves, the end does
        not), ``"e"``, the fields of `LinearForce` or the parameters of a `ParametricForce`,
        ``"force"`` for a number, those of a `HarmonicWall` as ``"wall.amplitude"``. Of a
        `MechanicalSystem` ``"q0"`` and ``"qdot0"`` (all coordinates), ``"q0.x"`` or ``"q0[0]"``
        (one), ``"t0"``, ``"e"`` (of all gaps together), ``"e.floor"`` or ``"e[0]"`` (of one), the
        names of its parameters. By default the initial state.
    method : SwitchedRK
        Tolerances and order.
    errsens : bool
        Whether the steps are adapted to the errors of the columns too (their absolute tolerances
        are those of the state divided by the size of the parameter).
    dense_output : bool
        Whether the trajectory keeps the motion between its samples.
    tstops : array_like, optional
        Times where the force, or one of its derivatives, jumps (s), as in `simulate`. They are
        fixed: what moves them is not differentiated by.
    progress : bool, optional
        Show a progress bar once a run lasts longer than a second; by default on a terminal only.

    Returns
    -------
    Sensitivity
        The run and its derivatives; of a `MechanicalSystem` a `MechanicalSensitivity`.

    Raises
    ------
    ValueError
        For a name that is no parameter here: the error lists those that are.
    TypeError
        For another method than `SwitchedRK`.
    Exception
        Whatever the force raises.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> s = zivi.sensitivity(ball, (0, 3), (1, 0), wrt=("x0", "e", "force"))
    >>> s.zeno_times.round(6)  # of sqrt(2 x0/g) (1 + e)/(1 - e)
    array([[0.677285, 3.612189, 0.06904 ]])
    """
    mechanical = isinstance(system, MechanicalSystem)
    if not mechanical:
        check_differentiable(system)
    if not isinstance(method, SwitchedRK):
        raise TypeError(f"sensitivity needs method=zivi.SwitchedRK(...), got {told(method)}")
    span = pair("t_span", t_span, "(t0, t1)")
    for name, value in (("errsens", errsens), ("dense_output", dense_output)):
        if not isinstance(value, bool):
            raise TypeError(f"{name} must be True or False, got {value!r}")
    stops = stop_times(tstops, method)
    if wrt is None:
        wrt = ("q0", "qdot0") if mechanical else ("x0", "xdot0")
    names = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    if not names or len(set(names)) != len(names):
        raise ValueError(f"wrt must be one or more different names, got {names!r}")
    if isinstance(system, MechanicalSystem):
        from zivi.mechanics.sensitivity import differentiate_mechanical

        return differentiate_mechanical(
            system,
            span,
            y0,
            names,
            method,
            errsens=errsens,
            stops=stops,
            dense=dense_output,
            progress=progress,
        )
    state = pair("y0", y0, "(x0, xdot0)")
    problem = _Problem.of(system, span, state, names, method, errsens, stops)
    return problem.solve(dense_output, progress)
