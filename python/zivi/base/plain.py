"""Plain text: counts of things, and configurations as JSON without infinity and NaN."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

__all__ = ["counted", "listed_by", "text_of"]


def counted(number: int, thing: str) -> str:
    """Return a count and what it counts, in the plural unless it is one.

    Examples
    --------
    >>> counted(1, "impact"), counted(2, "impact")
    ('1 impact', '2 impacts')
    """
    return f"{number} {thing}" + ("" if number == 1 else "s")


def listed_by(total: int, what: str, reasons: Iterable[str]) -> str:
    """Return how many of a number are so, and by which reasons; nothing if none is.

    Examples
    --------
    >>> listed_by(40, "runs without an orbit", ["failed", "irregular", "irregular"])
    '3 of 40 runs without an orbit (2 irregular, 1 failed)'
    """
    counts = Counter(reasons)
    if not counts:
        return ""
    by = ", ".join(f"{number} {reason}" for reason, number in counts.most_common())
    return f"{counts.total()} of {total} {what} ({by})"


def text_of(value: Any) -> str:
    """Write plain values as JSON; numbers that are not finite become null."""
    return json.dumps(_finite(value), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: _finite(it) for name, it in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(it) for it in value]
    return value
