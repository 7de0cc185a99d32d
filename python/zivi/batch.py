"""Many runs at once, on all cores: arrays of parameters and of initial states."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi import _zivi
from zivi._batch_arguments import check_threads, every_of, states_of, systems_of
from zivi._batch_samples import sampled, sampling_of
from zivi._check import Array
from zivi._compiled import listening, tell
from zivi._describe import describe, describe_system
from zivi._extras import needed
from zivi._impacts import IMPACT
from zivi._json import text_of
from zivi._misplaced import check_method
from zivi._progress import ProgressBar
from zivi.mechanics.batch import MechanicalBatch, mechanical_batch
from zivi.mechanics.system import MechanicalSystem
from zivi.methods import Method
from zivi.simulate import DEFAULT_METHOD, pair, times_within
from zivi.status import Status
from zivi.system import ImpactSystem

if TYPE_CHECKING:
    import xarray

__all__ = ["Batch", "simulate_batch"]

"""What can be saved of each run, beside a number of samples."""

NUMBERS = {
    "t": ("s", "time of the last sample"),
    "x": ("m", "last distance from the wall"),
    "xdot": ("m/s", "last velocity"),
    "rest_time": ("s", "time from which the mass rests, NaN if it does not"),
    "first_impact": ("s", "time of the first impact, NaN without one"),
    "last_impact": ("s", "time of the last impact, NaN without one"),
    "hardest_impact": ("m/s", "largest speed before an impact"),
    "n_impacts": ("1", "number of impacts that were resolved"),
    "n_zeno": ("1", "number of Zeno points"),
    "n_liftoffs": ("1", "number of lift-offs"),
    "status": ("1", "how the run ended, a zivi.Status"),
    "nfev": ("1", "evaluations of the force"),
}
"""Unit and meaning of what every batch has for each run."""
EXTREMES = {
    "x_max": ("m", "largest sampled distance from the wall"),
    "speed_max": ("m/s", "largest sampled speed"),
}
"""The same for what only ``save="statistics"`` has."""


class Runs:
    """What all batches have."""

    if TYPE_CHECKING:
        status: NDArray[np.uint8]
        rest_time: Array

    _called = "runs"

    def __len__(self) -> int:
        return len(self.status)

    @property
    def success(self) -> NDArray[np.bool_]:
        """Which runs reached the end of the span."""
        return np.equal(self.status, Status.COMPLETED)

    def __repr__(self) -> str:
        done, rests = int(np.sum(self.success)), int(np.sum(~np.isnan(self.rest_time)))
        counted = f"{len(self)} {self._called}: {done} completed, {rests} at rest"
        return f"<{type(self).__name__} of {counted}>"


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Batch(Runs):
    """Results of a batch: an entry for each run.

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
        Numbers of impacts that were resolved, of Zeno points and of lift-offs.
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
        With ``save="events"``: for each run a dict with ``impacts`` (structured as those of a
        `Trajectory`), ``zeno_times`` and ``liftoff_times``.
    sample_t : ndarray or None
        With ``save=k`` or ``t_eval``: the times of the samples (s).
    sample_x, sample_xdot : ndarray or None
        The samples, a row for each run; NaN after the end of a run that ended early.
    config : dict
        Settings of the batch, as plain values: systems and initial states of the first 100.
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
    x_max: Array | None
    speed_max: Array | None
    grazing: NDArray[np.bool_] | None
    events: list[dict[str, Any]] | None
    sample_t: Array | None
    sample_x: Array | None
    sample_xdot: Array | None
    config: dict[str, Any]

    def to_xarray(self) -> xarray.Dataset:
        """Convert to a labelled dataset over ``run`` (and ``time`` for samples).

        Returns
        -------
        xarray.Dataset
            With units, descriptions and the configuration (JSON) in the attributes. Events, which
            differ in number from run to run, are not in it.
        """
        needed("xarray", "labelled datasets")
        import xarray

        def labelled(dims: Any, values: Any, unit: str, meaning: str) -> Any:
            return dims, values, {"units": unit, "long_name": meaning}

        shown = NUMBERS | (EXTREMES if self.x_max is not None else {})
        variables = {
            name: labelled("run", getattr(self, name), unit, meaning)
            for name, (unit, meaning) in shown.items()
        }
        coords: dict[str, Any] = {"run": np.arange(len(self))}
        if self.sample_t is not None:
            coords["time"] = labelled("time", self.sample_t, "s", "time")
            for name, unit in (("sample_x", "m"), ("sample_xdot", "m/s")):
                values = getattr(self, name)
                variables[name] = labelled(("run", "time"), values, unit, "samples")
        attrs = {
            "title": "Batch of runs of mechanical systems with impacts",
            "source": f"zivi {_zivi.__version__}",
            "config": text_of(self.config),
        }
        return xarray.Dataset(variables, coords=coords, attrs=attrs)


