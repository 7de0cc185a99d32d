"""The events of a chunk of points in a Parquet file."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zivi.base.extras import needed

__all__ = ["DamagedError", "read_events", "write_events"]


class DamagedError(Exception):
    """A part of a store that cannot be read; the text says which and why."""


def write_events(file: Path, points: NDArray[np.int64], events: NDArray[np.void]) -> None:
    """Write the events of a chunk; the file is there as a whole or not at all."""
    pyarrow, parquet = needed("pyarrow", "events"), needed("pyarrow.parquet", "events")
    columns = {name: np.ascontiguousarray(events[name]) for name in events.dtype.names or ()}
    draft = file.with_suffix(".partial")
    table = pyarrow.table({"point": points, **columns})
    try:
        parquet.write_table(table, draft, write_page_checksum=True)
        os.replace(draft, file)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


def read_events(file: Path) -> tuple[NDArray[np.int64], NDArray[np.void]]:
    """Read the events of a chunk and their points; `DamagedError` says why it cannot be."""
    pyarrow, parquet = (needed(it, "events in a folder") for it in ("pyarrow", "pyarrow.parquet"))
    try:
        # by memory, since a file that is not closed after an error is a warning
        table = parquet.read_table(
            pyarrow.BufferReader(file.read_bytes()), page_checksum_verification=True
        )
        columns = {name: table[name].to_numpy() for name in table.column_names}
    except Exception as error:
        raise DamagedError(f"{file} is damaged: {type(error).__name__}: {error}") from error
    kinds = {name: column.dtype for name, column in columns.items()}
    if kinds.get("point") != np.int64 or any(kind.kind not in "biuf" for kind in kinds.values()):
        raise DamagedError(f"{file} is damaged: its columns are {kinds}")
    points = columns.pop("point")
    found = np.empty(len(table), [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        found[name] = column
    return points, found
