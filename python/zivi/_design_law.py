"""What the gains of a controller do: accelerations, the time to rest, the largest control."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zivi._check import Array

__all__ = ["Law", "settling"]


@dataclasses.dataclass(frozen=True)
class Law:
    """What the gains make of a controller: accelerations, condition, largest control."""

    kind: Literal["tracker", "regulator"]
    e: float
    force: float
    force_ref: float | None

    def accelerations(self, mu1: Array, mu2: Array) -> tuple[Array, Array]:
        """Give U and D, the net accelerations of a rising and of a falling mass."""
        if self.kind == "regulator":
            return mu1 + mu2 - self.force, mu1 - mu2 - self.force
        part = 2.0 / (1.0 + self.e)
        return part * self.e * (mu1 + mu2), part * (mu1 - mu2)

    def suffices(self, mu1: Array, mu2: Array, bound: float) -> NDArray[np.bool_]:
        """Whether the gains hold a force of this bound."""
        rising, falling = self.accelerations(mu1, mu2)
        holds: NDArray[np.bool_] = (falling > bound) & (
            growth_of(self.e, rising, falling, bound) < 1.0
        )
        if self.kind == "tracker":
            # an unknown force enters as d/R, R >= 2e/(1+e)
            least = bound * (1.0 + self.e) / (2.0 * self.e)
            holds &= (mu2 > least) & (mu2 < mu1 - least)
        return holds

    def peak(self, mu1: float, mu2: float) -> float:
        """Give the largest control."""
        if self.kind == "regulator":
            return mu1 + mu2
        rising, falling = self.accelerations(np.array(mu1), np.array(mu2))
        resting = float(max(rising, falling)) + abs(self.force)
        if self.force_ref is None:
            return resting
        kappa = (1.0 - self.e) / (1.0 + self.e)
        moving = (1.0 + kappa) * (mu1 + mu2 + abs(self.force_ref) / (1.0 - kappa))
        return max(resting, moving + abs(self.force))


def growth_of(e: float, rising: Array, falling: Array, bound: float) -> Array:
    """Give the largest ratio of the speeds of two impacts, e sqrt((D + M)/(U - M))."""
    with np.errstate(invalid="ignore", divide="ignore"):
        growth = e * np.sqrt((falling + bound) / (rising - bound))
    return np.where(rising > bound, growth, np.inf)


def settling(
    e: float, rising: Array, falling: Array, bound: float, start: tuple[float, float]
) -> Array:
    r"""Bound the time to rest from a start, for any unknown force within its bound.

    .. math::

        T = t_c + e V_c \frac{1/(U-M) + 1/\sqrt{(U-M)(D-M)}}{1 - \rho}, \qquad
        \rho = e \sqrt{\frac{D+M}{U-M}}
    """
    x, xdot = start
    slow, fast, brake = falling - bound, falling + bound, rising - bound
    growth = growth_of(e, rising, falling, bound)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        up = max(xdot, 0.0) / brake
        top = x + 0.5 * max(xdot, 0.0) * up
        down = min(xdot, 0.0)
        first = up + 2.0 * top / (np.sqrt(down * down + 2.0 * slow * top) - down)
        speed = np.sqrt(down * down + 2.0 * fast * top)
        first = np.where(top > 0.0, first, 0.0)
        after = e * speed * (1.0 / brake + 1.0 / np.sqrt(brake * slow)) / (1.0 - growth)
        time = first + after
    sure = (slow > 0.0) & (brake > 0.0) & (growth < 1.0)
    return np.where(sure, time, np.inf)
