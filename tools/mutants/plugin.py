"""For pytest: notes which test reaches which functions that have mutations."""

import contextlib
import ctypes
import os
from pathlib import Path

HEAD = "= "


def note(line):
    """Add a line to what the switches note."""
    with Path(os.environ["ZIVI_REACHED"]).open("a", encoding="utf-8") as file:
        file.write(f"{HEAD}{line}\n")


def pytest_runtest_logstart(nodeid):
    """Begin a test: what is reached from here on is noted again."""
    import zivi._zivi

    # an extension without mutations has no such function, as has a package without mutmut's
    with contextlib.suppress(AttributeError):
        ctypes.CDLL(zivi._zivi.__file__).zivi_mutants_forget()
    with contextlib.suppress(ImportError):
        from zivi import _mutants

        _mutants.REACHED.clear()
    note(f"start {nodeid}")


def pytest_runtest_logreport(report):
    """Note how long a part of a test took, and how it ended."""
    note(f"{report.outcome} {report.duration} {report.nodeid}")
