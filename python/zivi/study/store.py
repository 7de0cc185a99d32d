"""Where results go: the interface of stores, and the one in memory."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.extras import needed
from zivi.base.status import StudyStatus
from zivi.study.block import Block
from zivi.study.design import RESERVED, Design
from zivi.study.layout import Layout
from zivi.study.piece import Schema

if TYPE_CHECKING:
    import xarray

__all__ = ["DESCRIPTIONS", "Labels", "MemoryStore", "Store", "attributes", "count", "dims_of"]

# the metadata of a folder are compared with these: the words of version 0.1 stay in them
DESCRIPTIONS = {
    "status": {"long_name": "0 missing, 1 done, 2 failed", "units": "1"},
    "message": {"long_name": "why a point failed"},
    "n_events": {"long_name": "number of events", "units": "1"},
}


class Labels:
    """Units and names of dimensions that a user gives.

    Parameters
    ----------
    units : dict
        Units of parameters and results.
    dims : dict
        Names of the dimensions of results that are arrays.
    """

    def __init__(self, units: Mapping[str, str], dims: Mapping[str, Sequence[str]]) -> None:
        for what, unit in units.items():
            if not isinstance(what, str) or not isinstance(unit, str):
                raise TypeError(f"units must give strings by names, got {what!r}: {unit!r}")
        for name, names in dims.items():
            of = f"dims[{name!r}]"
            if isinstance(names, str) or not all(isinstance(it, str) and it for it in names):
                raise TypeError(f"{of} must be a list of names, got {names!r}")
            if len(set(names)) < len(names):
                raise ValueError(f"{of} names a dimension twice: {', '.join(names)}")
        self.units = dict(units)
        self.dims = {name: tuple(names) for name, names in dims.items()}

    def check_names(self, parameters: Sequence[str]) -> None:
        """Raise if a dimension of a result has a name that the points need."""
        for name, names in self.dims.items():
            if taken := set(names) & {*parameters, *RESERVED, *self.dims}:
                raise ValueError(
                    f"dims[{name!r}] cannot name a dimension {taken.pop()!r}: a parameter, a "
                    "result or the store has this name"
                )

    def check(self, schema: Schema, parameters: Sequence[str]) -> None:
        """Raise if the dimensions of the results do not fit them, or one another."""
        self.check_names(parameters)
        known: dict[str, tuple[str, int]] = {}
        for name, shape in schema.shapes.items():
            names = dims_of(name, shape, (), self)
            if len(shape) != len(names):
                raise ValueError(
                    f"dims[{name!r}] names {len(names)} dimensions, "
                    f"the result has the shape {shape}"
                )
            for dim, length in zip(names, shape, strict=True):
                if dim in (*schema.shapes, *parameters):
                    raise ValueError(
                        f"the dimension {dim!r} of {name!r} has the name of a result or of a "
                        "parameter; dims gives it another one"
                    )
                other, size = known.setdefault(dim, (name, length))
                if size != length:
                    raise ValueError(
                        f"the dimension {dim!r} has the length {size} in {other!r}, {length} in "
                        f"{name!r}; dims gives it another name"
                    )


class Store(Protocol):
    """What keeps the results of a study."""

    @property
    def layout(self) -> Layout:
        """The chunks of points, which may be others once it is known what the points give."""

    @property
    def identity(self) -> dict[str, Any]:
        """What tells the study."""

    @property
    def schema(self) -> Schema | None:
        """What the points give, once that is known."""

    def written(self) -> list[int]:
        """List the chunks that have states."""

    def status_of(self, chunk: int) -> NDArray[np.int8]:
        """Give the states of the points of a chunk; those that cannot be read are missing."""

    def define(self, schema: Schema) -> None:
        """Make room for what the points give."""

    def load(self, chunk: int) -> Block:
        """Give what is there of a chunk."""

    def save(self, chunk: int, block: Block) -> None:
        """Keep a chunk: all of it, or what was there before."""

    def close(self) -> None:
        """Let others write."""


def count(store: Store, *states: StudyStatus) -> int:
    """Count the points of a store in some states, chunk by chunk."""
    own = (store.status_of(chunk) for chunk in store.written())
    return sum(int(np.count_nonzero(np.isin(status, states))) for status in own)


def attributes(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Give the attributes of the dataset."""
    found = {
        "title": f"Study of {identity['function']}",
        "source": f"zivi {_zivi.__version__}",
        "parameters": json.dumps(identity["parameters"]),
        "config": json.dumps(identity),
    }
    # what is not there is left out: not every format of a dataset has a word for it
    return found if identity["seed"] is None else found | {"seed": identity["seed"]}


