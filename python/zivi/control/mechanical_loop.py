"""Sampled closed loops of mechanical systems, and batches of loops that run one by one."""

from __future__ import annotations

import copy
import dataclasses
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, by_name, real_array
from zivi.base.extras import ProgressBar
from zivi.base.machine_code import listening_always
from zivi.base.status import ModelWarning
from zivi.base.table import Field, ResultTable
from zivi.control.gap_tracker import GapTracker, Striker
from zivi.control.loop_arguments import (
    Loop,
    check_delay,
    check_not_negative,
    check_predicted,
    check_seed,
    described,
    sampling_period,
)
from zivi.control.loop_run import NONE, Updated, UpdatedBatch, Updates, with_updates
from zivi.control.mechanical_reference import MechanicalReference, check_coupling, reference_of
from zivi.control.model_based import JointObserver, ModelBased, check_believes
from zivi.control.twisting import CONTROLLERS
from zivi.simulation import mechanical_trajectory as labelled
from zivi.simulation.batch_result import check_threads, threads_for
from zivi.simulation.events import check_slowest
from zivi.simulation.mechanical_run import (
    RunRequest,
    check_friction,
    configuration,
    state_of,
    with_kicks,
)
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import pair
from zivi.simulation.run_result import as_raised, with_partial
from zivi.simulation.trajectory import describe
from zivi.system.kicks import kicks_table
from zivi.system.mechanism import ControlInputs, MechanicalSystem, Model, check_planar
from zivi.system.start import check_start

if TYPE_CHECKING:
    import pandas

    from zivi.control.loop_run import ClosedLoop


# The result of a closed loop of a mechanical system.

