"""Implementation of the commands; each returns the exit code."""

from __future__ import annotations

import contextlib
import json
import math
import os
import shutil
import sys
import uuid
import warnings
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.table import Table

from zivi.base.status import StudyStatus
from zivi.files import summary
from zivi.files.kinds import FileError
from zivi.files.results import (
    check_netcdf,
    check_suffix,
    open_result,
    read_curve,
    read_run,
    require_library,
    require_regular,
    restored,
    save,
)
from zivi.files.runs import Prepared, Run, prepare_sweep
from zivi.study import Study, open_study
from zivi.study.folder import FolderStore

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Output of the commands; closed pipes are tolerated.


def say(text: str, *, end: str = "\n") -> None:
    """Print on standard output; a reader that has left (a closed pipe) is no error.

    Parameters
    ----------
    text : str
        The text.
    end : str
        What follows it.

    Raises
    ------
    OSError
        If standard output cannot be written for another reason.
    """
    try:
        typer.echo(text + end, nl=False)
    except OSError as error:
        # what Python still holds back must go somewhere when it ends
        with contextlib.suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            reason = error.strerror or str(error)
            raise OSError(f"standard output cannot be written: {reason}") from error


def show_table(table: Table) -> None:
    """Print a table as `say` does."""
    console = Console()
    with console.capture() as drawn:
        console.print(table)
    say(drawn.get(), end="")


def show_record(record: dict[str, Any]) -> None:
    """Print plain values as one line of JSON."""
    say(json.dumps(record, allow_nan=False, ensure_ascii=False))


def echo_error(text: str) -> None:
    """Print one line on standard error, if it exists."""
    with contextlib.suppress(OSError):
        typer.echo(text, err=True)


# Implementation of ``zivi show``: print a result, write its table and figure.


def is_study(path: Path) -> bool:
    """Whether a result is the folder of a study."""
    return path.is_dir()


def check_result(path: Path) -> None:
    """Raise an OSError if a path is not a result."""
    if not is_study(path):
        check_netcdf(path)


def summarise(path: Path) -> tuple[Table, Figure, dict[str, Any]]:
    """Sum up and draw a result; a `FileError` or an OSError if it cannot be read."""
    try:
        return _summarise(path)
    except (FileError, OSError, ImportError, MemoryError):
        raise
    except ValueError as error:
        raise FileError(str(error)) from error
    except Exception as error:  # whatever stands there in place of what was written
        reason = f"{type(error).__name__}: {error}"
        raise FileError(f"{path}: cannot be shown ({reason:.200})") from error


def _summarise(path: Path) -> tuple[Table, Figure, dict[str, Any]]:
    import matplotlib.style

    from zivi.files.picture import run_picture, study_picture  # with matplotlib

    with matplotlib.style.context("zivi.plot.figures"):
        if is_study(path):
            study = open_study(path, verify=True)
            table, record = summary.study_table(study), summary.record_of_study(study)
            return table, study_picture(study), record
        dataset = open_result(path)
        run, curve = restored(path, dataset, read_run), restored(path, dataset, read_curve)
        return summary.run_table(run), run_picture(curve), summary.record_of_run(run)


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


# Implementations of the commands; each returns the exit code.

EARLY, WRONG, INTERRUPTED = 1, 2, 130
"""Exit codes beside 0: the run ended early, something cannot be read or written, Ctrl-C."""
PICTURES = (".png", ".svg", ".pdf")
"""Endings of pictures."""


def example_file(command: str) -> str:
    """Return the example file of a command."""
    return (resources.files("zivi.files") / "examples" / f"{command}.toml").read_text("utf-8")


