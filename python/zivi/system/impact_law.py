"""Impact laws: the speed after an impact from the speed before it."""

from __future__ import annotations

import ctypes
import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, check_arguments, is_jitted, real, real_array, vector

# Impact laws of a few numbers, and the base class of all.


@dataclasses.dataclass(frozen=True)
class ImpactLaw:
    r"""Speed after an impact: base class of `NewtonImpact` and the other laws.

    .. math:: \dot x^+ = e(v)\,v, \qquad v = -\dot x^- > 0, \qquad 0 \le e(v) \le 1

    A law is given to `ImpactSystem` or `MechanicalSystem` as its `e`.
    """

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, real(field.name, getattr(self, field.name)))
        _ = self._core

    @property
    def _core(self) -> _zivi.ImpactLaw:
        """The law for the core, created once."""
        made: _zivi.ImpactLaw | None = self.__dict__.get("_made")
        if made is None:
            values = [getattr(self, field.name) for field in dataclasses.fields(self)]
            made = self.__dict__["_made"] = _zivi.ImpactLaw(type(self).__name__, values)
        return made

    def __getstate__(self) -> dict[str, Any]:
        # the object of the core is created again
        return {name: value for name, value in self.__dict__.items() if name != "_made"}

    @property
    def limit(self) -> float:
        """The coefficient of restitution of slow impacts, in the limit ``v -> 0``.

        Between 0 and 1 impacts accumulate as a geometric chain, whose end is extrapolated; with 1
        they do not accumulate; with 0 faster than any such chain.
        """
        limit = self._core.limit
        return np.nan if limit is None else limit

    def after(self, v: ArrayLike) -> Array:
        """Return the speed after an impact (m/s).

        Parameters
        ----------
        v : array_like
            Speed before it, >= 0 (m/s), any shape.

        Returns
        -------
        ndarray
            Of the shape of `v`.

        Raises
        ------
        ValueError
            If a speed is negative or not finite.

        Examples
        --------
        >>> zivi.SpeedDependentImpact(e0=0.5, v0=1.0, k=0.25).after([1.0, 16.0])
        array([0.5, 4. ])
        """
        return self._at(v, self._core.after)

    def slope(self, v: ArrayLike) -> Array:
        """Return the derivative of the speed after an impact by the speed `v` before it."""
        return self._at(v, self._core.slope)

    def _described(self) -> dict[str, Any]:
        """Return plain values that describe the law."""
        return {"name": type(self).__name__, **dataclasses.asdict(self)}

    def _scaled(self, factor: float) -> Self:
        """Return the law with its first coefficient multiplied."""
        first = dataclasses.fields(self)[0].name
        return dataclasses.replace(self, **{first: factor * getattr(self, first)})

    def _at(self, v: ArrayLike, of: Any) -> Array:
        speeds = real_array("v", v)
        if not (np.all(speeds >= 0.0) and np.all(np.isfinite(speeds))):
            raise ValueError("v must be finite and >= 0, a speed")
        at: Array = np.where(speeds > 0.0, of(np.ravel(speeds)).reshape(speeds.shape), 0.0)
        return at


@dataclasses.dataclass(frozen=True)
class NewtonImpact(ImpactLaw):
    r"""Newton's impact law: one coefficient of restitution for all speeds.

    .. math:: \dot x^+ = -e\,\dot x^-

    ``zivi.ImpactSystem(force, e=zivi.NewtonImpact(0.5))`` is ``zivi.ImpactSystem(force, e=0.5)``.

    Parameters
    ----------
    e : float
        Coefficient of restitution in [0, 1]: 0 plastic, 1 elastic.

    Raises
    ------
    ValueError
        If `e` is out of range.

    See Also
    --------
    SpeedDependentImpact : restitution that depends on the speed.
    Restitution : restitution as a function of the speed.

    Notes
    -----
    The speeds of an accumulation are a geometric series with the ratio `e`, so its end is
    extrapolated.

    References
    ----------
    B. Brogliato, Nonsmooth Mechanics, 3rd ed., Springer, 2016.

    Examples
    --------
    >>> zivi.NewtonImpact(0.5).limit
    0.5
    """

    e: float


