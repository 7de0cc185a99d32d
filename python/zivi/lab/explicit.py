"""The twisting regulator with the signs of the sample: what the implicit one is compared to."""

import math

__all__ = ["ExplicitRegulator"]


class ExplicitRegulator:
    """u = -mu1 - mu2 sgn(xdot), with the sign of the measured velocity."""

    def __init__(self, mu1: float, mu2: float, h: float) -> None:
        self.mu1, self.mu2, self.h = mu1, mu2, h

    def step(self, x: float, xdot: float, force: float) -> float:
        """Give the control for the next period."""
        sign = math.copysign(1.0, xdot) if xdot else 0.0
        return -self.mu1 - self.mu2 * sign
