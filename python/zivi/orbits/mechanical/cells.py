"""Many runs of one mechanical system that merge: what they settle on."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.orbits.cells import together
from zivi.orbits.mechanical.settled import Settled, settle
from zivi.simulation.batch import simulate_batch
from zivi.simulation.methods import SwitchedRK
from zivi.system.mechanism import MechanicalSystem

__all__ = ["open_starts", "settle_cells"]


def open_starts(system: MechanicalSystem, states: Array) -> NDArray[np.bool_]:
    """Tell which states, of shape (N, 2, n), penetrate no gap at the time 0."""
    model = system.model(states.shape[2])
    rows = (model.layout.read(model.evaluate(0.0, q, qdot)).gaps for q, qdot in states)
    return np.array([bool((gaps >= 0.0).all()) for gaps in rows], dtype=bool)


def settle_cells(
    system: MechanicalSystem,
    states: Array,
    period: float,
    transient: int,
    keep: int,
    method: SwitchedRK,
    threads: int | None = None,
    progress: bool | None = None,
) -> tuple[list[Settled], NDArray[np.int64]]:
    """Run from all states, of shape (N, 2, n): what they settled on, and for each which of it."""
    n = states.shape[2]

    def after(rows: Array, periods: int) -> tuple[Array, NDArray[np.bool_]]:
        ends = np.full(rows.shape, np.nan)
        runs = ~np.isnan(rows[:, 0])
        if runs.any():
            batch = simulate_batch(
                system,
                (0.0, periods * period),
                (rows[runs, :n], rows[runs, n:]),
                method=method,
                threads=threads,
                progress=progress,
            )
            reached = np.hstack([batch.q, batch.qdot])
            reached[~batch.success] = np.nan
            ends[runs] = reached
        return ends, np.zeros(len(rows), dtype=bool)

    flat = states.reshape(len(states), 2 * n)
    now, which, _ = together(after, flat, transient, method)
    failed = np.isnan(now[:, 0])
    kept = np.where(failed[:, None], flat[:1], now).reshape(-1, 2, n)
    several = settle(
        [system] * len(kept), kept, [period] * len(kept), 0, keep, method, threads, progress
    )
    pairs = zip(several, failed, strict=True)
    return [dataclasses.replace(it, success=it.success and not bad) for it, bad in pairs], which
