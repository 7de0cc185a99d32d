"""Forces: those that the core evaluates by itself, and what the extension takes of any."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
import numbers
import sys
from collections.abc import Callable
from typing import Any, Self, TypeAlias

import zivi._zivi as _zivi
from zivi.base.check import finite
from zivi.base.functions import OfState, compiled_by_numba, of_three, reads_time
from zivi.base.habits import hinted
from zivi.system.parametric import ParametricForce
from zivi.system.table import Table

_CFunction = type(ctypes.CFUNCTYPE(None)()).__mro__[1]
"""The class of all function pointers of ctypes (which it does not name publicly)."""

__all__ = ["Force", "LinearForce", "NativeForce", "force_spec"]

Force: TypeAlias = "float | LinearForce | Callable[[float, float, float], float] | Any"
"""A number, a `LinearForce`, a callable ``f(t, x, xdot)`` or ``f(t, y)``, a compiled callable."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class NativeForce:
    """A force that the core evaluates by itself: its fields are the numbers of that force.

    A subclass is a frozen dataclass of the name and with the fields that the core has; they are
    parameters, by which runs can be differentiated and orbits continued.
    """

    def __post_init__(self) -> None:
        for name, value in self._numbers().items():
            object.__setattr__(self, name, finite(name, value))

    def _numbers(self) -> dict[str, float]:
        """Give the numbers by their names, in the order of the core."""
        kind: Any = type(self)
        return {name: getattr(self, name) for name in _names_of(kind)}

    def _moved(self, name: str, value: float) -> Self:
        """Give the same force with another number."""
        new = object.__new__(type(self))
        vars(new).update(vars(self))
        object.__setattr__(new, name, finite(name, value))
        return new

    @property
    def _excitation(self) -> float | None:
        """The angular frequency of a harmonic excitation, None without one."""
        return None

    def _spec(self) -> _zivi.Force:
        return _zivi.Force.native(type(self).__name__, **self._numbers())


@functools.cache
def _names_of(kind: type[Any]) -> tuple[str, ...]:
    """Name the fields of a force that are numbers."""
    return tuple(it.name for it in dataclasses.fields(kind) if it.name != "excitation")


@hinted("LinearForce")
@dataclasses.dataclass(frozen=True, kw_only=True)
class LinearForce(NativeForce):
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
    excitation : Table, optional
        A further excitation as a table of time (m/s^2), added to the wave. Only `simulate`,
        `simulate_batch`, `sensitivity` and closed loops take it.

    Raises
    ------
    ValueError
        If a coefficient is not finite, or the table has several values.
    TypeError
        If the excitation is no `Table`.

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
    excitation: Table | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.excitation is not None:
            if not isinstance(self.excitation, Table):
                raise TypeError(f"excitation must be a zivi.Table, got {self.excitation!r}")
            self.excitation._scalar("excitation")

    def __call__(self, t: float, x: float, xdot: float) -> float:
        """Evaluate the force (m/s^2) at time `t` (s), distance `x` (m), velocity `xdot` (m/s)."""
        excitation = self.amplitude * _zivi.cosine(self.omega * t + self.phase)
        if self.excitation is not None:
            excitation += self.excitation._at(t)[0]
        return -self.stiffness * x - self.damping * xdot - self.gravity + excitation

    @property
    def _excitation(self) -> float | None:
        return None if self.amplitude == 0.0 else abs(self.omega)

    def _spec(self) -> _zivi.Force:
        if self.excitation is None:
            return super()._spec()
        return _zivi.Force.with_table(list(self._numbers().values()), self.excitation._core)

    def __repr__(self) -> str:
        more = {} if self.excitation is None else {"excitation": self.excitation}
        parts = (f"{name}={value!r}" for name, value in (self._numbers() | more).items())
        return f"LinearForce({', '.join(parts)})"

    def __getstate__(self) -> dict[str, Any]:
        state = dict(vars(self))
        if self.excitation is None:
            del state["excitation"]  # as before there was one
        return state


def force_spec(force: Any, name: str = "force") -> _zivi.Force:
    """Translate a force into what the extension takes; it holds the owner of compiled code."""
    if isinstance(force, numbers.Real):
        return _zivi.Force.constant(finite(name, force))
    if isinstance(force, NativeForce | ParametricForce):
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
        timed = reads_time(force)
        if (code := compiled_by_numba(force, name)) is not None:
            return _zivi.Force.compiled(code.address, owner=code, reads_time=timed)
        if isinstance(of_three(name, force, more_than_y=False), OfState):
            return _zivi.Force.callable(force, of_array=True, reads_time=timed)
        return _zivi.Force.callable(force, reads_time=timed)
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
