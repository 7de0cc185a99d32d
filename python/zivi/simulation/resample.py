"""A run reported at other times."""

from __future__ import annotations

import dataclasses
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, real_array, whole
from zivi.simulation.dense import LinearPath
from zivi.simulation.runs import MassRun

__all__ = ["resampled", "times_of"]

Mass = TypeVar("Mass", bound=MassRun)


def times_of(sol: MassRun, t: ArrayLike | None, n: int | None) -> Array:
    """Give the times that are asked for: these, or a number of equidistant ones."""
    if (t is None) == (n is None):
        raise TypeError("exactly one of t and n must be given")
    if n is not None:
        if whole("n", n) < 2:
            raise ValueError(f"n must be >= 2, got {n}")
        return np.linspace(*sol._span(), n)
    times = real_array("t", t)
    if times.ndim != 1:
        raise ValueError(f"t must be one-dimensional, got shape {times.shape}")
    if np.any(np.diff(times) < 0):
        raise ValueError("t must not decrease")
    return times


def resampled(sol: Mass, times: Array) -> Mass:
    """Report a run at `times` within its span; its events stay as they are."""
    x, xdot = sol(times)
    path = sol._known()
    s, v = path.lifted(times)
    if isinstance(path, LinearPath):
        lambda_s, lambda_v, residual = _of_steps(sol, path, times)
    else:
        # the branch is that of v at the wall; at rest both are zero
        lambda_s, lambda_v = np.where(s == 0.0, np.sign(v), np.sign(s)), np.sign(v)
        residual = np.full(len(times), np.nan)
    return dataclasses.replace(
        sol,
        t=times,
        x=x,
        xdot=xdot,
        s=s,
        v=v,
        lambda_s=lambda_s,
        lambda_v=lambda_v,
        residual=residual,
    )


def _of_steps(sol: MassRun, path: LinearPath, times: Array) -> tuple[Array, Array, Array]:
    """Give what belongs to the steps that contain the times, NaN where it was not kept."""
    columns = (sol.lambda_s, sol.lambda_v, sol.residual)
    if not np.array_equal(sol.t, path.t):
        unknown = np.full(len(times), np.nan)
        return unknown, unknown, unknown
    # the step that contains a time ends at the first sample not before it
    step = np.searchsorted(path.t, times)
    first, second, third = (column[step] for column in columns)
    return first, second, third
