"""Dry friction: tangential to gaps, and in joints."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import finite
from zivi.base.functions import check_arguments
from zivi.base.habits import hinted
from zivi.system.model_parts import Compiled, Part, differenced, number_part, part
from zivi.system.wall import HarmonicWall, MovingWall

__all__ = [
    "IMPACT_LAWS",
    "PARADOXES",
    "Channel",
    "DryFriction",
    "Slip",
    "joints_of",
    "one_of",
    "slip_of_gap",
    "tangential_restitution",
]

Motion: TypeAlias = HarmonicWall | MovingWall

IMPACT_LAWS = ("newton", "poisson", "stronge")
"""How friction acts in an impact."""
PARADOXES = ("stop", "impact")
"""What becomes of a sliding contact whose force no motion gives."""


@dataclasses.dataclass(frozen=True, eq=False)
class Slip:
    r"""One direction of dry friction: its slip speed, and how much the friction can hold.

    .. math:: w = B \dot q + \beta, \qquad \dot w = B \ddot q + k

    Parameters
    ----------
    direction, rate, curvature : Part
        B, beta and the number k.
    limit, static : Part
        What the friction takes in slip, and what it holds in stick: coefficients of friction at a
        gap, forces in a joint.
    by_speed : callable or None
        The limit in slip as a function of the slip speed, instead of `limit`.
    motion : HarmonicWall, MovingWall or None
        The motion of the surface that is in `rate` and `curvature`.
    """

    direction: Part
    rate: Part
    curvature: Part
    limit: Part
    static: Part | None
    by_speed: Callable[[float], float] | None = None
    motion: Motion | None = None

    def is_smooth(self) -> bool:
        """Whether there is no friction at all: both coefficients are 0."""
        limits = self.limit, self.static
        return self.by_speed is None and all(
            isinstance(it, np.ndarray) and not np.any(it) for it in limits
        )

    def is_steady(self) -> bool:
        """Whether direction, rate and limits are constants."""
        parts = (self.direction, self.rate, self.limit, 0.0 if self.static is None else self.static)
        return self.by_speed is None and all(isinstance(it, np.ndarray | float) for it in parts)


@dataclasses.dataclass(frozen=True)
class Channel:
    """A place of dry friction in a system.

    Parameters
    ----------
    name : str
        The name of its gap, or of the joint.
    gap : int or None
        The number of its gap, None for a joint.
    e_t : float
        Tangential restitution.
    """

    name: str
    gap: int | None
    e_t: float = 0.0


@hinted("DryFriction")
class DryFriction:
    r"""Dry friction in a joint, in a guide, or on a belt under a given load.

    .. math::

        f = -L \operatorname{Sign}(w), \qquad w = b \cdot \dot q - v

    The force acts along :math:`b`. In stick, :math:`w = 0` exactly, it is what keeps the rest, up
    to the static limit.

    Parameters
    ----------
    direction : array_like or callable
        :math:`b`, of shape (n,), or ``b(t, q)``, or compiled as the parts of a `MechanicalSystem`.
        By default 1, for one coordinate.
    limit : float or callable
        :math:`L \ge 0`, the force of friction in slip: a number, ``L(t, q, qdot)`` (which may
        depend on the slip speed), or compiled.
    static : float, callable or None
        What it holds in stick, not less than the limit at slip speed zero; by default the limit.
    velocity : float, callable, HarmonicWall or MovingWall
        :math:`v`, the speed of what it rubs on: a number, ``v(t, q)``, or a motion, whose velocity
        it is.
    curvature : callable, float or None
        ``(t, q, qdot)`` to the number :math:`k`, what :math:`\dot w` is without acceleration; by
        default it is differenced.
    name : str, optional
        What tables and errors call it; by default ``friction0``, ``friction1``, ... by its place.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite, the limit is negative or more than the static one, or a part is
        none of these.

    Notes
    -----
    The force of the system must not contain the dry friction.

    Examples
    --------
    A mass at a spring on a belt, static 1.2, in slip 0.8:

    >>> belt = zivi.DryFriction(direction=[1.0], limit=0.8, static=1.2, velocity=0.2, name="belt")
    >>> belt
    DryFriction(direction=[1.0], limit=0.8, static=1.2, velocity=0.2, name='belt')
    """

    def __init__(
        self,
        direction: Callable[..., Any] | ArrayLike | Any = 1.0,
        limit: float | Callable[..., Any] | Any = None,
        static: float | Callable[..., Any] | Any | None = None,
        velocity: float | Callable[..., Any] | Motion = 0.0,
        curvature: Callable[..., Any] | float | Any | None = None,
        name: str | None = None,
    ) -> None:
        self.direction, self.limit, self.static = direction, limit, static
        self.velocity, self.curvature = velocity, curvature
        self._name = None if name is None else str(name)
        called = "friction" if name is None else f"friction {name!r}"
        if limit is None:
            raise ValueError(f"limit of {called} must be given, the force of friction in slip")
        row = _row(f"direction of {called}", direction)
        held = number_part(f"limit of {called}", limit, "t, q, qdot")
        most = None if static is None else number_part(f"static of {called}", static, "t, q, qdot")
        _check_limits(f"limit of {called}", held, f"static of {called}", most)
        rate, k, motion = _moving(called, velocity)
        if curvature is not None:
            k = number_part(f"curvature of {called}", curvature, "t, q, qdot")
            motion = None
        elif k is None or not isinstance(row, np.ndarray):
            k, motion = differenced(row, rate), None
        self._slip = Slip(row, rate, k, held, most, motion=motion)

    @property
    def name(self) -> str | None:
        """What tables and errors call it."""
        return self._name

    def __repr__(self) -> str:
        told = {"direction": self.direction, "limit": self.limit}
        if self.static is not None:
            told["static"] = self.static
        if not isinstance(self.velocity, int | float) or self.velocity != 0.0:
            told["velocity"] = self.velocity
        if self._name is not None:
            told["name"] = self._name
        return f"DryFriction({', '.join(f'{name}={value!r}' for name, value in told.items())})"

    def __getstate__(self) -> dict[str, Any]:
        names = ("direction", "limit", "static", "velocity", "curvature")
        return {name: getattr(self, name) for name in names} | {"name": self._name}

    def __setstate__(self, state: dict[str, Any]) -> None:
        DryFriction.__init__(self, **state)


def slip_of_gap(
    called: str,
    tangent: Any,
    velocity: Any,
    curvature: Any,
    coefficients: tuple[Any, Any],
    belt: Any = None,
) -> Slip | None:
    """Read the friction of a gap, None without; an error names the argument and the gap.

    Parameters
    ----------
    called : str
        The gap in errors.
    tangent, velocity, curvature
        B, beta and k as they were given.
    coefficients : tuple
        mu and mu_static.
    belt
        The motion of the surface, instead of `velocity` and `curvature`.
    """
    mu, mu_static = coefficients
    if tangent is None:
        others = {"mu": mu, "mu_static": mu_static, "tangent_velocity": velocity}
        others |= {"tangent_curvature": curvature, "belt": belt}
        for name, value in others.items():
            if value is not None:
                raise ValueError(f"{name} of {called} needs a tangent, the direction of slip")
        return None
    if mu is None:
        raise ValueError(f"mu of {called} must be given: it has a tangent")
    row = _row(f"tangent of {called}", tangent)
    rate: Part
    rate, k, motion = np.zeros(()), None, None
    if belt is not None:
        rate, k, motion = _moving(f"belt of {called}", belt, several=False)
    elif velocity is not None:
        rate = number_part(f"tangent_velocity of {called}", velocity, "t, q")
    if curvature is not None:
        k = number_part(f"tangent_curvature of {called}", curvature, "t, q, qdot")
    elif k is None:
        k = differenced(row, rate)
    by_speed = mu if callable(mu) else None
    if by_speed is not None:
        check_arguments(f"mu of {called}", mu, "speed")
    kinetic = np.asarray(finite(f"mu of {called}", mu(0.0) if by_speed else mu))
    most = kinetic if mu_static is None else np.asarray(finite(f"mu_static of {called}", mu_static))
    _check_limits(f"mu of {called}", kinetic, f"mu_static of {called}", most)
    return Slip(row, rate, k, kinetic, most, by_speed, motion)


def _row(name: str, given: Any) -> Part:
    """Read a direction."""
    read = part(name, given, "t, q")
    if not isinstance(read, np.ndarray):
        return read
    row = np.atleast_1d(read)
    if row.ndim != 1:
        raise ValueError(
            f"{name} must be one vector of shape (n,), got shape {row.shape}: friction is planar, "
            "one tangential direction a gap"
        )
    if not np.any(row):
        raise ValueError(f"{name} must not be zero, got {row.tolist()}")
    return row


def _moving(
    called: str, velocity: Any, *, several: bool = True
) -> tuple[Part, Part | None, Motion | None]:
    """Read the motion of the other surface: beta, k if it is known, and the motion itself."""
    if isinstance(velocity, HarmonicWall | MovingWall):
        at = velocity._at
        return lambda t, q: -at(t)[1], lambda t, q, qdot: -at(t)[2], velocity
    name = f"velocity of {called}" if several else called
    if callable(velocity) and several and not isinstance(velocity, Compiled):
        if isinstance(read := part(name, velocity, "t, q"), Compiled):
            raise TypeError(f"{name} must be a number, a function (t, q) or a motion, not compiled")
        function: Any = read
        return lambda t, q: -function(t, q), None, None
    try:
        return np.asarray(0.0 - finite(name, velocity)), np.zeros(()), None
    except TypeError:
        forms = "a number, a function (t, q), " if several else "a number, "
        raise TypeError(
            f"{name} must be {forms}a zivi.HarmonicWall or a zivi.MovingWall, got {velocity!r}"
        ) from None


def _check_limits(name: str, limit: Part, static_name: str, static: Part | None) -> None:
    """Refuse numbers that are negative, and a static limit below the limit in slip."""
    for called, value in ((name, limit), (static_name, static)):
        if isinstance(value, np.ndarray) and value < 0.0:
            raise ValueError(f"{called} must be >= 0, got {value}")
    both = isinstance(limit, np.ndarray) and isinstance(static, np.ndarray)
    if both and static < limit:  # type: ignore[operator]
        raise ValueError(
            f"{static_name} must be at least {name.split(' of ')[0]}, got {static} < {limit}"
        )


def tangential_restitution(called: str, e_t: Any) -> float:
    """Read e_t of a gap."""
    value = finite(f"e_t of {called}", e_t)
    if not 0.0 <= value <= 1.0:
        raise ValueError(f"e_t of {called} must be in [0, 1], got {value}")
    return value


def joints_of(friction: Any) -> tuple[DryFriction, ...]:
    """Read the joints with dry friction."""
    several = (friction,) if isinstance(friction, DryFriction) else friction
    if not isinstance(several, Iterable):
        kind = type(friction).__name__
        raise TypeError(f"friction must be a sequence of zivi.DryFriction, got {kind}")
    several = tuple(several)
    for i, joint in enumerate(several):
        if not isinstance(joint, DryFriction):
            raise TypeError(f"friction[{i}] must be a zivi.DryFriction, got {joint!r}")
    return several


def one_of(name: str, value: Any, known: tuple[str, ...]) -> str:
    """Read a choice by its name."""
    if value not in known:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, known))}, got {value!r}")
    return str(value)
