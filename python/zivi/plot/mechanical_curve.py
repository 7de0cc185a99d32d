"""A run of a mechanical system as lines that can be drawn, with points by the motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from zivi.simulation.linear_motion import LinearMotion

if TYPE_CHECKING:
    from zivi.base.check import Array
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory

__all__ = ["Quantity", "broken", "drawn"]

Quantity: TypeAlias = Literal["q", "phase", "gaps", "reactions", "slips"]
"""What is drawn; ``"phase"`` is coordinates and velocities side by side."""

EVEN = 200
"""So many equidistant intervals at least are looked at."""
PER_STEP = 4
"""So many of them for each step of the method."""
OFF = 1e-3
"""Largest distance of a line from the curve, as a part of the range of the quantity."""
HALVINGS = 12
MOST = 500_000
"""Points at which an interval is no longer halved."""


def drawn(sol: MechanicalTrajectory, quantity: Quantity) -> tuple[Array, Array]:
    """Give times and columns of a quantity whose connecting lines follow the motion.

    The times are those of samples and events, the last moment before each impact, and what
    halving adds where a line is off the curve by more than a thousandth of the range. A run that
    keeps no motion is drawn at its samples.
    """
    path = sol._path
    unknown = quantity == "reactions" and not isinstance(path, LinearMotion) and sol._model is None
    if path is None or not getattr(path, "dense", True) or len(sol.t) < 2 or unknown:
        return sol.t, _sampled(sol, quantity)
    start, end = float(sol.t[0]), float(sol.t[-1])
    tables = (sol.impacts, sol.zeno, sol.liftoffs, sol.openings, sol.transitions)
    events = np.concatenate([rows["t"] for rows in tables])
    known = [sol.t, events, np.nextafter(events, -np.inf)]
    if isinstance(path, LinearMotion):
        known.append(path.t)
    else:
        known.append(np.linspace(start, end, EVEN + PER_STEP * sol.n_steps + 1))
    times = np.unique(np.concatenate(known))
    times = times[(times >= start) & (times <= end)]
    values = _at(sol, quantity, times)
    return (
        (times, values) if isinstance(path, LinearMotion) else _halved(sol, quantity, times, values)
    )


def broken(sol: MechanicalTrajectory, times: Array, values: Array) -> tuple[Array, Array]:
    """Insert NaN before impacts, where velocities jump."""
    after = np.searchsorted(times, np.unique(sol.impacts["t"]))
    after = np.unique(after[(after > 0) & (after < len(times))])
    return np.insert(times, after, np.nan), np.insert(values, after, np.nan, axis=0)


def _halved(
    sol: MechanicalTrajectory, quantity: Quantity, times: Array, values: Array
) -> tuple[Array, Array]:
    """Halve intervals until lines are near the curve."""
    with np.errstate(invalid="ignore"):
        spans = np.nanmax(values, axis=0, initial=-np.inf) - np.nanmin(
            values, axis=0, initial=np.inf
        )
    allowed = OFF * np.where(spans > 0.0, spans, np.inf)
    open_ = np.ones(len(times) - 1, dtype=bool)
    for _ in range(HALVINGS):
        left = np.flatnonzero(open_ & (np.diff(times) > 1e-12 * np.abs(times[1:])))
        if not len(left) or len(times) + len(left) > MOST:
            break
        middle = 0.5 * (times[left] + times[left + 1])
        found = _at(sol, quantity, middle)
        off = np.abs(found - 0.5 * (values[left] + values[left + 1])) > allowed
        far = left[off.any(axis=1)]
        # an interval that is halved gives two that are open
        inside = np.zeros(len(times) - 1, dtype=bool)
        inside[far] = True
        kept = np.isin(left, far)
        open_ = np.repeat(inside, 1 + inside)
        times = np.insert(times, far + 1, middle[kept])
        values = np.insert(values, far + 1, found[kept], axis=0)
    return times, values


def _at(sol: MechanicalTrajectory, quantity: Quantity, times: Array) -> Array:
    """Evaluate a quantity along the motion."""
    if quantity in ("reactions", "slips"):
        return _sampled(sol.resample(times), quantity)
    path: Any = sol._path
    q, qdot, gaps, *_ = path.at(np.ascontiguousarray(times))
    columns: Array = {"q": q, "gaps": gaps, "phase": np.hstack([q, qdot])}[quantity]
    return columns


def _sampled(sol: MechanicalTrajectory, quantity: Quantity) -> Array:
    """Give a quantity at the samples."""
    if quantity == "phase":
        return np.hstack([sol.q, sol.qdot])
    if quantity == "reactions":
        # a reaction jumps where its contact begins and ends
        return np.where(sol.contacts, sol.reactions, np.nan)
    columns: Array = getattr(sol, quantity)
    return columns
