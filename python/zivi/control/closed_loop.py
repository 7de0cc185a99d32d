"""The sampled closed loop of a plant and a controller."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import math
from collections.abc import Callable, Sequence
from typing import Any, Never, Protocol, overload

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, real
from zivi.base.experiments import registered as _registered
from zivi.base.extras import ProgressBar
from zivi.base.habits import hinted
from zivi.base.machine_code import listening
from zivi.base.status import Status
from zivi.control.loop_arguments import (
    GivenReference,
    Loop,
    Reference,
    Sensor,
    Told,
    check_ahead,
    check_delay,
    check_interface,
    check_observer,
    check_plant_method,
    check_reference,
    check_stays,
    describe_reference,
    described,
    described_observer,
    has_own_tick,
    interface_of,
    loop_forces,
    on_wall,
    plant_motion,
    sampling_period,
    spec_of,
    with_step_to,
)
from zivi.control.loop_run import (
    ESTIMATES,
    QUANTITIES,
    ClosedLoop,
    SampledReference,
    Updates,
    path_of,
)
from zivi.control.mechanical_loop import (
    MechanicalClosedLoop,
    MechanicalController,
    RKPeriod,
    simulate_mechanical,
)
from zivi.control.model_based import JointObserver
from zivi.control.observer import ImpactObserver
from zivi.control.twisting import CONTROLLERS, TwistingTracker
from zivi.simulation.events import SLOWEST, check_slowest, events_of, impacts_of
from zivi.simulation.mechanical_run import stops_with
from zivi.simulation.methods import SwitchedRK, ThetaGamma
from zivi.simulation.run import Event, pair, refuse, times_within
from zivi.simulation.run_result import as_raised, with_partial
from zivi.simulation.trajectory import describe, describe_system
from zivi.system.kicks import Kick, kicks_table, schedule_of
from zivi.system.mass import Force, ImpactSystem, check_system
from zivi.system.mechanism import MechanicalSystem

# A closed loop reported otherwise than sample by sample: at given times, up to an event.

SAMPLED = ("x", "xdot", "x_ref", "u")
"""What a batch keeps of each loop at given times."""


def restrict_loop(run: ClosedLoop, times: Array) -> ClosedLoop:
    """Report a run at `times` (those within the computed span) instead of at its samples."""
    if run._span is None:
        return run
    return run._resampled(times[times <= run._span[1]])


def keep(rows: Array, run: ClosedLoop, times: Array) -> None:
    """Write the samples of one loop of a batch at `times` into its rows."""
    there = restrict_loop(run, times)
    for row, name in zip(rows, SAMPLED, strict=True):
        values = getattr(there, name)
        if values is not None:
            row[: len(there.t)] = values


def end_loop_at_event(run: ClosedLoop, h: float) -> ClosedLoop:
    """End a run at its last event, within its last period."""
    end = max(float(times[-1]) for times in run.t_events if len(times))
    times = np.append(run.t[run.t < end], end)
    zeno = run.zeno_times[run.zeno_times <= end]
    gone = run.liftoff_times[run.liftoff_times <= end]
    cut = dataclasses.replace(
        run._resampled(times),
        resolved_impacts=run.resolved_impacts[run.resolved_impacts["t"] <= end],
        zeno_times=zeno,
        liftoff_times=gone,
        _span=(float(run.t[0]), end),
    )
    return dataclasses.replace(cut, rest_time=_rest(cut, max(end - h, times[0])))


def _rest(run: ClosedLoop, latest: float) -> float | None:
    """Return the time from which the plant rests until the end, if that is not after `latest`."""
    if (run.x[-1], run.xdot[-1]) != (0.0, 0.0):
        return None
    left = run.liftoff_times[-1] if len(run.liftoff_times) else -np.inf
    since = run.zeno_times[run.zeno_times > left]
    start = since[-1] if len(since) else max(left, run.t[0])
    return float(start) if start <= latest else None


# Who drives: the sampled closed loop of a plant and a controller.


class Controller(Protocol):
    """Protocol of controllers for `simulate_closed_loop`: a sampling period and a method `step`.

    Optional members, detected at the start of a run:

    - With an attribute ``x_ref`` (m) it has a reference, which the run records; ``xdot_ref`` (m/s)
      too, NaN without. Its ``step`` may then have a fourth argument, the force on the reference
      (m/s^2): ``step(x, xdot, force, force_ref)``.
    - If ``step`` has an argument ``t``, for example ``step(x, xdot, force, t)``, the time of the
      sample (s) is passed as ``t``.
    - With ``reference=`` its method ``step_to(x, xdot, force, now, next, acceleration)`` is called,
      as that of `TwistingTracker`. Without one ``step`` is given the reference at the sample where
      it has arguments called ``x_ref`` and ``xdot_ref``; a ``step`` without them does not receive
      the reference, and the run records the error.
    - A method ``reset(x_ref, xdot_ref)`` is called at the start of a run with ``y_ref0``, which
      cannot be given without it.

    It is not reset otherwise: a user-defined controller, unlike zivi's own, is not copied and
    continues from its present state.

    See Also
    --------
    MechanicalController : controllers of mechanical systems.
    simulate_closed_loop : run a controller.

    Notes
    -----
    Any object with these members is accepted, without inheritance. `step` is called once per
    period, in the order of time.

    Examples
    --------
    >>> class Swinging:
    ...     h = 1e-2
    ...     x_ref = 0.5
    ...
    ...     def step(self, x, xdot, force, t):
    ...         self.x_ref = 0.5 + 0.1 * np.sin(t + self.h)
    ...         return 100.0 * (self.x_ref - x) - 20.0 * xdot - force
    >>> plant = zivi.ImpactSystem(-9.81, e=0.5)
    >>> run = zivi.simulate_closed_loop(plant, Swinging(), (0, 10), (1, 0))
    >>> float(abs(run.error[500:]).max().round(2))
    0.02
    """

    @property
    def h(self) -> float:
        """Sampling period (s)."""

    @property
    def step(self) -> Callable[..., float]:
        """Return the control (m/s^2) for the sampling period that starts now."""


@overload
def simulate_closed_loop(
    system: ImpactSystem,
    controller: Controller,
    t_span: Sequence[float],
    y0: ArrayLike,
    *,
    y_ref0: ArrayLike | None = ...,
    force_ref: Force | None = ...,
    force_model: Force | None = ...,
    reference: Reference | None = ...,
    method: ThetaGamma | SwitchedRK | None = ...,
    noise: Sequence[float] = ...,
    seed: int | None = ...,
    quantization: Sequence[float] = ...,
    delay: int = ...,
    observer: ImpactObserver | None = ...,
    kicks: Kick | Sequence[Kick] | None = ...,
    t_eval: ArrayLike | None = ...,
    events: Event | Sequence[Event] | None = ...,
    dense_output: bool = ...,
    slowest: float = ...,
    progress: bool | None = ...,
    **misplaced: Never,
) -> ClosedLoop: ...
@overload
def simulate_closed_loop(
    system: MechanicalSystem,
    controller: MechanicalController,
    t_span: Sequence[float],
    y0: Sequence[ArrayLike],
    *,
    reference: Any = ...,
    method: SwitchedRK | RKPeriod | None = ...,
    noise: Sequence[float] = ...,
    seed: int | None = ...,
    quantization: float | Sequence[float] = ...,
    delay: int = ...,
    observer: JointObserver | None = ...,
    disturbance: Any = ...,
    kicks: Kick | Sequence[Kick] | None = ...,
    dense_output: bool = ...,
    slowest: float = ...,
    progress: bool | None = ...,
    **misplaced: Never,
) -> MechanicalClosedLoop: ...


@hinted("simulate_closed_loop")
def simulate_closed_loop(
    system: Any,
    controller: Any,
    t_span: Sequence[float],
    y0: Any,
    *,
    y_ref0: ArrayLike | None = None,
    force_ref: Force | None = None,
    force_model: Force | None = None,
    reference: Any = None,
    method: Any = None,
    noise: Sequence[float] = (0.0, 0.0),
    seed: int | None = None,
    quantization: Any = (0.0, 0.0),
    delay: int = 0,
    observer: Any = None,
    disturbance: Any = None,
    kicks: Kick | Sequence[Kick] | None = None,
    t_eval: ArrayLike | None = None,
    events: Event | Sequence[Event] | None = None,
    dense_output: bool = True,
    slowest: float = SLOWEST,
    progress: bool | None = None,
    **misplaced: Never,
) -> ClosedLoop | MechanicalClosedLoop:
    r"""Simulate the sampled closed loop of a plant and a controller.

    At :math:`t_k = t_0 + k h` the state is measured, the controller returns :math:`u_k`, and until
    :math:`t_{k+1}` the plant moves under its force and that control, held:

    .. math:: \ddot x = f(t, x, \dot x) + u_{k-d}, \quad x \ge 0, \quad \dot x^+ = -e\,\dot x^-

    Between samples the motion is exact where the force is constant, through any number of impacts;
    where it depends on time or state, `SwitchedRK` integrates it.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        The plant; its force is the true one. A `MechanicalSystem` moves under :math:`B u` with the
        matrix of its ``inputs``; it takes `reference`, `method`, `noise`, `seed`, `quantization`,
        `delay`, `observer`, `disturbance`, `dense_output`, `slowest`, `progress`.
    controller : Controller or MechanicalController
        Zivi's controllers are copied and run without the interpreter (not subclasses with a
        ``step`` of their own). Any object with ``h`` and ``step(x, xdot, force)`` will do (see
        `Controller`).
    t_span : (float, float)
        Start and end (s), ``t0 < t1``.
    y0 : (float, float) or (array_like, array_like)
        The plant's initial distance from the wall, >= 0 (m), and velocity (m/s); of a
        `MechanicalSystem` its coordinates and velocities ``(q0, qdot0)``.
    y_ref0 : (float, float), optional
        Initial state of the reference: the controller is reset to it. Without it the controller
        continues from its present state.
    force_ref : float, LinearForce or callable, optional
        Force on the reference (m/s^2), at the sample; by default `force_model`. Above a moving
        wall, where everything else is in the wall's frame, so is this force. The reference is
        advanced by implicit Euler steps: it drifts, see "A reference given as a force" in
        follow_reference.md.
    force_model : float, LinearForce or callable, optional
        The force of the controller's model, evaluated at the measured state; by default the true
        force.
    reference : Trajectory, callable or array_like, optional
        The reference itself, in place of `y_ref0` and `force_ref`, for a `TwistingTracker` or a
        controller of the user: a run of `simulate` that covers `t_span`; a function of time
        that gives ``(x_r, xdot_r)``, or ``(x_r, xdot_r, acceleration)``; or these at the samples,
        shape (2, n) or (3, n). Its values at the sample and at the next one are passed to the
        controller; since they are not integrated, they do not drift. It may bounce, rest and lift
        off. A function is called for both ends of each period at its start, so its values may
        change while the loop runs. For a `MechanicalSystem`: a run of the system, such as
        `reference_run` gives, ``"rest"``, or a dict with ``"rest"`` or a run of one mass for each
        gap and a ``"posture"``.
    method : SwitchedRK, ThetaGamma or RKPeriod, optional
        How the plant moves between samples. By default exactly where the force is constant, else
        by ``SwitchedRK(rtol=1e-9, atol=1e-12)``. With `ThetaGamma` the plant is on one grid with
        the controller (the paper's own loop): its ``h`` must be the controller's.
    noise : (float, float)
        Standard deviations of the measured position (m) and velocity (m/s), Gaussian.
    seed : int, optional
        Seed of the noise. A random one is drawn by default; ``config["seed"]`` has its value.
    quantization : (float, float)
        Resolution of the measured position (m) and velocity (m/s); 0 is exact.
    delay : int
        Periods from a measurement to the moment when its control acts, >= 0; until then 0 acts.
        Set the delay in zivi's controllers: with ``delay=`` they predict the state; with ``ahead=1
        + delay`` only the contact-establishing law accounts for it.
    observer : ImpactObserver or JointObserver, optional
        The observer whose estimates replace the measurement: position, velocity, and the unknown
        force, which is added to the model's force. A copy in its present state runs; its input is
        the control that acts, after limits and delay.
    disturbance : array_like or callable, optional
        Forces on the coordinates of a `MechanicalSystem` that the controller does not know: shape
        (n,), or ``d(t, q, qdot)``.
    kicks : Kick or sequence of Kick, optional
        Impulses on the plant at given times (see `simulate`); one at a sample acts after its
        measurement. Without `ThetaGamma`.
    t_eval : array_like, optional
        Increasing times in `t_span` to report instead of the samples (s). ``u``, ``signs`` and
        ``tick_status`` are those of the sample before.
    events : callable or sequence of callables, optional
        Functions ``g(t, x, xdot)`` of the plant's state (see `simulate`). Sign changes are located
        between the samples; each period is scanned in four parts, before and after each impact. The
        run ends at a terminal one, after the control update of the period in which it happens.
    dense_output : bool
        Whether the motion between the samples is kept, ``run(t)``; ``t_eval`` and terminal events
        keep it.
    slowest : float
        The slowest impacts that are listed in ``impacts``, as a part of the fastest one, > 0.
    progress : bool, optional
        Show a progress bar on standard error once a run lasts longer than a second. By default
        only on a terminal.
    **misplaced
        Not accepted: a `TypeError` names the method to which a setting such as ``rtol`` belongs.

    Returns
    -------
    ClosedLoop or MechanicalClosedLoop
        Always valid up to its last sample.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range, before anything is computed.
    Exception
        Whatever a force or the controller raises, and `KeyboardInterrupt`: with the part of the
        run that was computed as the exception's attribute ``trajectory``.

    Warns
    -----
    ModelWarning
        If the controller's `e` differs from the plant's; if `ahead` of its contact-establishing law
        is too small for the delay; if a constant force accelerates a reference without `y_ref0`
        away from the wall; and if more than a tenth of the control updates were rejected, or
        saturated.

    See Also
    --------
    simulate : a run without controller.
    simulate_closed_loop_batch : many closed loops on all cores.
    design_tracker : gains and sampling period of a tracker.

    Notes
    -----
    The plant moves exactly between two samples by `SwitchedRK`, through any number of impacts; the
    cost is that of the plant's run plus one update per period. The noise of a sample depends on
    `seed` and the number of the sample only.

    References
    ----------
    O. Huber and H. B. Oza, Implicit numerical integration for the simulation and control of a
    non-smooth system with resets, IEEE CDC, 2016.

    V. Acary, B. Brogliato and Y. Orlov, Chattering-free digital sliding-mode control with state
    observer and disturbance rejection, IEEE Trans. Automatic Control 57, 2012.

    Examples
    --------
    >>> plant = zivi.ImpactSystem(-9.81, kappa=0.5)
    >>> tracker = zivi.TwistingTracker(30, 17, h=1e-3, kappa=0.5)
    >>> run = zivi.simulate_closed_loop(
    ...     plant, tracker, (0, 2), (6, 5), y_ref0=(3, 3), force_ref=-19.81
    ... )
    >>> float(abs(run.error[-1])), round(float(run.u[-1]), 9)  # at rest, pressed on the wall
    (0.0, -9.69)
    """
    refuse("simulate_closed_loop", misplaced, inspect.signature(simulate_closed_loop).parameters)
    loop = Loop(
        y_ref0=y_ref0, force_ref=force_ref, force_model=force_model, reference=reference,
        method=method, noise=noise, seed=seed, quantization=quantization, delay=delay,
        observer=observer, disturbance=disturbance, kicks=kicks, t_eval=t_eval, events=events,
        dense_output=dense_output, slowest=slowest, progress=progress,
    )  # fmt: skip
    loop.check_for(system)
    one = simulate_mechanical if isinstance(system, MechanicalSystem) else simulate_mass
    run = one(system, controller, t_span, y0, loop)
    run.updates.warn(run.config["controller"]["name"])
    return run


def simulate_mass(
    system: ImpactSystem, controller: Any, t_span: Sequence[float], y0: Any, loop: Loop
) -> ClosedLoop:
    """Simulate the closed loop of a mass, as `simulate_closed_loop` has it."""
    part = check_slowest(loop.slowest)
    check_system(system)
    h, reference = sampling_period(controller), loop.reference
    own, controller = controller, on_wall(with_step_to(controller, reference), system)
    interface = interface_of(controller)
    span = pair("t_span", t_span, "(t0, t1)")
    state = pair("y0", y0, "(x0, xdot0)")
    forces, specs = loop_forces(system, loop.force_model, loop.force_ref)
    check_observer(loop.observer, h)
    follows = {"y_ref0": loop.y_ref0, "force_ref": loop.force_ref}
    check_interface(controller, interface, specs[-1], **follows)
    check_reference(controller, reference, **follows)
    check_stays(controller, not (loop.y_ref0 is None and reference is None), forces["force_ref"])
    told = None if reference is None else spec_of(reference, span, h)
    kappa_ref = real("kappa_ref", getattr(controller, "kappa_ref", system.kappa))
    samples = (max(span[1] - span[0], 0.0) / h if h > 0.0 else 0.0) + 2
    sensor = Sensor.of(loop.noise, loop.quantization, loop.seed, samples, 1)
    periods = check_delay(loop.delay)
    check_ahead(controller, periods, sensor.deviations[1] if loop.observer is None else 0.0)
    check_plant_method(loop.method, h)
    kicked, stops = schedule_of(loop.kicks, system, None, span), np.empty(0)
    if kicked is not None:
        stops = stops_with(kicked, stops, loop.method or SwitchedRK())
        state = state[0], kicked.start(span[0], *state)
    times = None if loop.t_eval is None else times_within(loop.t_eval, span)
    watched = events_of(loop.events)
    if not isinstance(loop.dense_output, bool):
        raise TypeError(f"dense_output must be True or False, got {loop.dense_output!r}")
    if isinstance(controller, CONTROLLERS):
        controller = copy.copy(controller)
    start_ref = None
    if loop.y_ref0 is not None:
        start_ref = pair("y_ref0", loop.y_ref0, "(x_ref0, xdot_ref0)")
        controller.reset(*start_ref)
    config = describe_system(system) | {name: describe(it) for name, it in forces.items()}
    config |= {
        "t_span": list(span),
        "y0": list(state),
        "y_ref0": None if start_ref is None else list(start_ref),
        "reference": None if reference is None else describe_reference(reference),
        "controller": described(own if isinstance(controller, Told) else controller),
        "method": None if loop.method is None else describe(loop.method),
        **sensor.described(),
        "delay": periods,
        **described_observer(loop.observer),
    }
    with ProgressBar(loop.progress) as bar, listening(specs) as ear:
        record = _zivi.simulate_closed_loop(
            controller,
            specs,
            restitution=_zivi.Restitution.of_both(system.e, system.kappa),
            h=h,
            span=span,
            start=_zivi.State(*state),
            **plant_motion(loop.method),
            noise=sensor.of_mass(),
            resolution=sensor.steps,
            delay=periods,
            observer=loop.observer,
            interface=interface,
            ours=has_own_tick(controller),
            dense=loop.dense_output or times is not None or bool(watched),
            given=told,
            restitution_ref=_zivi.Restitution(kappa=kappa_ref),
            events=watched,
            kicks=None if kicked is None else (stops[stops > span[0]], kicked),
            progress=bar.report,
        )
    run, raised = _loop_result(record, config, part), record.raised
    if callable(reference) and isinstance(run._reference, SampledReference):
        # defined between the samples too
        run = dataclasses.replace(run, _reference=GivenReference(reference, run._reference))
    if raised is None and (raised := ear.ends(run.success)):
        run = as_raised(run)
    if run.status is Status.TERMINATED_BY_EVENT:
        run = end_loop_at_event(run, h)
    if times is not None:
        run = restrict_loop(run, times)
    if kicked is not None:
        vars(run)["_kicks"] = kicks_table(kicked.rows, None)
    if raised is None:
        return run
    try:
        raise with_partial(raised, run)
    finally:
        del raised, ear


def _loop_result(record: _zivi.LoopRecord, config: dict[str, Any], slowest: float) -> ClosedLoop:
    t, *sampled = record.columns
    samples: dict[str, Any] = dict(zip(QUANTITIES, sampled, strict=True))
    impacts, wall = impacts_of(record), (config["e"], config["kappa"])
    path, updates = path_of(record, impacts, wall), Updates(*record.updates)
    return ClosedLoop(
        t=t,
        **samples,
        signs=record.signs,  # type: ignore[arg-type]  # an array as soon as it is asked for
        tick_status=record.ticks,
        resolved_impacts=impacts,
        zeno_times=record.zeno_times,
        liftoff_times=record.liftoff_times,
        rest_time=record.rest_time,
        status=Status(record.status),
        message=updates.added_to(record.message),
        nfev=record.nfev,
        config=config,
        **_estimates(record.estimates),
        slowest=slowest,
        updates=updates,
        t_events=[hits.t for hits in record.hits],
        y_events=[np.hstack([hits.q, hits.qdot]) for hits in record.hits],
        _path=path,
        _reference=_reference(t, samples, config),
        _span=(float(t[0]), float(t[-1])) if len(t) else None,
    )


def _estimates(columns: Sequence[Array]) -> dict[str, Any]:
    """Return the columns of an observer's estimates by name; empty without one."""
    if not len(columns[0]):
        return {}
    return dict(zip(ESTIMATES, columns, strict=True))


def _reference(
    t: Array, samples: dict[str, Array], config: dict[str, Any]
) -> SampledReference | None:
    """Return the motion of the reference, None if the controller has none."""
    x = samples["x_ref"]
    if not len(t) or np.isnan(x).all():
        return None
    kappa = config["controller"].get("kappa_ref", config["kappa"])
    return SampledReference(t, x, samples["xdot_ref"], kappa)


# Experiments with controllers that studies can name.


@_registered(
    mu1="m/s^2", mu2="m/s^2", e="1", h="s", x0="m", v0="m/s", disturbance="m/s^2", t_end="s",
    settling_time="s", effort="m/s", peak="m/s^2", error="m", n_refused="1",
)  # fmt: skip
def tracker_gains(
    mu1: float = 30.0,
    mu2: float = 17.0,
    e: float = 1.0 / 3.0,
    h: float = 1e-3,
    x0: float = 6.0,
    v0: float = 5.0,
    disturbance: float = 0.0,
    t_end: float = 3.0,
    tolerance: float = 1e-3,
) -> dict[str, float]:
    """Track a bouncing ball of larger weight through its Zeno point, the paper's task.

    The plant falls with 9.81 m/s^2, the reference, from 3 m with 3 m/s, with 19.81 m/s^2.

    Parameters
    ----------
    mu1, mu2 : float
        Gains on the signs of position and velocity (m/s^2).
    e : float
        Coefficient of restitution of both, 0 < e < 1.
    h : float
        Sampling period (s).
    x0, v0 : float
        Initial height (m) and velocity (m/s) of the plant.
    disturbance : float
        Constant force on the plant that the controller does not know (m/s^2).
    t_end : float
        Length of the run (s).
    tolerance : float
        Position error that counts as settled (m).

    Returns
    -------
    dict
        ``settling_time``, the first sample from which the error stays within `tolerance` to the
        end (s; the start if it always does, NaN if it does not at the end),
        ``effort``, the integral of the absolute control (m/s), ``peak``, the largest absolute
        control (m/s^2), ``error``, the last absolute position error (m), and ``n_refused``, the
        samples that the controller refused.

    Examples
    --------
    >>> found = zivi.study.EXPERIMENTS["tracker_gains"]()
    >>> round(found["settling_time"], 3), found["error"]
    (1.243, 0.0)
    """
    plant = ImpactSystem(-9.81 + disturbance, e=e)
    tracker = TwistingTracker(mu1, mu2, h=h, e=e)
    run = simulate_closed_loop(
        plant,
        tracker,
        (0.0, t_end),
        (x0, v0),
        y_ref0=(3.0, 3.0),
        force_ref=-19.81,
        force_model=-9.81,
        progress=False,
    )
    return {
        "settling_time": _settling_time(run, tolerance),
        "effort": float(h * np.sum(np.abs(run.u[:-1]))),
        "peak": float(np.max(np.abs(run.u))),
        "error": float(abs(run.error[-1])),
        "n_refused": float(run.n_refused),
    }


def _settling_time(run: ClosedLoop, tolerance: float) -> float:
    outside = np.flatnonzero(~(np.abs(run.error) <= tolerance))
    if not len(outside):
        return float(run.t[0])
    last = int(outside[-1])
    return float(run.t[last + 1]) if last + 1 < len(run.t) else math.nan
