"""Result of a study: dataset, events and failures, from memory or from a folder."""

from __future__ import annotations

import dataclasses
import math
import warnings
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.extras import have, needed
from zivi.base.status import Status, StudyStatus
from zivi.base.table import listed_by, page
from zivi.study.design import Design
from zivi.study.folder import DamagedError, FolderStore
from zivi.study.store import MemoryStore, Store

if TYPE_CHECKING:
    import pandas
    import xarray

MOST_SALVAGED = 10**8
"""Points of the largest damaged study that is read into memory."""


class Study:
    """The results of a study.

    Other attributes are those of the dataset: ``study.rest_time.plot()`` and
    ``study["rest_time"]`` are ``study.dataset.rest_time.plot()`` and so on.

    Parameters
    ----------
    dataset : xarray.Dataset
        The results over the parameters, with known units. ``status`` holds the
        numbers of `StudyStatus`: 0 for a missing, 1 for a completed, 2 for a failed point;
        ``message`` is the reason. The attributes tell the seed, the version and, as JSON, what the
        study is. From a folder, the values are read when they are used.
    path : Path, optional
        The folder.
    events : optional
        The events with the number of their point, or a function that reads them: a
        ``pyarrow.Table`` (``to_pandas()``), or a structured array without pyarrow; None if the
        function returns no events. From a folder, they are read when they are used.

    See Also
    --------
    open_study : read a study from its folder.
    sweep : compute a study.

    Notes
    -----
    Results are read from the store when they are used; a study in memory has the same interface.
    """

    def __init__(
        self, dataset: xarray.Dataset, path: Path | None = None, events: Any = None
    ) -> None:
        self.dataset = dataset
        self.path = path
        self._given = events

    @property
    def events(self) -> Any:
        """The events with the numbers of their points, None if the function gives none."""
        events = self._given() if callable(self._given) else self._given
        if not isinstance(events, np.ndarray) or not have("pyarrow"):
            return events
        inner = [name for name in events.dtype.names or () if name != "point"]
        return _arrow_table(events["point"], events[inner])

    @property
    def status(self) -> NDArray[np.int8]:
        """States of all points, in the order of C, the numbers of `StudyStatus`."""
        return np.asarray(self.dataset["status"].values, np.int8).ravel()

    @property
    def complete(self) -> bool:
        """Whether no point is missing."""
        return not np.any(self.status == StudyStatus.MISSING)

    @property
    def failed(self) -> pandas.DataFrame:
        """The points that failed: their parameters and why, by the number of the point."""
        import pandas

        dataset = self.dataset
        numbers = np.flatnonzero(self.status == StudyStatus.FAILED)
        columns: dict[str, Any]
        if "point" in dataset.dims:
            columns = {str(name): dataset[name].values[numbers] for name in dataset.coords}
        else:
            places = np.unravel_index(numbers, dataset["status"].shape)
            pairs = zip(dataset["status"].dims, places, strict=True)
            columns = {str(name): dataset[name].values[place] for name, place in pairs}
        # as plain strings, whatever kind the store has
        columns["message"] = [str(it) for it in dataset["message"].values.ravel()[numbers]]
        return pandas.DataFrame(columns, index=pandas.Index(numbers, name="point"))

    def __getitem__(self, name: Any) -> Any:
        return self.dataset[name]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "dataset":
            raise AttributeError(name)
        return getattr(self.dataset, name)

    def to_xarray(self) -> xarray.Dataset:
        """Return the dataset, as every result of zivi does."""
        return self.dataset

    def _repr_html_(self) -> str:
        """Show the counts of points and the dataset, in a notebook."""
        status = self.status
        rows = {state.name.lower(): str(np.count_nonzero(status == state)) for state in StudyStatus}
        where = {} if self.path is None else {"folder": str(self.path)}
        ended = {"runs": text} if (text := self._ended()) else {}
        told = {"points": str(len(status)), **rows, **ended, **where}
        return page("zivi.Study", told) + str(self.dataset._repr_html_())

    def _ended(self) -> str:
        """Describe how many runs ended early, by status."""
        if "run_status" not in self.dataset:
            return ""
        ends = self.dataset["run_status"].values.ravel()
        good = np.isin(ends, (Status.COMPLETED, Status.TERMINATED_BY_EVENT)) | np.isnan(ends)
        reasons = [Status(int(it)).name.lower() for it in ends[~good]]
        return listed_by(len(ends), "with a run that failed", reasons)

    def __repr__(self) -> str:
        status = self.status
        completed = np.count_nonzero(status == StudyStatus.COMPLETED)
        counts = [f"{completed} of {len(status)} points completed"]
        for state in (StudyStatus.FAILED, StudyStatus.MISSING):
            if number := np.count_nonzero(status == state):
                counts.append(f"{number} {state.name.lower()}")
        if ended := self._ended():
            counts.append(ended)
        where = "" if self.path is None else f" in {self.path}"
        results = ", ".join(str(name) for name in self.dataset.data_vars)
        return f"<Study{where}: {', '.join(counts)}; {results}>"


