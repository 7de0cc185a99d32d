"""Executors (inline, threads, processes, of the user) and the work of a worker."""

from __future__ import annotations

import concurrent.futures
import contextlib
import dataclasses
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import integer
from zivi.study.design import child, generators, seeds
from zivi.study.outcome import Collector, Piece, message_of

# Work of a worker: the points of one task, until its time is up.

SLICE = 2.0
"""Seconds after which a task hands back what it has: no more than that is lost with a worker."""
MAX_SEED = 2**63 - 1
"""Largest seed of a study."""


class SignalGate:
    """Delays Ctrl-C while closed, so that computed results are not lost.

    It holds within ``with``, in the main thread, if Ctrl-C calls a function of Python there.

    Attributes
    ----------
    open : bool
        Whether Ctrl-C comes through; one that came before does when `look` is called.
    """

    def __init__(self) -> None:
        self.open = False
        self._heard = False
        self._before: Any = None
        self._outer: SignalGate | None = None

    def __enter__(self) -> SignalGate:
        main = threading.current_thread() is threading.main_thread()
        before = signal.getsignal(signal.SIGINT) if main else None
        if callable(before):
            self._before = before
            self._outer = getattr(_thread, "gate", None)
            _thread.gate = self
            signal.signal(signal.SIGINT, self._answer)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None
    ) -> None:
        if self._before is not None:
            _thread.gate = self._outer
            signal.signal(signal.SIGINT, self._before)
            if kind is None:  # else the run ends already
                self.look()

    def _answer(self, number: int, frame: Any) -> None:
        if self.open:
            self._before(number, frame)
        else:
            self._heard = True

    def look(self) -> None:
        """Handle a signal that arrived while it was closed."""
        if self._heard:
            self._heard = False
            self._before(signal.SIGINT, None)

    @contextlib.contextmanager
    def opened(self) -> Iterator[None]:
        """Open it for code without side effects."""
        self.open = True
        try:
            self.look()
            yield
        finally:
            self.open = False


@dataclasses.dataclass(frozen=True)
class Job:
    """Computation at every point.

    Parameters
    ----------
    function : callable
        Called with the parameters of a point by name.
    names : tuple of str
        Names of the parameters.
    fixed : dict
        Further arguments, the same at all points.
    seed : int or None
        Seed of the study.
    wants : tuple of str
        Which of ``seed`` and ``rng`` the function takes.
    vectorized : bool
        Whether the function takes arrays, with an entry for each of many points.
    """

    function: Callable[..., Any]
    names: tuple[str, ...]
    fixed: dict[str, Any]
    seed: int | None
    wants: tuple[str, ...]
    vectorized: bool = False

    def call(self, point: int, values: tuple[Any, ...]) -> Any:
        """Compute one point."""
        arguments = dict(zip(self.names, values, strict=True))
        if self.wants:
            source = child(self.seed, point)
            if "seed" in self.wants:
                arguments["seed"] = int(source.generate_state(1, np.uint64)[0])
            if "rng" in self.wants:
                arguments["rng"] = np.random.default_rng(source)
        return self.function(**self.fixed, **arguments)

    def call_many(self, points: NDArray[np.int64], columns: Mapping[str, NDArray[Any]]) -> Any:
        """Compute several points in one call."""
        arguments: dict[str, Any] = dict(columns)
        if "seed" in self.wants:
            arguments["seed"] = seeds(self.seed, points)
        if "rng" in self.wants:
            arguments["rng"] = generators(self.seed, points)
        return self.function(**self.fixed, **arguments)


def compute(job: Job, points: NDArray[np.int64], columns: Mapping[str, NDArray[Any]]) -> Piece:
    """Compute points until all are done, the time is up or all must stop."""
    return (_compute_many if job.vectorized else _compute_each)(job, points, columns)


def _compute_each(
    job: Job, points: NDArray[np.int64], columns: Mapping[str, NDArray[Any]]
) -> Piece:
    found, gate = Collector(job.names), _gate()
    plain = [column.tolist() for column in columns.values()]
    rows = zip(points.tolist(), *plain, strict=True)
    for number, (point, *values) in enumerate(rows):
        if number and (_must_stop() or found.seconds > SLICE):
            return found.piece(points[number:])
        try:
            try:  # no context manager: points may be short
                gate.open = True
                gate.look()
                value = job.call(point, tuple(values))
            finally:
                gate.open = False
            found.add(point, value)
        except BaseException as error:
            if not isinstance(error, (Exception, SystemExit)):
                return found.piece(points[number:], error)
            found.failed[point] = message_of(error)
    return found.piece(points[:0])


def _compute_many(
    job: Job, points: NDArray[np.int64], columns: Mapping[str, NDArray[Any]]
) -> Piece:
    """Compute points in one call; those of a call that raises in halves, down to the culprits."""
    found, gate = Collector(job.names), _gate()
    todo, calls = [slice(0, len(points))], 0
    while todo:
        part = todo.pop()
        if calls and (_must_stop() or found.seconds > SLICE):
            return found.piece(points[part.start :])
        calls += 1
        try:
            # copies, since a function may modify its arguments
            own = {name: column[part].copy() for name, column in columns.items()}
            with gate.opened():
                values = job.call_many(points[part], own)
            found.add_many(points[part], values)
        except BaseException as error:
            if not isinstance(error, (Exception, SystemExit)):
                return found.piece(points[part.start :], error)
            if part.stop - part.start == 1:
                found.failed[int(points[part.start])] = message_of(error)
                continue
            middle = (part.start + part.stop) // 2
            todo += [slice(middle, part.stop), slice(part.start, middle)]
    return found.piece(points[:0])


