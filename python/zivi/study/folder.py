"""The store of a study on disk: a Zarr group with its events in Parquet files.

``PATH/zarr.json`` holds what the study is, ``PATH/NAME`` one array per parameter and result, with
one file per chunk of points, ``PATH/events`` one Parquet file per chunk. The chunk of ``status`` is
written last: what it calls done is there.
"""

from __future__ import annotations

import json
import os
import uuid
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zivi._extras import needed
from zivi.study.block import Block
from zivi.study.design import Design
from zivi.study.layout import Layout
from zivi.study.parquet import DamagedError, parted, read_events, write_events
from zivi.study.store import DESCRIPTIONS, Labels, attributes, dims_of
from zivi.study.work import DONE, MISSING, Schema

if TYPE_CHECKING:
    from zivi.study.result import Study

__all__ = ["FolderStore", "create", "read_identity"]

EVENTS = "events"


def create(
    path: Path, design: Design, layout: Layout, identity: Mapping[str, Any], labels: Labels
) -> None:
    """Make an empty store; it is there as a whole or not at all."""
    zarr = needed("zarr", "studies in a folder")
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    kept = {"units": labels.units, "dims": {k: list(v) for k, v in labels.dims.items()}}
    group = zarr.create_group(
        draft,
        attributes={
            **attributes(identity),
            "labels": json.dumps(kept),
            "schema": json.dumps(None),
            "coordinates": " ".join(design.names),
        },
    )
    group.create_group(EVENTS)
    for name, column in design.values.items():
        dims = (name,) if design.kind == "grid" else design.dims
        attrs = {"units": labels.units[name]} if name in labels.units else {}
        kind = str if column.dtype.kind == "U" else column.dtype
        empty = "" if kind is str else np.zeros((), kind)[()]
        array = _array(group, name, column.shape, column.shape, dims, kind, empty, attrs)
        array[:] = column
    for name, dtype, nothing in (("status", np.int8, 0), ("message", str, "")):
        attrs = DESCRIPTIONS[name]
        _array(group, name, design.shape, layout.chunk, design.dims, dtype, nothing, attrs)
    _consolidate(draft)
    os.replace(draft, path)


def _array(
    group: Any,
    name: str,
    shape: tuple[int, ...],
    chunk: tuple[int, ...],
    dims: tuple[str, ...],
    dtype: Any,
    empty: Any,
    attrs: Mapping[str, str],
) -> Any:
    from zarr.codecs import Crc32cCodec, ZstdCodec

    return group.create_array(
        name,
        shape=shape,
        chunks=chunk,
        dtype=dtype,
        fill_value=empty,
        dimension_names=dims,
        attributes=dict(attrs),
        # a file that was cut or altered is noticed
        compressors=[ZstdCodec(level=1), Crc32cCodec()],
        overwrite=True,
    )


def _consolidate(path: Path) -> None:
    import zarr

    with warnings.catch_warnings():
        # that this is not yet in the specification
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(path)


