"""Results of points: numbers, arrays, events, errors; results of tasks."""

from __future__ import annotations

import dataclasses
import functools
import math
import pickle
import time
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, unmasked
from zivi.simulation.batch_result import BatchRuns
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.run_result import MassRun
from zivi.study.design import valid_name

# Text of an exception, safe for any file and terminal.

LONGEST = 1000
"""Characters of a message that are kept."""


def message_of(error: BaseException) -> str:
    """Return an exception as one text, safe for any file and terminal."""
    try:
        text = f"{type(error).__name__}: {error}"[:LONGEST]
    except Exception as other:  # of its own __str__
        text = f"{type(error).__name__}, whose text raises {type(other).__name__}"
    return writable(text)


def writable(text: str) -> str:
    """Escape what is no letter, half a pair of UTF-16 or a control character, and cut the text."""
    return "".join(map(_escaped, text[:LONGEST]))[:LONGEST]


def _escaped(letter: str) -> str:
    if letter in "\n\t" or unicodedata.category(letter) not in ("Cc", "Cs"):
        return letter
    return letter.encode("unicode_escape", "surrogatepass").decode("ascii")


# Result of a point: numbers, arrays of fixed shape, and events.

Values: TypeAlias = dict[str, float | Array]
Events: TypeAlias = NDArray[np.void]


@runtime_checkable
class Summarised(Protocol):
    """Protocol of results that define their values for a study."""

    def _summary(self) -> tuple[dict[str, Any], dict[str, str]]:
        """Return the values, and the units of the values that have one."""


RUN_UNITS = {
    "t": "s",
    "x": "m",
    "xdot": "m/s",
    "x_ref": "m",
    "xdot_ref": "m/s",
    "u": "m/s^2",
    "rest_time": "s",
    "n_impacts": "1",
    "n_zeno": "1",
    "n_liftoffs": "1",
    "nfev": "1",
    "n_steps": "1",
    "n_refused": "1",
    "n_saturated": "1",
    "run_status": "1",
}
"""What is kept of a `Trajectory` or a `ClosedLoop`, with its unit; x, u, ... are the last ones."""


def split(returned: Any) -> tuple[Values, Events | None, bool]:
    """Split a function's return value into values and events; return whether it had events."""
    has_events = isinstance(returned, tuple)
    if not has_events:
        return point_values(returned), None, False
    if len(returned) != 2:
        raise TypeError(f"a tuple must be (values, events), got {len(returned)} things")
    return point_values(returned[0]), point_events(returned[1]), True


def point_values(returned: Any) -> Values:
    """Return the values that are kept, by name."""
    if isinstance(returned, Mapping):
        if not returned:
            raise ValueError("the function returned an empty dict")
        return {name: _real_value(name, value) for name, value in returned.items()}
    if isinstance(returned, MassRun):
        return _summary(returned)
    if isinstance(returned, MechanicalTrajectory):
        return _mechanical_summary(returned)
    if hasattr(returned, "_summary"):  # quicker than the protocol: numbers come here
        return {name: _real_value(name, value) for name, value in returned._summary()[0].items()}
    return {"value": _real_value("the result", returned)}


def _real_value(name: str, value: Any) -> float | Array:
    if type(value) is float or isinstance(value, float | int):
        return float(value)
    if value is None:
        return np.nan
    unmasked(name, value)
    array = np.asarray(value)
    if array.dtype.kind not in "biuf":
        raise TypeError(
            f"{name} must be a real number or an array of them, got {type(value).__name__} "
            f"{value!r:.60}"
        )
    return array.astype(np.float64)


def _summary(run: MassRun) -> Values:
    last = {
        name: float(samples[-1]) if len(samples := getattr(run, name)) else np.nan
        for name in ("t", "x", "xdot", "x_ref", "xdot_ref", "u")
        if hasattr(run, name)
    }
    counts: dict[str, float] = {
        "n_impacts": len(run.impacts),
        "n_zeno": len(run.zeno_times),
        "n_liftoffs": len(run.liftoff_times),
        "nfev": run.nfev,
        "run_status": int(run.status),
    }
    for name in ("n_steps", "n_refused", "n_saturated"):
        if hasattr(run, name):
            counts[name] = getattr(run, name)
    rest = np.nan if run.rest_time is None else run.rest_time
    return {**last, "rest_time": rest, **{name: float(count) for name, count in counts.items()}}