def _must_stop() -> bool:
    stopped = getattr(_thread, "stopped", None)
    return stopped is not None and stopped.is_set()


def _gate() -> SignalGate:
    """Return that of the study whose points this thread itself computes."""
    return getattr(_thread, "gate", None) or SignalGate()


def begin_thread(stopped: threading.Event) -> None:
    """Make this thread check after each point whether it must stop."""
    _thread.stopped = stopped


_thread = threading.local()
"""What this thread reads: whether a pool of ours was stopped, the gate of a study."""


def is_ready(job: Job) -> bool:
    """Return whether a worker has received its task."""
    return callable(job.function)


# Executors: this process, threads, processes, or one of the user's.

KINDS = ("threads", "processes")


class Inline(concurrent.futures.Executor):
    """Executor that computes immediately, in this thread."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:
        """Compute and return a future that is done."""
        future: concurrent.futures.Future[Any] = concurrent.futures.Future()
        future.set_result(fn(*args, **kwargs))
        return future


class Pool:
    """An executor with its properties.

    Parameters
    ----------
    executor : Executor
        Runs the tasks.
    workers : int
        How many at a time.
    make : callable, optional
        Makes another one, if the executor is ours.
    stopped : Event, optional
        Event that its threads check after each point.
    """

    def __init__(
        self,
        executor: Any,
        workers: int,
        make: Callable[[], concurrent.futures.Executor] | None = None,
        stopped: threading.Event | None = None,
    ) -> None:
        self.executor = executor
        self.workers = workers
        self._make = make
        self._stopped = stopped or threading.Event()

    @property
    def ours(self) -> bool:
        """Whether a broken executor can be replaced."""
        return self._make is not None

    @property
    def inline(self) -> bool:
        """Whether tasks run in this thread."""
        return isinstance(self.executor, Inline)

    @property
    def spreads(self) -> bool:
        """Whether what is submitted must be pickled by us."""
        return isinstance(self.executor, concurrent.futures.ProcessPoolExecutor)

    @property
    def broken(self) -> bool:
        """Whether a process died; before Python 3.12, futures may then wait indefinitely."""
        return bool(getattr(self.executor, "_broken", False))

    def stop(self) -> None:
        """Make threads return their results after their current point."""
        self._stopped.set()

    def renew(self) -> None:
        """Replace a broken executor."""
        assert self._make is not None
        self._end()
        self.executor = self._make()

    def close(self, *, at_once: bool) -> None:
        """Shut down an executor of ours, with its running tasks if necessary."""
        if self._make is None:
            return
        if at_once:
            self._end()
        else:
            self.executor.shutdown(wait=True)

    def _end(self) -> None:
        """Shut down an executor with all its processes, including one started as it broke."""
        workers = list((getattr(self.executor, "_processes", None) or {}).values())
        self.executor.shutdown(wait=False, cancel_futures=True)
        for process in workers:
            with contextlib.suppress(OSError, ValueError, AttributeError):
                process.terminate()


def pool_of(executor: Any, workers: int | None) -> Pool:
    """Understand what a user gave as an executor."""
    if workers is not None and integer("workers", workers) < 1:
        raise ValueError(f"workers must be >= 1, got {workers}")
    if executor in KINDS:
        number = workers or os.cpu_count() or 1
        stopped = threading.Event()

        def make() -> concurrent.futures.Executor:
            return _threads(number, stopped) if executor == "threads" else _processes(number)

        return Pool(make(), number, make, stopped)
    if workers is not None:
        raise ValueError(f"workers goes with executor='threads' or 'processes', got {executor!r}")
    if executor is None:
        return Pool(Inline(), 1)
    if isinstance(executor, concurrent.futures.Executor):
        return Pool(executor, _workers(executor))
    if callable(getattr(executor, "get_executor", None)):  # a Client of Dask
        return Pool(executor.get_executor(pure=False), _cores(executor))
    raise TypeError(
        "executor must be None, 'threads', 'processes', a concurrent.futures.Executor or a "
        f"dask.distributed.Client, got {executor!r:.100}"
    )


def sendable(job: Job) -> None:
    """Raise if a job cannot be sent to another process."""
    try:
        pickle.dumps(job)
    except Exception as error:
        raise TypeError(
            "the function and its fixed arguments must be picklable for processes: define the "
            "function at the top level of a module, or use threads or Dask "
            f"({type(error).__name__}: {error})"
        ) from error


def _workers(executor: Any) -> int:
    client = getattr(executor, "_client", None)
    if client is not None:
        return _cores(client)
    number = getattr(executor, "_max_workers", None)
    return number if isinstance(number, int) else os.cpu_count() or 1


def _cores(client: Any) -> int:
    return sum(client.nthreads().values()) or 1


def _threads(number: int, stopped: threading.Event) -> concurrent.futures.Executor:
    return concurrent.futures.ThreadPoolExecutor(
        number, thread_name_prefix="zivi", initializer=begin_thread, initargs=(stopped,)
    )


def _processes(number: int) -> concurrent.futures.Executor:
    # not by fork: this process has threads, and a fork copies the locks that they hold
    methods = multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
    return concurrent.futures.ProcessPoolExecutor(number, context, initializer=_initialise_worker)


def _initialise_worker() -> None:
    """Leave Ctrl-C to the parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