LOOP_FIELDS: dict[str, Field] = {
    "u": (("time", "control"), "", "controls, held from the sample on"),
    "error_gaps": (("time", "gap"), "", "gaps less those of the reference"),
    "latched": (("time", "gap"), "", "which contacts the controller holds"),
    "tick_status": ("time", "1", "bits of TickStatus"),
    "q_ref": (("time", "coordinate"), "", "coordinates of the reference"),
    "q_est": (("time", "coordinate"), "", "estimated coordinates"),
    "qdot_est": (("time", "coordinate"), "", "estimated velocities"),
}
"""What a loop has at its samples beside a run: dimensions, unit, meaning."""
LOOP_COORDS: dict[str, Field] = {"control": ("control", "", "name of the control")}


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalClosedLoop(Updated, MechanicalTrajectory):
    """Samples and events of one closed loop of a mechanical system.

    All that a `MechanicalTrajectory` has, at the samples of the controller: there also the contact
    forces are those under the control that begins.

    Attributes
    ----------
    u : ndarray
        Controls that act from the sample on, shape (k, r); the last ones are repeated.
    error_gaps : ndarray
        Gaps less those of the reference, shape (k, m); NaN without one.
    latched : ndarray of bool
        Which contacts the controller holds, shape (k, m).
    tick_status : ndarray of uint8
        What was done at the samples, as bits of `TickStatus`; 0 at the last one, which has none.
    updates : Updates
        Counts of the control updates: all, rejected, saturated, with a lost contact; ``n_updates``,
        ``n_refused`` and ``n_saturated`` are the same. Where a sample or a control is rejected the
        last controls are held.
    q_ref : ndarray
        Coordinates of the reference, shape (k, n); NaN without one.
    q_est, qdot_est : ndarray
        What the observer thought, shape (k, n); what was measured without one.
    control_names : tuple of str
        Names of the controls.
    """

    u: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    error_gaps: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    latched: NDArray[np.bool_] = dataclasses.field(default_factory=lambda: np.empty((0, 0), bool))
    tick_status: NDArray[np.uint8] = dataclasses.field(
        default_factory=lambda: np.empty(0, np.uint8)
    )
    q_ref: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    q_est: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    qdot_est: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    control_names: tuple[str, ...] = ()
    updates: Updates = NONE
    _ticks: dict[str, Array] | None = None
    """What was held from each sample on, of a run that is reported at other times."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(with_updates(state))

    def _resampled(self, times: Array) -> MechanicalClosedLoop:
        names = ("t", *LOOP_FIELDS)
        ticks = self._ticks or {name: getattr(self, name) for name in names}
        k = np.maximum(np.searchsorted(ticks["t"], times, side="right") - 1, 0)
        held: dict[str, Any] = {name: ticks[name][k] for name in names[1:]}
        held["error_gaps"] = np.where(
            np.isin(times, ticks["t"])[:, None], held["error_gaps"], np.nan
        )
        moved: Any = super()._resampled(times)
        known: MechanicalClosedLoop = dataclasses.replace(moved, **held, _ticks=ticks)
        return known

    def __repr__(self) -> str:
        name = self.config["controller"]["name"]
        inner = super().__repr__()[len("<MechanicalTrajectory ") :]
        events, _, ended = inner.rpartition(": ")
        return f"<MechanicalClosedLoop {name}, {events}{self._failed_text()}: {ended}"

    def _facts(self) -> dict[str, str]:
        held = self.latched[-1] if len(self.t) else []
        names = [name for name, it in zip(self.gap_names, held, strict=False) if it]
        return {
            **super()._facts(),
            "controller": self.config["controller"]["name"],
            "held at the end": ", ".join(names) or "none",
            "control updates": f"{self.n_updates}{self._failed_text()}",
        }

    def _as_frame(self) -> pandas.DataFrame:
        table = super()._as_frame()
        for j, name in enumerate(self.control_names):
            table[f"u_{name}"] = self.u[:, j]
        for i, name in enumerate(self.gap_names):
            table[f"error_{name}"] = self.error_gaps[:, i]
        return table

    def _table(self) -> ResultTable:
        table = labelled.labels_of(self)
        return dataclasses.replace(
            table,
            title="Closed loop of a mechanical system with impacts",
            fields={**table.fields, **LOOP_FIELDS},
            coords={**table.coords, **LOOP_COORDS},
            attrs={**table.attrs, **self.updates.attrs()},
            values={**table.values, "control": np.array(self.control_names, dtype=object)},
        )


# The sampled closed loop of a mechanical system.

BETWEEN_SAMPLES = SwitchedRK(rtol=1e-9, atol=1e-12)
"""How a plant moves between samples."""


@dataclasses.dataclass(frozen=True)
class RKPeriod:
    """Integrate the plant of a loop by one Runge-Kutta step per period, with located impacts.

    A step of order 5 (Dormand-Prince), cut at impacts, accumulations and lift-offs, which are
    found as by `SwitchedRK`. No error is controlled: the period must be short against the motion.

    See Also
    --------
    SwitchedRK : adaptive steps between samples.
    simulate_closed_loop : the argument ``method``.

    Examples
    --------
    >>> zivi.RKPeriod()
    RKPeriod()
    """


class MechanicalController(Protocol):
    """Anything that `simulate_closed_loop` can run with a `MechanicalSystem`.

    Optional members, detected at the start of a run:

    - With ``reference=`` its method ``step_to(t, q, qdot, now, next)`` is called, with the
      `ReferenceSample` at the sample and at the next one, ``delay`` periods later if it has an
      attribute of that name.
    - ``status``, a `TickStatus`, and ``latched``, of shape (m,), are recorded.
    - A controller with ``copy()`` and ``reset()`` runs as a copy in its present state.

    Where it gives NaN or infinity the last controls are held, and the tick is ``REFUSED``. Another
    number of controls is a `TypeError`.

    See Also
    --------
    Controller : controllers of one mass.
    simulate_closed_loop : run a controller.

    Examples
    --------
    >>> class Damped:
    ...     h = 1e-2
    ...
    ...     def step(self, t, q, qdot):
    ...         return -5.0 * qdot
    >>> ball = zivi.MechanicalSystem(
    ...     mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1])], e=0.5, inputs=[[1.0]]
    ... )
    >>> run = zivi.simulate_closed_loop(ball, Damped(), (0, 2), ([0.1], [0]))
    >>> run.contacts[-1], run.u.shape
    (array([ True]), (201, 1))
    """

    @property
    def h(self) -> float:
        """Sampling period (s)."""

    @property
    def step(self) -> Callable[..., ArrayLike]:
        """Return the controls for the sampling period that starts now, shape (r,)."""


def simulate_mechanical(
    system: MechanicalSystem, controller: Any, t_span: Sequence[float], y0: Any, loop: Loop
) -> MechanicalClosedLoop:
    """Simulate the closed loop of a mechanical system, as `simulate_closed_loop` has it."""
    h, span = sampling_period(controller), pair("t_span", t_span, "(t0, t1)")
    q, qdot = state_of(y0, system._n)
    part, chosen = check_slowest(loop.slowest), read_plant_method(loop.method)
    check_friction(system, chosen[0])
    check_planar(system, "simulate_closed_loop")
    model, times = system.model(len(q)), _zivi.grid_times(*span, h, 1)
    check_start(system, model, span, q, qdot)
    inputs = system.control_inputs(q)
    if isinstance(controller, CONTROLLERS):
        kind = type(controller).__name__
        raise TypeError(f"controller must be one of a mechanical system, {kind} is of one mass")
    if isinstance(controller, ModelBased):
        check_believes("controller", controller.system, system, q)
    sensor = Sensor.of(loop.noise, loop.quantization, loop.seed, len(times), len(q))
    periods = check_delay(loop.delay)
    own, controller, reference = controller, copy_controller(controller), loop.reference
    ahead = int(getattr(controller, "delay", 0))
    check_predicted(ahead, periods)
    asked_at = times_ahead(times, h, ahead, reference)
    tasks = tuple(getattr(controller, "tasks", ()))
    given = reference_of(reference, asked_at, system.gap_names, q, tasks)
    check_gap_reference(controller, given, model, (q, qdot), (asked_at, system.gap_names, tasks))
    watching = watching_of(loop.observer, system, h, q)
    tell_sensor(controller, sensor, watching)
    plant = model if loop.disturbance is None else disturbed(model, loop.disturbance, len(q))
    native = type(controller) in (GapTracker, Striker)
    ticks = (
        controller.in_loop(len(q), given)
        if native
        else called_loop(controller, given, inputs.names)
    )
    stops = np.unique(np.concatenate([times[1:-1], system._breaks(span)]))
    asked = RunRequest(span, q, qdot, None, stops, [], loop.dense_output)
    kicked = with_kicks(asked, loop.kicks, system, chosen[0])
    with ProgressBar(loop.progress) as bar, listening_always() as ear:
        record = _zivi.simulate_mechanical_loop(
            system.mechanism(plant),
            inputs.spec(),
            chosen[0]._core,
            times,
            kicked.tstops,
            _zivi.Configuration(q, kicked.qdot),
            ticks,
            observer=None if watching is None else watching.step,
            noise=sensor.noise,
            steps=sensor.steps,
            delay=periods,
            dense=loop.dense_output,
            one_step=chosen[1],
            kicks=kicked.kicks,
            progress=bar.report,
        )
    config = configuration(system, model, chosen[0], asked) | {
        "controller": described(own),
        "reference": None if reference is None else reference_text(reference),
        "noise": list(sensor.deviations),
        "quantization": list(sensor.steps),
        "seed": sensor.seed,
        "delay": periods,
        "observer": None if loop.observer is None else repr(loop.observer),
        "disturbance": None if loop.disturbance is None else describe(loop.disturbance),
    }
    if chosen[1]:
        config["method"] = {"name": "SwitchedRK"} | {"one_step_a_period": True}
    run = loop_of(record, given, system, plant, config, (inputs, times))
    vars(run)["slowest"] = part
    if kicked.kicks is not None:
        vars(run)["_kicks"] = kicks_table(kicked.kicks.rows, len(q))
    raised = record.run.raised
    if raised is None and (raised := ear.ends(run.success)):
        run = as_raised(run)
    if raised is None:
        return run
    try:
        raise with_partial(raised, run)
    finally:
        del raised, ear


def read_plant_method(method: Any) -> tuple[SwitchedRK, bool]:
    """Read how the plant moves: a method, and whether by one step a period."""
    if method is None:
        return BETWEEN_SAMPLES, False
    if isinstance(method, RKPeriod):
        return BETWEEN_SAMPLES, True
    if not isinstance(method, SwitchedRK):
        raise TypeError(
            "method must be None, a zivi.SwitchedRK or a zivi.RKPeriod for a mechanical system, "
            f"got {type(method).__name__}"
        )
    return method, False


def reference_text(reference: Any) -> str:
    """Describe a reference."""
    return repr(reference) if isinstance(reference, str) else f"a {type(reference).__name__}"


def copy_controller(controller: Any) -> Any:
    """Copy a controller if possible, so that the run does not change it."""
    return controller.copy() if callable(getattr(controller, "copy", None)) else controller


def times_ahead(times: Array, h: float, ahead: int, reference: Any) -> Array:
    """Return the times at which a controller needs its reference, up to its end."""
    more = times[-1] + h * np.arange(1, ahead + 1)
    if isinstance(reference, MechanicalTrajectory):
        more = more[more <= reference._extent()[1]]
    elif not isinstance(reference, str):
        more = more[:0]
    return np.concatenate([times, more])


def check_gap_reference(
    controller: Any,
    given: MechanicalReference | None,
    model: Model,
    start: tuple[Array, Array],
    told: tuple[Array, tuple[str, ...], tuple[str, ...]],
) -> None:
    """Refuse references that a controller does not take, or that cannot be followed."""
    if given is None:
        return
    if not callable(getattr(controller, "step_to", None)):
        kind = type(controller).__name__
        raise TypeError(f"reference= needs a controller with step_to, {kind} has none")
    known = isinstance(controller, GapTracker)
    functions = controller.functions(start[0]) if known else None
    check_coupling(given, model, functions, start, told)


def disturbed(model: Model, disturbance: Any, n: int) -> Model:
    """Add generalised forces to a model: constants, or a function ``d(t, q, qdot)``."""
    if not callable(disturbance):
        constant = np.atleast_1d(real_array("disturbance", disturbance))
        if constant.shape != (n,) or not np.all(np.isfinite(constant)):
            raise ValueError(
                f"disturbance must be finite and of shape ({n},), got {constant.tolist()}"
            )
    layout, start = model.layout, n * n

    def evaluate(t: float, q: Array, qdot: Array) -> Array:
        row = model.evaluate(t, q, qdot).copy()
        if callable(disturbance):
            added = np.atleast_1d(real_array("disturbance(t, q, qdot)", disturbance(t, q, qdot)))
            if added.shape != (n,):
                raise ValueError(f"disturbance must give shape ({n},), got {added.shape}")
        else:
            added = constant
        row[start : start + n] += added
        return row

    return Model(layout, _zivi.Model.callable(evaluate), evaluate)


@dataclasses.dataclass(frozen=True, eq=False)
class Sensor:
    """Sensor: standard deviations of the noise, resolutions, the noise and its seed.

    Parameters
    ----------
    deviations, steps : (float, float)
        Of coordinates and of velocities.
    noise : ndarray or None
        Shape (k, 2, n).
    seed : int or None
        Its seed.
    """

    deviations: tuple[float, float]
    steps: tuple[float, float]
    noise: Array | None
    seed: int | None

    @classmethod
    def of(cls, noise: Any, quantization: Any, seed: Any, count: int, n: int) -> Sensor:
        """Read the arguments of a loop, and draw the noise."""
        deviations = check_not_negative("noise", noise)
        resolution = quantization if np.ndim(quantization) else (quantization, 0.0)
        steps = check_not_negative("quantization", resolution)
        known = None if seed is None else check_seed(seed)
        if deviations == (0.0, 0.0):
            return cls(deviations, steps, None, known)
        source = np.random.SeedSequence(known)
        draws = np.random.default_rng(source).standard_normal((count, 2, n))
        entropy = source.entropy
        told = int(entropy) if isinstance(entropy, int) else None
        return cls(deviations, steps, draws * np.array(deviations)[:, None], told)


def watching_of(observer: Any, system: MechanicalSystem, h: float, q: Array) -> Any:
    """Return a copy of an observer for a run."""
    if observer is None:
        return None
    if not isinstance(observer, JointObserver):
        raise TypeError(f"observer must be a zivi.JointObserver, got {type(observer).__name__}")
    check_believes("observer", observer.system, system, q)
    return observer.begun(h, len(q))


def tell_sensor(controller: Any, sensor: Sensor, watching: Any) -> None:
    """Pass the sensor's properties to a controller with a method ``sensed``."""
    if not callable(getattr(controller, "sensed", None)):
        return
    if watching is None:
        controller.sensed(sensor.deviations, sensor.steps)
    else:
        controller.sensed(watching.deviations, sensor.steps)


