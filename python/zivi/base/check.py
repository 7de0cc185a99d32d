"""Validation of numbers, arrays and callables given by the user."""

from __future__ import annotations

import dis
import functools
import inspect
import math
import numbers
import re
import sys
import types
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

_T = TypeVar("_T")

# Checks of user input: types and shapes; ranges are checked by the classes that define them.

Array = NDArray[np.float64]
MaybeNone: TypeAlias = Any
"""None in a case that a caller often knows to be excluded.

``float | MaybeNone`` may be compared with None and, unlike ``float | None``, be used without that.
"""


def real(name: str, value: object) -> float:
    """Return `value` as a float; an error names what is not a real number, or too large."""
    if type(value) is float:
        return value
    if type(value) is not int and not isinstance(value, numbers.Real):
        raise TypeError(f"{name} must be a real number, got {type(value).__name__} {value!r}")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{name} must fit into a float, got an integer above 1e308") from None


_FLOAT64 = np.dtype(np.float64)


def real_array(name: str, value: object) -> Array:
    """Return `value` as a new contiguous array of floats; a TypeError names what holds no reals.

    A copy: what the caller, or a function that the caller gave, writes into `value` later changes
    nothing.
    """
    if type(value) is np.ndarray and value.dtype is _FLOAT64:
        return value.copy()
    unmasked(name, value)
    try:
        array = np.asarray(value)
    except ValueError as error:  # ragged
        raise TypeError(f"{name} must hold real numbers: {error}") from None
    if array.dtype.kind not in "biuf":
        raise TypeError(f"{name} must hold real numbers, got dtype {array.dtype}")
    return array.astype(np.float64, order="C", copy=True)


def read_only(array: Array) -> Array:
    """Return the array, which nobody can write into from now on."""
    array.flags.writeable = False
    return array


def unmasked(name: str, value: object) -> None:
    """Raise a ValueError for masked entries: NumPy would use the masked numbers."""
    if isinstance(mask := getattr(value, "_mask", None), np.ndarray) and mask.any():
        raise ValueError(
            f"{name} must not have masked entries, got {np.count_nonzero(mask)} of {mask.size}; "
            "use .compressed() or .filled(value)"
        )


def finite(name: str, value: object) -> float:
    """Return `value` as a finite float; a TypeError or ValueError names it otherwise."""
    number = real(name, value)
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {number}")
    return number


def not_negative(name: str, value: object) -> float:
    """Return `value` as a finite float >= 0; a TypeError or ValueError names it otherwise."""
    number = real(name, value)
    if not (math.isfinite(number) and number >= 0.0):
        raise ValueError(f"{name} must be finite and >= 0, got {number}")
    return number


def positive(name: str, value: object) -> float:
    """Return a finite number > 0."""
    number = real(name, value)
    if not (math.isfinite(number) and number > 0.0):
        raise ValueError(f"{name} must be finite and > 0, got {number}")
    return number


def identifier(name: str, value: str) -> str:
    """Return `value` if it can be a name in C; a ValueError tells it otherwise."""
    if re.fullmatch(r"[A-Za-z]\w*", value, re.ASCII) is None:
        raise ValueError(
            f"{name} must be a letter, then letters, digits and underscores, got {value!r}"
        )
    return value


def by_name(name: str, value: object) -> dict[str, Any]:
    """Return a dict with names for keys; a TypeError names what is none."""
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} must be a dict by names, got {type(value).__name__} {value!r}")
    return {str(key): it for key, it in value.items()}


def integer(name: str, value: object) -> int:
    """Return `value` as an int of 64 bits; a TypeError or ValueError names it otherwise."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise TypeError(f"{name} must be a whole number, got {value!r}")
    if abs(number := int(value)) >= 2**63:
        raise ValueError(f"{name} must be a whole number below 2**63, got {value}")
    return number


def all_of(name: str, given: Any, kind: type[_T]) -> tuple[_T, ...]:
    """Return one object of a public class, or a sequence of them, as a tuple."""
    several = (given,) if isinstance(given, kind) else given
    if not isinstance(several, Iterable):
        got = type(given).__name__
        raise TypeError(f"{name} must be a sequence of zivi.{kind.__name__}, got {got}")
    several = tuple(several)
    for i, one in enumerate(several):
        if not isinstance(one, kind):
            raise TypeError(f"{name}[{i}] must be a zivi.{kind.__name__}, got {one!r}")
    return several


def switch(name: str, value: object) -> bool:
    """Return `value` as True or False; a TypeError names it otherwise."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {value!r}")
    return bool(value)


