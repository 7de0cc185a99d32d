"""Batches of closed loops, on all cores."""

from __future__ import annotations

import copy
import dataclasses
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, by_name, finite, real_array
from zivi.base.extras import ProgressBar
from zivi.base.habits import hinted
from zivi.base.machine_code import listening, tell
from zivi.base.status import ModelWarning, warn
from zivi.base.table import Field, ResultTable
from zivi.control.closed_loop import SAMPLED, Controller, keep, simulate_mass
from zivi.control.loop_arguments import (
    Loop,
    Reference,
    at_samples,
    check_ahead,
    check_delay,
    check_follows,
    check_not_negative,
    check_observer,
    check_plant_method,
    check_reference,
    check_seed,
    check_stays,
    describe_reference,
    described,
    described_observer,
    on_wall,
    plant_motion,
    sampling_period,
)
from zivi.control.loop_run import ClosedLoop, ClosedLoopBatch, UpdatedBatch, warn_of_batch
from zivi.control.mechanical_loop import (
    MechanicalClosedLoop,
    MechanicalController,
    RKPeriod,
    simulate_mechanical,
    times_ahead,
)
from zivi.control.mechanical_reference import reference_of
from zivi.control.model_based import JointObserver
from zivi.control.observer import ImpactObserver
from zivi.control.twisting import CONTROLLERS
from zivi.simulation.batch_result import (
    MAX_DESCRIBED,
    check_native,
    check_threads,
    every_of,
    kept_times,
    room_for,
    state_rows,
    threads_for,
)
from zivi.simulation.events import SLOWEST, check_slowest
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import SwitchedRK, ThetaGamma
from zivi.simulation.run import pair
from zivi.simulation.trajectory import describe, describe_system
from zivi.system.mass import Force, ImpactSystem, force_spec, in_wall_frame
from zivi.system.mechanism import MechanicalSystem

# What is requested of a batch of closed loops: its arguments, checked and translated.


def observers_of(observer: Any, controllers: list[Any]) -> list[Any]:
    """Return the observers, each of its controller's period."""
    observers = [] if observer is None else as_list("observer", observer)
    for i in range(max(len(observers), len(controllers)) if observers else 0):
        if i < len(observers) or len(observers) == 1:
            check_observer(entry(observers, i), controllers[min(i, len(controllers) - 1)].h)
    return observers


def as_list(name: str, things: Any) -> list[Any]:
    """Return one thing, or several, as a list."""
    try:
        one = isinstance(things, (ImpactSystem, ImpactObserver, *CONTROLLERS))
        found = [things] if one else list(things)
    except TypeError:
        found = [things]
    if not found:
        raise ValueError(f"{name} must hold at least one")
    return found


def loop_count(lists: dict[str, Any]) -> int:
    """Return the number of loops; every list has an entry for each, or one for all."""
    n = max(len(it) for it in lists.values())
    for name, it in lists.items():
        if len(it) not in (1, n):
            raise ValueError(f"{name} must have 1 or {n} entries, got {len(it)}")
    return n


def place_controllers(controllers: list[Any], references: Array, n: int) -> list[Any]:
    """Copy the controllers, with their references where they start."""
    copies = []
    for i in range(n):
        controller = controllers[i if len(controllers) > 1 else 0].copy()
        controller.reset(*(float(it) for it in references[i if len(references) > 1 else 0]))
        copies.append(controller)
        if len(controllers) == 1 and len(references) == 1:
            break
    return copies


def on_walls(controllers: list[Any], plants: list[ImpactSystem], n: int) -> list[Any]:
    """Return the controllers; one without `e` gets the `e` of its plant."""
    ours = [it for it in controllers if isinstance(it, CONTROLLERS)]
    differ = len(plants) > 1 and any(it._settings["kappa"] is None for it in ours)
    count = n if differ else len(controllers)
    # one warning for all of a kind: the warnings of one place are shown once
    return [on_wall(entry(controllers, i), entry(plants, i)) for i in range(count)]


