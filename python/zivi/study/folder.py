"""The store of a study on disk: a Zarr group with its events in Parquet files."""

from __future__ import annotations

import functools
import math
import os
import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.extras import needed
from zivi.base.status import StudyStatus
from zivi.study.codec import FileCodec
from zivi.study.design import Design
from zivi.study.head import (
    EVENTS,
    GROUP,
    KINDS,
    Head,
    json_text,
    metadata_difference,
    no_link,
    read_head,
    read_json,
    write_below,
    write_bytes,
    write_json,
)
from zivi.study.outcome import EventTable, Schema
from zivi.study.store import Block, Chunks, Labels

# The lock of a store: one run writes at a time.


def locked(file: Path) -> int | None:
    """Keep others from writing, also after this process is killed, where the system can."""
    try:
        import fcntl
    except ImportError:
        return None
    file.parent.mkdir(exist_ok=True)
    descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # a run that extended the study has just put another file in this place
        if not (file.exists() and os.path.samestat(os.fstat(descriptor), file.stat())):
            raise BlockingIOError
    except BlockingIOError:
        os.close(descriptor)
        raise RuntimeError(f"another run writes to {file.parent.parent} at this moment") from None
    except OSError:  # a file system without locks
        os.close(descriptor)
        return None
    return descriptor


# The events of a chunk of points in a Parquet file.


class DamagedError(Exception):
    """Raised for an unreadable part of a store, with the reason."""


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
    """Read the events of a chunk and their points; raise `DamagedError` if that fails."""
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


# The store of a study on disk: a Zarr group with its events in Parquet files.
#
# ``PATH/zarr.json`` holds the identity of the study, ``PATH/NAME`` one array per parameter and
# result, with one file per chunk of points, ``PATH/events`` one Parquet file per chunk. The chunk
# of ``status`` is written last: what it calls done is there.


