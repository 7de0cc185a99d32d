"""Optional libraries, progress bars, and the end of the interpreter."""

from __future__ import annotations

import atexit
import importlib
import os
import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import zivi._zivi as _zivi

if TYPE_CHECKING:
    import rich.progress

# Libraries that only a part of zivi needs, imported when they are.

EXTRAS = {
    "matplotlib": "plot",
    "xarray": "xarray",
    "pandas": "xarray",
    "rich": "cli",
    "typer": "cli",
    "h5netcdf": "files",
    "zarr": "study",
    "pyarrow": "study",
    "scipy": "study",
    "dask": "dask",
    "distributed": "dask",
    "control": "control",
    "jax": "jax",
    "sympy": "symbolic",
    "mujoco": "mujoco",
    "gymnasium": "gym",
    "marimo": "lab",
    "plotly": "lab",
    "uvicorn": "lab",
}
"""The extra of the package that brings a library."""
NAMES = {"control": "python-control"}
"""What a library is called where that is not its module's name."""


def needed(module: str, purpose: str) -> Any:
    """Import a library of an extra; an ImportError says in one line how to get it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        library = module.partition(".")[0]
        raise ImportError(
            f"{purpose} need {NAMES.get(library, library)}: "
            f"pip install 'zivi[{EXTRAS[library]}]' ({error})",
            name=library,
        ) from error


def have(module: str) -> bool:
    """Whether a library can be imported."""
    try:
        importlib.import_module(module)
    except ImportError:
        return False
    return True


def import_attribute(module: str, name: str) -> Any:
    """Return a function of a higher-level module, which is imported at this call."""
    return getattr(importlib.import_module(module), name)


# A progress bar for long runs, on a terminal only.

Report: TypeAlias = Callable[[int, int], None]
"""Called with the number of steps done and their total."""

DELAY = 1.0
"""Seconds before a bar appears: short runs show none."""


class ProgressBar:
    """Shows the steps done, once the run has lasted longer than `DELAY`.

    Parameters
    ----------
    show : bool or None
        ``None`` shows the bar if standard error is a terminal.
    title : str
        What is done.
    """

    # of a bar that is not open: short runs are called by the million
    _started = 0.0
    _bar: rich.progress.Progress | None = None
    _task: rich.progress.TaskID | None = None

    def __init__(self, show: bool | None, title: str = "simulate") -> None:
        if show:
            needed("rich", "progress bars")
        self._title = title
        self._wanted = is_shown(show)
        if self._wanted:
            self._started = time.monotonic()

    @property
    def report(self) -> Report | None:
        """Callback of a run, with the number of steps done and their total; None without a bar."""
        return self._update if self._wanted else None

    def _update(self, done: int, of: int) -> None:
        if self._bar is None:
            if time.monotonic() - self._started < DELAY:
                return
            self._bar, self._task = _open_bar(self._title, of)
        assert self._task is not None
        self._bar.update(self._task, completed=done)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.stop()


_seen: tuple[object, bool] = (None, False)
"""The last standard error that was asked, and its answer: the system takes a while to give it."""


def is_shown(show: bool | None) -> bool:
    """Whether there is a bar if a run lasts: by default on a terminal that one can be drawn on."""
    global _seen
    # services have no standard error, and it may be closed
    if sys.stderr is None or getattr(sys.stderr, "closed", False):
        return False
    if show is not None:
        return bool(show)
    stream, terminal = _seen
    if stream is not sys.stderr:
        terminal = sys.stderr.isatty()
        _seen = (sys.stderr, terminal)
    return terminal and have("rich")


def _open_bar(title: str, of: int) -> tuple[rich.progress.Progress, rich.progress.TaskID]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    # without a terminal nothing can be drawn over: then the last state stays, as one line
    bar = Progress(*columns, console=console, transient=console.is_terminal)
    bar.start()
    return bar, bar.add_task(title, total=of)


# At the end of the interpreter runs of other threads are stopped: it could not end them alive.

WAIT = 5.0
"""Time (s) for which the interpreter waits: a run stops when its force returns."""


def watch() -> None:
    """Stop runs when the interpreter ends."""
    atexit.register(_zivi.stop_runs, WAIT)
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=_zivi.forget_runs)
