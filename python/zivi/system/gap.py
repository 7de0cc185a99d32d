"""Moving walls, gaps and dry friction."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, all_of, check_arguments, finite, read_only, real_array
from zivi.base.habits import hinted
from zivi.system.model_parts import Compiled, Part, Unchanging, differenced, number_part, own, part
from zivi.system.table import Table

# Walls that move: ``x >= w(t)`` with ``w``, ``w'`` and ``w''`` given.


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

    See Also
    --------
    MovingWall : other motions of a wall.
    Table : tabulated motions.

    Notes
    -----
    The wall needs no evaluation in Python: impacts are the roots of a power series in the frame of
    the wall.

    References
    ----------
    J. M. Luck and A. Mehta, Bouncing ball with a finite restitution: chattering, locking, and
    chaos, Phys. Rev. E 48, 1993.

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
                f"amplitude*omega^2 must be a finite acceleration, got amplitude = {self.amplitude}"
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

    ``wall(t)`` returns ``(w, w', w'')``.

    Parameters
    ----------
    position, velocity, acceleration : callable
        ``w(t)`` (m), ``w'(t)`` (m/s) and ``w''(t)`` (m/s^2) for a float `t` (s). They must be
        consistent: an error of the acceleration acts like a force per unit mass.

    Raises
    ------
    TypeError
        If one of them cannot be called.

    See Also
    --------
    HarmonicWall : a vibrating wall, evaluated without Python.

    Notes
    -----
    All three functions are called at each evaluation of the force; a `HarmonicWall` or a `Table`
    calls none.

    References
    ----------
    J. M. Luck and A. Mehta, Bouncing ball with a finite restitution: chattering, locking, and
    chaos, Phys. Rev. E 48, 1993.

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


# Dry friction: tangential to gaps and in joints.

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
        Limit while slipping and limit while sticking: coefficients of friction at a gap, forces in
        a joint.
    by_speed : callable or None
        The limit while slipping as a function of the slip speed, instead of `limit`.
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
        The name of its gap or joint.
    gap : int or None
        The number of its gap, None for a joint.
    e_t : float
        Tangential restitution.
    row : int or None
        The number of the direction, of a gap with two.
    """

    name: str
    gap: int | None
    e_t: float = 0.0
    row: int | None = None

    @property
    def label(self) -> str:
        """The name in tables: with the number of the row for a gap with two directions."""
        return self.name if self.row is None else f"{self.name}[{self.row}]"


@hinted("DryFriction")
class DryFriction(Unchanging):
    r"""Dry friction in a joint, in a guide or on a belt under a given load.

    .. math::

        f = -L \operatorname{Sign}(w), \qquad w = b \cdot \dot q - v

    The force acts along :math:`b`. While sticking, :math:`w = 0` exactly, it is the reaction that
    maintains :math:`w = 0`, up to the static limit.

    Parameters
    ----------
    direction : array_like, callable or str
        :math:`b`, of shape (n,), or ``b(t, q)``, or compiled as the parts of a `MechanicalSystem`.
        By default 1, for one coordinate. In a `zivi.Tree` the name of a joint.
    limit : float or callable
        :math:`L \ge 0`, the force of friction while slipping: a number, ``L(t, q, qdot)`` (which
        may depend on the slip speed), or compiled.
    static : float, callable or None
        Its limit while sticking, not less than the limit at slip speed zero; by default the limit.
    velocity : float, callable, HarmonicWall or MovingWall
        :math:`v`, the speed of the counter-surface: a number, ``v(t, q)``, or a motion whose
        velocity is used.
    curvature : callable, float or None
        Callable ``(t, q, qdot) -> float``: the part :math:`k` of :math:`\dot w` that does not
        depend on accelerations. By default it is finite-differenced.
    name : str, optional
        Name in tables and errors; by default ``friction0``, ``friction1``, ... by position.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite, the limit is negative or more than the static one, or a part is
        none of these.

    See Also
    --------
    Gap : friction at a gap.
    MechanicalSystem : the argument ``friction``.

    Notes
    -----
    The force of the system must not contain the dry friction. The page "Friction" (friction.md) has
    the equations and the selection of the modes.

    References
    ----------
    J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, in Nonsmooth
    Mechanics and Applications, Springer, 1988.

    V. Acary and B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, Springer, 2008.

    Examples
    --------
    A mass at a spring on a belt, static 1.2, while slipping 0.8:

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
        self.direction, self.limit, self.static = own(direction), limit, static
        self.velocity, self.curvature = velocity, curvature
        self._name = None if name is None else str(name)
        called = "friction" if name is None else f"friction {name!r}"
        if limit is None:
            raise ValueError(f"limit of {called} must be given, the force of friction in slip")
        named = isinstance(direction, str)  # then the tree knows the row
        row = np.ones(1) if named else _row(f"direction of {called}", direction)
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
        """Name in tables and messages."""
        return self._name

    def in_modes(self, shapes: Array) -> DryFriction:
        """Return the same joint in the amplitudes of modes, whose shapes are the columns."""
        if not isinstance(self._slip.direction, np.ndarray):
            raise ValueError(
                f"direction of {self._name!r} must be an array of shape (n,) in a system of modes"
            )
        new = object.__new__(type(self))
        new.__setstate__(self.__getstate__() | {"direction": self._slip.direction @ shapes})
        return new

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
) -> tuple[Slip, ...]:
    """Read the directions of friction of a gap; an error names the argument and the gap.

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
        return ()
    if mu is None:
        raise ValueError(f"mu of {called} must be given: it has a tangent")
    if isinstance(mu, list | tuple | np.ndarray):
        raise ValueError(
            f"mu of {called} must be one number for all directions, got {mu!r}: coefficients that "
            "depend on the direction are not supported"
        )
    if _is_pair(tangent):
        return _cone(called, tangent, velocity, curvature, coefficients, belt)
    return (_slip_along(called, tangent, velocity, curvature, coefficients, belt),)


