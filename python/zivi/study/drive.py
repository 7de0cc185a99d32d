"""Executors of a study, and the loop that hands out tasks and stores what comes back."""

from __future__ import annotations

import concurrent.futures
import contextlib
import dataclasses
import errno
import math
import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import integer
from zivi.base.extras import ProgressBar
from zivi.base.status import StudyStatus
from zivi.study.design import Design, child, generators, seeds
from zivi.study.outcome import Collector, Piece, check_same_schema, message_of
from zivi.study.store import Block, Store, count_points

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


# Drives a study: hands out tasks, takes back pieces, stores them, survives workers that die.


DEATHS = 2
"""Times that a point alone may take its worker with it before it counts as failed."""
BREAKS = 20
"""Pools in a row that may break before anything is computed."""
START = 60.0
"""Seconds that a new worker may take to show that it is ready."""
FIRST, SHARES = 1024, 64
"""Points of the first tasks at most, and parts of the study that they are at most."""
LONG, MOST, GROWTH = 0.5, 2**17, 4
"""Seconds that a task should take, points that it has at most, how much more it has than others."""
OPEN = 4
"""Shards that are in memory at a time, as long as each has many tasks."""
SAVING = 20.0
"""Chunks that are not done are saved so seldom that the rest takes so many times longer."""


@dataclasses.dataclass
class Task:
    """Points that one worker computes."""

    points: NDArray[np.int64]
    deaths: int = 0

    def halves(self) -> list[Task]:
        """Split the points in two."""
        middle = len(self.points) // 2
        return [Task(part) for part in (self.points[:middle], self.points[middle:])]


