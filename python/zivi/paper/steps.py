"""A set of steps to be solved by several solvers, and the residual that judges them all."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Solver", "Steps", "natural_residual"]

Array = NDArray[np.float64]

Solver = Callable[[Array, Array], Array]
"""Multipliers, row by row, for rows of states, each solve begun at its row of the starts."""


@dataclasses.dataclass(frozen=True)
class Steps:
    """Steps that are solved one by one.

    Parameters
    ----------
    problem : str
        Whose steps they are.
    label : str
        Which of them.
    states : ndarray
        What each starts from, row by row.
    starts : ndarray
        Where each solve begins; NaN where the last one has ended.
    solvers : dict
        By name.
    residual : callable
        Relative natural residual of multipliers for states, written apart from the solvers.
    """

    problem: str
    label: str
    states: Array
    starts: Array
    solvers: dict[str, Solver]
    residual: Callable[[Array, Array], Array]


def natural_residual(rows: Iterable[tuple[Array, Array, Array]]) -> Array:
    """Return the worst row of ``lambda in sgn(z)``: 0 where all of them hold exactly.

    Each row is ``lambda``, ``z`` and the size of the terms of ``z``.
    """
    each = [np.maximum(lam - 1.0, np.minimum(lam + 1.0, -z / size)) for lam, z, size in rows]
    worst = np.max(np.abs(each), axis=0)
    return np.where(np.isnan(worst), np.inf, worst)