def read_identity(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read what a store is and all attributes; an OSError or ValueError says why it cannot be."""
    file = path / "zarr.json"
    if not path.exists():
        raise FileNotFoundError(f"there is no study at {path}")
    if not file.is_file():
        raise ValueError(f"{path} is not a study: it has no zarr.json")
    try:
        attrs = json.loads(file.read_bytes())["attributes"]
    except (ValueError, KeyError, TypeError) as error:
        raise OSError(
            f"{file} is damaged ({type(error).__name__}: {error}); the arrays of the study may "
            f"still be readable one by one, zarr.open_array('{path}/status')"
        ) from None
    try:
        return json.loads(attrs["config"]), attrs
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"{path} is a Zarr group, but not a study of zivi") from None


class FolderStore:
    """Keeps the results of a study in a folder.

    Parameters
    ----------
    path : Path
        The folder, which `create` made.
    write : bool
        Whether to write: then nobody else may.
    """

    def __init__(self, path: Path, *, write: bool) -> None:
        zarr = needed("zarr", "studies in a folder")
        self.path = path
        self.identity, attrs = read_identity(path)
        labels = json.loads(attrs["labels"])
        dims = {name: tuple(names) for name, names in labels["dims"].items()}
        self.labels = Labels(labels["units"], dims)
        self.layout = Layout(tuple(self.identity["shape"]), self.identity["chunk"])
        self._lock = _locked(path / EVENTS / "zarr.json") if write else None
        self._group = zarr.open_group(path, mode="r+" if write else "r")
        # read again: the last to write may have added to it
        self.schema = _schema(json.loads(read_identity(path)[1]["schema"]))
        self._arrays: dict[str, Any] = {}
        self._messages: set[int] = set()

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        names = tuple(self.identity["parameters"])
        return names if self.identity["kind"] == "grid" else ("point",)

    @property
    def results(self) -> list[str]:
        """Names of the arrays with results."""
        if self.schema is None:
            return []
        return [*self.schema.shapes, *(["n_events"] if self.schema.has_events else [])]

    def close(self) -> None:
        """Let others write."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def study(self) -> Study:
        """Give what is there so far."""
        from zivi.study.result import open_study

        return open_study(self.path)

    def design(self) -> Design:
        """Read the points back."""
        columns = {name: self._array(name)[:] for name in self.identity["parameters"]}
        kept = {
            name: column.astype(str) if column.dtype.kind in "OT" else column
            for name, column in columns.items()
        }
        return Design(self.identity["kind"], kept)

    # reading

    def status(self) -> NDArray[np.int8]:
        """Give the states of all points; those that cannot be read are missing."""
        try:
            return np.asarray(self._array("status")[...], np.int8).ravel()
        except Exception:  # one of its files is damaged: whatever the codec raises
            return np.concatenate([self._status(chunk) for chunk in range(len(self.layout))])

    def _status(self, chunk: int) -> NDArray[np.int8]:
        try:
            return np.asarray(self._array("status")[self.layout.slices(chunk)], np.int8).ravel()
        except Exception:
            return np.full(len(self.layout.span(chunk)), MISSING, np.int8)

    def load(self, chunk: int) -> Block:
        """Give what is there of a chunk, nothing if something of it cannot be read."""
        try:
            return self.read(chunk)
        except DamagedError:
            self._messages.add(chunk)
            return Block.empty(self.layout.span(chunk))

    def read(self, chunk: int) -> Block:
        """Read a chunk; `DamagedError` says what of it cannot be read."""
        block = Block.empty(self.layout.span(chunk))
        if not self._file("status", chunk).exists():
            return block
        block.status = self._rows("status", chunk, ())
        if np.any(block.status == DONE) and self.schema is None:
            raise DamagedError(f"chunk {chunk} is done, but what it holds is not known")
        if self.schema is not None and np.any(block.status == DONE):
            for name, shape in self.schema.shapes.items():
                block.values[name] = self._rows(name, chunk, shape)
            if self.schema.has_events:
                self._read_events(chunk, block)
        if self._file("message", chunk).exists():
            self._messages.add(chunk)
            texts = self._rows("message", chunk, ())
            places = zip(block.span, texts.tolist(), strict=True)
            block.messages = {point: text for point, text in places if text}
        return block

    def _read_events(self, chunk: int, block: Block) -> None:
        # what a killed run wrote of further points does not count
        done = block.status == DONE
        expected = np.where(done, self._rows("n_events", chunk, ()), 0)
        if not expected.any():
            return
        known = parted(read_events(self._events(chunk)))
        block.events = {it: rows for it, rows in known.items() if done[it - block.span.start]}
        if not np.array_equal(block.counts(), expected):
            raise DamagedError(f"{self._events(chunk)} has not the events that were counted")

    def damage(self) -> Iterator[tuple[int, str]]:
        """Read everything and tell the chunks of which something cannot be read, and why."""
        for chunk in range(len(self.layout)):
            try:
                self.read(chunk)
            except DamagedError as error:
                yield chunk, str(error)

    def forget_damaged(self) -> None:
        """Call everything missing that cannot be read, so that it is computed again."""
        for chunk, _ in list(self.damage()):
            self.save(chunk, Block.empty(self.layout.span(chunk)))

    def lost_files(self) -> list[str]:
        """List the files that should be there and are not."""
        status = self.status()
        found = []
        for chunk in range(len(self.layout)):
            span = self.layout.span(chunk)
            if np.any(status[span.start : span.stop] == DONE):
                files = [self._file(name, chunk) for name in self.results]
                found += [str(file) for file in files if not file.exists()]
            elif self._file("status", chunk).exists() and not status[span.start : span.stop].any():
                found += self._unreadable_status(chunk)
        return found

    def _unreadable_status(self, chunk: int) -> list[str]:
        try:
            self._rows("status", chunk, ())
        except DamagedError:
            return [str(self._file("status", chunk))]
        return []

    def _array(self, name: str) -> Any:
        if name not in self._arrays:
            # a chunk without a file is one that was not written
            self._arrays[name] = self._group[name].with_config({"write_empty_chunks": True})
        return self._arrays[name]

    def _file(self, name: str, chunk: int) -> Path:
        inner = len(self.schema.shapes.get(name, ())) if self.schema else 0
        places = (*self.layout.coordinates(chunk), *(0 for _ in range(inner)))
        return self.path.joinpath(name, "c", *map(str, places))

    def _events(self, chunk: int) -> Path:
        return self.path / EVENTS / f"{chunk:08d}.parquet"

    def _rows(self, name: str, chunk: int, shape: tuple[int, ...]) -> NDArray[Any]:
        file = self._file(name, chunk)
        if not file.exists():
            raise DamagedError(f"{file} is missing")
        try:
            found = self._array(name)[self.layout.slices(chunk)]
        except Exception as error:  # whatever the codec raises
            raise DamagedError(f"{file} is damaged: {type(error).__name__}: {error}") from error
        return np.asarray(found).reshape(len(self.layout.span(chunk)), *shape)

    # writing

    def define(self, schema: Schema) -> None:
        """Make room for what the points give."""
        self.labels.check(schema)
        units = {**schema.units, **self.labels.units}
        shape, chunk = self.layout.shape, self.layout.chunk
        for name, inner in schema.shapes.items():
            attrs = {"units": units[name]} if name in units else {}
            dims = dims_of(name, inner, self.dims, self.labels)
            whole = (*shape, *inner), (*chunk, *(max(1, length) for length in inner))
            _array(self._group, name, *whole, dims, np.float64, np.nan, attrs)
        if schema.has_events:
            needed("pyarrow.parquet", "events in a folder")
            attrs = DESCRIPTIONS["n_events"]
            _array(self._group, "n_events", shape, chunk, self.dims, np.int64, 0, attrs)
        kept = {"shapes": schema.shapes, "has_events": schema.has_events, "units": schema.units}
        self._group.update_attributes({"schema": json.dumps(kept)})
        _consolidate(self.path)
        self.schema = schema
        self._reopen()
        for number in range(len(self.layout)):
            # all its points failed before this was known
            if self._file("status", number).exists():
                self.save(number, self.load(number))

    def _reopen(self) -> None:
        import zarr

        self._group = zarr.open_group(self.path, mode="r+")
        self._arrays.clear()

    def save(self, chunk: int, block: Block) -> None:
        """Keep a chunk: its states last, so that what they call done is there."""
        slices = self.layout.slices(chunk)
        shape = tuple(piece.stop - piece.start for piece in slices)

        def put(name: str, rows: NDArray[Any]) -> None:
            self._array(name)[slices] = rows.reshape(*shape, *rows.shape[1:])

        if self.schema is not None:
            block.shaped(self.schema)
            for name in self.schema.shapes:
                put(name, block.values[name])
            if self.schema.has_events:
                table = block.table()
                if table is not None:
                    write_events(self._events(chunk), *table)
                else:
                    self._events(chunk).unlink(missing_ok=True)
                put("n_events", block.counts())
        if block.messages or chunk in self._messages:
            texts = [block.messages.get(point, "") for point in block.span]
            put("message", np.array(texts, object))
            self._messages.add(chunk)
        put("status", block.status)


def _schema(kept: Any) -> Schema | None:
    if kept is None:
        return None
    shapes = {name: tuple(shape) for name, shape in kept["shapes"].items()}
    return Schema(shapes, kept["has_events"], kept["units"])


def _locked(file: Path) -> int | None:
    """Keep others from writing, also after this process is killed, where the system can."""
    try:
        import fcntl
    except ImportError:
        return None
    descriptor = os.open(file, os.O_RDWR)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise RuntimeError(f"another run writes to {file.parent.parent} at this moment") from None
    except OSError:  # a file system without locks
        os.close(descriptor)
        return None
    return descriptor
