"""What Zarr makes of the values of a file, in memory.

Zarr reads a shard before it changes a part of it, and cannot if it is damaged. Here whole files are
made anew, so that their bytes depend on nothing but the values.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from zivi.base.extras import needed

__all__ = ["Encoder"]


class Encoder:
    """Encodes values as an array of a store keeps them.

    Parameters
    ----------
    documents : dict
        The metadata of all arrays by their names.
    """

    def __init__(self, documents: Mapping[str, Any]) -> None:
        self._documents = documents
        self._files: dict[str, Any] = {}
        self._arrays: dict[str, Any] = {}

    def encoded(self, name: str, where: Any, values: Any) -> list[tuple[str, bytes]]:
        """Give the files of some places of an array: their paths in the store, and their bytes."""
        self._array(name)[where] = values
        keys = [key for key in self._files if not key.endswith("zarr.json")]
        return [(key, self._files.pop(key).to_bytes()) for key in keys]

    def _array(self, name: str) -> Any:
        if name not in self._arrays:
            zarr = needed("zarr", "studies in a folder")
            buffer = needed("zarr.core.buffer.cpu", "studies in a folder").Buffer
            text = json.dumps(self._documents[name]).encode()
            self._files[f"{name}/zarr.json"] = buffer.from_bytes(text)
            store = zarr.storage.MemoryStore(self._files)
            array = zarr.open_array(store, path=name, mode="r+", zarr_format=3)
            # a chunk without a file is one that was not written
            self._arrays[name] = array.with_config({"write_empty_chunks": True})
        return self._arrays[name]
