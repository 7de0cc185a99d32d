"""One call from a function and its points to the results."""

from __future__ import annotations

import contextlib
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from zivi.base.check import integer
from zivi.base.extras import ProgressBar
from zivi.base.habits import hinted
from zivi.base.status import StudyStatus
from zivi.study.design import Design, design_of
from zivi.study.digest import differences, identity
from zivi.study.drive import Driver
from zivi.study.experiments import experiment
from zivi.study.extend import extended, put_back
from zivi.study.folder import FolderStore, create
from zivi.study.head import read_head
from zivi.study.pools import MAX_SEED, Job, Pool, pool_of, sendable
from zivi.study.result import Study, study_of
from zivi.study.store import Chunks, Labels, MemoryStore, Store, count_points

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
        raise FileExistsError(f"resume=False, but there is something at {path}")
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
