"""One call from a function and its points to the results, new or extended."""

from __future__ import annotations

import contextlib
import functools
import inspect
import math
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import integer
from zivi.base.extras import ProgressBar
from zivi.base.habits import hinted
from zivi.base.status import StudyStatus
from zivi.study.design import Design, design_of
from zivi.study.digest import differences, identity
from zivi.study.drive import MAX_SEED, Driver, Job, Pool, pool_of, sendable
from zivi.study.experiments import experiment
from zivi.study.folder import EVENTS, FolderStore, create, head_of, locked, read_head, write_empty
from zivi.study.outcome import concatenate_tables
from zivi.study.result import Study, study_of
from zivi.study.store import Block, Chunks, Labels, MemoryStore, Store, count_points

# Extension of a stored study by points, of which only the new ones are computed.


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


# One call from a function and its points to the results.


GIVEN = ("seed", "rng")
"""Arguments that a function gets from the seed of the study."""
POINTS = {"shape", "values"}
"""What differs between a study and one of more points."""


@hinted("sweep")
def sweep(
    function: Callable[..., Any] | str,
    points: Design | Mapping[str, Any] | Sequence[Mapping[str, Any]],
    *,
    vectorized: bool = False,
    out: str | PathLike[str] | None = None,
    executor: Any = None,
    workers: int | None = None,
    seed: int | None = None,
    fixed: Mapping[str, Any] | None = None,
    units: Mapping[str, str] | None = None,
    dims: Mapping[str, Sequence[str]] | None = None,
    chunk: int | None = None,
    in_flight: int | None = None,
    resume: bool | None = None,
    retry_failed: bool = False,
    progress: bool | None = None,
) -> Study:
    """Evaluate a function at many points and store the results.

    A point that fails does not stop the others. A run that was stopped or killed is resumed by
    repeating the call.

    Parameters
    ----------
    function : callable or str
        Called with the parameters of each point by name; or the name of one of the experiments in
        ``zivi.study.EXPERIMENTS``. Returns a number, an array, a dict of both (always the same
        names and shapes; None is NaN), or a `Trajectory`, `ClosedLoop`, `MechanicalTrajectory` or
        `PeriodicOrbit`, of which the last state, the rest time and the counts are kept. A tuple
        ``(values, events)`` adds events: a structured array such as ``sol.impacts``, or a dict of
        arrays of one length. Values are kept as 64-bit floats. If it has a parameter ``seed`` or
        ``rng`` that is no parameter of the study, each point gets its own: an int or a
        ``numpy.random.Generator`` made from the child of ``numpy.random.SeedSequence(seed)`` with
        the number of the point.
    points : Design, dict or list of dict
        A dict of values is a grid; see `grid`, `points` and `sample`.
    vectorized : bool
        Whether the function takes many points at a time: arrays with an entry for each, ``seed``
        too, ``rng`` a list. It returns an array or a dict of arrays with a row for each point
        (an optional entry ``"message"`` has the reasons of failed points, "" for others), a batch,
        or a list of the results for each point, with exceptions for failed ones; or a tuple
        ``(values, events)``, the events a list or a table with the field ``point``. Points of a
        call that raises are called again in halves, down to those that make it raise. An entry must
        not depend on the others.
    out : path, optional
        Folder of the results, a Zarr store; without it they are kept in memory. Needs the extra
        ``study``.
    executor : optional
        Who computes: None is this thread, "threads" and "processes" are pools of this machine
        (`workers` wide; a process that dies is replaced). Or any ``concurrent.futures.Executor``,
        or a ``dask.distributed.Client``. It decides nothing but the time.
    workers : int, optional
        Width of a pool of this machine; by default the number of its cores.
    seed : int, optional
        Seed of the study, >= 0. A random one is drawn if the function wants one; the attribute
        ``seed`` of the results tells it.
    fixed : dict, optional
        Further arguments of the function, the same at all points. In a folder, they are compared by
        content when the study goes on.
    units : dict, optional
        Units of parameters and results.
    dims : dict, optional
        For results that are arrays, the names of their dimensions.
    chunk : int, optional
        Points of a task and of a file at most. By default tasks have as many as take half a
        second, files (Zarr's shards) as many as fit into 256 MB. A task that takes longer than 2 s
        hands back what it has and is parted.
    in_flight : int, optional
        Tasks that are handed out at a time; by default two for each worker.
    resume : bool, optional
        With None, an existing study in the folder `out` is resumed if it is identical; a ValueError
        names the difference: fixed arguments, the function, its source and state (defaults,
        closure, the object of a method), ... True goes on even if the text of the function or the
        version of zivi has changed, and requires that there is one; False that there is none. If
        all points of the folder are among `points`, only the new ones are computed: values may be
        added to any parameter, in any order. The folder is then written again, which takes its size
        once more while it lasts. Points of a function with ``seed`` or ``rng`` must keep their
        numbers: append values to a list or to the first parameter of a grid.
    retry_failed : bool
        Compute the points again that failed in an earlier run.
    progress : bool, optional
        Show a progress bar on standard error once the study lasts longer than a second. By default
        only on a terminal.

    Returns
    -------
    Study
        The dataset and the events, read from the folder `out` if given.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range, more than 1e9 points, or another study in the folder, before
        anything is computed; a TypeError also for values without a digest, such as an open file in
        `fixed`. A ValueError after the first point if the dimensions of the results do not fit
        together.
    ImportError
        If a library is missing; the message names the extra to install.
    RuntimeError
        If no point could be computed, if workers die again and again, or if another run writes to
        the folder.
    KeyboardInterrupt, concurrent.futures.BrokenExecutor, OSError
        If the run is stopped, which includes a point that raises an exception other than an
        `Exception` (`SystemExit` is a failed point). As with `RuntimeError`, computed results are
        stored; they are in the exception's attribute ``study``. An OSError without it, before
        anything is computed, if the folder has a study whose head is damaged or has arrays that
        zivi does not write.

    See Also
    --------
    open_study : read the folder of a study.
    grid : a full grid of parameters.
    sample : random or quasi-random points.
    simulate_batch : batches of one system, faster.

    Notes
    -----
    Points are computed in chunks, which are written atomically; a stopped study loses at most its
    unfinished tasks.

    Examples
    --------
    >>> def bounce(e, v):
    ...     ball = zivi.ImpactSystem(-9.81, e=e)
    ...     return zivi.simulate(ball, (0, 30), (1, v))
    >>> study = zivi.sweep(bounce, {"e": [0.3, 0.5, 0.7], "v": [0.0, 2.0]}, units={"v": "m/s"})
    >>> dict(study.sizes)
    {'e': 3, 'v': 2}
    >>> round(float(study.rest_time.sel(e=0.5, v=0.0)), 6)
    1.354571

    Many points at a time:

    >>> def bounces(e, v):
    ...     balls = [zivi.ImpactSystem(-9.81, e=it) for it in e]
    ...     return zivi.simulate_batch(balls, (0, 30), np.column_stack([np.ones(len(v)), v]))
    >>> points = {"e": [0.3, 0.5, 0.7], "v": [0.0, 2.0]}
    >>> same = zivi.sweep(bounces, points, vectorized=True)
    >>> bool(np.all(same.rest_time == study.rest_time))
    True
    """
    work = experiment(function) if isinstance(function, str) else function
    design = design_of(points)
    constants = dict(fixed or {})
    wants = _wants(work, design, constants)
    if not isinstance(vectorized, bool):
        raise TypeError(f"vectorized must be True or False, got {vectorized!r}")
    if chunk is not None and integer("chunk", chunk) < 1:
        raise ValueError(f"chunk must be >= 1, got {chunk}")
    if seed is not None and not 0 <= integer("seed", seed) <= MAX_SEED:
        raise ValueError(f"seed must be >= 0 and fit into 63 bits, got {seed}")
    labels = _result_labels(work, units, dims)
    labels.check_names(design.names)
    pool = pool_of(executor, workers)
    try:
        number = _max_in_flight(in_flight, pool)
        told = identity(
            work,
            design,
            constants,
            None if seed is None else int(seed),
            None if chunk is None else int(chunk),
            vectorized=vectorized,
            faithful=out is not None,
        )
        store = _store(out, design, told, labels, resume, draws=bool(wants))
    except BaseException:
        pool.close(at_once=True)
        raise
    job = Job(work, design.names, constants, store.identity["seed"], wants, vectorized)
    driver = Driver(job, design, store, pool, number)
    return _run_study(driver, store, pool, job, retry_failed, progress)


