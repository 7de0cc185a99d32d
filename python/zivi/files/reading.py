"""Reads a file into checked values."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

from zivi.files.tables import Key, read_keys
from zivi.files.validation import FileError, Mistakes

__all__ = ["Content", "command_of", "read"]

Keys: TypeAlias = tuple[Key, ...]

LARGEST = 50_000_000
"""Bytes of a file that is read."""
DEEPEST = 50
"""Parts of a key, parted by dots: tomllib takes a time that grows with their square."""
PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
DEEP = re.compile(rf"(?<![\w-])(?:{PART}\.[ \t]*+){{{DEEPEST}}}")


@dataclasses.dataclass(frozen=True)
class Content:
    """What a file says.

    Parameters
    ----------
    values : dict
        The values of the keys that are there, checked one by one.
    mistakes : Mistakes
        For what only shows when they are put together.
    """

    values: dict[str, Any]
    mistakes: Mistakes


def read(
    path: Path, keys: Keys | Callable[[dict[str, Any]], Keys], command: str | None = None
) -> Content:
    """Read a file; a `FileError` tells all that is wrong with it.

    Parameters
    ----------
    path : Path
        The file.
    keys : tuple of Key, or callable
        Its keys, or what gives them for what the file holds.
    command : str, optional
        The command that reads it; a file for another one is rejected in one line.
    """
    mistakes = Mistakes(path)
    content = _parsed(path)
    meant = command_of(content)
    if command is not None and meant not in (command, None):
        raise FileError(f"{path}: is a file for zivi {meant}, not for zivi {command}")
    values = read_keys(keys(content) if callable(keys) else keys, content, "", mistakes)
    mistakes.stop()
    return Content(values, mistakes)


def command_of(content: dict[str, Any]) -> str | None:
    """Return the command whose files have the keys of a file, None if several do or none."""
    found = [
        command
        for command, key in {"simulate": "system", "sweep": "experiment"}.items()
        if key in content
    ]
    if len(found) != 1:
        return None
    if "controller" in content:
        return "control" if found == ["simulate"] else None
    return found[0]


def _parsed(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > LARGEST:
            raise FileError(f"{path}: is larger than {LARGEST // 10**6} MB")
        # a byte order mark is no content, and lines may end as they do elsewhere
        text = path.read_text("utf-8-sig")
        if deep := DEEP.search(text):
            line = text.count("\n", 0, deep.start()) + 1
            raise FileError(f"{path}: a key must have at most {DEEPEST} parts (line {line})")
        return tomllib.loads(text)
    except FileNotFoundError:
        raise FileError(f"{path}: there is no such file") from None
    except tomllib.TOMLDecodeError as error:  # it tells line and column
        raise FileError(f"{path}: is no TOML: {error}") from None
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: is no text in UTF-8 (byte {error.start})") from None
    except (OSError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or "too deeply nested"
        raise FileError(f"{path}: cannot be read: {reason}") from None
