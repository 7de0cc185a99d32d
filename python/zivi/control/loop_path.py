"""The motion of a closed loop between its samples: that of the plant, and that of the reference."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.simulation.dense import LinearPath
from zivi.system.transform import lift, project

__all__ = ["BallisticPath", "Reference", "SampledReference", "on_side", "path_of", "sides"]

LISTED = 1000
"""Impacts that a period lists; further ones are skipped in closed form."""


def sides(times: Array, impacts: Array) -> Array:
    """Give the branch at `times`, which increase: 1, and the other after each impact."""
    ends = np.concatenate(([0], np.searchsorted(times, impacts), [len(times)]))
    branches = np.ones(len(impacts) + 1)
    branches[1::2] = -1.0
    return np.repeat(branches, np.diff(ends))


@dataclasses.dataclass(frozen=True)
class BallisticPath:
    """Exact motion from each sample under an acceleration that is held.

    Parameters
    ----------
    t, x, xdot : ndarray
        The samples (s, m, m/s).
    net : ndarray
        The acceleration from each sample on (m/s^2).
    side : ndarray
        The branch at each sample.
    wall : (float, float)
        `e` and `kappa`.
    full : ndarray, shape (n, 3)
        Periods that list no more impacts: number, time and speed of the last one that is listed.
    """

    t: Array
    x: Array
    xdot: Array
    net: Array
    side: Array
    wall: tuple[float, float]
    full: Array
    dense: bool = True

    @property
    def span(self) -> tuple[float, float]:
        """The times of the first and the last sample (s)."""
        return float(self.t[0]), float(self.t[-1])

    def _at(self, times: Array) -> tuple[Array, Array, Array]:
        k = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, len(self.t) - 1)
        rows = np.column_stack([self.x[k], self.xdot[k], self.net[k], times - self.t[k]])
        end = _zivi.ballistic_motion(rows, _zivi.Restitution.of_both(*self.wall))
        return end.x, end.xdot, self.side[k] * (1.0 - 2.0 * (end.n_impacts % 2))

    def physical(self, times: Array) -> tuple[Array, Array]:
        """Give ``(x, xdot)``, after the impact where there is one."""
        return self._at(times)[:2]

    def lifted(self, times: Array) -> tuple[Array, Array]:
        """Give ``(s, v)``."""
        x, xdot, side = self._at(times)
        return on_side(x, xdot, side, self.wall[1])

    def skipped_impacts(self, speed: float, at_most: int) -> tuple[Array, Array, Array]:
        """Give the impacts beyond the listed ones of each period: a geometric series."""
        e = self.wall[0]
        found: list[Array] = [np.empty((0, 3))]
        for number, t, u in self.full:
            k = int(number)
            n = np.arange(1.0, _impacts_down_to(speed, u, e, at_most) + 1.0)
            # impact n is 2 u (1 + e + ... + e^(n-1))/-f later, and e^n as fast
            times = t + np.cumsum(2.0 * u * e ** (n - 1.0) / -self.net[k])
            rows = np.column_stack([times, -u * e ** (n - 1.0), u * e**n])
            found.append(rows[(times <= self.t[k + 1]) & (rows[:, 2] >= speed)])
        t, before, after = np.concatenate(found).T
        return t, before, after


def _impacts_down_to(speed: float, u: float, e: float, at_most: int) -> int:
    """Bound the impacts after one that leaves `u` which leave `speed`, by ``u e^n >= speed``."""
    if not 0.0 < speed < u or not 0.0 < e < 1.0:
        return at_most if speed <= u else 0
    return min(at_most, math.ceil(math.log(speed / u) / math.log(e)))


def on_side(x: Array, xdot: Array, side: Array, kappa: float) -> tuple[Array, Array]:
    """Lift states to the branches on which they are."""
    s, v = lift(x, xdot, kappa=kappa)
    # no negative zeros
    return side * s + 0.0, side * v + 0.0


def path_of(record: _zivi.LoopRecord, impacts: NDArray[np.void], wall: tuple[float, float]) -> Any:
    """Give the motion of the plant between its samples, None if it was not kept."""
    t, x, xdot, _, _, u = record.columns
    if record.own_force is not None:
        side, net = sides(t, impacts["t"]), record.own_force + u
        return BallisticPath(t, x, xdot, net, side, wall, _full(t, impacts))
    if record.lifted is not None:
        s, v = record.lifted.s[: len(t)], record.lifted.v[: len(t)]
        return LinearPath(t, s, v, wall[1])
    return record.path


def _full(t: Array, impacts: NDArray[np.void]) -> Array:
    """Find the periods that list as many impacts as they may."""
    if len(impacts) < LISTED:
        return np.empty((0, 3))
    ends = np.searchsorted(impacts["t"], t, side="right")
    k = np.flatnonzero(np.diff(ends) >= LISTED)
    last = impacts[ends[k + 1] - 1]
    return np.column_stack([k, last["t"], last["xdot_after"]])


class Reference(Protocol):
    """The motion of a reference."""

    def lifted(self, times: Array) -> tuple[Array, Array]:
        """``(s_r, v_r)`` at `times`."""

    def physical(self, times: Array) -> tuple[Array, Array]:
        """``(x_r, xdot_r)`` at `times`."""


@dataclasses.dataclass(frozen=True)
class SampledReference:
    """A reference that is known at the samples: ``s_r`` and ``v_r`` are linear between them.

    Parameters
    ----------
    t, x, xdot : ndarray
        The samples (s, m, m/s); the velocity may be unknown, NaN.
    kappa : float
        Of the wall of the reference.
    """

    t: Array
    x: Array
    xdot: Array
    kappa: float

    @functools.cached_property
    def _path(self) -> LinearPath:
        h, x, end = np.diff(self.t), self.x, self.xdot[1:]
        # s+ = s + h R v+ of the implicit step: on the other branch it is x+ + x = h xdot+
        through = np.abs(x[1:] + x[:-1] - h * end) < np.abs(x[1:] - x[:-1] - h * end)
        side = np.cumprod(np.append(1.0, np.where(through, -1.0, 1.0)))
        s, v = on_side(x, self.xdot, side, self.kappa)
        return LinearPath(self.t, s, v, self.kappa)

    def lifted(self, times: Array) -> tuple[Array, Array]:
        """Give ``(s_r, v_r)``."""
        return self._path.lifted(times)

    def physical(self, times: Array) -> tuple[Array, Array]:
        """Give ``(x_r, xdot_r)``."""
        if np.isnan(self.xdot).all():
            return np.interp(times, self.t, self.x), np.full(times.shape, np.nan)
        s, v = self.lifted(times)
        return project(s, v, kappa=self.kappa)
