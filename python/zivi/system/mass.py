"""One mass above a wall: its forces, its wall, and the transform of its motion."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
import numbers
import sys
from collections.abc import Callable, Mapping
from typing import Any, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import (
    Array,
    MaybeNone,
    OfState,
    check_arguments,
    compiled_by_numba,
    finite,
    is_jitted,
    of_three,
    reads_time,
    real,
    real_array,
)
from zivi.base.extras import import_attribute
from zivi.base.habits import attribute_error, hinted
from zivi.system.gap import DryFriction, HarmonicWall, MovingWall, joints_of
from zivi.system.impact_law import ImpactLaw, NewtonImpact, law_of
from zivi.system.table import Table, declared_breaks

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

    Notes
    -----
    The function is called with the parameters by name, once per evaluation. Without `jacobian` its
    partial derivatives are central differences, two more evaluations for each parameter and for `x`
    and `xdot`.

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

    Notes
    -----
    Flights under this force are power series that are computed to rounding; `SwitchedRK` then
    evaluates no force. `sensitivity`, orbits and batches use the same series.

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


# The Zhuravlev-Ivanov transform between ``(x, x')`` and ``(s, v)``.


def lift(
    x: ArrayLike,
    xdot: ArrayLike,
    *,
    e: float | None = None,
    kappa: float | None = None,
    branch: Literal["positive", "negative"] = "positive",
) -> tuple[Array, Array]:
    r"""Lift physical states to the transform's coordinates.

    .. math:: s = \sigma x, \qquad v = \sigma \dot x / (1 - \kappa\,\mathrm{sgn}\,\dot x)

    Parameters
    ----------
    x : array_like
        Distance from the wall, :math:`x \ge 0` (m), any shape.
    xdot : array_like
        Velocity (m/s), broadcast against `x`. At the wall, a velocity into it lifts to the
        state at the impact, whose projection is the velocity after it.
    e, kappa : float
        Exactly one of the coefficient of restitution and :math:`\kappa = (1-e)/(1+e)`,
        in [0, 1].
    branch : {"positive", "negative"}
        The sign :math:`\sigma` of `s`.

    Returns
    -------
    s, v : ndarray
        Transformed position (m) and velocity (m/s), of the broadcast shape.

    Raises
    ------
    ValueError
        If some `x` is negative, `x` or `xdot` is not finite, `e`, `kappa` or `branch` is out of
        range, or ``e = 0`` and some `xdot` is positive: it has no finite image.

    See Also
    --------
    project : the inverse transform.
    SwitchedRK : the method that reports lifted states.

    Notes
    -----
    The Zhuravlev-Ivanov transform removes the velocity jump at impacts: ``s`` and ``v`` are
    continuous in time. They obey equation (2) of Huber and Oza, whose inverse,
    ``v = xdot/(1 - kappa)``, holds for ``xdot >= 0`` only.

    References
    ----------
    V. Ph. Zhuravlev, A method for analysing vibration-impact systems by means of special functions,
    Mechanics of Solids 11, 1976.

    A. P. Ivanov, Analytical methods in the theory of vibro-impact systems, J. Appl. Math. Mech. 57,
    1993.

    Examples
    --------
    >>> s, v = zivi.lift(1.0, -3.0, kappa=0.5)
    >>> float(s), float(v)
    (1.0, -2.0)
    """
    e, kappa = coefficients(e, kappa)
    if branch not in ("positive", "negative"):
        raise ValueError(f"branch must be 'positive' or 'negative', got {branch!r}")
    position, velocity = _broadcast(x=x, xdot=xdot)
    if not (np.all(position >= 0.0) and np.all(np.isfinite(position))):
        raise ValueError("x must be finite and >= 0 (the wall is at 0)")
    if not np.all(np.isfinite(velocity)):
        raise ValueError("xdot must be finite")
    if kappa == 1.0 and np.any(velocity > 0.0):
        raise ValueError("e must be > 0 to lift a velocity away from the wall (R = 0 there)")
    sigma = 1.0 if branch == "positive" else -1.0
    s, v = _zivi.lift(np.ravel(position), np.ravel(velocity), sigma, kappa)
    return s.reshape(position.shape), v.reshape(position.shape)


def project(
    s: ArrayLike, v: ArrayLike, *, e: float | None = None, kappa: float | None = None
) -> tuple[Array, Array]:
    r"""Project lifted states back to physical coordinates.

    .. math:: x = |s|, \qquad \dot x = R\,v\,\mathrm{sgn}\,s, \qquad
              R = 1 - \kappa\,\mathrm{sgn}\,s\,\mathrm{sgn}\,v

    Parameters
    ----------
    s, v : array_like
        Transformed position (m) and velocity (m/s), broadcast against each other.
    e, kappa : float
        Exactly one of the coefficient of restitution and :math:`\kappa`, in [0, 1].

    Returns
    -------
    x, xdot : ndarray
        Distance from the wall (m) and velocity (m/s); at the wall, the velocity after the
        impact, :math:`(1-\kappa)|v|`.

    See Also
    --------
    lift : the transform to lifted coordinates.

    Notes
    -----
    Elementwise and exact to rounding; the inverse of `lift` on one branch. The map is the
    definition before equation (2) of Huber and Oza.

    References
    ----------
    V. Ph. Zhuravlev, A method for analysing vibration-impact systems by means of special functions,
    Mechanics of Solids 11, 1976.

    A. P. Ivanov, Analytical methods in the theory of vibro-impact systems, J. Appl. Math. Mech. 57,
    1993.

    Examples
    --------
    >>> x, xdot = zivi.project(-1.0, 2.0, kappa=0.5)
    >>> float(x), float(xdot)
    (1.0, -3.0)
    """
    _, kappa = coefficients(e, kappa)
    position, velocity = _broadcast(s=s, v=v)
    x, xdot = _zivi.project(np.ravel(position), np.ravel(velocity), kappa)
    return x.reshape(position.shape), xdot.reshape(position.shape)


def coefficients(e: float | None, kappa: float | None) -> tuple[float, float]:
    """Return `e` and `kappa` from exactly one of them, in [0, 1]."""
    given = _zivi.Restitution(
        e=None if e is None else real("e", e),
        kappa=None if kappa is None else real("kappa", kappa),
    )
    return given.e, given.kappa


def _broadcast(**named: Any) -> tuple[Array, Array]:
    (name_a, a), (name_b, b) = named.items()
    first, second = real_array(name_a, a), real_array(name_b, b)
    try:
        first, second = np.broadcast_arrays(first, second)
    except ValueError as error:
        raise ValueError(f"{name_a} and {name_b} must have shapes that agree: {error}") from None
    return first, second


# One mass under a force above a wall with an impact law.

WRAPPED = "zivi.simulate(zivi.ImpactSystem(force, e=0.5), t_span, y0)"
"""How a force becomes a run."""


ARGUMENTS = ("force", "e", "kappa", "wall", "friction")
"""The arguments of a system, which `replace` takes too."""
CALLED = "f(t, x, xdot), three numbers"
"""How a force of three arguments is called."""


@hinted("ImpactSystem")
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
        argument, ``void *``, if the signature has one; it is not checked and must live as long as
        the system.
    e : float, ImpactLaw or callable, optional
        Coefficient of restitution in [0, 1]: 0 plastic, 1 elastic. Or an impact law:
        `SpeedDependentImpact`, `RestitutionTable` or `Restitution`; a function ``e(v)`` of the
        speed is ``Restitution(e)``.
    kappa : float, optional
        :math:`\kappa = (1-e)/(1+e)` in [0, 1]. Exactly one of `e` and `kappa` is given.
    wall : HarmonicWall, MovingWall or Table, optional
        A wall that moves, :math:`x \ge w(t)`. The force is then still that of the fixed frame,
        ``f(t, x, xdot)``; initial states and results are in the wall's frame, the distance
        :math:`x - w` and its rate, where the impacts obey restitution. `Trajectory.fixed` returns
        the motion in the fixed frame.
    friction : DryFriction, optional
        Dry friction in a guide, a force per unit mass; the wall must be at rest. Such a system is
        for `simulate` and `simulate_batch`, which run it as a `MechanicalSystem` of one
        coordinate: the results are a `MechanicalTrajectory` and a `MechanicalBatch`.

    Attributes
    ----------
    force
        The force as given.
    e, kappa : float
        Both coefficients, of Newton's impact law.
    law : ImpactLaw
        The impact law.
    wall
        The moving wall, or None.
    friction
        The dry friction, or None.

    Raises
    ------
    ValueError
        If not exactly one of `e` and `kappa` is given, or it is out of range, or a number
        `force` is not finite.
    TypeError
        If `force` is none of the above, takes other arguments, or does not compile.

    See Also
    --------
    MechanicalSystem : several coordinates and gaps.
    LinearForce : forces with exact flights.
    simulate : run the system.

    Notes
    -----
    A system is a value: it does not change, and `replace` returns another one. The force is called
    by the method only; a number or a `LinearForce` is never called, which saves nearly all of the
    time of a run. The system is equation (1) of Huber and Oza.

    References
    ----------
    O. Huber and H. B. Oza, Implicit numerical integration for the simulation and control of a
    non-smooth system with resets, IEEE CDC, 2016.

    B. Brogliato, Nonsmooth Mechanics, 3rd ed., Springer, 2016.

    Examples
    --------
    >>> zivi.ImpactSystem(-9.81, e=0.5)
    ImpactSystem(force=-9.81, e=0.5, kappa=0.3333333333333333)
    >>> spring = zivi.ImpactSystem(lambda t, y: 1.0 - 4.0 * y[0], e=0.5)
    >>> float(zivi.simulate(spring, (0, 1), (0.25, 0)).x[-1])  # in equilibrium
    0.25
    """

    __slots__ = ("_core", "_e", "_force", "_friction", "_impact", "_kappa", "_spec", "_wall")

    def __init__(
        self,
        force: Force,
        *,
        e: float | ImpactLaw | Callable[[float], float] | None = None,
        kappa: float | None = None,
        wall: HarmonicWall | MovingWall | Table | None = None,
        friction: DryFriction | None = None,
    ) -> None:
        self._e: float | ImpactLaw
        self._kappa: float | None
        law = law_of(e)
        if isinstance(law, ImpactLaw) and not isinstance(law, NewtonImpact):
            if kappa is not None:
                raise ValueError("exactly one of e and kappa must be given, got both")
            self._e, self._kappa = law, None
        else:
            given = law.e if isinstance(law, NewtonImpact) else law
            self._e, self._kappa = coefficients(given, kappa)
        self._force = force
        if isinstance(wall, Table):
            wall._wall("wall")
        elif not (wall is None or isinstance(wall, HarmonicWall | MovingWall)):
            raise TypeError(
                "wall must be None, a zivi.HarmonicWall, a zivi.MovingWall or a zivi.Table, "
                f"got {wall!r}"
            )
        self._wall = wall
        self._friction = friction
        if friction is not None:
            self._check_friction()
        self._prepare()

    def _check_friction(self) -> None:
        if not isinstance(self._friction, DryFriction):
            raise TypeError(f"friction must be a zivi.DryFriction, got {self._friction!r}")
        joints_of(self._friction)  # which refuses the name of a joint
        if self._wall is not None:
            raise ValueError(
                "wall must be None (at rest) for a mass with friction; use a zivi.MechanicalSystem "
                "for friction with moving walls"
            )
        _ = self.e  # which says that another law does not go with friction

    def __getattr__(self, name: str) -> Any:
        if name in ("_core", "_impact", "_spec") and self._friction is not None:
            raise NotImplementedError(
                "an ImpactSystem with friction is for zivi.simulate and zivi.simulate_batch"
            )
        raise attribute_error("system", self, name)

    @property
    def _calls_functions(self) -> bool:
        """Whether the force or the impact law calls compiled functions."""
        return self._spec.is_compiled or self._impact.is_compiled

    @property
    def _call_form(self) -> str:
        """How a force that is a function is called, for errors that it raises."""
        of_y = isinstance(of_three("force", self._force, more_than_y=False), OfState)
        return f"force is called as {'f(t, y), y = [x, xdot]' if of_y else CALLED}"

    def _prepare(self) -> None:
        if self._friction is not None:
            return
        self._spec = in_wall_frame(self, force_spec(self._force))
        e, kappa = self._e, self._kappa
        if isinstance(e, ImpactLaw):
            self._impact = e._core
        else:
            assert kappa is not None
            self._impact = _zivi.ImpactLaw.newton(e, kappa)
        self._core = _zivi.PointMass(self._spec, self._impact)

    def _under(self, force: Force) -> ImpactSystem:
        """Return the same system under another force, with its impact law."""
        new = object.__new__(type(self))
        new._force, new._e, new._kappa = force, self._e, self._kappa
        new._wall, new._friction = self._wall, self._friction
        new._prepare()
        return new

    def replace(self, **changes: Any) -> Self:
        """Return the same system with other arguments or other values of its parameters.

        Parameters
        ----------
        **changes
            Arguments of `ImpactSystem` by name, or parameters of the force, the wall and the impact
            law as `zivi.sensitivity` names them: ``gravity=3.7``, ``**{"wall.amplitude": 0.1}``.
            Other arguments are unchanged.

        Returns
        -------
        ImpactSystem
            A new system; this one does not change.

        Raises
        ------
        KeyError
            For a name that is neither.
        ValueError, TypeError
            As for `ImpactSystem`.

        Examples
        --------
        >>> ball = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81), e=0.5)
        >>> ball.replace(e=0.8, gravity=1.62).force.gravity
        1.62
        """
        own = {name: changes.pop(name) for name in ARGUMENTS if name in changes}
        system = self._with(**own) if own else self
        with_value = import_attribute("zivi.system.parameters", "with_value")
        for name, value in changes.items():
            try:
                import_attribute("zivi.system.parameters", "parameter")(system, name)
            except ValueError as error:
                raise KeyError(str(error)) from None
            system = with_value(system, name, value)
        return system

    def _with(self, **given: Any) -> Self:
        """Return the same system with other arguments; e and kappa keep their bits."""
        law = {name: given[name] for name in ("e", "kappa") if name in given}
        new = object.__new__(type(self))
        ImpactSystem.__init__(
            new,
            given.get("force", self._force),
            wall=given.get("wall", self._wall),
            friction=given.get("friction", self._friction),
            **(law or {"e": self._e}),
        )
        if not law and new._kappa != self._kappa:
            new._kappa = self._kappa
            new._prepare()
        return new

    def __getstate__(self) -> tuple[Any, ...]:
        state = self._force, self._e, self._kappa, self._wall
        return state if self._friction is None else (*state, self._friction)

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self._force, self._e, self._kappa, self._wall = state[:4]
        self._friction = state[4] if len(state) > 4 else None
        self._prepare()  # an address is of this process

    @property
    def force(self) -> Force:
        """The force as given."""
        return self._force

    @property
    def wall(self) -> HarmonicWall | MovingWall | Table | MaybeNone:
        """The moving wall, or None."""
        return self._wall

    def _breaks(self, span: tuple[float, float]) -> Array:
        """Return the knots of the tables within a span, which it must not leave."""
        excitation = getattr(self._force, "excitation", None)
        if excitation is None and self._wall is None:
            return _NONE
        return declared_breaks(span, [excitation], [self._wall])

    @property
    def friction(self) -> DryFriction | MaybeNone:
        """The dry friction, or None."""
        return self._friction

    @property
    def e(self) -> float:
        """Coefficient of restitution; a ValueError for another impact law than Newton's."""
        if isinstance(self._e, ImpactLaw):
            raise ValueError(self._not_newton())
        return self._e

    @property
    def kappa(self) -> float:
        """Parameter of the transform, ``(1 - e)/(1 + e)``; a ValueError as for `e`."""
        if self._kappa is None:
            raise ValueError(self._not_newton())
        return self._kappa

    @property
    def law(self) -> ImpactLaw:
        """The impact law."""
        return self._e if isinstance(self._e, ImpactLaw) else _newton_law(self._e)

    def _not_newton(self) -> str:
        return (
            f"e must be a number here, Newton's impact law, got {self._e!r}: other "
            "laws are for simulate and simulate_batch with SwitchedRK, and for sensitivity"
        )

    def __repr__(self) -> str:
        kappa = "" if self._kappa is None else f", kappa={self._kappa!r}"
        wall = "" if self._wall is None else f", wall={self._wall!r}"
        friction = "" if self._friction is None else f", friction={self._friction!r}"
        return f"ImpactSystem(force={self._force!r}, e={self._e!r}{kappa}{wall}{friction})"


_NONE = np.empty(0)
"""No times at which a force jumps."""
_NONE.flags.writeable = False


@functools.lru_cache(maxsize=256)
def _newton_law(e: float) -> NewtonImpact:
    """Return the law of a coefficient, of which diagrams have the same again and again."""
    return NewtonImpact(e)


def in_wall_frame(system: ImpactSystem, spec: _zivi.Force) -> _zivi.Force:
    """Translate a force of the fixed frame into the frame of the system's wall."""
    return spec if system.wall is None else _zivi.Force.above(system.wall._spec(), spec)


def check_system(system: Any) -> None:
    """Reject what is no system, above all the arguments of `solve_ivp` in its order."""
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
