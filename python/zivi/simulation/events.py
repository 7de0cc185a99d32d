"""Events of a run: impacts at walls and gaps, and zeros of functions of the user."""

from __future__ import annotations

import functools
import numbers
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, check_arguments, finite, integer, of_three
from zivi.base.habits import field_error, hinted
from zivi.simulation.dense import LostPath

# Tables of events at walls and gaps.


class EventTable(np.recarray):
    """A record array of events; a field that it does not have is answered by a hint."""

    if not TYPE_CHECKING:  # which would take any name for granted

        def __getitem__(self, key):
            if isinstance(key, str) and key not in (self.dtype.fields or ()):  # or their titles
                raise field_error("impacts", key, self.dtype.names or ())
            return super().__getitem__(key)

        def __getattr__(self, name):
            if name.startswith("_"):
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            error = field_error("impacts", name, self.dtype.names or ())
            raise AttributeError(str(error), name=name)


Rows: TypeAlias = "np.recarray[Any, Any]"
"""A table of events: a record array."""

IMPACT = np.dtype([("t", "f8"), ("xdot_before", "f8"), ("xdot_after", "f8")])
"""An impact of a mass as it was computed: its time (s), the velocities before and after (m/s)."""

SLOWEST = 1e-3
"""The slowest impacts that are listed, as a part of the fastest one."""
MOST_LISTED = 1_000_000
"""Impacts of one accumulation that are listed at most."""

EVENT = {"t": "f8", "gap": "i8"}
FIELDS = {
    "impacts": {
        "t": "f8",
        "gap": "i8",
        "speed_before": "f8",
        "speed_after": "f8",
        "impulse": "f8",
        "group": "i8",
    },
    "zeno": EVENT | {"closed": "?m"},
    "touchdowns": EVENT,
    "liftoffs": EVENT,
    "openings": EVENT,
    "corners": {"t": "f8", "gaps": "?m"},
    "flags": {"kind": "U24", "t": "f8", "gaps": "?m", "size": "f8"},
}
"""The tables of a run: their fields and the types of these, ``?m`` for m flags."""

TITLES = {"speed_before": "xdot_before", "speed_after": "xdot_after"}
OF_MASS = np.dtype(
    [((TITLES[it], it), k) if it in TITLES else (it, k) for it, k in FIELDS["impacts"].items()]
)
"""The rows of impacts of one mass, whose speeds are also called velocities."""


def table(fields: dict[str, str], m: int, columns: dict[str, Any]) -> Rows:
    """Make a record array of columns; `m` is the number of gaps."""
    kind = _kind(tuple(fields.items()), m)
    count = len(columns["t"])
    if not count:  # most of the tables of most runs
        return _nothing(kind)
    rows = np.empty(count, kind)
    for name in fields:
        rows[name] = columns[name]
    return rows.view(EventTable)


@functools.lru_cache
def _kind(fields: tuple[tuple[str, str], ...], m: int) -> np.dtype[np.void]:
    """Return the type of the rows of a table."""
    return np.dtype([(name, "?", (m,)) if it == "?m" else (name, it) for name, it in fields])


@functools.lru_cache
def _nothing(kind: np.dtype[np.void]) -> Rows:
    """Return a table without rows: one for all, there is nothing in it to be changed."""
    return np.empty(0, kind).view(EventTable)


def impacts_of(record: _zivi.RunRecord | _zivi.LoopRecord) -> NDArray[np.void]:
    """Return the impacts of a record as a structured array."""
    return record.impacts.view(IMPACT)  # which has its rows


def rows_of_impacts(impacts: NDArray[np.void]) -> Rows:
    """Return the impacts of a mass as the table that a mechanism has, of unit mass and one gap."""
    rows = np.zeros(len(impacts), OF_MASS)
    rows["t"] = impacts["t"]
    rows["speed_before"], rows["speed_after"] = impacts["xdot_before"], impacts["xdot_after"]
    rows["impulse"] = rows["speed_after"] - rows["speed_before"]
    rows["group"] = np.arange(1, len(rows) + 1)
    return rows.view(EventTable)


def rows_of_events(name: str, times: Array, closed: bool = True) -> Rows:
    """Return the times of events of a mass as the table that a mechanism has."""
    columns = {"t": times, "gap": 0, "closed": np.full((len(times), 1), closed)}
    return table(FIELDS[name], 1, columns)


