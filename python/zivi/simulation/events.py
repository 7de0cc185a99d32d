"""Events of the user: zeros of functions of time and state along a run."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Iterable
from typing import Any, TypeVar, cast

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import check_arguments, finite, of_three
from zivi.base.habits import hinted

Function = TypeVar("Function", bound=Callable[..., Any])

MECHANICAL = "g(t, q, qdot)"
"""What an event of a mechanical system is."""


@hinted("Level")
class Level:
    """An event where the motion crosses a level: ``x = c`` or ``xdot = c``.

    `SwitchedRK` finds all crossings, however brief, from the polynomials of its dense output; a
    user function is only sampled a few times per step. With a method of fixed steps it is the
    function ``x - c`` or ``xdot - c``.

    Parameters
    ----------
    x, xdot : float
        Exactly one of them: the level of the position (m) or of the velocity (m/s).
    terminal : bool or int
        Whether the run ends at the event; an integer n ends it at the n-th.
    direction : int
        1 only rising, -1 only falling, 0 both.

    Raises
    ------
    ValueError, TypeError
        Unless exactly one level is given, a finite number.

    See Also
    --------
    event : attributes of event functions.
    simulate : the argument ``events``.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-2.0, e=0.5)
    >>> sol = zivi.simulate(ball, (0, 4), (1, 0), events=zivi.Level(x=0.24, direction=1))
    >>> [round(float(t), 9) for t in sol.t_events[0]]  # on the arc from 1 s, 0.25 m high
    [1.4]
    """

    def __init__(
        self,
        *,
        x: float | None = None,
        xdot: float | None = None,
        terminal: bool | int = False,
        direction: int = 0,
    ) -> None:
        if (x is None) == (xdot is None):
            raise ValueError(f"exactly one of x and xdot must be given, got {x!r} and {xdot!r}")
        self.x = None if x is None else finite("x", x)
        self.xdot = None if xdot is None else finite("xdot", xdot)
        self.terminal, self.direction = terminal, direction

    def __call__(self, t: float, x: float, xdot: float) -> float:
        """Signed distance from the level."""
        return x - self.x if self.x is not None else xdot - cast("float", self.xdot)

    def __repr__(self) -> str:
        name, value = ("xdot", self.xdot) if self.x is None else ("x", self.x)
        return f"Level({name}={value}, terminal={self.terminal}, direction={self.direction})"


@hinted("event")
def event(*, terminal: bool | int = False, direction: float = 0) -> Callable[[Function], Function]:
    """Set SciPy's attributes ``terminal`` and ``direction`` on an event function.

    A decorator: type checkers object to attributes that are set from outside.

    Parameters
    ----------
    terminal : bool or int
        Whether the run ends at the event; an integer n ends it at the n-th.
    direction : float
        1 only rising, -1 only falling, 0 both.

    Returns
    -------
    callable
        Of a function, which it returns with the attributes set.

    Raises
    ------
    ValueError
        If `terminal` is neither a bool nor a count, or `direction` no number.

    See Also
    --------
    Level : crossings of a level of position or velocity.
    simulate : the argument ``events``.

    Notes
    -----
    Sign changes are located on the dense output to rounding; two sign changes between samples of
    the function may be missed.

    Examples
    --------
    >>> @zivi.event(terminal=True, direction=-1)
    ... def half_way(t, x, xdot):
    ...     return x - 0.5
    >>> sol = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 2), (1, 0), events=half_way)
    >>> round(float(sol.t[-1]), 6)
    0.319275
    """
    if not is_count(terminal):
        raise ValueError(
            f"terminal must be a bool or a count from 0 to 2**63 - 1, got {terminal!r}"
        )
    if not isinstance(direction, numbers.Real) or direction != direction:  # NaN
        raise ValueError(f"direction must be a number, got {direction!r}")

    def with_settings(function: Function) -> Function:
        thing: Any = function
        thing.terminal, thing.direction = terminal, direction
        return function

    return with_settings


def events_of(events: Any, form: str = "g(t, x, xdot)") -> list[_zivi.Event]:
    """Read the argument ``events``: a function or several, with SciPy's attributes."""
    if events is None:
        return []
    if not (callable(events) or isinstance(events, Iterable)):
        raise TypeError(f"events must be a function or a sequence of functions, got {events!r}")
    functions = [events] if callable(events) else list(events)
    return [_event(k, function, form) for k, function in enumerate(functions)]


def _event(k: int, function: Any, form: str) -> _zivi.Event:
    if not callable(function):
        raise TypeError(f"events[{k}] must be a function {form}, got {function!r}")
    terminal = getattr(function, "terminal", None)
    if not (terminal is None or is_count(terminal)):
        raise ValueError(
            f"events[{k}].terminal must be a bool or a count from 0 to 2**63 - 1, got {terminal!r}"
        )
    direction = getattr(function, "direction", 0)
    if not isinstance(direction, numbers.Real) or direction != direction:  # NaN
        raise ValueError(f"events[{k}].direction must be a number, got {direction!r}")
    # not numpy.sign, which rejects bools and integers of more than 64 bits
    sign = int(direction > 0) - int(direction < 0)  # type: ignore[operator]
    of_mass = form != MECHANICAL
    if not of_mass:
        check_arguments(f"events[{k}]", function, "t, q, qdot")
    exact = of_mass and isinstance(function, Level)
    levels = (function.x, function.xdot) if exact else (None, None)
    return _zivi.Event(
        of_three(f"events[{k}]", function, more_than_y=True) if of_mass else function,
        direction=sign,
        terminal=int(terminal or 0) or None,
        level_x=levels[0],
        level_xdot=levels[1],
    )


def is_count(value: Any) -> bool:
    """Whether SciPy would accept it as the number of an event or as a bool."""
    whole = isinstance(value, bool | np.bool | int | np.integer) or (
        isinstance(value, float) and value.is_integer()
    )
    return whole and 0 <= int(value) < 2**63