def called_loop(
    controller: Any, reference: MechanicalReference | None, names: Sequence[str]
) -> _zivi.CalledLoop:
    """Return the loop component that calls a Python controller."""
    has = {it: controller if hasattr(controller, it) else None for it in ("status", "latched")}
    several = "" if len(names) == 1 else "s"
    expected = f"{len(names)} control{several} ({', '.join(names)})"
    if reference is None:
        return _zivi.CalledLoop(controller.step, False, has["status"], has["latched"], expected)
    ahead = int(getattr(controller, "delay", 0))

    def step(k: int, t: float, q: Array, qdot: Array) -> Any:
        now, after = (reference.sample(k + ahead + it) for it in (0, 1))
        return controller.step_to(t, q, qdot, now, after)

    return _zivi.CalledLoop(step, True, has["status"], has["latched"], expected)


def loop_of(
    record: _zivi.MechanicalLoopRecord,
    given: MechanicalReference | None,
    system: MechanicalSystem,
    plant: Model,
    config: dict[str, Any],
    more: tuple[ControlInputs, Array],
) -> MechanicalClosedLoop:
    """Make the result of a loop from its record."""
    inputs, times = more
    held = driven_model(plant, inputs, times, record.u)
    stepped = config["method"]["name"] != "SwitchedRK"
    run: Any = MechanicalClosedLoop._from_record(
        record.run, system, held, config, None, stepped=stepped
    )
    count = len(run.t)
    last = np.minimum(np.arange(count), len(record.tick_status) - 1)
    bits, updates = np.zeros(count, np.uint8), Updates(*record.updates)
    bits[: updates.total] = record.tick_status[:count]
    unknown = np.full_like(run.q, np.nan)
    error = np.full_like(run.gaps, np.nan)
    if given is not None:
        places = np.minimum(np.arange(count), len(given.q) - 1)
        unknown, error = given.q[places], run.gaps - given.gaps[places]
    known: MechanicalClosedLoop = dataclasses.replace(
        run,
        u=record.u,
        error_gaps=error,
        latched=record.latched[last],
        tick_status=bits,
        updates=updates,
        message=updates.added_to(run.message),
        q_ref=unknown,
        q_est=record.q_est[last],
        qdot_est=record.qdot_est[last],
        control_names=inputs.names,
    )
    return known


