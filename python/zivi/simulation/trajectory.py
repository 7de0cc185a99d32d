"""The result of a run of a mass."""

from __future__ import annotations

import dataclasses
import functools
import operator
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, MaybeNone
from zivi.base.status import Status, warn
from zivi.base.table import Field, ResultTable
from zivi.simulation.dense import DenseMotion, LinearPath, PenetratingPath
from zivi.simulation.events import SLOWEST, impacts_of
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run_result import (
    EVENT_COORDS,
    EVENT_FIELDS,
    Closer,
    MassRun,
    Setup,
    between_steps,
    closer_mass,
    trust_note,
    trusted,
)
from zivi.system.impact_law import NewtonImpact, Restitutions
from zivi.system.table import Table, TableMotion, motion_of

if TYPE_CHECKING:
    from zivi.simulation.method_settings import Method
    from zivi.system.gap import HarmonicWall, MovingWall
    from zivi.system.mass import ImpactSystem

# Systems, forces and runs as plain values, which files and results keep.


def configuration_of(
    system: ImpactSystem, method: Method, span: tuple[float, float], state: tuple[float, float]
) -> dict[str, Any]:
    """Plain values that tell the run again (a callable only by its name)."""
    settings = method._values()  # type: ignore[attr-defined]
    return {
        **describe_system(system),
        "t_span": list(span),
        "y0": list(state),
        "method": {"name": type(method).__name__, **settings},
    }


def describe_system(system: ImpactSystem) -> dict[str, Any]:
    """Plain values that tell a system again."""
    law, newton = system.law, isinstance(system.law, NewtonImpact)
    return {
        "force": describe(system.force),
        "e": system.e if newton else law._described(),
        "kappa": system.kappa if newton else None,
        "wall": None if system.wall is None else describe(system.wall),
    }


def describe_restitutions(e: Restitutions) -> list[Any]:
    """Plain values that tell the coefficients or laws of gaps again."""
    return [law._described() for law in e] if isinstance(e, tuple) else e.tolist()


def describe(force: Any) -> Any:
    """Plain values that tell a force, a wall or a law again (a callable only by its name)."""
    if dataclasses.is_dataclass(force) and not isinstance(force, type):
        values = {field.name: getattr(force, field.name) for field in dataclasses.fields(force)}
        if values.get("excitation", 0) is None:
            del values["excitation"]
        plain = {name: describe(it) if callable(it) else it for name, it in values.items()}
        return {"name": type(force).__name__, **plain}
    if isinstance(force, Table):
        numbers = {"times": force.times.tolist(), "values": force.values.tolist()}
        return {"name": "Table", **numbers, "kind": force.kind, "extend": force.extend}
    if isinstance(force, int | float):
        return float(force)
    name = getattr(force, "__qualname__", None) or type(force).__qualname__
    return f"{getattr(force, '__module__', None) or '?'}.{name}"


# The result of a run.

QUANTITIES: dict[str, Field] = {
    "x": ("time", "m", "distance from the wall"),
    "xdot": ("time", "m/s", "velocity"),
    "s": ("time", "m", "transformed position"),
    "v": ("time", "m/s", "transformed velocity"),
    "lambda_s": ("time", "1", "multiplier of the sign of s"),
    "lambda_v": ("time", "1", "multiplier of the sign of v"),
    "residual": ("time", "1", "relative natural residual of the step"),
}
"""Unit and meaning of each sampled quantity, in the order of the record's rows after time."""
FIXED: dict[str, Field] = {
    "x_fixed": ("time", "m", "position in the fixed frame"),
    "xdot_fixed": ("time", "m/s", "velocity in the fixed frame"),
    "wall": ("time", "m", "position of the wall"),
}
"""The same for what a moving wall adds."""

NO_STOPS = np.empty(0)
"""No times at which a force jumps."""
NO_STOPS.flags.writeable = False


@dataclasses.dataclass(frozen=True, eq=False)
class Transformed:
    """The samples of a run in the coordinates of Zhuravlev and Ivanov, in which impacts are smooth.

    Attributes
    ----------
    s, v : ndarray
        Transformed position (m) and velocity (m/s), ``x = |s|``. `v` is not the velocity `xdot`.
    lambda_s, lambda_v : ndarray
        Multipliers in ``sgn s`` and ``sgn v`` of the step that ends at the sample.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> sol = zivi.simulate(ball, (0, 0.1), (1, 0), method=zivi.ThetaGamma(h=1e-3))
    >>> round(float(sol.xdot[-1] / sol.transformed.v[-1]), 6)  # 1 + kappa, with kappa = 1/3
    1.333333
    """

    s: Array
    v: Array
    lambda_s: Array
    lambda_v: Array


