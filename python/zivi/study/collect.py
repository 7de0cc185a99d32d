"""Puts the results of the points of a task together."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.study.design import name_of
from zivi.study.many import Many, many_of
from zivi.study.messages import message_of, writable
from zivi.study.outcome import Values, split, units_of
from zivi.study.piece import EventTable, Piece, Schema, check_same_schema, joined

__all__ = ["Collector"]


class Collector:
    """Puts the results of points together, if they are alike.

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
        """Take what a function gave for one point."""
        values, events, has_events = split(returned)
        shapes = {name: np.shape(value) for name, value in values.items()}
        dtype = None if events is None else events.dtype
        self._fit(shapes, has_events, dtype, lambda: units_of(returned))
        if events is not None and len(events):
            self._events.append((np.full(len(events), point), events.copy()))
        self._rows.append(values)
        self._numbers.append(point)

    def add_many(self, points: NDArray[np.int64], returned: Any) -> None:
        """Take what a vectorized function gave for several points."""
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
                if name_of("result", name) in self._parameters:
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
        """Give all that there is; the points of what came later are larger."""
        self._stack()
        names = self.schema.shapes if self.schema and self._parts else ()
        return Piece(
            schema=self.schema if self._parts else None,
            done=np.concatenate([np.empty(0, np.int64), *(done for done, _ in self._parts)]),
            values={name: np.concatenate([it[name] for _, it in self._parts]) for name in names},
            events=joined(self._events),
            failed=self.failed,
            rest=rest,
            raised=raised,
            seconds=self.seconds,
        )
