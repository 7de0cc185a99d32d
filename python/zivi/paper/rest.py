"""Whether the tracker rests exactly in the sampled loop: that depends on the restitution.

The implicit step plans to end on the wall. The plant, under the control held, meets the wall
before the end of the period and bounces; the remaining motion after a period is proportional to the
initial one, with a factor that depends on e. In the paper's own loop the motion follows the plan.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np
from rich.table import Table

from zivi.control.closed_loop import simulate_closed_loop
from zivi.control.twisting import TwistingTracker
from zivi.paper import report
from zivi.paper.closed_loops import FORCE, MU1, MU2, H
from zivi.paper.report import max_abs
from zivi.simulation.methods import ThetaGamma
from zivi.system.mass import ImpactSystem

RESTITUTIONS = (0.05, 0.1, 0.2, 0.3, 1 / 3, 0.38, 0.4, 0.45, 0.5, 0.6, 0.7, 0.8, 0.9)
STARTS = 50
T_END, TAIL = 4.0, 3.0
SEED = 20161212


@dataclasses.dataclass(frozen=True)
class Rest:
    """All starts at one coefficient of restitution; the reference rests on the wall.

    Parameters
    ----------
    e : float
        Coefficient of restitution of plant and controller.
    starts : int
        How many random starts.
    sampled, paper : int
        How many of them are at exact rest at the end, in the sampled and in the paper's own loop.
    distance, speed : float
        Largest ``x`` (m) and ``|x'|`` (m/s) in the last second of the sampled loop.
    """

    e: float
    starts: int
    sampled: int
    paper: int
    distance: float
    speed: float


def measure_rest(h: float = H) -> list[Rest]:
    """Run all starts for every restitution."""
    return [_measure_restitution(e, h) for e in RESTITUTIONS]


def _measure_restitution(e: float, h: float) -> Rest:
    generator = np.random.default_rng(SEED)
    starts = np.stack(
        [10 ** generator.uniform(-6, 0, STARTS), generator.normal(0.0, 1.0, STARTS)], axis=1
    )
    plant, tracker = ImpactSystem(FORCE, e=e), TwistingTracker(MU1, MU2, h=h, e=e, landing=False)
    at_rest = {"sampled": 0, "paper": 0}
    distance = speed = 0.0
    for start in starts:
        for loop, method in (("sampled", None), ("paper", ThetaGamma(h))):
            run = simulate_closed_loop(
                plant, tracker, (0.0, T_END), start, y_ref0=(0.0, 0.0), method=method
            )
            at_rest[loop] += run.rest_time is not None
            if loop == "sampled":
                tail = run.t >= TAIL
                distance = max(distance, max_abs(run.x[tail]))
                speed = max(speed, max_abs(run.xdot[tail]))
    return Rest(e, STARTS, at_rest["sampled"], at_rest["paper"], distance, speed)


def rest_table(rows: Iterable[Rest]) -> Table:
    """Format the rows for a terminal."""
    return report.terminal_table(
        "Exact rest of the tracker, reference on the wall",
        "starts that end at exact rest; largest x and |x'| in the last second (sampled loop)",
        ("e", "starts", "sampled loop", "paper's loop", "max x", "max |x'|"),
        [tuple(dataclasses.astuple(row)) for row in rows],
    )
