"""A step of a search for a zero in a bracket."""

from __future__ import annotations

import numpy as np

__all__ = ["secant"]

Look = tuple[float, float]
"""A place and the value there."""


def secant(last: Look, before: Look, low: float, high: float) -> float:
    """Give the zero of a line through two points, or the middle where that is not within."""
    rise = last[1] - before[1]
    if np.isfinite(rise) and rise != 0.0:
        part = last[0] - last[1] * (last[0] - before[0]) / rise
        if low < part < high:
            return float(part)
    return 0.5 * (low + high)
