"""Columns of tables in files and in objects of pandas."""

from __future__ import annotations

from os import PathLike
from typing import Any

__all__ = ["column", "is_number", "of_pandas"]


def of_pandas(series: Any) -> tuple[Any, Any]:
    """Read index and columns of a Series or a DataFrame."""
    if not (hasattr(series, "index") and hasattr(series, "to_numpy")):
        raise TypeError("values must be given, unless times is a pandas.Series or DataFrame")
    index = series.index
    if hasattr(index, "total_seconds"):
        return index.total_seconds().to_numpy(), series.to_numpy()
    if hasattr(index, "tz_localize"):
        raise TypeError(
            "times must be seconds, got dates: series.index - series.index[0] has the time since "
            "the first one"
        )
    return index.to_numpy(), series.to_numpy()


def is_number(text: str) -> bool:
    """Whether a text is one number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def mistake_in(path: str | PathLike[str], delimiter: str, error: ValueError) -> str:
    """Return what keeps a file from being read as a table: the first line that is none."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        lines = [(k, line.strip()) for k, line in enumerate(file, 1) if line.strip()]
    first = len(lines[0][1].split(delimiter)) if lines else 0
    for k, line in lines:
        entries = [it.strip() for it in line.split(delimiter)]
        wrong = next((it for it in entries if not is_number(it)), None)
        if (wrong is None or k == lines[0][0]) and len(entries) == first:
            continue
        others = [it for it in (";", "\t", ",", " ") if it != delimiter and it in line]
        if others and len(entries) == 1:
            remedy = f"; use delimiter={others[0]!r}"
        elif wrong and is_number(wrong.replace(",", ".")):
            remedy = "; write decimal points, not commas"
        else:
            remedy = ""
        got = f"{wrong[:40]!r}" if wrong else f"{len(entries)} columns instead of {first}"
        return f"must hold numbers parted by {delimiter!r}, got {got} in line {k}{remedy}"
    return f"must hold numbers parted by {delimiter!r}: {error}"


def column(name: str, given: Any, names: list[str], count: int) -> int:
    """Give the place of a column."""
    if isinstance(given, str):
        if given not in names:
            known = ", ".join(names) or "none: the file has no line of names"
            raise ValueError(f"{name} must be a column of the file, got {given!r}; it has {known}")
        return names.index(given)
    if not -count <= given < count:
        raise ValueError(f"{name} must be a column of the file, got {given}; it has {count}")
    return int(given) % count
