"""What is refused of a mechanical system before there is a state: gaps, mass, names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.system.gap import Gap

__all__ = [
    "MAX_SIZE",
    "check_mass",
    "check_size",
    "coordinates_of",
    "gaps_of",
    "matrix_of",
    "names_of",
]

MAX_SIZE = 256
"""Most coordinates, and most gaps with the channels of friction."""


def gaps_of(gaps: Any) -> tuple[Gap, ...]:
    """Read the gaps: one or a sequence."""
    several = (gaps,) if isinstance(gaps, Gap) else gaps
    if not isinstance(several, Iterable):
        raise TypeError(f"gaps must be a sequence of zivi.Gap, got {type(gaps).__name__}")
    several = tuple(several)
    for i, gap in enumerate(several):
        if not isinstance(gap, Gap):
            raise TypeError(f"gaps[{i}] must be a zivi.Gap or zivi.LinearGap, got {gap!r}")
    if len(several) > MAX_SIZE:
        raise ValueError(f"gaps must be at most {MAX_SIZE}, got {len(several)}")
    return several


def check_size(name: str, given: Any) -> None:
    """Raise a ValueError for an array of more coordinates than a system may have."""
    shape = getattr(given, "shape", ())
    if isinstance(shape, tuple) and max(shape, default=0) > MAX_SIZE:
        raise ValueError(f"{name} must be for at most {MAX_SIZE} coordinates, got shape {shape}")


def matrix_of(mass: Array) -> Array:
    """Check a constant mass matrix."""
    check_size("mass", mass)
    matrix = mass.reshape(1, 1) if mass.size == 1 else mass
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not matrix.size:
        raise ValueError(f"mass must have shape (n, n) with n >= 1, got {mass.shape}")
    check_mass(matrix)
    return matrix


def check_mass(matrix: Array) -> None:
    """Refuse a mass matrix that is not symmetric and positive definite."""
    if not np.isfinite(matrix).all():
        raise ValueError(f"mass must be finite, got {matrix.tolist()}")
    skew = np.abs(matrix - matrix.T).max()
    if skew > 1e-10 * np.abs(matrix).max():
        raise ValueError(f"mass must be symmetric, got {matrix.tolist()}")
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        least = float(np.linalg.eigvalsh(matrix)[0])
        raise ValueError(
            f"mass must be positive definite, got one with the eigenvalue {least:.6g}"
        ) from None


def names_of(what: str, names: Sequence[str]) -> tuple[str, ...]:
    """Give names that all differ."""
    twice = sorted({name for name in names if list(names).count(name) > 1})
    if twice:
        raise ValueError(f"names of {what} must differ, got {twice[0]!r} twice")
    return tuple(names)


def coordinates_of(names: Sequence[str] | None, n: int | None) -> tuple[str, ...] | None:
    """Read the names of the coordinates, as many as there are if that is known."""
    if names is None:
        return None
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise TypeError(f"coordinates must be a sequence of names, got {names!r}")
    if n is not None and len(names) != n:
        raise ValueError(f"coordinates must be {n} names, got {len(names)}")
    return names_of("coordinates", list(names))
