"""Gaps: functions of time and coordinates that stay non-negative."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import finite, real_array
from zivi.base.habits import hinted
from zivi.system.friction import slip_of_gap, tangential_restitution
from zivi.system.model_parts import Part, differenced, number_part, part
from zivi.system.table import Table
from zivi.system.wall import HarmonicWall, MovingWall

__all__ = ["Gap", "LinearGap"]


@hinted("Gap")
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
    tangent : callable or array_like, optional
        With friction: the direction :math:`B` of slip, of shape (n,), as ``(t, q)`` or an array,
        on the scale of the gap: of a distance, the unit tangent. The slip speed is
        :math:`w = B \dot q + \beta`.
    tangent_velocity : callable, float or None
        ``(t, q)`` to :math:`\beta`, minus the speed of a belt; by default 0.
    tangent_curvature : callable, float or None
        ``(t, q, qdot)`` to the number :math:`k`, what :math:`\dot w` is without acceleration; by
        default it is differenced.
    mu : float or callable
        Coefficient of friction, >= 0, or ``mu(speed)`` of the slip speed >= 0. With 0 the gap is
        one without friction.
    mu_static : float, optional
        What sticks, at least ``mu``; by default ``mu``.
    e_t : float
        Tangential restitution in [0, 1]; other values than 0 are for superballs.

    Raises
    ------
    TypeError
        If a part is none of these.
    ValueError
        If a coefficient is out of range, there is a tangent without `mu`, or `mu` without one.

    Notes
    -----
    Gradient, curvature, rate and tangent_curvature are compared with differences once, at the start
    of a run (to 1e-5). Without friction, which of the functions that describe a surface is taken
    does not matter.

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
        *,
        tangent: Callable[..., Any] | ArrayLike | Any | None = None,
        tangent_velocity: Callable[..., Any] | float | Any | None = None,
        tangent_curvature: Callable[..., Any] | float | Any | None = None,
        mu: float | Callable[[float], float] | None = None,
        mu_static: float | None = None,
        e_t: float = 0.0,
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
        self._rate = number_part(f"rate of {called}", 0.0 if rate is None else rate, "t, q")
        self._curvature = (
            differenced(self._gradient, self._rate)
            if curvature is None
            else number_part(f"curvature of {called}", curvature, "t, q, qdot")
        )
        self._rub(
            {
                "tangent": tangent,
                "tangent_velocity": tangent_velocity,
                "tangent_curvature": tangent_curvature,
                "mu": mu,
                "mu_static": mu_static,
                "e_t": e_t,
            },
            called,
        )

    def _rub(self, given: dict[str, Any], called: str, belt: Any = None) -> None:
        """Read the friction, if there is any; with coefficients of 0 there is none."""
        coefficients = given["mu"], given["mu_static"]
        velocity, curvature = given.get("tangent_velocity"), given.get("tangent_curvature")
        tangent = given["tangent"]
        self._slip = slip_of_gap(called, tangent, velocity, curvature, coefficients, belt)
        self._e_t = tangential_restitution(called, given["e_t"])
        if tangent is None and self._e_t:
            raise ValueError(f"e_t of {called} needs a tangent, the direction of slip")
        if self._slip is not None and self._slip.is_smooth() and self._e_t == 0.0:
            self._slip = None
        self._friction = {} if tangent is None else given

    @property
    def name(self) -> str | None:
        """What errors and plots call it."""
        return self._name

    def _parts(self) -> tuple[Part, Part, Part, Part]:
        """Give value, gradient, curvature and rate."""
        return self._value, self._gradient, self._curvature, self._rate

    def __repr__(self) -> str:
        return f"{type(self).__name__}(name={self._name!r}{self._friction_text()})"

    def _friction_text(self) -> str:
        """Show the coefficients of friction."""
        told = {name: self._friction.get(name) for name in ("mu", "mu_static")}
        told["e_t"] = self._e_t or None
        return "".join(f", {name}={value!r}" for name, value in told.items() if value is not None)

    def __getstate__(self) -> dict[str, Any]:
        names = ("value", "gradient", "curvature", "rate", "_name")
        return {name: getattr(self, name) for name in names} | self._friction

    def __setstate__(self, state: dict[str, Any]) -> None:
        more = dict(state)
        parts = [more.pop(name) for name in ("value", "gradient", "curvature", "rate", "_name")]
        Gap.__init__(self, *parts, **more)


@hinted("LinearGap")
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
    tangent : array_like, optional
        With friction: the direction of slip, of shape (n,).
    mu, mu_static, e_t
        As for `Gap`.
    belt : float, HarmonicWall or MovingWall
        The speed of the surface along the tangent, or its motion; by default it does not move.

    Raises
    ------
    ValueError, TypeError
        If the normal is zero or a number is not finite; if the motion is none; as for `Gap`.

    Examples
    --------
    A wall on the right at 0.8, ``0.8 - x >= 0``, and a floor that vibrates:

    >>> right = zivi.LinearGap([-1.0, 0.0], offset=0.8, name="right")
    >>> floor = zivi.LinearGap([0.0, 1.0], motion=zivi.HarmonicWall(0.01, 60.0))

    A conveyor with friction:

    >>> zivi.LinearGap([0.0, 1.0], name="belt", tangent=[1.0, 0.0], mu=0.3, belt=0.2)
    LinearGap([0.0, 1.0], offset=0.0, name='belt', mu=0.3)
    """

    def __init__(
        self,
        normal: ArrayLike,
        offset: float = 0.0,
        motion: HarmonicWall | MovingWall | Table | None = None,
        name: str | None = None,
        *,
        tangent: ArrayLike | None = None,
        mu: float | Callable[[float], float] | None = None,
        mu_static: float | None = None,
        e_t: float = 0.0,
        belt: float | HarmonicWall | MovingWall | None = None,
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
        else:
            at = motion._at
            super().__init__(
                lambda t, q: float(n @ q) + c - at(t)[0],
                n,
                lambda t, q, qdot: -at(t)[2],
                lambda t, q: -at(t)[1],
                name,
            )
        called = "gap" if name is None else f"gap {name!r}"
        if tangent is not None:
            tangent = np.atleast_1d(real_array(f"tangent of {called}", tangent)).copy()
        given = {"tangent": tangent, "mu": mu, "mu_static": mu_static, "e_t": e_t, "belt": belt}
        self._rub(given, called, belt)

    def __repr__(self) -> str:
        motion = "" if self.motion is None else f", motion={self.motion!r}"
        name = "" if self.name is None else f", name={self.name!r}"
        told = f"{motion}{name}{self._friction_text()}"
        return f"LinearGap({self.normal.tolist()}, offset={self.offset}{told})"

    def __getstate__(self) -> dict[str, Any]:
        names = ("normal", "offset", "motion", "_name")
        return {name: getattr(self, name) for name in names} | self._friction

    def __setstate__(self, state: dict[str, Any]) -> None:
        more = dict(state)
        parts = [more.pop(name) for name in ("normal", "offset", "motion", "_name")]
        LinearGap.__init__(self, *parts, **more)
