"""What a task gives back, and what all points must have alike."""

from __future__ import annotations

import dataclasses
import math
import pickle
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.study.messages import message_of
from zivi.study.outcome import Events

__all__ = ["EventTable", "Piece", "Schema", "check_same_schema", "joined"]

EVENTS_SIZE = 256
"""Bytes that the events of a point are taken to have."""
EventTable: TypeAlias = tuple[NDArray[np.int64], Events]
"""Events with the number of the point of each."""


@dataclasses.dataclass(frozen=True)
class Schema:
    """What every point gives.

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
        """Bytes of what is kept of a point; of the events, those of a few."""
        numbers = sum(math.prod(shape) for shape in self.shapes.values())
        return 8 * numbers + (EVENTS_SIZE if self.has_events else 0)


@dataclasses.dataclass
class Piece:
    """What a task gives back: some of its points.

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
        """Give what it has of consecutive points."""
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
        """Let all points fail."""
        self.failed |= dict.fromkeys(self.done.tolist(), why)
        self.done, self.values, self.events = self.done[:0], {}, None


def joined(tables: list[EventTable]) -> EventTable | None:
    """Put tables of events together."""
    if not sum(len(points) for points, _ in tables):
        return None
    return np.concatenate([it for it, _ in tables]), np.concatenate([it for _, it in tables])


def check_same_schema(schema: Schema, shapes: dict[str, tuple[int, ...]], has_events: bool) -> None:
    """Raise if what a point gave is not what the others give."""
    if shapes != schema.shapes:
        raise ValueError(f"returned {_shown(shapes)}; other points gave {_shown(schema.shapes)}")
    if has_events != schema.has_events:
        raise ValueError("either all points return (values, events) or none does")


def _shown(shapes: dict[str, tuple[int, ...]]) -> str:
    return ", ".join(f"{name} {shape}" if shape else name for name, shape in shapes.items())