def _is_pair(tangent: Any) -> bool:
    """Whether two directions are given: an array of two rows, or a pair of functions."""
    if callable(tangent):
        return False
    if isinstance(tangent, list | tuple) and len(tangent) == 2 and all(map(callable, tangent)):
        return True
    return np.ndim(tangent) == 2 and len(tangent) == 2


def _cone(
    called: str,
    tangent: Any,
    velocity: Any,
    curvature: Any,
    coefficients: tuple[Any, Any],
    belt: Any,
) -> tuple[Slip, ...]:
    """Read friction in two directions: each argument has two entries."""
    if callable(coefficients[0]):
        raise ValueError(
            f"mu of {called} must be a number: a function of the speed is not supported with two "
            "tangents; use mu and mu_static"
        )

    size = 3 if callable(tangent[0]) else np.shape(tangent)[1]
    if size < 3:
        raise ValueError(
            f"tangent of {called} must be one vector of shape ({size},), got two: with the "
            "gradient they need three coordinates"
        )

    def entry(name: str, given: Any, i: int) -> Any:
        if given is None:
            return None
        if not isinstance(given, list | tuple | np.ndarray) or len(given) != 2:
            raise ValueError(f"{name} of {called} must be a pair, one for each tangent")
        return given[i]

    return tuple(
        _slip_along(
            called,
            tangent[i],
            entry("tangent_velocity", velocity, i),
            entry("tangent_curvature", curvature, i),
            coefficients,
            entry("belt", belt, i),
        )
        for i in range(2)
    )


def _slip_along(
    called: str,
    tangent: Any,
    velocity: Any,
    curvature: Any,
    coefficients: tuple[Any, Any],
    belt: Any,
) -> Slip:
    """Read one direction of friction of a gap."""
    mu, mu_static = coefficients
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
            f"{name} must be one vector of shape (n,), or two in an array of shape (2, n), got "
            f"shape {row.shape}"
        )
    if not np.any(row):
        raise ValueError(f"{name} must not be zero, got {row.tolist()}")
    return row


def _moving(
    called: str, velocity: Any, *, several: bool = True
) -> tuple[Part, Part | None, Motion | None]:
    """Return beta, k (None if unknown) and the motion of the counter-surface."""
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
    """Reject numbers that are negative, and a static limit below the limit in slip."""
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
    several = all_of("friction", friction, DryFriction)
    for i, joint in enumerate(several):
        if isinstance(joint.direction, str):
            raise TypeError(
                f"friction[{i}] must have a direction of shape (n,), got the name "
                f"{joint.direction!r}: names of joints are for a zivi.Tree"
            )
    return several


