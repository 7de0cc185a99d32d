"""Parts of a system as given by the user, and their layout in one row of numbers."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
import math
import sys
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array, check_arguments, real_array

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
        What friction takes in slip and holds in stick, of shape (p,): coefficients of friction at
        gaps, forces in joints.
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