@dataclasses.dataclass(frozen=True)
class SpeedDependentImpact(ImpactLaw):
    r"""A coefficient of restitution that is a power of the speed of the impact.

    .. math:: \dot x^+ = -e(v)\,\dot x^-, \qquad v = -\dot x^-, \qquad
              e(v) = \min\!\left(e_0\,(v/v_0)^{-k},\ e_{\max}\right)

    With ``k > 0`` fast impacts lose the larger share, for example in a contact that yields: ``k =
    1/4`` for a sphere far above the yield point (Johnson, Contact Mechanics, 1985).
    Without the cap :math:`e_{\max} \le 1` slow ones would gain energy.

    The limit of slow impacts, `limit` = :math:`e` as :math:`v \to 0`, decides about rest:

    - ``k > 0`` and ``e_max = 1``: the limit is 1. Speeds fall to
      :math:`v_* = v_0 e_0^{1/k}`, below which nothing is lost: the mass keeps bouncing with flights
      of :math:`2 v_*/g`, impacts do not accumulate, and it never rests.
    - ``k > 0`` and ``e_max < 1``: from :math:`v_0 (e_0/e_{\max})^{1/k}` down the law is Newton's
      with ``e_max``. The chain of impacts is geometric there, and a run jumps over it as usual.
    - ``k < 0``: the limit is 0. Below :math:`v_*` (above it, with ``e_max = 1``, impacts are
      lossless) each impact loses a larger share than the previous one, so that the times of flight
      sum up faster than any geometric series. There is no jump: a run computes the few impacts
      until what is left of their time is below rounding, and rests.

    `SwitchedRK` supports the law in `simulate`, `simulate_batch` and `sensitivity`, for a mass and
    for mechanical systems. All other functions require Newton's law and raise an error.

    Parameters
    ----------
    e0 : float
        Coefficient of restitution at `v0`, in [0, 1].
    v0 : float
        Speed, > 0 (m/s).
    k : float
        Exponent, < 1: from 1 on a faster impact would have no faster rebound.
    e_max : float
        Largest coefficient, from `e0` to 1: that of slow impacts for ``k > 0``, of fast ones for
        ``k < 0``.

    Raises
    ------
    ValueError
        If a parameter is out of range.

    See Also
    --------
    NewtonImpact : constant restitution.
    Restitution : any function of the speed.

    Notes
    -----
    For plastic contact of spheres `k` is 1/4. Whether the impacts accumulate depends on the limit
    of `e` for slow impacts; below the last speed at which the law changes, a series is
    extrapolated.

    References
    ----------
    T. Schwager and T. Poeschel, Coefficient of normal restitution of viscous particles and cooling
    rate of granular gases, Phys. Rev. E 57, 1998.

    K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985.

    Examples
    --------
    >>> law = zivi.SpeedDependentImpact(e0=0.5, v0=1.0, k=0.25)
    >>> law.limit
    1.0
    >>> ball = zivi.ImpactSystem(-9.81, e=law)
    >>> sol = zivi.simulate(ball, (0, 3), (1, 0))
    >>> bool(sol.success), sol.rest_time, len(sol.zeno_times)  # bounces for good
    (True, None, 0)
    >>> round(float(sol.impacts["xdot_after"][-1]), 4)  # v0 e0^(1/k) = 1/16
    0.0625
    """

    e0: float
    v0: float
    k: float
    e_max: float = 1.0


def law_parameters(law: ImpactLaw) -> dict[str, float]:
    """Names and values of the parameters of a law: of a table ``e[0]``, ``e[1]``, ..."""
    if isinstance(law, RestitutionTable):
        return {f"e[{i}]": value for i, value in enumerate(law.e.tolist())}
    return {field.name: getattr(law, field.name) for field in dataclasses.fields(law)}


def law_with(law: ImpactLaw, name: str, value: float) -> ImpactLaw:
    """Return a law with another value of a parameter."""
    if isinstance(law, RestitutionTable):
        e = law.e.copy()
        e[list(law_parameters(law)).index(name)] = value
        return RestitutionTable(law.v, e)
    return dataclasses.replace(law, **{name: value})


# Coefficients of restitution that are functions or tables of the speed of the impact.