def one_of(name: str, value: Any, known: tuple[str, ...]) -> str:
    """Read a choice by its name."""
    if value not in known:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, known))}, got {value!r}")
    return str(value)


# Compliant gaps: the contact force is a function of depth and rate.


@hinted("SpringDamper")
@dataclasses.dataclass(frozen=True)
class SpringDamper:
    r"""A compliant contact with a linear spring and damper (Kelvin and Voigt).

    .. math:: \lambda = k d + c \dot d, \qquad d = -g

    The contact opens where the force vanishes: the gap is still negative there. Until it is
    open there is no force.

    Parameters
    ----------
    k : float
        Stiffness, > 0 (N/m).
    c : float
        Damping, >= 0 (N s/m).

    Raises
    ------
    ValueError
        If a parameter is out of range.

    See Also
    --------
    Hertz, HuntCrossley : contacts whose stiffness grows with the depth.

    Notes
    -----
    A mass m that hits it leaves with the restitution :math:`\exp(-\zeta s_1)`,
    :math:`s_1 = \operatorname{atan2}(2 \zeta \omega, 2 \zeta^2 - 1)/\omega`,
    :math:`\omega = \sqrt{1 - \zeta^2}`, with :math:`\zeta = c/(2 \sqrt{k m})` and without
    other forces.

    Examples
    --------
    A ball of 1 kg falls on a rubber mat:

    >>> mat = zivi.LinearGap([1], contact=zivi.SpringDamper(k=1e4, c=20.0))
    >>> ball = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[mat])
    >>> sol = zivi.simulate(ball, (0, 2), ([1.0], [0.0]))
    >>> sol.touchdowns["t"].round(6)
    array([0.451524, 1.148428, 1.668205])
    """

    k: float
    c: float = 0.0

    def __post_init__(self) -> None:
        _set_law(self, k="> 0", c=">= 0")

    def __call__(self, depth: float, rate: float) -> float:
        """Return the force (N) at a depth (m) and its rate (m/s)."""
        return self.k * depth + self.c * rate

    _kind = "spring_damper"


@hinted("Hertz")
@dataclasses.dataclass(frozen=True)
class Hertz:
    r"""An elastic contact after Hertz.

    .. math:: \lambda = k d^p, \qquad d = -g

    Parameters
    ----------
    k : float
        Stiffness, > 0 (N/m^p).
    p : float
        Exponent, from 1 to 10; 3/2 of a ball on a plane.

    Raises
    ------
    ValueError
        If a parameter is out of range.

    See Also
    --------
    HuntCrossley : with damping.
    SpringDamper : a linear contact law.

    Notes
    -----
    The force is not smooth where the contact begins, so that steps there are short: a contact takes
    two to three times the evaluations of that with a spring.

    References
    ----------
    H. Hertz, Ueber die Beruehrung fester elastischer Koerper, J. reine angew. Math. 92, 1882.

    K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985.

    Examples
    --------
    >>> anvil = zivi.LinearGap([1], contact=zivi.Hertz(k=1e6))
    >>> hammer = zivi.MechanicalSystem(mass=1.0, force=[0.0], gaps=[anvil])
    >>> sol = zivi.simulate(hammer, (0, 1), ([0.1], [-2.0]))
    >>> float((sol.liftoffs["t"][0] - sol.touchdowns["t"][0]).round(7))
    0.0111529
    """

    k: float
    p: float = 1.5

    def __post_init__(self) -> None:
        _set_law(self, k="> 0", p="from 1 to 10")

    def __call__(self, depth: float, rate: float) -> float:
        """Return the force (N) at a depth (m) and its rate (m/s)."""
        return self.k * float(depth**self.p)

    _kind = "power"


