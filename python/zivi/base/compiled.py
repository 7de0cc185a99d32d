"""Exceptions in compiled forces: C has no way to hand them on, so they are caught beside it.

ctypes, numba and Cython report what is raised in a function that C calls to `sys.unraisablehook`
and return a number that means nothing. While a run with such a force is under way the hook belongs
to zivi: the evaluation counts as NaN, and what was raised reaches the caller of the run.
"""

from __future__ import annotations

import contextlib
import sys
import threading
import warnings
from collections.abc import Iterable
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.locks import ForkLock
from zivi.base.status import Status

__all__ = ["Ear", "listening", "listening_always", "tell"]

CALLBACKS = ("ctypes callback", "cffi callback")
"""What the message of a report speaks of if it is one of these libraries'."""


class Ear:
    """What was raised in the compiled forces of a run, while it is open.

    Parameters
    ----------
    thread : int or None
        The thread that computes the run, None where several do.
    """

    def __init__(self, thread: int | None) -> None:
        self.thread = thread
        self.error: BaseException | None = None

    def __enter__(self) -> Self:
        _open(self)
        return self

    def __exit__(self, *_: object) -> None:
        _close(self)

    def ends(self, success: bool) -> BaseException | None:
        """Give what ended a run: an exception that a method got around (below the wall) did not."""
        return None if success and isinstance(self.error, Exception) else self.error


_lock = ForkLock()
_ears: list[Ear] = []
_before: Any = None
"""The hook before ours, while there are ears."""


_DEAF = contextlib.nullcontext(Ear(None))
"""For runs without a compiled force: nothing can be heard in them."""


def listening(
    specs: Iterable[_zivi.Force], *, threads: bool = False
) -> contextlib.AbstractContextManager[Ear]:
    """Listen to the compiled forces among some while they are run, in this thread or in several."""
    for spec in specs:
        if spec.is_compiled:
            return listening_always(threads=threads)
    return _DEAF


def listening_always(*, threads: bool = False) -> contextlib.AbstractContextManager[Ear]:
    """Listen whatever is run: a mechanical system may have compiled parts."""
    return Ear(None if threads else threading.get_ident())


def tell(ear: Ear, status: NDArray[np.uint8]) -> None:
    """Warn of what was raised in runs of a batch that it ended; raise what is no `Exception`."""
    ended = int(np.count_nonzero(status == int(Status.FORCE_NOT_FINITE)))
    if not isinstance(error := ear.ends(not ended), Exception | None):
        raise error
    if error is not None:
        warnings.warn(
            f"a compiled force raised {error!r}; {ended} runs ended with FORCE_NOT_FINITE",
            RuntimeWarning,
            stacklevel=3,
        )


def _open(ear: Ear) -> None:
    global _before
    with _lock:
        if not _ears:
            _before, sys.unraisablehook = sys.unraisablehook, _hook
        _ears.append(ear)


def _close(ear: Ear) -> None:
    with _lock:
        _ears.remove(ear)
        # whoever took the hook meanwhile keeps it
        if not _ears and sys.unraisablehook is _hook:
            sys.unraisablehook = _before


def _hook(report: Any) -> None:
    own = threading.get_ident()
    ears = [ear for ear in list(_ears) if ear.thread == own]
    ears = ears or [ear for ear in list(_ears) if ear.thread is None]
    if not (ears and _of_a_function(report)):
        (_before or sys.__unraisablehook__)(report)
        return
    _zivi.force_raised()
    for ear in ears:
        ear.error = report.exc_value or report.exc_type()


def _of_a_function(report: Any) -> bool:
    """Whether a function that C called raised, not a finaliser."""
    told = report.err_msg or ""
    return isinstance(report.object, str) or any(name in told for name in CALLBACKS)
