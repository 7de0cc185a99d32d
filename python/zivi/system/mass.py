"""What moves: a mass under a force, above a wall that takes part of its velocity."""

from __future__ import annotations

import ctypes
import dataclasses
import math
import numbers
import sys
from collections.abc import Callable
from typing import Any, TypeAlias

from zivi import _zivi
from zivi.base.check import finite
from zivi.base.functions import compiled_by_numba, of_three
from zivi.system.parametric import ParametricForce
from zivi.system.transform import coefficients
from zivi.system.wall import HarmonicWall, MovingWall

_CFunction = type(ctypes.CFUNCTYPE(None)()).__mro__[1]
"""The class of all function pointers of ctypes (which it does not name publicly)."""

__all__ = ["Force", "ImpactSystem", "LinearForce", "check_system"]

WRAPPED = "zivi.simulate(zivi.ImpactSystem(force, e=0.5), t_span, y0)"
"""How a force becomes a run."""

Force: TypeAlias = "float | LinearForce | Callable[[float, float, float], float] | Any"
"""A number, a `LinearForce`, a callable ``f(t, x, xdot)`` or ``f(t, y)``, a compiled callable."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LinearForce:
    r"""Spring, damper, gravity and a harmonic excitation, evaluated without the interpreter.

    .. math:: f = -k x - c \dot x - g + A \cos(\omega t + \varphi)

    All coefficients are per unit mass, given by name. The object can also be
    called, ``force(t, x, xdot)``.

    Parameters
    ----------
    stiffness : float
        :math:`k` (1/s^2).
    damping : float
        :math:`c` (1/s).
    gravity : float
        :math:`g`, a constant pull towards the wall (m/s^2).
    amplitude : float
        :math:`A` (m/s^2). A table that vibrates with amplitude `a` gives
        :math:`A = a \omega^2` in its own frame.
    omega : float
        :math:`\omega` (rad/s).
    phase : float
        :math:`\varphi` (rad).

    Raises
    ------
    ValueError
        If a coefficient is not finite.

    Examples
    --------
    >>> force = zivi.LinearForce(gravity=9.81, damping=0.1)
    >>> force(0.0, 1.0, 2.0)
    -10.01
    """

    stiffness: float = 0.0
    damping: float = 0.0
    gravity: float = 0.0
    amplitude: float = 0.0
    omega: float = 1.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            object.__setattr__(self, field.name, finite(field.name, value))

    def __call__(self, t: float, x: float, xdot: float) -> float:
        """Evaluate the force (m/s^2) at time `t` (s), distance `x` (m), velocity `xdot` (m/s)."""
        excitation = self.amplitude * math.cos(self.omega * t + self.phase)
        return -self.stiffness * x - self.damping * xdot - self.gravity + excitation


class ImpactSystem:
    r"""A mass above a wall: :math:`\ddot x = f(t, x, \dot x)`, :math:`x \ge 0`.

    At an impact :math:`\dot x^+ = -e\,\dot x^-`; at rest on the wall the mass stays while
    :math:`f \le 0` and leaves when :math:`f > 0`.

    Parameters
    ----------
    force : float, LinearForce, ParametricForce or callable
        Force per unit mass, an acceleration (m/s^2): a number; a `LinearForce`; a
        `ParametricForce`; a callable
        ``f(t, x, xdot) -> float``, or, if it has two arguments, ``f(t, y)`` with an array
        ``y = [x, xdot]``; or a compiled callable of the C signature
        ``double (double t, double x, double xdot)``, run without the interpreter: a
        `scipy.LowLevelCallable`, a numba ``@cfunc`` or a `ctypes` function pointer. A function of
        numba's ``@njit``, of either form, is compiled to one. A compiled callable that has no
        value returns NaN, which ends the run; what it raises (in ctypes or numba) counts as NaN
        and is raised by the run. The ``user_data`` of a `LowLevelCallable` is passed as a fourth
        argument, ``void *``, if the signature has one; nothing is checked there, and it must live
        as long as the system.
    e : float, optional
        Coefficient of restitution in [0, 1]: 0 plastic, 1 elastic.
    kappa : float, optional
        :math:`\kappa = (1-e)/(1+e)` in [0, 1]. Exactly one of `e` and `kappa` is given.
    wall : HarmonicWall or MovingWall, optional
        A wall that moves, :math:`x \ge w(t)`. The force is then still that of the fixed frame,
        ``f(t, x, xdot)``; initial states and results are in the wall's frame, the distance
        :math:`x - w` and its rate, where the impacts obey restitution. `Trajectory.fixed` gives
        the other frame.

    Attributes
    ----------
    force
        The force as given.
    e, kappa : float
        Both coefficients.
    wall
        The moving wall, or None.

    Raises
    ------
    ValueError
        If not exactly one of `e` and `kappa` is given, or it is out of range, or a number
        `force` is not finite.
    TypeError
        If `force` is none of the above, takes other arguments, or does not compile.

    Examples
    --------
    >>> zivi.ImpactSystem(-9.81, e=0.5)
    ImpactSystem(force=-9.81, e=0.5, kappa=0.3333333333333333)
    >>> spring = zivi.ImpactSystem(lambda t, y: 1.0 - 4.0 * y[0], e=0.5)
    >>> float(zivi.simulate(spring, (0, 1), (0.25, 0)).x[-1])  # in equilibrium
    0.25
    """

    __slots__ = ("_core", "_e", "_force", "_kappa", "_spec", "_wall")

    def __init__(
        self,
        force: Force,
        *,
        e: float | None = None,
        kappa: float | None = None,
        wall: HarmonicWall | MovingWall | None = None,
    ) -> None:
        self._e, self._kappa = coefficients(e, kappa)
        self._force = force
        if not (wall is None or isinstance(wall, HarmonicWall | MovingWall)):
            raise TypeError(
                f"wall must be None, a zivi.HarmonicWall or a zivi.MovingWall, got {wall!r}"
            )
        self._wall = wall
        self._prepare()

    def _prepare(self) -> None:
        self._spec = in_wall_frame(self, force_spec(self._force))
        restitution = _zivi.Restitution.of_both(self._e, self._kappa)
        self._core = _zivi.PointMass(self._spec, restitution)

    def __getstate__(self) -> tuple[Any, ...]:
        return self._force, self._e, self._kappa, self._wall

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self._force, self._e, self._kappa, self._wall = state
        self._prepare()  # an address is of this process

    @property
    def force(self) -> Force:
        """The force as given."""
        return self._force

    @property
    def wall(self) -> HarmonicWall | MovingWall | None:
        """The moving wall, or None."""
        return self._wall

    @property
    def e(self) -> float:
        """Coefficient of restitution."""
        return self._e

    @property
    def kappa(self) -> float:
        """Parameter of the transform, ``(1 - e)/(1 + e)``."""
        return self._kappa

    def __repr__(self) -> str:
        wall = "" if self._wall is None else f", wall={self._wall!r}"
        return f"ImpactSystem(force={self._force!r}, e={self._e!r}, kappa={self._kappa!r}{wall})"


def in_wall_frame(system: ImpactSystem, spec: _zivi.Force) -> _zivi.Force:
    """Translate a force of the fixed frame into the frame of the system's wall."""
    return spec if system.wall is None else _zivi.Force.above(system.wall._spec(), spec)


