"""Walls that move: ``x >= w(t)`` with ``w``, ``w'`` and ``w''`` given."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, finite, real_array
from zivi.base.functions import check_arguments
from zivi.base.habits import hinted

__all__ = ["HarmonicWall", "MovingWall"]


@hinted("HarmonicWall")
@dataclasses.dataclass(frozen=True)
class HarmonicWall:
    r"""A wall that vibrates, evaluated without the interpreter.

    .. math:: w = w_0 + a \cos(\omega t + \varphi)

    Calling it, ``wall(t)``, gives ``(w, w', w'')``.

    Parameters
    ----------
    amplitude : float
        :math:`a` (m).
    omega : float
        :math:`\omega` (rad/s).
    phase : float
        :math:`\varphi` (rad).
    offset : float
        :math:`w_0` (m).

    Raises
    ------
    ValueError
        If a parameter, or the acceleration :math:`a \omega^2`, is not finite.

    Examples
    --------
    >>> table = zivi.HarmonicWall(amplitude=0.1, omega=10.0)
    >>> [float(value) for value in table(0.0)]
    [0.1, -0.0, -10.0]
    """

    amplitude: float
    omega: float
    phase: float = 0.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, finite(field.name, getattr(self, field.name)))
        square = self.omega * self.omega
        if not math.isfinite(square):
            raise ValueError(f"omega must have a finite square, got {self.omega}")
        if not math.isfinite(self.amplitude * square):
            raise ValueError(
                f"amplitude must give a finite acceleration amplitude*omega^2, got {self.amplitude}"
            )

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Position (m), velocity (m/s) and acceleration (m/s^2) of the wall at `t` (s)."""
        angle = self.omega * real_array("t", t) + self.phase
        swing = self.amplitude * np.cos(angle)
        speed = -self.amplitude * self.omega * np.sin(angle)
        return self.offset + swing, speed, -(self.omega**2) * swing

    def _at(self, t: float) -> tuple[float, float, float]:
        angle = self.omega * t + self.phase
        swing = self.amplitude * math.cos(angle)
        speed = -self.amplitude * self.omega * math.sin(angle)
        return self.offset + swing, speed, -(self.omega**2) * swing

    def _spec(self) -> _zivi.Wall:
        return _zivi.Wall.harmonic(**vars(self))


@dataclasses.dataclass(frozen=True)
class MovingWall:
    """A wall whose motion is given by three functions of time.

    Calling it, ``wall(t)``, gives ``(w, w', w'')``.

    Parameters
    ----------
    position, velocity, acceleration : callable
        ``w(t)`` (m), ``w'(t)`` (m/s) and ``w''(t)`` (m/s^2) for a float `t` (s). They must belong
        together: a wrong derivative is a force that nobody ordered.

    Raises
    ------
    TypeError
        If one of them cannot be called.

    Examples
    --------
    >>> lift = zivi.MovingWall(lambda t: 0.5 * t, lambda t: 0.5, lambda t: 0.0)
    >>> [float(value) for value in lift(2.0)]
    [1.0, 0.5, 0.0]
    """

    position: Callable[[float], float]
    velocity: Callable[[float], float]
    acceleration: Callable[[float], float]

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            function = getattr(self, field.name)
            if not callable(function):
                raise TypeError(f"{field.name} must be a function of time, got {function!r}")
            check_arguments(field.name, function, "t")

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Position (m), velocity (m/s) and acceleration (m/s^2) of the wall at `t` (s)."""
        times = real_array("t", t)
        motion = np.array([self._at(time) for time in times.ravel().tolist()]).reshape(-1, 3)
        w, wdot, wddot = (column.reshape(times.shape) for column in motion.T)
        return w, wdot, wddot

    def _at(self, t: float) -> tuple[float, float, float]:
        return (
            _number("position", self.position(t)),
            _number("velocity", self.velocity(t)),
            _number("acceleration", self.acceleration(t)),
        )

    def _spec(self) -> _zivi.Wall:
        return _zivi.Wall.callable(self._at)


def _number(name: str, value: Any) -> float:
    try:
        return math.ldexp(value, 0)  # what is a float or becomes one; strings do not
    except TypeError:
        raise TypeError(f"{name}(t) of the wall must return a float, got {value!r}") from None
