"""What the page asks for: one frozen dataclass for each of its tabs."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal, TypeAlias

from zivi.base.check import finite, switch

__all__ = ["Ball", "Belt", "Regulator", "Settings", "Tracker", "check", "landing_of", "observer_of"]

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
    amplitude, omega : float
        Amplitude (m/s^2) and frequency (rad/s) of a harmonic force that it does not know either.
    landing : bool
        Whether the implicit controller lands.
    noise_x, noise_xdot : float
        Standard deviations of the measured position (m) and velocity (m/s).
    seed : int
        Seed of the noise.
    delay : int
        Periods from a measurement to its control.
    observer : bool
        Whether an observer stands between the sensor and both controllers.
    position_only : bool
        Whether it takes positions alone.
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
    amplitude: float = 0.0
    omega: float = 3.0
    landing: bool = True
    noise_x: float = 0.0
    noise_xdot: float = 0.0
    seed: int = 1
    delay: int = 0
    observer: bool = False
    position_only: bool = False
    x0: float = 1.0
    xdot0: float = 0.0
    t_end: float = 3.0


@dataclasses.dataclass(frozen=True)
class Tracker:
    """A mass that follows a bouncing reference; fields that `Regulator` has mean the same.

    Parameters
    ----------
    e, h, mu1, mu2, force, disturbance, amplitude, omega, landing, noise_x, noise_xdot, seed, delay
        As of `Regulator`.
    observer, position_only, x0, xdot0, t_end
        As of `Regulator`.
    force_ref : float
        Force on the reference (m/s^2).
    x_ref0, xdot_ref0 : float
        Initial distance (m) and velocity (m/s) of the reference.
    branch : {"positive", "nearest"}
        How the implicit tracker lifts what it measures.
    drawn : bool
        Whether the reference is drawn by hand: from `x_ref0` through the heights.
    height1, height2, height3, height4, height5 : float
        Heights of the drawn reference after each fifth of the run (m).
    """

    e: float = 0.33
    h: float = 1e-2
    mu1: float = 30.0
    mu2: float = 17.0
    force: float = -9.81
    disturbance: float = 0.0
    amplitude: float = 0.0
    omega: float = 3.0
    landing: bool = True
    noise_x: float = 0.0
    noise_xdot: float = 0.0
    seed: int = 1
    delay: int = 0
    observer: bool = False
    position_only: bool = False
    x0: float = 6.0
    xdot0: float = 5.0
    t_end: float = 4.0
    force_ref: float = -5.0
    x_ref0: float = 3.0
    xdot_ref0: float = 3.0
    branch: Literal["positive", "nearest"] = "positive"
    drawn: bool = False
    height1: float = 1.0
    height2: float = 2.0
    height3: float = 0.0
    height4: float = 0.0
    height5: float = 1.5

    @property
    def heights(self) -> tuple[float, ...]:
        """Heights of the drawn reference, from its beginning to its end (m)."""
        later = (self.height1, self.height2, self.height3, self.height4, self.height5)
        return (self.x_ref0, *later)


@dataclasses.dataclass(frozen=True)
class Belt:
    """A mass of 1 kg at a spring on a belt with dry friction.

    Parameters
    ----------
    h : float
        Step of the methods with fixed steps (s).
    limit : float
        Friction while the mass slips (N).
    extra : float
        By how much more it holds a mass that sticks (N).
    speed : float
        Speed of the belt (m/s).
    stiffness, damping : float
        Of the spring (N/m) and of a damper beside it (N s/m).
    x0, xdot0 : float
        Initial position (m) and velocity (m/s).
    t_end : float
        End of the run (s).
    """

    h: float = 1e-2
    limit: float = 0.8
    extra: float = 0.4
    speed: float = 0.2
    stiffness: float = 1.0
    damping: float = 0.0
    x0: float = 0.0
    xdot0: float = 0.2
    t_end: float = 30.0


Settings: TypeAlias = Ball | Regulator | Tracker | Belt


def check(settings: Settings) -> None:
    """Refuse what would keep the page busy; the library checks the rest.

    Raises
    ------
    ValueError, TypeError
        For a run of too many steps, or an empty field.
    """
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if isinstance(field.default, bool):
            switch(field.name, value)
        elif field.name != "branch":
            finite(field.name, value)
    if settings.h > 0.0 and settings.t_end / settings.h > MOST_STEPS:
        raise ValueError(
            f"t_end / h must be at most {MOST_STEPS} steps on this page, "
            f"got {settings.t_end / settings.h:.3g}"
        )


def landing_of(given: Regulator | Tracker) -> dict[str, Any]:
    """Give the arguments of an implicit controller that are of the landing."""
    return {"landing": True, "ahead": 1 + given.delay} if given.landing else {"landing": False}


LEAST_NOISE = (1e-6, 1e-4)
"""What an observer takes for the noise of an exact sensor (m, m/s)."""


def observer_of(given: Regulator | Tracker) -> dict[str, Any]:
    """Give the arguments of the observer beside `e` and `h`.

    The variance of the change of the unknown force is 7 (h max|d'|)^2, but at least that of a
    random walk of 1 m^2/s^5.
    """
    least_x, least_xdot = LEAST_NOISE
    walk = given.h * given.amplitude * given.omega
    return {
        "noise": (max(given.noise_x, least_x), max(given.noise_xdot, least_xdot)),
        "q_d": max(given.h, 7.0 * walk**2),
        "dmax": max(20.0, 2.0 * (abs(given.disturbance) + given.amplitude)),
        "position_only": given.position_only,
    }
