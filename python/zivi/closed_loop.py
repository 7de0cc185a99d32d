"""Who drives: the sampled closed loop of a plant and a controller."""

from __future__ import annotations

import copy
import dataclasses
import json
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Never, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi import _zivi
from zivi._check import Array
from zivi._compiled import listening
from zivi._extras import needed
from zivi._loop_arguments import (
    OURS,
    check_delay,
    check_interface,
    check_method,
    check_not_negative,
    described,
    forces_of,
    interface_of,
    is_ours,
    motion_of,
    noise_of,
    period_of,
)
from zivi._misplaced import check_system, refuse
from zivi._progress import ProgressBar
from zivi.control import TickStatus
from zivi.methods import SwitchedRK, ThetaGamma
from zivi.simulate import as_raised, pair, with_partial
from zivi.status import Status
from zivi.system import Force, ImpactSystem
from zivi.trajectory import describe, describe_system, impacts_of

if TYPE_CHECKING:
    import xarray

__all__ = ["ClosedLoop", "Controller", "simulate_closed_loop"]

QUANTITIES = {
    "x": ("m", "distance from the wall"),
    "xdot": ("m/s", "velocity"),
    "x_ref": ("m", "distance of the reference from its wall"),
    "xdot_ref": ("m/s", "velocity of the reference"),
    "u": ("m/s^2", "control, held from the sample on"),
}
"""Unit and meaning of each sampled quantity, in the order of the record's rows after time."""
SIGNS = ("lambda_s", "lambda_v", "lambda_sr", "lambda_vr", "lambda_es", "lambda_ev")
"""Names of the columns of ``signs``."""


class Controller(Protocol):
    """Anything that `simulate_closed_loop` can run: a sampling period and a tick.

    What else it has is found at the start of a run:

    - With an attribute ``x_ref`` (m) it has a reference, which the run records; ``xdot_ref`` (m/s)
      too, NaN without. Its ``step`` may then take a fourth argument, the force on the reference
      (m/s^2): ``step(x, xdot, force, force_ref)``.
    - If ``step`` has an argument called ``t``, as in ``step(x, xdot, force, t)``, it is given the
      time of the sample (s).
    - A method ``reset(x_ref, xdot_ref)`` is called at the start of a run with ``y_ref0``, which
      cannot be given without it.

    Nothing else resets it: a controller of the user, unlike zivi's own, is not copied and goes on
    from where it is.

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
        """Give the control (m/s^2) for the period that starts now, ``step(x, xdot, force)``."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ClosedLoop:
    """Samples and events of one closed loop.

    Attributes
    ----------
    t : ndarray
        Times of the samples (s); all sampled arrays have its length.
    x, xdot : ndarray
        The plant: distance from the wall (m) and velocity (m/s).
    x_ref, xdot_ref : ndarray
        The reference, NaN for a controller without one.
    u : ndarray
        Control that acts on the plant from the sample on (m/s^2); the last one is repeated.
    signs : ndarray, shape (n, 6)
        ``ls, lv, lsr, lvr, les, lev`` of the tick at the sample, NaN where a controller has none.
    tick_status : ndarray of uint8
        What was done at the sample, as the bits of `TickStatus`.
    impacts : structured ndarray
        Fields ``t`` (s), ``xdot_before`` and ``xdot_after`` (m/s); of an accumulation within a
        period at most 1000.
    zeno_times : ndarray
        Times at which the plant came to rest through impacts (s).
    liftoff_times : ndarray
        Times at which it left rest (s).
    rest_time : float or None
        Time from which it stays at rest until the end (s), for a whole period at least: the
        control of the next sample could still lift it.
    status : Status
        How the run ended.
    message : str
        The same in words, with advice.
    nfev : int
        Evaluations of the true force.
    config : dict
        Settings of the run, with the seed of its noise.
    """

    t: Array
    x: Array
    xdot: Array
    x_ref: Array
    xdot_ref: Array
    u: Array
    signs: Array
    tick_status: NDArray[np.uint8]
    impacts: np.ndarray
    zeno_times: Array
    liftoff_times: Array
    rest_time: float | None
    status: Status
    message: str
    nfev: int
    config: dict[str, Any]

    @property
    def success(self) -> bool:
        """Whether the end of ``t_span`` was reached."""
        return self.status is Status.COMPLETED

    @property
    def n_refused(self) -> int:
        """Samples that the controller refused; the last control was held."""
        return int(np.count_nonzero(self.tick_status & TickStatus.REFUSED))

    @property
    def error(self) -> Array:
        """Position error ``x - x_ref`` (m), NaN without a reference."""
        return self.x - self.x_ref

    def __repr__(self) -> str:
        wall = f"{len(self.impacts)} impacts"
        if self.rest_time is not None:
            wall += f", at rest from {self.rest_time:.6g} s"
        name = self.config["controller"]["name"]
        span = f"{self.t[0]:.6g} .. {self.t[-1]:.6g} s" if len(self.t) else "no samples"
        return f"<ClosedLoop {name}, {span}, {wall}: {self.status.name.lower()}>"

    def to_xarray(self) -> xarray.Dataset:
        """Convert to a labelled dataset that can be plotted, selected and saved.

        Returns
        -------
        xarray.Dataset
            The sampled quantities over ``time``, the signs over ``time`` and ``sign``, the
            impacts over ``impact_time``, with units, descriptions and the configuration (JSON)
            in the attributes.
        """
        needed("xarray", "labelled datasets")
        import xarray

        def labelled(dims: Any, values: Any, unit: str, meaning: str) -> Any:
            return dims, values, {"units": unit, "long_name": meaning}

        return xarray.Dataset(
            {
                name: labelled("time", getattr(self, name), unit, meaning)
                for name, (unit, meaning) in QUANTITIES.items()
            }
            | {
                "signs": labelled(("time", "sign"), self.signs, "1", "multipliers of the tick"),
                "tick_status": labelled("time", self.tick_status, "1", "bits of TickStatus"),
                "zeno_time": labelled("zeno", self.zeno_times, "s", "time of a Zeno point"),
                "liftoff_time": labelled("liftoff", self.liftoff_times, "s", "time of a lift-off"),
            }
            | {
                f"impact_{field}": labelled("impact_time", self.impacts[field], "m/s", meaning)
                for field, meaning in (
                    ("xdot_before", "velocity before the impact"),
                    ("xdot_after", "velocity after the impact"),
                )
            },
            coords={
                "time": labelled("time", self.t, "s", "time"),
                "sign": list(SIGNS),
                "impact_time": labelled("impact_time", self.impacts["t"], "s", "time of an impact"),
            },
            attrs={
                "title": "Closed loop of a mechanical system with impacts",
                "source": f"zivi {_zivi.__version__}",
                "config": json.dumps(self.config),
                "status": int(self.status),
                "message": self.message,
                "rest_time": np.nan if self.rest_time is None else self.rest_time,
                "nfev": self.nfev,
            },
        )


