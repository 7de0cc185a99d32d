"""Blocks for python-control: a plant with impacts, zivi's controllers, forces.

python-control integrates continuous systems without events, so no impact can be in one. The blocks
here are discrete-time systems with the sampling period as ``dt``: the plant moves exactly, through
any number of impacts, from one sample to the next. `control.interconnect` joins them by the names
of their signals, with each other and with any discrete-time system of the same ``dt``.
"""

from __future__ import annotations

import numbers
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array, real
from zivi.base.extras import needed
from zivi.base.status import ModelWarning
from zivi.control.closed_loop import Controller, simulate_closed_loop
from zivi.control.component import TickStatus
from zivi.control.loop_arguments import Told, asked_of, interface_of, sampling_period
from zivi.control.loop_batch import copy_for_loop
from zivi.control.twisting import CONTROLLERS
from zivi.simulation.methods import SwitchedRK, ThetaGamma
from zivi.system.mass import Force, ImpactSystem

__all__ = ["controller_block", "force_block", "impact_plant", "state_vector"]

STATES = ("s_ref", "v_ref", "side", "held", "ls", "lv", "lsr", "lvr", "les", "lev", "status")
"""Names of what a controller's state holds, in the order of `state_vector`."""


def impact_plant(
    system: ImpactSystem,
    h: float,
    *,
    method: ThetaGamma | SwitchedRK | None = None,
    name: str = "plant",
) -> Any:
    r"""Make a plant with impacts for python-control.

    .. math:: \ddot x = f(t, x, \dot x) + u, \quad x \ge 0, \quad \dot x^+ = -e\,\dot x^-

    with `u` held over each period of length `h`, with the same motion between samples as in
    `zivi.simulate_closed_loop`.

    Parameters
    ----------
    system : ImpactSystem
        The force without the control, and the wall.
    h : float
        Sampling period, > 0 (s): the ``dt`` of the block.
    method : SwitchedRK or ThetaGamma, optional
        How the plant moves between samples. By default exactly where the force is constant, else
        by ``SwitchedRK(rtol=1e-9, atol=1e-12)``. The ``h`` of a `ThetaGamma` must be `h`.
    name : str
        Name of the block.

    Returns
    -------
    control.NonlinearIOSystem
        Input ``u`` (m/s^2); states and outputs ``x`` (m) and ``xdot`` (m/s).

    Raises
    ------
    ValueError, TypeError
        For an argument out of range. Simulating raises `RuntimeError` where the motion fails.
    ImportError
        If python-control is not installed; the message names the command.

    See Also
    --------
    controller_block, force_block : the other blocks of a loop.

    Examples
    --------
    >>> import control  # doctest: +SKIP
    >>> plant = zivi.interop.impact_plant(zivi.ImpactSystem(-9.81, e=0.5), h=0.01)  # doctest: +SKIP
    >>> t = np.arange(201) * 0.01
    >>> response = control.input_output_response(plant, t, 0, [1, 0])  # doctest: +SKIP
    >>> response.states[:, -1]  # at rest after the Zeno point at 1.3546 s  # doctest: +SKIP
    array([0., 0.])
    """
    if not isinstance(system, ImpactSystem):
        raise TypeError(f"system must be a zivi.ImpactSystem, got {type(system).__name__}")
    period = _check_period("h", h)
    # nothing depends on the time: the same period every time, to the last bit
    timeless = isinstance(system.force, numbers.Real) and system.wall is None

    def update(t: float, state: Array, u: Array, params: Any) -> Array:
        start = 0.0 if timeless else float(t)
        return _plant_step(system, period, start, state, float(u[0]), method)

    still = ImpactSystem(0.0, kappa=system.kappa)
    _plant_step(still, period, 0.0, np.zeros(2), 0.0, method)  # a bad method shows here
    return _library().nlsys(
        update,
        lambda t, state, u, params: state,
        inputs=["u"],
        outputs=["x", "xdot"],
        states=["x", "xdot"],
        dt=period,
        name=name,
    )