def references_of(
    references: list[Any], controllers: list[Any], span: tuple[float, float], n: int
) -> list[tuple[Array, float]]:
    """Return the references at the samples, and the kappas of their walls."""
    count = n if max(len(references), len({(it.h, it.kappa_ref) for it in controllers})) > 1 else 1
    pairs = [(entry(references, i), entry(controllers, i)) for i in range(count)]
    return [(at_samples(it, span, controller.h), controller.kappa_ref) for it, controller in pairs]


def batch_forces(
    plants: list[ImpactSystem], force_model: Any, force_ref: Any
) -> tuple[list[_zivi.Force], list[_zivi.Force], list[_zivi.Force]]:
    """Translate the forces on the plants, in the models and on the references."""
    own = [plant._spec for plant in plants]
    if force_model is None:
        models = own
    else:
        model = force_spec(force_model, "force_model")
        models = [in_wall_frame(plant, model) for plant in plants]
    references = models if force_ref is None else [force_spec(force_ref, "force_ref")]
    for name, specs in (("system", own), ("model", models), ("reference", references)):
        for i, spec in enumerate(specs):
            check_native(spec, f"the force of {name} {i}")
    return own, models, references


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


Found = TypeVar("Found")


def outcomes(
    one: Callable[[int], Found], n: int, threads: int, report: Callable[[int, int], None] | None
) -> list[Found]:
    """Run the loops on threads, and return what each leaves."""
    pool = ThreadPoolExecutor(threads)
    found: list[Found] = []
    try:
        for result in pool.map(one, range(n)):
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
    """Reject a state from which no loop can start, before any does."""
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

    workers = threads_for(plants, check_threads(threads))
    with ProgressBar(asked.progress) as bar:
        found, runs = zip(*outcomes(kept, n, workers, bar.report), strict=True)
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
    whole: Any = list(runs) if save == "runs" else None
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


# Many closed loops at once, on all cores: the study of gains and of tolerances.

STATE = ("x", "xdot")
"""The columns of initial states."""


@overload
def simulate_closed_loop_batch(
    systems: ImpactSystem | Sequence[ImpactSystem],
    controllers: Controller | Sequence[Controller],
    t_span: Sequence[float],
    y0: ArrayLike,
    *,
    y_ref0: ArrayLike | None = ...,
    force_ref: Force | None = ...,
    force_model: Force | None = ...,
    reference: Reference | Sequence[Reference] | None = ...,
    method: ThetaGamma | SwitchedRK | None = ...,
    noise: ArrayLike = ...,
    seed: int | Sequence[int] | None = ...,
    quantization: Sequence[float] = ...,
    delay: int = ...,
    observer: ImpactObserver | Sequence[ImpactObserver] | None = ...,
    within: float = ...,
    save: str | int = ...,
    slowest: float = ...,
    t_eval: ArrayLike | None = ...,
    threads: int | None = ...,
    progress: bool | None = ...,
) -> ClosedLoopBatch: ...
@overload
def simulate_closed_loop_batch(
    systems: MechanicalSystem,
    controllers: MechanicalController,
    t_span: Sequence[float],
    y0: ArrayLike | tuple[ArrayLike, ArrayLike],
    *,
    reference: Any = ...,
    method: SwitchedRK | RKPeriod | None = ...,
    noise: ArrayLike = ...,
    seed: int | Sequence[int] | None = ...,
    quantization: float | Sequence[float] = ...,
    delay: int = ...,
    observer: JointObserver | None = ...,
    disturbance: Any = ...,
    kicks: Any = ...,
    parameters: Mapping[str, ArrayLike] | None = ...,
    save: str = ...,
    slowest: float = ...,
    threads: int | None = ...,
    progress: bool | None = ...,
) -> MechanicalLoopBatch: ...


