"""What a vectorized function gives: arrays with an entry for each of many points."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, unmasked
from zivi.simulation.batch_result import Runs
from zivi.study.outcome import Events, events_of

__all__ = ["Many", "many_of"]

MESSAGE = "message"
"""What in a dict says of each point why it failed, "" if it did not."""


@dataclasses.dataclass
class Many:
    """What one call gave.

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
        return _values_of(returned, n)
    if len(returned) != 2:
        raise TypeError(f"a tuple must be (values, events), got {len(returned)} things")
    many = _values_of(returned[0], n)
    many.has_events, many.events = True, _events_of(returned[1], n)
    return many


def _values_of(returned: Any, n: int) -> Many:
    if isinstance(returned, Runs):
        return _of_batch(returned, n)
    if not isinstance(returned, Mapping):
        return Many({"value": _rows("the result", returned, n)}, {}, {})
    values = {name: _rows(name, it, n) for name, it in returned.items() if name != MESSAGE}
    if not values:
        raise ValueError("the function returned no values")
    return Many(values, {}, _failed(returned.get(MESSAGE), n))


def _rows(name: str, given: Any, n: int) -> Array:
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


def _failed(messages: Any, n: int) -> dict[int, str]:
    if messages is None:
        return {}
    if isinstance(messages, str) or len(messages) != n:
        raise ValueError(f"{MESSAGE} must have one text for each of {n} points")
    return {place: str(text) for place, text in enumerate(messages) if text}


def _of_batch(batch: Runs, n: int) -> Many:
    """Keep what a batch tells of each run; `status` is how it ended."""
    if len(batch) != n:
        raise ValueError(f"a batch must have one run for each of {n} points, got {len(batch)}")
    table = batch._table()
    values: dict[str, Array] = {}
    units: dict[str, str] = {}
    for name, (dims, unit, _) in table.fields.items():
        if ((dims,) if isinstance(dims, str) else dims)[0] == "run":
            own = "run_status" if name == "status" else name
            values[own] = _rows(name, table.value(batch, name), n)
            units |= {own: unit} if unit else {}
    return Many(values, units, {})


def _events_of(given: Any, n: int) -> tuple[NDArray[np.int64], Events] | None:
    """Put the events of all points into one table."""
    if given is None:
        return None
    if isinstance(given, Mapping) or isinstance(getattr(given, "dtype", None), np.dtype):
        return _by_place(given, n)
    if not isinstance(given, Sequence) or len(given) != n:
        raise ValueError(
            f"events must be a list with those of each of {n} points, or one table with the field "
            "'point', its place among them"
        )
    tables = [(place, events_of(it)) for place, it in enumerate(given)]
    known = [(place, table) for place, table in tables if table is not None]
    if not known:
        return None
    if len({table.dtype for _, table in known}) > 1:
        raise ValueError("the events of all points must have the same columns")
    places = np.repeat([place for place, _ in known], [len(table) for _, table in known])
    return places.astype(np.int64), np.concatenate([table for _, table in known])


def _by_place(given: Any, n: int) -> tuple[NDArray[np.int64], Events]:
    columns = dict(given) if isinstance(given, Mapping) else _columns(given)
    places = np.asarray(columns.pop("point", None))
    if places.dtype.kind not in "iu" or places.ndim != 1:
        raise TypeError("a table of events must have a column 'point' of whole numbers")
    if len(places) and not 0 <= places.min() <= places.max() < n:
        raise ValueError(f"the column 'point' of events must be >= 0 and < {n}")
    table = events_of(columns)
    assert table is not None
    if len(table) != len(places):
        raise ValueError("events must be columns of one length")
    order = np.argsort(places, kind="stable")
    return places[order].astype(np.int64), table[order]


def _columns(given: Any) -> dict[str, Any]:
    if given.dtype.names is None:
        raise TypeError(f"events must be a structured array, got {given.dtype}")
    return {name: given[name] for name in given.dtype.names}
