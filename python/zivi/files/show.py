"""What ``zivi show`` does: a result, a table and a picture of it."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zivi.files import picture, summary
from zivi.files.restore import drawn, run_of
from zivi.files.results import check_kind, open_result, restored
from zivi.files.validation import FileError
from zivi.study import open_study

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

__all__ = ["check", "has_display", "is_study", "open_window", "shown", "write_picture"]


def is_study(path: Path) -> bool:
    """Whether a result is the folder of a study."""
    return path.is_dir()


def check(path: Path) -> None:
    """Raise an OSError for what is no result, before anything else is looked at."""
    if not is_study(path):
        check_kind(path)


def shown(path: Path) -> tuple[Table, Figure, dict[str, Any]]:
    """Sum up and draw a result; a `FileError` or an OSError if it cannot be read."""
    try:
        return _shown(path)
    except (FileError, OSError, ImportError, MemoryError):
        raise
    except ValueError as error:
        raise FileError(str(error)) from error
    except Exception as error:  # whatever stands there in place of what was written
        reason = f"{type(error).__name__}: {error}"
        raise FileError(f"{path}: cannot be shown ({reason:.200})") from error


def _shown(path: Path) -> tuple[Table, Figure, dict[str, Any]]:
    if is_study(path):
        study = open_study(path, verify=True)
        return summary.of_study(study), picture.of_study(study), summary.record_of_study(study)
    dataset = open_result(path)
    run, curve = restored(path, dataset, run_of), restored(path, dataset, drawn)
    return summary.of_run(run), picture.of_run(curve), summary.record_of_run(run)


def has_display() -> bool:
    """Whether a window can be opened here."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def write_picture(figure: Figure, path: Path) -> None:
    """Write a picture, which is there as a whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.part")
    try:
        figure.savefig(draft, dpi=150, format=path.suffix.lstrip(".").lower() or "png")
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def open_window() -> None:
    """Show the picture until its window is closed."""
    import matplotlib.pyplot as plt

    plt.show()