def _mechanical_summary(run: MechanicalTrajectory) -> Values:
    last: Values = {name: getattr(run, name)[-1] for name in ("q", "qdot", "gaps")}
    counts: dict[str, float] = {
        "n_impacts": len(np.unique(run.impacts["group"])),
        "n_zeno": len(run.zeno),
        "n_liftoffs": len(run.liftoffs),
        "n_corners": len(run.corners),
        "n_flags": len(run.flags),
        "nfev": run.nfev,
        "n_steps": run.n_steps,
        "run_status": int(run.status),
    }
    contacts = run.contacts[-1].astype(np.float64)
    counted = {name: float(count) for name, count in counts.items()}
    return {"t": float(run.t[-1]), **last, "contacts": contacts, **counted}


def result_units(returned: Any) -> dict[str, str]:
    """Return the known units of results (those of runs)."""
    given = returned[0] if isinstance(returned, tuple) else returned
    if isinstance(given, MassRun):
        return {name: RUN_UNITS[name] for name in _summary(given)}
    if isinstance(given, MechanicalTrajectory):  # those of its coordinates are the user's
        return {"t": "s"}
    if isinstance(given, Summarised):
        return given._summary()[1]
    return {}


def point_events(given: Any) -> Events | None:
    """Return the events of a point as a structured array."""
    if given is None:
        return None
    if isinstance(given, Mapping):
        given = _structured(given)
    if not isinstance(given, np.ndarray) or given.dtype.names is None or given.ndim != 1:
        raise TypeError(
            "events must be a structured array such as sol.impacts, or a dict of arrays of one "
            f"length, got {type(given).__name__} {given!r:.60}"
        )
    for field in given.dtype.names:
        valid_name("field of events", field)
        kind = given.dtype[field]
        if kind.kind not in "biuf" or kind.shape:
            raise TypeError(f"events must hold real numbers, got {kind} in {field!r}")
    # without titles, second names of fields, which files do not keep
    return given.astype(_without_titles(given.dtype), copy=False)


@functools.cache
def _without_titles(dtype: np.dtype[Any]) -> np.dtype[Any]:
    return np.dtype([(name, dtype[name]) for name in dtype.names or ()])


def _structured(given: Mapping[str, Any]) -> Events:
    columns = {name: np.asarray(column) for name, column in given.items()}
    lengths = {column.shape for column in columns.values()}
    if len(lengths) != 1 or len(next(iter(lengths))) != 1:
        shapes = {name: column.shape for name, column in columns.items()}
        raise ValueError(f"events must be columns of one length, got the shapes {shapes}")
    dtype = [(name, column.dtype) for name, column in columns.items()]
    table = np.empty(next(iter(lengths)), dtype)
    for name, column in columns.items():
        table[name] = column
    return table


# Results of a vectorized function: arrays with an entry for each point.

MESSAGE = "message"
"""What in a dict says of each point why it failed, "" if it did not."""


@dataclasses.dataclass
class Many:
    """Results of one call.

    Parameters
    ----------
    values : dict of ndarray
        The values, a row for each point.
    units : dict of str
        Units that are known.
    has_events : bool
        Whether it gave events.
    events : tuple of ndarray, optional
        The events in the order of the points, and the place of the point of each.
    failed : dict of str
        Which points failed, by their places, and why.
    """

    values: dict[str, Array]
    units: dict[str, str]
    failed: dict[int, str]
    has_events: bool = False
    events: tuple[NDArray[np.int64], Events] | None = None


def many_of(returned: Any, n: int) -> Many:
    """Understand what a vectorized function returned for `n` points."""
    if not isinstance(returned, tuple):
        return _many_values(returned, n)
    if len(returned) != 2:
        raise TypeError(f"a tuple must be (values, events), got {len(returned)} things")
    many = _many_values(returned[0], n)
    many.has_events, many.events = True, _many_events(returned[1], n)
    return many


