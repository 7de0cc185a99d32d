"""The twisting regulator of section III brings the mass to rest (figure 5, section V.B).

The paper does not state the gains of its figure 5. Chosen here: mu1 = 3, mu2 = 2, F = 0,
kappa = 1/2, from (x, x') = (1, 0); for them the settling time has a closed form.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from zivi import plot
from zivi.control.loop_run import ClosedLoop
from zivi.paper.closed_loops import (
    PAPER_LOOP,
    REGULATION,
    REGULATOR,
    START_REGULATOR,
    E,
    lift_run,
    regulate,
)
from zivi.paper.report import Check, PaperFigure, draw_sv_plane, loop_data, max_abs, rest_time_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


STEPS = (1e-2, 1e-3, 1e-4)
FINE = 1e-6


def exact_settling() -> float:
    """Exact settling time (s): flights of constant deceleration, speeds in a geometric series."""
    mu1, mu2 = REGULATOR
    x0, _ = START_REGULATOR
    rising, falling = mu1 + mu2, mu1 - mu2
    first, speed = math.sqrt(2 * x0 / falling), math.sqrt(2 * x0 * falling)
    ratio = E * math.sqrt(falling / rising)
    flight = 1 / rising + 1 / math.sqrt(rising * falling)
    return first + E * speed * flight / (1 - ratio)


def draw_regulator(run: ClosedLoop) -> Iterator[PaperFigure]:
    """Draw figure 5, in the (s, v) plane, and the same run over time."""
    settings = REGULATION | {"loop": PAPER_LOOP}
    s, v = lift_run(run)
    data = {"": loop_data(run, "x", "xdot").assign(s=s, v=v)}
    title = "The regulator in the (s, v) plane"
    remark = "Gains, kappa and start are ours: the paper gives no numbers."
    figure = draw_sv_plane(s, v, (6e-4, 0.025))
    yield PaperFigure("fig5_regulator_sv_plane", title, settings, figure, data, remark)
    title, data = "The regulator over time", {"": loop_data(run)}
    yield PaperFigure("regulator_over_time", title, settings, _draw_regulator_history(run), data)


def _draw_regulator_history(run: ClosedLoop) -> Figure:
    result = plot.overview(run)
    for ax in result.axes:
        ax.axvline(exact_settling(), color="0.5", ls=":", lw=1)
    result.axes[0].text(
        exact_settling(), 0.9, f" settling time\n {exact_settling():.4f} s", va="top"
    )
    result.axes[3].legend(loc="center left")
    return result


LOOPS = {"paper": False, "sampled": True}


def check_regulator() -> list[Check]:
    """Hold both loops against the closed form of the settling time."""
    exact = exact_settling()
    result = []
    for name, sampled in LOOPS.items():
        for h in STEPS:
            # like the Zeno point of the ball, h log(1/h)
            bound = 2 * h * math.log(1 / h)
            settled = rest_time_of(regulate(h, sampled=sampled))
            result.append(Check(f"settles, {name}, h={h:.0e} (s)", settled, exact, "exact", bound))
    limit = rest_time_of(regulate(FINE, t_end=2.0))
    result.append(Check(f"settles, paper, h={FINE:.0e} (s)", limit, exact, "exact", 3e-5))
    for name, sampled in LOOPS.items():
        run = regulate(sampled=sampled)
        still = run.t > rest_time_of(run)
        unrest = max_abs(np.stack([run.x[still], run.xdot[still]]))
        result.append(Check(f"regulator at rest, {name}", unrest, 0.0, "exact", 0.0))
    return result
