"""Lyapunov exponents of mechanical systems, from the derivatives of a run piece by piece."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from zivi.base.check import Array, finite
from zivi.derivatives.result import OrbitStatus
from zivi.derivatives.sensitivity import sensitivity
from zivi.orbits.mechanical.family import frequency_of
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.methods import SwitchedRK
from zivi.system.mechanism import MechanicalSystem

__all__ = ["flow_maps", "piece_of"]

PIECES = 200
"""Parts of a run of a system that nothing excites."""


def piece_of(system: MechanicalSystem, piece: float | None, duration: float) -> float:
    """Give the length of a piece: the period of the excitation if it is known."""
    if piece is not None:
        if not 0.0 < finite("piece", piece) <= duration:
            raise ValueError(f"piece must be > 0 and within t_span, got {piece}")
        return piece
    omega = frequency_of(system)
    own = duration / PIECES if omega is None else 2.0 * np.pi / omega
    return float(min(own, duration))


def flow_maps(
    system: MechanicalSystem,
    span: tuple[float, float],
    y0: Any,
    transient: float,
    piece: float,
    method: SwitchedRK,
    report: Any = None,
) -> tuple[list[Array], Array, int, OrbitStatus]:
    """Run a span in pieces: their state-transition matrices, the times between them, impacts, how.

    A piece that a tie of impacts or a corner makes not differentiable ends the list.
    """
    state = state_of(y0, system._n)
    count = max(1, round((span[1] - span[0] - transient) / piece))
    first = span[0] + transient
    times = np.linspace(first, span[1], count + 1)
    before = max(1, round(transient / piece)) if transient else 0
    ends = np.concatenate([np.linspace(span[0], first, before + 1), times[1:]])
    maps: list[Array] = []
    n_impacts = 0
    for k, (start, end) in enumerate(itertools.pairwise(ends)):
        s: Any = sensitivity(
            system,
            (float(start), float(end)),
            state,
            ("q0", "qdot0"),
            method,
            dense_output=False,
            progress=False,
        )
        sol = s.trajectory
        if not sol.success:
            return maps, times[: len(maps) + 1], n_impacts, OrbitStatus.RUN_ENDED
        state = sol.q[-1], sol.qdot[-1]
        if report is not None:
            report(k + 1, len(ends) - 1)
        if k < before:
            continue
        if not np.all(np.isfinite(s.final)):
            return maps, times[: len(maps) + 1], n_impacts, OrbitStatus.NOT_DIFFERENTIABLE
        n_impacts += len(np.unique(sol.impacts["group"]))
        maps.append(s.monodromy)
    return maps, times, n_impacts, OrbitStatus.COMPLETED
