"""Parts of a system as given by the user: arrays, functions, equality rows."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
import math
import sys
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, all_of, check_arguments, read_only, real_array
from zivi.base.habits import hinted

ARGUMENTS = (
    *("value", "gradient", "curvature", "rate", "normal", "offset", "motion"),
    *("direction", "limit", "static", "velocity"),
)
"""Attributes of gaps and friction that systems have read."""


class Unchanging:
    """A part of a system whose arguments stay: systems keep the models that are made of them."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in ARGUMENTS and name in vars(self):
            kind = type(self).__name__
            raise AttributeError(f"{name} of a zivi.{kind} cannot be changed; make another {kind}")
        object.__setattr__(self, name, value)


def own(value: Any) -> Any:
    """Return a read-only copy of an array, a copy of a list, and other values unchanged."""
    if isinstance(value, np.ndarray):
        return read_only(value.copy())
    return list(value) if isinstance(value, list) else value


# Parts of a system as the user passes them: arrays, functions, compiled functions.

Part: TypeAlias = "Array | Callable[..., Any] | Compiled"
"""A constant array, a function of the interpreter, or a compiled one."""

# addresses, which are cheaper to make than pointers to doubles
PART = ctypes.CFUNCTYPE(None, ctypes.c_double, *[ctypes.c_void_p] * 3)
PART_WITH_DATA = ctypes.CFUNCTYPE(None, ctypes.c_double, *[ctypes.c_void_p] * 4)
C_FORM = "void (double t, double *q, double *qdot, double *out)"

_CFunction: Any = type(ctypes.CFUNCTYPE(None)()).__mro__[1]


class Compiled:
    """A compiled part, called through its address; it fills ``out``.

    Parameters
    ----------
    address : int
        Where the function is.
    data : int or None
        What it takes as a last argument ``void *``, if it takes one.
    owner : object
        What keeps it alive.
    """

    def __init__(self, address: int, data: int | None, owner: object) -> None:
        self.address, self.data, self.owner = address, data, owner
        self._call = (PART if data is None else PART_WITH_DATA)(address)

    def fill(self, t: float, q: Array, qdot: Array, out: Array) -> None:
        """Evaluate into ``out``; all arrays are contiguous."""
        more = () if self.data is None else (self.data,)
        self._call(t, q.ctypes.data, qdot.ctypes.data, out.ctypes.data, *more)


def part(name: str, given: Any, arguments: str) -> Part:
    """Read a part of a system; an error names it, and the arguments of its function."""
    if (compiled := compiled_part(name, given)) is not None:
        return compiled
    if callable(given):
        check_arguments(name, given, arguments)
        return given  # type: ignore[no-any-return]
    try:
        array = real_array(name, given)
    except TypeError:
        raise TypeError(
            f"{name} must be an array, a function ({arguments}), or a compiled callable "
            f"{C_FORM}, got {type(given).__name__}"
        ) from None
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} must be finite, got {array.tolist()}")
    return array


def number_part(name: str, given: Any, arguments: str) -> Part:
    """Read a part that is one number."""
    read = part(name, given, arguments)
    if isinstance(read, np.ndarray) and read.shape != ():
        raise ValueError(f"{name} must be one number or a function, got shape {read.shape}")
    return read


STEP = 5e-4
"""How far a coordinate or the time moves in a difference of a curvature."""


def differenced(row: Part, rate: Part) -> Part:
    """Return the derivative of ``row . qdot + rate`` along ``(t + s, q + s qdot)``."""
    if isinstance(row, np.ndarray) and isinstance(rate, np.ndarray):
        return np.zeros(())
    gradient, by_time = evaluated(row, 1), evaluated(rate, 0)

    def speed(s: float, t: float, q: Array, qdot: Array) -> float:
        there = q + s * qdot
        return float(gradient(t + s, there, qdot) @ qdot + by_time(t + s, there, qdot)[()])

    def curvature(t: float, q: Array, qdot: Array) -> float:
        # of sixth order
        s = STEP / max(1.0, float(np.max(np.abs(qdot), initial=0.0)))
        first, second, third = (
            speed(k * s, t, q, qdot) - speed(-k * s, t, q, qdot) for k in (1, 2, 3)
        )
        return (45 * first - 9 * second + third) / (60 * s)

    return curvature


def evaluated(given: Part, dimensions: int) -> Callable[[float, Array, Array], Array]:
    """Return a part of (t, q) as a function of (t, q, qdot) whose result is an array."""
    if isinstance(given, np.ndarray):
        return lambda t, q, qdot: given
    if isinstance(given, Compiled):

        def filled(t: float, q: Array, qdot: Array) -> Array:
            out = np.empty(len(q) if dimensions else 1)
            given.fill(t, np.ascontiguousarray(q), np.ascontiguousarray(qdot), out)
            return out if dimensions else out[0]

        return filled
    return lambda t, q, qdot: np.asarray(given(t, q), dtype=np.float64)