FUNCTIONS: Any = type(ctypes.CFUNCTYPE(None)()).__mro__[1]
"""The class of all function pointers of ctypes."""
RATIO = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)
"""``double e(double v)``."""
COMPILED = "_zivi_restitution"
"""The attribute in which a function of numba keeps its C function."""
SPEEDS = np.geomspace(1e-6, 1e2, 64)
"""Speeds at which a function is checked (m/s)."""


class Restitution(ImpactLaw):
    r"""A coefficient of restitution that is a function of the speed of the impact.

    .. math:: \dot x^+ = -e(v)\,\dot x^-, \qquad v = -\dot x^- > 0

    A function given as `e` of a system is ``Restitution(function)``.

    Parameters
    ----------
    f : callable
        ``f(v) -> float``, the coefficient in [0, 1] at the speed `v` > 0 (m/s) before the impact: a
        Python function, a function of numba's ``@njit``, which is compiled, or a ctypes function
        pointer ``double (double)``. Runs with several threads call it from each of them.
    limit : float, optional
        The coefficient in the limit ``v -> 0``, in [0, 1]. Default ``f(0.0)``.
    slope : callable, optional
        The derivative ``f'(v)`` (s/m), of the same kind, for `zivi.sensitivity`. Default: central
        differences of the fourth order.

    Raises
    ------
    TypeError
        If `f` or `slope` is not callable, has other arguments or does not compile.
    ValueError
        If `f` is outside of [0, 1] at one of 64 speeds from 1e-6 m/s to 100 m/s, or `limit` is not
        given and ``f(0.0)`` is not a number in [0, 1], or `f` does not approach `limit`.

    See Also
    --------
    RestitutionTable : a measured coefficient.
    SpeedDependentImpact : a power of the speed.

    Notes
    -----
    A chain of impacts is extrapolated to its end below the speed from which on `f` is smooth,
    ``limit + a v + b v^2``, which is found at construction. Where `f` has a fractional power of `v`
    or a logarithm there, impacts are followed one by one: to rounding if `limit` < 1. With
    ``limit=1`` and ``1 - f(v)`` like :math:`c\,v^p`, speeds fall as :math:`n^{-1/p}` after `n`
    impacts, which end after a finite time if ``p < 1``. A run adds the time of the impacts below
    the tolerance `atol` of the velocity as a sum over the recursion :math:`v \to e(v)\,v`. About
    :math:`1/(c\,p\,\mathrm{atol}^p)` impacts come before that: with more than `max_steps` the run
    ends with ``STEP_BUDGET``.

    A value outside of [0, 1] during a run ends the run. An exception of `f` is raised by the run.

    References
    ----------
    Viscoelastic spheres have ``p = 1/5``: T. Schwager and T. Poeschel, Coefficient of normal
    restitution of viscous particles and cooling rate of granular gases, Phys. Rev. E 57 (1998) 650.

    Examples
    --------
    >>> law = zivi.Restitution(lambda v: 1 / (1 + 0.3 * v**0.6))
    >>> law.limit, law.after([1.0]).round(6)
    (1.0, array([0.769231]))
    >>> ball = zivi.ImpactSystem(-9.81, e=lambda v: 0.8 - 0.05 * min(v, 5.0))
    >>> bool(zivi.simulate(ball, (0, 6), (1, 0)).rest_time < 6.0)
    True
    """

    f: Callable[[float], float]
    limit: float = math.nan
    slope_function: Callable[[float], float] | None
    smooth_up_to: float

    def __init__(
        self,
        f: Callable[[float], float],
        *,
        limit: float | None = None,
        slope: Callable[[float], float] | None = None,
    ) -> None:
        _check_function("f", f)
        if slope is not None:
            _check_function("slope", slope)
        at_zero = _limit(f, limit)
        _check_speeds(f, at_zero)
        smooth = _smooth_up_to(f, at_zero)
        vars(self).update(f=f, slope_function=slope, limit=at_zero, smooth_up_to=smooth)
        e = _compiled("f", f, checked=True)
        de = None if slope is None else _compiled("slope", slope, checked=False)
        addresses = (_address(e), None if de is None else _address(de))
        vars(self)["_made"] = _zivi.ImpactLaw.compiled(*addresses, at_zero, smooth, (e, de))

    def after(self, v: ArrayLike) -> Array:
        """Return the speed after an impact (m/s), as `ImpactLaw.after`."""
        return self._at(v, lambda speeds: [self._ratio(it) * it for it in speeds.tolist()])

    def _at(self, v: ArrayLike, of: Any) -> Array:
        return super()._at(v, lambda speeds: np.array(of(speeds), dtype=float))

    def _ratio(self, v: float) -> float:
        return _in_unit(v, self.f(v)) if v > 0.0 else self.limit

    def _described(self) -> dict[str, Any]:
        return {"name": "Restitution", "f": _name(self.f), "limit": self.limit}

    def _scaled(self, factor: float) -> Self:
        f = self.f
        return type(self)(lambda v: factor * f(v), limit=factor * self.limit)

    def __reduce__(self) -> Any:
        return _restitution, (self.f, self.limit, self.slope_function)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Restitution):
            return NotImplemented
        slopes = (self.slope_function, other.slope_function)
        same = same_function(self.f, other.f) and same_function(*slopes)
        return same and self.limit == other.limit

    def __hash__(self) -> int:
        return hash(("Restitution", self.limit))

    def __repr__(self) -> str:
        return f"Restitution({_name(self.f)}, limit={self.limit!r})"


