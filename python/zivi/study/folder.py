"""The store of a study on disk: a Zarr group with its metadata and events."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import json
import math
import os
import shutil
import uuid
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.extras import needed
from zivi.base.status import StudyStatus
from zivi.study.design import MOST_POINTS, Design, valid_name
from zivi.study.digest import canonical_json
from zivi.study.drive import MAX_SEED
from zivi.study.outcome import EventTable, Schema
from zivi.study.store import (
    DESCRIPTIONS,
    INNER,
    SHARD,
    Block,
    Chunks,
    Labels,
    dataset_attributes,
    dims_of,
)

# Encode and decode the files of the arrays of a store (Zarr v3 codecs).


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


# Files of a store, written atomically, even if another file type occupies their place.


def write_below(top: Path, file: Path, write: Callable[[], None]) -> None:
    """Write a file below a folder; what is in its place and no file is moved aside, not removed."""
    for it in file.parents:
        if it != top and it.is_relative_to(top):
            no_link(it)
    try:
        write()
    except OSError:
        if not _made_room(top, file):
            raise
        write()


def no_link(place: Path) -> None:
    """Raise an OSError for a symbolic link: its target does not belong to the study."""
    if place.is_symlink():
        raise OSError(
            f"{place} is a symbolic link, which zivi neither reads nor writes through; put what it "
            "points to in its place"
        )


def write_bytes(top: Path, file: Path, data: bytes) -> None:
    """Write a file below a folder, whatever is in its place."""
    write_below(top, file, functools.partial(write_whole, file, data))


def write_whole(file: Path, data: bytes) -> None:
    """Write a file and its folders; it is there as a whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draft = file.with_name(f"{file.name}.partial")
    try:
        draft.write_bytes(data)
        os.replace(draft, file)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
        raise


def _made_room(top: Path, file: Path) -> bool:
    """Move aside what is a folder where a file should be, or the other way round."""
    folders = [it for it in reversed(file.parents) if it.is_relative_to(top) and it != top]
    wrong = [it for it in folders if it.exists() and not it.is_dir()]
    wrong += [file] if file.is_dir() else []
    for it in wrong[:1]:
        it.rename(it.with_name(f".{it.name}.{uuid.uuid4().hex[:8]}"))
    return bool(wrong)


# Format of the arrays of a store; other formats are not read.
#
# A store may come from anywhere, and its metadata name the codecs that decode it. Only arrays of
# the third format of Zarr with the codecs, kinds and shapes that zivi itself would write are
# accepted.

EVENTS = "events"
GROUP: dict[str, Any] = {"attributes": {}, "zarr_format": 3, "node_type": "group"}
"""The metadata of the folder of events."""
KINDS = {"f": "float64", "i": "int64", "b": "bool", "U": "string"}
"""How the values of a parameter are kept, by the kind of their array."""
NOTHING = {"float64": 0.0, "int64": 0, "int8": 0, "bool": False, "string": ""}
LITTLE = {"name": "bytes", "configuration": {"endian": "little"}}
CHECKSUM = {"name": "crc32c"}
BYTES = {
    "float64": LITTLE,
    "int64": LITTLE,
    "int8": {"name": "bytes"},
    "bool": {"name": "bytes"},
    "string": {"name": "vlen-utf8", "configuration": {}},
}