def _many_values(returned: Any, n: int) -> Many:
    if isinstance(returned, BatchRuns):
        return _of_batch(returned, n)
    if not isinstance(returned, Mapping):
        return Many({"value": _real_rows("the result", returned, n)}, {}, {})
    values = {name: _real_rows(name, it, n) for name, it in returned.items() if name != MESSAGE}
    if not values:
        raise ValueError("the function returned no values")
    return Many(values, {}, _failed_points(returned.get(MESSAGE), n))


def _real_rows(name: str, given: Any, n: int) -> Array:
    unmasked(name, given)
    array = np.asarray(given)
    if array.dtype.kind not in "biuf":
        raise TypeError(
            f"{name} must be an array of real numbers, got {type(given).__name__} {given!r:.60}"
        )
    if array.shape[:1] != (n,):
        raise ValueError(
            f"{name} must have one row for each of {n} points, got an array of shape {array.shape}"
        )
    return array.astype(np.float64)


def _failed_points(messages: Any, n: int) -> dict[int, str]:
    if messages is None:
        return {}
    if isinstance(messages, str) or len(messages) != n:
        raise ValueError(f"{MESSAGE} must have one text for each of {n} points")
    return {place: str(text) for place, text in enumerate(messages) if text}


def _of_batch(batch: BatchRuns, n: int) -> Many:
    """Extract the per-run results of a batch; `status` is how it ended."""
    if len(batch) != n:
        raise ValueError(f"a batch must have one run for each of {n} points, got {len(batch)}")
    table = batch._table()
    values: dict[str, Array] = {}
    units: dict[str, str] = {}
    for name, (dims, unit, _) in table.fields.items():
        # parameters of the batch are those of the points, or made of them
        if name in batch.parameters:
            continue
        if ((dims,) if isinstance(dims, str) else dims)[0] == "run":
            own = "run_status" if name == "status" else name
            values[own] = _real_rows(name, table.value(batch, name), n)
            units |= {own: unit} if unit else {}
    return Many(values, units, {})


def _many_events(given: Any, n: int) -> tuple[NDArray[np.int64], Events] | None:
    """Collect the events of all points in one table."""
    if given is None:
        return None
    if isinstance(given, Mapping) or isinstance(getattr(given, "dtype", None), np.dtype):
        return _by_place(given, n)
    if not isinstance(given, Sequence) or len(given) != n:
        raise ValueError(
            f"events must be a list with those of each of {n} points, or one table with the field "
            "'point', its place among them"
        )
    tables = [(place, point_events(it)) for place, it in enumerate(given)]
    known = [(place, table) for place, table in tables if table is not None]
    if not known:
        return None
    if len({table.dtype for _, table in known}) > 1:
        raise ValueError("the events of all points must have the same columns")
    places = np.repeat([place for place, _ in known], [len(table) for _, table in known])
    return places.astype(np.int64), np.concatenate([table for _, table in known])


def _by_place(given: Any, n: int) -> tuple[NDArray[np.int64], Events]:
    columns = dict(given) if isinstance(given, Mapping) else _field_columns(given)
    places = np.asarray(columns.pop("point", None))
    if places.dtype.kind not in "iu" or places.ndim != 1:
        raise TypeError("a table of events must have a column 'point' of whole numbers")
    if len(places) and not 0 <= places.min() <= places.max() < n:
        raise ValueError(f"the column 'point' of events must be >= 0 and < {n}")
    table = point_events(columns)
    assert table is not None
    if len(table) != len(places):
        raise ValueError("events must be columns of one length")
    order = np.argsort(places, kind="stable")
    return places[order].astype(np.int64), table[order]


def _field_columns(given: Any) -> dict[str, Any]:
    if given.dtype.names is None:
        raise TypeError(f"events must be a structured array, got {given.dtype}")
    return {name: given[name] for name in given.dtype.names}


