"""What controllers of mechanisms share that believe in a model of their plant."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, real_array
from zivi.control.believed_plant import BelievedPlant
from zivi.control.u_limits import limits_of
from zivi.system.control_inputs import ControlInputs
from zivi.system.mechanism import MechanicalSystem

__all__ = ["ModelBased", "believed", "check_believes"]


class ModelBased:
    """Settings, a model, its prediction over a delay, and the last controls.

    Parameters
    ----------
    system : MechanicalSystem
        What the plant is believed to be.
    settings : dict
        The arguments of the constructor, with ``h``, ``delay`` and ``u_limits``.
    """

    _law: Any

    def __init__(self, system: MechanicalSystem, settings: dict[str, Any]) -> None:
        self.system = system
        self._settings = {**settings, "u_limits": limits_of(settings["u_limits"])}
        self._inputs: ControlInputs | None = None
        self._believed: BelievedPlant | None = None

    @property
    def h(self) -> float:
        """Sampling period (s)."""
        return float(self._settings["h"])

    @property
    def delay(self) -> int:
        """Periods from a measurement to the moment when its control acts."""
        return int(self._settings["delay"])

    @property
    def settings(self) -> dict[str, Any]:
        """All settings, as they are given to the constructor."""
        return dict(self._settings)

    def reset(self) -> None:
        """Forget all that was measured."""
        self._law.reset()

    def copy(self) -> Self:
        """Copy it: the same settings, the same state."""
        twin = type(self).__new__(type(self))
        vars(twin).update(vars(self))
        twin._law = self._law.copy()
        return twin

    def __copy__(self) -> Self:
        return self.copy()

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self.copy()

    def __repr__(self) -> str:
        shown = ", ".join(f"{name}={it!r}" for name, it in self._settings.items() if it is not None)
        return f"{type(self).__name__}({self.system!r}, {shown})"

    def _measured(self, q: ArrayLike, qdot: ArrayLike) -> tuple[_zivi.Believed, Array, Array]:
        """Give the plant that is believed in and what was measured, as arrays that fit it."""
        at, speed = (np.atleast_1d(real_array(*it)) for it in (("q", q), ("qdot", qdot)))
        if at.shape != speed.shape or at.ndim != 1:
            raise ValueError(f"qdot must have shape {at.shape}, got {speed.shape}")
        return self._model(at)[1].core, at, speed

    def _model(self, q: Array) -> tuple[ControlInputs, BelievedPlant]:
        """Give the inputs and the plant, which the first sample tells the number of coordinates."""
        if self._inputs is None or self._believed is None:
            inputs, limits = self.system.control_inputs(q), self._settings["u_limits"]
            if limits is not None and len(limits) != inputs.r:
                raise ValueError(
                    f"u_limits must have a pair for each of {inputs.r} controls, got {len(limits)}"
                )
            self._look_at(q)
            tasks = self._functions(q)
            self._inputs = inputs
            self._believed = BelievedPlant(self.system, self.h, len(q), tasks)
        return self._inputs, self._believed

    def _look_at(self, q: Array) -> None:
        """Check what only a sample shows."""

    def _functions(self, q: Array) -> MechanicalSystem | None:
        """Give a system whose gaps are what follows beside the gaps, if anything does."""
        return None


def believed(system: Any) -> MechanicalSystem:
    """Check that a model was given."""
    if not isinstance(system, MechanicalSystem):
        raise TypeError(f"system must be a zivi.MechanicalSystem, got {type(system).__name__}")
    return system


def check_believes(told: str, system: MechanicalSystem, plant: MechanicalSystem, q: Array) -> None:
    """Refuse a model whose coordinates, gaps or controls are others than the plant's.

    Parameters
    ----------
    told : str
        Whose model it is.
    system, plant : MechanicalSystem
        The model and the plant.
    q : ndarray
        Coordinates of the plant.
    """
    n = system._n
    if n is not None and n != len(q):
        raise ValueError(f"{told} must believe in {len(q)} coordinates, as the plant has, not {n}")
    if system.gap_names != plant.gap_names:
        raise ValueError(
            f"{told} must believe in the gaps of the plant, {plant.gap_names}, "
            f"not in {system.gap_names}"
        )
    believed, known = system.control_inputs(q).names, plant.control_inputs(q).names
    if len(believed) != len(known):
        raise ValueError(
            f"{told} must believe in {len(known)} controls, as the plant has, not {len(believed)}"
        )
