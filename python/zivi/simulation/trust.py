"""Until when a run is near the motion: the same run beside it, at tighter tolerances.

Tolerances bound the errors of steps. What the motion makes of them, which in a chaotic one grow
like ``exp(lambda t)``, shows where a run of much smaller errors parts from it. That one starts and
is thrown back with a few roundings' difference, so that those of exact flights are seen, too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from zivi.base.check import Array
from zivi.base.extras import late
from zivi.system.impact_law import ImpactLaw, NewtonImpact, Restitutions, restitutions

if TYPE_CHECKING:
    from zivi.simulation.methods import SwitchedRK
    from zivi.simulation.run_result import SampledRun
    from zivi.system.mass import ImpactSystem
    from zivi.system.mechanism import MechanicalSystem

__all__ = ["Closer", "closer_mass", "closer_mechanism", "trust_note", "trusted"]

Closer: TypeAlias = Callable[[Array], Array]
"""Positions at times, a row for each, of a run with smaller errors; fewer if it ended early."""

MOST = 300.0
"""A run that is off by more is not trusted: relative tolerances of the largest position."""
TIGHTER = 0.01
LEAST_RTOL = 1e-14
ULPS = 4 * 2.0**-52
TIMES = 1000
"""Times of comparison, besides those of the samples."""


def trusted(sol: SampledRun, positions: Array) -> float:
    """Give the last time up to which a run agrees with a closer one.

    Parameters
    ----------
    sol : Trajectory or MechanicalTrajectory
        The run.
    positions : ndarray
        Those of its samples.
    """
    closer: Closer | None = sol._closer
    if closer is None:
        raise ValueError(
            "trusted_until is there for a run of SwitchedRK in the process that made it: "
            "a run of another method, or a stored one, does not know its system"
        )
    times, at = sol.t, positions.reshape(len(sol.t), -1)
    if sol._path is not None and getattr(sol._path, "dense", True):
        between = np.linspace(sol.t[0], sol.t[-1], TIMES)
        times = np.unique(np.concatenate([times, between]))
        at = sol(times)[0].reshape(len(times), -1)
    if len(times) < 2:
        return float(times[-1])
    near = closer(times)
    settings: Any = sol.config["method"]
    atol = np.broadcast_to(settings["atol"], 2)[0]
    most = MOST * (settings["rtol"] * np.abs(at).max(axis=0) + atol)
    apart = np.flatnonzero((np.abs(at[: len(near)] - near) > most).any(axis=1))
    agree = int(apart[0]) if len(apart) else len(near)
    return float(times[max(agree - 1, 0)])


def trust_note(sol: SampledRun) -> str:
    """Say until when a run is trusted, where that is known and not its end."""
    until = vars(sol).get("trusted_until")
    return "" if until is None or until >= sol.t[-1] else f", trusted until {until:.6g} s"


def closer_mass(
    system: ImpactSystem,
    method: SwitchedRK,
    start: float,
    state: tuple[float, float],
    stops: Array,
    times: Array,
) -> Array:
    """Give the positions of the closer run of a mass."""
    near = type(system)(system.force, e=_nearby(system.law), wall=system.wall)
    begin = (state[0] * (1 + ULPS), state[1] * (1 - ULPS))
    x: Array = late("zivi.simulation.run", "simulate")(
        near,
        (start, float(times[-1])),
        begin,
        _tighter(method),
        t_eval=times,
        dense_output=False,
        progress=False,
        tstops=stops,
    ).x
    return x[:, None]


def closer_mechanism(
    system: MechanicalSystem,
    method: SwitchedRK,
    start: float,
    state: tuple[Array, Array],
    stops: Array,
    times: Array,
) -> Array:
    """Give the coordinates of the closer run of a mechanical system, from the same place."""
    near = object.__new__(type(system))
    vars(near).update(vars(system), _e=_nearby_of_gaps(system._e))
    q, qdot = state
    at: Array = late("zivi.simulation.run", "simulate")(
        near,
        (start, float(times[-1])),
        (q, qdot * (1 - ULPS)),
        _tighter(method),
        t_eval=times,
        dense_output=False,
        progress=False,
        tstops=stops,
    ).q
    return at


def _tighter(method: SwitchedRK) -> SwitchedRK:
    rtol = max(method.rtol * TIGHTER, LEAST_RTOL)
    atol = tuple(TIGHTER * np.broadcast_to(method.atol, 2))
    return dataclasses.replace(method, rtol=rtol, atol=atol)


def _nearby(law: ImpactLaw) -> float | ImpactLaw:
    """Move a law by some roundings."""
    if isinstance(law, NewtonImpact):
        moved: float = _moved(law.e)
        return moved
    first = dataclasses.fields(law)[0].name
    return dataclasses.replace(law, **{first: _moved(getattr(law, first))})


def _nearby_of_gaps(e: Restitutions) -> Restitutions:
    """Move those of all gaps."""
    if isinstance(e, tuple):
        return restitutions([_nearby(law) for law in e], len(e))
    moved: Array = _moved(e)
    return moved


def _moved(e: Any) -> Any:
    """Move restitutions by some roundings; 1 stays elastic, 0 plastic."""
    moved = np.where(np.asarray(e) < 1.0, np.asarray(e) * (1 - ULPS), e)
    return float(moved) if moved.ndim == 0 else moved