def compiled_part(name: str, given: Any) -> Compiled | None:
    """Read a compiled callable: of numba's ``@cfunc``, of SciPy, or a pointer of ctypes."""
    # an object of SciPy's class can only be here if SciPy has been imported
    low_level = getattr(sys.modules.get("scipy"), "LowLevelCallable", None)
    if low_level is not None and isinstance(given, low_level):
        pointer, data = _low_level(name, given)
        return Compiled(pointer, data, given)
    pointer_of = given if isinstance(given, _CFunction) else getattr(given, "ctypes", None)
    if not isinstance(pointer_of, _CFunction):
        return None
    arguments = list(pointer_of.argtypes or [])
    if len(arguments) not in (4, 5) or arguments[0] is not ctypes.c_double:
        names = [getattr(kind, "__name__", str(kind)) for kind in arguments]
        raise TypeError(f"{name}, compiled, must have the signature {C_FORM}, got {names}")
    address = ctypes.cast(pointer_of, ctypes.c_void_p).value
    if not address:
        raise ValueError(f"{name}: the compiled function is a null pointer")
    return Compiled(address, 0 if len(arguments) == 5 else None, given)


def _low_level(name: str, given: Any) -> tuple[int, int | None]:
    """Read a `scipy.LowLevelCallable`: the address and the data of its capsule."""
    function = _zivi.compiled_model(tuple(given), name)
    return function.address, function.data


# Partial derivatives of a mechanical system's numbers: given, derived, or differenced.


@dataclasses.dataclass(frozen=True)
class Partials:
    """Derivatives of a model for the extension.

    Parameters
    ----------
    spec : _zivi.Partials
        Differences, or a function that fills in all derivatives.
    parameters : dict
        Names and values of the parameters, in their order.
    """

    spec: _zivi.Partials = dataclasses.field(default_factory=lambda: _zivi.Partials.differences([]))
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)


# Values of a model of a mechanical system at a state, and their places in a row of numbers.


@dataclasses.dataclass(frozen=True, eq=False)
class Evaluation:
    r"""A mechanical system at one time and state.

    Attributes
    ----------
    mass : ndarray
        :math:`M`, of shape (n, n).
    force : ndarray
        :math:`F`, of shape (n,).
    gaps : ndarray
        :math:`g_i`, of shape (m,).
    gradients : ndarray
        :math:`\partial g_i/\partial q`, of shape (m, n).
    curvatures : ndarray
        :math:`h_i = \dot q^T H_i \dot q + 2 g_{i,tq} \dot q + g_{i,tt}`, of shape (m,).
    rates : ndarray
        :math:`\partial g_i/\partial t`, of shape (m,).
    tangents : ndarray
        Directions of slip :math:`B_c` of the p channels of dry friction, of shape (p, n).
    slip_curvatures : ndarray
        :math:`k_c`, what the derivatives of the slip speeds are without acceleration, of shape
        (p,).
    slip_rates : ndarray
        :math:`\beta_c`, of shape (p,): the slip speeds are :math:`w_c = B_c \dot q + \beta_c`.
    limits, static_limits : ndarray
        Limits of friction while slipping and while sticking, of shape (p,): coefficients of
        friction at gaps, forces in joints.
    equalities : ndarray
        Values :math:`\varphi` of the k equality rows, of shape (k,).
    equality_gradients : ndarray
        Their gradients :math:`G`, of shape (k, n).
    equality_curvatures : ndarray
        What the second time derivatives of the rows are without acceleration, of shape (k,).
    equality_rates : ndarray
        Partial time derivatives :math:`\varphi_t`, of shape (k,).
    """

    mass: Array
    force: Array
    gaps: Array
    gradients: Array
    curvatures: Array
    rates: Array
    tangents: Array
    slip_curvatures: Array
    slip_rates: Array
    limits: Array
    static_limits: Array
    equalities: Array
    equality_gradients: Array
    equality_curvatures: Array
    equality_rates: Array


