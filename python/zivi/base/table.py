"""Results as plain text, labelled datasets, tables and pages."""

from __future__ import annotations

import dataclasses
import html
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

import zivi._zivi as _zivi
from zivi.base.extras import needed

if TYPE_CHECKING:
    import pandas
    import xarray

# Plain text: counts of things, and configurations as JSON without infinity and NaN.


def counted(number: int, thing: str) -> str:
    """Return a count with its noun, in the plural unless the count is one.

    Examples
    --------
    >>> counted(1, "impact"), counted(2, "impact")
    ('1 impact', '2 impacts')
    """
    return f"{number} {thing}" + ("" if number == 1 else "s")


def listed_by(total: int, what: str, reasons: Iterable[str]) -> str:
    """Return how many of a total are affected, with the reasons; "" if none is.

    Examples
    --------
    >>> listed_by(40, "runs without an orbit", ["failed", "irregular", "irregular"])
    '3 of 40 runs without an orbit (2 irregular, 1 failed)'
    """
    counts = Counter(reasons)
    if not counts:
        return ""
    by = ", ".join(f"{number} {reason}" for reason, number in counts.most_common())
    return f"{counts.total()} of {total} {what} ({by})"


def text_of(value: Any) -> str:
    """Write plain values as JSON; numbers that are not finite become null."""
    return json.dumps(_finite_or_none(value), allow_nan=False)


def _finite_or_none(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: _finite_or_none(it) for name, it in value.items()}
    if isinstance(value, list | tuple):
        return [_finite_or_none(it) for it in value]
    return value


# Results as labelled datasets, tables and pages.
#
# A result declares its quantities, ``FIELDS = {name: (dims, unit, meaning)}``; `dataset`, `frame`
# and `page` write them for xarray, pandas and a notebook.

Field: TypeAlias = "tuple[str | tuple[str, ...], str, str]"
"""Dimensions, unit ("" if it has none that is known) and meaning of a quantity."""


@dataclasses.dataclass(frozen=True)
class ResultTable:
    """Schema of the dataset of a result.

    Parameters
    ----------
    title : str
        Title of the dataset.
    fields, coords : dict
        Dimensions, unit and meaning of the variables and of the coordinates, by name.
    values : dict
        Values of fields that are not attributes of the result.
    attrs : dict
        More attributes than title, version and configuration.
    rows : str
        The dimension that has the rows of a table, by default that of the first field.
    """

    title: str
    fields: Mapping[str, Field]
    coords: Mapping[str, Field] = dataclasses.field(default_factory=dict)
    values: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    attrs: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    rows: str = ""

    def value(self, result: Any, name: str) -> Any:
        """Return the values of a field or a coordinate."""
        return self.values[name] if name in self.values else getattr(result, name)


def dataset(
    result: Any,
    fields: Mapping[str, Field],
    *,
    title: str,
    coords: Mapping[str, Field] | None = None,
    values: Mapping[str, Any] | None = None,
    attrs: Mapping[str, Any] | None = None,
) -> xarray.Dataset:
    """Return a result as a labelled dataset.

    Parameters
    ----------
    result : object
        Fields without an entry in `values` are its attributes.
    fields, coords : dict
        Dimensions, unit and meaning of the variables and of the coordinates, by name.
    title : str
        What it is.
    values : dict, optional
        Values that are no attributes of the result.
    attrs : dict, optional
        More attributes; an attribute ``config`` of the result is among them, as JSON.

    Returns
    -------
    xarray.Dataset
        With the units, meanings, and the version of zivi.
    """
    return _dataset(result, ResultTable(title, fields, coords or {}, values or {}, attrs or {}))