@hinted("simulate_batch")
def simulate_closed_loop_batch(
    systems: Any,
    controllers: Any,
    t_span: Sequence[float],
    y0: Any,
    *,
    y_ref0: ArrayLike | None = None,
    force_ref: Force | None = None,
    force_model: Force | None = None,
    reference: Any = None,
    method: Any = None,
    noise: ArrayLike = (0.0, 0.0),
    seed: int | Sequence[int] | None = None,
    quantization: Any = (0.0, 0.0),
    delay: int = 0,
    observer: Any = None,
    within: float = 1e-2,
    save: str | int = "final",
    slowest: float = SLOWEST,
    t_eval: ArrayLike | None = None,
    threads: int | None = None,
    progress: bool | None = None,
    **mechanical: Any,
) -> ClosedLoopBatch | MechanicalLoopBatch:
    """Simulate many independent closed loops, on all cores and without the interpreter.

    Loops with noise, with `t_eval`, and those of controllers of the user, run one by one on the
    threads. Each run is bit-identical to `simulate_closed_loop`, for any number of threads.
    Arguments that differ between loops are sequences or rows.

    Parameters
    ----------
    systems : ImpactSystem or sequence of ImpactSystem
        The plants: one for all, or one for each. Forces must not need the interpreter.
    controllers : controller or sequence of controllers
        One for all or one for each; they are copied, those of the user by `copy.deepcopy`.
    t_span : (float, float)
        Start and end (s), the same for all.
    y0 : array_like
        The plants' initial states, shape (n, 2), or (2,) for all.
    y_ref0 : array_like, optional
        The references' initial states, shape (n, 2), or (2,) for all. Without it each controller
        continues from its present state.
    force_ref, force_model : float, LinearForce or compiled callable, optional
        Common to all loops; see `simulate_closed_loop`.
    reference : Trajectory, callable, array_like or list of these, optional
        The references (see `simulate_closed_loop`): one for all loops, or a list with one per loop.
        A function is evaluated once for each sample, before the loops begin.
    method : SwitchedRK or ThetaGamma, optional
        Integration of the plants between samples (see `simulate_closed_loop`).
    noise : array_like
        Standard deviations of the measured positions (m) and velocities (m/s), shape (n, 2), or
        (2,) for all.
    seed : int or sequence of int, optional
        Seeds of the noise: one for all loops, which then have the same, or one for each, such as
        ``range(n)``. By default each draws its own; ``config["seed"]`` tells them.
    quantization : (float, float)
        Resolution of the measured position (m) and velocity (m/s); 0 is exact.
    delay : int
        Periods from a measurement to the moment when its control acts, >= 0.
    observer : ImpactObserver or sequence of ImpactObserver, optional
        Observers whose estimates replace the measurement (see `simulate_closed_loop`): one for all
        loops or one per loop; copies run.
    within : float
        The position error that counts as followed, > 0 (m): see ``settling_time``.
    save : "final" or int
        ``"final"`` stores the numbers of each loop; an integer n also every n-th sample.
    slowest : float
        The slowest impacts that are counted, as a part of the fastest one of the loop, > 0.
    t_eval : array_like, optional
        Increasing times in `t_span` (s) at which positions, velocities, references and controls are
        stored; with ``save="final"`` only.
    threads : int, optional
        Number of threads, >= 1; by default the number of cores.
    progress : bool, optional
        Show a progress bar on standard error once it lasts longer than a second. By default only
        on a terminal.
    **mechanical
        Of a `MechanicalSystem`, with `y0` of shapes ``((N, n), (N, n))`` or ``(N, 2, n)``:
        ``parameters``, a dict of names and values of the plant's parameters, one for all loops or
        N; ``disturbance``. Then ``save="runs"`` keeps the loops. Their ticks
        need the interpreter and take turns.

    Returns
    -------
    ClosedLoopBatch or MechanicalLoopBatch
        An entry for each loop. As in all batches ``x`` is the state at the end of each, and
        ``sample_x`` its samples.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range, before anything is computed.
    KeyboardInterrupt
        On Ctrl-C; nothing is kept then.

    Warns
    -----
    ModelWarning
        If more than a tenth of the control updates of a loop were rejected, or saturated, and as
        `simulate_closed_loop`.

    See Also
    --------
    simulate_closed_loop : a single loop, with all its samples.
    simulate_batch : many runs without controller.

    Notes
    -----
    Each loop has the bits of `simulate_closed_loop`, whatever the number of threads. Memory is
    proportional to the number of loops and of kept samples.

    References
    ----------
    O. Huber and H. B. Oza, Implicit numerical integration for the simulation and control of a
    non-smooth system with resets, IEEE CDC, 2016.

    Examples
    --------
    >>> plant = zivi.ImpactSystem(-9.81, kappa=0.5)
    >>> trackers = [zivi.TwistingTracker(mu1, 17, h=1e-3, kappa=0.5) for mu1 in (20, 30, 40)]
    >>> batch = zivi.simulate_closed_loop_batch(
    ...     plant, trackers, (0, 2), (6, 5), y_ref0=(3, 3), force_ref=-19.81
    ... )
    >>> batch
    <ClosedLoopBatch of 3 loops: 3 completed, 3 at rest>
    >>> float(batch.settling_time[1])  # the paper's gains
    1.211
    """
    if "seeds" in mechanical:
        warn("seeds= is deprecated; use seed=", DeprecationWarning)
        seed = mechanical.pop("seeds")
    loop = Loop(
        y_ref0=y_ref0, force_ref=force_ref, force_model=force_model, reference=reference,
        method=method, noise=noise, seed=seed, quantization=quantization, delay=delay,
        observer=observer, t_eval=t_eval, slowest=slowest, progress=progress,
    )  # fmt: skip
    if isinstance(systems, MechanicalSystem):
        loop.check_for(systems)
        strange = sorted(set(mechanical) - {"parameters", "disturbance", "kicks"})
        if strange:
            raise TypeError(f"unknown argument {strange[0]} for loops of a mechanical system")
        parameters = mechanical.pop("parameters", None)
        loops = simulate_mechanical_batch(
            systems, controllers, t_span, y0, dataclasses.replace(loop, **mechanical),
            parameters=parameters, save=save, threads=threads,
        )  # fmt: skip
        warn_of_batch(loops)
        return loops
    if mechanical:
        raise TypeError(f"{min(mechanical)} is for a zivi.MechanicalSystem")
    span, slowest = pair("t_span", t_span, "(t0, t1)"), check_slowest(slowest)
    plants, ticking = as_list("systems", systems), as_list("controllers", controllers)
    for i, plant in enumerate(plants):
        if not isinstance(plant, ImpactSystem):
            kind = type(plant).__name__
            raise TypeError(f"systems must be zivi.ImpactSystem, got {kind} (number {i})")
    ours = all(type(controller) in CONTROLLERS for controller in ticking)
    for controller in ticking:
        sampling_period(controller)
        check_follows(controller, y_ref0=y_ref0, force_ref=force_ref)
        check_reference(controller, reference, y_ref0=y_ref0, force_ref=force_ref)
    states = state_rows("y0", y0)
    references = np.empty((1, 0)) if y_ref0 is None else state_rows("y_ref0", y_ref0)
    followed = reference if isinstance(reference, list) else [reference]
    observers = observers_of(observer, ticking)
    lists = {"systems": plants, "controllers": ticking, "y0": states, "y_ref0": references}
    lists |= {"reference": followed} | ({"observer": observers} if observers else {})
    deviations = noises_of(noise)
    lists |= {"noise": deviations} | ({} if seed is None or np.ndim(seed) == 0 else {"seed": seed})
    n = loop_count(lists)
    noisy = any(it != (0.0, 0.0) for it in deviations)
    seeds = seeds_of(seed, n) if noisy or seed is not None else []
    times = None if t_eval is None else kept_times(t_eval, save, span)
    rows = None if times is None else room_for(len(SAMPLED), n, len(times))
    if y_ref0 is not None and ours:
        ticking = place_controllers(ticking, references, n)
    forces = batch_forces(plants, force_model, force_ref)
    ticking = on_walls(ticking, plants, n)
    for controller in ticking:
        check_plant_method(method, controller.h)
        check_ahead(controller, check_delay(delay), max(it[1] for it in deviations))
    own = plants[0].force if force_model is None else force_model
    given_place = not (y_ref0 is None and reference is None)
    check_stays(ticking[0], given_place, own if force_ref is None else force_ref)
    if not (finite("within", within) > 0.0):
        raise ValueError(f"within must be > 0 (m), got {within}")
    asked = dataclasses.replace(
        loop, y_ref0=None, noise=(0.0, 0.0), seed=None, t_eval=None, progress=False
    )

    def run_of(i: int) -> ClosedLoop:
        given: dict[str, Any] = {"reference": entry(followed, i)}
        if not ours and y_ref0 is not None:
            given["y_ref0"] = entry(references, i)
        if noisy:
            given |= {"noise": entry(deviations, i), "seed": entry(seeds, i)}
        if observers:
            given["observer"] = entry(observers, i)
        own = copy_for_loop(entry(ticking, i), i)
        one = dataclasses.replace(asked, **given)
        return simulate_mass(entry(plants, i), own, span, entry(states, i), one)

    every, workers = every_of(save, ("final",)) or 0, check_threads(threads)

    def numbers(i: int) -> dict[str, Any]:
        run = run_of(i)
        if times is not None and rows is not None:
            keep(rows[:, i], run, times)
        return numbers_of(run, float(within), every)

    resolution = check_not_negative("quantization", quantization)
    specs = [spec for several in forces for spec in several]
    with ProgressBar(progress) as bar:
        if noisy or not ours or rows is not None:
            check_starts(states)
            with warnings.catch_warnings():
                # the batch has said already what differs
                warnings.simplefilter("ignore", ModelWarning)
                found = loop_columns(outcomes(numbers, n, workers, bar.report), every)
        else:
            given = [] if reference is None else references_of(followed, ticking, span, n)
            with listening(specs, threads=True) as ear:
                record = _zivi.simulate_closed_loop_batch(
                    ticking,
                    observers,
                    forces,
                    np.array([(plant.e, plant.kappa) for plant in plants]),
                    np.ascontiguousarray(np.broadcast_to(states, (n, 2))),
                    span=span,
                    **plant_motion(method),
                    resolution=resolution,
                    delay=check_delay(delay),
                    within=float(within),
                    every=every,
                    slowest=slowest,
                    threads=workers,
                    references=given,
                    progress=bar.report,
                )
            tell(ear, record.status)
            found = columns_of_record(record, save != "final")
    config = {
        "systems": [describe_system(plant) for plant in plants[:MAX_DESCRIBED]],
        "n_systems": len(plants),
        "n_runs": n,
        "t_span": list(span),
        "y0": states[:MAX_DESCRIBED].tolist(),
        "y_ref0": None if y_ref0 is None else references[:MAX_DESCRIBED].tolist(),
        "reference": None if reference is None else [*map(describe_reference, followed)],
        "force_model": None if force_model is None else describe(force_model),
        "force_ref": None if force_ref is None else describe(force_ref),
        "method": None if method is None else describe(method),
        **({"noise": deviations[:MAX_DESCRIBED], "seed": seeds[:MAX_DESCRIBED]} if noisy else {}),
        "quantization": [float(value) for value in quantization],
        "delay": int(delay),
        "within": float(within),
        **described_observer(observers[0] if observers else None),
        "save": save if isinstance(save, str) else int(save),
        **({} if times is None else {"t_eval": times.tolist()}),
        "controllers": [described(it) for it in ticking[:MAX_DESCRIBED]],
        "n_controllers": len(ticking),
    }
    if every and len({controller.h for controller in ticking}) == 1:
        width = found["sample_x"].shape[1]
        found["sample_t"] = _zivi.grid_times(*span, float(ticking[0].h), every)[:width]
    if rows is not None:
        found |= {"sample_t": times}
        found |= dict(zip((f"sample_{it}" for it in SAMPLED), rows, strict=True))
    batch = ClosedLoopBatch(**found, config=config)
    warn_of_batch(batch)
    return batch