def _restitution(f: Any, limit: float, slope: Any) -> Restitution:
    return Restitution(f, limit=limit, slope=slope)


def _name(f: Any) -> str:
    name = getattr(f, "__qualname__", None) or type(f).__qualname__
    return str(name).rpartition(".<locals>.")[2]


def same_function(f: Any, g: Any) -> bool:
    """Whether two functions are known to be equal: one object, or one code with equal values."""
    if f is g:
        return True
    names = ("__code__", "__defaults__", "__kwdefaults__")
    if (
        not (hasattr(f, "__code__") and hasattr(g, "__code__"))
        or f.__globals__ is not g.__globals__
    ):
        return False
    cells = [tuple(it.cell_contents for it in h.__closure__ or ()) for h in (f, g)]
    try:
        return bool(
            all(getattr(f, name) == getattr(g, name) for name in names) and cells[0] == cells[1]
        )
    except ValueError:  # arrays
        return False


# Checks of a function before any computation.


def _check_function(name: str, f: Any) -> None:
    if not callable(f):
        raise TypeError(f"{name} must be a function {name}(v), got {f!r}")
    if not isinstance(f, FUNCTIONS):
        check_arguments(name, f.py_func if is_jitted(f) else f, "v")


def _in_unit(v: float, value: Any) -> float:
    e = real("e(v)", value)
    if not 0.0 <= e <= 1.0:
        raise ValueError(f"e(v) must be in [0, 1], got {e:.6g} at v = {v:.6g} m/s")
    return e


def _limit(f: Any, given: float | None) -> float:
    if given is not None:
        limit = real("limit", given)
        if not 0.0 <= limit <= 1.0:
            raise ValueError(f"limit must be in [0, 1], got {limit!r}")
        return limit
    try:
        limit = real("f(0.0)", f(0.0))
    except (ArithmeticError, ValueError, TypeError) as error:
        raise ValueError(
            f"limit must be given where f(0.0) raises an error ({error}): "
            "zivi.Restitution(f, limit=...)"
        ) from error
    if not 0.0 <= limit <= 1.0:
        raise ValueError(
            f"f(0.0) must be in [0, 1], got {limit!r}; give zivi.Restitution(f, limit=...)"
        )
    return limit


def _check_speeds(f: Any, limit: float) -> None:
    for v in SPEEDS.tolist():
        _in_unit(v, f(v))
    far, near = (abs(_in_unit(v, f(v)) - limit) for v in (1e-6, 1e-12))
    if near > 1e-3 and near > 0.95 * far:
        raise ValueError(
            f"limit must be the coefficient as v -> 0, got {limit!r} where f(1e-12) is "
            f"{float(f(1e-12)):.6g}"
        )


TINY = 1e-13
"""A difference of coefficients that is nothing but rounding."""
CURVED = 0.02
"""How far the slope of a smooth function may be from its extrapolation, as a part of it."""


def _smooth_up_to(f: Any, limit: float) -> float:
    """Return the speed (m/s) up to which `f` is ``limit + a v + b v^2``; 0 if it never is."""

    def slope(v: float) -> float:
        return (float(f(v)) - limit) / v

    found = 0.0
    for power in range(-20, 7):
        v = 2.0**power
        a, half, quarter = slope(v), slope(v / 2), slope(v / 4)
        bend = abs((2 * half - a) - (2 * quarter - half))
        if bend > CURVED * max(abs(a), abs(half), abs(quarter)) + TINY / v:
            return found
        found = v
    return found


