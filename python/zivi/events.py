"""Events of the user: zeros of functions of time and state along a run."""

from __future__ import annotations

import dataclasses
import inspect
import itertools
import math
import numbers
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from zivi._check import Array
from zivi.dense import Path

__all__ = ["Event", "Hits", "events_of", "locate"]


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
    """

    function: Callable[[float, float, float], float]
    direction: int
    terminal: int | None

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
    return Event(_of_three(function), sign, int(terminal or 0) or None)


def _is_count(value: Any) -> bool:
    """Whether SciPy would take it as the number of an event, or as a bool."""
    whole = isinstance(value, bool | np.bool | int | np.integer) or (
        isinstance(value, float) and value.is_integer()
    )
    return whole and 0 <= int(value) < 2**63


def _of_three(function: Any) -> Callable[[float, float, float], float]:
    """SciPy's ``g(t, y)`` as a function ``g(t, x, xdot)``."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # a builtin that does not tell
        return function  # type: ignore[no-any-return]
    kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    required = [p for p in parameters if p.kind in kinds and p.default is p.empty]
    variadic = any(p.kind is p.VAR_POSITIONAL for p in parameters)
    if len(required) != 2 or variadic:
        return function  # type: ignore[no-any-return]
    return lambda t, x, xdot: function(t, np.array([x, xdot]))


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
