"""What belongs to the steps of a run, at other times."""

from __future__ import annotations

from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.simulation.dense import LinearPath

__all__ = ["between_steps"]


def between_steps(sol: Any, times: Array) -> tuple[Array, ...]:
    """Give transformed state, multipliers and residual at `times` within the span of a run."""
    path = sol._known()
    s, v = path.lifted(times)
    if isinstance(path, LinearPath):
        lambda_s, lambda_v, residual = _of_steps(sol, path, times)
    else:
        # the branch is that of v at the wall; at rest both are zero
        lambda_s, lambda_v = np.where(s == 0.0, np.sign(v), np.sign(s)), np.sign(v)
        residual = np.full(len(times), np.nan)
    return s, v, lambda_s, lambda_v, residual


def _of_steps(sol: Any, path: LinearPath, times: Array) -> list[Array]:
    """Give what belongs to the steps that contain the times, NaN where it was not kept."""
    if not np.array_equal(sol.t, path.t):
        return [np.full(len(times), np.nan)] * 3
    # the step that contains a time ends at the first sample not before it
    step = np.searchsorted(path.t, times)
    lifted = sol.transformed
    return [row[step] for row in (lifted.lambda_s, lifted.lambda_v, sol.residual)]
