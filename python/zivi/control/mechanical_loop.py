"""Sampled closed loops of mechanical systems."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, real_array
from zivi.base.extras import ProgressBar
from zivi.base.machine_code import listening_always
from zivi.base.table import Field, ResultTable
from zivi.control.gap_tracker import GapTracker, Striker
from zivi.control.loop_arguments import (
    BETWEEN_SAMPLES,
    Loop,
    Sensor,
    check_delay,
    check_predicted,
    described,
    sampling_period,
)
from zivi.control.loop_run import NONE, Updated, Updates, with_updates
from zivi.control.mechanical_reference import MechanicalReference, check_coupling, reference_of
from zivi.control.model_based import JointObserver, ModelBased, check_believes
from zivi.control.twisting import CONTROLLERS
from zivi.simulation import mechanical_trajectory as labelled
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
        ticks, held = self._held(("t", *LOOP_FIELDS), times)
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


@dataclasses.dataclass(frozen=True)
class RKPeriod:
    """Integrate the plant of a loop by one Runge-Kutta step per period, with located impacts.

    A step of order 5 (Dormand-Prince), cut at impacts, accumulations and lift-offs, which are
    found as by `SwitchedRK`. The error is not controlled: the period must be short relative to the
    motion.

    See Also
    --------
    SwitchedRK : adaptive steps between samples.
    simulate_closed_loop : the argument ``method``.

    Notes
    -----
    One step of Dormand and Prince's pair of order 5 per period, cut at impacts; the error is not
    controlled but proportional to the fifth power of `h` in flight.

    References
    ----------
    E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed.,
    Springer, 1993, chapter II.

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

    Notes
    -----
    Any object with these members will do; no inheritance is needed. `step` is called once per
    period, in the order of time.

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
    resolution = loop.quantization if np.ndim(loop.quantization) else (loop.quantization, 0.0)
    sensor = Sensor.of(loop.noise, resolution, loop.seed, len(times), len(q))
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
        **sensor.described(),
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
    """Reject references that a controller does not take, or that cannot be followed."""
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
