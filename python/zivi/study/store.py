"""Chunks of a study, the interface of stores, and the store in memory."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.base.extras import needed
from zivi.base.status import StudyStatus
from zivi.study.design import RESERVED, Design
from zivi.study.outcome import EventTable, Piece, Schema, concatenate_tables

if TYPE_CHECKING:
    import xarray

# The points of one chunk between the workers and the store.


@dataclasses.dataclass
class Block:
    """Results of the points of one chunk.

    Parameters
    ----------
    span : range
        Numbers of the points.
    status : ndarray of int8
        Their states.
    values : dict of ndarray
        Their values, one row per point, NaN if missing.
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
        """Insert the result of a task."""
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
        """Return all events in the order of the points, with the number of the point of each."""
        table = concatenate_tables(self.events)
        if table is None:
            return None
        if len(self.events) > 1:
            order = np.argsort(table[0], kind="stable")
            table = table[0][order], table[1][order]
        self.events = [table]
        return table


# How the points of a study are cut into chunks, the files of its store.

CHUNKS, LARGEST = 64, 1024
"""Chunks that a study of version 0.1 has, and points that one has at most, by default."""
SHARD, INNER = 2**21, 16
"""Points of a shard at most, and parts of it that are decoded on their own."""
ROOM = 2**28
"""Bytes that the results of a chunk may take before they are compressed."""
LEAST = 128
"""Bytes that a point is taken to have at least, so that most studies have one layout."""


