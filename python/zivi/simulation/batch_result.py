"""Arguments and results of batches of runs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, MaybeNone, integer, real_array
from zivi.base.status import Status
from zivi.base.table import Field, ResultTable, Tabulated
from zivi.simulation.method_settings import Method
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import stop_times, times_within
from zivi.system.mass import ImpactSystem, coefficients
from zivi.system.mechanism import MechanicalSystem, as_mechanism
from zivi.system.parameters import parameter, parameters_of
from zivi.system.table import Table

# Arguments of a batch, checked and converted.

MAX_THREADS = 1024


def systems_of(systems: Any) -> list[ImpactSystem]:
    """Return the systems as a list; each must do without the interpreter."""
    try:
        several = [systems] if isinstance(systems, ImpactSystem) else list(systems)
    except TypeError:
        several = [systems]
    for i, system in enumerate(several):
        if not isinstance(system, ImpactSystem):
            kind = type(system).__name__
            raise TypeError(f"systems must be zivi.ImpactSystem, got {kind} (number {i})")
        if isinstance(system.wall, Table):
            raise TypeError(
                f"the wall of system {i} must not be a zivi.Table in a batch, got {system.wall!r}: "
                "use zivi.simulate, or a zivi.LinearGap(motion=) in a batch of LinearSystems"
            )
        check_native(system._spec, f"the force of system {i}")
    if not several:
        raise ValueError("systems must hold at least one system")
    return several


def check_native(spec: _zivi.Force, what: str) -> None:
    """Reject a force that needs the interpreter."""
    if not spec.is_native:
        raise ValueError(
            f"{what} needs the interpreter: a batch takes numbers, LinearForce and compiled "
            "callables (numba cfunc, scipy.LowLevelCallable); zivi.sweep runs any function"
        )


def check_threads(threads: int | None) -> int:
    """Return the number of threads, by default the number of cores."""
    workers = _zivi.available_threads() if threads is None else integer("threads", threads)
    if not 1 <= workers <= MAX_THREADS:
        raise ValueError(f"threads must be from 1 to {MAX_THREADS}, got {workers}")
    return workers


def threads_for(systems: Iterable[MechanicalSystem], threads: int) -> int:
    """Return the number of threads on which the systems may be evaluated."""
    return threads if all(system.reentrant for system in systems) else 1


def stops_of(
    systems: Sequence[ImpactSystem] | Sequence[MechanicalSystem],
    tstops: ArrayLike | None,
    method: Method,
    span: tuple[float, float],
) -> list[Array]:
    """Return the declared breaks of each system; those of many under one table are one array."""
    known: dict[bytes, Array] = {}
    several = (stop_times(tstops, method, system, span) for system in systems)
    return [known.setdefault(stops.tobytes(), stops) for stops in several]


def with_friction(
    systems: ImpactSystem | Sequence[ImpactSystem], y0: Any
) -> tuple[list[MechanicalSystem], list[Array]]:
    """Return masses with friction as mechanical systems, and their states."""
    several = [systems] if isinstance(systems, ImpactSystem) else list(systems)
    for i, system in enumerate(several):
        if not isinstance(system, ImpactSystem) or system.friction is None:
            raise TypeError(
                "systems must all be zivi.ImpactSystem with friction, as the first is, got "
                f"{system!r} (number {i})"
            )
    states = states_for(y0, len(several))
    return [as_mechanism(system) for system in several], np.split(states, 2, axis=1)


def state_rows(name: str, value: ArrayLike) -> Array:
    """Return states as rows."""
    rows = np.atleast_2d(real_array(name, value))
    if rows.ndim != 2 or rows.shape[1] != 2:
        raise ValueError(f"{name} must have shape (n, 2) or (2,), got {np.shape(value)}")
    return rows


def states_for(y0: ArrayLike, n_systems: int) -> Array:
    """Return the initial states of the runs of some systems as rows."""
    states = state_rows("y0", y0)
    if len(states) == 1:
        states = np.tile(states, (n_systems, 1))
    if n_systems not in (1, len(states)):
        raise ValueError(
            f"y0 must have a row for each of the {n_systems} systems, got {len(states)}"
        )
    return np.ascontiguousarray(states)


def values_by_run(parameters: Any, system: Any, y0: Any) -> dict[str, Array]:
    """Return the parameters that are given, as arrays with a value for each run.

    Parameters
    ----------
    parameters : dict of str to array_like or None
        Values by name: a number, or one for each run.
    system
        The system, of which there must be one.
    y0 : array_like
        Initial states of as many runs, or of one for all.

    Raises
    ------
    TypeError, ValueError
        If there are several systems, a name is unknown, or an array has another shape.
    """
    if parameters is None:
        return {}
    if not isinstance(parameters, Mapping):
        raise TypeError(f"parameters must be a dict of names and arrays, got {parameters!r}")
    if not isinstance(system, ImpactSystem | MechanicalSystem):
        got = "a function; zivi.sweep calls functions" if callable(system) else "several systems"
        raise ValueError(f"parameters need one system for all runs, got {got}")
    given = {str(name): _checked_values(str(name), values) for name, values in parameters.items()}
    # what else is wrong with y0 is said where it is read
    pair = tuple(y0) if isinstance(y0, Iterable) else ()
    several = (y0,) if isinstance(system, ImpactSystem) else pair
    sizes = {"y0": max((len(it) if np.ndim(it) > 1 else 1 for it in several), default=1)}
    sizes |= {f"parameters[{name!r}]": it.size for name, it in given.items() if it.ndim}
    n = max(sizes.values())
    for name, size in sizes.items():
        if size != n and not (name == "y0" and size == 1):
            raise ValueError(f"{name} must have one value or row for each of {n} runs, got {size}")
    return {name: np.array(np.broadcast_to(it, n), dtype=np.float64) for name, it in given.items()}


def _checked_values(name: str, given: Any) -> Array:
    if name in ("x0", "xdot0", "q0", "qdot0", "t0"):
        raise ValueError(f"parameters: {name!r} is set by y0 or t_span")
    values = real_array(f"parameters[{name!r}]", given)
    if values.ndim > 1:
        raise ValueError(
            f"parameters[{name!r}] must be a number or have shape (n,), got shape {values.shape}"
        )
    rows = np.atleast_1d(values)
    valid = (rows >= 0) & (rows <= 1) if name == "e" else np.isfinite(rows)
    if not np.all(valid):
        run = int(np.argmin(valid))
        range_ = "in [0, 1]" if name == "e" else "finite"
        raise ValueError(f"parameters[{name!r}] must be {range_}, got {rows[run]:.6g} in run {run}")
    return values


def native_columns(
    system: Any, columns: Mapping[str, Array]
) -> list[tuple[int | None, Array]] | None:
    """Return columns as the extension takes them, by the index of the parameter, None for ``e``.

    It is None where only `replaced` systems have such values.
    """
    if not isinstance(system, ImpactSystem) or system.friction is not None:
        return None
    indices = {name: index for index, name in enumerate(parameters_of(system))}
    for name in columns:
        parameter(system, name)  # which refuses an unknown name
        if name.startswith("law."):
            return None
    return [(indices.get(name), values) for name, values in columns.items()]


def replaced(system: Any, columns: Mapping[str, Array]) -> list[Any]:
    """Return a system for each run, with its values of the parameters."""
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    made = []
    for i, row in enumerate(rows):
        try:
            made.append(system.replace(**dict(zip(columns, row, strict=True))))
        except KeyError as error:
            raise ValueError(f"parameters: {error.args[0]}") from None
        except ValueError as error:
            raise ValueError(f"parameters of run {i}: {error}") from None
    return made


def every_of(save: Any, names: Sequence[str]) -> int | None:
    """Return the number of samples from one that is saved to the next, None for one of `names`."""
    if isinstance(save, str):
        if save not in names:
            told = " or ".join(repr(name) for name in names)
            told = told if len(names) == 1 else f"one of {told.replace(' or ', ', ')}"
            raise ValueError(f"save must be {told} or a number of samples >= 1, got {save!r}")
        return None
    every = integer("save", save)
    if every < 1:
        raise ValueError(f"save must be a number of samples >= 1, got {every}")
    return every


def kept_times(
    t_eval: Any, save: Any, span: tuple[float, float], beside: Sequence[str] = ("final",)
) -> Array:
    """Return the times at which states are kept, which not all of `save` allow."""
    if save not in beside:
        told = " or ".join(repr(name) for name in beside)
        raise ValueError(f"t_eval goes with save={told} only, got save={save!r}")
    return times_within(t_eval, span)


def room_for(quantities: int, n: int, times: int, *more: int) -> Array:
    """Make room for quantities of `n` runs at some times, all NaN."""
    try:
        return np.full((quantities, n, times, *more), np.nan)
    except (MemoryError, ValueError):
        size = 8e-9 * quantities * n * times * math.prod(more)
        raise MemoryError(
            f"y0 has {n} runs, t_eval {times} samples of each: {size:.3f} GB do not fit into "
            "memory; use fewer times, or fewer runs at a time"
        ) from None


# Results of a batch: numbers and samples of each run.

MAX_DESCRIBED = 100
"""Systems, and states, that are told in ``config``."""

NUMBERS: dict[str, Field] = {
    "t": ("run", "s", "time of the last sample"),
    "x": ("run", "m", "last distance from the wall"),
    "xdot": ("run", "m/s", "last velocity"),
    "rest_time": ("run", "s", "time from which the mass rests, NaN if it does not"),
    "first_impact": ("run", "s", "time of the first impact, NaN without one"),
    "last_impact": ("run", "s", "time of the last impact, NaN without one"),
    "hardest_impact": ("run", "m/s", "largest speed before an impact"),
    "n_impacts": ("run", "1", "number of impacts"),
    "n_zeno": ("run", "1", "number of Zeno points"),
    "n_liftoffs": ("run", "1", "number of lift-offs"),
    "status": ("run", "1", "how the run ended, a zivi.Status"),
    "nfev": ("run", "1", "evaluations of the force"),
}
"""Dimensions, unit and meaning of what every batch has for each run."""
EXTREMES: dict[str, Field] = {
    "x_max": ("run", "m", "largest sampled distance from the wall"),
    "speed_max": ("run", "m/s", "largest sampled speed"),
}
"""The same for what only ``save="statistics"`` has."""
SAMPLES: dict[str, Field] = {
    "sample_x": (("run", "time"), "m", "samples"),
    "sample_xdot": (("run", "time"), "m/s", "samples"),
}
"""The same for samples."""


class BatchRuns(Tabulated):
    """Base class of batches."""

    if TYPE_CHECKING:
        status: NDArray[np.uint8]
        rest_time: Array

    _called = "runs"
    parameters: Any = MappingProxyType({})

    def __len__(self) -> int:
        return len(self.status)

    @property
    def success(self) -> NDArray[np.bool_]:
        """Which runs reached the end of the span."""
        return np.equal(self.status, Status.COMPLETED)

    def __repr__(self) -> str:
        done, rests = int(np.sum(self.success)), int(np.sum(~np.isnan(self.rest_time)))
        counted = f"{len(self)} {self._called}: {done} completed, {rests} at rest"
        for number, count in zip(*np.unique(self.status, return_counts=True), strict=True):
            if number != Status.COMPLETED:
                counted += f", {count} {Status(int(number)).name.lower()}"
        if more := self._counted():
            counted += f"; {more}"
        return f"<{type(self).__name__} of {counted}>"

    def _varied(self) -> dict[str, Field]:
        """Declare the parameters that differ from run to run."""
        return {name: ("run", "", f"parameter {name}") for name in self.parameters}

    def _counted(self) -> str:
        """Describe other failures of the runs; "" if there are none."""
        return ""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Batch(BatchRuns):
    """Results of a batch: an entry for each run.

    In all batches a plain name is the value at the end of each run, ``sample_`` its samples.

    Attributes
    ----------
    t, x, xdot : ndarray
        Time (s), distance from the wall (m) and velocity (m/s) at the end of each run.
    rest_time : ndarray
        Time from which the mass rests until the end (s), NaN if it does not.
    first_impact, last_impact : ndarray
        Times of the first and of the last impact (s), NaN without one.
    hardest_impact : ndarray
        Largest speed before an impact (m/s), 0 without one.
    n_impacts, n_zeno, n_liftoffs : ndarray of int
        Numbers of impacts (down to the part `slowest` of the fastest of the run, whether they were
        computed or skipped by a Zeno extrapolation), of Zeno points and of lift-offs.
    n_resolved, last_resolved : ndarray or None
        Number of the impacts that were resolved, and the time of the last of them (s).
    status : ndarray of uint8
        How each run ended, the numbers of `Status`.
    nfev : ndarray of int
        Evaluations of the force.
    x_max, speed_max : ndarray or None
        Largest sampled distance (m) and speed (m/s), with ``save="statistics"``.
    grazing : ndarray of bool or None
        With ``save="grazing"``: whether the run passed a grazing, an impact or the want of one that
        its tolerances decided.
    events : list or None
        With ``save="events"``: for each run a dict with the tables ``impacts``, ``zeno``,
        ``liftoffs`` and ``resolved_impacts`` of a `Trajectory`, and ``zeno_times`` and
        ``liftoff_times``, their names of version 0.1.
    sample_t : ndarray or None
        With ``save=k`` or ``t_eval``: the times of the samples (s).
    sample_x, sample_xdot : ndarray or None
        The samples, a row for each run; NaN after the end of a run that ended early.
    config : dict
        Settings of the batch, as plain values: systems and initial states of the first 100.
    parameters : dict of str to ndarray
        The values of the argument `parameters`, of shape (n,) each, by name.
    """

    t: Array
    x: Array
    xdot: Array
    rest_time: Array
    first_impact: Array
    last_impact: Array
    hardest_impact: Array
    n_impacts: NDArray[np.uint64]
    n_zeno: NDArray[np.uint64]
    n_liftoffs: NDArray[np.uint64]
    status: NDArray[np.uint8]
    nfev: NDArray[np.uint64]
    x_max: Array | MaybeNone
    speed_max: Array | MaybeNone
    grazing: NDArray[np.bool_] | MaybeNone
    events: list[dict[str, Any]] | MaybeNone
    sample_t: Array | MaybeNone
    sample_x: Array | MaybeNone
    sample_xdot: Array | MaybeNone
    config: dict[str, Any]
    n_resolved: NDArray[np.uint64] | MaybeNone = None
    last_resolved: Array | MaybeNone = None
    parameters: dict[str, Array] = dataclasses.field(default_factory=dict)

    def _table(self) -> ResultTable:
        """Describe the dataset: numbers over ``run``, samples over ``time``, events per run."""
        fields = NUMBERS | (EXTREMES if self.x_max is not None else {}) | self._varied()
        coords: dict[str, Field] = {"run": ("run", "", "number of the run")}
        if self.sample_t is not None:
            fields, coords = fields | SAMPLES, coords | {"time": ("time", "s", "time")}
        values = {"run": np.arange(len(self)), "time": self.sample_t} | self.parameters
        return ResultTable(
            "Batch of runs of mechanical systems with impacts", fields, coords, values
        )


# The states of the runs of a batch at given times.


@dataclasses.dataclass(frozen=True)
class Sampling:
    """The times at which states are kept, and how they come about.

    Parameters
    ----------
    times : ndarray or None
        The times (s).
    at : ndarray or None
        The same, if the method samples its dense output there.
    knots : ndarray or None
        Else the ends of the steps between which the times are (s).
    steps : ndarray of int or None
        The numbers of these.
    rows : ndarray or None
        Room for the distances and for the velocities of all runs, of shape (2, runs, times), NaN.
    """

    times: Array | None = None
    at: Array | None = None
    knots: Array | None = None
    steps: NDArray[np.intp] | None = None
    rows: Array | None = None


def sampling_of(t_eval: Any, save: Any, span: tuple[float, float], method: Any, n: int) -> Sampling:
    """Find what is to be kept for the states at given times."""
    if t_eval is None:
        return Sampling()
    times = kept_times(t_eval, save, span, ("final", "events"))
    rows = room_for(2, n, len(times))
    if isinstance(method, SwitchedRK):
        return Sampling(times, at=times, rows=rows)
    t = _zivi.grid_times(*span, method.h, 1)
    after = np.searchsorted(t, times, side="right")
    steps = np.unique(np.concatenate([after - 1, np.minimum(after, len(t) - 1)]))
    return Sampling(times, knots=t[steps], steps=steps, rows=rows)


def sampled(
    batch: Batch, record: _zivi.BatchRecord, systems: list[ImpactSystem], method: Any, how: Sampling
) -> Batch:
    """Attach to the batch the states at the times of `how`, NaN after the end of each run."""
    own_e = batch.parameters.get("e")
    assert how.times is not None
    assert how.rows is not None
    x, xdot = how.rows
    if how.knots is None:
        width = record.samples_x.shape[1]  # less where all runs ended early
        x[:, :width], xdot[:, :width] = record.samples_x, record.samples_xdot
        return dataclasses.replace(batch, sample_t=how.times, sample_x=x, sample_xdot=xdot)
    names = ("x", "xdot", "s", "v")
    kept = (record.samples_x, record.samples_xdot, record.samples_s, record.samples_v)
    known = np.searchsorted(how.times, batch.t, side="right")
    reached = np.searchsorted(how.knots, batch.t, side="right")
    for i, (n, end) in enumerate(zip(known, reached, strict=True)):
        samples = {name: rows[i, :end] for name, rows in zip(names, kept, strict=True)}
        system = systems[i if len(systems) > 1 else 0]
        kappa = system.kappa if own_e is None else coefficients(float(own_e[i]), None)[1]
        path = method._path(kappa, how.knots[:end], samples)
        if n:
            x[i, :n], xdot[i, :n] = path.physical(how.times[:n])
    return dataclasses.replace(batch, sample_t=how.times, sample_x=x, sample_xdot=xdot)
