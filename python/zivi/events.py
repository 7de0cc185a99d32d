"""Events of the user: zeros of functions of time and state along a run."""

from __future__ import annotations

import dataclasses
import inspect
import itertools
from collections.abc import Callable, Sequence
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
    functions = [events] if callable(events) else list(events)
    return tuple(_event(k, function) for k, function in enumerate(functions))


def _event(k: int, function: Any) -> Event:
    if not callable(function):
        raise TypeError(f"events[{k}] must be a function g(t, x, xdot), got {function!r}")
    terminal = getattr(function, "terminal", False)
    if isinstance(terminal, bool):
        number = 1 if terminal else None
    elif isinstance(terminal, int | np.integer) and terminal >= 0:
        number = int(terminal) or None
    else:
        raise ValueError(f"events[{k}].terminal must be a bool or a count >= 0, got {terminal!r}")
    direction = getattr(function, "direction", 0)
    if not isinstance(direction, int | float | np.number) or np.isnan(direction):
        raise ValueError(f"events[{k}].direction must be a number, got {direction!r}")
    return Event(_of_three(function), int(np.sign(direction)), number)


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

    Every step is looked at on both ends; where ``s`` crosses zero within it, the velocity jumps,
    and both sides are looked at.
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
    return float(event.function(t, float(x[0]), float(xdot[0])))


def _changes(event: Event, path: Path, grid: Array) -> Any:
    """Pairs of neighbouring times between which the event counts."""
    x, xdot = path.physical(grid)
    states = zip(grid.tolist(), x.tolist(), xdot.tolist(), strict=True)
    values = ((t, float(event.function(t, x, xdot))) for t, x, xdot in states)
    for (left, before), (right, after) in itertools.pairwise(values):
        if event.counts(before, after):
            yield left, right


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