# Arrays that arrive from outside for the VI solver: their type, shape and entries.

MAX_DENSE = 2000
"""Largest number of unknowns for which a sparse matrix is made dense: 2 x 32 MB of work."""


def vector(name: str, value: Any, *, scalar: bool = False) -> Array:
    """Return `value` as a one-dimensional array of floats, or perhaps a scalar one."""
    array = real_array(name, value)
    if array.ndim != 1 and not (scalar and array.ndim == 0):
        raise ValueError(f"{name} must be one-dimensional, got shape {array.shape}")
    return array


def bound(name: str, value: Any, n: int) -> Array | float:
    """Return `value`, a number or an array of `n`, as a float or an array of `n` floats.

    None, also as an entry, is no bound.
    """
    if type(value) in (float, int):
        return real(name, value)
    none = -np.inf if name == "lower" else np.inf
    if value is None:
        return none
    if isinstance(value, list | tuple) and any(entry is None for entry in value):
        value = [none if entry is None else entry for entry in value]
    array = real_array(name, value)
    if array.ndim == 0:
        return float(array)
    if array.shape != (n,):
        raise ValueError(f"{name} must have {n} entries, got shape {array.shape}")
    return array


def count(name: str, value: object, *, least: int = 0) -> int:
    """Return `value` as an integer that is large enough."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be an integer, got {type(value).__name__} {value!r}")
    if value < least:
        raise ValueError(f"{name} must be >= {least}, got {value}")
    return integer(name, int(value))


def require_finite(name: str, array: Array) -> None:
    """Reject an array with an entry that is not finite, naming the first one."""
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        index = ", ".join(str(int(k)) for k in bad[0])
        raise ValueError(f"{name}[{index}] must be finite, got {array[tuple(bad[0])]}")


def is_sparse(value: Any) -> bool:
    """Whether it is a sparse matrix or array."""
    return hasattr(value, "toarray") and hasattr(value, "nnz")


def dense(name: str, value: Any) -> Any:
    """Return a sparse matrix as a dense one, up to `MAX_DENSE` rows; others as they are."""
    if not is_sparse(value):
        return value
    if max(value.shape) > MAX_DENSE:
        raise ValueError(
            f"{name} is sparse with shape {value.shape}; a dense matrix may have at most "
            f"{MAX_DENSE} rows (zivi.vi.MAX_DENSE); use linear_algebra='auto' or 'sparse'"
        )
    return value.toarray()


def matrix(name: str, value: Any, n: int) -> Array:
    """Return `value`, dense or sparse, as an ``n x n`` array of floats."""
    array = real_array(name, value if type(value) is np.ndarray else dense(name, value))
    if array.shape != (n, n):
        raise ValueError(f"{name} must have shape ({n}, {n}), got {array.shape}")
    return array


# User functions, called as ``f(t, x, xdot)`` or ``f(t, y)`` (the signature of SciPy).


class OfState:
    """SciPy's ``f(t, y)`` as a function ``f(t, x, xdot)``; ``y`` is an array ``[x, xdot]``."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function

    def __call__(self, t: float, x: float, xdot: float) -> Any:
        """Call the function with a new array."""
        return self.function(t, np.array([x, xdot]))


def of_three(name: str, function: Any, *, more_than_y: bool) -> Callable[..., Any]:
    """Return a function as one of ``(t, x, xdot)``, by the number of its arguments.

    With `more_than_y` an optional argument after ``(t, y)`` keeps its default; otherwise an
    optional third argument is ambiguous and an error.
    """
    counts = _arity(function)
    _check_order(name, function, "(t, x, xdot), or of (t, y) with y = [x, xdot]")
    if counts is None:  # a builtin that does not tell
        return function  # type: ignore[no-any-return]
    required, most = counts
    either = required == 2 and 2 < most < math.inf
    if (required <= 2 and most == 2) or (either and more_than_y):
        return OfState(function)
    if either:
        raise TypeError(
            f"{name} must be a function of (t, x, xdot) or of (t, y), but it could be either with "
            "an optional third argument: bind that by functools.partial, or make it keyword-only"
        )
    if required <= 3 <= most:
        return function  # type: ignore[no-any-return]
    raise TypeError(
        f"{name} must be a function of (t, x, xdot), or of (t, y) with y = [x, xdot], got "
        f"{_signature(function)}"
    )


