"""The store of a study on disk: a Zarr group with its events in Parquet files.

``PATH/zarr.json`` holds what the study is, ``PATH/NAME`` one array per parameter and result, with
one file per chunk of points, ``PATH/events`` one Parquet file per chunk. The chunk of ``status`` is
written last: what it calls done is there.
"""

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
from zivi.study.block import Block
from zivi.study.design import Design
from zivi.study.form import EVENTS, GROUP, KINDS, difference
from zivi.study.head import Head, json_text, read_head, read_json, write_json
from zivi.study.lock import locked
from zivi.study.parquet import DamagedError, parted, read_events, write_events
from zivi.study.replacement import written
from zivi.study.store import Labels
from zivi.study.work import Schema

__all__ = ["FolderStore", "create"]


def create(path: Path, design: Design, identity: dict[str, Any], labels: Labels) -> bool:
    """Make an empty store, as a whole or not at all; tell whether it is ours.

    It is not if another run has made one at the same time.
    """
    zarr = needed("zarr", "studies in a folder")
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    kinds = {name: KINDS[column.dtype.kind] for name, column in design.values.items()}
    head = Head.new(identity, labels, kinds)
    try:
        write_json(draft / EVENTS / "zarr.json", GROUP)
        for name, document in head.documents().items():
            write_json(draft / name / "zarr.json", document)
        head.write(draft)
        group = zarr.open_group(draft, mode="r+", zarr_format=3, use_consolidated=True)
        for name, column in design.values.items():
            group[name][:] = column
        os.replace(draft, path)
    except BaseException as error:
        shutil.rmtree(draft, ignore_errors=True)
        if isinstance(error, OSError) and path.is_dir() and any(path.iterdir()):
            return False
        raise
    return True


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
        self.head = read_head(path)
        self._lock = locked(path / EVENTS / "zarr.json") if write else None
        try:
            # read again: the last to write may have added to it
            self.head = read_head(path)
            self._group = zarr.open_group(
                path, mode="r+" if write else "r", zarr_format=3, use_consolidated=True
            )
        except BaseException:
            self.close()
            raise
        self.layout = self.head.layout
        self._arrays: dict[str, Any] = {}
        self._messages: set[int] = set()

    @property
    def identity(self) -> dict[str, Any]:
        """What tells the study."""
        return self.head.identity

    @property
    def labels(self) -> Labels:
        """Units and names of dimensions."""
        return self.head.labels

    @property
    def schema(self) -> Schema | None:
        """What the points give, once that is known."""
        return self.head.schema

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

    def parameters(self) -> tuple[dict[str, NDArray[Any]], list[str]]:
        """Read the values of the parameters that can be read, and tell why others cannot."""
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
        file = self.path / name / "c" / "0"
        if not file.is_file():
            raise DamagedError(f"{file} is missing")
        try:
            column = self._array(name)[:]
        except Exception as error:  # whatever the codec raises
            raise _damaged(file, error) from error
        return np.array(column.tolist()) if column.dtype.kind in "OT" else np.asarray(column)

    def mend(self, design: Design) -> None:
        """Write again what is known and cannot be read: points, metadata of arrays."""
        for file, document in self._altered():
            if file.parent.name == EVENTS:  # in place: this file is the lock
                file.write_text(json_text(document), encoding="utf-8")
            else:
                written(self.path, file, functools.partial(write_json, file, document))
        for name, column in design.values.items():
            try:
                there = self._column(name)
            except DamagedError:
                there = None
            # by their bytes: NaN is not equal to itself
            if there is None or there.tobytes() != column.tobytes():
                put = functools.partial(self._array(name).__setitem__, slice(None), column)
                written(self.path, self.path / name / "c" / "0", put)

    def altered(self) -> list[str]:
        """List metadata that are not as the head says."""
        return [f"{file} is missing or altered" for file, _ in self._altered()]

    def _altered(self) -> Iterator[tuple[Path, Any]]:
        """Find metadata that are not as the head says, and tell what they should be."""
        for name, document in (self.head.documents() | {EVENTS: GROUP}).items():
            file = self.path / name / "zarr.json"
            try:
                wrong = difference(read_json(file), document)
            except (OSError, ValueError):
                wrong = "file"
            if wrong:
                yield file, document

    # reading

    def status(self) -> NDArray[np.int8]:
        """Give the states of all points; those that cannot be read are missing."""
        found = np.zeros(math.prod(self.layout.shape), np.int8)
        for chunk in self.written():
            span = self.layout.span(chunk)
            found[span.start : span.stop] = self._status(chunk)
        return found

    def written(self) -> list[int]:
        """List the chunks that have states: what is there counts, not what could be."""
        places: list[tuple[tuple[int, ...], Path]] = [((), self.path / "status" / "c")]
        for length in self.layout.per_dimension:
            places = [
                ((*place, number), folder / str(number))
                for place, folder in places
                for number in _numbers(folder)
                if number < length
            ]
        return sorted(self.layout.number(place) for place, _ in places)

    def _status(self, chunk: int) -> NDArray[np.int8]:
        try:
            return np.asarray(self._array("status")[self.layout.slices(chunk)], np.int8).ravel()
        except Exception:
            return np.full(len(self.layout.span(chunk)), StudyStatus.MISSING, np.int8)

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
        if not np.isin(block.status, tuple(StudyStatus)).all():
            raise DamagedError(f"{self._file('status', chunk)} has states that there are not")
        if np.any(block.status == StudyStatus.COMPLETED) and self.schema is None:
            raise DamagedError(f"chunk {chunk} is done, but what it holds is not known")
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
        known = parted(read_events(self._events(chunk)))
        block.events = {
            it: rows
            for it, rows in known.items()
            if it in block.span and done[it - block.span.start]
        }
        if not np.array_equal(block.counts(), expected):
            raise DamagedError(f"{self._events(chunk)} has not the events that were counted")

    def events(self, chunk: int, status: NDArray[np.int8]) -> tuple[NDArray[np.int64], Any] | None:
        """Read the events of the points of a chunk that are done, with the points' numbers."""
        block = Block(self.layout.span(chunk), status)
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
        """Call everything missing that cannot be read, so that it is computed again."""
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
            found += [file for file in needed if not file.is_file()]
        return [str(file) for file in found]

    def _has_events(self, chunk: int, status: NDArray[np.int8]) -> bool:
        """Whether a chunk needs a file of events."""
        if self.schema is None or not self.schema.has_events or self._events(chunk).is_file():
            return False
        try:
            return bool(np.any(self._rows("n_events", chunk, ())[status == StudyStatus.COMPLETED]))
        except DamagedError:
            return False

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
        if not file.is_file():
            raise DamagedError(f"{file} is missing")
        try:
            found = self._array(name)[self.layout.slices(chunk)]
        except Exception as error:  # whatever the codec raises
            raise _damaged(file, error) from error
        return np.asarray(found).reshape(len(self.layout.span(chunk)), *shape)

    # writing

    def define(self, schema: Schema) -> None:
        """Make room for what the points give."""
        self.labels.check(schema, self.identity["parameters"])
        if schema.has_events:
            needed("pyarrow.parquet", "events in a folder")
        head = self.head.with_schema(schema)
        for name in head.documents().keys() - self.head.documents().keys():
            write_json(self.path / name / "zarr.json", head.documents()[name])
        # at last and in one piece: a run that is killed before makes room again
        head.write(self.path)
        self.head = head
        self._reopen()
        for number in self.written():
            # all its points failed before this was known
            self.save(number, self.load(number))

    def _reopen(self) -> None:
        import zarr

        self._group = zarr.open_group(self.path, mode="r+", zarr_format=3, use_consolidated=True)
        self._arrays.clear()

    def save(self, chunk: int, block: Block) -> None:
        """Keep a chunk: its states last, so that what they call done is there."""
        slices = self.layout.slices(chunk)
        shape = tuple(piece.stop - piece.start for piece in slices)

        def put(name: str, rows: NDArray[Any]) -> None:
            values = rows.reshape(*shape, *rows.shape[1:])
            write = functools.partial(self._array(name).__setitem__, slices, values)
            written(self.path, self._file(name, chunk), write)

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
                written(self.path, file, write)
                put("n_events", block.counts())
        if block.messages or chunk in self._messages:
            texts = [block.messages.get(point, "") for point in block.span]
            put("message", np.array(texts, object))
            self._messages.add(chunk)
        put("status", block.status)


def _damaged(file: Path, error: Exception) -> DamagedError:
    return DamagedError(f"{file} is damaged: {type(error).__name__}: {error}")


def _numbers(folder: Path) -> list[int]:
    """List the numbers that name what is in a folder."""
    try:
        names = os.listdir(folder)
    except (FileNotFoundError, NotADirectoryError):
        return []
    return [int(name) for name in names if name.isdecimal() and str(int(name)) == name]
