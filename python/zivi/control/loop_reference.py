"""References that a closed loop is given: a run, a function of time, or values at the samples."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, real_array
from zivi.control.loop_path import SampledReference, on_side
from zivi.control.twisting import CONTROLLERS
from zivi.simulation.dense import Path
from zivi.simulation.describe import describe
from zivi.simulation.trajectory import Trajectory

__all__ = [
    "GivenReference",
    "Reference",
    "asked_of",
    "check_reference",
    "describe_reference",
    "rows_of",
    "spec_of",
    "told_of",
]

Reference: TypeAlias = Trajectory | Callable[[float], Sequence[float]] | ArrayLike
"""A run; ``(x_r, xdot_r)`` or ``(x_r, xdot_r, acceleration)`` of time; or these at the samples."""

Spec: TypeAlias = "Array | Callable[[float], tuple[float, float, float]]"
"""As the extension takes it: rows of x, xdot, branch (0 unknown), acceleration (NaN unknown)."""

SLOWEST = 1e-12
"""Speed of the slowest impact whose jump is told from the acceleration (m/s)."""


def check_reference(controller: Any, reference: Any, **others: Any) -> None:
    """Refuse a reference for a controller that takes none, and what is given beside it."""
    if reference is None:
        return
    for name, value in others.items():
        if value is not None:
            raise TypeError(f"{name} belongs to a reference that the controller advances itself")
    if isinstance(controller, CONTROLLERS) and not callable(getattr(controller, "step_to", None)):
        kind = type(controller).__name__
        raise TypeError(
            "reference= needs a controller with step_to, such as zivi.TwistingTracker, or one of "
            f"your own, got {kind}"
        )


def asked_of(controller: Any) -> list[str]:
    """Name what the step of a controller of the user asks of a reference that it is given."""
    try:
        parameters = inspect.signature(controller.step).parameters
    except (TypeError, ValueError):  # a builtin that does not tell
        return []
    return [name for name in ("x_ref", "xdot_ref") if name in parameters]


class Told:
    """A controller of the user without ``step_to``: its step is told the reference by name."""

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


def told_of(controller: Any, reference: Any) -> Any:
    """Give a controller of the user that has no ``step_to`` one, if there is a reference."""
    ours = reference is None or isinstance(controller, CONTROLLERS)
    return controller if ours or hasattr(controller, "step_to") else Told(controller)


def describe_reference(reference: Any) -> str:
    """Tell what a reference is."""
    if isinstance(reference, Trajectory):
        return "a zivi.Trajectory"
    return str(describe(reference)) if callable(reference) else "values at the samples"


def spec_of(reference: Any, span: tuple[float, float], h: float) -> Spec:
    """Translate a reference: a function stays one, all else is known at the samples."""
    if callable(reference) and not isinstance(reference, Trajectory):
        return _function(reference)
    return rows_of(reference, span, h)


def rows_of(reference: Any, span: tuple[float, float], h: float) -> Array:
    """Give a reference at the samples, also a function."""
    times = _zivi.grid_times(*span, h, 1)
    if isinstance(reference, Trajectory):
        return _of_run(reference, times)
    if callable(reference):
        function = _function(reference)
        called = np.array([function(float(t)) for t in times])
        return np.column_stack([called[:, :2], np.zeros(len(times)), called[:, 2]])
    return _of_array(reference, times)


def _of_run(run: Trajectory, times: Array) -> Array:
    """Give a run at the samples, with its branch and its mean acceleration in each period."""
    start, end = run._extent()
    if not (start <= times[0] and times[-1] <= end):
        raise ValueError(
            f"reference must be known over t_span = ({times[0]}, {times[-1]}), "
            f"it is a run over ({start}, {end})"
        )
    *moves, pull = sampled_run(run, times)
    return np.column_stack([*moves, np.append(pull, np.nan)])


def sampled_run(run: Trajectory, times: Array) -> tuple[Array, Array, Array, Array]:
    """Give position, velocity and branch at the times, and the mean acceleration between them."""
    x, xdot = run(times)
    s, v = run._known().lifted(times)
    impacts = run.impacts_down_to(SLOWEST)
    jumps = np.append(0.0, np.cumsum(impacts["xdot_after"] - impacts["xdot_before"]))
    before = jumps[np.searchsorted(impacts["t"], times, side="right")]
    pull = np.diff(xdot - before) / np.diff(times)
    return x, xdot, np.where(s == 0.0, np.sign(v), np.sign(s)), pull


def _of_array(reference: Any, times: Array) -> Array:
    values = real_array("reference", reference)
    n = len(times)
    if values.ndim == 2 and values.shape[0] not in (2, 3) and values.shape[0] == n:
        values = values.T
    if values.ndim != 2 or values.shape[0] not in (2, 3) or values.shape[1] != n:
        raise ValueError(
            f"reference must have shape (2, {n}) or (3, {n}): x_r, xdot_r and, where it is known, "
            f"the acceleration at the {n} samples, got {np.shape(reference)}"
        )
    _check("reference", values)
    pull = values[2] if len(values) == 3 else np.full(n, np.nan)
    return np.column_stack([values[0], values[1], np.zeros(n), pull])


def _check(name: str, values: Array) -> None:
    if not (np.all(np.isfinite(values)) and np.all(values[0] >= 0.0)):
        raise ValueError(f"{name} must be finite, with x_r >= 0")


def _function(reference: Callable[[float], Sequence[float]]) -> Callable[[float], Any]:
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
        What it was at the samples: this is stored.
    """

    source: Any
    sampled: SampledReference

    def __reduce__(self) -> tuple[Any, ...]:
        # a function need not outlive its run
        it = self.sampled
        return SampledReference, (it.t, it.x, it.xdot, it.kappa)

    def physical(self, times: Array) -> tuple[Array, Array]:
        """Give ``(x_r, xdot_r)``."""
        if isinstance(self.source, Trajectory):
            path: Path = self.source._known()
            return path.physical(times)
        function = _function(self.source)
        x, xdot, _ = np.array([function(float(t)) for t in times]).reshape(-1, 3).T
        return x, xdot

    def lifted(self, times: Array) -> tuple[Array, Array]:
        """Give ``(s_r, v_r)``."""
        if isinstance(self.source, Trajectory):
            path: Path = self.source._known()
            return path.lifted(times)
        x, xdot = self.physical(times)
        s, _ = self.sampled.lifted(times)
        side = np.where(s == 0.0, 1.0, np.sign(s))
        return on_side(x, xdot, side, self.sampled.kappa)
