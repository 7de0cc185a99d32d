"""What the gains of a controller do: accelerations, conditions, the range of the control."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np

from zivi.base.check import Array
from zivi.control.twisting import TwistingTracker

__all__ = ["Law"]

STEEPEST, FLATTEST = 0.02, 0.98
"""Range of ``mu2/mu1`` that is looked at."""
MARGIN = 1e-9
"""By how much a design stays within limits of the actuator: more than rounding."""


@dataclasses.dataclass(frozen=True)
class Law:
    """What the gains make of a controller.

    Parameters
    ----------
    kind : {"tracker", "regulator"}
        Of which controller.
    e : float
        Coefficient of restitution.
    force : float
        The known force (m/s^2).
    force_ref : float or None
        Largest force on a reference that moves (m/s^2).
    """

    kind: Literal["tracker", "regulator"]
    e: float
    force: float
    force_ref: float | None

    def gains(self, braking: float, falling: float) -> tuple[float, float]:
        """Give the gains whose net accelerations are U and D."""
        if self.kind == "regulator":
            both, rest = braking + self.force, falling + self.force
        else:
            part = 0.5 * (1.0 + self.e)
            both, rest = part / self.e * braking, part * falling
        return 0.5 * (both + rest), 0.5 * (both - rest)

    def least(self, ratio: Array, bound: float, exact: bool) -> Array:
        """Give the least U that holds an unknown force of this bound, with D = ratio U.

        Parameters
        ----------
        ratio : ndarray
            D/U.
        bound : float
            M, with its reserve (m/s^2).
        exact : bool
            Whether the mass rests, ``M < (min(U, D) - e^2 D)/(1 + e^2)``; else its long bounces
            shrink, ``e^2 (D + M) < U - M`` and ``M < D``.
        """
        e = self.e
        weaker = np.minimum(1.0, ratio) if exact else np.ones_like(ratio)
        least = _at_least(bound * (1.0 + e * e), weaker - e * e * ratio)
        least = np.maximum(least, bound / ratio)
        if self.kind == "tracker":
            # M/R < mu2 < mu1 - M/R with R = 2e/(1 + e)
            least = np.maximum(least, bound / (e * ratio))
            least = np.maximum(least, _at_least(2.0 * bound, 1.0 - e * ratio))
        return np.maximum(least, self._ordered(ratio))

    def _ordered(self, ratio: Array) -> Array:
        """Give the least U with a ``mu2/mu1`` in range, infinite where there is none."""
        low, high = ((1.0 - it) / (1.0 + it) for it in (FLATTEST, STEEPEST))
        if self.kind == "tracker":
            share = self.e * ratio  # (mu1 - mu2)/(mu1 + mu2)
            return np.where((share >= low) & (share <= high), 0.0, np.inf)
        # low <= (D + F)/(U + F) <= high
        least = np.maximum(
            _at_least(-self.force * (1.0 - low), ratio - low),
            _at_least(self.force * (1.0 - high), high - ratio),
        )
        return np.maximum(least, 0.0)

    def allowed(self, ratio: Array, limits: tuple[float, float]) -> tuple[Array, Array]:
        """Give the least and the largest U whose control stays within the actuator's range."""
        low, high = limits
        # u = -F - g with g from min(U, D) to max(U, D)
        least = (-self.force - high) * (1.0 + MARGIN) / np.minimum(1.0, ratio)
        most = (-self.force - low) * (1.0 - MARGIN) / np.maximum(1.0, ratio)
        if self.force_ref is not None:
            room = min(high - max(0.0, -self.force), min(0.0, -self.force) - low)
            most = np.minimum(most, self.e * room * (1.0 - MARGIN) - abs(self.force_ref))
        return least, most

    def controls(self, mu1: float, mu2: float, late: bool) -> tuple[float, float]:
        """Give the least and the largest control; with a delay 0 acts at first.

        While the reference moves the control is ``-a F`` with ``0 <= a <= 1`` and on either side
        up to ``(1 + kappa)(mu1 + mu2 + |F_r|/R_r) = (1 + kappa)(mu1 + mu2) + |F_r|/e``.
        """
        if self.kind == "regulator":
            low, high = -mu1 - mu2, -mu1 + mu2
        else:
            low, high = self._landing_controls(mu1, mu2)
        if self.force_ref is not None:
            moving = 2.0 / (1.0 + self.e) * (mu1 + mu2) + abs(self.force_ref) / self.e
            low = min(low, min(0.0, -self.force) - moving)
            high = max(high, max(0.0, -self.force) + moving)
        return (min(low, 0.0), max(high, 0.0)) if late else (low, high)

    def _landing_controls(self, mu1: float, mu2: float) -> tuple[float, float]:
        """Give ``-F - g`` for the least and the largest g, as the tracker rounds them."""
        accelerations = TwistingTracker(mu1, mu2, h=1.0, e=self.e)._accelerations()
        assert accelerations is not None
        return -self.force - max(accelerations), -self.force - min(accelerations)


def _at_least(needed: float, per: Array) -> Array:
    """Give the least U >= 0 with ``per U >= needed`` for it and all larger ones."""
    possible = per > 0.0
    least = np.maximum(needed / np.where(possible, per, 1.0), 0.0)
    return np.where(possible, least, np.inf)