def driven_model(model: Model, inputs: ControlInputs, times: Array, controls: Array) -> Model:
    """Return a model under the controls of a loop, for contact forces between the samples."""
    n = model.layout.n

    def evaluate(t: float, q: Array, qdot: Array) -> Array:
        k = min(max(int(np.searchsorted(times, t, side="right")) - 1, 0), len(controls) - 1)
        row = model.evaluate(t, q, qdot).copy()  # constant parts are written once
        row[n * n : n * n + n] += inputs.at(q) @ controls[k]
        return row

    return Model(model.layout, _zivi.Model.callable(evaluate), evaluate)


# Loops of a batch that run one by one: with noise, at given times, with controllers of users.

SAVED = ("x", "x_ref", "u")
"""What is saved of the samples."""


def noises_of(noise: Any) -> list[tuple[float, float]]:
    """Return the deviations of the noise, of all loops or of each."""
    rows = np.atleast_2d(real_array("noise", noise))
    if rows.ndim != 2 or rows.shape[1] != 2:
        raise ValueError(f"noise must have shape (n, 2) or (2,), got {np.shape(noise)}")
    return [check_not_negative("noise", row.tolist()) for row in rows]


def seeds_of(seed: Any, n: int) -> list[int]:
    """Return the seeds of the loops: drawn if none is given."""
    if seed is None:
        return [int(it) for it in np.random.SeedSequence().generate_state(n, np.uint64)]
    several = [seed] if np.ndim(seed) == 0 else list(seed)
    return [check_seed(it) for it in several]


