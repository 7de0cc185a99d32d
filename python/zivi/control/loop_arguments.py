"""Arguments of closed loops: references, models, noise; validation."""

from __future__ import annotations

import contextlib
import dataclasses
import inspect
import math
import numbers
import weakref
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, real, real_array
from zivi.base.status import warn
from zivi.control.loop_run import SampledReference, on_side
from zivi.control.observer import ImpactObserver
from zivi.control.twisting import CONTROLLERS
from zivi.simulation.dense import DenseMotion
from zivi.simulation.events import SLOWEST
from zivi.simulation.methods import SwitchedRK, ThetaGamma
from zivi.simulation.run import argument_text, pair
from zivi.simulation.trajectory import Trajectory, describe
from zivi.system.mass import ImpactSystem, LinearForce, force_spec, in_wall_frame
from zivi.system.mechanism import MechanicalSystem

# What a closed loop is given beside its plant, its controller, its span and its initial state.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Loop:
    """The arguments of `simulate_closed_loop`, of a mass or of a mechanical system."""

    y_ref0: Any = None
    force_ref: Any = None
    force_model: Any = None
    reference: Any = None
    method: Any = None
    noise: Any = (0.0, 0.0)
    seed: Any = None
    quantization: Any = (0.0, 0.0)
    delay: Any = 0
    observer: Any = None
    disturbance: Any = None
    kicks: Any = None
    t_eval: Any = None
    events: Any = None
    dense_output: bool = True
    slowest: float = SLOWEST
    progress: bool | None = None

    def check_for(self, system: Any) -> None:
        """Reject arguments of the loop of the other kind of system."""
        if not isinstance(system, MechanicalSystem):
            if self.disturbance is not None:
                raise TypeError(
                    "disturbance is for a zivi.MechanicalSystem: here system.force is true"
                )
            return
        for name in ("y_ref0", "force_ref", "force_model", "t_eval", "events"):
            if getattr(self, name) is not None:
                raise TypeError(f"{name} is for a zivi.ImpactSystem, not for a MechanicalSystem")


# References that a closed loop is given: a run, a function of time, or values at the samples.

Reference: TypeAlias = Trajectory | Callable[[float], Sequence[float]] | ArrayLike
"""A run; ``(x_r, xdot_r)`` or ``(x_r, xdot_r, acceleration)`` of time; or these at the samples."""

Spec: TypeAlias = "Array | Callable[[float], tuple[float, float, float]]"
"""As the extension takes it: rows of x, xdot, branch (0 unknown), acceleration (NaN unknown)."""

SLOWEST_JUMP = 1e-12
"""Speed of the slowest impact whose jump is told from the acceleration (m/s)."""


def check_reference(controller: Any, reference: Any, **others: Any) -> None:
    """Reject a reference for a controller without one, and arguments that conflict with it."""
    if reference is None:
        return
    for name, value in others.items():
        if value is not None:
            raise TypeError(f"{name} must be None with reference=, got a value; use one of them")
    if isinstance(controller, CONTROLLERS) and not callable(getattr(controller, "step_to", None)):
        kind = type(controller).__name__
        raise TypeError(
            "reference= needs a controller with step_to, such as zivi.TwistingTracker, or one of "
            f"your own, got {kind}"
        )


def asked_of(controller: Any) -> list[str]:
    """List the reference arguments of a user-defined controller's ``step``."""
    try:
        parameters = inspect.signature(controller.step).parameters
    except (TypeError, ValueError):  # a builtin that does not tell
        return []
    return [name for name in ("x_ref", "xdot_ref") if name in parameters]


