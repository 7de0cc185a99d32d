"""How the points of a study are cut into chunks, the files of its store."""

import dataclasses
import functools
import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["INNER", "SHARD", "Layout"]

CHUNKS, LARGEST = 64, 1024
"""Chunks that a study of version 0.1 has, and points that one has at most, by default."""
SHARD, INNER = 2**21, 16
"""Points of a shard at most, and parts of it that are decoded on their own."""
ROOM = 2**28
"""Bytes that the results of a chunk may take before they are compressed."""
LEAST = 128
"""Bytes that a point is taken to have at least, so that most studies have one layout."""


@dataclasses.dataclass(frozen=True)
class Layout:
    """Chunks of consecutive points, counted in the order of C. Each is one file of each array.

    Parameters
    ----------
    shape : tuple of int
        Points along each dimension.
    points : int or None
        Points of a chunk at most; by default as `sharded` says.
    sharded : bool
        Whether chunks are shards, which can be read in part: as many points as fit into 256 MB,
        at most 2,097,152. Otherwise, as in version 0.1, a 64th of all, at most 1024.
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
        """Points along each dimension of what is decoded at a time."""
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
        """Tell which chunk along each dimension it is."""
        found: list[int] = []
        for number in reversed(self.per_dimension):
            chunk, place = divmod(chunk, number)
            found.append(place)
        return tuple(reversed(found))

    def number(self, coordinates: tuple[int, ...]) -> int:
        """Tell the chunk by where it is along each dimension."""
        found = 0
        for place, length in zip(coordinates, self.per_dimension, strict=True):
            found = found * length + place
        return found

    def chunk_of(self, points: NDArray[np.int64]) -> NDArray[np.int64]:
        """Tell in which chunks points are."""
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
        """Tell where the points of a chunk are."""
        places = zip(self.coordinates(chunk), self.chunk, self.shape, strict=True)
        return tuple(
            slice(place * size, min((place + 1) * size, length)) for place, size, length in places
        )

    def span(self, chunk: int) -> range:
        """Tell the numbers of the points of a chunk; no other chunk has one between them."""
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