def check_slowest(part: Any) -> float:
    """Read the argument ``slowest``."""
    value: float = part if part is SLOWEST else finite("slowest", part)
    if not 0.0 < value <= 1.0:
        raise ValueError(f"slowest must be > 0 and <= 1, a part of the fastest impact, got {part}")
    return value


def check_bounds(speed: Any, limit: Any) -> None:
    """Reject bounds of a list of impacts that are none."""
    if not finite("speed", speed) > 0.0:
        raise ValueError(f"speed must be > 0, got {speed}")
    if integer("limit", limit) < 1:
        raise ValueError(f"limit must be >= 1, got {limit}")


def skipped_impacts(path: Any, speed: float, limit: int) -> tuple[Array, ...] | None:
    """Return columns of the impacts that jumps skipped, None if there are none."""
    skipped = getattr(path, "skipped_impacts", None)
    if skipped is None:
        return None
    columns: tuple[Array, ...] = skipped(speed, limit)
    return columns if len(columns[0]) else None


def listed(known: NDArray[np.void], path: Any, part: float) -> NDArray[np.void]:
    """List the impacts of a mass that were computed or skipped, down to a part of the fastest."""
    fastest = np.max(-known["xdot_before"], initial=0.0)
    fast = known[-known["xdot_before"] >= part * fastest]
    columns = skipped_fast(path, part * fastest)
    return fast if columns is None else _in_time_order(fast, columns)


def skipped_fast(path: Any, speed: float) -> tuple[Array, ...] | None:
    """Return the skipped impacts with at least a speed before them, if the run has kept them."""
    if isinstance(path, LostPath) or not speed > 0.0:
        return None
    return skipped_before(path, speed, MOST_LISTED)


def skipped_before(path: Any, speed: float, limit: int) -> tuple[Array, ...] | None:
    """Return the extrapolated impacts above a speed, up to a number for each extrapolation."""
    first = skipped_impacts(path, 0.0, 1)
    if first is None:
        return None
    # Newton's law: the speeds after them are e times those before
    least = np.min(first[2] / -first[1]) * (1.0 - 1e-9) * speed
    found = skipped_impacts(path, float(least), limit)
    return None if found is None else tuple(column[-found[1] >= speed] for column in found)


def down_to(known: NDArray[np.void], path: Any, speed: float, limit: int) -> NDArray[np.void]:
    """Add the impacts to `known` that the path of a run skipped, down to a speed before them."""
    check_bounds(speed, limit)
    fast = known[-known["xdot_before"] >= speed]
    columns = skipped_before(path, speed, limit)
    return fast if columns is None else _in_time_order(fast, columns)


def _in_time_order(fast: NDArray[np.void], columns: tuple[Array, ...]) -> NDArray[np.void]:
    skipped = np.empty(len(columns[0]), IMPACT)
    for field, column in zip(IMPACT.names or (), columns, strict=False):
        skipped[field] = column
    return np.sort(np.concatenate([fast, skipped]), order="t", kind="stable")


# The impacts of a mechanical system: those that were computed, and those that jumps skipped.


def listed_of_gaps(known: Rows, zeno: Rows, path: Any, part: float) -> Rows:
    """List the impacts down to a part of the fastest, by the speeds before them."""
    speed = float(part * np.max(-known["speed_before"], initial=0.0))
    fast = _groups_with(-known["speed_before"] >= speed, known)
    return _with_skipped(fast, known, zeno, skipped_fast(path, speed))


def down_to_of_gaps(known: Rows, zeno: Rows, path: Any, speed: float, limit: int) -> Rows:
    """List the impacts with at least a speed before them."""
    check_bounds(speed, limit)
    fast = _groups_with(-known["speed_before"] >= speed, known)
    return _with_skipped(fast, known, zeno, skipped_before(path, speed, limit))


def _groups_with(chosen: Any, known: Any) -> Any:
    """Select the simultaneous impacts that contain at least one chosen impact."""
    if np.all(chosen):
        return known
    groups = known["group"]
    wanted = np.zeros(1 + np.max(groups), bool)
    wanted[groups[chosen]] = True
    return known[wanted[groups]]


