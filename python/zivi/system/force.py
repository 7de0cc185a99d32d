"""Forces: native ones and those of the user, with parameters."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
import numbers
import sys
from collections.abc import Callable, Mapping
from typing import Any, Self, TypeAlias

import zivi._zivi as _zivi
from zivi.base.check import (
    OfState,
    check_arguments,
    compiled_by_numba,
    finite,
    is_jitted,
    of_three,
    reads_time,
)
from zivi.base.habits import hinted
from zivi.system.table import Table

# Forces of the user with parameters that a run can be differentiated by.

RESERVED = ("x0", "xdot0", "t0", "e")
"""Names that `zivi.sensitivity` has for something else."""
MOST_COMPILED = 5
"""Parameters of a compiled force."""


@dataclasses.dataclass(frozen=True)
class ParametricForce:
    r"""A force :math:`f(t, x, \dot x; p_1, p_2, \dots)` with named parameters.

    Parameters
    ----------
    f : callable
        ``f(t, x, xdot, p1, p2, ...) -> float`` (m/s^2), the parameters in the order of
        `parameters`: a Python function, or a compiled one whose arguments are all doubles (a numba
        ``@cfunc``, a `ctypes` function pointer; at most 5 parameters), which runs without the
        interpreter. A function of numba's ``@njit`` is compiled to one.
    parameters : dict of str to float
        Names and values.
    jacobian : callable, optional
        ``jacobian(t, x, xdot, p1, ...) -> (f_t, f_x, f_xdot, f_p1, ...)``. Without it derivatives
        are central differences, each of two more evaluations, whose own error is about 1e-10.

    Raises
    ------
    TypeError
        If `f` or `jacobian` cannot be called, or a compiled `f` has other arguments.
    ValueError
        If a value is not finite, or a name is taken: ``x0``, ``xdot0``, ``t0``, ``e``.

    See Also
    --------
    LinearForce : linear forces, with exact flights.
    sensitivity : derivatives with respect to the parameters.

    Examples
    --------
    >>> spring = zivi.ParametricForce(
    ...     lambda t, x, xdot, k, b: -k * x - b * x**3 - 1.0, {"k": 4.0, "b": 0.5})
    >>> system = zivi.ImpactSystem(spring, e=0.5)
    >>> s = zivi.sensitivity(system, (0, 5), (1, 0), wrt=("k", "b"))
    >>> s.zeno_times.shape
    (1, 2)
    """

    f: Callable[..., float] | Any
    parameters: Mapping[str, float]
    jacobian: Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        if not callable(self.f) and not hasattr(self.f, "address"):
            raise TypeError(f"f must be a function f(t, x, xdot, ...), got {self.f!r}")
        if self.jacobian is not None and not callable(self.jacobian):
            raise TypeError(f"jacobian must be a function or None, got {self.jacobian!r}")
        if not isinstance(self.parameters, Mapping) or not self.parameters:
            raise TypeError(
                f"parameters must be a dict of names and values, got {self.parameters!r}"
            )
        values = {}
        for name, value in self.parameters.items():
            if not isinstance(name, str) or name in RESERVED or "." in name:
                raise ValueError(
                    f"parameters: {name!r} cannot be a name; {', '.join(RESERVED)} and names with "
                    "a dot are taken"
                )
            values[name] = finite(f"parameters[{name!r}]", value)
        object.__setattr__(self, "parameters", values)
        arguments = ", ".join(("t", "x", "xdot", *values))
        if callable(self.f) and getattr(self.f, "ctypes", None) is None:
            check_arguments("f", self.f, arguments)
        if self.jacobian is not None:
            check_arguments("jacobian", self.jacobian, arguments)

    def __call__(self, t: float, x: float, xdot: float) -> float:
        """Evaluate the force (m/s^2) with the values of the parameters."""
        return float(self._function()(t, x, xdot, *self.parameters.values()))

    def _function(self) -> Callable[..., float]:
        compiled = getattr(self.f, "ctypes", None)
        return compiled if compiled is not None else self.f

    def replace(self, **values: float) -> ParametricForce:
        """Return the same force with other values of some parameters.

        Parameters
        ----------
        **values
            New values by name.

        Returns
        -------
        ParametricForce
            A new force.

        Raises
        ------
        ValueError
            For a name that is none of its parameters.
        """
        for name in values:
            if name not in self.parameters:
                raise ValueError(
                    f"unknown parameter {name!r}; this force has the parameters "
                    f"{', '.join(self.parameters)}"
                )
        return dataclasses.replace(self, parameters={**self.parameters, **values})

    def _compiled(self) -> tuple[int, object] | None:
        """Return the address of a compiled function and the owner of its code."""
        code = _parametric_by_numba(self.f, len(self.parameters))
        owner: Any = code if code is not None else self.f
        pointer: Any = getattr(owner, "ctypes", owner)
        if getattr(pointer, "argtypes", None) is None or not hasattr(pointer, "restype"):
            return None
        n = len(self.parameters)
        if pointer.restype is not ctypes.c_double or list(pointer.argtypes) != (
            [ctypes.c_double] * (3 + n)
        ):
            raise TypeError(
                f"f, compiled, must return a double and take {3 + n} of them, (t, x, xdot, "
                f"{', '.join(self.parameters)})"
            )
        if n > MOST_COMPILED:
            raise ValueError(f"parameters: a compiled force has at most {MOST_COMPILED}, got {n}")
        address = ctypes.cast(pointer, ctypes.c_void_p).value
        if not address:
            raise ValueError("f: the compiled function is a null pointer")
        return address, owner

    def _spec(self) -> _zivi.Force:
        """Return the force for the extension."""
        values, timed = list(self.parameters.values()), reads_time(self.f)
        if (compiled := self._compiled()) is not None:
            address, owner = compiled
            plain = _zivi.Force.compiled(address, parameters=values, owner=owner, reads_time=timed)
        else:
            plain = _zivi.Force.callable(self, reads_time=timed)
        return _zivi.Force.parametric(plain, self._function(), values, self.jacobian)


def _parametric_by_numba(function: Any, n: int) -> Any:
    if not is_jitted(function):
        return None
    known = function.__dict__.get("_zivi_parametric")
    if known is None:
        import numba

        numbers = ", ".join(f"p{k}" for k in range(3 + n))
        scope: dict[str, Any] = {"function": function}
        exec(f"def law({numbers}):\n    return function({numbers})", scope)
        signature = f"float64({', '.join(['float64'] * (3 + n))})"
        known = function.__dict__.setdefault(
            "_zivi_parametric", numba.cfunc(signature)(scope["law"])
        )
    return known


# Forces that the core evaluates without a callback, and the adapter for all others.

_CFunction = type(ctypes.CFUNCTYPE(None)()).__mro__[1]
"""The class of all function pointers of ctypes (which it does not name publicly)."""


Force: TypeAlias = "float | LinearForce | Callable[[float, float, float], float] | Any"
"""A number, a `LinearForce`, a callable ``f(t, x, xdot)`` or ``f(t, y)``, a compiled callable."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class NativeForce:
    """A force that the core evaluates without a callback: its fields are the parameters.

    A subclass is a frozen dataclass of the name and with the fields that the core has; they are
    parameters, by which runs can be differentiated and orbits continued.
    """

    def __post_init__(self) -> None:
        for name, value in self._numbers().items():
            object.__setattr__(self, name, finite(name, value))

    def _numbers(self) -> dict[str, float]:
        """Return the numbers by their names, in the order of the core."""
        kind: Any = type(self)
        return {name: getattr(self, name) for name in _number_fields(kind)}

    def _moved(self, name: str, value: float) -> Self:
        """Return the same force with another number."""
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
def _number_fields(kind: type[Any]) -> tuple[str, ...]:
    """List the numeric fields of a force."""
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
        :math:`g`, a constant acceleration towards the wall (m/s^2).
    amplitude : float
        :math:`A` (m/s^2). A table that vibrates with amplitude `a` gives
        :math:`A = a \omega^2` in its own frame.
    omega : float
        :math:`\omega` (rad/s).
    phase : float
        :math:`\varphi` (rad).
    excitation : Table, optional
        A further excitation as a table of time (m/s^2), added to the wave. Supported by `simulate`,
        `simulate_batch`, `sensitivity` and closed loops only.

    Raises
    ------
    ValueError
        If a coefficient is not finite, or the table has several values.
    TypeError
        If the excitation is no `Table`.

    See Also
    --------
    ParametricForce : functions with named parameters.
    ImpactSystem : the system of a force.

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
            state.pop("excitation", None)  # as before there was one
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
