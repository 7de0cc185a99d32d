"""What a worker does: the points of one task, until its time is up."""

from __future__ import annotations

import contextlib
import dataclasses
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.study.collect import Collector
from zivi.study.messages import message_of
from zivi.study.piece import Piece
from zivi.study.seeds import child, generators, seeds

__all__ = ["MAX_SEED", "SLICE", "Gate", "Job", "begin_thread", "compute", "is_ready"]

SLICE = 2.0
"""Seconds after which a task hands back what it has: no more than that is lost with a worker."""
MAX_SEED = 2**63 - 1
"""Largest seed of a study."""


class Gate:
    """Ctrl-C comes through only where it is open: what was computed is not lost on its way.

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
        self._outer: Gate | None = None

    def __enter__(self) -> Gate:
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
        """Answer what was heard while it was closed."""
        if self._heard:
            self._heard = False
            self._before(signal.SIGINT, None)

    @contextlib.contextmanager
    def opened(self) -> Iterator[None]:
        """Open it for what changes nothing."""
        self.open = True
        try:
            self.look()
            yield
        finally:
            self.open = False


@dataclasses.dataclass(frozen=True)
class Job:
    """What is computed at every point.

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
            # copies, since a function may write to what it gets
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


def _gate() -> Gate:
    """Give that of the study whose points this thread itself computes."""
    return getattr(_thread, "gate", None) or Gate()


def begin_thread(stopped: threading.Event) -> None:
    """Let this thread look, after each point, whether it must stop."""
    _thread.stopped = stopped


_thread = threading.local()
"""What this thread reads: whether a pool of ours was stopped, the gate of a study."""


def is_ready(job: Job) -> bool:
    """Tell that a worker has understood what to do."""
    return callable(job.function)
