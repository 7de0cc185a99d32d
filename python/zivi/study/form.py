"""What zivi writes of the arrays of a store, so that nothing else is read.

A store may come from anywhere, and its metadata name the codecs that decode it. Only arrays of the
third format of Zarr with the codecs, kinds and shapes that zivi itself would write are accepted.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from zivi.study.layout import Layout
from zivi.study.store import DESCRIPTIONS, Labels, dims_of
from zivi.study.work import Schema

__all__ = ["EVENTS", "GROUP", "KINDS", "difference", "documents"]

EVENTS = "events"
GROUP: dict[str, Any] = {"attributes": {}, "zarr_format": 3, "node_type": "group"}
"""The metadata of the folder of events."""
KINDS = {"f": "float64", "i": "int64", "b": "bool", "U": "string"}
"""How the values of a parameter are kept, by the kind of their array."""
NOTHING = {"float64": 0.0, "int64": 0, "int8": 0, "bool": False, "string": ""}
LITTLE = {"name": "bytes", "configuration": {"endian": "little"}}
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
    shape, chunk = layout.shape, layout.chunk
    units = {**(schema.units if schema else {}), **labels.units}

    def unit(name: str) -> dict[str, str]:
        return {"units": units[name]} if name in units else {}

    found = {
        name: _document(kept, ((n,), (n,)), (name,) if is_grid else design, unit(name))
        for (name, kept), n in zip(parameters.items(), lengths, strict=True)
    }
    over_points = {"status": "int8", "message": "string"}
    if schema is not None and schema.has_events:
        over_points["n_events"] = "int64"
    for name, kept in over_points.items():
        found[name] = _document(kept, (shape, chunk), design, DESCRIPTIONS[name])
    for name, inner in (schema.shapes if schema else {}).items():
        sizes = (*shape, *inner), (*chunk, *(max(1, length) for length in inner))
        dims = dims_of(name, inner, design, labels)
        found[name] = _document("float64", sizes, dims, unit(name), "NaN")
    return {name: found[name] for name in sorted(found)}


def _document(
    kept: str,
    sizes: tuple[tuple[int, ...], tuple[int, ...]],
    dims: tuple[str, ...],
    attributes: Mapping[str, str],
    nothing: Any = None,
) -> dict[str, Any]:
    shape, chunk = sizes
    return {
        "shape": list(shape),
        "data_type": kept,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": list(chunk)}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": NOTHING[kept] if nothing is None else nothing,
        "codecs": [
            BYTES[kept],
            {"name": "zstd", "configuration": {"level": 1, "checksum": False}},
            # a file that was cut or altered is noticed
            {"name": "crc32c"},
        ],
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
        found.append({"name": codec.get("name"), "setting": setting, **more})
    return found


def _text(value: Any) -> str:
    # so that 1, 1.0 and true differ
    return json.dumps(value, sort_keys=True)