def documents(
    kind: str, parameters: Mapping[str, str], layout: Chunks, labels: Labels, schema: Schema | None
) -> dict[str, Any]:
    """Return the metadata of all arrays of a store by name.

    Parameters
    ----------
    kind : str
        Kind of the design.
    parameters : dict of str
        How the values of each parameter are kept, one of `KINDS`.
    layout : Layout
        The chunks of points.
    labels : Labels
        Units and names of dimensions.
    schema : Schema or None
        What the points give, if that is known.
    """
    names = tuple(parameters)
    is_grid = kind == "grid"
    design = names if is_grid else ("point",)
    lengths = layout.shape if is_grid else layout.shape * len(names)
    places = Places(layout.shape, layout.chunk, layout.inner if layout.has_shards else None)
    units = {**(schema.units if schema else {}), **labels.units}

    def unit(name: str) -> dict[str, str]:
        return {"units": units[name]} if name in units else {}

    found = {
        name: _document(kept, _column_places(n, layout), (name,) if is_grid else design, unit(name))
        for (name, kept), n in zip(parameters.items(), lengths, strict=True)
    }
    over_points = {"status": "int8", "message": "string"}
    if schema is not None and schema.has_events:
        over_points["n_events"] = "int64"
    for name, kept in over_points.items():
        found[name] = _document(kept, places, design, DESCRIPTIONS[name])
    for name, inner in (schema.shapes if schema else {}).items():
        dims = dims_of(name, inner, design, labels)
        found[name] = _document("float64", places.of(inner), dims, unit(name), "NaN")
    return {name: found[name] for name in sorted(found)}


@dataclasses.dataclass(frozen=True)
class Places:
    """Shapes of an array, of its files, and of the inner chunks of a sharded file."""

    shape: tuple[int, ...]
    file: tuple[int, ...]
    part: tuple[int, ...] | None = None

    def of(self, inner: tuple[int, ...]) -> Places:
        """Return the layout of an array with more dimensions, which are not split."""
        more = tuple(max(1, length) for length in inner)
        part = None if self.part is None else (*self.part, *more)
        return Places((*self.shape, *inner), (*self.file, *more), part)