class Told:
    """A user-defined controller without ``step_to``: its step gets the reference by keyword."""

    takes: ClassVar[dict[str, bool]] = {}
    """Of what `interface_of` finds, nothing beside the sample."""

    def __init__(self, controller: Any) -> None:
        self.controller, self.h = controller, controller.h
        for name in ("e", "kappa_ref"):
            if hasattr(controller, name):
                setattr(self, name, getattr(controller, name))
        self._names = asked_of(controller)
        try:
            signature = inspect.signature(controller.step)
            signature.bind(0.0, 0.0, 0.0, **dict.fromkeys(self._names, 0.0))
        except ValueError:  # a builtin that does not tell
            return
        except TypeError:
            raise TypeError(
                "with reference= the step of a controller takes (x, xdot, force), x_ref and "
                "xdot_ref if it wants them; one that needs more has step_to. That of "
                f"{type(controller).__name__} takes {signature}"
            ) from None

    def step(self, x: float, xdot: float, force: float) -> float:
        """Do not tick: with a reference only `step_to` is called."""
        raise NotImplementedError

    def step_to(
        self, x: float, xdot: float, force: float, now: Any, following: Any, acceleration: Any
    ) -> Any:
        """Tick with the reference at the sample."""
        known = dict(zip(("x_ref", "xdot_ref"), now, strict=False))
        return self.controller.step(x, xdot, force, **{name: known[name] for name in self._names})


def with_step_to(controller: Any, reference: Any) -> Any:
    """Return a user-defined controller with a ``step_to``, if there is a reference."""
    ours = reference is None or isinstance(controller, CONTROLLERS)
    return controller if ours or hasattr(controller, "step_to") else Told(controller)


def describe_reference(reference: Any) -> str:
    """Describe a reference."""
    if isinstance(reference, Trajectory):
        return "a zivi.Trajectory"
    return str(describe(reference)) if callable(reference) else "values at the samples"


def spec_of(reference: Any, span: tuple[float, float], h: float) -> Spec:
    """Translate a reference: a function stays one, all else is known at the samples."""
    if callable(reference) and not isinstance(reference, Trajectory):
        return _checked_function(reference)
    return at_samples(reference, span, h)


def at_samples(reference: Any, span: tuple[float, float], h: float) -> Array:
    """Return a reference at the samples, also a function."""
    times = _zivi.grid_times(*span, h, 1)
    if isinstance(reference, Trajectory):
        return _rows_of_run(reference, times)
    if callable(reference):
        function = _checked_function(reference)
        called = np.array([function(float(t)) for t in times])
        return np.column_stack([called[:, :2], np.zeros(len(times)), called[:, 2]])
    return _rows_of_array(reference, times)


def _rows_of_run(run: Trajectory, times: Array) -> Array:
    """Return a run at the samples, with its branch and its mean acceleration in each period."""
    start, end = run._extent()
    if not (start <= times[0] and times[-1] <= end):
        raise ValueError(
            f"reference must be known over t_span = ({times[0]}, {times[-1]}), "
            f"it is a run over ({start}, {end})"
        )
    *moves, pull = sampled_run(run, times)
    return np.column_stack([*moves, np.append(pull, np.nan)])


def sampled_run(run: Trajectory, times: Array) -> tuple[Array, Array, Array, Array]:
    """Return position, velocity and branch at the times, and the mean acceleration between them."""
    x, xdot = run(times)
    s, v = run._known().lifted(times)
    impacts = run.impacts_down_to(SLOWEST_JUMP)
    jumps = np.append(0.0, np.cumsum(impacts["xdot_after"] - impacts["xdot_before"]))
    before = jumps[np.searchsorted(impacts["t"], times, side="right")]
    pull = np.diff(xdot - before) / np.diff(times)
    return x, xdot, np.where(s == 0.0, np.sign(v), np.sign(s)), pull


