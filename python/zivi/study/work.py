"""What a worker does: the points of one task, until its time is up."""

from __future__ import annotations

import dataclasses
import threading
import time
import unicodedata
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.study.design import name_of
from zivi.study.outcome import Events, Values, split, units_of

__all__ = [
    "MAX_SEED",
    "SLICE",
    "Job",
    "Piece",
    "Schema",
    "child",
    "compute",
]

SLICE = 2.0
"""Seconds after which a task hands back what it has: no more than that is lost with a worker."""
LONGEST = 1000
"""Characters of a message that are kept."""
MAX_SEED = 2**63 - 1
"""Largest seed of a study."""


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
    """

    function: Callable[..., Any]
    names: tuple[str, ...]
    fixed: dict[str, Any]
    seed: int | None
    wants: tuple[str, ...]

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


def child(seed: int | None, point: int) -> np.random.SeedSequence:
    """Give what ``SeedSequence(seed).spawn(n)[point]`` is."""
    return np.random.SeedSequence(seed, spawn_key=(point,))


@dataclasses.dataclass(frozen=True)
class Schema:
    """What every point gives.

    Parameters
    ----------
    shapes : dict
        For each value its name and its shape.
    has_events : bool
        Whether a point gives events.
    units : dict
        Units that are known from the kind of the result.
    """

    shapes: dict[str, tuple[int, ...]]
    has_events: bool
    units: dict[str, str]


@dataclasses.dataclass
class Piece:
    """What a task gives back: some of its points.

    Parameters
    ----------
    schema : Schema or None
        What the points gave; None if none was done.
    done : ndarray of int
        Numbers of the points that are done.
    values : dict of ndarray
        Their values, one row a point.
    events : dict of ndarray
        The events of those that have some.
    failed : dict of str
        Numbers of the points that failed, and why.
    rest : ndarray of int
        Numbers of the points that were not computed.
    interrupted : bool
        Whether Ctrl-C reached the task.
    """

    schema: Schema | None
    done: NDArray[np.int64]
    values: dict[str, Array]
    events: dict[int, Events]
    failed: dict[int, str]
    rest: NDArray[np.int64]
    interrupted: bool = False


class _Collector:
    """Puts the results of points together, if they are alike."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self._rows: list[Values] = []
        self.schema: Schema | None = None
        self.dtype: np.dtype[Any] | None = None
        self.done: list[int] = []
        self.events: dict[int, Events] = {}
        self.failed: dict[int, str] = {}

    def add(self, point: int, returned: Any) -> None:
        values, events, has_events = split(returned)
        shapes = {name: np.shape(value) for name, value in values.items()}
        if self.schema is None:
            for name in shapes:
                if name_of("result", name) in self._job.names:
                    raise ValueError(f"the result {name!r} has the name of a parameter")
            self.schema = Schema(shapes, has_events, units_of(returned))
        alike(self.schema, shapes, has_events)
        if events is not None:
            if self.dtype not in (None, events.dtype):
                raise ValueError(f"events have {events.dtype}, those of others {self.dtype}")
            self.dtype = events.dtype
        if events is not None and len(events):
            self.events[point] = events.copy()
        self._rows.append(values)
        self.done.append(point)

    def piece(self, rest: NDArray[np.int64], interrupted: bool) -> Piece:
        names = self.schema.shapes if self.schema else ()
        return Piece(
            schema=self.schema,
            done=np.array(self.done, np.int64),
            values={name: np.array([row[name] for row in self._rows], float) for name in names},
            events=self.events,
            failed=self.failed,
            rest=rest,
            interrupted=interrupted,
        )


def alike(schema: Schema, shapes: dict[str, tuple[int, ...]], has_events: bool) -> None:
    """Raise if what a point gave is not what the others give."""
    if shapes != schema.shapes:
        raise ValueError(f"returned {_shown(shapes)}; other points gave {_shown(schema.shapes)}")
    if has_events != schema.has_events:
        raise ValueError("either all points return (values, events) or none does")


def _shown(shapes: dict[str, tuple[int, ...]]) -> str:
    return ", ".join(f"{name} {shape}" if shape else name for name, shape in shapes.items())


def compute(job: Job, points: NDArray[np.int64], columns: dict[str, list[Any]]) -> Piece:
    """Compute points one after the other, until all are done, the time is up or all must stop."""
    found = _Collector(job)
    end = time.monotonic() + SLICE
    stopped = getattr(_thread, "stopped", None) or threading.Event()
    rows = zip(points.tolist(), *columns.values(), strict=True)
    for number, (point, *values) in enumerate(rows):
        if number and (stopped.is_set() or time.monotonic() > end):
            return found.piece(points[number:], interrupted=False)
        try:
            found.add(point, job.call(point, tuple(values)))
        except KeyboardInterrupt:
            return found.piece(points[number:], interrupted=True)
        except (Exception, SystemExit) as error:
            found.failed[point] = message_of(error)
    return found.piece(points[:0], interrupted=False)


def begin_thread(stopped: threading.Event) -> None:
    """Let this thread look, after each point, whether it must stop."""
    _thread.stopped = stopped


_thread = threading.local()
"""What a thread of a pool of ours looks at."""


def lives(job: Job) -> bool:
    """Tell that a worker has understood what to do."""
    return callable(job.function)


def message_of(error: BaseException) -> str:
    """Tell an exception in one text, which any file and any terminal can take."""
    try:
        text = f"{type(error).__name__}: {error}"[:LONGEST]
    except Exception as other:  # of its own __str__
        text = f"{type(error).__name__}, whose text raises {type(other).__name__}"
    return "".join(map(_writable, text))[:LONGEST]


def _writable(letter: str) -> str:
    """Escape what is no letter: half a pair of UTF-16, a control character."""
    if letter in "\n\t" or unicodedata.category(letter) not in ("Cc", "Cs"):
        return letter
    return letter.encode("unicode_escape", "surrogatepass").decode("ascii")
