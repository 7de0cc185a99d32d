"""Least accelerations that do what is requested of a design, and what an actuator allows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.control.design_law import Law
from zivi.control.design_time import Landing, settled

__all__ = ["LARGEST", "Asked", "Found", "feasible_time", "least_limit", "search"]

RESERVE = 1.2
"""By how much the gains exceed what the bound of the unknown force asks for."""
PART = 0.98
"""Part of the settling time that is promised."""
SAMPLING = 0.1
"""Part of it that sampling may take."""
RATIOS = np.sort(np.append(np.geomspace(0.05, 8.0, 80), 1.0))
"""D/U."""
FINER = 0.25 ** np.arange(6)
"""Sampling periods, as parts of the first, that are tried where an actuator has limits."""
LEAST, LARGEST = 1e-12, 1e12
"""Range of U (m/s^2)."""
BISECTIONS = 50
LONGEST = 1e6
"""Times the settling time: longer ones are not looked at."""


@dataclasses.dataclass(frozen=True)
class Asked:
    """What is requested.

    Parameters
    ----------
    law : Law
        Of which controller.
    landing : Landing
        What lands.
    time : float
        Within which time (s).
    limits : (float, float)
        Range of the actuator (m/s^2).
    exact : bool
        Whether the mass has to rest exactly.
    """

    law: Law
    landing: Landing
    time: float
    limits: tuple[float, float]
    exact: bool

    def period(self, ratio: Array) -> Array:
        """Give the sampling period: what sampling costs is a tenth of the time, about."""
        kappa = (1.0 - self.law.e) / (1.0 + self.law.e)
        periods = 3.0 * (1.0 + 1.0 / kappa) * np.maximum(1.0, 1.0 / ratio) + 11.0
        return SAMPLING * self.time / ((1 + self.landing.delay) * periods)

    def ends(self) -> tuple[Array, Array]:
        """Give the least and the largest U for each ratio, but for the time."""
        least = self.law.least(RATIOS, RESERVE * self.landing.bound, self.exact)
        low, high = self.law.allowed(RATIOS, self.limits)
        return np.maximum(np.maximum(least, low), LEAST), np.minimum(high, LARGEST)

    def periods(self) -> Array:
        """Give the sampling periods that are tried, a row for each."""
        limited = any(map(math.isfinite, self.limits))
        return np.outer(FINER if limited else FINER[:1], self.period(RATIOS))

    def in_time(self, braking: Array, h: Array) -> NDArray[np.bool_]:
        """Whether so much brake is enough, for each ratio."""
        found = settled(self.landing, braking, RATIOS * braking, h, PART * self.time)
        enough: NDArray[np.bool_] = found.time <= PART * self.time
        return enough

    def feasible(self) -> bool:
        """Whether any gains do it."""
        low, high = self.ends()
        some = low <= high
        braking = np.where(some, high, 1.0)
        return any(bool((some & self.in_time(braking, h)).any()) for h in self.periods())


@dataclasses.dataclass(frozen=True)
class Found:
    """Accelerations U and D, the sampling period, and what they promise."""

    braking: float
    falling: float
    h: float
    time: float
    height: float


def search(asked: Asked) -> Found | None:
    """Give the least accelerations, None where there are none."""
    low, high = asked.ends()
    some = low <= high
    low, high = np.where(some, low, 1.0), np.where(some, high, 1.0)
    for h in asked.periods():
        possible = some & asked.in_time(high, h)
        if possible.any():
            return _least(asked, (low, high), possible, h)
    return None


def _least(asked: Asked, ends: tuple[Array, Array], possible: NDArray[np.bool_], h: Array) -> Found:
    """Find the least U for each ratio between its ends; of these the least acceleration."""
    low, high = np.log(ends[0]), np.log(ends[1])
    at_once = asked.in_time(ends[0], h)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        good = asked.in_time(np.exp(middle), h)
        low, high = np.where(good, low, middle), np.where(good, middle, high)
    braking = np.where(at_once, ends[0], np.minimum(np.exp(high), ends[1]))
    most = np.where(possible, braking * np.maximum(1.0, RATIOS), np.inf)
    k = int(np.argmin(most))
    U, D = braking[k : k + 1], RATIOS[k] * braking[k : k + 1]
    found = settled(asked.landing, U, D, h[k : k + 1])
    return Found(*(float(it[0]) for it in (U, D, h[k : k + 1], found.time, found.height)))


def feasible_time(asked: Asked) -> float | None:
    """Give the least settling time that the actuator allows, None where it allows none."""

    def feasible(time: float) -> bool:
        return dataclasses.replace(asked, time=time).feasible()

    return _least_of(feasible, asked.time, LONGEST * asked.time)


def least_limit(asked: Asked) -> float | None:
    """Give the least limit of the absolute control that allows what is requested."""

    def feasible(limit: float) -> bool:
        return dataclasses.replace(asked, limits=(-limit, limit)).feasible()

    return _least_of(feasible, LEAST, LARGEST)


def _least_of(feasible: Callable[[float], bool], low: float, high: float) -> float | None:
    """Give the least value above which it is feasible, to a millionth."""
    if not feasible(high):
        return None
    while high > (1.0 + 1e-6) * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if feasible(middle) else (middle, high)
    return high