def copy_for_loop(controller: Any, i: int) -> Any:
    """Copy a controller for a loop of its own; zivi's are copied by the loop."""
    if isinstance(controller, CONTROLLERS):
        return controller
    try:
        return copy.deepcopy(controller)
    except Exception as error:
        kind = type(controller).__name__
        text = f"each loop has a controller of its own, but {kind} (number {i}) cannot be copied"
        raise TypeError(f"{text}: {error}") from error


def outcomes(
    numbers: Callable[[int], dict[str, Any]],
    n: int,
    threads: int,
    report: Callable[[int, int], None] | None,
) -> list[dict[str, Any]]:
    """Run the loops on threads, and keep the numbers of each."""
    pool = ThreadPoolExecutor(threads)
    found: list[dict[str, Any]] = []
    try:
        with warnings.catch_warnings():
            # the batch has said already what differs
            warnings.simplefilter("ignore", ModelWarning)
            for result in pool.map(numbers, range(n)):
                found.append(result)
                if report is not None:
                    report(len(found), n)
    finally:
        # after an error or Ctrl-C only the loops that run are awaited
        pool.shutdown(cancel_futures=True)
    return found


def numbers_of(run: ClosedLoop, within: float, every: int) -> dict[str, Any]:
    """Return the batch columns of a loop, summed in the order of the Rust batches."""
    # the last sample repeats the control of the one before
    held, error = run.u[:-1], np.abs(run.x - run.x_ref)
    late = np.flatnonzero(~(error <= within))
    settled = late[-1] + 1 if len(late) else 0
    last = {name: getattr(run, name)[-1:] for name in ("t", "x", "xdot", "x_ref", "xdot_ref")}
    return {
        **{name: it[0] if len(it) else np.nan for name, it in last.items()},
        "settling_time": run.t[settled] if settled < len(run.t) else np.nan,
        "error_max": np.fmax.reduce(error, initial=np.nan),
        "error_rms": _rms(error),
        "u_max": np.abs(held).max(initial=0.0),
        "u_rms": _rms(held),
        "u_variation": _sum(np.abs(np.diff(held))),
        "rest_time": np.nan if run.rest_time is None else run.rest_time,
        "n_impacts": len(run.impacts),
        "n_updates": run.n_updates,
        "n_refused": run.n_refused,
        "n_saturated": run.n_saturated,
        "n_unsolved": run.updates.unsolved,
        "status": int(run.status),
        "saved": [getattr(run, name)[::every] for name in SAVED] if every else None,
    }


