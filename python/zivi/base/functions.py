"""Functions of the user: called as ``f(t, x, xdot)`` or, as in SciPy, as ``f(t, y)``."""

from __future__ import annotations

import dis
import functools
import inspect
import math
import sys
import types
from collections.abc import Callable
from typing import Any

import numpy as np

__all__ = [
    "OfState",
    "check_arguments",
    "compiled_by_numba",
    "is_jitted",
    "of_three",
    "reads_time",
]


class OfState:
    """SciPy's ``f(t, y)`` as a function ``f(t, x, xdot)``; ``y`` is an array ``[x, xdot]``."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function

    def __call__(self, t: float, x: float, xdot: float) -> Any:
        """Call the function with a new array."""
        return self.function(t, np.array([x, xdot]))


def of_three(name: str, function: Any, *, more_than_y: bool) -> Callable[..., Any]:
    """Give a function as one of ``(t, x, xdot)``, by the number of its arguments.

    With `more_than_y` an optional argument behind ``(t, y)`` keeps its default; else whether it is
    one, or the third of ``(t, x, xdot)``, is not for us to guess.
    """
    counts = _counts(function)
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
        f"{name} must be a function of (t, x, xdot), or of (t, y) with y = [x, xdot], "
        f"got {_shown(function)}"
    )


def check_arguments(name: str, function: Any, arguments: str) -> None:
    """Refuse a function that does not take as many arguments by position as are named."""
    counts, given = _counts(function), arguments.count(",") + 1
    if counts is not None and not counts[0] <= given <= counts[1]:
        raise TypeError(f"{name} must be a function of ({arguments}), got {_shown(function)}")
    if arguments.startswith("t, "):
        _check_order(name, function, f"({arguments})")


POSITIONS = frozenset({"x", "q", "pos", "position", "y"})
VELOCITIES = frozenset(
    {"xdot", "qdot", "x_dot", "q_dot", "v", "vel", "velocity", "xd", "qd", "dx", "dq", "dxdt"}
)


def _check_order(name: str, function: Any, arguments: str) -> None:
    """Refuse a function whose arguments have the right names in another order, as odeint's."""
    if type(function) is not types.FunctionType:
        return
    code = function.__code__
    names = code.co_varnames[: code.co_argcount]
    late = any(it in ("t", "time") for it in names[1:])
    without = len(names) > 1 and names[0] in POSITIONS and names[1] in VELOCITIES
    if (late and names[0] not in ("t", "time", "self", "_t", "_time", "_")) or without:
        raise TypeError(
            f"{name} must be a function of {arguments}, got {_shown(function)}; "
            "time is its first argument"
        )


def _counts(function: Any) -> tuple[float, float] | None:
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


def _shown(function: Any) -> str:
    name = getattr(function, "__name__", type(function).__name__)
    return f"{'a lambda' if name == '<lambda>' else name}{inspect.signature(function)}"


def is_jitted(function: Any) -> bool:
    """Whether a function is one of ``@numba.njit``."""
    numba = sys.modules.get("numba")  # nothing of numba's can be here before
    return numba is not None and numba.extending.is_jitted(function)


def compiled_by_numba(function: Any, name: str) -> Any:
    """Compile a function of ``@numba.njit`` to a C function, once; None for anything else.

    The function keeps what is compiled: whoever holds the one holds the other.
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
            f"{name}, a function of numba, does not compile to {DOUBLES}: {why.strip()}. Mend it, "
            f"or give {name}.py_func, which runs in the interpreter"
        ) from error