def _dataset(result: Any, table: ResultTable) -> xarray.Dataset:
    needed("xarray", "labelled datasets")
    import xarray

    def labelled(known: Mapping[str, Field]) -> dict[str, Any]:
        return {
            name: (dims, table.value(result, name), _attributes(unit, meaning))
            for name, (dims, unit, meaning) in known.items()
        }

    attrs: dict[str, Any] = {"title": table.title, "source": f"zivi {_zivi.__version__}"}
    if hasattr(result, "config"):
        attrs["config"] = text_of(result.config)
    return xarray.Dataset(
        labelled(table.fields), coords=labelled(table.coords), attrs=attrs | dict(table.attrs)
    )


def _attributes(unit: str, meaning: str) -> dict[str, str]:
    return ({"units": unit} if unit else {}) | ({"long_name": meaning} if meaning else {})


def frame(result: Any, table: ResultTable) -> pandas.DataFrame:
    """Return the fields of a result along one dimension as a table.

    A field with several numbers per row (by coordinate, gap or sign) becomes several columns, with
    the name as suffix. Fields of other dimensions are left out.
    """
    needed("pandas", "tables")
    import pandas

    rows = table.rows or _dims(next(iter(table.fields.values())))[0]
    columns: dict[str, Any] = {}
    for name, field in {**table.coords, **table.fields}.items():
        dims = _dims(field)
        if name == rows or rows not in dims:
            continue
        values = np.asarray(table.value(result, name))
        if len(dims) == 1:
            columns[name] = values
        elif len(dims) == 2:
            other = dims[1 - dims.index(rows)]
            values = np.moveaxis(values, dims.index(rows), 0)
            for k, label in enumerate(_coordinate_labels(result, table, other)):
                columns[f"{name}_{label}"] = values[:, k]
    if rows in table.coords:
        return pandas.DataFrame(columns, index=pandas.Index(table.value(result, rows), name=rows))
    made = pandas.DataFrame(columns)
    made.index.name = rows
    return made


def _dims(field: Field) -> tuple[str, ...]:
    return (field[0],) if isinstance(field[0], str) else field[0]


def _coordinate_labels(result: Any, table: ResultTable, dim: str) -> list[str]:
    """Return the names along a dimension, none if it has numbers only."""
    if dim not in table.coords:
        return []
    labels = np.asarray(table.value(result, dim))
    return [str(it) for it in labels] if labels.dtype.kind in "OU" else []


def page(title: str, rows: Mapping[str, str]) -> str:
    """Return names with their values as an HTML table."""
    lines = "".join(
        f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
        f"<td style='text-align:left'>{html.escape(value)}</td></tr>"
        for name, value in rows.items()
    )
    return f"<table><caption>{title}</caption>{lines}</table>"


class Tabulated:
    """Base class of results: export as dataset, table and HTML page."""

    def _table(self) -> ResultTable:
        """Declare what is in the tables."""
        raise NotImplementedError

    def to_xarray(self) -> xarray.Dataset:
        """Convert to a labelled dataset that can be plotted, selected and saved.

        Returns
        -------
        xarray.Dataset
            With units, descriptions and the configuration (JSON, if the result has one) as
            attributes.
        """
        return self._as_dataset()

    def _as_dataset(self) -> xarray.Dataset:
        return _dataset(self, self._table())

    def to_pandas(self) -> pandas.DataFrame:
        """Convert to a table.

        Returns
        -------
        pandas.DataFrame
            A row for each sample, run, point or impact, whichever the result lists.
        """
        return self._as_frame()

    def _as_frame(self) -> pandas.DataFrame:
        return frame(self, self._table())

    def _facts(self) -> Mapping[str, str]:
        """Return the rows of the HTML page of the result."""
        table = self._table()
        told = {"": repr(self)}
        for name, (dims, unit, meaning) in table.fields.items():
            shape = " x ".join(map(str, np.shape(table.value(self, name))))
            over = dims if isinstance(dims, str) else ", ".join(dims)
            unit = f" ({unit})" if unit not in ("", "1") else ""
            told[name] = f"{meaning}{unit}, {shape} over {over}"
        return told

    def _repr_html_(self) -> str:
        """Show the result as a table, in a notebook."""
        return page(f"zivi.{type(self).__name__}", self._facts())