# Functions of C: what numba compiles, and a call of the interpreter for the others.


def _compiled(name: str, f: Any, *, checked: bool) -> Any:
    if isinstance(f, FUNCTIONS):
        if f.restype is not ctypes.c_double or list(f.argtypes or []) != [ctypes.c_double]:
            raise TypeError(f"{name}, compiled, must have the signature double (double v)")
        return f
    if is_jitted(f):
        known = f.__dict__.get(COMPILED)
        return known or f.__dict__.setdefault(COMPILED, _cfunc(name, f))
    if not checked:
        return RATIO(lambda v: float(f(v)))
    return RATIO(lambda v: _in_unit(v, f(v)))


def _cfunc(name: str, f: Any) -> Any:
    import numba

    def law(v: float) -> Any:
        return f(v)

    try:
        return numba.cfunc("float64(float64)")(law)
    except numba.core.errors.NumbaError as error:
        why = next((line for line in str(error).splitlines() if "Failed in" not in line), "")
        raise TypeError(
            f"{name}, a function of numba, does not compile to float64(float64): {why.strip()}; "
            f"give {name}.py_func, which runs in the interpreter"
        ) from error


def _address(f: Any) -> int:
    address = ctypes.cast(getattr(f, "ctypes", f), ctypes.c_void_p).value
    if not address:
        raise ValueError("f: the compiled function is a null pointer")
    return address


class RestitutionTable(ImpactLaw):
    r"""A coefficient of restitution that is linear between measured speeds.

    .. math:: \dot x^+ = -e(v)\,\dot x^-, \qquad v = -\dot x^- > 0

    Parameters
    ----------
    v : array_like, shape (n,)
        Speeds before the impact (m/s), increasing, >= 0; two or more.
    e : array_like, shape (n,)
        Coefficients at these speeds, in [0, 1]. Below the first and above the last speed the
        coefficient is that at the first and the last.

    Attributes
    ----------
    v, e : ndarray, shape (n,)
        Speeds (m/s) and coefficients.

    Raises
    ------
    ValueError
        If the shapes differ, speeds do not increase or a coefficient is outside of [0, 1].

    See Also
    --------
    Restitution : a coefficient that is a function.

    Notes
    -----
    A chain of impacts is extrapolated to its end below the first speed > 0; faster impacts are
    followed one by one.

    Examples
    --------
    >>> steel = zivi.RestitutionTable(v=[0.0, 1.0, 4.0], e=[0.8, 0.6, 0.4])
    >>> steel.limit, steel.after([2.5])
    (0.8, array([1.25]))
    >>> ball = zivi.ImpactSystem(-9.81, e=steel)
    >>> round(zivi.simulate(ball, (0, 3), (1, 0)).rest_time, 5)
    1.46745
    """

    v: Array
    e: Array

    def __init__(self, v: ArrayLike, e: ArrayLike) -> None:
        speeds, ratios = vector("v", v).copy(), vector("e", e).copy()
        if speeds.shape != ratios.shape or speeds.size < 2:
            raise ValueError(
                f"v and e must have one length of two or more, got {speeds.shape} and "
                f"{ratios.shape}"
            )
        increases = np.all(np.diff(speeds) > 0) and speeds[0] >= 0.0
        if not (increases and np.all(np.isfinite(speeds))):
            raise ValueError(f"v must be finite, increasing speeds >= 0, got {speeds.tolist()}")
        for i, value in enumerate(ratios.tolist()):
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"e[{i}] must be in [0, 1], got {value!r}")
        speeds.flags.writeable = ratios.flags.writeable = False
        vars(self).update(v=speeds, e=ratios, _made=_zivi.ImpactLaw.table(speeds, ratios))

    def _described(self) -> dict[str, Any]:
        return {"name": "RestitutionTable", "v": self.v.tolist(), "e": self.e.tolist()}

    def _scaled(self, factor: float) -> Self:
        return type(self)(self.v, factor * self.e)

    def __reduce__(self) -> Any:
        return RestitutionTable, (self.v, self.e)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RestitutionTable):
            return NotImplemented
        return np.array_equal(self.v, other.v) and np.array_equal(self.e, other.e)

    def __hash__(self) -> int:
        return hash((*self.v.tolist(), *self.e.tolist()))

    def __repr__(self) -> str:
        return f"RestitutionTable(v={self.v.tolist()}, e={self.e.tolist()})"


