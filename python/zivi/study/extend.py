"""Extension of a stored study by points, of which only the new ones are computed."""

from __future__ import annotations

import contextlib
import functools
import math
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.study.design import Design
from zivi.study.folder import FolderStore, head_of, locked, write_empty
from zivi.study.head import EVENTS
from zivi.study.outcome import concatenate_tables
from zivi.study.store import Block

LOADED = 4
"""Chunks of the smaller study that are in memory at a time."""
EXACT = 2**53
"""Whole numbers below are floats."""


def extended(store: FolderStore, design: Design, differences: str, *, draws: bool) -> FolderStore:
    """Replace a store by one of more points, with the results of the old one.

    Parameters
    ----------
    store : FolderStore
        The smaller study, open for writing; it is closed.
    design : Design
        All points, of the same kind and with the same parameters.
    differences : str
        Differences of the two designs, for the error message.
    draws : bool
        Whether the points have seeds, which depend on their numbers.
    """
    values, lost = store.parameters()
    if lost:
        raise OSError(
            f"the study cannot be extended: {'; '.join(lost)}; the same call with its own points "
            "writes them again"
        )
    there = Design(store.identity["kind"], values)
    where = _where(there, design)
    among = math.prod(int(np.count_nonzero(axis >= 0)) for axis in where)
    if among < len(there):
        raise ValueError(
            f"{store.path} has another study: {differences}; points can be added, but "
            f"{len(there) - among} of the {len(there)} in the folder are not among these"
        )
    if draws and not _keeps_numbers(there, design, where):
        raise ValueError(
            f"{store.path} has another study: {differences}; the function has an argument seed or "
            "rng, which depend on the number of a point: append values to a list, or to the first "
            "parameter of a grid"
        )
    identity = store.identity | {"shape": list(design.shape), "values": design.digest()}
    head = head_of(design, identity, store.labels)
    if store.schema is not None:
        head = head.with_schema(store.schema)
    place = Path(os.path.realpath(store.path))
    draft = place.with_name(f".{place.name}.extended")
    shutil.rmtree(draft, ignore_errors=True)
    new = None
    try:
        write_empty(draft, head, design)
        new = FolderStore(draft, write=True)
        _copy(store, new, where)
        _replace(place, draft)
    except BaseException:
        if new is not None:
            new.close()
        shutil.rmtree(draft, ignore_errors=True)
        raise
    new.moved_to(store.path)
    store.close()
    return new


def put_back(path: Path) -> None:
    """Complete the replacement of a folder that a killed run left unfinished."""
    place = Path(os.path.realpath(path))
    before = _before(place)
    if not before.is_dir():
        return
    lock = locked(before / EVENTS / "zarr.json")  # raises if that run is not killed
    try:
        if place.exists():
            shutil.rmtree(before, ignore_errors=True)
        else:
            os.replace(before, place)
    finally:
        if lock is not None:
            os.close(lock)


def _before(place: Path) -> Path:
    return place.with_name(f".{place.name}.before")


def _replace(place: Path, draft: Path) -> None:
    """Replace a folder by another one, then remove the old one."""
    before = _before(place)
    os.replace(place, before)
    try:
        os.replace(draft, place)
    except BaseException:
        with contextlib.suppress(OSError):
            os.replace(before, place)
        raise
    shutil.rmtree(before, ignore_errors=True)


def _where(there: Design, here: Design) -> list[NDArray[np.int64]]:
    """Return, for each index along each dimension, the index in the smaller study, -1 if new."""
    if here.kind != "grid":
        return [_match_rows(list(there.values.values()), list(here.values.values()))]
    pairs = zip(there.values.values(), here.values.values(), strict=True)
    return [_match_rows([old], [new]) for old, new in pairs]