def _rows_of_array(reference: Any, times: Array) -> Array:
    values = real_array("reference", reference)
    n = len(times)
    if values.ndim == 2 and values.shape[0] not in (2, 3) and values.shape[0] == n:
        values = values.T
    if values.ndim != 2 or values.shape[0] not in (2, 3) or values.shape[1] != n:
        raise ValueError(
            f"reference must have shape (2, {n}) or (3, {n}): x_r, xdot_r and optionally the "
            f"acceleration at the {n} samples, got {np.shape(reference)}"
        )
    _check_samples("reference", values)
    pull = values[2] if len(values) == 3 else np.full(n, np.nan)
    return np.column_stack([values[0], values[1], np.zeros(n), pull])


def _check_samples(name: str, values: Array) -> None:
    if not (np.all(np.isfinite(values)) and np.all(values[0] >= 0.0)):
        raise ValueError(f"{name} must be finite, with x_r >= 0")


def _checked_function(reference: Callable[[float], Sequence[float]]) -> Callable[[float], Any]:
    def called(t: float) -> tuple[float, float, float]:
        answer: Any = reference(t)
        try:
            values = [float(it) for it in answer]
        except TypeError:
            values = []
        if len(values) not in (2, 3):
            raise TypeError(
                "reference(t) must give (x_r, xdot_r) or (x_r, xdot_r, acceleration), "
                f"got {answer!r}"
            )
        if not (all(map(np.isfinite, values)) and values[0] >= 0.0):
            raise ValueError(
                f"reference(t) must give finite numbers, x_r >= 0, got {answer!r} at t = {t}"
            )
        x, xdot, *known = values
        return x, xdot, known[0] if known else np.nan

    return called


@dataclasses.dataclass(frozen=True)
class GivenReference:
    """The motion of a given reference between the samples.

    Parameters
    ----------
    source : Trajectory or callable
        What was given.
    sampled : SampledReference
        Its values at the samples, which are stored.
    """

    source: Any
    sampled: SampledReference

    def __reduce__(self) -> tuple[Any, ...]:
        # a function need not outlive its run
        it = self.sampled
        return SampledReference, (it.t, it.x, it.xdot, it.kappa)

    def physical(self, times: Array) -> tuple[Array, Array]:
        """Return ``(x_r, xdot_r)``."""
        if isinstance(self.source, Trajectory):
            path: DenseMotion = self.source._known()
            return path.physical(times)
        function = _checked_function(self.source)
        x, xdot, _ = np.array([function(float(t)) for t in times]).reshape(-1, 3).T
        return x, xdot

    def lifted(self, times: Array) -> tuple[Array, Array]:
        """Return ``(s_r, v_r)``."""
        if isinstance(self.source, Trajectory):
            path: DenseMotion = self.source._known()
            return path.lifted(times)
        x, xdot = self.physical(times)
        s, _ = self.sampled.lifted(times)
        side = np.where(s == 0.0, 1.0, np.sign(s))
        return on_side(x, xdot, side, self.sampled.kappa)


# What is requested of a closed loop: its arguments, checked and translated.

BETWEEN_SAMPLES = SwitchedRK(rtol=1e-9, atol=1e-12)
"""Method that moves a plant between samples."""


def loop_forces(
    system: ImpactSystem, force_model: Any, force_ref: Any
) -> tuple[dict[str, Any], list[_zivi.Force]]:
    """Return the forces on the plant, in the model and on the reference, and their specs."""
    forces = {
        "force": system.force,
        "force_model": system.force if force_model is None else force_model,
    }
    # in the frame of a moving wall, which the controller knows
    specs = [in_wall_frame(system, force_spec(force, name)) for name, force in forces.items()]
    specs.append(specs[-1] if force_ref is None else force_spec(force_ref, "force_ref"))
    forces["force_ref"] = forces["force_model"] if force_ref is None else force_ref
    return forces, specs


def plant_motion(method: ThetaGamma | SwitchedRK | None) -> dict[str, Any]:
    """Return the plant's integration between samples, for the extension."""
    return {
        "method": (BETWEEN_SAMPLES if method is None else method)._core,
        "exact": method is None,
    }