class FolderStore:
    """Keeps the results of a study in a folder.

    Parameters
    ----------
    path : Path
        The folder, which `create.create` made.
    write : bool
        Whether to write: then nobody else may.
    """

    def __init__(self, path: Path, *, write: bool) -> None:
        needed("zarr", "studies in a folder")
        self.path = path
        self.head = read_head(path)
        for name in (*self.head.documents(), EVENTS):
            for it in (path / name, path / name / "c", path / name / "zarr.json"):
                no_link(it)
        self._lock = locked(path / EVENTS / "zarr.json") if write else None
        try:
            # read again: the last to write may have added to it
            self.head = read_head(path)
        except BaseException:
            self.close()
            raise
        self._codecs: dict[str, FileCodec] = {}
        self._messages: set[int] = set()

    @property
    def layout(self) -> Chunks:
        """The chunks of points."""
        return self.head.layout

    @property
    def identity(self) -> dict[str, Any]:
        """Identity of the study."""
        return self.head.identity

    @property
    def labels(self) -> Labels:
        """Units and names of dimensions."""
        return self.head.labels

    @property
    def schema(self) -> Schema | None:
        """Schema of the results, once it is known."""
        return self.head.schema

    @property
    def results(self) -> list[str]:
        """Names of the arrays with results."""
        if self.schema is None:
            return []
        return [*self.schema.shapes, *(["n_events"] if self.schema.has_events else [])]

    def close(self) -> None:
        """Release the lock for writing."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def moved_to(self, path: Path) -> None:
        """Continue in the folder's new location."""
        self.path = path
        self._reset()

    def parameters(self) -> tuple[dict[str, NDArray[Any]], list[str]]:
        """Read the readable parameter values, with the reasons for the others."""
        known, lost = {}, []
        for name in self.head.parameters:
            try:
                known[name] = self._column(name)
            except DamagedError as error:
                lost.append(str(error))
        if not lost and Design(self.identity["kind"], known).digest() != self.identity["values"]:
            return {}, [f"the parameters in {self.path} are not those of the study (digest)"]
        return known, lost

    def _column(self, name: str) -> NDArray[Any]:
        n, files = self._column_files(name)
        for file in files:
            if not _is_there(file):
                raise DamagedError(f"{file} is missing or empty")
        try:
            parts = [self._codec(name).decode(file.read_bytes()) for file in files]
        except Exception as error:  # whatever the codec raises
            raise _damaged(files[0] if len(files) == 1 else files[0].parent, error) from error
        column = np.concatenate(parts)[:n]
        return np.array(column.tolist()) if column.dtype.kind == "O" else column

    def _column_files(self, name: str) -> tuple[int, list[Path]]:
        """Return the number of values of a parameter and its files."""
        (n,), (whole,) = self.head.documents()[name]["shape"], self._codec(name).file
        return n, [self.path / name / "c" / str(number) for number in range(math.ceil(n / whole))]

    def mend(self, design: Design) -> None:
        """Rewrite damaged parts whose content is known: points, metadata of arrays."""
        for file, document in self._altered():
            if file.parent.name == EVENTS:  # in place: this file is the lock
                file.write_text(json_text(document), encoding="utf-8")
            else:
                write_below(self.path, file, functools.partial(write_json, file, document))
        for name, column in design.values.items():
            try:
                there = self._column(name)
            except DamagedError:
                there = None
            # by their bytes: NaN is not equal to itself
            if there is None or there.tobytes() != column.tobytes():
                write_column(self.path, name, column, self._codec(name))

    def altered(self) -> list[str]:
        """List metadata that are not as the head says."""
        return [f"{file} is missing or altered" for file, _ in self._altered()]

    def _altered(self) -> Iterator[tuple[Path, Any]]:
        """Yield metadata that differ from the head, with their correct values."""
        for name, document in (self.head.documents() | {EVENTS: GROUP}).items():
            file = self.path / name / "zarr.json"
            try:
                wrong = metadata_difference(read_json(file), document)
            except (OSError, ValueError, RecursionError):
                wrong = "file"
            if wrong:
                yield file, document

    # reading

    def written(self) -> list[int]:
        """List the chunks that have states: what is there counts, not what could be."""
        places: list[tuple[tuple[int, ...], Path]] = [((), self.path / "status" / "c")]
        for length in self.layout.per_dimension:
            places = [
                ((*place, number), folder / str(number))
                for place, folder in places
                for number in _numbered_entries(folder)
                if number < length
            ]
        return sorted(self.layout.number(place) for place, _ in places)

    def status_of(self, chunk: int) -> NDArray[np.int8]:
        """Return the states of the points of a chunk; those that cannot be read are missing."""
        try:
            return self._rows("status", chunk, ())
        except DamagedError:
            return np.full(len(self.layout.span(chunk)), StudyStatus.MISSING, np.int8)

    def load(self, chunk: int) -> Block:
        """Return the stored data of a chunk; empty if a part cannot be read."""
        try:
            return self.read(chunk)
        except DamagedError:
            self._messages.add(chunk)
            return Block.empty(self.layout.span(chunk))

    def read(self, chunk: int) -> Block:
        """Read a chunk; raise `DamagedError` for an unreadable part."""
        block = Block.empty(self.layout.span(chunk))
        if not self._file("status", chunk).exists():
            return block
        block.status = self._rows("status", chunk, ())
        if not np.isin(block.status, tuple(StudyStatus)).all():
            raise DamagedError(f"{self._file('status', chunk)} has unknown states")
        if np.any(block.status == StudyStatus.COMPLETED) and self.schema is None:
            raise DamagedError(
                f"chunk {chunk} is marked complete but its data are missing; run the sweep again "
                "to compute it"
            )
        if self.schema is not None and np.any(block.status == StudyStatus.COMPLETED):
            for name, shape in self.schema.shapes.items():
                block.values[name] = self._rows(name, chunk, shape)
            if self.schema.has_events:
                self._read_events(chunk, block)
        if self._file("message", chunk).is_file() or np.any(block.status == StudyStatus.FAILED):
            self._messages.add(chunk)
            texts = self._rows("message", chunk, ())
            places = zip(block.span, texts.tolist(), strict=True)
            block.messages = {point: text for point, text in places if text}
        return block

    def _read_events(self, chunk: int, block: Block) -> None:
        # what a killed run wrote of further points does not count
        done = block.status == StudyStatus.COMPLETED
        expected = np.where(done, self._rows("n_events", chunk, ()), 0)
        if not expected.any():
            return
        points, rows = read_events(self._events(chunk))
        own = (points >= block.span.start) & (points < block.span.stop)
        own[own] = done[points[own] - block.span.start]
        block.events = [(points[own], rows[own])]
        if not np.array_equal(block.counts(), expected):
            raise DamagedError(f"{self._events(chunk)} lacks some of the counted events")

    def events(self, chunk: int) -> EventTable | None:
        """Read the events of the points of a chunk that are completed."""
        block = Block(self.layout.span(chunk), self.status_of(chunk))
        self._read_events(chunk, block)
        return block.table()

    def damage(self) -> Iterator[tuple[int, str]]:
        """Read everything and tell the chunks of which something cannot be read, and why."""
        for chunk in self.written():
            try:
                self.read(chunk)
            except DamagedError as error:
                yield chunk, str(error)

    def forget_damaged(self) -> None:
        """Mark unreadable points as missing, so that they are computed again."""
        for chunk, _ in list(self.damage()):
            self.save(chunk, Block.empty(self.layout.span(chunk)))

    def lost_files(self) -> list[str]:
        """List the files that should be there and are not."""
        found = []
        for chunk in self.written():
            try:
                status = self._rows("status", chunk, ())
            except DamagedError:
                found.append(self._file("status", chunk))
                continue
            results = self.results if StudyStatus.COMPLETED in status else []
            needed = [self._file(name, chunk) for name in results]
            if StudyStatus.FAILED in status:
                needed.append(self._file("message", chunk))
            if self._has_events(chunk, status):
                needed.append(self._events(chunk))
            found += [file for file in needed if not _is_there(file)]
        return [str(file) for file in found]

    def _has_events(self, chunk: int, status: NDArray[np.int8]) -> bool:
        """Whether a chunk needs a file of events."""
        if self.schema is None or not self.schema.has_events or self._events(chunk).is_file():
            return False
        try:
            return bool(np.any(self._rows("n_events", chunk, ())[status == StudyStatus.COMPLETED]))
        except DamagedError:
            return False

    def _codec(self, name: str) -> FileCodec:
        if name not in self._codecs:
            self._codecs[name] = FileCodec(self.head.documents()[name])
        return self._codecs[name]

    def _file(self, name: str, chunk: int) -> Path:
        inner = len(self.schema.shapes.get(name, ())) if self.schema else 0
        places = (*self.layout.coordinates(chunk), *(0 for _ in range(inner)))
        return self.path.joinpath(name, "c", *map(str, places))

    def _events(self, chunk: int) -> Path:
        return self.path / EVENTS / f"{chunk:08d}.parquet"

    def _rows(self, name: str, chunk: int, shape: tuple[int, ...]) -> NDArray[Any]:
        file = self._file(name, chunk)
        if not _is_there(file):
            raise DamagedError(f"{file} is missing or empty")
        try:
            whole = self._codec(name).decode(file.read_bytes())
        except Exception as error:  # whatever the codec raises
            raise _damaged(file, error) from error
        found = whole[tuple(map(slice, self._lengths(chunk)))]
        return found.reshape(len(self.layout.span(chunk)), *shape)

    def _lengths(self, chunk: int) -> tuple[int, ...]:
        """Return the number of points of a chunk along each dimension."""
        return tuple(piece.stop - piece.start for piece in self.layout.slices(chunk))

    # writing

    def define(self, schema: Schema) -> None:
        """Create the arrays of the results."""
        self.labels.check(schema, self.identity["parameters"])
        if schema.has_events:
            needed("pyarrow.parquet", "events in a folder")
        head = self.head.with_schema(schema)
        # all their points failed before this was known
        before = [self.load(number) for number in self.written()]
        others = head.documents()["status"] != self.head.documents()["status"]
        if others:
            for name in ("status", "message"):  # in other files from now on
                shutil.rmtree(self.path / name / "c", ignore_errors=True)
        known = {} if others else self.head.documents()
        for name in head.documents().keys() - known.keys():
            write_json(self.path / name / "zarr.json", head.documents()[name])
        # at last and in one piece: a run that is killed before makes room again
        head.write(self.path)
        self.head = head
        self._reset()
        for chunk, block in self._moved(before):
            self.save(chunk, block)

    def _moved(self, blocks: list[Block]) -> Iterator[tuple[int, Block]]:
        """Distribute failures to the current chunks."""
        failed = {point: why for block in blocks for point, why in block.messages.items()}
        points = np.array(sorted(failed), np.int64)
        for chunk in np.unique(self.layout.chunk_of(points)).tolist():
            block = Block.empty(self.layout.span(chunk))
            own = points[slice(*np.searchsorted(points, (block.span.start, block.span.stop)))]
            block.status[own - block.span.start] = StudyStatus.FAILED
            block.messages = {point: failed[point] for point in own.tolist()}
            yield chunk, block

    def _reset(self) -> None:
        self._codecs.clear()
        self._messages.clear()

    def save(self, chunk: int, block: Block) -> None:
        """Keep a chunk: its states last, so that what they call done is there."""
        shape = self._lengths(chunk)

        def put(name: str, rows: NDArray[Any]) -> None:
            values = rows.reshape(*shape, *rows.shape[1:])
            write_bytes(self.path, self._file(name, chunk), self._codec(name).encode(values))

        if self.schema is not None:
            block.shaped(self.schema)
            for name in self.schema.shapes:
                put(name, block.values[name])
            if self.schema.has_events:
                table = block.table()
                file = self._events(chunk)
                if table is not None:
                    write = functools.partial(write_events, file, *table)
                else:
                    write = functools.partial(file.unlink, missing_ok=True)
                write_below(self.path, file, write)
                put("n_events", block.counts())
        if block.messages or chunk in self._messages:
            texts = [block.messages.get(point, "") for point in block.span]
            put("message", np.array(texts, object))
            self._messages.add(chunk)
        put("status", block.status)


