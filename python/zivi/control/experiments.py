"""Experiments with controllers that studies can name."""

from __future__ import annotations

import math

import numpy as np

from zivi.base.experiments import registered as _registered
from zivi.control.closed_loop import ClosedLoop, simulate_closed_loop
from zivi.control.twisting import TwistingTracker
from zivi.system.mass import ImpactSystem

__all__ = ["tracker_gains"]


@_registered(
    mu1="m/s^2", mu2="m/s^2", e="1", h="s", x0="m", v0="m/s", disturbance="m/s^2", t_end="s",
    settling_time="s", effort="m/s", peak="m/s^2", error="m", n_refused="1",
)  # fmt: skip
def tracker_gains(
    mu1: float = 30.0,
    mu2: float = 17.0,
    e: float = 1.0 / 3.0,
    h: float = 1e-3,
    x0: float = 6.0,
    v0: float = 5.0,
    disturbance: float = 0.0,
    t_end: float = 3.0,
    tolerance: float = 1e-3,
) -> dict[str, float]:
    """Track a bouncing ball of larger weight through its Zeno point, the paper's task.

    The plant falls with 9.81 m/s^2, the reference, from 3 m with 3 m/s, with 19.81 m/s^2.

    Parameters
    ----------
    mu1, mu2 : float
        Gains on the signs of position and velocity (m/s^2).
    e : float
        Coefficient of restitution of both, 0 < e < 1.
    h : float
        Sampling period (s).
    x0, v0 : float
        Initial height (m) and velocity (m/s) of the plant.
    disturbance : float
        Constant force on the plant that the controller does not know (m/s^2).
    t_end : float
        Length of the run (s).
    tolerance : float
        Position error that counts as settled (m).

    Returns
    -------
    dict
        ``settling_time``, the first sample from which the error stays within `tolerance` to the
        end (s; the start if it always does, NaN if it does not at the end),
        ``effort``, the integral of the absolute control (m/s), ``peak``, the largest absolute
        control (m/s^2), ``error``, the last absolute position error (m), and ``n_refused``, the
        samples that the controller refused.

    Examples
    --------
    >>> found = zivi.study.EXPERIMENTS["tracker_gains"]()
    >>> round(found["settling_time"], 3), found["error"]
    (1.243, 0.0)
    """
    plant = ImpactSystem(-9.81 + disturbance, e=e)
    tracker = TwistingTracker(mu1, mu2, h=h, e=e)
    run = simulate_closed_loop(
        plant,
        tracker,
        (0.0, t_end),
        (x0, v0),
        y_ref0=(3.0, 3.0),
        force_ref=-19.81,
        force_model=-9.81,
        progress=False,
    )
    return {
        "settling_time": _settling_time(run, tolerance),
        "effort": float(h * np.sum(np.abs(run.u[:-1]))),
        "peak": float(np.max(np.abs(run.u))),
        "error": float(abs(run.error[-1])),
        "n_refused": float(run.n_refused),
    }


def _settling_time(run: ClosedLoop, tolerance: float) -> float:
    outside = np.flatnonzero(~(np.abs(run.error) <= tolerance))
    if not len(outside):
        return float(run.t[0])
    last = int(outside[-1])
    return float(run.t[last + 1]) if last + 1 < len(run.t) else math.nan