def _run_study(
    driver: Driver, store: Store, pool: Pool, job: Job, retry_failed: bool, progress: bool | None
) -> Study:
    at_once = True
    try:
        if pool.spreads:
            sendable(job)
        with ProgressBar(progress, "sweep") as bar:
            driver.run(retry_failed=bool(retry_failed), bar=bar)
        at_once = False
        if driver.n_failed and driver.n_failed == driver.computed and store.schema is None:
            raise RuntimeError(
                f"all {driver.n_failed} points failed, one of them: {driver.first_failure}"
            )
    except BaseException as error:
        pool.close(at_once=at_once)
        store.close()
        raise _with_study(error, store) from None
    pool.close(at_once=False)
    store.close()
    return study_of(store)


def _with_study(error: BaseException, store: Store) -> BaseException:
    """Attach what was computed to the exception that ended a run."""
    with contextlib.suppress(Exception):
        study = study_of(store)
        known = count_points(store, StudyStatus.COMPLETED, StudyStatus.FAILED)
        error.study = study  # type: ignore[attr-defined]
        where = "" if study.path is None else f" and in {study.path}"
        error.add_note(
            f"zivi: the study stopped, {known} of {math.prod(store.layout.shape)} "
            f"points are known; they are in this exception's attribute 'study'{where}."
        )
    return error