@dataclasses.dataclass(frozen=True)
class Chunks:
    """Chunks of consecutive points, counted in the order of C. Each is one file of each array.

    Parameters
    ----------
    shape : tuple of int
        Points along each dimension.
    points : int or None
        Points of a chunk at most; by default as `sharded` says.
    sharded : bool
        Whether chunks are shards, which can be read in part: as many points as fit into 256 MB,
        at most 2,097,152. Otherwise (version 0.1) a 64th of all, at most 1024.
    size : int
        Bytes of the results of a point, of which the points of a shard depend.
    """

    shape: tuple[int, ...]
    points: int | None = None
    sharded: bool = False
    size: int = 0

    @property
    def has_shards(self) -> bool:
        """Whether files have several parts."""
        return self.sharded and self.points is None

    @property
    def room(self) -> int:
        """Points of a chunk at most."""
        if self.has_shards:
            fit = max(1, ROOM // max(LEAST, self.size))
            return min(SHARD, 1 << (fit.bit_length() - 1))
        return self.points or min(LARGEST, math.ceil(math.prod(self.shape) / CHUNKS))

    @functools.cached_property
    def inner(self) -> tuple[int, ...]:
        """Points along each dimension of a decoding unit."""
        room = max(1, self.room // INNER) if self.has_shards else self.room
        return _filled(self.shape, room, (1,) * len(self.shape))

    @functools.cached_property
    def chunk(self) -> tuple[int, ...]:
        """Points of a chunk along each dimension: ``(1, ..., 1, some, all, ..., all)``.

        All are rounded up to the parts of a shard.
        """
        return _filled(self.shape, self.room, self.inner) if self.has_shards else self.inner

    @property
    def per_dimension(self) -> tuple[int, ...]:
        """Chunks along each dimension."""
        pairs = zip(self.shape, self.chunk, strict=True)
        return tuple(math.ceil(length / size) for length, size in pairs)

    def __len__(self) -> int:
        return math.prod(self.per_dimension)

    def coordinates(self, chunk: int) -> tuple[int, ...]:
        """Return the index of the chunk along each dimension."""
        found: list[int] = []
        for number in reversed(self.per_dimension):
            chunk, place = divmod(chunk, number)
            found.append(place)
        return tuple(reversed(found))

    def number(self, coordinates: tuple[int, ...]) -> int:
        """Return the chunk at an index along each dimension."""
        found = 0
        for place, length in zip(coordinates, self.per_dimension, strict=True):
            found = found * length + place
        return found

    def chunk_of(self, points: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the chunks of points."""
        places = zip(np.unravel_index(points, self.shape), self.chunk, strict=True)
        found = np.zeros(len(points), np.int64)
        for (place, size), length in zip(places, self.per_dimension, strict=True):
            found = found * length + place // size
        return found

    def chunks_of(self, points: NDArray[np.int64]) -> list[int]:
        """List the chunks of increasing points."""
        first, last = self.chunk_of(points[[0, -1]]).tolist()
        return [first] if first == last else np.unique(self.chunk_of(points)).tolist()

    def slices(self, chunk: int) -> tuple[slice, ...]:
        """Return the slices of a chunk along each dimension."""
        places = zip(self.coordinates(chunk), self.chunk, self.shape, strict=True)
        return tuple(
            slice(place * size, min((place + 1) * size, length)) for place, size, length in places
        )

    def span(self, chunk: int) -> range:
        """Return the range of point numbers of a chunk; ranges of chunks do not overlap."""
        slices = self.slices(chunk)
        start = 0
        for piece, length in zip(slices, self.shape, strict=True):
            start = start * length + piece.start
        return range(start, start + math.prod(piece.stop - piece.start for piece in slices))


def _filled(shape: tuple[int, ...], room: int, unit: tuple[int, ...]) -> tuple[int, ...]:
    """Fill a room with points, the last dimension first, in multiples of a unit."""
    sizes: list[int] = []
    for length, one in zip(reversed(shape), reversed(unit), strict=True):
        if room >= length:
            sizes.append(math.ceil(length / one) * one)
            room //= length
        else:
            sizes.append(max(1, room // one) * one)
            room = 1
    return tuple(reversed(sizes))


# Where results go: the interface of stores, and the one in memory.

# the metadata of a folder are compared with these: the words of version 0.1 stay in them
DESCRIPTIONS = {
    "status": {"long_name": "0 missing, 1 done, 2 failed", "units": "1"},
    "message": {"long_name": "why a point failed"},
    "n_events": {"long_name": "number of events", "units": "1"},
}


class Labels:
    """Units and names of dimensions that a user gives.

    Parameters
    ----------
    units : dict
        Units of parameters and results.
    dims : dict
        Names of the dimensions of results that are arrays.
    """

    def __init__(self, units: Mapping[str, str], dims: Mapping[str, Sequence[str]]) -> None:
        for what, unit in units.items():
            if not isinstance(what, str) or not isinstance(unit, str):
                raise TypeError(f"units must give strings by names, got {what!r}: {unit!r}")
        for name, names in dims.items():
            of = f"dims[{name!r}]"
            if isinstance(names, str) or not all(isinstance(it, str) and it for it in names):
                raise TypeError(f"{of} must be a list of names, got {names!r}")
            if len(set(names)) < len(names):
                raise ValueError(f"{of} names a dimension twice: {', '.join(names)}")
        self.units = dict(units)
        self.dims = {name: tuple(names) for name, names in dims.items()}

    def check_names(self, parameters: Sequence[str]) -> None:
        """Raise if a dimension of a result has a name that the points need."""
        for name, names in self.dims.items():
            if taken := set(names) & {*parameters, *RESERVED, *self.dims}:
                raise ValueError(
                    f"dims[{name!r}] cannot name a dimension {taken.pop()!r}: a parameter, a "
                    "result or the store has this name"
                )

    def check(self, schema: Schema, parameters: Sequence[str]) -> None:
        """Raise if the dimensions of the results do not fit them, or one another."""
        self.check_names(parameters)
        known: dict[str, tuple[str, int]] = {}
        for name, shape in schema.shapes.items():
            names = dims_of(name, shape, (), self)
            if len(shape) != len(names):
                raise ValueError(
                    f"dims[{name!r}] names {len(names)} dimensions, "
                    f"the result has the shape {shape}"
                )
            for dim, length in zip(names, shape, strict=True):
                if dim in (*schema.shapes, *parameters):
                    raise ValueError(
                        f"the dimension {dim!r} of {name!r} has the name of a result or of a "
                        "parameter; rename it by dims"
                    )
                other, size = known.setdefault(dim, (name, length))
                if size != length:
                    raise ValueError(
                        f"the dimension {dim!r} has the length {size} in {other!r}, {length} in "
                        f"{name!r}; rename one by dims"
                    )


class Store(Protocol):
    """Interface of stores for the results of a study."""

    @property
    def layout(self) -> Chunks:
        """The chunks of points, which may be others once it is known what the points give."""

    @property
    def identity(self) -> dict[str, Any]:
        """Identity of the study."""

    @property
    def schema(self) -> Schema | None:
        """Schema of the results, once it is known."""

    def written(self) -> list[int]:
        """List the chunks that have states."""

    def status_of(self, chunk: int) -> NDArray[np.int8]:
        """Return the states of the points of a chunk; unreadable points count as missing."""

    def define(self, schema: Schema) -> None:
        """Create the arrays of the results."""

    def load(self, chunk: int) -> Block:
        """Return the stored data of a chunk."""

    def save(self, chunk: int, block: Block) -> None:
        """Save a chunk atomically."""

    def close(self) -> None:
        """Release the lock for writing."""


def count_points(store: Store, *states: StudyStatus) -> int:
    """Count the points of a store in some states, chunk by chunk."""
    own = (store.status_of(chunk) for chunk in store.written())
    return sum(int(np.count_nonzero(np.isin(status, states))) for status in own)


def dataset_attributes(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return the attributes of the dataset."""
    found = {
        "title": f"Study of {identity['function']}",
        "source": f"zivi {_zivi.__version__}",
        "parameters": json.dumps(identity["parameters"]),
        "config": json.dumps(identity),
    }
    # what is not there is left out: not every format of a dataset has a word for it
    return found if identity["seed"] is None else found | {"seed": identity["seed"]}


def dims_of(name: str, shape: tuple[int, ...], design: tuple[str, ...], labels: Labels) -> Any:
    """Return the dimensions of a result."""
    own = labels.dims.get(name) or tuple(f"{name}_{axis}" for axis in range(len(shape)))
    return (*design, *own)


class MemoryStore:
    """Keeps the results of a study in this process.

    Parameters
    ----------
    design : Design
        The points.
    layout : Layout
        How they are cut into chunks.
    identity : dict
        Identity of the study.
    labels : Labels
        Units and dimensions.
    """

    def __init__(
        self, design: Design, layout: Chunks, identity: dict[str, Any], labels: Labels
    ) -> None:
        self._design, self._labels = design, labels
        self.layout, self.identity = layout, identity
        self.schema: Schema | None = None
        self._blocks: dict[int, Block] = {}

    def written(self) -> list[int]:
        """List the chunks of which something is known."""
        return sorted(self._blocks)

    def status_of(self, chunk: int) -> NDArray[np.int8]:
        """Return the states of the points of a chunk."""
        return self.load(chunk).status

    def define(self, schema: Schema) -> None:
        """Create the arrays of the results."""
        self._labels.check(schema, self._design.names)
        self.schema = schema
        for block in self._blocks.values():  # those of which all points failed
            block.shaped(schema)

    def load(self, chunk: int) -> Block:
        """Return the stored data of a chunk."""
        return self._blocks.get(chunk) or Block.empty(self.layout.span(chunk))

    def save(self, chunk: int, block: Block) -> None:
        """Keep a chunk."""
        if self.schema is not None:
            block.shaped(self.schema)
        self._blocks[chunk] = block

    def close(self) -> None:
        """Do nothing: nobody else writes here."""

    def events(self) -> Any:
        """Return the events of all points, None where the function gives none."""
        if self.schema is None or not self.schema.has_events:
            return None
        tables = [self._blocks[chunk].table() for chunk in sorted(self._blocks)]
        known = [table for table in tables if table is not None]
        if not known:
            return np.empty(0, [("point", np.int64)])
        fields = known[0][1].dtype
        found = np.empty(sum(len(points) for points, _ in known), [("point", "i8"), *fields.descr])
        found["point"] = np.concatenate([points for points, _ in known])
        for field in fields.names or ():
            found[field] = np.concatenate([events[field] for _, events in known])
        return found

    def _filled(self, shape: tuple[int, ...], empty: Any, dtype: Any, of: Any) -> Any:
        """Assemble the arrays that `of` returns for each chunk into one over the points."""
        flat = np.full((len(self._design), *shape), empty, dtype)
        for block in self._blocks.values():
            flat[block.span.start : block.span.stop] = of(block)
        return flat.reshape(*self._design.shape, *shape)

    def dataset(self) -> xarray.Dataset:
        """Return the results so far."""
        needed("xarray", "the results of studies")
        import xarray

        design, units = self._design, self._labels.units
        schema = self.schema or Schema({}, False, {})
        known = {**schema.units, **units}

        def unit(name: str) -> dict[str, str]:
            return {"units": known[name]} if name in known else {}

        columns: dict[str, Any] = {
            name: (
                dims_of(name, shape, design.dims, self._labels),
                self._filled(shape, np.nan, float, lambda block, name=name: block.values[name]),
                unit(name),
            )
            for name, shape in schema.shapes.items()
        }
        dims = design.dims
        columns["status"] = dims, self._filled((), 0, np.int8, _status), DESCRIPTIONS["status"]
        messages = self._filled((), "", object, _messages)
        columns["message"] = dims, messages.astype(str), DESCRIPTIONS["message"]
        if schema.has_events:
            counts = self._filled((), 0, np.int64, Block.counts)
            columns["n_events"] = dims, counts, DESCRIPTIONS["n_events"]
        coordinates = {
            name: ((name,) if design.kind == "grid" else dims, column, unit(name))
            for name, column in design.values.items()
        }
        return xarray.Dataset(columns, coordinates, dataset_attributes(self.identity))


def _status(block: Block) -> NDArray[np.int8]:
    return block.status


def _messages(block: Block) -> list[str]:
    return [block.messages.get(point, "") for point in block.span]