@dataclasses.dataclass(frozen=True)
class Layout:
    """Where the parts of an evaluation stand in the row of numbers that a model fills.

    Parameters
    ----------
    n, m, p, k : int
        Numbers of coordinates, of gaps, of channels of dry friction and of equality rows.
    """

    n: int
    m: int
    p: int = 0
    k: int = 0

    @property
    def size(self) -> int:
        """How many numbers there are."""
        rows = self.m + (self.m + self.p) * (self.n + 2) + 2 * self.p
        return self.n * (self.n + 1) + rows + self.k * (self.n + 3)

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The parts in their order, by the names of `Evaluation`."""
        n, m, p, k = self.n, self.m, self.p, self.k
        return {
            "mass": (n, n),
            "force": (n,),
            "gaps": (m,),
            "gradients": (m, n),
            "tangents": (p, n),
            "curvatures": (m,),
            "slip_curvatures": (p,),
            "rates": (m,),
            "slip_rates": (p,),
            "limits": (p,),
            "static_limits": (p,),
            "equalities": (k,),
            "equality_gradients": (k, n),
            "equality_curvatures": (k,),
            "equality_rates": (k,),
        }

    def views(self, row: Array) -> dict[str, Array]:
        """Return the parts of a row as arrays that share its memory."""
        return {name: row[at].reshape(shape) for name, at, shape in places(self)}

    def read(self, row: Array) -> Evaluation:
        """Return a copy of a row by its parts."""
        return Evaluation(**self.views(row.copy()))


@functools.lru_cache(maxsize=256)
def places(layout: Layout) -> list[tuple[str, slice, tuple[int, ...]]]:
    """List the parts of a row with their places and shapes."""
    found, start = [], 0
    for name, shape in layout.shapes.items():
        end = start + math.prod(shape)
        found.append((name, slice(start, end), shape))
        start = end
    return found


# Equality rows of mechanical systems: closed chains and prescribed motion.


@hinted("Equality")
class Equality(Unchanging):
    r"""An equation between the coordinates, kept exactly: a joint that closes a chain, or a drive.

    .. math::

        \varphi(t, q) = 0, \qquad G \dot q + \varphi_t = 0, \qquad G \ddot q + c = 0,
        \qquad c = \dot q^T H \dot q + 2 \varphi_{tq} \dot q + \varphi_{tt}

    with the gradient :math:`G` and the matrix :math:`H` of second derivatives. The row acts on the
    system with the force :math:`G^T \mu`, whose multiplier :math:`\mu` is in
    ``constraint_forces`` of a result. A coordinate that moves as prescribed has
    :math:`\varphi = q_i - s(t)`.

    Parameters
    ----------
    value : callable, float or compiled
        :math:`\varphi`: ``value(t, q) -> float``, or compiled as the parts of a
        `MechanicalSystem`. A number c with a constant gradient: :math:`\varphi = G q + c`.
    gradient : array_like, callable or compiled
        :math:`G`, of shape (n,): an array, ``gradient(t, q)``, or compiled.
    curvature : callable, float or None
        ``curvature(t, q, qdot) -> float``, the number :math:`c`. By default it is
        finite-differenced from gradient and rate, to about 1e-10 of its terms.
    rate : callable, float or None
        ``rate(t, q) -> float``, the derivative :math:`\varphi_t` with respect to time. Default 0;
        a row that depends on time needs it.
    name : str
        Name in results, tables and errors. Default ``"pin"``.

    Raises
    ------
    ValueError, TypeError
        If a part is neither a number, an array nor callable, or a number is not finite.

    See Also
    --------
    zivi.consistent : move a state onto the equality rows.
    zivi.symbolic.system : rows as formulas, with all derivatives generated.

    Notes
    -----
    The rows are eliminated from the equations of motion and of impacts; the state is projected
    onto them after each step and impact, in the metric of the masses. Dependent rows are allowed
    where they agree: of all multipliers those of least norm are reported.

    References
    ----------
    E. Hairer, G. Wanner, *Solving Ordinary Differential Equations II*, Springer 1996, chapter VII.

    Examples
    --------
    A pendulum of 1 m in Cartesian coordinates:

    >>> rod = zivi.Equality(
    ...     lambda t, q: 0.5 * (q @ q - 1.0),
    ...     lambda t, q: q,
    ...     curvature=lambda t, q, qdot: qdot @ qdot,
    ...     name="rod",
    ... )
    >>> pendulum = zivi.MechanicalSystem(mass=np.eye(2), force=[0.0, -9.81], equalities=[rod])
    >>> sol = zivi.simulate(pendulum, (0, 3), ([1.0, 0.0], [0.0, 0.0]))
    >>> bool(abs(np.hypot(*sol.q.T) - 1.0).max() < 1e-14)
    True
    """

    def __init__(
        self,
        value: Callable[[float, Array], float] | float | Any,
        gradient: Callable[[float, Array], ArrayLike] | ArrayLike | Any,
        curvature: Callable[[float, Array, Array], float] | float | Any | None = None,
        rate: Callable[[float, Array], float] | float | Any | None = None,
        name: str = "pin",
    ) -> None:
        self.value, self.gradient = value, own(gradient)
        self.curvature, self.rate = curvature, rate
        self._name = str(name)
        called = f"equality {self._name!r}"
        row = part(f"gradient of {called}", gradient, "t, q")
        self._row: Part = row
        if isinstance(row, np.ndarray):
            self._row = read_only(np.atleast_1d(row))
            if self._row.ndim != 1 or not np.any(self._row):
                raise ValueError(
                    f"gradient of {called} must be a vector, not zero, got {row.tolist()}"
                )
        self._phi = self._value_part(called, value)
        self._phi_t = number_part(f"rate of {called}", 0.0 if rate is None else rate, "t, q")
        self._bias = (
            differenced(self._row, self._phi_t)
            if curvature is None
            else number_part(f"curvature of {called}", curvature, "t, q, qdot")
        )

    def _value_part(self, called: str, value: Any) -> Part:
        """Read the value; a number is the constant of a linear row."""
        read = number_part(f"value of {called}", value, "t, q")
        if not isinstance(read, np.ndarray):
            return read
        row, constant = self._row, float(read)
        if not isinstance(row, np.ndarray):
            raise TypeError(
                f"value of {called} must be a function (t, q), got {value!r}; a number needs a "
                "gradient that is an array"
            )
        return lambda t, q: float(row @ q) + constant

    @property
    def name(self) -> str:
        """Name in results, tables and errors."""
        return self._name

    def _parts(self) -> tuple[Part, Part, Part, Part]:
        """Return value, gradient, curvature and rate."""
        return self._phi, self._row, self._bias, self._phi_t

    def _is_flat(self) -> bool:
        """Whether the gradient is constant."""
        return isinstance(self._row, np.ndarray)

    def in_modes(self, shapes: Array) -> Equality:
        """Return the row of modal amplitudes; its gradient must be an array."""
        value, rate, bias = evaluated(self._phi, 0), evaluated(self._phi_t, 0), self._bias
        if isinstance(bias, Compiled):
            raise TypeError(f"curvature of equality {self._name!r} must not be compiled here")

        def curvature(t: float, q: Array, qdot: Array) -> float:
            if isinstance(bias, np.ndarray):
                return float(bias)
            return float(bias(t, shapes @ q, shapes @ qdot))

        return Equality(
            lambda t, q: float(value(t, shapes @ q, q)),
            np.asarray(self._row) @ shapes,
            curvature,
            lambda t, q: float(rate(t, shapes @ q, q)),
            self._name,
        )

    def __repr__(self) -> str:
        return f"Equality(name={self._name!r})"

    def __getstate__(self) -> dict[str, Any]:
        names = ("value", "gradient", "curvature", "rate", "name")
        return {name: getattr(self, name) for name in names}

    def __setstate__(self, state: dict[str, Any]) -> None:
        Equality.__init__(self, **state)


def equalities_of(given: Any) -> tuple[Equality, ...]:
    """Read the equality rows: one or a sequence."""
    return all_of("equalities", given, Equality)


# Whether a state obeys the rows.

AGREES = 1e-6
"""What a row may leave at the start, relative to its terms: it is projected away."""
FLOOR = 1e-9
"""The same where the terms are smaller than one."""


def violations(here: Evaluation, q: Array, qdot: Array) -> tuple[Array, Array]:
    """Return what positions and velocities leave of the rows, in units of what may be left.

    Parameters
    ----------
    here : Evaluation
        The system at the state.
    q, qdot : ndarray
        The state, of shape (n,).

    Returns
    -------
    (ndarray, ndarray)
        Of shape (k,): 1 is the most that is allowed.
    """
    sizes = np.abs(here.equality_gradients).sum(axis=1)
    positions = sizes * np.max(np.abs(q), initial=0.0)
    speeds = sizes * np.max(np.abs(qdot), initial=0.0) + np.abs(here.equality_rates)
    floor = FLOOR * np.maximum(sizes, 1.0)
    rates = here.equality_gradients @ qdot + here.equality_rates
    far = np.abs(here.equalities) / (AGREES * positions + floor)
    return far, np.abs(rates) / (AGREES * speeds + floor)


def check_equalities(names: tuple[str, ...], here: Evaluation, q: Array, qdot: Array) -> None:
    """Raise a ValueError that names the row which a start does not obey."""
    remedy = "; use zivi.consistent(system, q, qdot) to move the state onto the rows"
    far, fast = violations(here, q, qdot)
    for name, value, part_of in zip(names, here.equalities, far, strict=True):
        if not part_of <= 1.0:
            raise ValueError(
                f"q0 must obey equality {name!r}, whose value is {value:.6g} at the start{remedy}"
            )
    rates = here.equality_gradients @ qdot + here.equality_rates
    for name, rate, part_of in zip(names, rates, fast, strict=True):
        if not part_of <= 1.0:
            raise ValueError(
                f"qdot0 must obey equality {name!r}, whose rate is {rate:.6g} at the start{remedy}"
            )