def controller_block(controller: Controller, *, name: str = "controller") -> Any:
    """Make a controller a block for python-control.

    Start one of zivi's from `state_vector`: it has a state that is not zero. The state of a
    user-defined controller stays in the block: copies in their present state run, and the time must
    not decrease except for a restart.

    Parameters
    ----------
    controller : Controller
        One of zivi's, or one of the user as `Controller` describes it. It is copied; its `h` is
        the ``dt`` of the block.
    name : str
        Name of the block.

    Returns
    -------
    control.NonlinearIOSystem
        Inputs ``x``, ``xdot``, ``force`` (the model's force at the sample) and, of a tracker,
        ``force_ref``. Outputs ``u`` and, of a tracker, ``x_ref`` and ``xdot_ref``. The last state,
        ``status``, holds the bits of `zivi.TickStatus` of the tick before: where a sample was
        ``REFUSED`` the last control is held, the reference waits, and a `ModelWarning` says so.
        The block of a controller of
        the user has no states; it has the input ``force_ref`` and the outputs ``x_ref``,
        ``xdot_ref`` if the controller has these attributes, and the inputs ``x_ref``, ``xdot_ref``
        if it has no reference and these are arguments of its ``step``.

    Raises
    ------
    TypeError
        If `controller` is none of them. Simulating raises `ValueError` from a state that is none
        of a controller.
    ImportError
        If python-control is not installed; the message names the command.

    See Also
    --------
    impact_plant, state_vector : the plant; the initial state.

    Examples
    --------
    >>> tracker = zivi.TwistingTracker(30, 17, h=1e-3, kappa=0.5)
    >>> zivi.interop.controller_block(tracker).input_labels  # doctest: +SKIP
    ['x', 'xdot', 'force', 'force_ref']
    """
    if not isinstance(controller, CONTROLLERS):
        return _own_block(controller, name)
    _controller_state(controller)
    twin: Any = controller.copy()
    follows = hasattr(twin, "x_ref")

    def update(t: float, state: Array, sample: Array, params: Any) -> Array:
        _put(twin, state)
        refused = _tick(twin, sample)
        after = state_vector(twin)
        if refused is not None:
            after[-1] = TickStatus.REFUSED
            warnings.warn(
                f"block {name!r} rejected a sample at t = {t:.9g} s and holds its last control, "
                f"its state 'status' tells where: {refused}",
                ModelWarning,
                stacklevel=2,
            )
        return after

    def output(t: float, state: Array, sample: Array, params: Any) -> Array:
        _put(twin, state)
        reference = (twin.x_ref, twin.xdot_ref) if follows else ()
        _tick(twin, sample)
        return np.array([twin.u, *reference])

    return _library().nlsys(
        update,
        output,
        inputs=["x", "xdot", "force", *(["force_ref"] if follows else [])],
        outputs=["u", *(["x_ref", "xdot_ref"] if follows else [])],
        states=list(STATES),
        dt=_check_period("controller.h", controller.h),
        name=name,
    )


def _own_block(controller: Any, name: str) -> Any:
    period = _check_period("controller.h", sampling_period(controller))
    ticking = _Ticking(controller)
    return _library().nlsys(
        None,
        lambda t, state, sample, params: ticking.at(float(t), sample),
        inputs=[*ticking.given, *ticking.named],
        outputs=["u", *ticking.reference],
        dt=period,
        name=name,
    )


class _Ticking:
    """A controller of the user that is evaluated several times at a sample, and ticks once."""

    def __init__(self, controller: Any) -> None:
        self.named = [] if hasattr(controller, "x_ref") else asked_of(controller)
        # a step with a reference by keyword has no other arguments than the sample
        takes = Told(controller).takes if self.named else interface_of(controller)
        self.given = ["x", "xdot", "force", *(["force_ref"] if takes.get("force_ref") else [])]
        self.reference = [it for it in ("x_ref", "xdot_ref") if takes.get(it)]
        self._timed = takes.get("t", False)
        self._start = copy_for_loop(controller, 0)
        self._t, self._before, self._after = np.nan, self._start, self._start

    def at(self, t: float, sample: Array) -> Array:
        """Return the control, and the reference before the tick."""
        if t != self._t:
            # the last answer at the sample before is the one that counted
            self._before = self._after if t > self._t else self._start
            self._t = t
        reference = [float(getattr(self._before, name)) for name in self.reference]
        self._after = copy_for_loop(self._before, 0)
        values = [float(it) for it in sample]
        count = len(self.given)
        by_name = dict(zip(self.named, values[count:], strict=True))
        by_name |= {"t": t} if self._timed else {}
        return np.array([float(self._after.step(*values[:count], **by_name)), *reference])