# Result of a task, and the schema common to all points.

EVENTS_SIZE = 256
"""Bytes that the events of a point are taken to have."""
EventTable: TypeAlias = tuple[NDArray[np.int64], Events]
"""Events with the number of the point of each."""


@dataclasses.dataclass(frozen=True)
class Schema:
    """Schema of the results of a point.

    Parameters
    ----------
    shapes : dict
        For each value its name and its shape.
    has_events : bool
        Whether a point gives events.
    units : dict
        Units that are known from the kind of the result.
    """

    shapes: dict[str, tuple[int, ...]]
    has_events: bool
    units: dict[str, str]

    @property
    def size(self) -> int:
        """Bytes stored for a point; for the events, an estimate from a few points."""
        numbers = sum(math.prod(shape) for shape in self.shapes.values())
        return 8 * numbers + (EVENTS_SIZE if self.has_events else 0)


@dataclasses.dataclass
class Piece:
    """Result of a task: some of its points.

    Parameters
    ----------
    schema : Schema or None
        What the points gave; None if none was done.
    done : ndarray of int
        Numbers of the points that are done.
    values : dict of ndarray
        Their values, one row a point.
    events : tuple of ndarray or None
        All their events, in the order of the points: the number of the point of each, and a
        structured array.
    failed : dict of str
        Numbers of the points that failed, and why.
    rest : ndarray of int
        Numbers of the points that were not computed.
    raised : BaseException or None
        What ended the task and shall end the study: Ctrl-C or another exception that is not an
        `Exception`.
    seconds : float
        How long it took.
    """

    schema: Schema | None
    done: NDArray[np.int64]
    values: dict[str, Array]
    events: EventTable | None
    failed: dict[int, str]
    rest: NDArray[np.int64]
    raised: BaseException | None = None
    seconds: float = 0.0

    def __len__(self) -> int:
        return len(self.done) + len(self.failed)

    def __getstate__(self) -> dict[str, Any]:
        """Return what can be sent between processes: an exception that cannot only as its text."""
        state = dict(self.__dict__)
        if self.raised is not None:
            try:
                pickle.loads(pickle.dumps(self.raised))
            except Exception:
                state["raised"] = BaseException(message_of(self.raised))
        return state

    def within(self, span: range) -> Piece:
        """Return the outcomes of consecutive points."""
        where = slice(*np.searchsorted(self.done, (span.start, span.stop)))
        events = self.events
        if events is not None:
            rows = slice(*np.searchsorted(events[0], (span.start, span.stop)))
            events = (events[0][rows], events[1][rows]) if rows.start < rows.stop else None
        return dataclasses.replace(
            self,
            done=self.done[where],
            values={name: rows[where] for name, rows in self.values.items()},
            events=events,
            failed={point: why for point, why in self.failed.items() if point in span},
        )

    def fail(self, why: str) -> None:
        """Mark all points as failed."""
        self.failed |= dict.fromkeys(self.done.tolist(), why)
        self.done, self.values, self.events = self.done[:0], {}, None


def concatenate_tables(tables: list[EventTable]) -> EventTable | None:
    """Concatenate tables of events."""
    if not sum(len(points) for points, _ in tables):
        return None
    return np.concatenate([it for it, _ in tables]), np.concatenate([it for _, it in tables])


def check_same_schema(schema: Schema, shapes: dict[str, tuple[int, ...]], has_events: bool) -> None:
    """Raise if what a point gave is not what the others give."""
    if shapes != schema.shapes:
        raise ValueError(f"returned {_shapes(shapes)}; other points gave {_shapes(schema.shapes)}")
    if has_events != schema.has_events:
        raise ValueError("either all points return (values, events) or none does")


def _shapes(shapes: dict[str, tuple[int, ...]]) -> str:
    return ", ".join(f"{name} {shape}" if shape else name for name, shape in shapes.items())


# Puts the results of the points of a task together.


