"""Common part of the closed loops of section V.B: data and the two loops."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Literal

import numpy as np

from zivi.base.check import Array
from zivi.base.status import ModelWarning
from zivi.control.closed_loop import simulate_closed_loop
from zivi.control.loop_run import ClosedLoop
from zivi.control.twisting import ExplicitTwisting, TwistingRegulator, TwistingTracker
from zivi.simulation.methods import ThetaGamma
from zivi.system.mass import Force, ImpactSystem, lift

KAPPA = 0.5
E = (1 - KAPPA) / (1 + KAPPA)
H = 1e-3

# the tracking problem: the paper's data
MU1, MU2 = 30.0, 17.0
FORCE, FORCE_REF = -9.81, -19.81
START, START_REF = (6.0, 5.0), (3.0, 3.0)
T_TRACKING = 4.0

# the paper gives neither gains nor start of its figure 5: these are ours
REGULATOR = (3.0, 2.0)
START_REGULATOR = (1.0, 0.0)
T_REGULATOR = 2.5

PAPER_LOOP = "the paper's, plant by the implicit step"

REGULATION: dict[str, float | str] = {
    "h": H,
    "mu1": REGULATOR[0],
    "mu2": REGULATOR[1],
    "kappa": KAPPA,
    "F": 0.0,
    "x(0)": START_REGULATOR[0],
    "x'(0)": START_REGULATOR[1],
    "branch": "positive",
    "law": "the paper's, without contact-establishing law",
}
TRACKING: dict[str, float | str] = {
    "h": H,
    "mu1": MU1,
    "mu2": MU2,
    "kappa": KAPPA,
    "kappa_ref": KAPPA,
    "F": FORCE,
    "F_ref": FORCE_REF,
    "x(0)": START[0],
    "x'(0)": START[1],
    "x_ref(0)": START_REF[0],
    "x_ref'(0)": START_REF[1],
}
"""What the figures state."""

IMPLICIT = ("positive", "nearest")
"""Branch strategies of the implicit tracker."""


def regulate(
    h: float = H, *, sampled: bool = False, landing: bool = False, t_end: float = T_REGULATOR
) -> ClosedLoop:
    """Run the regulator of figure 5, in the paper's own loop or in others."""
    return simulate_closed_loop(
        ImpactSystem(0.0, kappa=KAPPA),
        TwistingRegulator(*REGULATOR, h=h, kappa=KAPPA, landing=landing),
        (0.0, t_end),
        START_REGULATOR,
        method=None if sampled else ThetaGamma(h),
    )


def track(
    controller: str = "positive",
    h: float = H,
    *,
    sampled: bool = True,
    start: Sequence[float] = START,
    start_ref: Sequence[float] = START_REF,
    force: Force = FORCE,
    force_ref: float = FORCE_REF,
    t_end: float = T_TRACKING,
    e: float | None = None,
    e_ref: float | None = None,
    noise: Sequence[float] = (0.0, 0.0),
    quantization: Sequence[float] = (0.0, 0.0),
    delay: int = 0,
    seed: int | None = None,
    landing: bool = False,
) -> ClosedLoop:
    """Run a tracker (``positive``, ``nearest`` or ``explicit``) on the paper's data.

    The controller's model always has `FORCE`; `e` and `e_ref` are its own, by default the plant's;
    the law is the paper's unless it is to land.
    """
    # kappa, not e: in the last digit they differ, and the time of exact rest shows it
    kappa = KAPPA if e is None else None
    tracker: ExplicitTwisting | TwistingTracker
    if controller == "explicit":
        tracker = ExplicitTwisting(MU1, MU2, h=h, e=e, kappa=kappa, e_ref=e_ref)
    else:
        branch: Literal["positive", "nearest"] = (
            "nearest" if controller == "nearest" else "positive"
        )
        tracker = TwistingTracker(
            MU1, MU2, h=h, e=e, kappa=kappa, e_ref=e_ref, branch=branch, landing=landing
        )
    with warnings.catch_warnings():
        # the table is about an e that differs from the plant's
        warnings.simplefilter("ignore", ModelWarning)
        return simulate_closed_loop(
            ImpactSystem(force, kappa=KAPPA),
            tracker,
            (0.0, t_end),
            start,
            y_ref0=start_ref,
            force_ref=force_ref,
            force_model=FORCE,
            method=None if sampled else ThetaGamma(h),
            noise=noise,
            seed=seed,
            quantization=quantization,
            delay=delay,
        )


def lift_run(run: ClosedLoop, kappa: float = KAPPA) -> tuple[Array, Array]:
    """Lift the plant to ``(s, v)`` without jumps: the side changes at impacts."""
    s, v = lift(run.x, run.xdot, kappa=kappa)
    side = (-1.0) ** np.searchsorted(run.resolved_impacts["t"], run.t, side="right")
    return side * s, side * v


def closed_form_zeno(state: Sequence[float], force: float, e: float = E) -> float:
    """Zeno point (s) of a mass that starts in `state` under a constant force towards the wall."""
    x, xdot = state
    speed = math.sqrt(xdot**2 - 2 * force * x)
    return (xdot + speed + 2 * e * speed / (1 - e)) / -force


def last_above(run: ClosedLoop, bound: float) -> float:
    """Last sample (s) at which ``|x - x_r|`` is above `bound`; NaN if it never is."""
    above = run.t[np.abs(run.error) > bound]
    return float(above[-1]) if above.size else math.nan
