"""Gaps: functions of time and coordinates that stay non-negative."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, finite, real_array
from zivi.system.model_parts import Compiled, Part, part
from zivi.system.table import Table
from zivi.system.wall import HarmonicWall, MovingWall

__all__ = ["Gap", "LinearGap"]


class Gap:
    r"""A unilateral constraint :math:`g(t, q) \ge 0`.

    Parameters
    ----------
    value : callable
        ``g(t, q)``, a float; or compiled, ``void (t, q*, qdot*, out*)``.
    gradient : callable or array_like
        ``(t, q)`` to :math:`\partial g/\partial q`, of shape (n,); an array if it is constant.
    curvature : callable, float or None
        ``(t, q, qdot)`` to the number
        :math:`h = \dot q^T H \dot q + 2 g_{tq} \dot q + g_{tt}`, :math:`H` the Hessian: what
        :math:`\ddot g` is without acceleration. By default it is differenced, to about 1e-11
        where gradient and rate vary over lengths and times of order one, by six evaluations.
    rate : callable, float or None
        ``(t, q)`` to :math:`\partial g/\partial t`; by default the gap does not depend on time.
    name : str, optional
        What errors and plots call it; by default ``gap0``, ``gap1``, ... by its place.

    Raises
    ------
    TypeError
        If a part is none of these.

    Notes
    -----
    Gradient, curvature and rate are compared with differences once, at the start of a run (to
    1e-5). Which of the functions that describe a surface is taken does not matter.

    Examples
    --------
    A point ``q = (x, y)`` over the parabola ``y = x^2/2``:

    >>> bowl = zivi.Gap(
    ...     lambda t, q: q[1] - q[0] ** 2 / 2,
    ...     lambda t, q: np.array([-q[0], 1.0]),
    ...     lambda t, q, qdot: -(qdot[0] ** 2),
    ...     name="bowl",
    ... )
    >>> bowl
    Gap(name='bowl')
    """

    def __init__(
        self,
        value: Callable[..., Any] | Any,
        gradient: Callable[..., Any] | ArrayLike | Any,
        curvature: Callable[..., Any] | float | Any | None = None,
        rate: Callable[..., Any] | float | Any | None = None,
        name: str | None = None,
    ) -> None:
        called = "gap" if name is None else f"gap {name!r}"
        self._name = None if name is None else str(name)
        self.value, self.gradient, self.curvature, self.rate = value, gradient, curvature, rate
        self._value = part(f"value of {called}", value, "t, q")
        if isinstance(self._value, np.ndarray):
            raise TypeError(f"value of {called} must be a function of (t, q), got {value!r}")
        self._gradient = part(f"gradient of {called}", gradient, "t, q")
        if isinstance(self._gradient, np.ndarray):
            self._gradient = np.atleast_1d(self._gradient)
        self._rate = _number(f"rate of {called}", 0.0 if rate is None else rate, "t, q")
        self._curvature = (
            self._differenced()
            if curvature is None
            else _number(f"curvature of {called}", curvature, "t, q, qdot")
        )

    @property
    def name(self) -> str | None:
        """What errors and plots call it."""
        return self._name

    def _differenced(self) -> Part:
        """Give the curvature as the derivative of ``g'`` along ``(t + s, q + s qdot)``."""
        if isinstance(self._gradient, np.ndarray) and isinstance(self._rate, np.ndarray):
            return np.zeros(())
        gradient, rate = evaluated(self._gradient, 1), evaluated(self._rate, 0)

        def speed(s: float, t: float, q: Array, qdot: Array) -> float:
            there = q + s * qdot
            return float(gradient(t + s, there, qdot) @ qdot + rate(t + s, there, qdot)[()])

        def curvature(t: float, q: Array, qdot: Array) -> float:
            # of sixth order
            s = STEP / max(1.0, float(np.max(np.abs(qdot), initial=0.0)))
            first, second, third = (
                speed(k * s, t, q, qdot) - speed(-k * s, t, q, qdot) for k in (1, 2, 3)
            )
            return (45 * first - 9 * second + third) / (60 * s)

        return curvature

    def _parts(self) -> tuple[Part, Part, Part, Part]:
        """Give value, gradient, curvature and rate."""
        return self._value, self._gradient, self._curvature, self._rate

    def __repr__(self) -> str:
        return f"{type(self).__name__}(name={self._name!r})"

    def __getstate__(self) -> dict[str, Any]:
        names = ("value", "gradient", "curvature", "rate", "_name")
        return {name: getattr(self, name) for name in names}

    def __setstate__(self, state: dict[str, Any]) -> None:
        parts = [state[name] for name in ("value", "gradient", "curvature", "rate", "_name")]
        Gap.__init__(self, *parts)