def open_study(path: str | PathLike[str], *, verify: bool = False) -> Study:
    """Open the results of a study in a folder.

    ``xarray.open_zarr(path)`` opens the same dataset.

    Parameters
    ----------
    path : path
        The folder that `sweep` wrote; the run may still be going on, or have been killed.
    verify : bool
        Read everything and check it. Otherwise a file that is damaged is noticed when it is read.

    Returns
    -------
    Study
        The dataset, read when it is used, and the events. If files are missing or, with `verify`,
        damaged, a warning names them and the dataset, in memory, has the readable parts; their
        points are missing in it (lost parameter values are NaN or ""), and `sweep` will compute or
        write them again.

    Raises
    ------
    FileNotFoundError
        If there is nothing.
    ValueError
        If it is something else.
    OSError
        If what the study is cannot be read, or if the folder has arrays that zivi does not write:
        other codecs, kinds or shapes. None of them is decoded then.

    See Also
    --------
    sweep : compute or resume a study.
    Study : the result.

    Notes
    -----
    Only the metadata are read until a result is used; ``verify=True`` reads and checks all chunks.

    Examples
    --------
    >>> import tempfile, os.path
    >>> folder = os.path.join(tempfile.mkdtemp(), "study.zarr")
    >>> _ = zivi.sweep("ball_rest_time", {"e": [0.3, 0.5]}, out=folder)
    >>> zivi.open_study(folder).rest_time.values.round(6)
    array([0.838544, 1.354571])
    """
    path = Path(path)
    store = FolderStore(path, write=False)
    known, damage = store.parameters()
    if verify:
        damage += [*store.altered(), *(why for _, why in store.damage())]
    else:
        damage += [f"{file} is missing or damaged" for file in store.lost_files()]
    if damage:
        more = f" and {len(damage) - 3} more" if len(damage) > 3 else ""
        warnings.warn(
            f"{path} is damaged: {'; '.join(damage[:3])}{more}; what can be read is read",
            stacklevel=2,
        )
        return _salvaged(store, known)
    return Study(_open_dataset(path), path, StoredEvents(path))


def _open_dataset(path: Path) -> xarray.Dataset:
    import xarray

    # the metadata in the head, which were checked, and no others
    dataset: xarray.Dataset = xarray.open_zarr(path, chunks=None, consolidated=True, zarr_format=3)
    for internal in ("labels", "schema"):
        dataset.attrs.pop(internal, None)
    return dataset


def _salvaged(store: FolderStore, known: dict[str, NDArray[Any]]) -> Study:
    """Read what can be read into memory; parameters that are lost are NaN or ""."""
    if (size := math.prod(store.layout.shape)) > MOST_SALVAGED:
        raise OSError(f"{store.path} is damaged, and its {size} points are too many for the memory")
    head = store.head
    lengths = store.layout.shape * (1 if head.identity["kind"] == "grid" else len(head.parameters))
    columns = {
        name: known[name] if name in known else np.full(length, "" if kept == "string" else np.nan)
        for (name, kept), length in zip(head.parameters.items(), lengths, strict=True)
    }
    design = Design(head.identity["kind"], columns)
    kept = MemoryStore(design, store.layout, head.identity, head.labels)
    if store.schema is not None:
        kept.define(store.schema)
    for chunk in store.written():
        kept.save(chunk, store.load(chunk))
    return Study(kept.dataset(), store.path, kept.events())


def study_of(store: Store) -> Study:
    """Return the results that a store has so far."""
    if isinstance(store, FolderStore):
        return open_study(store.path)
    assert isinstance(store, MemoryStore)
    return Study(store.dataset(), events=store.events())


@dataclasses.dataclass(frozen=True)
class StoredEvents:
    """Reads the events of all points that are completed, and warns of files that cannot be read.

    Parameters
    ----------
    path : Path
        The store.
    """

    path: Path

    def __call__(self) -> Any:
        """Return a table, or None if there are no events."""
        store = FolderStore(self.path, write=False)
        if store.schema is None or not store.schema.has_events:
            return None
        pyarrow = needed("pyarrow", "events in a folder")
        tables: list[Any] = []
        broken = []
        for chunk in store.written():
            try:
                rows = store.events(chunk)
            except DamagedError as error:
                broken.append(str(error))
                continue
            if rows is None:
                continue
            table = _arrow_table(*rows)
            if tables and table.schema != tables[0].schema:
                broken.append(f"the events of chunk {chunk} have other columns than those before")
            else:
                tables.append(table)
        if broken:
            warnings.warn("; ".join(broken), stacklevel=3)
        if not tables:
            return pyarrow.table({"point": np.empty(0, np.int64)})
        return pyarrow.concat_tables(tables)


def _arrow_table(points: NDArray[np.int64], events: NDArray[np.void]) -> Any:
    pyarrow = needed("pyarrow", "tables of events")
    names = events.dtype.names or ()
    columns = {name: np.ascontiguousarray(events[name]) for name in names}
    return pyarrow.table({"point": points, **columns})
