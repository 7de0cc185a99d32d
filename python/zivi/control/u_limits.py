"""Ranges of controls."""

from __future__ import annotations

from typing import Any

from zivi.base.check import Array, real_array

__all__ = ["limits_of", "pairs"]


def limits_of(limits: Any) -> Array | None:
    """Read the range of each control."""
    if limits is None:
        return None
    rows = real_array("u_limits", limits)
    if rows.ndim != 2 or rows.shape[1] != 2 or not (rows[:, 0] < rows[:, 1]).all():
        raise ValueError(f"u_limits must be pairs (u_min, u_max) with u_min < u_max, got {limits}")
    return rows


def pairs(limits: Array | None) -> list[tuple[float, float]] | None:
    """Give them as the extension takes them."""
    return None if limits is None else [(float(low), float(high)) for low, high in limits]
