"""Batches of closed loops, on all cores."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, finite
from zivi.base.extras import ProgressBar
from zivi.base.habits import hinted
from zivi.base.machine_code import listening, tell
from zivi.base.status import warn
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
    check_stays,
    describe_reference,
    described,
    described_observer,
    on_wall,
    plant_motion,
    sampling_period,
)
from zivi.control.loop_run import ClosedLoop, ClosedLoopBatch, warn_of_batch
from zivi.control.mechanical_loop import (
    MechanicalController,
    MechanicalLoopBatch,
    RKPeriod,
    check_starts,
    columns_of_record,
    copy_for_loop,
    entry,
    loop_columns,
    noises_of,
    numbers_of,
    outcomes,
    seeds_of,
    simulate_mechanical_batch,
)
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
)
from zivi.simulation.events import SLOWEST, check_slowest
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
        loop.check_mechanical()
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