def _column_places(n: int, layout: Chunks) -> Places:
    """Return the layout of a parameter: one file, unless it is too large for a codec."""
    if layout.has_shards and n > SHARD:
        return Places((n,), (SHARD,), (SHARD // INNER,))
    return Places((n,), (n,))


def _document(
    kept: str,
    places: Places,
    dims: tuple[str, ...],
    attributes: Mapping[str, str],
    nothing: Any = None,
) -> dict[str, Any]:
    codecs = [
        BYTES[kept],
        {"name": "zstd", "configuration": {"level": 1, "checksum": False}},
        # a file that was cut or altered is noticed
        CHECKSUM,
    ]
    if places.part is not None:
        setting = {
            "chunk_shape": list(places.part),
            "codecs": codecs,
            "index_codecs": [LITTLE, CHECKSUM],
            "index_location": "end",
        }
        codecs = [{"name": SHARDS, "configuration": setting}]
    return {
        "shape": list(places.shape),
        "data_type": kept,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": list(places.file)}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": NOTHING[kept] if nothing is None else nothing,
        "codecs": codecs,
        "attributes": dict(attributes),
        "dimension_names": list(dims),
        "zarr_format": 3,
        "node_type": "array",
        "storage_transformers": [],
    }


def metadata_difference(found: Any, wanted: Mapping[str, Any]) -> str | None:
    """Return the difference between an array's metadata and zivi's format; None without one."""
    if not isinstance(found, dict):
        return "metadata"
    for key in map(str, (*wanted, *found)):
        if key not in wanted:
            return key
        # another version of Zarr may leave this out
        there = found.get(key, [] if key == "storage_transformers" else None)
        here = wanted[key]
        if key == "codecs":
            there, here = _plain_codecs(there), _plain_codecs(here)
        if canonical_json(there) != canonical_json(here):
            return key
    return None


def _plain_codecs(given: Any) -> Any:
    """Remove codec fields that differ between Zarr versions and do not affect decoding."""
    if not isinstance(given, list) or not all(isinstance(it, dict) for it in given):
        return given
    found = []
    for codec in given:
        more = {key: it for key, it in codec.items() if key not in ("name", "configuration")}
        setting = codec.get("configuration", {})
        if codec.get("name") == "zstd" and isinstance(setting, dict):
            setting = {key: it for key, it in setting.items() if key not in ("level", "checksum")}
        if codec.get("name") == SHARDS and isinstance(setting, dict):
            inner = ("codecs", "index_codecs")
            setting = setting | {key: _plain_codecs(setting.get(key)) for key in inner}
        found.append({"name": codec.get("name"), "setting": setting, **more})
    return found


# The head of a store, ``PATH/zarr.json``: identity of the study and metadata of its arrays.
#
# It is written as a whole or not at all, and read with suspicion: what zivi would not have written
# is refused before any array is decoded.

FILE = "zarr.json"


@dataclasses.dataclass(frozen=True)
class Head:
    """Metadata of a store.

    Parameters
    ----------
    identity : dict
        What tells the study.
    labels : Labels
        Units and names of dimensions.
    schema : Schema or None
        What the points give, once that is known.
    parameters : dict of str
        How the values of each parameter are kept.
    attributes : dict
        All attributes, as they are written.
    """

    identity: dict[str, Any]
    labels: Labels
    schema: Schema | None
    parameters: dict[str, str]
    attributes: dict[str, Any]

    @classmethod
    def new(cls, identity: dict[str, Any], labels: Labels, parameters: dict[str, str]) -> Head:
        """Make the head of a store without results."""
        kept = {"units": labels.units, "dims": {k: list(v) for k, v in labels.dims.items()}}
        given = {
            **dataset_attributes(identity),
            "labels": json.dumps(kept),
            "schema": json.dumps(None),
            "coordinates": " ".join(parameters),
        }
        return cls(identity, labels, None, parameters, given)

    def with_schema(self, schema: Schema) -> Head:
        """Return the head of the same store with arrays for results."""
        kept = {"shapes": schema.shapes, "has_events": schema.has_events, "units": schema.units}
        given = {**self.attributes, "schema": json.dumps(kept)}
        return dataclasses.replace(self, schema=schema, attributes=given)

    @property
    def layout(self) -> Chunks:
        """The chunks of points."""
        told, size = self.identity, 0 if self.schema is None else self.schema.size
        return Chunks(tuple(told["shape"]), told["chunk"], told.get("shards", False), size)

    def documents(self) -> dict[str, Any]:
        """Return the metadata of all arrays."""
        kind = self.identity["kind"]
        return documents(kind, self.parameters, self.layout, self.labels, self.schema)

    def write(self, path: Path) -> None:
        """Write the head; it is there as a whole or not at all."""
        nodes = self.documents() | {EVENTS: _consolidated(GROUP, {})}
        ordered = {name: nodes[name] for name in sorted(nodes)}
        write_json(path / FILE, _consolidated(GROUP | {"attributes": self.attributes}, ordered))


def _consolidated(group: Mapping[str, Any], nodes: Mapping[str, Any]) -> dict[str, Any]:
    inner = {"kind": "inline", "must_understand": False, "metadata": dict(nodes)}
    return {
        "attributes": group["attributes"],
        "zarr_format": 3,
        "consolidated_metadata": inner,
        "node_type": "group",
    }


def json_text(document: Any) -> str:
    """Write metadata as Zarr does."""
    return json.dumps(document, indent=2)


def write_json(file: Path, document: Any) -> None:
    """Write metadata; they are there as a whole or not at all."""
    write_whole(file, json_text(document).encode())


def read_json(file: Path) -> Any:
    """Read metadata; raise a ValueError with the reason if that fails."""
    try:
        return json.loads(file.read_bytes())
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def read_head(path: Path) -> Head:
    """Read and check the head of a store.

    Raises
    ------
    FileNotFoundError
        If there is nothing.
    ValueError
        If it is no study.
    OSError
        If it is damaged, or holds arrays that zivi does not write.
    """
    file = path / FILE
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist: expected the folder of a study")
    if not file.is_file():
        raise ValueError(f"{path} is not a study: {FILE} is missing")
    try:
        raw = read_json(file)
        attrs = raw["attributes"]
    except (ValueError, KeyError, TypeError) as error:
        raise OSError(
            f"{file} is damaged ({type(error).__name__}: {error}); the arrays of the study may "
            f"still be readable one by one, zarr.open_array('{path}/status')"
        ) from None
    try:
        identity = json.loads(attrs["config"])
        _ = identity["function"]
    except (ValueError, KeyError, TypeError, RecursionError):
        raise ValueError(f"{path} is a Zarr group, but not a study of zivi") from None
    try:
        return _valid_head(raw, identity, attrs)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        said = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise OSError(
            f"{file} is damaged, or partly written by another program: {said}; its arrays were not "
            "decoded"
        ) from None


def _valid_head(raw: Mapping[str, Any], identity: dict[str, Any], attrs: dict[str, Any]) -> Head:
    for key in _wrong(identity):
        raise ValueError(f"{key} is {identity.get(key)!r:.80} in its config")
    names = identity["parameters"]
    if attrs.get("coordinates") != " ".join(names):
        raise ValueError(f"its coordinates are {attrs.get('coordinates')!r:.80}")
    nodes = dict(raw["consolidated_metadata"]["metadata"])
    if raw != _consolidated(GROUP | {"attributes": attrs}, nodes):
        raise ValueError("it is not a Zarr v3 group with consolidated metadata")
    events = nodes.pop(EVENTS)
    if events not in (GROUP, _consolidated(GROUP, {})):
        raise ValueError(f"{EVENTS} is {events!r:.80}")
    labels = _read_labels(json.loads(attrs["labels"]))
    schema = _schema(json.loads(attrs["schema"]))
    if schema is not None:
        labels.check(schema, names)
        if not set(nodes) & set(schema.shapes):
            # version 0.1.0 was killed while it made room for results: there are none yet
            schema = None
    kinds = {name: nodes[name]["data_type"] for name in names}
    if unknown := {name: kept for name, kept in kinds.items() if kept not in KINDS.values()}:
        raise ValueError(f"parameters are kept as {unknown!r:.80}")
    head = Head(identity, labels, schema, kinds, attrs)
    wanted = head.documents()
    if set(wanted) != set(nodes):
        different = sorted(set(wanted) ^ set(nodes))
        raise ValueError(f"these arrays are missing or unknown: {', '.join(different)}")
    for name, document in wanted.items():
        if wrong := metadata_difference(nodes[name], document):
            there = nodes[name].get(wrong) if isinstance(nodes[name], dict) else nodes[name]
            raise ValueError(f"the {wrong} of the array {name!r} is {there!r:.120}")
    return head


def _wrong(config: dict[str, Any]) -> Iterator[str]:
    """Yield the invalid entries of a study's identity."""
    for key in ("function", "values", "zivi"):
        if not isinstance(config.get(key), str):
            yield key
    kind, shape = config.get("kind"), config.get("shape")
    names: Any = config.get("parameters")
    if kind not in ("grid", "list", "sample"):
        yield "kind"
    if not _are_names(names):
        yield "parameters"
    elif (
        not _are_whole(shape, 1)
        or len(shape or ()) != (len(names) if kind == "grid" else 1)
        or math.prod(shape or ()) > MOST_POINTS
    ):
        yield "shape"
    if not isinstance(config.get("shards", False), bool):
        yield "shards"
    chunk, seed = config.get("chunk"), config.get("seed")
    if not (chunk is None or _are_whole([chunk], 1)):
        yield "chunk"
    if not (seed is None or (_are_whole([seed], 0) and seed <= MAX_SEED)):
        yield "seed"


def _are_names(given: Any) -> bool:
    if not isinstance(given, list) or not given:
        return False
    try:
        return len({valid_name("parameter", name) for name in given}) == len(given)
    except (TypeError, ValueError):
        return False


def _are_whole(given: Any, least: int) -> bool:
    return isinstance(given, list) and all(type(it) is int and it >= least for it in given)


def _read_labels(kept: Any) -> Labels:
    dims = {name: tuple(names) for name, names in kept["dims"].items()}
    return Labels(kept["units"], dims)


def _schema(kept: Any) -> Schema | None:
    if kept is None:
        return None
    for name, shape in kept["shapes"].items():
        valid_name("result", name)
        if not _are_whole(shape, 0):
            raise ValueError(f"the shape of {name!r} is {shape!r:.80}")
    if not isinstance(kept["has_events"], bool):
        raise ValueError(f"has_events is {kept['has_events']!r:.80}")
    shapes = {name: tuple(shape) for name, shape in kept["shapes"].items()}
    return Schema(shapes, kept["has_events"], dict(kept["units"]))


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
