"""What is left of a run that an exception ended."""

from __future__ import annotations

import contextlib
from typing import TypeVar

import zivi._zivi as _zivi
from zivi.base.status import Status
from zivi.simulation.run_result import SampledRun

__all__ = ["as_raised", "with_partial"]

AnyRun = TypeVar("AnyRun", bound=SampledRun)


def as_raised(run: AnyRun) -> AnyRun:
    """Copy a run with the status of one that an exception ended; unread fields stay unread."""
    copied = object.__new__(type(run))
    message = _zivi.STATUS_MESSAGES[Status.RAISED]
    vars(copied).update(vars(run), status=Status.RAISED, message=message)
    return copied


def with_partial(error: BaseException, sol: SampledRun) -> BaseException:
    """Attach what was computed to the exception that ended a run."""
    end = sol._end()
    where = "before its first sample" if end is None else f"at t = {end:.9g} s"
    error.add_note(
        f"zivi: the run stopped {where}; "
        "what was computed is this exception's attribute 'trajectory'."
    )
    with contextlib.suppress(AttributeError):  # an exception class with __slots__
        error.trajectory = sol  # type: ignore[attr-defined]
    return error