def _with_skipped(fast: Any, known: Any, zeno: Any, columns: tuple[Array, ...] | None) -> Rows:
    """Add what jumps to Zeno points skipped.

    These are impacts of one gap that repeat the last computed impact: all impulses, including
    reactions at closed gaps, decrease with its speed.
    """
    # plain arrays, whose fields are quick to get
    known, zeno = np.asarray(known), np.asarray(zeno)
    found, beyond = [np.asarray(fast)], 1 + np.max(known["group"], initial=-1)
    t, before, after, ends = columns or [np.empty(0)] * 4
    if not len(t):
        return _numbered(_by_time(found[0]))
    begins = _changes(ends)
    each, place = ends[begins], np.cumsum(begins) - 1
    gaps, first, count = _last(known, zeno, each)
    alone = count[place] == 1
    if np.any(alone):
        rows = known[first[place[alone]]]
        _fall(rows, after[alone] / rows["speed_after"])
        rows["t"], rows["speed_before"], rows["speed_after"] = t[alone], before[alone], after[alone]
        rows["group"] = beyond + np.arange(len(rows))
        found.append(rows)
        beyond += len(rows)
    for k in np.flatnonzero(count > 1):
        own, last = place == k, known[first[k] : first[k] + count[k]]
        rows = _repeated(last, gaps[k], t[own], before[own], after[own])
        rows["group"] = beyond + np.repeat(np.arange(own.sum()), len(last))
        found.append(rows)
        beyond += own.sum()
    return _numbered(_by_time(np.concatenate(found)))


def _numbered(rows: Any) -> Rows:
    """Return impacts at one instant a number, in the order of their times."""
    groups = rows["group"]
    there = np.zeros(1 + np.max(groups, initial=0), bool)
    there[groups] = True
    begins = _changes(groups)
    if np.count_nonzero(begins) == np.count_nonzero(there):
        rows["group"] = np.cumsum(begins)
    else:  # two groups at one time, one in between the other
        _, start, number = np.unique(groups, return_index=True, return_inverse=True)
        rows["group"] = 1 + np.argsort(np.argsort(start))[number]
    whole: Rows = rows.view(EventTable)
    return whole


def _changes(values: Any) -> Any:
    """Return where values differ from the previous one; True for the first."""
    return np.concatenate([np.ones(min(1, len(values)), bool), values[1:] != values[:-1]])


def _by_time(rows: Any) -> Any:
    """Sort impacts by time, simultaneous ones by their other fields."""
    order = np.argsort(rows["t"], kind="stable")
    t = rows["t"][order]
    if np.any(t[1:] == t[:-1]):
        return np.sort(rows, order="t", kind="stable")
    return rows[order]


def _last(known: Any, zeno: Any, ends: Array) -> tuple[Any, Any, Any]:
    """Find the gap that bounces before each accumulation, and its last impact.

    Returns the first row and the number of rows, none if unknown.
    """
    gaps, first, count = (np.zeros(len(ends), int) for _ in range(3))
    times = np.append(zeno["t"], np.nan)
    at = np.searchsorted(zeno["t"], ends)
    is_known = times[at] == ends
    gaps[is_known] = zeno["gap"][at[is_known]]
    for gap in np.unique(gaps[is_known]):
        own = np.flatnonzero(is_known & (gaps == gap))
        bounces = np.flatnonzero((known["gap"] == gap) & (known["speed_after"] > 0.0))
        before = np.searchsorted(known["t"][bounces], ends[own])
        own, before = own[before > 0], before[before > 0]
        group = known["group"][bounces[before - 1]]
        first[own] = np.searchsorted(known["group"], group)
        count[own] = np.searchsorted(known["group"], group, side="right") - first[own]
    return gaps, first, count


def _fall(rows: Any, ratio: Any) -> None:
    """Scale impacts with the speed."""
    for name in ("speed_before", "speed_after", "impulse"):
        rows[name] = rows[name] * ratio
    if "sticks" in (rows.dtype.names or ()):
        rows["tangential_impulse"] = rows["tangential_impulse"] * ratio
        rows["slip_before"] = rows["slip_after"] = np.nan


def _repeated(last: Any, gap: int, t: Any, before: Any, after: Any) -> Any:
    """Repeat an impact on several gaps at falling speeds."""
    ratio = after / last["speed_after"][last["gap"] == gap][0]
    rows = np.repeat(last, len(t)).reshape(len(last), len(t))
    rows["t"] = t
    _fall(rows, ratio)
    own = last["gap"] == gap
    rows["speed_before"][own], rows["speed_after"][own] = before, after
    return rows.T.ravel()


# Events of the user: zeros of functions of time and state along a run.


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

    Notes
    -----
    Crossings are roots of the dense output, isolated by Bernstein coefficients: none is missed, and
    no function is called.

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
