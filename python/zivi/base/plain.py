"""Plain text: counts of things, and configurations as JSON without infinity and NaN."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

__all__ = ["counted", "text_of"]


def counted(number: int, thing: str) -> str:
    """Return a count and what it counts, in the plural unless it is one.

    Examples
    --------
    >>> counted(1, "impact"), counted(2, "impact")
    ('1 impact', '2 impacts')
    """
    return f"{number} {thing}" + ("" if number == 1 else "s")


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
