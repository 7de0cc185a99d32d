"""What zivi writes of the arrays of a store, so that nothing else is read.

A store may come from anywhere, and its metadata name the codecs that decode it. Only arrays of the
third format of Zarr with the codecs, kinds and shapes that zivi itself would write are accepted.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

from zivi.study.layout import INNER, SHARD, Layout
from zivi.study.piece import Schema
from zivi.study.store import DESCRIPTIONS, Labels, dims_of

__all__ = ["EVENTS", "GROUP", "KINDS", "difference", "documents"]

EVENTS = "events"
GROUP: dict[str, Any] = {"attributes": {}, "zarr_format": 3, "node_type": "group"}
"""The metadata of the folder of events."""
KINDS = {"f": "float64", "i": "int64", "b": "bool", "U": "string"}
"""How the values of a parameter are kept, by the kind of their array."""
NOTHING = {"float64": 0.0, "int64": 0, "int8": 0, "bool": False, "string": ""}
LITTLE = {"name": "bytes", "configuration": {"endian": "little"}}
CHECKSUM = {"name": "crc32c"}
SHARDS = "sharding_indexed"
BYTES = {
    "float64": LITTLE,
    "int64": LITTLE,
    "int8": {"name": "bytes"},
    "bool": {"name": "bytes"},
    "string": {"name": "vlen-utf8", "configuration": {}},
}


def documents(
    kind: str, parameters: Mapping[str, str], layout: Layout, labels: Labels, schema: Schema | None
) -> dict[str, Any]:
    """Give the metadata of all arrays of a store, by their names.

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
        name: _document(kept, _column(n, layout), (name,) if is_grid else design, unit(name))
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
    """The shape of an array, of one of its files, and of the parts of a file if it is a shard."""

    shape: tuple[int, ...]
    file: tuple[int, ...]
    part: tuple[int, ...] | None = None

    def of(self, inner: tuple[int, ...]) -> Places:
        """Give those of an array with more dimensions, which are not cut."""
        more = tuple(max(1, length) for length in inner)
        part = None if self.part is None else (*self.part, *more)
        return Places((*self.shape, *inner), (*self.file, *more), part)


def _column(n: int, layout: Layout) -> Places:
    """Give the places of a parameter: one file, as long as that is not too large for a codec."""
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


def difference(found: Any, wanted: Mapping[str, Any]) -> str | None:
    """Name what of the metadata of an array is not as zivi writes it, None if all is."""
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
        if _text(there) != _text(here):
            return key
    return None


def _plain_codecs(given: Any) -> Any:
    """Leave out what versions of Zarr write in different ways, and what decoding does not need."""
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


def _text(value: Any) -> str:
    # so that 1, 1.0 and true differ
    return json.dumps(value, sort_keys=True)