def sampling_period(controller: Any) -> float:
    """Return the sampling period of a controller; raise if it cannot run as one."""
    if isinstance(controller, type) or not (
        hasattr(controller, "h") and callable(getattr(controller, "step", None))
    ):
        raise TypeError(
            "controller must have a sampling period 'h' and a method 'step', "
            f"e.g. zivi.TwistingTracker(30, 17, h=1e-3, e=0.5), got {controller!r}"
        )
    return real("controller.h", controller.h)


def on_wall(controller: Any, system: ImpactSystem) -> Any:
    """Return the controller with the plant's `e` if it has none; warn if the two differ."""
    if isinstance(controller, CONTROLLERS):
        controller = controller._on(system.kappa)
    believed = getattr(controller, "e", system.e)
    if isinstance(believed, numbers.Real) and abs(float(believed) - system.e) > SAME_E:
        warn(
            f"the controller believes in e = {believed:.6g}, the plant has e = {system.e:.6g}: "
            "without e it takes the plant's"
        )
    return controller


def check_stays(controller: Any, placed: bool, force_ref: Any) -> None:
    """Warn of a default reference that its force accelerates away from the wall."""
    pull = force_ref
    if isinstance(force_ref, LinearForce):
        held = force_ref.stiffness != 0.0 or force_ref.excitation is not None
        pull = None if held else -force_ref.gravity - abs(force_ref.amplitude)
    outward = isinstance(pull, numbers.Real) and float(pull) > 0.0
    follows = isinstance(controller, CONTROLLERS) and hasattr(controller, "x_ref")
    if outward and follows and not placed:
        warn(
            f"the reference flies off: the force on it pulls away from the wall ({pull:.6g} m/s^2 "
            "and more); give reference=, or y_ref0= and force_ref="
        )


SAME_E = 1e-12
"""Difference of two `e` that is one of rounding, as between an `e` and a `kappa`."""


def check_delay(delay: Any) -> int:
    """Return a number of periods."""
    if isinstance(delay, bool) or not isinstance(delay, int | np.integer):
        raise TypeError(f"delay must be a whole number of periods, got {delay!r}")
    if not 0 <= delay <= MAX_DELAY:
        raise ValueError(f"delay must be >= 0 periods and at most {MAX_DELAY:.0e}, got {delay}")
    return int(delay)


def check_predicted(own: int, delay: int) -> None:
    """Warn of a controller that predicts over another delay than the loop's."""
    if own and own != delay:
        warn(f"the controller predicts over delay = {own}, the loop has delay = {delay}")


def check_ahead(controller: Any, delay: int, noise: float = 0.0) -> None:
    """Warn if the contact-establishing law looks ahead by less than the delay of its control.

    Under noise of the velocity the brake of a late loop, ``v' = -v(t - d h)/(N h)``, swings over
    unless ``N >= (1 + d)^(1 + d)/d^d``; a dead zone does as well.
    """
    it: Any = controller
    own = getattr(it, "delay", 0) if isinstance(controller, CONTROLLERS) else 0
    text = ""
    if own:
        return check_predicted(own, delay)
    if not (delay and isinstance(controller, CONTROLLERS) and getattr(it, "landing", False)):
        return
    elif it.ahead < 1 + delay:
        text = f"a landing may never rest: ahead = {it.ahead}, but 1 + delay = {1 + delay}"
    elif noise > 0.0 and it.quiet == 0.0 and it.e >= NEAR_ELASTIC and it.ahead < calm(delay):
        text = (
            f"under noise a landing with ahead = {it.ahead} and delay = {delay} may never rest at "
            f"e = {it.e:.6g}: give it quiet (5 deviations of the velocity), or ahead={calm(delay)}"
        )
    if text:
        warn(text)


NEAR_ELASTIC = 0.9
"""`e` from which a brake that swings over may keep a mass from rest under noise."""


def calm(delay: int) -> int:
    """Return the least horizon whose late brake does not swing over."""
    return math.ceil((1 + delay) * (1.0 + 1.0 / delay) ** delay)