def _sum(values: Array) -> float:
    """Sum sequentially (NumPy sums pairwise)."""
    return float(np.cumsum(values)[-1]) if len(values) else 0.0


def _rms(values: Array) -> float:
    return float(np.sqrt(_sum(values * values) / len(values))) if len(values) else np.nan


def loop_columns(found: Sequence[dict[str, Any]], every: int) -> dict[str, Any]:
    """Collect the numbers of the loops in arrays, and the samples in rows padded with NaN."""
    names = [name for name in found[0] if name != "saved"]
    kinds = {name: np.uint64 for name in names if name.startswith("n_")} | {"status": np.uint8}
    columns: dict[str, Any] = {
        name: np.array([it[name] for it in found], dtype=kinds.get(name, np.float64))
        for name in names
    }
    for k, name in enumerate(SAVED):
        columns[f"sample_{name}"] = _padded([it["saved"][k] for it in found]) if every else None
    return columns


def _padded(several: list[Array]) -> Array:
    rows = np.full((len(several), max(map(len, several))), np.nan)
    for row, values in zip(rows, several, strict=True):
        row[: len(values)] = values
    return rows


def columns_of_record(record: _zivi.LoopBatchRecord, sampled: bool) -> dict[str, Any]:
    """Return the columns of a native batch by name."""
    names = (
        "settling_time error_max error_rms u_max u_rms u_variation rest_time n_impacts n_updates "
        "n_refused n_saturated n_unsolved status"
    )
    columns = {name: getattr(record, name) for name in names.split()}
    last = dict(zip(("t", "x", "xdot", "x_ref", "xdot_ref"), record.last.T, strict=True))
    saved = {
        f"sample_{name}": getattr(record, f"samples_{name}") if sampled else None for name in SAVED
    }
    return last | columns | saved


def check_starts(states: Array) -> None:
    """Refuse a state from which no loop can start, before any does."""
    for i, (x, xdot) in enumerate(states):
        if not (x >= 0.0 and np.isfinite(x) and np.isfinite(xdot)):
            raise ValueError(f"y0 must be finite with x >= 0, got {(x, xdot)} (run {i})")


# Many closed loops of a mechanical system.

