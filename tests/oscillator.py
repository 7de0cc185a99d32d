"""The periodic orbits with one impact of a driven linear oscillator, in closed form.

``x'' = -x - 2 z x' + 1 + F cos w t`` above a wall at ``x = 0`` (S. W. Shaw and P. J. Holmes, A
periodically forced piecewise linear oscillator, J. Sound Vib. 90, 1983).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

import zivi


@dataclasses.dataclass(frozen=True)
class Oscillator:
    """Damping `z`, frequency `w`, restitution `e`."""

    z: float
    w: float
    e: float

    def system(self, amplitude: float) -> zivi.ImpactSystem:
        """The system with an amplitude."""
        force = zivi.LinearForce(
            stiffness=1.0, damping=2 * self.z, gravity=-1.0, amplitude=amplitude, omega=self.w
        )
        return zivi.ImpactSystem(force, e=self.e)

    @property
    def period(self) -> float:
        """Of the excitation."""
        return 2 * math.pi / self.w

    @property
    def flow(self) -> np.ndarray:
        """The flow over a period."""
        decay, fast = math.exp(-self.z * self.period), math.sqrt(1 - self.z**2)
        c, s = math.cos(fast * self.period), math.sin(fast * self.period) / fast
        return decay * np.array([[c + self.z * s, s], [-s, c - self.z * s]])

    @property
    def quadratic(self) -> tuple[float, float, float]:
        """``D, a, b`` of ``F^2 = D (a u^2 + b u + 1)``."""
        p = self.flow
        matrix = np.eye(2) - p
        r = np.linalg.solve(matrix, [-p[0, 1], -(p[1, 1] + 1 / self.e)])
        d = (1 - self.w**2) ** 2 + (2 * self.z * self.w) ** 2
        return d, r[0] ** 2 + (r[1] / self.w) ** 2, -2 * r[0]

    def amplitude(self, u: float) -> float:
        """The amplitude for a speed after the impact."""
        d, a, b = self.quadratic
        return math.sqrt(d * (a * u * u + b * u + 1))

    @property
    def fold(self) -> tuple[float, float]:
        """Speed and amplitude at the fold."""
        _, a, b = self.quadratic
        u = -b / (2 * a)
        return u, self.amplitude(u)

    def orbit(self, u: float) -> tuple[float, float]:
        """Time of the impact and amplitude of the orbit with this speed after it."""
        # the free part h has h(T) = h(0), h'(T) = h'(0) - u (1 + 1/e)
        h, rate = np.linalg.solve(np.eye(2) - self.flow, [0.0, u * (1 + 1 / self.e)])
        lag = math.atan2(2 * self.z * self.w, 1 - self.w**2)
        angle = math.atan2(-(u - rate) / self.w, -1 - h)
        return (angle + lag) / self.w % self.period, self.amplitude(u)
