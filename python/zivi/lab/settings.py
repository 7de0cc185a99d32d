"""What the page asks for: one frozen dataclass for each of its tabs."""

from __future__ import annotations

import dataclasses
from typing import Literal, TypeAlias

from zivi._check import finite

__all__ = ["Ball", "Regulator", "Settings", "Tracker", "check"]

MOST_STEPS = 400_000
"""Steps of the longest run that the page computes while a slider moves."""


@dataclasses.dataclass(frozen=True)
class Ball:
    """A ball above a wall, shaken by a harmonic force.

    Parameters
    ----------
    e : float
        Coefficient of restitution.
    h : float
        Step of the methods with fixed steps (s).
    gravity : float
        Pull towards the wall (m/s^2).
    amplitude, omega : float
        Amplitude (m/s^2) and frequency (rad/s) of the disturbance.
    x0, xdot0 : float
        Initial distance (m) and velocity (m/s).
    t_end : float
        End of the run (s).
    """

    e: float = 0.5
    h: float = 1e-2
    gravity: float = 9.81
    amplitude: float = 0.0
    omega: float = 15.0
    x0: float = 1.0
    xdot0: float = 4.0
    t_end: float = 4.0


@dataclasses.dataclass(frozen=True)
class Regulator:
    """A mass that the twisting regulator brings to rest at the wall.

    Parameters
    ----------
    e : float
        Coefficient of restitution.
    h : float
        Sampling period (s).
    mu1, mu2 : float
        Gains (m/s^2).
    force : float
        Force that the controller knows (m/s^2).
    disturbance : float
        Force that it does not know (m/s^2).
    noise_x, noise_xdot : float
        Standard deviations of the measured position (m) and velocity (m/s).
    seed : int
        Seed of the noise.
    delay : int
        Periods from a measurement to its control.
    x0, xdot0 : float
        Initial distance (m) and velocity (m/s).
    t_end : float
        End of the run (s).
    """

    e: float = 0.33
    h: float = 1e-2
    mu1: float = 3.0
    mu2: float = 2.0
    force: float = 0.0
    disturbance: float = 0.0
    noise_x: float = 0.0
    noise_xdot: float = 0.0
    seed: int = 1
    delay: int = 0
    x0: float = 1.0
    xdot0: float = 0.0
    t_end: float = 3.0


@dataclasses.dataclass(frozen=True)
class Tracker:
    """A mass that follows a bouncing reference; fields that `Regulator` has mean the same.

    Parameters
    ----------
    e, h, mu1, mu2, force, disturbance, noise_x, noise_xdot, seed, delay, x0, xdot0, t_end
        As of `Regulator`.
    force_ref : float
        Force on the reference (m/s^2).
    x_ref0, xdot_ref0 : float
        Initial distance (m) and velocity (m/s) of the reference.
    branch : {"positive", "nearest"}
        How the implicit tracker lifts what it measures.
    """

    e: float = 0.33
    h: float = 1e-2
    mu1: float = 30.0
    mu2: float = 17.0
    force: float = -9.81
    disturbance: float = 0.0
    noise_x: float = 0.0
    noise_xdot: float = 0.0
    seed: int = 1
    delay: int = 0
    x0: float = 6.0
    xdot0: float = 5.0
    t_end: float = 4.0
    force_ref: float = -5.0
    x_ref0: float = 3.0
    xdot_ref0: float = 3.0
    branch: Literal["positive", "nearest"] = "positive"


Settings: TypeAlias = Ball | Regulator | Tracker


def check(settings: Settings) -> None:
    """Refuse what would keep the page busy; the library checks the rest.

    Raises
    ------
    ValueError, TypeError
        For a run of too many steps, or an empty field.
    """
    for field in dataclasses.fields(settings):
        if field.name != "branch":
            finite(field.name, getattr(settings, field.name))
    if settings.h > 0.0 and settings.t_end / settings.h > MOST_STEPS:
        raise ValueError(
            f"t_end / h must be at most {MOST_STEPS} steps on this page, "
            f"got {settings.t_end / settings.h:.3g}"
        )