class FormerName:
    """A name of `Transformed` on a run, which readers could mistake for a physical quantity."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, run: Any, owner: type | None = None) -> Any:
        if run is None:
            return self
        instead = "; the velocity of the mass is xdot" if self._name == "v" else ""
        warn(
            f"the name {self._name} of a run is deprecated; use transformed.{self._name}{instead}",
            DeprecationWarning,
        )
        return getattr(run.transformed, self._name)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Trajectory(MassRun):
    """Samples and events of one run.

    Calling it, ``sol(t)``, gives ``(x, xdot)`` between the samples. The impacts are the table
    ``impacts`` with fields ``t`` (s), ``gap`` (0), ``speed_before`` and ``speed_after`` (m/s),
    ``impulse`` (of unit mass, m/s) and ``group`` (their number); accumulations are in ``zeno`` and
    lift-offs in ``liftoffs``, the same tables as in a `MechanicalTrajectory`.

    Attributes
    ----------
    t : ndarray
        Times of the samples (s); all sampled arrays have its length.
    x, xdot : ndarray
        Distance from the wall (m) and velocity (m/s); at the wall, the velocity after an impact.
    transformed : Transformed
        The samples in the coordinates in which impacts are smooth: position ``s`` (m) and velocity
        ``v`` (m/s), ``x = |s|``, with the multipliers ``lambda_s`` and ``lambda_v`` in ``sgn s``
        and ``sgn v`` of the step that ends at the sample; for the first sample the signs of the
        initial state. ``sol.s``, ``sol.v``, ``sol.lambda_s`` and ``sol.lambda_v`` are deprecated.
    residual : ndarray
        Natural residual of that step, its rows divided by the size of their terms, recomputed
        from the inclusion: at rounding level (1e-13 at most, where a degenerate case was taken)
        if the step is solved. For `e` below about 1e-2 the rounding of ``R``, which may be as
        small as `e`, shows: 3e-12 at ``e = 1e-6``. 0 at the first sample; NaN for methods
        that solve no inclusion.
    resolved_impacts : structured ndarray
        Fields ``t`` (s), ``xdot_before`` and ``xdot_after`` (m/s): the impacts that the steps
        resolve, however slow; those that a Zeno extrapolation skips are not among them.
    zeno_times : ndarray
        Times at which rest was reached through impacts (s): ``zeno["t"]`` by its name of
        version 0.1.
    liftoff_times : ndarray
        Times at which the mass left rest (s), the last instant at rest: ``liftoffs["t"]`` by its
        name of version 0.1.
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
        Reason of the end, with advice.
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
    slowest : float
        The slowest of ``impacts``, as a part of the fastest.
    config : dict
        System, method, span and initial state, as plain values.
    """

    _habits: ClassVar[str] = "run"

    t: Array
    x: Array
    xdot: Array
    transformed: Transformed
    residual: Array
    resolved_impacts: NDArray[np.void]
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
    slowest: float = SLOWEST
    # no class defaults: these are also created at first access
    _path: DenseMotion | None = dataclasses.field(repr=False, default_factory=lambda: None)
    _wall: HarmonicWall | MovingWall | TableMotion | None = dataclasses.field(
        repr=False, default_factory=lambda: None
    )
    _closer: Closer | None = dataclasses.field(repr=False, default_factory=lambda: None)

    s, v, lambda_s, lambda_v = FormerName(), FormerName(), FormerName(), FormerName()

    @functools.cached_property
    def config(self) -> dict[str, Any]:
        """System, method, span and initial state, as plain values."""
        return self._setup() if callable(self._setup) else self._setup

    def __getstate__(self) -> dict[str, Any]:
        # plain values can be copied and sent where a force cannot
        state = self._read_all() | {"_setup": self.config, "_closer": None}
        lifted = state.pop("transformed")
        return state | {name: getattr(lifted, name) for name in LIFTED}

    def __setstate__(self, state: dict[str, Any]) -> None:
        rest = {name: it for name, it in state.items() if name not in LIFTED}
        lifted = Transformed(*(state[name] for name in LIFTED))
        super().__setstate__(rest | {"transformed": lifted})

    @functools.cached_property
    def trusted_until(self) -> float:
        """Time up to which the run is near the motion, the end if all of it is (s).

        The tolerances bound the errors of steps; in a chaotic motion these grow until the run is
        another one. It is compared with a run at a hundredth of the tolerances, with restitution
        and initial state perturbed by some roundings: up to this time both agree in `x` to 300
        times the tolerance of `rtol` and `atol`. It is made when this is first asked for, takes
        about twice the time of the run, and calls its force again.

        Raises
        ------
        ValueError
            For a fixed-step method, and for a run that was loaded or sent to another process before
            the first access.

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
        *,
        drawn: bool = False,
    ) -> Self:
        """Make it of a record; `drawn` if samples between the steps shall draw the motion."""
        sol = object.__new__(cls)
        # fields are computed from the record at first access: batches make millions of short runs
        own = vars(sol)
        own["status"] = STATUSES[record.status]
        own["n_rejected"] = record.n_rejected
        own["_record"] = record
        own["_drawn"] = drawn
        own["_asked"] = (system, method, span, state, stops)
        return sol

    if not TYPE_CHECKING:  # which would take any name for granted

        def __getattr__(self, name):
            own = vars(self)
            record = own.get("_record")
            if record is None:
                return super().__getattr__(name)
            if name == "transformed" and own["_drawn"]:
                own[name] = Transformed(*record.drawn_lifted())
            elif name == "transformed":
                rows = record.columns[:, : record.n_samples]
                own[name] = Transformed(*(rows[QUANTITY_ROWS[it]] for it in LIFTED))
            elif name in ROWS and own["_drawn"]:
                own[name] = record.drawn(ROWS[name])
            elif name in ROWS:
                rows = record.columns[:, : record.n_samples]
                own.update((it, rows[row]) for it, row in ROWS.items())
            elif name in OF_RECORD:
                own[name] = OF_RECORD[name](record)
            elif name in OF_ARGUMENTS:
                own[name] = OF_ARGUMENTS[name](self, *own["_asked"])
            else:
                return super().__getattr__(name)
            return own[name]

    def _read_all(self) -> dict[str, Any]:
        """Return all attributes, read if they were not yet, without the record."""
        for field in dataclasses.fields(self):
            getattr(self, field.name)
        return {name: it for name, it in vars(self).items() if name not in UNREAD}

    def _end(self) -> float | None:
        record: _zivi.RunRecord | None = vars(self).get("_record")
        if record is None:
            return super()._end()
        # neither samples nor the motion are made of a long record for that
        _, end = (record.path and record.path.span) or (None, None)
        return record.last if end is None else end

    def _sample_kicks(self, times: Array) -> None:
        """Insert samples after kicks where samples draw the motion, as those after impacts."""
        x, xdot = self(times)
        *lifted, residual = between_steps(self, times)
        at, own = np.searchsorted(self.t, times, "right"), vars(self)
        of_time = {"t": times, "x": x, "xdot": xdot, "residual": residual}
        after = {name: np.insert(getattr(self, name), at, it) for name, it in of_time.items()}
        before = self.transformed
        pairs = zip(LIFTED, lifted, strict=True)
        inserted = (np.insert(getattr(before, name), at, it) for name, it in pairs)
        own["transformed"] = Transformed(*inserted)
        own.update(after)

    def _resampled(self, times: Array) -> Trajectory:
        x, xdot = self(times)
        *lifted, residual = between_steps(self, times)
        steps: dict[str, Any] = {"transformed": Transformed(*lifted), "residual": residual}
        return dataclasses.replace(self, t=times, x=x, xdot=xdot, **steps)

    def fixed(self, t: ArrayLike | None = None) -> tuple[Array, Array]:
        """Return the motion in the fixed frame, where a moving wall moves.

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
        span = f"{self.t[0]:.6g} .. {self.t[-1]:.6g} s" if len(self.t) else "no samples"
        steps = f"{self.n_steps} steps"
        if len(self.failed_steps):
            steps += f" ({len(self.failed_steps)} not solved by the chosen solver)"
        known = f"{span}, {steps}, {self._events_text()}{self._kicks_text()}{trust_note(self)}"
        return f"<Trajectory {known}: {self.status.name.lower()}>"

    def _facts(self) -> dict[str, str]:
        work = f"{self.n_steps} steps, {self.nfev} evaluations of the force"
        return {**self._wall_facts(), "work": work}

    def _table(self) -> ResultTable:
        values, fields = self._event_values(), QUANTITIES | EVENT_FIELDS
        values |= {name: getattr(self.transformed, name) for name in LIFTED}
        if self._wall is not None:
            values["x_fixed"], values["xdot_fixed"] = self.fixed()
            values["wall"], fields = self._wall(self.t)[0], fields | FIXED
        attrs = self._outcome() | {
            "n_steps": self.n_steps,
            "n_rejected": self.n_rejected,
            "n_failed_steps": len(self.failed_steps),
        }
        title = "Trajectory of a mechanical system with impacts"
        return ResultTable(title, fields, EVENT_COORDS, values, attrs)


STATUSES = {int(status): status for status in Status}
"""A call of the class takes longer."""
UNREAD = ("_record", "_drawn", "_asked")
"""What a run has of which its attributes are made."""
LIFTED = ("s", "v", "lambda_s", "lambda_v")
"""What follows from the state at a sample."""
QUANTITY_ROWS = {name: row for row, name in enumerate(("t", *QUANTITIES))}
ROWS = {name: row for name, row in QUANTITY_ROWS.items() if name not in LIFTED}
"""What a run samples, and where it is in the record."""


def _motion_path(
    sol: Trajectory, system: ImpactSystem, method: Method, *_: Any
) -> DenseMotion | _zivi.MotionPath | None:
    own: _zivi.MotionPath | None = vars(sol)["_record"].path
    if own is not None:
        return own
    samples = {"x": sol.x, "xdot": sol.xdot, **vars(sol.transformed)}
    made: DenseMotion = method._path(system.kappa, sol.t, samples)  # type: ignore[attr-defined]
    return made


def _mass_setup(
    sol: Trajectory,
    system: ImpactSystem,
    method: Method,
    span: tuple[float, float],
    state: tuple[float, float],
    *_: Any,
) -> Setup:
    return functools.partial(configuration_of, system, method, span, state)


def _mass_closer(
    sol: Trajectory,
    system: ImpactSystem,
    method: Method,
    span: tuple[float, float],
    state: tuple[float, float],
    stops: Array,
) -> Closer | None:
    if not isinstance(method, SwitchedRK):
        return None
    return functools.partial(closer_mass, system, method, span[0], state, stops)


def _moving_wall(sol: Trajectory, system: ImpactSystem, *_: Any) -> Any:
    return motion_of(system.wall)


def _event_states(record: _zivi.RunRecord) -> list[Array]:
    return [np.hstack([hits.q, hits.qdot]) for hits in record.hits]


OF_RECORD: dict[str, Callable[[_zivi.RunRecord], Any]] = {
    "resolved_impacts": impacts_of,
    "t_events": lambda record: [hits.t for hits in record.hits],
    "y_events": _event_states,
} | {
    name: operator.attrgetter(name)
    for name in (
        *("zeno_times", "liftoff_times", "rest_time", "failed_steps"),
        *("message", "nfev", "n_steps"),
    )
}
"""How the attributes of a run are read from its record."""
OF_ARGUMENTS: dict[str, Callable[..., Any]] = {
    "_setup": _mass_setup,
    "_path": _motion_path,
    "_wall": _moving_wall,
    "_closer": _mass_closer,
}
"""How those are made that follow from what was run."""


# Runs of fixed steps, reported otherwise than step by step: at given times, up to an event.


def restrict_run(sol: Trajectory, times: Array) -> Trajectory:
    """Report a run at `times` (those within the computed span) instead of at its steps."""
    return sol._resampled(times[times <= sol.t[-1]])


def end_run_at_event(sol: Trajectory) -> Trajectory:
    """End a fixed-step run at its last event, within its last step."""
    end = max(float(times[-1]) for times in sol.t_events if len(times))
    kept = restrict_run(sol, np.append(sol.t[sol.t < end], end))
    rests = sol.rest_time is not None and sol.rest_time <= end
    # a rest that ended later was one until here
    last = sol.zeno_times[sol.zeno_times <= end]
    gone = sol.liftoff_times[sol.liftoff_times <= end]
    if not rests and len(last) and not np.any(gone >= last[-1]):
        rest_time: float | None = float(last[-1])
    else:
        rest_time = sol.rest_time if rests else None
    return dataclasses.replace(
        kept,
        resolved_impacts=sol.resolved_impacts[sol.resolved_impacts["t"] <= end],
        zeno_times=last,
        liftoff_times=gone,
        rest_time=rest_time,
        failed_steps=sol.failed_steps[sol.failed_steps < len(kept.t)],
        n_steps=len(kept.t) - 1,
        _path=_path_until(sol._known(), kept),
    )


def _path_until(path: DenseMotion, kept: Trajectory) -> DenseMotion:
    """Return the path of a fixed-step run through the samples that are left of it."""
    changes: dict[str, Any] = {"t": kept.t, "s": kept.transformed.s, "v": kept.transformed.v}
    if isinstance(path, PenetratingPath):
        changes |= {"x": kept.x, "xdot": kept.xdot}
    assert isinstance(path, LinearPath)
    return dataclasses.replace(path, **changes)