STEP = 5e-4
"""How far a coordinate or the time moves in a difference of a curvature."""


class LinearGap(Gap):
    r"""A gap that is linear in the coordinates, over a wall that may move.

    .. math:: g(t, q) = n \cdot q + c - w(t) \ge 0

    Parameters
    ----------
    normal : array_like
        :math:`n`, of shape (n,), not zero. It need not have length one.
    offset : float
        :math:`c`.
    motion : HarmonicWall, MovingWall, Table or None
        :math:`w`, with its derivatives; by default the wall does not move.
    name : str, optional
        As for `Gap`.

    Raises
    ------
    ValueError, TypeError
        If the normal is zero or a number is not finite; if the motion is none.

    Examples
    --------
    A wall on the right at 0.8, ``0.8 - x >= 0``, and a floor that vibrates:

    >>> right = zivi.LinearGap([-1.0, 0.0], offset=0.8, name="right")
    >>> floor = zivi.LinearGap([0.0, 1.0], motion=zivi.HarmonicWall(0.01, 60.0))
    """

    def __init__(
        self,
        normal: ArrayLike,
        offset: float = 0.0,
        motion: HarmonicWall | MovingWall | Table | None = None,
        name: str | None = None,
    ) -> None:
        n = np.atleast_1d(real_array("normal", normal)).copy()
        if n.ndim != 1 or not np.all(np.isfinite(n)) or not np.any(n):
            whose = f" of gap {name!r}" if name else ""
            raise ValueError(
                f"normal{whose} must be a vector, finite and not zero, got {n.tolist()}"
            )
        c = finite("offset", offset)
        if isinstance(motion, Table):
            motion._wall("motion")
        elif not (motion is None or isinstance(motion, HarmonicWall | MovingWall)):
            raise TypeError(
                "motion must be a zivi.HarmonicWall, a zivi.MovingWall or a zivi.Table, "
                f"got {motion!r}"
            )
        self.normal, self.offset, self.motion = n, c, motion
        if motion is None:
            super().__init__(lambda t, q: float(n @ q) + c, n, 0.0, 0.0, name)
            return
        at = motion._at
        super().__init__(
            lambda t, q: float(n @ q) + c - at(t)[0],
            n,
            lambda t, q, qdot: -at(t)[2],
            lambda t, q: -at(t)[1],
            name,
        )

    def __repr__(self) -> str:
        motion = "" if self.motion is None else f", motion={self.motion!r}"
        name = "" if self.name is None else f", name={self.name!r}"
        return f"LinearGap({self.normal.tolist()}, offset={self.offset}{motion}{name})"

    def __getstate__(self) -> dict[str, Any]:
        names = ("normal", "offset", "motion", "_name")
        return {name: getattr(self, name) for name in names}

    def __setstate__(self, state: dict[str, Any]) -> None:
        LinearGap.__init__(self, state["normal"], state["offset"], state["motion"], state["_name"])


def _number(name: str, given: Any, arguments: str) -> Part:
    """Read a part that is one number."""
    read = part(name, given, arguments)
    if isinstance(read, np.ndarray) and read.shape != ():
        raise ValueError(f"{name} must be one number or a function, got shape {read.shape}")
    return read


def evaluated(given: Part, dimensions: int) -> Callable[[float, Array, Array], Array]:
    """Give a gap's part as a function of (t, q, qdot) whose result is an array."""
    if isinstance(given, np.ndarray):
        return lambda t, q, qdot: given
    if isinstance(given, Compiled):

        def filled(t: float, q: Array, qdot: Array) -> Array:
            out = np.empty(len(q) if dimensions else 1)
            given.fill(t, np.ascontiguousarray(q), np.ascontiguousarray(qdot), out)
            return out if dimensions else out[0]

        return filled
    return lambda t, q, qdot: np.asarray(given(t, q), dtype=np.float64)
