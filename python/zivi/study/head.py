"""Metadata of a store, ``PATH/zarr.json``: identity of the study and its arrays."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import json
import math
import os
import uuid
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from zivi.study.codec import SHARDS
from zivi.study.design import MOST_POINTS, valid_name
from zivi.study.digest import canonical_json
from zivi.study.outcome import Schema
from zivi.study.pools import MAX_SEED
from zivi.study.store import DESCRIPTIONS, INNER, SHARD, Chunks, Labels, dataset_attributes, dims_of

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