MAX_DELAY = 10**9
"""Periods of the longest run."""


def check_not_negative(name: str, value: Sequence[float]) -> tuple[float, float]:
    """Return two numbers >= 0."""
    first, second = pair(name, value, "(of x, of xdot)")
    for number in (first, second):
        if not (number >= 0.0 and np.isfinite(number)):
            raise ValueError(f"{name} must be two finite numbers >= 0, got {value!r}")
    return first, second


@dataclasses.dataclass(frozen=True, eq=False)
class Sensor:
    """Sensor of a loop: deviations and seed of its noise, resolutions, and the noise.

    Parameters
    ----------
    deviations, steps : (float, float)
        Standard deviations and resolutions of coordinates and of velocities.
    noise : ndarray or None
        Noise of the samples, shape (k, 2, n); None without noise.
    seed : int or None
        Seed of the noise.
    """

    deviations: tuple[float, float]
    steps: tuple[float, float]
    noise: Array | None
    seed: int | None

    @classmethod
    def of(cls, noise: Any, quantization: Any, seed: Any, count: float, n: int) -> Sensor:
        """Read the arguments of a loop, and draw the noise of all samples."""
        deviations = check_not_negative("noise", noise)
        steps = check_not_negative("quantization", quantization)
        known = None if seed is None else check_seed(seed)
        if deviations == (0.0, 0.0):
            return cls(deviations, steps, None, known)
        source = np.random.SeedSequence(known)
        if not count * n <= MAX_NOISE:
            text = f"noise is drawn for at most {MAX_NOISE:.0e} samples, got {count * n:.3g}"
            raise ValueError(text)
        # sample by sample: a longer run with the same seed begins alike
        draws = np.random.default_rng(source).standard_normal((int(count), 2, n))
        entropy = source.entropy
        drawn = int(entropy) if isinstance(entropy, int) else None
        return cls(deviations, steps, draws * np.array(deviations)[:, None], drawn)

    def of_mass(self) -> tuple[Array, Array]:
        """Return the noise of position and velocity of one mass; empty without noise."""
        if self.noise is None:
            return np.empty(0), np.empty(0)
        x, xdot = np.ascontiguousarray(self.noise[..., 0].T)
        return x, xdot

    def described(self) -> dict[str, Any]:
        """Return deviations, resolutions and seed for the settings of a run."""
        return {"noise": [*self.deviations], "quantization": [*self.steps], "seed": self.seed}


