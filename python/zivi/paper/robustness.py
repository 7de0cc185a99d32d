"""The tracker where the world is not as it believes: the paper's problem in the sampled loop."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

from rich.table import Table

from zivi.paper import report
from zivi.paper.closed_loops import FORCE, IMPLICIT, largest, last_above, track

__all__ = ["DISTURBANCES", "Robustness", "measure", "table"]

SEED = 20161212
T_END = 6.0
TAIL = 5.0
"""Errors and speeds are taken from here on (s); the reference rests since 1.28 s."""
NEAR = 1e-2

DISTURBANCES: dict[str, dict[str, Any]] = {
    "none": {},
    "force -5": {"force": FORCE - 5},
    "force -1.5": {"force": FORCE - 1.5},
    "force +1.5": {"force": FORCE + 1.5},
    "force +5": {"force": FORCE + 5},
    "e = 0.3 in the controller": {"e": 0.3},
    "e = 0.4 in the controller": {"e": 0.4},
    "e_ref = 0.3": {"e_ref": 0.3},
    "e_ref = 0.4": {"e_ref": 0.4},
    "noise 1e-5 m, 1e-3 m/s": {"noise": (1e-5, 1e-3), "seed": SEED},
    "noise 1e-4 m, 1e-2 m/s": {"noise": (1e-4, 1e-2), "seed": SEED},
    "noise 1e-3 m, 1e-1 m/s": {"noise": (1e-3, 1e-1), "seed": SEED},
    "delay 1 period": {"delay": 1},
    "delay 2 periods": {"delay": 2},
    "delay 5 periods": {"delay": 5},
    "steps of 1e-5 m, 1e-3 m/s": {"quantization": (1e-5, 1e-3)},
    "steps of 1e-4 m, 1e-2 m/s": {"quantization": (1e-4, 1e-2)},
    "steps of 1e-3 m, 1e-1 m/s": {"quantization": (1e-3, 1e-1)},
}
"""What is wrong in each run, and the arguments that make it so. The plant has e = 1/3."""


@dataclasses.dataclass(frozen=True)
class Robustness:
    """One run.

    Parameters
    ----------
    disturbance : str
        What is wrong.
    branch : str
        Branch strategy of the tracker.
    reached : float
        Last time at which ``|x - x_r|`` was above 1 cm (s).
    error : float
        Largest ``|x - x_r|`` in the last second (m).
    speed : float
        Largest ``|x'|`` in the last second, where the reference rests (m/s).
    u_low, u_high : float
        Range of the control in the last second (m/s^2).
    """

    disturbance: str
    branch: str
    reached: float
    error: float
    speed: float
    u_low: float
    u_high: float


def measure() -> list[Robustness]:
    """Run every disturbance in both branch strategies."""
    return [
        _measured(name, branch, given)
        for name, given in DISTURBANCES.items()
        for branch in IMPLICIT
    ]


def _measured(name: str, branch: str, given: dict[str, Any]) -> Robustness:
    run = track(branch, t_end=T_END, **given)
    tail = run.t >= TAIL
    return Robustness(
        disturbance=name,
        branch=branch,
        reached=last_above(run, NEAR),
        error=largest(run.error[tail]),
        speed=largest(run.xdot[tail]),
        u_low=float(run.u[tail].min()),
        u_high=float(run.u[tail].max()),
    )


def table(rows: Iterable[Robustness]) -> Table:
    """Lay the rows out for a terminal."""
    return report.table(
        "The tracker under disturbances",
        "reached: last |x - x_r| > 1 cm; the rest in the last second, the reference at rest",
        ("disturbance", "branch", "reached", "max |e|", "max |x'|", "min u", "max u"),
        [tuple(dataclasses.astuple(row)) for row in rows],
    )
