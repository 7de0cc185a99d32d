"""What controllers of mechanisms share that believe in a model of their plant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi.base.check import Array, finite, real_array
from zivi.control.believed_plant import BelievedPlant
from zivi.control.component import TickStatus
from zivi.control.u_limits import limits_of
from zivi.system.control_inputs import ControlInputs
from zivi.system.gap_coordinates import GapKinetics
from zivi.system.mechanism import MechanicalSystem

__all__ = ["ModelBased", "Outlook", "believed", "check_believes", "numbers"]


class Outlook(NamedTuple):
    """The state in which the control of a tick will act.

    Parameters
    ----------
    t : float
        The time (s).
    q, qdot : ndarray
        Coordinates and velocities, shape (n,).
    kinetics : GapKinetics
        The same by its gaps.
    matrix : ndarray
        :math:`B`, shape (n, r).
    """

    t: float
    q: Array
    qdot: Array
    kinetics: GapKinetics
    matrix: Array


class ModelBased:
    """Settings, a model, its prediction over a delay, and the last controls.

    Parameters
    ----------
    system : MechanicalSystem
        What the plant is believed to be.
    settings : dict
        The arguments of the constructor, with ``h``, ``delay`` and ``u_limits``.
    """

    def __init__(self, system: MechanicalSystem, settings: dict[str, Any]) -> None:
        self.system = system
        self._settings = {**settings, "u_limits": limits_of(settings["u_limits"])}
        self._noise: Any = None
        self._inputs: ControlInputs | None = None
        self._believed: BelievedPlant | None = None
        self.reset()

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

    @property
    def status(self) -> TickStatus:
        """What was done to the last sample and to the control."""
        return self._status

    def reset(self) -> None:
        """Forget all that was measured."""
        self._u: Array | None = None
        self._queue: list[Array] = []
        self._status = TickStatus(0)

    @property
    def state(self) -> tuple[Any, ...]:
        """All that changes from tick to tick; assigning it restores what it was of exactly."""
        raise NotImplementedError

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        raise NotImplementedError

    def copy(self) -> Self:
        """Copy it: the same settings, the same state."""
        twin = type(self).__new__(type(self))
        vars(twin).update(vars(self))
        twin.state = self.state
        return twin

    def __copy__(self) -> Self:
        return self.copy()

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self.copy()

    def __getstate__(self) -> dict[str, Any]:
        own = {"settings": self._settings, "system": self.system}
        return {**own, "state": self.state, "noise": self._noise}

    def __repr__(self) -> str:
        shown = ", ".join(f"{name}={it!r}" for name, it in self._settings.items() if it is not None)
        return f"{type(self).__name__}({self.system!r}, {shown})"

    def _outlook(
        self, t: float, q: ArrayLike, qdot: ArrayLike, closed: NDArray[np.bool_]
    ) -> Outlook | None:
        """Give the state when the control of this tick will act; None if the sample is refused.

        Parameters
        ----------
        t : float
            Time of the measurement (s).
        q, qdot : array_like
            Measured coordinates and velocities, shape (n,).
        closed : ndarray
            Contacts that are known to be closed, shape (m,).
        """
        at, speed = (np.atleast_1d(real_array(*it)) for it in (("q", q), ("qdot", qdot)))
        if at.shape != speed.shape or at.ndim != 1:
            raise ValueError(f"qdot must have shape {at.shape}, got {speed.shape}")
        if self._believed is not None and len(at) != self._believed.model.layout.n:
            raise ValueError(
                f"q must have shape ({self._believed.model.layout.n},), got {at.shape}"
            )
        inputs, plant = self._model(at)
        t = finite("t", t)
        if not (np.all(np.isfinite(at)) and np.all(np.isfinite(speed))):
            self._status = TickStatus.REFUSED
            return None
        self._status = TickStatus(0)
        if self.delay:
            idle = [np.zeros(inputs.r)] * (self.delay - len(self._queue))
            controls = np.array(idle + self._queue[-self.delay :])
            at, speed = plant.onto(t, at, speed, closed)
            at, speed, _ = plant.moved(t, at, speed, controls)
            t += self.delay * self.h
        return self._measured(t, at, speed)

    def _measured(self, t: float, q: ArrayLike, qdot: ArrayLike) -> Outlook:
        """Give a state by its gaps."""
        at, speed = (np.atleast_1d(np.asarray(it, dtype=np.float64)) for it in (q, qdot))
        inputs, plant = self._model(at)
        here = plant.model.layout.read(plant.model.evaluate(t, at, speed))
        return Outlook(t, at, speed, GapKinetics.of(here, speed), inputs.at(at))

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

    def _sent(self, u: Array) -> Array:
        """Remember what is sent: the last controls again where none are finite."""
        if not np.all(np.isfinite(u)):
            self._status |= TickStatus.REFUSED
            u = np.zeros_like(u) if self._u is None else self._u
        self._u = u
        if self.delay:
            self._queue = [*self._queue, u][-self.delay :]
        return u.copy()

    def _hold_controls(self) -> Array:
        """Send the last controls again."""
        assert self._inputs is not None
        return self._sent(np.zeros(self._inputs.r) if self._u is None else self._u)


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


def numbers(rows: Sequence[Array | None]) -> tuple[Any, ...]:
    """Give arrays as plain numbers, for a state."""
    return tuple(None if it is None else tuple(it.tolist()) for it in rows)
