"""Encode and decode the files of the arrays of a store (Zarr v3 codecs)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.extras import needed

SHARDS = "sharding_indexed"
DTYPES = {"float64": "<f8", "int64": "<i8", "int8": "i1", "bool": "?", "string": "O"}
NO_PART = 2**64 - 1
"""Offset and length of an inner chunk that is not stored."""


class FileCodec:
    """Encode and decode one file of an array, as the codecs of its metadata say.

    Zarr passes every read and write to a thread of its own, which costs a millisecond for each
    small file. The arrays of a store have one chain of codecs: bytes or vlen-utf8, zstd, crc32c;
    in a shard, this chain for each inner chunk. A file is always encoded as a whole, so that its
    bytes depend on the values alone.

    Parameters
    ----------
    document : dict
        The metadata of the array, as `head.documents` writes them.

    References
    ----------
    Zarr core specification, version 3; codec *sharding_indexed*, version 1.0.
    """

    def __init__(self, document: Mapping[str, Any]) -> None:
        numcodecs = needed("numcodecs", "studies in a folder")
        self.file: tuple[int, ...] = tuple(document["chunk_grid"]["configuration"]["chunk_shape"])
        """Shape of the values of a file."""
        last = document["codecs"][-1]
        self._sharded = last["name"] == SHARDS
        self._part = tuple(last["configuration"]["chunk_shape"]) if self._sharded else self.file
        self._dtype = np.dtype(DTYPES[document["data_type"]])
        fill = document["fill_value"]
        self._fill = math.nan if fill == "NaN" else fill
        self._zstd = numcodecs.Zstd(level=1)
        self._checksum = numcodecs.checksum32.CRC32C(location="end")
        self._texts = numcodecs.VLenUTF8()

    def encode(self, values: NDArray[Any]) -> bytes:
        """Return the bytes of a file; the file is filled up if `values` are fewer.

        Inner chunks without any of the values are not stored.
        """
        whole = values.astype(self._dtype)
        if whole.shape != self.file:
            whole = np.full(self.file, self._fill, self._dtype)
            whole[tuple(map(slice, values.shape))] = values
        if not self._sharded:
            return self._packed(whole)
        index, parts, at = [], [], 0
        for place in self._places():
            if any(it.start >= n for it, n in zip(place, values.shape, strict=True)):
                index.append((NO_PART, NO_PART))
                continue
            parts.append(self._packed(whole[place]))
            index.append((at, len(parts[-1])))
            at += len(parts[-1])
        return b"".join([*parts, bytes(self._checksum.encode(np.array(index, "<u8")))])

    def decode(self, data: bytes) -> NDArray[Any]:
        """Return the values of a file, an array of shape `file`.

        Raises
        ------
        ValueError, RuntimeError
            If `data` are damaged.
        """
        if not self._sharded:
            return self._unpacked(data)
        whole = np.full(self.file, self._fill, self._dtype)
        places = list(self._places())
        end = len(data) - 16 * len(places) - 4
        if end < 0:
            raise ValueError(f"the file must have at least {len(data) - end} bytes")
        index = np.frombuffer(self._checksum.decode(data[end:]), "<u8").reshape(-1, 2)
        for place, (at, length) in zip(places, index.tolist(), strict=True):
            if at != NO_PART:
                whole[place] = self._unpacked(data[at : at + length])
        return whole

    def _places(self) -> Iterator[tuple[slice, ...]]:
        """Yield the slices of the inner chunks of a shard, in C order."""
        pairs = list(zip(self.file, self._part, strict=True))
        for place in np.ndindex(*(whole // part for whole, part in pairs)):
            yield tuple(
                slice(k * part, (k + 1) * part) for k, part in zip(place, self._part, strict=True)
            )

    def _packed(self, values: NDArray[Any]) -> bytes:
        is_text = self._dtype.kind == "O"
        raw = self._texts.encode(values.ravel()) if is_text else values.tobytes()
        return bytes(self._checksum.encode(self._zstd.encode(raw)))

    def _unpacked(self, data: bytes) -> NDArray[Any]:
        raw = self._zstd.decode(self._checksum.decode(data))
        if self._dtype.kind == "O":
            values: NDArray[Any] = self._texts.decode(raw)
        else:
            values = np.frombuffer(raw, self._dtype).copy()  # writable
        return values.reshape(self._part)