@overload
def simulate_batch(
    systems: MechanicalSystem | Sequence[MechanicalSystem],
    t_span: Sequence[float],
    y0: Any,
    *,
    method: Method = ...,
    t_eval: ArrayLike | None = ...,
    save: str | int = ...,
    threads: int | None = ...,
    progress: bool | None = ...,
) -> MechanicalBatch: ...


@overload
def simulate_batch(
    systems: ImpactSystem | Sequence[ImpactSystem],
    t_span: Sequence[float],
    y0: ArrayLike,
    *,
    method: Method = ...,
    t_eval: ArrayLike | None = ...,
    save: str | int = ...,
    threads: int | None = ...,
    progress: bool | None = ...,
) -> Batch: ...


def simulate_batch(
    systems: Any,
    t_span: Sequence[float],
    y0: Any,
    *,
    method: Method = DEFAULT_METHOD,
    t_eval: ArrayLike | None = None,
    save: str | int = "final",
    threads: int | None = None,
    progress: bool | None = None,
) -> Batch | MechanicalBatch:
    """Simulate many independent runs, on all cores and without the interpreter.

    The results do not depend on the number of threads, and each run gives what `simulate` gives
    for it, to the last bit. Memory is what is saved, and a record of one run for each thread.

    Parameters
    ----------
    systems : ImpactSystem or sequence of ImpactSystem, or of MechanicalSystem
        One for all runs, or one for each. Forces must not need the interpreter: numbers,
        `LinearForce` and compiled callables do not. A `MechanicalSystem` may; those of
        `zivi.symbolic`, which do not, run side by side.
    t_span : (float, float)
        Start and end (s), the same for all.
    y0 : array_like
        Initial states, shape (n, 2), or (2,) for all systems. Of mechanical systems
        ``(q0, qdot0)``, each with a row for each run or one for all.
    method : SwitchedRK, ThetaGamma, MoreauJean or ExplicitEuler
        The method, by default and for mechanical systems `SwitchedRK`. Under constant forces
        `ThetaGamma` moves many masses side by side.
    t_eval : array_like, optional
        Increasing times in `t_span` (s) at which the states of all runs are kept beside their ends,
        as those that `simulate` gives: with `SwitchedRK` from its dense output, each time once;
        with a method of fixed steps between its steps, then also `ThetaGamma` goes run by run. Of
        an `ImpactSystem` not with another `save`.
    save : {"final", "statistics", "events", "grazing"} or int
        What is kept of each run: its end; its end and the extremes of its samples; its end and
        all events; its end and whether it passed a grazing (`SwitchedRK` only); or its end and
        every so many samples (methods of fixed steps only). Of mechanical systems "final", "events"
        or "runs", the runs themselves.
    threads : int, optional
        Number of threads, >= 1; by default as many as the machine runs at once.
    progress : bool, optional
        Show a progress bar on standard error once it lasts longer than a second. By default only
        on a terminal.

    Returns
    -------
    Batch or MechanicalBatch
        An entry for each run; one that ended early has its status and the last valid state.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range, before anything is computed; a run that cannot start is
        named.
    KeyboardInterrupt
        On Ctrl-C; nothing is kept then.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> heights = np.linspace(0.1, 1.0, 4)
    >>> starts = np.column_stack([heights, np.zeros(4)])
    >>> batch = zivi.simulate_batch(ball, (0, 3), starts, method=zivi.ThetaGamma(h=1e-3))
    >>> batch
    <Batch of 4 runs: 4 completed, 4 at rest>
    """
    span = pair("t_span", t_span, "(t0, t1)")
    first = next(iter(systems), None) if isinstance(systems, Sequence) else systems
    if isinstance(first, MechanicalSystem):
        workers = check_threads(threads)
        times = None if t_eval is None else times_within(t_eval, span)
        return mechanical_batch(systems, span, y0, method, times, save, workers, progress)
    several = systems_of(systems)
    states = states_of(y0, len(several))
    check_method(method)
    every = every_of(save, method)
    sampling = sampling_of(t_eval, save, span, method, len(states))
    workers = check_threads(threads)
    specs = [system._spec for system in several]
    with ProgressBar(progress) as bar, listening(specs, threads=True) as ear:
        record = _zivi.simulate_batch(
            specs,
            np.array([(system.e, system.kappa) for system in several]),
            states,
            method._core,
            span=span,
            save=save if every is None else every,
            threads=workers,
            at=sampling.at,
            steps=sampling.steps,
            progress=bar.report,
        )
    tell(ear, record.status)
    config = {
        "t_span": list(span),
        "method": describe(method),
        "save": save if every is None else every,
        **({} if sampling.times is None else {"t_eval": sampling.times.tolist()}),
        "systems": [describe_system(system) for system in several[:MAX_DESCRIBED]],
        "n_systems": len(several),
        "y0": states[:MAX_DESCRIBED].tolist(),
        "n_runs": len(states),
    }
    batch = _batch(record, span, method, every, str(save), config)
    return batch if sampling.times is None else sampled(batch, record, several, method, sampling)