@hinted("HuntCrossley")
@dataclasses.dataclass(frozen=True)
class HuntCrossley:
    r"""A contact after Hertz with a damping that grows with the depth (Hunt and Crossley).

    .. math:: \lambda = k d^p (1 + \alpha \dot d), \qquad d = -g

    Parameters
    ----------
    k : float
        Stiffness, > 0 (N/m^p).
    p : float
        Exponent, from 1 to 10.
    alpha : float
        Damping, >= 0 (s/m). Of slow impacts :math:`1 - e \approx 2 \alpha v/3`.

    Raises
    ------
    ValueError
        If a parameter is out of range.

    See Also
    --------
    Hertz : without damping.
    SpringDamper : a linear contact law.

    Notes
    -----
    Without other forces a mass that comes with v leaves with u,
    :math:`\alpha v - \ln(1 + \alpha v) = -\alpha u - \ln(1 - \alpha u)`, whatever k, p and
    the mass are.

    References
    ----------
    K. H. Hunt and F. R. E. Crossley, Coefficient of restitution interpreted as damping in
    vibroimpact, J. Appl. Mech. 42, 1975.

    Examples
    --------
    >>> zivi.HuntCrossley(k=1e6, alpha=0.3)
    HuntCrossley(k=1000000.0, p=1.5, alpha=0.3)
    """

    k: float
    p: float = 1.5
    alpha: float = 0.0

    def __post_init__(self) -> None:
        _set_law(self, k="> 0", p="from 1 to 10", alpha=">= 0")

    def __call__(self, depth: float, rate: float) -> float:
        """Return the force (N) at a depth (m) and its rate (m/s)."""
        return self.k * float(depth**self.p) * (1.0 + self.alpha * rate)

    _kind = "hunt_crossley"


_RANGES: dict[str, Callable[[float], bool]] = {
    "> 0": lambda value: value > 0.0,
    ">= 0": lambda value: value >= 0.0,
    "from 1 to 10": lambda value: 1.0 <= value <= 10.0,
}


def _set_law(law: Any, **ranges: str) -> None:
    """Check the numbers of a law and make them floats."""
    for name, wanted in ranges.items():
        value = finite(name, getattr(law, name))
        if not _RANGES[wanted](value):
            raise ValueError(f"{name} must be {wanted}, got {value}")
        object.__setattr__(law, name, value)


ContactLaw: TypeAlias = SpringDamper | Hertz | HuntCrossley | Callable[[float, float], float]
"""The force of a compliant gap as a function of its depth and rate."""


def contact_law(called: str, contact: Any) -> ContactLaw | None:
    """Read the law of a compliant gap, None of a rigid one."""
    if contact is None or isinstance(contact, SpringDamper | Hertz | HuntCrossley):
        return contact
    if not callable(contact):
        raise TypeError(
            f"contact of {called} must be a zivi.SpringDamper, zivi.Hertz, zivi.HuntCrossley or a "
            f"function of depth and rate, got {contact!r}"
        )
    check_arguments(f"contact of {called}", contact, "depth, rate")
    return contact  # type: ignore[no-any-return]


def compliant_gaps(
    laws: Iterable[ContactLaw | None],
) -> list[tuple[int, str, list[float], Any]]:
    """Return the contact laws of the compliant gaps for the extension."""
    given: list[tuple[int, str, list[float], Any]] = []
    for i, law in enumerate(laws):
        if isinstance(law, SpringDamper | Hertz | HuntCrossley):
            numbers = [getattr(law, field.name) for field in dataclasses.fields(law)]
            given.append((i, law._kind, numbers, None))
        elif law is not None:
            given.append((i, "function", [], law))
    return given


# Gaps: functions of time and coordinates that stay non-negative.