FIELDS: dict[str, Field] = {
    "t": ("run", "", "time of the last sample"),
    "q": (("run", "coordinate"), "", "coordinates there"),
    "qdot": (("run", "coordinate"), "", "velocities there"),
    "gaps": (("run", "gap"), "", "gaps there"),
    "contacts": (("run", "gap"), "", "which gaps are closed there"),
    "reactions": (("run", "gap"), "", "contact forces there"),
    "u": (("run", "control"), "", "the last controls"),
    "error_max": (("run", "gap"), "", "largest error of a gap"),
    "error_rms": (("run", "gap"), "", "root mean square of the error of a gap"),
    "u_max": (("run", "control"), "", "largest control"),
    "u_variation": (("run", "control"), "", "total variation of the control"),
    "rest_time": ("run", "", "time from which nothing moves, NaN if something does"),
    "n_impacts": ("run", "1", "number of impacts"),
    "n_updates": ("run", "1", "number of control updates"),
    "n_refused": ("run", "1", "number of control updates that were rejected"),
    "n_saturated": ("run", "1", "number of control updates that were saturated"),
    "n_lost": ("run", "1", "number of samples at which a held contact was lost"),
    "status": ("run", "1", "how the run ended, a zivi.Status"),
}
"""Dimensions, unit and meaning of what a batch has for each loop."""
LABELS: dict[str, Field] = {
    "run": ("run", "", "number of the run"),
    "coordinate": ("coordinate", "", "name of the coordinate"),
    "gap": ("gap", "", "name of the gap"),
    "control": ("control", "", "name of the control"),
}


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalLoopBatch(UpdatedBatch):
    """Results of a batch of closed loops of a mechanical system: an entry for each of N loops.

    Attributes
    ----------
    t : ndarray
        Time of the last sample, shape (N,).
    q, qdot : ndarray
        Coordinates and velocities there, shape (N, n).
    gaps, contacts, reactions : ndarray
        Gaps, which of them are closed, and contact forces there, shape (N, m).
    u : ndarray
        The last controls, shape (N, r).
    error_max, error_rms : ndarray
        Largest error and root mean square of the error of each gap, NaN without a reference.
    u_max, u_variation : ndarray
        Largest control and total variation of each control, shape (N, r).
    rest_time : ndarray
        Time from which nothing moves until the end, NaN if something does.
    n_impacts : ndarray of int
        Numbers of impacts.
    n_updates, n_refused, n_saturated, n_lost : ndarray of int
        Numbers of control updates, of rejected updates, of updates with a saturated control, and of
        updates at which a held contact was lost.
    status : ndarray of uint8
        How each run ended, the numbers of `Status`.
    runs : list of MechanicalClosedLoop or None
        With ``save="runs"``: the loops themselves.
    config : dict
        Settings of the batch, as plain values.
    """

    t: Array
    q: Array
    qdot: Array
    gaps: Array
    contacts: NDArray[np.bool_]
    reactions: Array
    u: Array
    error_max: Array
    error_rms: Array
    u_max: Array
    u_variation: Array
    rest_time: Array
    n_impacts: NDArray[np.int64]
    n_updates: NDArray[np.int64]
    n_refused: NDArray[np.int64]
    n_saturated: NDArray[np.int64]
    n_lost: NDArray[np.int64]
    status: NDArray[np.uint8]
    runs: list[MechanicalClosedLoop] | None
    config: dict[str, Any]

    def _table(self) -> ResultTable:
        values = {"run": np.arange(len(self))}
        names = {"coordinate": "coordinates", "gap": "gaps", "control": "controls"}
        values |= {
            one: np.array(self.config[several], dtype=object) for one, several in names.items()
        }
        title = "Batch of closed loops of mechanical systems with impacts"
        return ResultTable(title, FIELDS, LABELS, values)


def simulate_mechanical_batch(
    system: MechanicalSystem,
    controller: Any,
    t_span: Sequence[float],
    starts: Any,
    asked: Loop,
    *,
    parameters: Mapping[str, ArrayLike] | None = None,
    save: str | int = "final",
    threads: int | None = None,
) -> MechanicalLoopBatch:
    """Simulate many closed loops of a mechanical system, as `simulate_closed_loop_batch` has it."""
    if save not in ("final", "runs"):
        raise ValueError(f"save must be 'final' or 'runs' for a mechanical system, got {save!r}")
    states = read_starts(starts)
    plants = plants_of(system, {} if parameters is None else by_name("parameters", parameters))
    deviations = noises_of(asked.noise)
    noisy = any(it != (0.0, 0.0) for it in deviations)
    given = [] if asked.seed is None else np.atleast_1d(asked.seed).tolist()
    lists = {"starts": states, "parameters": plants, "noise": deviations, "seed": given}
    n = common_length(lists)
    numbers = seeds_of(asked.seed, n) if noisy or asked.seed is not None else []
    span, h = pair("t_span", t_span, "(t0, t1)"), sampling_period(controller)
    reference = asked.reference
    if isinstance(reference, MechanicalTrajectory):
        ahead = int(getattr(controller, "delay", 0))
        times = times_ahead(_zivi.grid_times(*span, h, 1), h, ahead, reference)
        reference = reference_of(reference, times, system.gap_names, states[0][0])
    kept_loop = dataclasses.replace(
        asked, reference=reference, dense_output=save == "runs", progress=False
    )

    def kept(i: int) -> tuple[dict[str, Any], MechanicalClosedLoop | None]:
        seed = entry(numbers, i) if numbers else None
        loop = dataclasses.replace(kept_loop, noise=entry(deviations, i), seed=seed)
        run = simulate_mechanical(entry(plants, i), controller, span, entry(states, i), loop)
        return mechanical_numbers_of(run), run if save == "runs" else None

    found, runs = [], []
    with ProgressBar(asked.progress) as bar:
        pool = ThreadPoolExecutor(threads_for(plants, check_threads(threads)))
        try:
            for row, run in pool.map(kept, range(n)):
                found.append(row)
                runs.append(run)
                if bar.report is not None:
                    bar.report(len(found), n)
        finally:
            pool.shutdown(cancel_futures=True)
    columns = {name: np.array([row[name] for row in found]) for name in found[0]}
    q0 = states[0][0]
    config = {
        "system": repr(system),
        "controller": described(controller),
        "t_span": list(span),
        "n": n,
        "coordinates": list(system.coordinate_names(len(q0))),
        "gaps": list(system.gap_names),
        "controls": list(system.control_inputs(q0).names),
        "seed": numbers,
        "parameters": {name: np.asarray(it).tolist() for name, it in (parameters or {}).items()},
    }
    whole: Any = runs if save == "runs" else None
    return MechanicalLoopBatch(**columns, runs=whole, config=config)