def check_seed(seed: Any) -> int:
    """Return a seed of the noise."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer):
        raise TypeError(f"seed must be a whole number >= 0, got {seed!r}")
    if seed < 0:
        raise ValueError(f"seed must be a whole number >= 0, got {seed}")
    return int(seed)


MAX_NOISE = 1e8
"""Samples up to which noise is drawn: 1.6 GB."""


def has_own_tick(controller: Any) -> bool:
    """Whether the ticks are those of one of our classes, not those of a subclass."""
    kind = type(controller)
    return any(
        issubclass(kind, base)
        and all(
            getattr(kind, name, None) is getattr(base, name, None)
            for name in ("step", "x_ref", "xdot_ref")
        )
        for base in CONTROLLERS
    )


def interface_of(controller: Any) -> dict[str, bool]:
    """Return the interface of a controller: its reference, and the arguments of its step.

    The force of the reference is the fourth argument by position of a controller that has one;
    the time is an argument that is called ``t``.
    """
    follows = hasattr(controller, "x_ref")
    has = {"x_ref": follows, "xdot_ref": hasattr(controller, "xdot_ref")}
    step = controller.step
    if not inspect.isbuiltin(step):
        return has | _taken_by(controller, follows)
    # the signature of a native step is text that Python parses: once for each class
    known = _NATIVE.setdefault(type(step.__self__), {})
    if follows not in known:
        known[follows] = _taken_by(controller, follows)
    return has | known[follows]


_NATIVE: weakref.WeakKeyDictionary[type, dict[bool, dict[str, bool]]]
_NATIVE = weakref.WeakKeyDictionary()


def _taken_by(controller: Any, follows: bool) -> dict[str, bool]:
    """Return the arguments of a step other than the sample."""
    try:
        signature = inspect.signature(controller.step)
    except (TypeError, ValueError):  # a builtin that does not tell
        return {"force_ref": follows, "t": False}
    kind = inspect.Parameter
    t = signature.parameters.get("t")
    timed = t is not None and t.kind in (kind.POSITIONAL_OR_KEYWORD, kind.KEYWORD_ONLY)
    named = {"t": 0.0} if timed else {}
    for count in (4, 3) if follows else (3,):
        with contextlib.suppress(TypeError):
            signature.bind(*count * (0.0,), **named)
            return {"force_ref": count == 4, "t": timed}
    more = "force_ref" if follows else "force_ref if it has an attribute x_ref"
    raise TypeError(
        f"controller.step must take (x, xdot, force), then {more}, then t if it wants the time; "
        f"that of {type(controller).__name__} takes {signature}"
    )


def check_interface(
    controller: Any, interface: dict[str, bool], spec_ref: _zivi.Force, **given: Any
) -> None:
    """Reject what a controller cannot be given; `spec_ref` is the force on its reference."""
    check_follows(controller, **given)
    kind = type(controller).__name__
    if given["force_ref"] is not None and not interface["force_ref"]:
        raise TypeError(f"force_ref must be None: the step of {kind} has no argument for it")
    if given["y_ref0"] is not None and not callable(getattr(controller, "reset", None)):
        raise TypeError(
            f"y_ref0 must be None: {kind} does not have a method reset(x_ref, xdot_ref)"
        )
    if interface["force_ref"] and not interface["xdot_ref"] and not spec_ref.is_constant:
        raise TypeError(
            f"the force on the reference may depend on its velocity, but {kind} does not have "
            "xdot_ref: add it, or use a step(x, xdot, force)"
        )


def check_follows(controller: Any, **given: Any) -> None:
    """Reject arguments of a reference, unless they are None, for a controller without one."""
    for name, value in given.items():
        if value is not None and not hasattr(controller, "x_ref"):
            kind = type(controller).__name__
            raise TypeError(f"{name} must be None: {kind} does not follow a reference")


def check_plant_method(method: ThetaGamma | SwitchedRK | None, h: float) -> None:
    """Reject a motion between samples that is none, or is not on the controller's grid."""
    if method is None or isinstance(method, SwitchedRK):
        return
    if not isinstance(method, ThetaGamma) or method.solver != "exact":
        raise TypeError(
            "method must be None, a zivi.SwitchedRK or an exact zivi.ThetaGamma, "
            f"got {argument_text(method)}"
        )
    if method.h != h:
        raise ValueError(f"method.h must be the controller's h = {h}, got {method.h}")


def described(controller: Any) -> dict[str, Any]:
    """Plain values that tell a controller again."""
    settings = getattr(controller, "settings", {})
    return {"name": type(controller).__name__, **(settings if isinstance(settings, dict) else {})}


def check_observer(observer: Any, h: float) -> None:
    """Reject what is no observer of ours, or one of another period."""
    if observer is None:
        return
    if type(observer) is not ImpactObserver:
        raise TypeError(f"observer must be a zivi.ImpactObserver, got {argument_text(observer)}")
    if observer.h != h:
        raise ValueError(f"observer.h must be the controller's h = {h}, got {observer.h}")


def described_observer(observer: Any) -> dict[str, Any]:
    """Plain values that tell an observer again; nothing without one."""
    if observer is None:
        return {}
    settings = observer.settings
    return {"observer": {**settings, "noise": list(settings["noise"])}}