def dims_of(name: str, shape: tuple[int, ...], design: tuple[str, ...], labels: Labels) -> Any:
    """Name the dimensions of a result."""
    own = labels.dims.get(name) or tuple(f"{name}_{axis}" for axis in range(len(shape)))
    return (*design, *own)


class MemoryStore:
    """Keeps the results of a study in this process.

    Parameters
    ----------
    design : Design
        The points.
    layout : Layout
        How they are cut into chunks.
    identity : dict
        What tells the study.
    labels : Labels
        Units and dimensions.
    """

    def __init__(
        self, design: Design, layout: Layout, identity: dict[str, Any], labels: Labels
    ) -> None:
        self._design, self._labels = design, labels
        self.layout, self.identity = layout, identity
        self.schema: Schema | None = None
        self._blocks: dict[int, Block] = {}

    def written(self) -> list[int]:
        """List the chunks of which something is known."""
        return sorted(self._blocks)

    def status_of(self, chunk: int) -> NDArray[np.int8]:
        """Give the states of the points of a chunk."""
        return self.load(chunk).status

    def define(self, schema: Schema) -> None:
        """Make room for what the points give."""
        self._labels.check(schema, self._design.names)
        self.schema = schema
        for block in self._blocks.values():  # those of which all points failed
            block.shaped(schema)

    def load(self, chunk: int) -> Block:
        """Give what is there of a chunk."""
        return self._blocks.get(chunk) or Block.empty(self.layout.span(chunk))

    def save(self, chunk: int, block: Block) -> None:
        """Keep a chunk."""
        if self.schema is not None:
            block.shaped(self.schema)
        self._blocks[chunk] = block

    def close(self) -> None:
        """Do nothing: nobody else writes here."""

    def events(self) -> Any:
        """Give the events of all points, None where the function gives none."""
        if self.schema is None or not self.schema.has_events:
            return None
        tables = [self._blocks[chunk].table() for chunk in sorted(self._blocks)]
        known = [table for table in tables if table is not None]
        if not known:
            return np.empty(0, [("point", np.int64)])
        fields = known[0][1].dtype
        found = np.empty(sum(len(points) for points, _ in known), [("point", "i8"), *fields.descr])
        found["point"] = np.concatenate([points for points, _ in known])
        for field in fields.names or ():
            found[field] = np.concatenate([events[field] for _, events in known])
        return found

    def _filled(self, shape: tuple[int, ...], empty: Any, dtype: Any, of: Any) -> Any:
        """Put what `of` gives for each chunk into one array over the points."""
        flat = np.full((len(self._design), *shape), empty, dtype)
        for block in self._blocks.values():
            flat[block.span.start : block.span.stop] = of(block)
        return flat.reshape(*self._design.shape, *shape)

    def dataset(self) -> xarray.Dataset:
        """Give what is there so far."""
        needed("xarray", "the results of studies")
        import xarray

        design, units = self._design, self._labels.units
        schema = self.schema or Schema({}, False, {})
        known = {**schema.units, **units}

        def unit(name: str) -> dict[str, str]:
            return {"units": known[name]} if name in known else {}

        columns: dict[str, Any] = {
            name: (
                dims_of(name, shape, design.dims, self._labels),
                self._filled(shape, np.nan, float, lambda block, name=name: block.values[name]),
                unit(name),
            )
            for name, shape in schema.shapes.items()
        }
        dims = design.dims
        columns["status"] = dims, self._filled((), 0, np.int8, _status), DESCRIPTIONS["status"]
        messages = self._filled((), "", object, _messages)
        columns["message"] = dims, messages.astype(str), DESCRIPTIONS["message"]
        if schema.has_events:
            counts = self._filled((), 0, np.int64, Block.counts)
            columns["n_events"] = dims, counts, DESCRIPTIONS["n_events"]
        coordinates = {
            name: ((name,) if design.kind == "grid" else dims, column, unit(name))
            for name, column in design.values.items()
        }
        return xarray.Dataset(columns, coordinates, attributes(self.identity))


def _status(block: Block) -> NDArray[np.int8]:
    return block.status


def _messages(block: Block) -> list[str]:
    return [block.messages.get(point, "") for point in block.span]