@hinted("Gap")
class Gap(Unchanging):
    r"""A unilateral constraint :math:`g(t, q) \ge 0`.

    Parameters
    ----------
    value : callable
        ``g(t, q)``, a float; or compiled, ``void (t, q*, qdot*, out*)``.
    gradient : callable or array_like
        Callable ``(t, q)`` that returns :math:`\partial g/\partial q`, of shape (n,), or a constant
        array.
    curvature : callable, float or None
        Callable ``(t, q, qdot) -> float``, the bias acceleration
        :math:`h = \dot q^T H \dot q + 2 g_{tq} \dot q + g_{tt}` with the Hessian :math:`H`: the
        part of :math:`\ddot g` that does not depend on accelerations. By default six evaluations
        of the gradient give finite differences, accurate to about 1e-11 if gradient and rate vary
        over lengths and times of order one.
    rate : callable, float or None
        Callable ``(t, q) -> float``, the partial derivative :math:`\partial g/\partial t`; by
        default the gap does not depend on time.
    name : str, optional
        Name in errors and plots; by default ``gap0``, ``gap1``, ... by position.
    tangent : callable or array_like, optional
        With friction: the direction :math:`B` of slip, of shape (n,), as ``(t, q)`` or an array,
        on the scale of the gap: of a distance, the unit tangent; one that is `c` times as long
        means `c * mu`. The slip speed is :math:`w = B \dot q + \beta`. Two orthogonal directions
        of one length, an array of shape (2, n) or a pair of functions, make Coulomb's cone of a
        body in space, others an elliptical one.
    tangent_velocity : callable, float or None
        Callable ``(t, q) -> float``: the drift :math:`\beta` of the slip velocity (m/s), for a
        conveyor belt minus its speed. Default 0. With two tangents a pair.
    tangent_curvature : callable, float or None
        Callable ``(t, q, qdot) -> float``: the part :math:`k` of :math:`\dot w` that does not
        depend on accelerations. By default it is finite-differenced. With two tangents a pair.
    mu : float or callable
        Coefficient of friction, >= 0, or ``mu(speed)`` of the slip speed >= 0. With 0 the gap is
        frictionless.
    mu_static : float, optional
        Coefficient of friction while sticking, at least ``mu``; by default ``mu``.
    e_t : float
        Tangential restitution in [0, 1]; other values than 0 are for superballs.
    contact : SpringDamper, Hertz, HuntCrossley or callable, optional
        Makes the gap compliant: it may become negative, and its contact force is this law, or
        ``contact(depth, rate)`` with the depth -g >= 0 (m) and its rate (m/s), in N. The force is
        zero where the law would be attractive. By default the gap is rigid.

    Raises
    ------
    TypeError
        If a part is none of these.
    ValueError
        If a coefficient is out of range, there is a tangent without `mu`, or `mu` without one.

    See Also
    --------
    LinearGap : gaps linear in the coordinates.
    DryFriction : friction in joints.

    Notes
    -----
    Gradient, curvature, rate and tangent_curvature are compared with differences once, at the start
    of a run (to 1e-5). Without friction, which of the functions that describe a surface is taken
    does not matter.

    References
    ----------
    B. Brogliato, Nonsmooth Mechanics, 3rd ed., Springer, 2016.

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
        contact: ContactLaw | None = None,
    ) -> None:
        called = "gap" if name is None else f"gap {name!r}"
        self._name = None if name is None else str(name)
        self._contact = contact_law(called, contact)
        self.value, self.gradient, self.curvature, self.rate = value, own(gradient), curvature, rate
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
        """Read the friction; coefficients of 0 mean none."""
        coefficients = given["mu"], given["mu_static"]
        velocity, curvature = given.get("tangent_velocity"), given.get("tangent_curvature")
        tangent = given["tangent"]
        self._slips = slip_of_gap(called, tangent, velocity, curvature, coefficients, belt)
        self._directions_known = False
        self._e_t = tangential_restitution(called, given["e_t"])
        if len(self._slips) > 1 and (self._e_t or self._contact is not None):
            name, value = ("e_t", self._e_t) if self._e_t else ("contact", self._contact)
            raise ValueError(
                f"{name} of {called} is not supported with two tangents, got {value!r}; use a "
                "rigid gap with e_t=0, or one tangent"
            )
        if tangent is None and self._e_t:
            raise ValueError(f"e_t of {called} needs a tangent, the direction of slip")
        if self._contact is not None and self._e_t:
            raise ValueError(f"e_t of {called} must be 0: a compliant gap does not have impacts")
        if all(slip.is_smooth() for slip in self._slips) and self._e_t == 0.0:
            self._slips = ()
        self._friction = {} if tangent is None else {k: own(it) for k, it in given.items()}

    @property
    def name(self) -> str | None:
        """Name in messages and plots."""
        return self._name

    @property
    def contact(self) -> ContactLaw | None:
        """The law of the contact force of a compliant gap, None of a rigid one."""
        return self._contact

    def _know_directions(self, n: int) -> None:
        """Read how many directions a tangent gives that is a function of `n` coordinates."""
        tangent = self._friction.get("tangent")
        if not self._slips or self._directions_known or not callable(tangent):
            return
        if isinstance(tangent, Compiled) or isinstance(self._slips[0].direction, Compiled):
            return
        self._directions_known = True
        try:
            shape = np.shape(tangent(0.0, np.zeros(n)))
        except Exception:  # a function that has no value there gives one direction
            return
        if shape == (2, n):
            given: dict[str, Any] = dict(self._friction)
            given["tangent"] = [
                lambda t, q: np.asarray(tangent(t, q), dtype=np.float64)[0],
                lambda t, q: np.asarray(tangent(t, q), dtype=np.float64)[1],
            ]
            called = "gap" if self._name is None else f"gap {self._name!r}"
            self._rub(given, called, given.get("belt"))
            self._friction["tangent"] = tangent

    def _parts(self) -> tuple[Part, Part, Part, Part]:
        """Return value, gradient, curvature and rate."""
        return self._value, self._gradient, self._curvature, self._rate

    def __repr__(self) -> str:
        return f"{type(self).__name__}(name={self._name!r}{self._friction_text()})"

    def _friction_text(self) -> str:
        """Show the coefficients of friction."""
        told = {name: self._friction.get(name) for name in ("mu", "mu_static")}
        told |= {"e_t": self._e_t or None, "contact": self._contact}
        return "".join(f", {name}={value!r}" for name, value in told.items() if value is not None)

    def __getstate__(self) -> dict[str, Any]:
        names = ("value", "gradient", "curvature", "rate", "_name")
        contact = {} if self._contact is None else {"contact": self._contact}
        return {name: getattr(self, name) for name in names} | self._friction | contact

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
        With friction: the direction of slip, of shape (n,), or two at right angles, of shape
        (2, n). Their lengths count, as for `Gap`.
    mu, mu_static, e_t, contact
        As for `Gap`.
    belt : float, HarmonicWall or MovingWall
        The speed of the surface along the tangent, or its motion; by default it does not move. With
        two tangents a pair.

    Raises
    ------
    ValueError, TypeError
        If the normal is zero or a number is not finite; if the motion is none; as for `Gap`.

    See Also
    --------
    Gap : nonlinear gap functions.
    HarmonicWall : a vibrating wall.

    Notes
    -----
    The gradient is constant, so a gap costs a scalar product, and its impact is a root of a
    polynomial.

    References
    ----------
    B. Brogliato, Nonsmooth Mechanics, 3rd ed., Springer, 2016.

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
        contact: ContactLaw | None = None,
    ) -> None:
        n = read_only(np.atleast_1d(real_array("normal", normal)))
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
            super().__init__(lambda t, q: float(n @ q) + c, n, 0.0, 0.0, name, contact=contact)
        else:
            at = motion._at
            super().__init__(
                lambda t, q: float(n @ q) + c - at(t)[0],
                n,
                lambda t, q, qdot: -at(t)[2],
                lambda t, q: -at(t)[1],
                name,
                contact=contact,
            )
        called = "gap" if name is None else f"gap {name!r}"
        if tangent is not None:
            tangent = np.atleast_1d(real_array(f"tangent of {called}", tangent))
        given = {"tangent": tangent, "mu": mu, "mu_static": mu_static, "e_t": e_t, "belt": belt}
        self._rub(given, called, belt)

    def with_normal(self, normal: Array) -> LinearGap:
        """Return the gap of other coordinates, with this normal and without friction."""
        return LinearGap(normal, self.offset, self.motion, self.name, contact=self.contact)

    def __repr__(self) -> str:
        motion = "" if self.motion is None else f", motion={self.motion!r}"
        name = "" if self.name is None else f", name={self.name!r}"
        told = f"{motion}{name}{self._friction_text()}"
        return f"LinearGap({self.normal.tolist()}, offset={self.offset}{told})"

    def __getstate__(self) -> dict[str, Any]:
        names = ("normal", "offset", "motion", "_name")
        contact = {} if self._contact is None else {"contact": self._contact}
        return {name: getattr(self, name) for name in names} | self._friction | contact

    def __setstate__(self, state: dict[str, Any]) -> None:
        more = dict(state)
        parts = [more.pop(name) for name in ("normal", "offset", "motion", "_name")]
        LinearGap.__init__(self, *parts, **more)