def read_starts(starts: Any) -> list[tuple[Array, Array]]:
    """Read initial states: ``(q0, qdot0)`` of shapes (n,) or (N, n), or an array (N, 2, n)."""
    if isinstance(starts, tuple) and len(starts) == 2:
        q, qdot = (np.atleast_1d(real_array("starts", it)) for it in starts)
        if q.ndim < 2 and qdot.ndim < 2:
            return [(q, qdot)]
        rows = np.broadcast_arrays(np.atleast_2d(q), np.atleast_2d(qdot))
        return list(zip(np.array(rows[0]), np.array(rows[1]), strict=True))
    array = real_array("starts", starts)
    if array.ndim != 3 or array.shape[1] != 2 or not len(array):
        raise ValueError(
            f"starts must be (q0, qdot0) with rows for each loop, or shape (N, 2, n), "
            f"got {array.shape}"
        )
    return [(row[0], row[1]) for row in array]


def plants_of(
    system: MechanicalSystem, parameters: Mapping[str, ArrayLike]
) -> list[MechanicalSystem]:
    """Return the plants with their parameters."""
    if not isinstance(system, MechanicalSystem):
        raise TypeError(f"systems must be one MechanicalSystem, got {type(system).__name__}")
    if not parameters:
        return [system]
    columns = {
        name: np.atleast_1d(real_array(f"parameters[{name!r}]", it))
        for name, it in parameters.items()
    }
    for name, it in columns.items():
        if it.ndim != 1 or not len(it):
            raise ValueError(
                f"parameters[{name!r}] must be a number or one for each loop, got shape {it.shape}"
            )
    n = common_length({f"parameters[{name!r}]": list(it) for name, it in columns.items()})
    rows = [{name: float(entry(list(it), i)) for name, it in columns.items()} for i in range(n)]
    return [system.replace(**row) for row in rows]


def common_length(lists: Mapping[str, Sequence[Any]]) -> int:
    """Return the length that all lists have that differ from loop to loop."""
    lengths = {name: len(it) for name, it in lists.items() if len(it) > 1}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"all that differs from loop to loop must be as many, got {lengths}")
    return max([1, *lengths.values()])


def entry(things: Sequence[Any] | Array, i: int) -> Any:
    """Return the entry of one loop, or the one for all."""
    return things[i if len(things) > 1 else 0]


def mechanical_numbers_of(run: MechanicalClosedLoop) -> dict[str, Any]:
    """Return the batch columns of a loop."""
    held = run.u[:-1]
    error = np.abs(run.error_gaps)
    last = ("t", "q", "qdot", "gaps", "contacts", "reactions", "u")
    return {name: getattr(run, name)[-1] for name in last} | {
        "error_max": error.max(axis=0),
        "error_rms": np.sqrt(np.mean(error**2, axis=0)),
        "u_max": np.abs(held).max(axis=0),
        "u_variation": np.abs(np.diff(held, axis=0)).sum(axis=0),
        "rest_time": np.nan if run.rest_time is None else run.rest_time,
        "n_impacts": len(np.unique(run.impacts["group"])),
        "n_updates": run.n_updates,
        "n_refused": run.n_refused,
        "n_saturated": run.n_saturated,
        "n_lost": run.updates.lost,
        "status": np.uint8(int(run.status)),
    }
