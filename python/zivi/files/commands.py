"""What the commands do; each returns the exit code."""

from __future__ import annotations

import shutil
import uuid
import warnings
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import typer
from rich.console import Console

from zivi.closed_loop import ClosedLoop
from zivi.files import show, summary
from zivi.files.mistakes import FileError
from zivi.files.results import require_library, save
from zivi.files.runs import Prepared
from zivi.files.sweeps import prepare_sweep
from zivi.study import Study
from zivi.study.folder import FolderStore
from zivi.study.work import DONE
from zivi.trajectory import Trajectory

__all__ = ["EARLY", "INTERRUPTED", "WRONG", "example", "output", "picture", "single", "study"]

EARLY, WRONG, INTERRUPTED = 1, 2, 130
"""Exit codes beside 0: the run ended early, a bad file, Ctrl-C."""
PICTURES = (".png", ".svg", ".pdf")
"""Endings of pictures."""


def example(command: str) -> str:
    """Give the example file of a command."""
    return (resources.files("zivi.files") / "examples" / f"{command}.toml").read_text("utf-8")


def output(given: Path | None, beside: Path, suffix: str, *, replace: bool) -> Path:
    """Give the path of a result; a `FileExistsError` if it is taken."""
    path = beside.with_suffix(suffix) if given is None else given
    if path.exists() and path.resolve() == beside.resolve():
        raise FileExistsError(f"{path}: is what is read; give another --out")
    if path.exists() and not replace:
        raise FileExistsError(f"{path}: is there already; --force replaces it, --out names another")
    if path.is_dir() and suffix != ".zarr":
        raise FileExistsError(f"{path}: is a folder")
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def single(
    prepare: Callable[[Path], Prepared], file: Path, out: Path | None, *, force: bool, quiet: bool
) -> int:
    """Compute and keep one run."""
    require_library()
    prepared = prepare(file)
    path = output(out, file, ".nc", replace=force)
    run, code = _computed(prepared, quiet)
    if not _saved(run, path, force):
        return EARLY
    if not quiet:
        console = Console()
        console.print(summary.of_run(run))
        typer.echo(f"{path}: {summary.opening(path, study=False)}")
    if code:
        end = f"{run.t[-1]:.9g} s" if len(run.t) else "the start"
        typer.echo(f"zivi: the run ended early, at {end}: {run.message}", err=True)
    return code


def _computed(prepared: Prepared, quiet: bool) -> tuple[Trajectory | ClosedLoop, int]:
    try:
        run = prepared.run(progress=False if quiet else None)
    except (Exception, KeyboardInterrupt) as error:
        partial = getattr(error, "trajectory", None)
        if not isinstance(partial, Trajectory | ClosedLoop):
            raise
        return partial, INTERRUPTED if isinstance(error, KeyboardInterrupt) else EARLY
    return run, 0 if run.success else EARLY


def _saved(run: Trajectory | ClosedLoop, path: Path, force: bool) -> bool:
    try:
        save(run, path, overwrite=force)
    except OSError as error:
        typer.echo(f"zivi: {path}: cannot be written: {error}", err=True)
        return False
    return True


def study(
    file: Path,
    out: Path | None,
    *,
    force: bool,
    resume: bool,
    retry_failed: bool,
    quiet: bool,
) -> int:
    """Compute and keep a study, or what of it is missing."""
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
        typer.echo(f"zivi: {'stopped by Ctrl-C' if stopped else error}", err=True)
        found, code = partial, INTERRUPTED if stopped else EARLY
    if not quiet:
        Console().print(summary.of_study(found))
        typer.echo(f"{path}: {summary.opening(path, study=True)}")
    return code or (0 if (found.status == DONE).all() else EARLY)


def _with_hint(error: FileError) -> FileError:
    text = str(error).replace("resume=True goes on", "--resume goes on")
    hint = "; --force starts anew, --out names another folder"
    return FileError(text + hint if "has another study" in text else text)


def _remove(path: Path) -> None:
    """Remove a study, and nothing else; a RuntimeError if somebody writes to it."""
    try:
        FolderStore(path, write=True).close()
    except (ValueError, OSError) as error:
        raise FileExistsError(f"{path}: is not removed, it is no study: {error}") from error
    old = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    path.rename(old)
    shutil.rmtree(old)


def picture(result: Path, out: Path | None, *, force: bool, window: bool, quiet: bool) -> int:
    """Sum up and draw a result."""
    if out is not None and out.suffix.lower() not in PICTURES:
        raise FileError(f"{out}: must end in {', '.join(PICTURES)}")
    path = None if window else output(out, result, ".png", replace=force)
    if window and not show.has_display():
        raise FileError("zivi show: there is no display for --window; --out writes a picture")
    with warnings.catch_warnings(record=True) as noted:
        warnings.simplefilter("always", UserWarning)
        table, figure = show.shown(result)
    for warning in noted:
        typer.echo(f"zivi: {warning.message}", err=True)
    if not quiet:
        Console().print(table)
    if path is None:
        show.open_window()
    else:
        show.write_picture(figure, path)
        typer.echo(f"picture: {path}")
    return 0
