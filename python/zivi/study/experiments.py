"""Experiments that studies can name: plain functions of numbers."""

from __future__ import annotations

import math

import numpy as np

# `whole`: the text of an experiment identifies its studies
from zivi.base.check import Array, finite, integer as whole
from zivi.base.experiments import EXPERIMENTS, experiment, registered
from zivi.simulation.methods import SwitchedRK, ThetaGamma
from zivi.simulation.run import simulate
from zivi.system.gap import HarmonicWall
from zivi.system.mass import ImpactSystem

__all__ = ["EXPERIMENTS", "ball_rest_time", "experiment", "registered", "table_period"]

_registered = registered  # stored studies are known by the text of their experiment, with this name


@_registered(
    e="1", x0="m", v0="m/s", g="m/s^2", h="s",
    rest_time="s", exact="s", error="s", n_impacts="1",
)  # fmt: skip
def ball_rest_time(
    e: float = 0.5, x0: float = 1.0, v0: float = 0.0, g: float = 9.81, h: float = 0.0
) -> dict[str, float]:
    r"""Let a ball bounce until it rests.

    .. math:: t_Z = \frac{v_0 + V}{g} + \frac{2 e V}{g (1 - e)}, \quad V^2 = v_0^2 + 2 g x_0

    Parameters
    ----------
    e : float
        Coefficient of restitution, 0 < e < 1.
    x0, v0 : float
        Initial height (m) and velocity (m/s).
    g : float
        Gravity, > 0 (m/s^2).
    h : float
        Step of `ThetaGamma` (s); with 0, `SwitchedRK` with its error control.

    Returns
    -------
    dict
        ``rest_time`` (s), ``exact``, the formula (s), ``error``, their difference (s), and
        ``n_impacts``, those that the steps resolve.

    Examples
    --------
    >>> round(zivi.study.EXPERIMENTS["ball_rest_time"](e=0.5)["rest_time"], 6)
    1.354571
    """
    if not (0.0 < finite("e", e) < 1.0 and finite("g", g) > 0.0):
        raise ValueError(f"a ball rests for 0 < e < 1 and g > 0, got e = {e}, g = {g}")
    speed = math.sqrt(v0**2 + 2.0 * g * x0)
    exact = (v0 + speed) / g + 2.0 * e * speed / (g * (1.0 - e))
    ball = ImpactSystem(-g, e=e)
    method = ThetaGamma(h=h) if h else SwitchedRK()
    run = simulate(ball, (0.0, 1.1 * exact + 10.0 * h), (x0, v0), method, progress=False)
    rest = math.nan if run.rest_time is None else run.rest_time
    return {
        "rest_time": rest,
        "exact": exact,
        "error": rest - exact,
        "n_impacts": float(len(run.impacts)),
    }


@_registered(
    Gamma="1", e="1", omega="rad/s", g="m/s^2",
    period="1", impacts="1", speed="m/s", sticks="1",
)  # fmt: skip
def table_period(
    Gamma: float = 1.2,
    e: float = 0.5,
    omega: float = 2.0 * math.pi,
    g: float = 9.81,
    transient: int = 300,
    longest: int = 16,
    tolerance: float = 1e-5,
) -> dict[str, float]:
    r"""Let a ball bounce on a table :math:`a \sin \omega t` and find the period of its motion.

    It starts on the orbit of period 1, slightly beside it, which is stable for

    .. math:: \pi \frac{1-e}{1+e} < \Gamma < \sqrt{\pi^2 \left(\frac{1-e}{1+e}\right)^2
        + \frac{4 (1+e^2)^2}{(1+e)^4}}, \quad \Gamma = a \omega^2 / g

    Parameters
    ----------
    Gamma : float
        Largest acceleration of the table in units of `g`, > 0.
    e : float
        Coefficient of restitution, 0 <= e < 1.
    omega : float
        Circular frequency of the table, > 0 (rad/s).
    g : float
        Gravity, > 0 (m/s^2).
    transient : int
        Periods of the table that are discarded, >= 0.
    longest : int
        Longest period that is looked for, in periods of the table, >= 1.
    tolerance : float
        How far from itself a motion may be after a period: velocities in units of
        ``g`` times the period of the table, positions in units of ``g`` times its square.

    Returns
    -------
    dict
        ``period`` in periods of the table (NaN if there is none up to `longest`), ``impacts`` in
        `longest` of them, ``speed``, the largest relative speed after an impact (m/s), and
        ``sticks``, whether the ball came to rest on the table.

    Examples
    --------
    >>> [zivi.study.EXPERIMENTS["table_period"](Gamma)["period"] for Gamma in (1.5, 1.56)]
    [1.0, 2.0]
    """
    for name, value in {"Gamma": Gamma, "omega": omega, "g": g, "tolerance": tolerance}.items():
        if not finite(name, value) > 0.0:
            raise ValueError(f"{name} must be > 0, got {value}")
    if whole("transient", transient) < 0 or whole("longest", longest) < 1:
        raise ValueError(f"transient must be >= 0, longest >= 1, got {transient}, {longest}")
    period = 2.0 * math.pi / omega
    cosine = min(1.0, math.pi * (1.0 - e) / ((1.0 + e) * Gamma))
    # the impact of the orbit of period 1 is at t = 0
    phase = math.acos(cosine) - 0.5 * math.pi
    table = HarmonicWall(Gamma * g / omega**2, omega, phase)
    start = 1.01 * 0.5 * g * period - Gamma * g / omega * cosine
    times = period * (transient + np.arange(2 * longest + 1) + 0.25)
    ball = ImpactSystem(-g, e=e, wall=table)
    run = simulate(
        ball, (0.0, float(times[-1])), (0.0, max(start, 0.0)), t_eval=times, progress=False
    )
    if not run.success:
        raise ArithmeticError(run.message)
    orbit = np.stack([run.x / (g * period**2), run.xdot / (g * period)])
    late = run.impacts[run.impacts["t"] > times[longest]]
    return {
        "period": _samples_per_period(orbit, longest, tolerance),
        "impacts": float(len(late)),
        "speed": float(np.max(late["xdot_after"], initial=0.0)),
        "sticks": float(np.any(run.zeno_times > times[0])),
    }


def _samples_per_period(orbit: Array, longest: int, tolerance: float) -> float:
    """Find after how many samples a motion repeats itself."""
    for step in range(1, longest + 1):
        if np.max(np.abs(orbit[:, step:] - orbit[:, :-step])) <= tolerance:
            return float(step)
    return math.nan