def _is_there(file: Path) -> bool:
    """Whether a file is there; Zarr treats an empty file as missing."""
    return file.is_file() and file.stat().st_size > 0


def _damaged(file: Path, error: Exception) -> DamagedError:
    return DamagedError(f"{file} is damaged: {type(error).__name__}: {error}")


def _numbered_entries(folder: Path) -> list[int]:
    """List the numbers that name what is in a folder."""
    try:
        names = os.listdir(folder)
    except (FileNotFoundError, NotADirectoryError):
        return []
    return [int(name) for name in names if name.isdecimal() and str(int(name)) == name]


# Makes the folder of a new study.


def create(path: Path, design: Design, identity: dict[str, Any], labels: Labels) -> bool:
    """Create an empty store atomically; return whether this call created it.

    It is not if another run has made one at the same time.
    """
    needed("zarr", "studies in a folder")
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    head = head_of(design, identity, labels)
    try:
        write_empty(draft, head, design)
        os.replace(draft, path)
    except BaseException as error:
        shutil.rmtree(draft, ignore_errors=True)
        if isinstance(error, OSError) and path.is_dir() and any(path.iterdir()):
            return False
        raise
    return True


def head_of(design: Design, identity: dict[str, Any], labels: Labels) -> Head:
    """Make the head of a store without results."""
    kinds = {name: KINDS[column.dtype.kind] for name, column in design.values.items()}
    return Head.new(identity, labels, kinds)


def write_empty(folder: Path, head: Head, design: Design) -> None:
    """Write the head, the metadata of all arrays and the parameters."""
    write_json(folder / EVENTS / "zarr.json", GROUP)
    for name, document in head.documents().items():
        write_json(folder / name / "zarr.json", document)
    head.write(folder)
    for name, column in design.values.items():
        write_column(folder, name, column, FileCodec(head.documents()[name]))


def write_column(folder: Path, name: str, column: NDArray[Any], codec: FileCodec) -> None:
    """Write the values of a parameter."""
    (whole,) = codec.file
    for number in range(math.ceil(len(column) / whole)):
        data = codec.encode(column[number * whole : (number + 1) * whole])
        write_bytes(folder, folder / name / "c" / str(number), data)
