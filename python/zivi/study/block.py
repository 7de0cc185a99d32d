"""The points of one chunk between the workers and the store."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.base.status import StudyStatus
from zivi.study.piece import EventTable, Piece, Schema, joined

__all__ = ["Block"]


@dataclasses.dataclass
class Block:
    """What is known of the points of one chunk.

    Parameters
    ----------
    span : range
        Numbers of the points.
    status : ndarray of int8
        Their states.
    values : dict of ndarray
        Their values, one row a point, NaN where there is none.
    messages : dict of str
        Why points failed, by their numbers.
    events : list of tuple
        Tables of events: the number of the point of each, and a structured array.
    """

    span: range
    status: NDArray[np.int8]
    values: dict[str, Array] = dataclasses.field(default_factory=dict)
    messages: dict[int, str] = dataclasses.field(default_factory=dict)
    events: list[EventTable] = dataclasses.field(default_factory=list)

    @classmethod
    def empty(cls, span: range) -> Block:
        """Make a chunk of which nothing is known."""
        return cls(span, np.zeros(len(span), np.int8))

    def shaped(self, schema: Schema) -> None:
        """Make room for values."""
        for name, shape in schema.shapes.items():
            if name not in self.values:
                self.values[name] = np.full((len(self.span), *shape), np.nan)

    def take(self, piece: Piece) -> None:
        """Put in what a task gave back."""
        places = piece.done - self.span.start
        for name, rows in piece.values.items():
            self.values[name][places] = rows
        self.status[places] = StudyStatus.COMPLETED
        if self.messages:
            for point in piece.done.tolist():
                self.messages.pop(point, None)
        if piece.events is not None:
            self.events.append(piece.events)
        for point, message in piece.failed.items():
            self.status[point - self.span.start] = StudyStatus.FAILED
            self.messages[point] = message

    def counts(self) -> NDArray[np.int64]:
        """Count the events of each point."""
        found = np.zeros(len(self.span), np.int64)
        for points, _ in self.events:
            found += np.bincount(points - self.span.start, minlength=len(found))
        return found

    def table(self) -> EventTable | None:
        """Give all events in the order of the points, with the number of the point of each."""
        table = joined(self.events)
        if table is None:
            return None
        if len(self.events) > 1:
            order = np.argsort(table[0], kind="stable")
            table = table[0][order], table[1][order]
        self.events = [table]
        return table