def check_arguments(name: str, function: Any, arguments: str) -> None:
    """Reject a function that does not take as many arguments by position as are named."""
    counts, given = _arity(function), arguments.count(",") + 1
    if counts is not None and not counts[0] <= given <= counts[1]:
        raise TypeError(f"{name} must be a function of ({arguments}), got {_signature(function)}")
    if arguments.startswith("t, "):
        _check_order(name, function, f"({arguments})")


POSITIONS = frozenset({"x", "q", "pos", "position", "y"})
VELOCITIES = frozenset(
    {"xdot", "qdot", "x_dot", "q_dot", "v", "vel", "velocity", "xd", "qd", "dx", "dq", "dxdt"}
)


def _check_order(name: str, function: Any, arguments: str) -> None:
    """Reject a function whose arguments have the right names in another order, as odeint's."""
    if type(function) is not types.FunctionType:
        return
    code = function.__code__
    names = code.co_varnames[: code.co_argcount]
    late = any(it in ("t", "time") for it in names[1:])
    without = len(names) > 1 and names[0] in POSITIONS and names[1] in VELOCITIES
    if (late and names[0] not in ("t", "time", "self", "_t", "_time", "_")) or without:
        raise TypeError(
            f"{name} must be a function of {arguments}, got {_signature(function)}; "
            "time is its first argument"
        )


def _arity(function: Any) -> tuple[float, float] | None:
    """Count the arguments that a function needs and the most that it takes, by position."""
    if type(function) is types.FunctionType and not hasattr(function, "__wrapped__"):
        code = function.__code__
        if not (code.co_kwonlyargcount or code.co_flags & inspect.CO_VARARGS):
            count = code.co_argcount
            return count - len(function.__defaults__ or ()), count
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return None
    if any(p.kind is p.KEYWORD_ONLY and p.default is p.empty for p in parameters):
        return math.inf, math.inf
    by_position = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    variadic = any(p.kind is p.VAR_POSITIONAL for p in parameters)
    required = sum(p.default is p.empty for p in by_position)
    return required, math.inf if variadic else len(by_position)


def reads_time(function: Any) -> bool:
    """Whether a function may use its first argument: not if its code never names it."""
    if is_jitted(function):
        function = function.py_func
    if type(function) is not types.FunctionType or hasattr(function, "__wrapped__"):
        return True
    return _names_first(function.__code__)


SEES_ALL = frozenset({"eval", "exec", "locals", "vars", "dir", "_getframe", "currentframe"})
"""What reads variables without naming them."""


@functools.lru_cache(maxsize=256)
def _names_first(code: types.CodeType) -> bool:
    if not code.co_argcount or SEES_ALL.intersection(code.co_names):
        return True
    first = code.co_varnames[0]
    for one in dis.get_instructions(code):
        # some instructions name two
        names = one.argval if isinstance(one.argval, tuple) else (one.argval,)
        if first in names and one.opname != "LOAD_CONST":
            return True
    return False


def _signature(function: Any) -> str:
    name = getattr(function, "__name__", type(function).__name__)
    return f"{'a lambda' if name == '<lambda>' else name}{inspect.signature(function)}"


def is_jitted(function: Any) -> bool:
    """Whether a function is one of ``@numba.njit``."""
    numba = sys.modules.get("numba")  # nothing of numba's can be here before
    return numba is not None and numba.extending.is_jitted(function)


def compiled_by_numba(function: Any, name: str) -> Any:
    """Compile a function of ``@numba.njit`` to a C function, once; None for anything else.

    The function keeps a reference to its compiled code, which lives equally long.
    """
    if not is_jitted(function):
        return None
    known = function.__dict__.get(COMPILED)
    return known or function.__dict__.setdefault(COMPILED, _cfunc(function, name))


COMPILED = "_zivi_compiled"
"""The attribute in which a function of numba keeps its C function."""

DOUBLES = "float64(float64, float64, float64)"


def _cfunc(function: Any, name: str) -> Any:
    import numba

    if isinstance(of_three(name, function.py_func, more_than_y=False), OfState):

        def law(t: float, x: float, xdot: float) -> Any:
            return function(t, np.array([x, xdot]))
    else:

        def law(t: float, x: float, xdot: float) -> Any:
            return function(t, x, xdot)

    try:
        return numba.cfunc(DOUBLES)(law)
    except numba.core.errors.NumbaError as error:
        why = next((line for line in str(error).splitlines() if "Failed in" not in line), "")
        raise TypeError(
            f"numba cannot compile {name} to {DOUBLES}: {why.strip()}. Fix the function, or pass "
            f"{name}.py_func to run it in Python"
        ) from error
