"""At the end of the interpreter runs of other threads are stopped: it could not end them alive."""

import atexit
import os

import zivi._zivi as _zivi

__all__ = ["WAIT", "watch"]

WAIT = 5.0
"""Time (s) for which the interpreter waits: a run stops when its force returns."""


def watch() -> None:
    """Stop runs when the interpreter ends."""
    atexit.register(_zivi.stop_runs, WAIT)
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=_zivi.forget_runs)
