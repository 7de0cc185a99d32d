"""The head of a store, ``PATH/zarr.json``: what the study is, and what its arrays are.

It is written as a whole or not at all, and read with suspicion: what zivi would not have written is
refused before any array is decoded.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from zivi.study.design import MOST_POINTS, name_of
from zivi.study.form import EVENTS, GROUP, KINDS, difference, documents
from zivi.study.layout import Layout
from zivi.study.piece import Schema
from zivi.study.replacement import write_whole
from zivi.study.store import Labels, attributes
from zivi.study.work import MAX_SEED

__all__ = ["Head", "json_text", "read_head", "read_json", "write_json"]

FILE = "zarr.json"


@dataclasses.dataclass(frozen=True)
class Head:
    """What a store says of itself.

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
            **attributes(identity),
            "labels": json.dumps(kept),
            "schema": json.dumps(None),
            "coordinates": " ".join(parameters),
        }
        return cls(identity, labels, None, parameters, given)

    def with_schema(self, schema: Schema) -> Head:
        """Give the head of the same store with room for results."""
        kept = {"shapes": schema.shapes, "has_events": schema.has_events, "units": schema.units}
        given = {**self.attributes, "schema": json.dumps(kept)}
        return dataclasses.replace(self, schema=schema, attributes=given)

    @property
    def layout(self) -> Layout:
        """The chunks of points."""
        told, size = self.identity, 0 if self.schema is None else self.schema.size
        return Layout(tuple(told["shape"]), told["chunk"], told.get("shards", False), size)

    def documents(self) -> dict[str, Any]:
        """Give the metadata of all arrays."""
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
    """Read metadata; a ValueError says why they cannot be."""
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
        raise FileNotFoundError(f"there is no study at {path}")
    if not file.is_file():
        raise ValueError(f"{path} is not a study: it has no {FILE}")
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
        return _checked(raw, identity, attrs)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        said = f"it has no {error}" if isinstance(error, KeyError) else str(error)
        raise OSError(
            f"{file} is damaged, or not all of it was written by zivi: {said}; nothing was decoded"
        ) from None


def _checked(raw: Mapping[str, Any], identity: dict[str, Any], attrs: dict[str, Any]) -> Head:
    for key in _wrong(identity):
        raise ValueError(f"{key} is {identity.get(key)!r:.80} in its config")
    names = identity["parameters"]
    if attrs.get("coordinates") != " ".join(names):
        raise ValueError(f"its coordinates are {attrs.get('coordinates')!r:.80}")
    nodes = dict(raw["consolidated_metadata"]["metadata"])
    if raw != _consolidated(GROUP | {"attributes": attrs}, nodes):
        raise ValueError("it is no group of the third format of Zarr with the metadata of all")
    events = nodes.pop(EVENTS)
    if events not in (GROUP, _consolidated(GROUP, {})):
        raise ValueError(f"{EVENTS} is {events!r:.80}")
    labels = _labels(json.loads(attrs["labels"]))
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
        if wrong := difference(nodes[name], document):
            there = nodes[name].get(wrong) if isinstance(nodes[name], dict) else nodes[name]
            raise ValueError(f"the {wrong} of the array {name!r} is {there!r:.120}")
    return head


def _wrong(config: dict[str, Any]) -> Iterator[str]:
    """Name the entries of what a study is that cannot be."""
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
        return len({name_of("parameter", name) for name in given}) == len(given)
    except (TypeError, ValueError):
        return False


def _are_whole(given: Any, least: int) -> bool:
    return isinstance(given, list) and all(type(it) is int and it >= least for it in given)


def _labels(kept: Any) -> Labels:
    dims = {name: tuple(names) for name, names in kept["dims"].items()}
    return Labels(kept["units"], dims)


def _schema(kept: Any) -> Schema | None:
    if kept is None:
        return None
    for name, shape in kept["shapes"].items():
        name_of("result", name)
        if not _are_whole(shape, 0):
            raise ValueError(f"the shape of {name!r} is {shape!r:.80}")
    if not isinstance(kept["has_events"], bool):
        raise ValueError(f"has_events is {kept['has_events']!r:.80}")
    shapes = {name: tuple(shape) for name, shape in kept["shapes"].items()}
    return Schema(shapes, kept["has_events"], dict(kept["units"]))
