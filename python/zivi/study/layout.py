"""How the points of a study are cut into chunks, the files of its store."""

import dataclasses
import math

__all__ = ["Layout"]

CHUNKS, LARGEST = 64, 1024
"""Chunks that a study should have, and points that a chunk has at most, by default."""


@dataclasses.dataclass(frozen=True)
class Layout:
    """Chunks of consecutive points, counted in the order of C.

    Parameters
    ----------
    shape : tuple of int
        Points along each dimension.
    points : int or None
        Points of a chunk at most; by default a 64th of all, at most 1024.
    """

    shape: tuple[int, ...]
    points: int | None = None

    @property
    def chunk(self) -> tuple[int, ...]:
        """Points of a chunk along each dimension: ``(1, ..., 1, some, all, ..., all)``."""
        room = self.points or min(LARGEST, math.ceil(math.prod(self.shape) / CHUNKS))
        sizes: list[int] = []
        for length in reversed(self.shape):
            sizes.append(min(length, room))
            room = room // length if room >= length else 1
        return tuple(max(1, size) for size in reversed(sizes))

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