def output(given: Path | None, beside: Path, suffix: str, *, replace: bool) -> Path:
    """Return the path of a result; raise a `FileExistsError` if it exists."""
    path = _beside(beside, suffix) if given is None else given
    if path.exists() and path.resolve() == beside.resolve():
        raise FileExistsError(f"{path}: is the input file; choose another --out")
    if path.exists() and not replace:
        raise FileExistsError(f"{path}: exists; --force replaces it, --out names another")
    if suffix != ".zarr":
        require_regular(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _beside(file: Path, suffix: str) -> Path:
    """Return the default path of the output for a file or folder."""
    named = file if file.name not in ("", "..") else file.resolve()
    if not named.name:
        raise FileError(f"{file}: cannot be turned into the name of a result; give --out")
    return named.with_suffix(suffix)


def netcdf_for(file: Path, out: Path | None, *, replace: bool) -> Path:
    """Return the path of a result in netCDF; a FileError where it cannot be one."""
    path = output(out, file, ".nc", replace=replace)
    try:
        check_suffix("--out", path)
    except ValueError as error:
        raise FileError(f"zivi: {error}") from None
    return path


def single(
    prepare: Callable[[Path], Prepared],
    file: Path,
    out: Path | None,
    *,
    force: bool,
    quiet: bool,
    as_json: bool = False,
) -> int:
    """Compute and keep one run."""
    require_library()
    prepared = prepare(file)
    path = netcdf_for(file, out, replace=force)
    run, code = _run_prepared(prepared, quiet)
    if not _saved(run, path, force):
        return WRONG
    if as_json:
        show_record({"result": str(path), "exit_code": code, **summary.record_of_run(run)})
    elif not quiet:
        show_table(summary.run_table(run))
        say(f"{path}: {summary.opening(path, study=False)}")
    if code:
        end = f"{run.t[-1]:.9g} s" if len(run.t) else "the start"
        echo_error(f"zivi: the run ended early, at {end}: {run.message}")
    return code


def _run_prepared(prepared: Prepared, quiet: bool) -> tuple[Run, int]:
    try:
        run = prepared.run(progress=False if quiet else None)
    except (Exception, KeyboardInterrupt) as error:
        partial = getattr(error, "trajectory", None)
        if not isinstance(partial, Run):
            raise
        return partial, INTERRUPTED if isinstance(error, KeyboardInterrupt) else EARLY
    return run, 0 if run.success else EARLY


def _saved(run: Run, path: Path, force: bool) -> bool:
    try:
        save(run, path, overwrite=force)
    except OSError as error:
        echo_error(f"zivi: {path}: cannot be written: {error}")
        return False
    return True


def fit_to_data(
    file: Path, out: Path | None, *, force: bool, quiet: bool, as_json: bool = False
) -> int:
    """Fit parameters to data, and keep the estimates."""
    from zivi.files.fits import prepare_fit  # with what only fits need

    require_library()
    prepared = prepare_fit(file)
    path = netcdf_for(file, out, replace=force)
    code = 0
    try:
        found = prepared.run(progress=False if quiet else None)
    except KeyboardInterrupt as error:
        if not hasattr(error, "fit"):
            raise
        found, code = error.fit, INTERRUPTED
    save(found, path, overwrite=force)
    if as_json:
        estimates = {"values": found.values, "std": _finite_values(found.std), "notes": found.notes}
        show_record({"result": str(path), "exit_code": code, "found": found.found, **estimates})
    elif not quiet:
        say(f"{found}\n{path}: {summary.opening(path, study=False)}")
    return code if code or found.success else EARLY


def _finite_values(values: dict[str, float]) -> dict[str, float | None]:
    return {name: it if math.isfinite(it) else None for name, it in values.items()}


def study(
    file: Path,
    out: Path | None,
    *,
    force: bool,
    resume: bool,
    retry_failed: bool,
    quiet: bool,
    as_json: bool = False,
) -> int:
    """Compute and store a study, or its missing points."""
    prepared = prepare_sweep(file)
    path = output(out, file, ".zarr", replace=True)
    if force and path.exists():
        _remove(path)
    options = {"resume": True if resume else None, "retry_failed": retry_failed}
    code = 0
    try:
        found = prepared.run(path, progress=False if quiet else None, **options)
    except FileError as error:
        raise _with_hint(error) from error
    except (Exception, KeyboardInterrupt) as error:
        partial = getattr(error, "study", None)
        if not isinstance(partial, Study):
            raise
        stopped = isinstance(error, KeyboardInterrupt)
        echo_error(f"zivi: {'stopped by Ctrl-C' if stopped else error}")
        found, code = partial, INTERRUPTED if stopped else EARLY
        if isinstance(error, OSError):
            code = WRONG
    code = code or (0 if (found.status == StudyStatus.COMPLETED).all() else EARLY)
    if as_json:
        show_record({"result": str(path), "exit_code": code, **summary.record_of_study(found)})
    elif not quiet:
        show_table(summary.study_table(found))
        say(f"{path}: {summary.opening(path, study=True)}")
    return code


def _with_hint(error: FileError) -> FileError:
    text = str(error).replace("resume=True goes on", "--resume goes on")
    hint = "; --force starts anew, --out names another folder"
    return FileError(text + hint if "has another study" in text else text)


def _remove(path: Path) -> None:
    """Remove a study, and nothing else; a RuntimeError if somebody writes to it."""
    try:
        FolderStore(path, write=True).close()
    except (ValueError, OSError) as error:
        raise FileExistsError(
            f"{path}: is not removed, since it is not a study: {error}"
        ) from error
    old = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    path.rename(old)
    shutil.rmtree(old)


def picture(
    result: Path,
    out: Path | None,
    *,
    force: bool,
    window: bool,
    quiet: bool,
    as_json: bool = False,
) -> int:
    """Sum up and draw a result."""
    check_result(result)
    if out is not None and out.suffix.lower() not in PICTURES:
        raise FileError(f"{out}: must end in {', '.join(PICTURES)}")
    path = None if window else output(out, result, ".png", replace=force)
    if window and not has_display():
        raise FileError("zivi show: cannot open a display for --window; --out writes a picture")
    with warnings.catch_warnings(record=True) as noted:
        warnings.simplefilter("always", UserWarning)
        table, figure, record = summarise(result)
    for warning in noted:
        echo_error(f"zivi: {warning.message}")
    if not quiet and not as_json:
        show_table(table)
    if path is None:
        open_window()
    else:
        write_picture(figure, path)
        if not as_json:
            say(f"picture: {path}")
    if as_json:
        drawn = {"result": str(result), "picture": None if path is None else str(path)}
        show_record({**drawn, "exit_code": 0, **record})
    return 0
