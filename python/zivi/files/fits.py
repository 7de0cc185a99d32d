"""Fits from files: ``zivi fit``."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from zivi.estimation import Bounces, Experiment, Fit, Record, fit
from zivi.files.file_keys import FIT, Key
from zivi.files.kinds import FileError, Mistakes
from zivi.files.runs import argument_keys, build_method, keys_of_run, read_file, system_of

SHARED = ("y0", "system", "method")
"""Keys that a file of ``zivi simulate`` has too."""


@dataclasses.dataclass(frozen=True)
class PreparedFit:
    """A fit whose file and data were read.

    Parameters
    ----------
    call : callable
        The fit, called with whether to show progress.
    mistakes : Mistakes
        Of the file.
    """

    call: Callable[[bool | None], Fit]
    mistakes: Mistakes

    def run(self, progress: bool | None = None) -> Fit:
        """Fit; a `FileError` names the key of an argument that is out of range."""
        with self.mistakes.naming(argument_keys("", ())):
            return self.call(progress)


def prepare_fit(path: Path) -> PreparedFit:
    """Read a file of ``zivi fit`` and its data.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    PreparedFit

    Raises
    ------
    FileError
        With all mistakes of the file.
    """
    content = read_file(path, _keys_of_fit, "fit")
    values, mistakes = content.values, content.mistakes
    system = system_of(values, mistakes)
    data = [_data_of(path, k, row, mistakes) for k, row in enumerate(values["data"])]
    mistakes.stop()
    names = ("bounds", "prior", "starts", "seed", "loss", "own")
    arguments: dict[str, Any] = {name: values[name] for name in names if name in values}
    if "method" in values:
        arguments["method"] = build_method(values["method"], mistakes)

    def call(progress: bool | None) -> Fit:
        runs = _experiments(values, data)
        return fit(system, runs, values["params"], progress=progress, **arguments)

    return PreparedFit(call, mistakes)


def _experiments(values: dict[str, Any], data: list[Any]) -> list[Experiment]:
    """Return the runs: data with an initial state of their own begin another one."""
    runs: list[tuple[Any, list[Any]]] = [(values["y0"], [])]
    for row, measured in zip(values["data"], data, strict=True):
        if "y0" in row:
            mass = np.ndim(values["y0"]) == 1
            y0 = [it[0] if mass and len(it) == 1 else it for it in row["y0"]]
            runs.append((y0, []))
        runs[-1][1].append(measured)
    t0 = values.get("t0", 0.0)
    return [Experiment(own, y0=tuple(y0), t0=t0) for y0, own in runs if own]


def _keys_of_fit(content: dict[str, Any]) -> tuple[Key, ...]:
    shared = tuple(key for key in keys_of_run(content) if key.name in SHARED)
    return (*shared, *FIT)


def _data_of(path: Path, number: int, row: dict[str, Any], mistakes: Mistakes) -> Any:
    """Read a data set from its table or from a CSV file."""
    key = f"data[{number}]"
    given = {name: it for name, it in row.items() if name in ("sigma", "gap", "of")}
    given |= {name: it for name, it in row.items() if name in ("missed", "spurious")}
    bouncing = row["kind"] == "bounces"
    wanted = {"times": row.get("column", "t")} if bouncing else {}
    if not bouncing:
        wanted = {"t": row.get("time", "t"), "values": row.get("column", row.get("of", "x"))}
    if ("file" in row) == any(name in row for name in wanted):
        told = " and ".join(wanted)
        mistakes.add(key, f"must have either file or {told}")
        return None
    if "file" in row:
        columns = read_csv_columns(path.parent / row["file"], list(wanted.values()))
        given |= dict(zip(wanted, columns, strict=True))
    else:
        given |= {name: row.get(name, []) for name in wanted}
    with mistakes.naming(argument_keys(key, given), key):
        return Bounces(**given) if bouncing else Record(**given)


def read_csv_columns(path: Path, names: list[str]) -> list[np.ndarray]:
    """Read columns of a CSV file with a row of names; empty cells are NaN.

    Raises
    ------
    FileError
        If the file cannot be read, lacks a column, or has a cell that is not a number.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(f"{path}: cannot be read: {reason}") from None
    head = [cell.strip() for cell in rows[0]] if rows else []
    for name in names:
        if name not in head:
            raise FileError(f"{path}: column {name!r} is missing; the file has {', '.join(head)}")
    places = [head.index(name) for name in names]
    table = [
        [_cell_value(path, line, row, place) for place in places]
        for line, row in enumerate(rows[1:], 2)
        if any(cell.strip() for cell in row)
    ]
    return list(np.array(table, float).reshape(-1, len(names)).T)


def _cell_value(path: Path, line: int, row: list[str], place: int) -> float:
    cell = row[place].strip() if place < len(row) else ""
    try:
        return float(cell) if cell else math.nan
    except ValueError:
        raise FileError(f"{path}: line {line}: {cell!r} is not a number") from None
