"""Drives a study: hands out tasks, takes back pieces, stores them, survives workers that die."""

from __future__ import annotations

import concurrent.futures
import contextlib
import dataclasses
from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.progress import ProgressBar
from zivi.base.status import StudyStatus
from zivi.study.block import Block
from zivi.study.design import Design
from zivi.study.pools import Pool
from zivi.study.store import Store
from zivi.study.work import SLICE, Job, Piece, alike, compute, lives, message_of

__all__ = ["Driver"]

DEATHS = 2
"""Times that a point alone may take its worker with it before it counts as failed."""
BREAKS = 20
"""Pools in a row that may break before anything is computed."""
START = 60.0
"""Seconds that a new worker may take to show that it lives."""


@dataclasses.dataclass
class Task:
    """Points of one chunk that one worker computes."""

    chunk: int
    points: NDArray[np.int64]
    deaths: int = 0

    def halves(self) -> list[Task]:
        """Part the points in two."""
        middle = len(self.points) // 2
        return [Task(self.chunk, part) for part in (self.points[:middle], self.points[middle:])]


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
        self._blocks: dict[int, Block] = {}
        self._missing: dict[int, int] = {}
        self._unsaved: set[int] = set()
        self._events: np.dtype[Any] | None = None
        self._breaks = 0
        self.computed = 0
        self.first_failure: str | None = None
        self.n_failed = 0

    def run(self, *, retry_failed: bool, bar: ProgressBar) -> None:
        """Compute all points that are missing."""
        status = self._store.status()
        before, total = int(np.count_nonzero(status)), len(status)
        if retry_failed:
            before -= int(np.count_nonzero(status == StudyStatus.FAILED))
        retried = (StudyStatus.FAILED,) if retry_failed else ()
        wanted = (StudyStatus.MISSING, *retried)
        self._fresh = self._tasks(status, wanted)
        try:
            while self._hand_out():
                done, _ = concurrent.futures.wait(
                    self._running, SLICE, return_when=concurrent.futures.FIRST_COMPLETED
                )
                if not done and self._pool.broken:
                    self._broken([], alone=len(self._running) == 1)
                self._collect(done)
                if bar.report is not None:
                    bar.report(before + self.computed, total)
        except BaseException:
            self._save_what_is_there()
            raise

    def _tasks(self, status: NDArray[np.int8], wanted: tuple[int, ...]) -> Iterator[Task]:
        layout = self._store.layout
        for chunk in range(len(layout)):
            span = layout.span(chunk)
            points = span.start + np.flatnonzero(np.isin(status[span.start : span.stop], wanted))
            if len(points):
                self._blocks[chunk] = self._store.load(chunk)
                self._missing[chunk] = len(points)
                yield Task(chunk, points)

    def _next(self) -> Task | None:
        # a task that may have killed its worker runs alone, so that one knows
        if self._suspects:
            return None if self._running else self._suspects.popleft()
        return self._queue.popleft() if self._queue else next(self._fresh, None)

    def _hand_out(self) -> bool:
        """Fill up what is in flight, and tell whether anything is."""
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
        executor: concurrent.futures.Executor = self._pool.executor
        return executor.submit(compute, self._job, task.points, columns)

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
        """Go on with a new pool, and find the point that took the last one with it."""
        if not self._pool.ours:
            raise concurrent.futures.BrokenExecutor(
                "a worker died and with it the executor, which is not zivi's to replace: call "
                "again with a new one, only what is missing is computed"
            )
        # all that was in flight is lost or done by now
        left, self._running = self._running, {}
        concurrent.futures.wait(left, SLICE)
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
        """Raise if a new worker cannot even be told what to do."""
        try:
            self._pool.executor.submit(lives, self._job).result(START)
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
        self._take(task, Piece(None, nothing, {}, {}, {point: message}, nothing))

    def _take(self, task: Task, piece: Piece) -> None:
        """Store what a task gave back, and queue what it left."""
        block = self._blocks[task.chunk]
        if len(piece.done):
            self._fit(piece)
        if self._store.schema is not None:
            block.shaped(self._store.schema)
        found = len(piece.done) + len(piece.failed)
        self._unsaved.add(task.chunk)
        block.take(piece)
        self._save(task.chunk)
        self.computed += found
        self._missing[task.chunk] -= found
        if not self._missing[task.chunk]:
            del self._blocks[task.chunk], self._missing[task.chunk]
        if found and not task.deaths:
            self._breaks = 0
        if piece.failed:
            self.n_failed += len(piece.failed)
            self.first_failure = self.first_failure or next(iter(piece.failed.values()))
        if piece.interrupted and self._pool.inline:
            raise KeyboardInterrupt
        if len(piece.rest):
            rest = Task(task.chunk, piece.rest)
            # so that a chunk of slow points is shared
            self._queue.extend(rest.halves() if len(piece.rest) > 1 else [rest])

    def _fit(self, piece: Piece) -> None:
        """Make room for the first results; turn later ones that differ into failures."""
        assert piece.schema is not None
        if self._store.schema is None:
            self._store.define(piece.schema)
        schema = self._store.schema
        assert schema is not None
        dtypes = {events.dtype for events in piece.events.values()}
        try:
            alike(schema, piece.schema.shapes, piece.schema.has_events)
            self._events = self._events or next(iter(dtypes), None)
            if dtypes - {self._events}:
                raise ValueError(f"events have {dtypes.pop()}, those of others {self._events}")
        except ValueError as error:
            piece.failed |= dict.fromkeys(piece.done.tolist(), message_of(error))
            piece.done, piece.values, piece.events = piece.done[:0], {}, {}

    def _save(self, chunk: int) -> None:
        self._store.save(chunk, self._blocks[chunk])
        self._unsaved.discard(chunk)

    def _save_what_is_there(self) -> None:
        """After Ctrl-C or an error: keep what is done or will be in a moment."""
        self._pool.stop()
        for chunk in list(self._unsaved):
            self._save(chunk)
        for future in self._running:
            future.cancel()
        done, _ = concurrent.futures.wait(self._running, timeout=2 * SLICE)
        for future in done:
            # what fails now is missing, as if it had not been handed out
            with contextlib.suppress(Exception, concurrent.futures.CancelledError):
                self._take(self._running[future], future.result())
