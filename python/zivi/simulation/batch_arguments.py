"""What a batch is asked for: its arguments, checked and translated."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, real_array, whole
from zivi.simulation.methods import Method, SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.table import refuse_tables

__all__ = ["check_native", "check_threads", "every_of", "states_of", "systems_of"]

MAX_THREADS = 1024
SAVES = ("final", "statistics", "events", "grazing")


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
        refuse_tables(system, f"system {i} of a batch")
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
    workers = _zivi.available_threads() if threads is None else whole("threads", threads)
    if not 1 <= workers <= MAX_THREADS:
        raise ValueError(f"threads must be from 1 to {MAX_THREADS}, got {workers}")
    return workers


def states_of(y0: ArrayLike, n_systems: int) -> Array:
    """Return initial states as rows."""
    states = real_array("y0", y0)
    if states.shape == (2,):
        states = np.tile(states, (n_systems, 1))
    if states.ndim != 2 or states.shape[1] != 2:
        raise ValueError(f"y0 must have shape (n, 2) or (2,), got {states.shape}")
    if n_systems not in (1, len(states)):
        raise ValueError(
            f"y0 must have a row for each of the {n_systems} systems, got {len(states)}"
        )
    return np.ascontiguousarray(states)


def every_of(save: Any, method: Method) -> int | None:
    """Return the number of samples from one that is saved to the next, if any is."""
    if isinstance(save, str):
        if save not in SAVES:
            names = ", ".join(repr(name) for name in SAVES)
            raise ValueError(f"save must be one of {names} or a number of samples, got {save!r}")
        return None
    every = whole("save", save)
    if every < 1:
        raise ValueError(f"save must be a number of samples >= 1, got {every}")
    if isinstance(method, SwitchedRK):
        raise ValueError(f"save={every} needs a method of fixed steps, got {method!r}")
    return every
