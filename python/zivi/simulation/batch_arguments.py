"""What is requested of a batch: its arguments, checked and translated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, integer, real_array
from zivi.simulation.methods import Method
from zivi.simulation.run import stop_times, times_within
from zivi.system.mass import ImpactSystem
from zivi.system.mass_with_friction import mechanism_of
from zivi.system.mechanism import MechanicalSystem
from zivi.system.table import Table

__all__ = [
    "check_native",
    "check_threads",
    "every_of",
    "room_for",
    "states_for",
    "states_of",
    "stops_of",
    "systems_of",
    "threads_for",
    "times_of",
    "with_friction",
]

MAX_THREADS = 1024


def systems_of(systems: Any) -> list[ImpactSystem]:
    """Return the systems as a list; each must do without the interpreter."""
    try:
        several = [systems] if isinstance(systems, ImpactSystem) else list(systems)
    except TypeError:
        several = [systems]
    for i, system in enumerate(several):
        if not isinstance(system, ImpactSystem):
            kind = type(system).__name__
            raise TypeError(f"systems must be zivi.ImpactSystem, got {kind} (number {i})")
        if isinstance(system.wall, Table):
            raise TypeError(
                f"the wall of system {i} must not be a zivi.Table in a batch, got {system.wall!r}: "
                "zivi.simulate takes it, and a zivi.LinearGap(motion=) in a batch of LinearSystems"
            )
        check_native(system._spec, f"the force of system {i}")
    if not several:
        raise ValueError("systems must hold at least one system")
    return several


def check_native(spec: _zivi.Force, what: str) -> None:
    """Refuse a force that needs the interpreter."""
    if not spec.is_native:
        raise ValueError(
            f"{what} needs the interpreter: a batch takes numbers, LinearForce and compiled "
            "callables (numba cfunc, scipy.LowLevelCallable); zivi.sweep runs any function"
        )


def check_threads(threads: int | None) -> int:
    """Return the number of threads, by default as many as the machine runs at once."""
    workers = _zivi.available_threads() if threads is None else integer("threads", threads)
    if not 1 <= workers <= MAX_THREADS:
        raise ValueError(f"threads must be from 1 to {MAX_THREADS}, got {workers}")
    return workers


def threads_for(systems: Iterable[MechanicalSystem], threads: int) -> int:
    """Return the number of threads on which the systems may be evaluated."""
    return threads if all(system.reentrant for system in systems) else 1


def stops_of(
    systems: Sequence[ImpactSystem] | Sequence[MechanicalSystem],
    tstops: ArrayLike | None,
    method: Method,
    span: tuple[float, float],
) -> list[Array]:
    """Give the declared breaks of each system; those of many under one table are one array."""
    known: dict[bytes, Array] = {}
    several = (stop_times(tstops, method, system, span) for system in systems)
    return [known.setdefault(stops.tobytes(), stops) for stops in several]


def with_friction(
    systems: ImpactSystem | Sequence[ImpactSystem], y0: Any
) -> tuple[list[MechanicalSystem], list[Array]]:
    """Give masses with friction as mechanical systems, and their states."""
    several = [systems] if isinstance(systems, ImpactSystem) else list(systems)
    for i, system in enumerate(several):
        if not isinstance(system, ImpactSystem) or system.friction is None:
            raise TypeError(
                "systems must all be zivi.ImpactSystem with friction, as the first is, got "
                f"{system!r} (number {i})"
            )
    states = states_for(y0, len(several))
    return [mechanism_of(system) for system in several], np.split(states, 2, axis=1)


def states_of(name: str, value: ArrayLike) -> Array:
    """Return states as rows."""
    rows = np.atleast_2d(real_array(name, value))
    if rows.ndim != 2 or rows.shape[1] != 2:
        raise ValueError(f"{name} must have shape (n, 2) or (2,), got {np.shape(value)}")
    return rows


def states_for(y0: ArrayLike, n_systems: int) -> Array:
    """Return the initial states of the runs of some systems as rows."""
    states = states_of("y0", y0)
    if np.ndim(y0) == 1:
        states = np.tile(states, (n_systems, 1))
    if n_systems not in (1, len(states)):
        raise ValueError(
            f"y0 must have a row for each of the {n_systems} systems, got {len(states)}"
        )
    return np.ascontiguousarray(states)


def every_of(save: Any, names: Sequence[str]) -> int | None:
    """Return the number of samples from one that is saved to the next, None for one of `names`."""
    if isinstance(save, str):
        if save not in names:
            told = " or ".join(repr(name) for name in names)
            told = told if len(names) == 1 else f"one of {told.replace(' or ', ', ')}"
            raise ValueError(f"save must be {told} or a number of samples >= 1, got {save!r}")
        return None
    every = integer("save", save)
    if every < 1:
        raise ValueError(f"save must be a number of samples >= 1, got {every}")
    return every


def times_of(t_eval: Any, save: Any, span: tuple[float, float]) -> Array:
    """Return the times at which states are kept, which nothing else can be then."""
    if save != "final":
        raise ValueError(f"t_eval goes with save='final' only, got save={save!r}")
    return times_within(t_eval, span)


def room_for(quantities: int, n: int, times: int, *more: int) -> Array:
    """Make room for quantities of `n` runs at some times, all NaN."""
    try:
        return np.full((quantities, n, times, *more), np.nan)
    except (MemoryError, ValueError):
        size = 8e-9 * quantities * n * times * math.prod(more)
        raise MemoryError(
            f"y0 gives {n} runs, t_eval {times} samples of each: {size:.3f} GB do not fit into "
            "memory; ask for fewer times, or compute fewer runs at a time"
        ) from None