class Collector:
    """Collects the results of points of equal schema.

    Parameters
    ----------
    parameters : tuple of str
        Names that results cannot have.
    """

    def __init__(self, parameters: tuple[str, ...]) -> None:
        self._parameters = parameters
        self._start = time.monotonic()
        self._rows: list[Values] = []
        self._numbers: list[int] = []
        self._parts: list[tuple[NDArray[np.int64], dict[str, Array]]] = []
        self._events: list[EventTable] = []
        self.schema: Schema | None = None
        self.dtype: np.dtype[Any] | None = None
        self.failed: dict[int, str] = {}

    @property
    def seconds(self) -> float:
        """How long it has taken until now."""
        return time.monotonic() - self._start

    def add(self, point: int, returned: Any) -> None:
        """Add the result of a function for one point."""
        values, events, has_events = split(returned)
        shapes = {name: np.shape(value) for name, value in values.items()}
        dtype = None if events is None else events.dtype
        self._fit(shapes, has_events, dtype, lambda: result_units(returned))
        if events is not None and len(events):
            self._events.append((np.full(len(events), point), events.copy()))
        self._rows.append(values)
        self._numbers.append(point)

    def add_many(self, points: NDArray[np.int64], returned: Any) -> None:
        """Add the result of a vectorized function for several points."""
        if isinstance(returned, list):
            self._add_each(points, returned)
            return
        many = many_of(returned, len(points))
        good = np.ones(len(points), bool)
        good[list(many.failed)] = False
        if good.any():
            self._fit_many(many)
            self._stack()
            values = {name: rows[good] for name, rows in many.values.items()}
            self._parts.append((points[good], values))
            if many.events is not None:
                places, rows = many.events
                kept = good[places]
                self._events.append((points[places[kept]], rows[kept]))
        self.failed |= {int(points[place]): writable(why) for place, why in many.failed.items()}

    def _fit_many(self, many: Many) -> None:
        shapes = {name: rows.shape[1:] for name, rows in many.values.items()}
        dtype = many.events[1].dtype if many.events is not None else None
        self._fit(shapes, many.has_events, dtype, lambda: many.units)

    def _add_each(self, points: NDArray[np.int64], returned: list[Any]) -> None:
        if len(returned) != len(points):
            raise ValueError(
                f"a list must have one entry for each point, got {len(returned)} for {len(points)}"
            )
        for point, one in zip(points.tolist(), returned, strict=True):
            try:
                if isinstance(one, Exception):
                    raise one
                self.add(point, one)
            except Exception as error:
                self.failed[point] = message_of(error)

    def _fit(
        self,
        shapes: dict[str, tuple[int, ...]],
        has_events: bool,
        dtype: np.dtype[Any] | None,
        units: Callable[[], dict[str, str]],
    ) -> None:
        """Raise if something is not as before."""
        if self.schema is None:
            for name in shapes:
                if valid_name("result", name) in self._parameters:
                    raise ValueError(f"the result {name!r} has the name of a parameter")
            self.schema = Schema(shapes, has_events, units())
        check_same_schema(self.schema, shapes, has_events)
        if dtype is not None:
            if self.dtype not in (None, dtype):
                raise ValueError(f"events have {dtype}, those of others {self.dtype}")
            self.dtype = dtype

    def _stack(self) -> None:
        """Make arrays of the points that came one by one."""
        if self._numbers:
            names = self.schema.shapes if self.schema else ()
            rows = {name: np.array([row[name] for row in self._rows], float) for name in names}
            self._parts.append((np.array(self._numbers, np.int64), rows))
            self._rows, self._numbers = [], []

    def piece(self, rest: NDArray[np.int64], raised: BaseException | None = None) -> Piece:
        """Return all results so far, in increasing order of points."""
        self._stack()
        names = self.schema.shapes if self.schema and self._parts else ()
        return Piece(
            schema=self.schema if self._parts else None,
            done=np.concatenate([np.empty(0, np.int64), *(done for done, _ in self._parts)]),
            values={name: np.concatenate([it[name] for _, it in self._parts]) for name in names},
            events=concatenate_tables(self._events),
            failed=self.failed,
            rest=rest,
            raised=raised,
            seconds=self.seconds,
        )
