"""The motion between the samples."""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol

import numpy as np

from zivi.base.check import Array
from zivi.system.mass import project


class DenseMotion(Protocol):
    """The motion as a function of time."""

    @property
    def dense(self) -> bool:
        """Whether dense output is stored."""

    @property
    def span(self) -> tuple[float, float] | None:
        """The times between which the motion is known (s)."""

    def lifted(self, times: Array) -> tuple[Array, Array]:
        """``(s, v)`` at `times`."""

    def physical(self, times: Array) -> tuple[Array, Array]:
        """Return ``(x, xdot)`` at `times`; at an impact, the state after it."""


@dataclasses.dataclass(frozen=True)
class LinearPath:
    """``s`` and ``v`` linear between the steps of a fixed-step run (first order, as the scheme)."""

    t: Array
    s: Array
    v: Array
    kappa: float
    dense: bool = True

    @property
    def span(self) -> tuple[float, float]:
        """The times of the first and the last step (s)."""
        return float(self.t[0]), float(self.t[-1])

    def lifted(self, times: Array) -> tuple[Array, Array]:
        """Interpolate ``(s, v)``."""
        return np.interp(times, self.t, self.s), np.interp(times, self.t, self.v)

    def physical(self, times: Array) -> tuple[Array, Array]:
        """Project what is interpolated: ``x >= 0``, and an impact is where ``s`` changes sign."""
        return project(*self.lifted(times), kappa=self.kappa)


@dataclasses.dataclass(frozen=True)
class PenetratingPath(LinearPath):
    """Path with linear ``x`` and ``xdot`` between samples, for schemes that may penetrate."""

    x: Array = dataclasses.field(kw_only=True)
    xdot: Array = dataclasses.field(kw_only=True)

    def physical(self, times: Array) -> tuple[Array, Array]:
        """Interpolate ``(x, xdot)``."""
        return np.interp(times, self.t, self.x), np.interp(times, self.t, self.xdot)


class LostPath:
    """The motion of a run whose file does not hold it, as zivi wrote files before version 0.2."""

    dense = False
    span = None

    def physical(self, *_: Any) -> Any:
        """Raise a ValueError that says so."""
        raise ValueError(
            "this file, written by an older version of zivi, stores neither dense output nor "
            "extrapolated impacts; rerun the simulation"
        )

    lifted = skipped_impacts = physical
