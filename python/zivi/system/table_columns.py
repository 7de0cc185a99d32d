"""Columns of tables in files and in objects of pandas."""

from __future__ import annotations

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
