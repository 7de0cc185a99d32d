"""What is left of a run that an exception ended."""

from __future__ import annotations

import contextlib
import dataclasses
from typing import TypeVar

import zivi._zivi as _zivi
from zivi.base.status import Status
from zivi.simulation.run_result import SampledRun

__all__ = ["as_raised", "with_partial"]

AnyRun = TypeVar("AnyRun", bound=SampledRun)


def as_raised(run: AnyRun) -> AnyRun:
    """Give a run the status of one that an exception ended."""
    message = _zivi.STATUS_MESSAGES[Status.RAISED]
    return dataclasses.replace(run, status=Status.RAISED, message=message)


def with_partial(error: BaseException, sol: SampledRun) -> BaseException:
    """Attach what was computed to the exception that ended a run."""
    path = getattr(sol, "_path", None)
    _, end = (path and path.span) or (None, sol.t[-1] if len(sol.t) else None)
    where = "before its first sample" if end is None else f"at t = {end:.9g} s"
    error.add_note(
        f"zivi: the run stopped {where}; "
        "what was computed is this exception's attribute 'trajectory'."
    )
    with contextlib.suppress(AttributeError):  # an exception class with __slots__
        error.trajectory = sol  # type: ignore[attr-defined]
    return error