MAX_DESCRIBED = 100
"""Systems, and states, that are told in ``config``."""


def _batch(
    record: _zivi.BatchRecord,
    span: tuple[float, float],
    method: Any,
    every: int | None,
    save: str,
    config: dict[str, Any],
) -> Batch:
    n_impacts, n_zeno, n_liftoffs = record.counts.T
    extremes = save == "statistics"
    return Batch(
        t=record.t,
        x=record.x,
        xdot=record.xdot,
        rest_time=record.rest_time,
        first_impact=record.first_impact,
        last_impact=record.last_impact,
        hardest_impact=record.hardest_impact,
        n_impacts=n_impacts,
        n_zeno=n_zeno,
        n_liftoffs=n_liftoffs,
        status=record.status,
        nfev=record.nfev,
        x_max=record.x_max if extremes else None,
        speed_max=record.speed_max if extremes else None,
        grazing=record.grazing if save == "grazing" else None,
        events=_events(record) if save == "events" else None,
        sample_t=None if every is None else _zivi.grid_times(*span, method.h, every),
        sample_x=None if every is None else record.samples_x,
        sample_xdot=None if every is None else record.samples_xdot,
        config=config,
    )


def _events(record: _zivi.BatchRecord) -> list[dict[str, Any]]:
    events = []
    # each look at one of these makes a new list
    columns = (record.impact_t, record.impact_xdot_before, record.impact_xdot_after)
    for t, before, after, zeno_times, liftoff_times in zip(
        *columns, record.zeno_times, record.liftoff_times, strict=True
    ):
        impacts = np.empty(len(t), IMPACT)
        impacts["t"], impacts["xdot_before"], impacts["xdot_after"] = t, before, after
        events.append(
            {"impacts": impacts, "zeno_times": zeno_times, "liftoff_times": liftoff_times}
        )
    return events
