"""Many runs of one system that merge: what they settle on, and whether a grazing decided it.

Runs of an attractor come ever closer. Those whose states at the start of a period differ by less
than the tolerances of the method, which could not tell them apart either, are one from there on. So
of a million initial states soon a few are left.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.derivatives.sensitivity import OrbitStatus, sensitivity
from zivi.orbits.attractor import Settled, settle
from zivi.simulation.batch import simulate_batch
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem

__all__ = ["After", "Cells", "settle_cells", "together"]

After: TypeAlias = Callable[[Array, int], tuple[Array, NDArray[np.bool_]]]
"""States after some periods, NaN of runs that fail, and which runs graze."""


@dataclasses.dataclass(frozen=True)
class Cells:
    """What runs settled on."""

    settled: list[Settled]
    """The different ones."""
    which: NDArray[np.int64]
    """For each run its number among them."""
    grazing: NDArray[np.bool_]
    """For each run whether an impact, or the want of one, was decided by the tolerances."""


@dataclasses.dataclass(frozen=True)
class _Runner:
    """Runs a system for some periods."""

    system: ImpactSystem
    period: float
    method: SwitchedRK
    threads: int | None
    progress: bool | None

    def after(self, states: Array, periods: int) -> tuple[Array, NDArray[np.bool_]]:
        """Give the states after some periods, NaN for runs that fail, and which runs graze."""
        span = (0.0, periods * self.period)
        if not self.system._spec.is_native:
            return self._one_by_one(states, span)
        batch = simulate_batch(
            [self.system] * len(states),
            span,
            states,
            method=self.method,
            save="grazing",
            threads=self.threads,
            progress=self.progress,
        )
        ends = np.column_stack([batch.x, batch.xdot])
        ends[~batch.success] = np.nan
        assert batch.grazing is not None
        return ends, batch.grazing

    def _one_by_one(
        self, states: Array, span: tuple[float, float]
    ) -> tuple[Array, NDArray[np.bool_]]:
        ends, grazing = np.full(states.shape, np.nan), np.zeros(len(states), dtype=bool)
        for i, state in enumerate(states):
            s = sensitivity(
                self.system,
                span,
                state,
                ("x0",),
                self.method,
                errsens=False,
                dense_output=False,
                progress=self.progress,
            )
            grazing[i] = s.status is OrbitStatus.GRAZING
            if s.trajectory.success:
                ends[i] = s.trajectory.x[-1], s.trajectory.xdot[-1]
        return ends, grazing


def settle_cells(
    system: ImpactSystem,
    states: Array,
    period: float,
    transient: int,
    keep: int,
    method: SwitchedRK,
    threads: int | None = None,
    progress: bool | None = None,
) -> Cells:
    """Run from all states for a number of periods, and note what they do in further ones."""
    runner = _Runner(system, period, method, threads, progress)
    now, which, grazing = together(runner.after, states, transient, method)
    failed = np.isnan(now[:, 0])
    kept = np.where(failed[:, None], 0.0, now)
    settled = settle(
        [system] * len(kept), kept, [period] * len(kept), 0, keep, method, threads, progress
    )
    settled = [
        dataclasses.replace(it, success=False) if fails else it
        for it, fails in zip(settled, failed, strict=True)
    ]
    if len(kept):
        grazing |= runner.after(kept, keep)[1][which]
    return Cells(settled, which, grazing)


def together(
    after: After, states: Array, transient: int, method: SwitchedRK
) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
    """Run all for a number of periods: the different ends, which each is, and grazing."""
    which, now = np.arange(len(states)), states
    grazing = np.zeros(len(states), dtype=bool)
    left, length = transient, 1
    while left > 0:
        step = min(length, left)
        ends, grazes = after(now, step)
        grazing |= grazes[which]
        left, length = left - step, 2 * length
        now, merged = _merged(ends, method)
        which = merged[which]
    return now, which, grazing


def _merged(states: Array, method: SwitchedRK) -> tuple[Array, NDArray[np.int64]]:
    """Give the different ones of some states, and which of them each is."""
    size = np.max(np.abs(np.nan_to_num(states)), axis=0, initial=0.0)
    each = np.broadcast_to(np.asarray(method.atol, np.float64), 2)
    atol = np.repeat(each, states.shape[1] // 2)  # of positions, then of velocities
    # failed ones are one
    cells = np.nan_to_num(np.rint(states / (atol + method.rtol * size)), nan=-np.inf)
    order = np.lexsort(cells.T)
    ordered = cells[order]
    new = np.append(True, np.any(ordered[1:] != ordered[:-1], axis=1))
    which = np.empty(len(states), np.int64)
    which[order] = np.cumsum(new) - 1
    return states[order[new]], which