def force_block(
    force: Force,
    h: float,
    *,
    inputs: Sequence[str] = ("x", "xdot"),
    output: str = "force",
    name: str | None = None,
) -> Any:
    """Make a python-control block from a force, for the force input of a controller.

    Parameters
    ----------
    force : float, LinearForce or callable
        The force (m/s^2): a number or ``f(t, x, xdot)``.
    h : float
        Sampling period, > 0 (s): the ``dt`` of the block.
    inputs : (str, str)
        Names of the position and velocity that it sees; ``("x_ref", "xdot_ref")`` for the force
        on a reference.
    output : str
        Name of the force; a tracker has the inputs ``"force"`` and ``"force_ref"``.
    name : str, optional
        Name of the block, by default that of its output.

    Returns
    -------
    control.NonlinearIOSystem

    Raises
    ------
    ValueError, TypeError
        For an argument out of range.
    ImportError
        If python-control is not installed; the message names the command.

    Examples
    --------
    >>> spring = zivi.LinearForce(stiffness=4.0)
    >>> zivi.interop.force_block(spring, 1e-3, output="force").ninputs  # doctest: +SKIP
    2
    """
    position, velocity = inputs
    evaluate = _evaluable(force)
    return _library().nlsys(
        None,
        lambda t, state, y, params: np.array([evaluate(float(t), float(y[0]), float(y[1]))]),
        inputs=[position, velocity],
        outputs=[output],
        dt=_check_period("h", h),
        name=output if name is None else name,
    )


def state_vector(controller: Controller) -> Array:
    """Return the state of a controller as numbers: the initial state of its block.

    Parameters
    ----------
    controller : Controller
        A zivi controller in its present state, for example after its `reset`.

    Returns
    -------
    ndarray, shape (11,)
        The reference ``(s_r, v_r)`` and its side, the last control, six signs and the status.

    Raises
    ------
    TypeError
        If `controller` is none of them.

    Examples
    --------
    >>> from zivi.interop import state_vector
    >>> tracker = zivi.TwistingTracker(30, 17, h=1e-3, kappa=0.5)
    >>> tracker.reset(3.0, 3.0)
    >>> [float(number) for number in state_vector(tracker)[:3]]
    [3.0, 6.0, 1.0]
    """
    s, v, side, u, signs, bits = _controller_state(controller)
    return np.array([s, v, side, u, *signs, bits], dtype=float)


class _Held:
    """A controller that holds one value: its loop over one period is the plant's motion."""

    def __init__(self, h: float, u: float) -> None:
        self.h = h
        self._u = u

    def step(self, x: float, xdot: float, force: float) -> float:
        return self._u


def _plant_step(
    system: ImpactSystem,
    h: float,
    t: float,
    state: Array,
    u: float,
    method: ThetaGamma | SwitchedRK | None,
) -> Array:
    if not np.isfinite(u):
        raise RuntimeError(
            f"the plant cannot move on from t = {t:.9g} s: u must be finite, got {u}"
        )
    run = simulate_closed_loop(
        system,
        _Held(h, u),
        (t, t + h),
        (float(state[0]), float(state[1])),
        force_model=0.0,
        method=method,
        progress=False,
    )
    if not run.success:
        raise RuntimeError(f"the plant cannot move on from t = {t:.9g} s: {run.message}")
    return np.array([run.x[-1], run.xdot[-1]])


def _controller_state(controller: Any) -> tuple[Any, ...]:
    """Return the state of a controller of ours."""
    state = None if isinstance(controller, type) else getattr(controller, "state", None)
    if not (isinstance(state, tuple) and len(state) == 6 and hasattr(controller, "copy")):
        raise TypeError(
            "controller must be one of zivi's, e.g. zivi.TwistingTracker(30, 17, h=1e-3, e=0.5), "
            f"got {controller!r}"
        )
    return state


def _put(controller: Any, state: Array) -> None:
    """Set the state of a controller to the state of its block."""
    *plain, status = map(float, state)
    try:
        bits = int(status) & ~int(TickStatus.REFUSED)  # plain numbers: at every tick
        controller.state = (*plain[:4], plain[4:], bits)
    except ValueError:
        raise ValueError(
            "the state of a controller's block must be one of a controller: start from "
            f"zivi.interop.state_vector(controller), got {state}"
        ) from None


def _tick(controller: Any, sample: Array) -> ValueError | None:
    """Tick; where the sample is rejected nothing has changed, and this is why."""
    try:
        controller.step(*map(float, sample))
    except ValueError as error:
        return error
    return None


def _check_period(name: str, h: Any) -> float:
    period = real(name, h)
    if not 0.0 < period < np.inf:
        raise ValueError(f"{name} must be > 0 and finite, got {h}")
    return period


def _evaluable(force: Any) -> Callable[[float, float, float], float]:
    if isinstance(force, numbers.Real):
        constant = real("force", force)
        return lambda t, x, xdot: constant
    function = getattr(force, "ctypes", force)  # a numba cfunc is called through it
    if not callable(function):
        raise TypeError(
            f"force must be a number or callable as f(t, x, xdot), got {type(force).__name__}"
        )
    return lambda t, x, xdot: float(function(t, x, xdot))


def _library() -> Any:
    return needed("control", "zivi.interop's blocks")
