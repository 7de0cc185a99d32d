"""Events of the user: zeros of functions of time and state along a run."""

from __future__ import annotations

import dataclasses
import itertools
import math
import numbers
from collections.abc import Callable, Iterable, Sequence
from typing import Any, cast

import numpy as np

from zivi._check import Array, finite
from zivi._functions import of_three
from zivi.dense import Path

__all__ = ["Event", "Hits", "Level", "events_of", "locate"]


class Level:
    """An event where the motion crosses a level: ``x = c`` or ``xdot = c``.

    `SwitchedRK` finds all crossings, however short the motion stays beyond the level, from the
    polynomials of its dense output; a function of the user is looked at a few times a step. With a
    method of fixed steps it is the function ``x - c`` or ``xdot - c``.

    Parameters
    ----------
    x, xdot : float
        Exactly one of them: the level of the position (m) or of the velocity (m/s).
    terminal : bool or int
        Whether the run ends at the event, or at which.
    direction : int
        1 only rising, -1 only falling, 0 both.

    Raises
    ------
    ValueError, TypeError
        Unless exactly one level is given, a finite number.

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

    @property
    def _level(self) -> tuple[bool, float]:
        return (False, self.x) if self.x is not None else (True, cast(float, self.xdot))

    def __call__(self, t: float, x: float, xdot: float) -> float:
        """Signed distance from the level."""
        of_velocity, value = self._level
        return xdot - value if of_velocity else x - value

    def __repr__(self) -> str:
        name, value = ("xdot", self.xdot) if self.x is None else ("x", self.x)
        return f"Level({name}={value}, terminal={self.terminal}, direction={self.direction})"


@dataclasses.dataclass(frozen=True)
class Event:
    """A function whose changes of sign are events.

    Parameters
    ----------
    function : callable
        ``g(t, x, xdot)``.
    direction : int
        1: only from negative to positive; -1: only the other way; 0: both.
    terminal : int or None
        The run ends at the event of this number.
    level : (bool, float) or None
        For a `Level`: whether it is one of the velocity, and which.
    """

    function: Callable[[float, float, float], float]
    direction: int
    terminal: int | None
    level: tuple[bool, float] | None = None

    def counts(self, before: float, after: float) -> bool:
        """Whether going from `before` to `after` reaches zero in the wanted direction."""
        rises, falls = before < 0.0 <= after, before > 0.0 >= after
        return (rises and self.direction >= 0) or (falls and self.direction <= 0)


@dataclasses.dataclass
class Hits:
    """What happened of each event: times and states, and whether one ended the run."""

    t: list[Array]
    y: list[Array]
    end: float | None = None


def events_of(events: Any) -> tuple[Event, ...]:
    """Read the argument ``events``: a function or several, with SciPy's attributes."""
    if events is None:
        return ()
    if not (callable(events) or isinstance(events, Iterable)):
        raise TypeError(f"events must be a function or a sequence of functions, got {events!r}")
    functions = [events] if callable(events) else list(events)
    return tuple(_event(k, function) for k, function in enumerate(functions))


def _event(k: int, function: Any) -> Event:
    if not callable(function):
        raise TypeError(f"events[{k}] must be a function g(t, x, xdot), got {function!r}")
    terminal = getattr(function, "terminal", None)
    if not (terminal is None or _is_count(terminal)):
        raise ValueError(
            f"events[{k}].terminal must be a bool or a count from 0 to 2**63 - 1, got {terminal!r}"
        )
    direction = getattr(function, "direction", 0)
    if not isinstance(direction, numbers.Real) or direction != direction:  # NaN
        raise ValueError(f"events[{k}].direction must be a number, got {direction!r}")
    # no numpy.sign, which takes neither a bool nor an integer beyond 64 bits
    sign = int(direction > 0) - int(direction < 0)  # type: ignore[operator]
    level = function._level if isinstance(function, Level) else None
    called = of_three(f"events[{k}]", function, more_than_y=True)
    return Event(called, sign, int(terminal or 0) or None, level)


def _is_count(value: Any) -> bool:
    """Whether SciPy would take it as the number of an event, or as a bool."""
    whole = isinstance(value, bool | np.bool | int | np.integer) or (
        isinstance(value, float) and value.is_integer()
    )
    return whole and 0 <= int(value) < 2**63


def locate(grid: Array, path: Path, events: Sequence[Event]) -> Hits:
    """Find the events of a fixed-step run on its interpolation.

    Every step is looked at on both ends, and at the wall where ``s`` crosses zero within it.
    """
    found: list[tuple[float, int]] = []
    for index, event in enumerate(events):
        hits = (_root(event, path, *pair) for pair in _changes(event, path, grid))
        found += [(t, index) for t in itertools.islice(hits, event.terminal)]
    found.sort()
    return _until_terminal(found, path, events)


def _until_terminal(
    found: Sequence[tuple[float, int]], path: Path, events: Sequence[Event]
) -> Hits:
    times: list[list[float]] = [[] for _ in events]
    end = None
    for t, index in found:
        times[index].append(t)
        if events[index].terminal == len(times[index]):
            end = t
            break
    arrays = [np.array(of_one, dtype=float) for of_one in times]
    return Hits(arrays, [np.column_stack(path.physical(t)) for t in arrays], end)


def _value(event: Event, path: Path, t: float) -> float:
    x, xdot = path.physical(np.array([t]))
    return _number(event.function(t, float(x[0]), float(xdot[0])))


def _changes(event: Event, path: Path, grid: Array) -> Any:
    """Pairs of neighbouring times between which the event counts."""
    crossings = _crossings(path, grid)
    times = np.union1d(grid, crossings)
    x, xdot = path.physical(times)
    x[np.isin(times, crossings)] = 0.0
    states = zip(times.tolist(), x.tolist(), xdot.tolist(), strict=True)
    values = ((state[0], _number(event.function(*state))) for state in states)
    for (left, before), (right, after) in itertools.pairwise(values):
        if event.counts(before, after):
            yield left, right


def _crossings(path: Path, grid: Array) -> Array:
    """Give the times at which ``s`` crosses zero between two steps."""
    s, _ = path.lifted(grid)
    (k,) = np.nonzero(np.sign(s[:-1]) * np.sign(s[1:]) < 0)
    return grid[k] + np.diff(grid)[k] / (1.0 - s[k + 1] / s[k])


def _number(value: Any) -> float:
    try:
        return math.ldexp(value, 0)  # what is a float or becomes one; strings do not
    except TypeError:
        raise TypeError(f"an event function must return a float, got {value!r}") from None


def _root(event: Event, path: Path, left: float, right: float) -> float:
    """Bisect to the change of sign; a jump of the velocity has no zero."""
    low = _value(event, path, left)
    for _ in range(60):
        middle = 0.5 * (left + right)
        if not left < middle < right:
            break
        value = _value(event, path, middle)
        if event.counts(low, value):
            right = middle
        else:
            left, low = middle, value
    return right