def _wants(
    function: Callable[..., Any], design: Design, fixed: Mapping[str, Any]
) -> tuple[str, ...]:
    """Return which of ``seed`` and ``rng`` a function accepts; check that it is callable."""
    if not callable(function):
        raise TypeError(f"function must be callable or the name of an experiment, got {function!r}")
    if not all(isinstance(name, str) for name in fixed):
        raise TypeError(f"fixed must have names of arguments as keys, got {list(fixed)!r}")
    twice = set(design.names) & set(fixed)
    if twice:
        raise ValueError(f"fixed has parameters of the study: {', '.join(sorted(twice))}")
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some built-in functions have none
        return ()
    given = {*design.names, *fixed}
    wants = tuple(
        name
        for name in GIVEN
        if name not in given
        and name in signature.parameters
        and signature.parameters[name].kind
        in (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    )
    try:
        signature.bind(**dict.fromkeys((*given, *wants)))
    except TypeError as error:
        raise TypeError(
            f"the function cannot be called with the parameters {', '.join(design.names)}: {error}"
        ) from None
    return wants


def _result_labels(
    function: Any,
    units: Mapping[str, str] | None,
    dims: Mapping[str, Sequence[str]] | None,
) -> Labels:
    own = getattr(function, "units", None)
    known = {**(own if isinstance(own, Mapping) else {}), **(units or {})}
    for name, names in (dims or {}).items():
        if not isinstance(names, Sequence):
            raise TypeError(f"dims[{name!r}] must be a list of names, got {names!r}")
    return Labels(known, dims or {})


def _max_in_flight(given: int | None, pool: Pool) -> int:
    if given is None:
        return 2 * pool.workers
    if integer("in_flight", given) < 1:
        raise ValueError(f"in_flight must be >= 1, got {given}")
    return int(given)


def _store(
    out: str | PathLike[str] | None,
    design: Design,
    told: dict[str, Any],
    labels: Labels,
    resume: bool | None,
    *,
    draws: bool,
) -> Store:
    if resume not in (None, True, False):
        raise TypeError(f"resume must be True, False or None, got {resume!r}")
    path = None if out is None else Path(out)
    if path is None and resume:
        raise ValueError("resume=True needs a folder, out=...")
    if path is not None:
        put_back(path)
    if path is not None and path.exists() and not _is_empty_folder(path):
        return _continued(path, design, told, resume, draws=draws)
    if path is not None and resume:
        raise FileNotFoundError(f"resume=True, but {path} does not contain a study")
    new = dict(told)
    if draws and new["seed"] is None:
        new["seed"] = int(np.random.SeedSequence().generate_state(1, np.uint64)[0] >> 1)
    if path is None:
        return MemoryStore(design, Chunks(design.shape, new["chunk"], sharded=True), new, labels)
    if not create(path, design, new, labels):
        return _continued(path, design, told, resume, draws=draws)  # another run was quicker
    return FolderStore(path, write=True)


def _is_empty_folder(path: Path) -> bool:
    return path.is_dir() and not any(path.iterdir())


def _continued(
    path: Path, design: Design, told: dict[str, Any], resume: bool | None, *, draws: bool
) -> Store:
    if resume is False:
        raise FileExistsError(
            f"resume is False, but {path} exists; choose another folder, or delete it"
        )
    found = differences(read_head(path).identity, told, mild=bool(resume))
    if found.keys() - POINTS:
        hint = (
            ""
            if resume
            else "; resume=True goes on when only the text of the function, what it uses or the "
            "version differs"
        )
        raise ValueError(f"{path} has another study: {'; '.join(found.values())}{hint}")
    store = FolderStore(path, write=True)
    try:
        if found:
            return extended(store, design, "; ".join(found.values()), draws=draws)
        store.mend(design)
        store.forget_damaged()
    except BaseException:
        store.close()
        raise
    return store