def simulate_closed_loop(
    system: ImpactSystem,
    controller: Controller,
    t_span: Sequence[float],
    y0: ArrayLike,
    *,
    y_ref0: ArrayLike | None = None,
    force_ref: Force | None = None,
    force_model: Force | None = None,
    method: ThetaGamma | SwitchedRK | None = None,
    noise: Sequence[float] = (0.0, 0.0),
    seed: int | None = None,
    quantization: Sequence[float] = (0.0, 0.0),
    delay: int = 0,
    progress: bool | None = None,
    **misplaced: Never,
) -> ClosedLoop:
    r"""Simulate the sampled closed loop of a plant and a controller.

    At :math:`t_k = t_0 + k h` the state is measured, the controller gives :math:`u_k`, and until
    :math:`t_{k+1}` the plant moves under its force and that control, held:

    .. math:: \ddot x = f(t, x, \dot x) + u_{k-d}, \quad x \ge 0, \quad \dot x^+ = -e\,\dot x^-

    Between samples the motion is exact where the force is constant, through any number of impacts;
    where it depends on time or state, `SwitchedRK` integrates it.

    Parameters
    ----------
    system : ImpactSystem
        The plant; its force is the true one.
    controller : TwistingTracker, TwistingRegulator, ExplicitTwisting or other
        Zivi's controllers are copied and run without the interpreter (not subclasses with a
        ``step`` of their own). Any object with ``h`` and ``step(x, xdot, force)`` will do (see
        `Controller`).
    t_span : (float, float)
        Start and end (s), ``t0 < t1``.
    y0 : (float, float)
        The plant's initial distance from the wall, >= 0 (m), and velocity (m/s).
    y_ref0 : (float, float), optional
        Initial state of the reference: the controller is reset to it. Without it the controller
        goes on from where it is.
    force_ref : float, LinearForce or callable, optional
        Force on the reference (m/s^2), at the sample; by default `force_model`. Above a moving
        wall, where everything else is in the wall's frame, so is this force. The reference is
        advanced by implicit Euler steps: it drifts, see "A reference given as a force" in
        control.md.
    force_model : float, LinearForce or callable, optional
        The force that the controller believes in, at the measured state; by default the true one.
    method : SwitchedRK or ThetaGamma, optional
        How the plant moves between samples. By default exactly where the force is constant, else
        by ``SwitchedRK(rtol=1e-9, atol=1e-12)``. With `ThetaGamma` the plant is on one grid with
        the controller (the paper's own loop): its ``h`` must be the controller's.
    noise : (float, float)
        Standard deviations of the measured position (m) and velocity (m/s), Gaussian.
    seed : int, optional
        Seed of the noise. A random one is drawn by default; ``config["seed"]`` tells it.
    quantization : (float, float)
        Resolution of the measured position (m) and velocity (m/s); 0 is exact.
    delay : int
        Periods from a measurement to the moment when its control acts, >= 0; until then 0 acts.
        Zivi's controllers should be told: ``ahead=1 + delay``.
    progress : bool, optional
        Show a progress bar on standard error once a run lasts longer than a second. By default
        only on a terminal.
    **misplaced
        Nothing: a `TypeError` says where a setting of a method, such as ``rtol``, belongs.

    Returns
    -------
    ClosedLoop
        Always valid up to its last sample.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range, before anything is computed.
    Exception
        Whatever a force or the controller raises, and `KeyboardInterrupt`: with the part of the
        run that was computed as the exception's attribute ``trajectory``.

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
    refuse("simulate_closed_loop", misplaced)
    check_system(system)
    h = period_of(controller)
    interface = interface_of(controller)
    span = pair("t_span", t_span, "(t0, t1)")
    state = pair("y0", y0, "(x0, xdot0)")
    forces, specs = forces_of(system, force_model, force_ref)
    check_interface(controller, interface, specs[-1], y_ref0=y_ref0, force_ref=force_ref)
    deviations = check_not_negative("noise", noise)
    resolution = check_not_negative("quantization", quantization)
    periods, scheme = check_delay(delay), check_method(method, h)
    seed, samples = noise_of(deviations, seed, span, h)
    if isinstance(controller, OURS):
        controller = copy.copy(controller)
    start_ref = None if y_ref0 is None else pair("y_ref0", y_ref0, "(x_ref0, xdot_ref0)")
    if start_ref is not None:
        following: Any = controller
        following.reset(*start_ref)
    config = (
        describe_system(system)
        | {name: describe(it) for name, it in forces.items()}
        | {
            "t_span": list(span),
            "y0": list(state),
            "y_ref0": None if start_ref is None else list(start_ref),
            "controller": described(controller),
            "method": None if method is None else describe(method),
            "noise": list(deviations),
            "seed": seed,
            "quantization": list(resolution),
            "delay": periods,
        }
    )
    with ProgressBar(progress) as bar, listening(specs) as ear:
        record = _zivi.simulate_closed_loop(
            controller,
            specs,
            wall=(system.e, system.kappa),
            h=h,
            span=span,
            state=state,
            scheme=scheme,
            **motion_of(method),
            noise=samples,
            resolution=resolution,
            delay=periods,
            interface=interface,
            ours=is_ours(controller),
            progress=bar.report,
        )
    run, raised = _run(record, config), record.raised
    # an exception holds this frame: it must not hold the record that holds the exception
    del record
    if raised is None and (raised := ear.ends(run.success)):
        run = as_raised(run)
    del ear
    if raised is not None:
        raise with_partial(raised, run)
    return run


def _run(record: _zivi.LoopRecord, config: dict[str, Any]) -> ClosedLoop:
    t, *sampled = record.columns[: 1 + len(QUANTITIES)]
    return ClosedLoop(
        t=t,
        **dict(zip(QUANTITIES, sampled, strict=True)),
        signs=np.column_stack(record.columns[1 + len(QUANTITIES) :]),
        tick_status=record.ticks,
        impacts=impacts_of(record),
        zeno_times=record.zeno_times,
        liftoff_times=record.liftoff_times,
        rest_time=record.rest_time,
        status=Status(record.status),
        message=record.message,
        nfev=record.nfev,
        config=config,
    )