def _match_rows(old: list[NDArray[Any]], new: list[NDArray[Any]]) -> NDArray[np.int64]:
    """Return, for each new row, the index of the equal old row, -1 if none; duplicates in order."""
    n = len(old[0])
    codes = np.zeros(n + len(new[0]), np.int64)
    for columns in zip(old, new, strict=True):
        both = _comparable(*columns)
        if both is None:
            return np.full(len(new[0]), -1)
        _, found = np.unique(both, return_inverse=True)
        _, codes = np.unique(codes * len(codes) + found, return_inverse=True)
    keys = codes * len(codes) + np.concatenate([_tie_ranks(codes[:n]), _tie_ranks(codes[n:])])
    order = np.argsort(keys[:n])
    at = np.minimum(np.searchsorted(keys[:n], keys[n:], sorter=order), n - 1)
    return np.where(keys[order[at]] == keys[n:], order[at], -1)


def _comparable(old: NDArray[Any], new: NDArray[Any]) -> NDArray[Any] | None:
    """Concatenate two columns for comparison by bytes; None if their types differ."""
    kinds = old.dtype.kind, new.dtype.kind
    if kinds[0] != kinds[1]:
        if set(kinds) != {"i", "f"}:
            return None
        whole = old if kinds[0] == "i" else new
        if np.abs(whole.astype(float)).max() >= EXACT:
            return None
    both = np.concatenate([old, new])
    # by their bytes: NaN is not equal to itself, and 1/-0.0 is not 1/0.0
    return both.view(np.int64) if both.dtype.kind == "f" else both


def _tie_ranks(codes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Count for each entry the equal ones before it."""
    order = np.argsort(codes, kind="stable")
    _, first, counts = np.unique(codes[order], return_index=True, return_counts=True)
    found = np.empty(len(codes), np.int64)
    found[order] = np.arange(len(codes)) - np.repeat(first, counts)
    return found


def _keeps_numbers(there: Design, here: Design, where: list[NDArray[np.int64]]) -> bool:
    """Return whether all old points keep their numbers."""
    lengths = zip(there.shape, where, strict=True)
    if not all(np.array_equal(axis[:n], np.arange(n)) for n, axis in lengths):
        return False
    # of a dimension with one place, the step to the next one does not matter
    return all(
        length == 1 or math.prod(there.shape[k + 1 :]) == math.prod(here.shape[k + 1 :])
        for k, length in enumerate(there.shape)
    )


def _copy(store: FolderStore, new: FolderStore, where: list[NDArray[np.int64]]) -> None:
    """Copy all results, chunk by chunk."""
    load = functools.lru_cache(LOADED)(store.load)
    there, here = store.layout, new.layout
    for chunk in range(len(here)):
        span = here.span(chunk)
        places = np.unravel_index(np.arange(span.start, span.stop), here.shape)
        old = np.stack([axis[place] for axis, place in zip(where, places, strict=True)])
        known = np.flatnonzero((old >= 0).all(axis=0))
        numbers = np.ravel_multi_index(tuple(old[:, known]), there.shape)
        block = Block.empty(span)
        chunks = there.chunk_of(numbers)
        for source in np.unique(chunks).tolist():
            own = chunks == source
            _take(block, load(source), known[own], numbers[own])
        if block.status.any():
            events = concatenate_tables(block.events)
            if events is not None:
                order = np.argsort(events[0], kind="stable")
                block.events = [(events[0][order], events[1][order])]
            new.save(chunk, block)


def _take(block: Block, source: Block, to: NDArray[np.int64], points: NDArray[np.int64]) -> None:
    """Copy points of another chunk into a block."""
    rows = points - source.span.start
    block.status[to] = source.status[rows]
    for name, values in source.values.items():
        if name not in block.values:
            block.values[name] = np.full((len(block.span), *values.shape[1:]), np.nan)
        block.values[name][to] = values[rows]
    places = np.full(len(source.span), -1)
    places[rows] = to
    for point, message in source.messages.items():
        if places[point - source.span.start] >= 0:
            block.messages[block.span.start + int(places[point - source.span.start])] = message
    for numbers, events in source.events:
        found = places[numbers - source.span.start]
        kept = found >= 0
        block.events.append((block.span.start + found[kept], events[kept]))
