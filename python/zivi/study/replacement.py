"""Files of a store, there as a whole or not at all, also where something else is in their place."""

from __future__ import annotations

import contextlib
import functools
import os
import uuid
from collections.abc import Callable
from pathlib import Path

__all__ = ["no_link", "write_bytes", "write_whole", "written"]


def written(top: Path, file: Path, write: Callable[[], None]) -> None:
    """Write a file below a folder; what is in its place and no file is moved aside, not removed."""
    for it in file.parents:
        if it != top and it.is_relative_to(top):
            no_link(it)
    try:
        write()
    except OSError:
        if not _made_room(top, file):
            raise
        write()


def no_link(place: Path) -> None:
    """Raise an OSError for a symbolic link: what is behind it is not the study's."""
    if place.is_symlink():
        raise OSError(
            f"{place} is a symbolic link, which zivi neither reads nor writes through; put what it "
            "points to in its place"
        )


def write_bytes(top: Path, file: Path, data: bytes) -> None:
    """Write a file below a folder, whatever is in its place."""
    written(top, file, functools.partial(write_whole, file, data))


def write_whole(file: Path, data: bytes) -> None:
    """Write a file and its folders; it is there as a whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draft = file.with_name(f"{file.name}.partial")
    try:
        draft.write_bytes(data)
        os.replace(draft, file)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
        raise


def _made_room(top: Path, file: Path) -> bool:
    """Move aside what is a folder where a file should be, or the other way round."""
    folders = [it for it in reversed(file.parents) if it.is_relative_to(top) and it != top]
    wrong = [it for it in folders if it.exists() and not it.is_dir()]
    wrong += [file] if file.is_dir() else []
    for it in wrong[:1]:
        it.rename(it.with_name(f".{it.name}.{uuid.uuid4().hex[:8]}"))
    return bool(wrong)