# The impact laws of the gaps of a system, from the argument `e`.


def law_class(name: str) -> type[ImpactLaw]:
    """Make the class of a law that only the core knows, from its parameters."""
    parameters = _zivi.IMPACT_LAWS[name]
    fields: list[Any] = [
        (it.name, float) if it.required else (it.name, float, dataclasses.field(default=it.default))
        for it in parameters
    ]
    told = "\n".join(f"{it.name}: {it.meaning} ({it.unit}), {it.range}." for it in parameters)
    kind = dataclasses.make_dataclass(name, fields, bases=(ImpactLaw,), frozen=True)
    kind.__doc__, kind.__module__ = f"The impact law {name} of the core.\n\n{told}", __name__
    return kind


OWN = (NewtonImpact, SpeedDependentImpact)
"""Laws of the core that have a class with documentation."""
LAWS: dict[str, Any] = {
    **{name: law_class(name) for name in _zivi.IMPACT_LAWS},
    **{kind.__name__: kind for kind in (*OWN, RestitutionTable)},
}
"""The class of each law that files can name."""
globals().update(LAWS)

GivenRestitutions: TypeAlias = (
    float
    | ArrayLike
    | ImpactLaw
    | Callable[[float], float]
    | Sequence[float | ImpactLaw | Callable[[float], float]]
)
"""What `e` of a mechanical system may be: one for all gaps, or one for each."""

Restitutions: TypeAlias = Array | tuple[ImpactLaw, ...]
"""What the gaps have: coefficients, or laws where one is not Newton's."""


def law_of(e: Any) -> Any:
    """Return the law of a function of the speed; what is none stays."""
    if not callable(e) or isinstance(e, ImpactLaw | type):
        return e
    if hasattr(type(e), "_kind"):  # a compliant law, which a module above this one defines
        raise TypeError(
            f"e must be a coefficient of restitution or an impact law, got {e!r}; a compliant "
            "contact is the contact= of a gap of a zivi.MechanicalSystem"
        )
    return Restitution(e)


def restitutions(e: Any, m: int) -> Restitutions:
    """Read the coefficients of restitution or the laws of `m` gaps: one for all, one for each."""
    each = [law_of(law) for law in e] if isinstance(e, list | tuple) else [law_of(e)]
    if all(isinstance(law, NewtonImpact) or not isinstance(law, ImpactLaw) for law in each):
        numbers = [law.e if isinstance(law, NewtonImpact) else law for law in each]
        return _coefficients(numbers if isinstance(e, list | tuple) else numbers[0], m)
    if not isinstance(e, list | tuple):
        each *= m
    if len(each) != m:
        raise ValueError(f"e must be one law or one for each of the {m} gaps, got {len(each)}")
    return tuple(
        law if isinstance(law, ImpactLaw) else NewtonImpact(real(f"e[{i}]", law))
        for i, law in enumerate(each)
    )


def _coefficients(e: Any, m: int) -> Array:
    given = real_array("e", e)
    if given.ndim == 0:
        given = np.full(m, float(given))
    if given.shape != (m,):
        raise ValueError(f"e must be one number or one for each of the {m} gaps, got {given.shape}")
    for i, value in enumerate(given):
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"e[{i}] must be in [0, 1], got {value}")
    return given.copy()


def laws_of(e: Restitutions) -> tuple[ImpactLaw, ...]:
    """Return the law of each gap."""
    return e if isinstance(e, tuple) else tuple(map(NewtonImpact, e.tolist()))


def core_of(e: Restitutions) -> Array | list[_zivi.ImpactLaw]:
    """Return the impact laws for the core."""
    return [law._core for law in e] if isinstance(e, tuple) else e


def written(e: Restitutions) -> str:
    """Write them, as ``(0.5, 0.3)``."""
    each = map(repr, e) if isinstance(e, tuple) else (f"{value:g}" for value in e)
    return f"({', '.join(each)})"