def force_spec(force: Any, name: str = "force") -> _zivi.Force:
    """Translate a force into what the extension takes; it holds the owner of compiled code."""
    if isinstance(force, numbers.Real):
        return _zivi.Force.constant(finite(name, force))
    if isinstance(force, LinearForce):
        return _zivi.Force.linear(**vars(force))
    if isinstance(force, ParametricForce):
        return force._spec()
    # an object of SciPy's class can only be here if SciPy has been imported
    low_level = getattr(sys.modules.get("scipy"), "LowLevelCallable", None)
    if low_level is not None and isinstance(force, low_level):
        return _zivi.Force.low_level(force, name)
    if isinstance(force, _CFunction):
        return _zivi.Force.compiled(_ctypes_address(force, name), owner=force)
    if hasattr(force, "address") and isinstance(getattr(force, "ctypes", None), _CFunction):
        return _zivi.Force.compiled(_ctypes_address(force.ctypes, name), owner=force)
    if callable(force):
        if (code := compiled_by_numba(force, name)) is not None:
            return _zivi.Force.compiled(code.address, owner=code)
        return _zivi.Force.callable(of_three(name, force, more_than_y=False))
    raise TypeError(
        f"{name} must be a number, a zivi.LinearForce, a callable f(t, x, xdot) or f(t, y), or a "
        f"compiled callable (scipy.LowLevelCallable, numba cfunc), got {type(force).__name__}"
    )


def _ctypes_address(function: Any, name: str) -> int:
    arguments = list(function.argtypes or [])
    if function.restype is not ctypes.c_double or arguments != [ctypes.c_double] * 3:
        names = [getattr(kind, "__name__", str(kind)) for kind in arguments]
        result = getattr(function.restype, "__name__", str(function.restype))
        raise TypeError(
            f"{name}, compiled, must have the signature double (double t, double x, double xdot), "
            f"got {result} ({', '.join(names)})"
        )
    address = ctypes.cast(function, ctypes.c_void_p).value
    if not address:
        raise ValueError(f"{name}: the compiled function is a null pointer")
    return address


def check_system(system: Any) -> None:
    """Refuse what is no system, above all the arguments of `solve_ivp` in its order."""
    if isinstance(system, ImpactSystem):
        return
    advice = ""
    if isinstance(system, type) and issubclass(system, ImpactSystem):
        got = "the class, not a system: zivi.ImpactSystem(force, e=0.5)"
    elif callable(system) or isinstance(system, int | float):
        got = "a force" if callable(system) else f"the number {system!r}"
        advice = f": the force makes a system with a wall, {WRAPPED}"
        if callable(system):
            advice += "; it returns the acceleration alone, not [xdot, acceleration]"
    elif isinstance(system, list | tuple) or hasattr(system, "__array__"):
        got = f"{system!r}: the system is the first argument, the span the second, {WRAPPED}"
    else:
        got = type(system).__name__
    raise TypeError(f"system must be a zivi.ImpactSystem, got {got}{advice}")