class Driver:
    """One run of a study.

    Parameters
    ----------
    job : Job
        What is computed.
    design : Design
        Where.
    store : Store
        Where it goes.
    pool : Pool
        Who computes it.
    in_flight : int
        Tasks that are handed out at a time.
    """

    def __init__(self, job: Job, design: Design, store: Store, pool: Pool, in_flight: int) -> None:
        self._job, self._design, self._store, self._pool = job, design, store, pool
        self._in_flight = 1 if pool.inline else in_flight
        self._fresh: Iterator[Task] = iter(())
        self._queue: deque[Task] = deque()
        self._suspects: deque[Task] = deque()
        self._running: dict[concurrent.futures.Future[Piece], Task] = {}
        # the chunks that are in memory, the points of each that are handed out or will be next,
        # and those with results that are not saved
        self._blocks: dict[int, Block] = {}
        self._left: Counter[int] = Counter()
        self._unsaved: set[int] = set()
        self._due = time.monotonic() + LONG
        self._next_point = 0
        self._wanted: tuple[int, ...] = ()
        total = len(design)
        self._given = store.layout.points
        self._size = self._given or min(FIRST, math.ceil(total / SHARES))
        self._events: np.dtype[Any] | None = None
        self._breaks = 0
        self._gate = SignalGate()
        self._raised: BaseException | None = None
        self.computed = 0
        self.first_failure: str | None = None
        self.n_failed = 0

    def run(self, *, retry_failed: bool, bar: ProgressBar) -> None:
        """Compute all points that are missing."""
        retried = (StudyStatus.FAILED,) if retry_failed else ()
        self._wanted = (StudyStatus.MISSING, *retried)
        total = len(self._design)
        before = count_points(self._store, *(set(StudyStatus) - set(self._wanted)))
        self._fresh = self._tasks(0)
        with self._gate:
            self._drive(before, total, bar)

    def _drive(self, before: int, total: int, bar: ProgressBar) -> None:
        try:
            while self._raised is None and self._hand_out():
                with self._gate.opened():
                    done, _ = concurrent.futures.wait(
                        self._running, SLICE, return_when=concurrent.futures.FIRST_COMPLETED
                    )
                if not done and self._pool.broken:
                    self._broken([], alone=len(self._running) == 1)
                self._collect(done)
                if bar.report is not None:
                    bar.report(before + self.computed, total)
            if self._raised is not None:
                raise self._raised
        except BaseException:
            self._save_what_is_there()
            raise

    def _tasks(self, start: int) -> Iterator[Task]:
        """Cut the points that are missing into tasks, those before `start` left out."""
        layout = self._store.layout
        first = layout.chunks_of(np.array([start]))[0] if start < len(self._design) else len(layout)
        for chunk in range(first, len(layout)):
            span = layout.span(chunk)
            status = self._store.status_of(chunk)
            points = span.start + np.flatnonzero(np.isin(status, self._wanted))
            points = points[points >= start]
            self._left[chunk] += len(points)
            while len(points):
                size = self._points_of_a_task()
                task, points = Task(points[:size]), points[size:]
                self._next_point = int(task.points[-1]) + 1
                yield task
            if not self._left[chunk]:
                del self._left[chunk]

    def _points_of_a_task(self) -> int:
        """Return the number of points of the next task, small enough to keep all workers busy."""
        if self._given is not None:
            return self._given
        shared = len(self._design) / (4 * self._in_flight)
        open_ = OPEN * self._store.layout.room / (2 * self._in_flight)
        return max(1, min(self._size, MOST, math.ceil(min(shared, open_))))

    def _learn(self, piece: Piece) -> None:
        """Adapt the task size to about half a second."""
        cost = max(piece.seconds, 1e-9) / max(1, len(piece))
        longest = max(1.0, min(LONG / cost, MOST))
        self._size = int(min(max(longest, self._size / GROWTH), self._size * GROWTH))

    def _next(self) -> Task | None:
        # a task that may have killed its worker runs alone, so that one knows
        if self._suspects:
            return None if self._running else self._suspects.popleft()
        if self._queue:
            return self._queue.popleft()
        layout = self._store.layout
        most = max(OPEN, self._in_flight // layout.room) if layout.has_shards else math.inf
        # bounds the memory: a chunk stays until its slowest point is there
        return None if self._running and len(self._left) > most else next(self._fresh, None)

    def _hand_out(self) -> bool:
        """Submit tasks up to the limit; return whether any is running."""
        while len(self._running) < self._in_flight:
            task = self._next()
            if task is None:
                break
            try:
                future = self._submit(task)
            except concurrent.futures.BrokenExecutor:
                self._suspects.append(task)
                self._broken([])
                continue
            self._running[future] = task
            if self._pool.inline:
                break
        return bool(self._running)

    def _submit(self, task: Task) -> concurrent.futures.Future[Piece]:
        columns = self._design.columns(task.points)
        return self._send(compute, self._job, task.points, columns)

    def _send(self, function: Any, *arguments: Any) -> concurrent.futures.Future[Any]:
        executor: concurrent.futures.Executor = self._pool.executor
        try:
            return executor.submit(function, *arguments)
        except OSError as error:
            # a process pool that breaks meanwhile closes the files that starting a worker needs
            if error.errno != errno.EBADF or not self._pool.ours:
                raise
            raise concurrent.futures.BrokenExecutor(str(error)) from error

    def _collect(self, done: set[concurrent.futures.Future[Piece]]) -> None:
        alone = len(self._running) == 1
        dead: list[Task] = []
        for future in done:
            task = self._running.pop(future)
            try:
                piece = future.result()
            except concurrent.futures.BrokenExecutor:
                dead.append(task)
            except Exception as error:
                if type(error).__name__ != "KilledWorker":
                    raise
                self._died(task)  # Dask has tried it on several workers
            else:
                self._take(task, piece)
        if dead:
            self._broken(dead, alone=alone)

    def _broken(self, dead: list[Task], *, alone: bool = False) -> None:
        """Continue with a new pool, and find the point that crashed the last one."""
        if not self._pool.ours:
            raise concurrent.futures.BrokenExecutor(
                "a worker died, and the executor cannot be used any more; make the same call with "
                "a new executor: only missing points are computed"
            )
        # all that was in flight is lost or done by now
        with self._gate.opened():
            concurrent.futures.wait(self._running, SLICE)
        left, self._running = self._running, {}
        for future, task in left.items():
            try:
                piece = future.result(timeout=0)
            except (Exception, concurrent.futures.CancelledError):
                dead.append(task)
            else:
                self._take(task, piece)
        self._breaks += 1
        if self._breaks > BREAKS:
            raise RuntimeError(
                f"workers died {self._breaks} times in a row before a point was computed"
            )
        self._pool.renew()
        self._see_it_live()
        if alone and len(dead) == 1:
            self._died(dead[0])
        else:
            self._suspects.extend(dead)

    def _see_it_live(self) -> None:
        """Raise if a new worker cannot receive its task."""
        try:
            with self._gate.opened():
                self._send(is_ready, self._job).result(START)
        except (concurrent.futures.BrokenExecutor, TimeoutError) as error:
            raise RuntimeError(
                "the workers die before they compute anything: can they import the function, is "
                "the script guarded by if __name__ == '__main__', is there enough memory?"
            ) from error

    def _died(self, task: Task) -> None:
        """Narrow a task down that took its worker with it, alone."""
        if len(task.points) > 1:
            self._suspects.extendleft(reversed(task.halves()))
            return
        task.deaths += 1
        if task.deaths < DEATHS:
            self._suspects.appendleft(task)
            return
        point = int(task.points[0])
        nothing = np.empty(0, np.int64)
        message = f"the worker died while it computed this point ({task.deaths} times)"
        self._take(task, Piece(None, nothing, {}, None, {point: message}, nothing))

    def _take(self, task: Task, piece: Piece) -> None:
        """Keep what a task gave back, and queue what it left."""
        if len(piece.done):
            self._fit(task, piece)
        self._learn(piece)
        for chunk in self._store.layout.chunks_of(task.points):
            self._put(chunk, piece.within(self._store.layout.span(chunk)))
        self._save_if_due()
        self.computed += len(piece)
        if len(piece) and not task.deaths:
            self._breaks = 0
        if piece.failed:
            self.n_failed += len(piece.failed)
            self.first_failure = self.first_failure or next(iter(piece.failed.values()))
        self._raised = self._raised or piece.raised
        if len(piece.rest):
            rest = Task(piece.rest)
            # so that a task of slow points is shared
            self._queue.extend(rest.halves() if len(piece.rest) > 1 else [rest])

    def _put(self, chunk: int, piece: Piece) -> None:
        """Write results to a chunk, and save it if complete."""
        block = self._blocks.get(chunk)
        if block is None:
            block = self._blocks[chunk] = self._store.load(chunk)
        if self._store.schema is not None:
            block.shaped(self._store.schema)
        self._unsaved.add(chunk)
        block.take(piece)
        self._left[chunk] -= len(piece)
        if self._left[chunk] <= 0:
            self._save(chunk)
            del self._blocks[chunk], self._left[chunk]

    def _fit(self, task: Task, piece: Piece) -> None:
        """Make room for the first results; turn later ones that differ into failures."""
        assert piece.schema is not None
        if self._store.schema is None:
            layout = self._store.layout
            self._save_all()
            self._blocks.clear()
            self._store.define(piece.schema)
            if self._store.layout != layout:
                self._cut_again(task)
        schema = self._store.schema
        assert schema is not None
        try:
            check_same_schema(schema, piece.schema.shapes, piece.schema.has_events)
            if piece.events is not None:
                dtype = piece.events[1].dtype
                self._events = self._events or dtype
                if dtype != self._events:
                    raise ValueError(f"events have {dtype}, those of others {self._events}")
        except ValueError as error:
            piece.fail(message_of(error))

    def _cut_again(self, task: Task) -> None:
        """Continue with other chunks after the size of the results has become known."""
        out = (task, *self._running.values(), *self._queue, *self._suspects)
        points = np.concatenate([it.points for it in out])
        self._left = Counter(self._store.layout.chunk_of(points).tolist())
        self._fresh = self._tasks(self._next_point)

    def _save(self, chunk: int) -> None:
        self._store.save(chunk, self._blocks[chunk])
        self._unsaved.discard(chunk)

    def _save_all(self) -> None:
        for chunk in list(self._unsaved):
            self._save(chunk)

    def _save_if_due(self) -> None:
        """Save chunks that are not done, but not so often that it costs much."""
        start = time.monotonic()
        if self._unsaved and start > self._due:
            self._save_all()
            end = time.monotonic()
            self._due = end + SAVING * (end - start)

    def _save_what_is_there(self) -> None:
        """After Ctrl-C or an error: store results that are complete or about to be."""
        self._pool.stop()
        self._save_all()
        for future in self._running:
            future.cancel()
        done, _ = concurrent.futures.wait(self._running, timeout=2 * SLICE)
        for future in done:
            # what fails now is missing, as if it had not been handed out
            with contextlib.suppress(Exception, concurrent.futures.CancelledError):
                self._take(self._running[future], future.result())
        self._save_all()
