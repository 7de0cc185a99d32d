"""The states of the runs of a batch at given times."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.simulation.batch_arguments import room_for, times_of
from zivi.simulation.batch_result import Batch
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem

__all__ = ["Sampling", "sampled", "sampling_of"]


@dataclasses.dataclass(frozen=True)
class Sampling:
    """The times at which states are kept, and how they come about.

    Parameters
    ----------
    times : ndarray or None
        The times (s).
    at : ndarray or None
        The same, if the method samples its dense output there.
    knots : ndarray or None
        Else the ends of the steps between which the times are (s).
    steps : ndarray of int or None
        The numbers of these.
    rows : ndarray or None
        Room for the distances and for the velocities of all runs, of shape (2, runs, times), NaN.
    """

    times: Array | None = None
    at: Array | None = None
    knots: Array | None = None
    steps: NDArray[np.intp] | None = None
    rows: Array | None = None


def sampling_of(t_eval: Any, save: Any, span: tuple[float, float], method: Any, n: int) -> Sampling:
    """Find what is to be kept for the states at given times."""
    if t_eval is None:
        return Sampling()
    times = times_of(t_eval, save, span)
    rows = room_for(2, n, len(times))
    if isinstance(method, SwitchedRK):
        return Sampling(times, at=times, rows=rows)
    t = _zivi.grid_times(*span, method.h, 1)
    after = np.searchsorted(t, times, side="right")
    steps = np.unique(np.concatenate([after - 1, np.minimum(after, len(t) - 1)]))
    return Sampling(times, knots=t[steps], steps=steps, rows=rows)


def sampled(
    batch: Batch, record: _zivi.BatchRecord, systems: list[ImpactSystem], method: Any, how: Sampling
) -> Batch:
    """Give the batch the states at the times of `how`, NaN after the ends of its runs."""
    assert how.times is not None
    assert how.rows is not None
    x, xdot = how.rows
    if how.knots is None:
        width = record.samples_x.shape[1]  # less where all runs ended early
        x[:, :width], xdot[:, :width] = record.samples_x, record.samples_xdot
        return dataclasses.replace(batch, sample_t=how.times, sample_x=x, sample_xdot=xdot)
    names = ("x", "xdot", "s", "v")
    kept = (record.samples_x, record.samples_xdot, record.samples_s, record.samples_v)
    known = np.searchsorted(how.times, batch.t, side="right")
    reached = np.searchsorted(how.knots, batch.t, side="right")
    for i, (n, end) in enumerate(zip(known, reached, strict=True)):
        samples = {name: rows[i, :end] for name, rows in zip(names, kept, strict=True)}
        kappa = systems[i if len(systems) > 1 else 0].kappa
        path = method._path(kappa, how.knots[:end], samples)
        if n:
            x[i, :n], xdot[i, :n] = path.physical(how.times[:n])
    return dataclasses.replace(batch, sample_t=how.times, sample_x=x, sample_xdot=xdot)
