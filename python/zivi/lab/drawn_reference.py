"""A reference drawn by hand, and the explicit law that follows what it is given."""

from zivi.control.twisting import ExplicitTwisting

__all__ = ["Drawn", "ExplicitFollower"]


class Drawn:
    """Heights at equal times, joined smoothly: x_r, its velocity and its acceleration.

    From height to height x_r = a + (b - a) (10 z^3 - 15 z^4 + 6 z^5), 0 <= z <= 1.
    """

    def __init__(self, heights: tuple[float, ...], t_end: float) -> None:
        self.heights, self.piece = heights, t_end / (len(heights) - 1)

    def __call__(self, t: float) -> tuple[float, float, float]:
        """Give the reference at time t."""
        k = min(int(t / self.piece), len(self.heights) - 2)
        z = min(t / self.piece - k, 1.0)
        start, rise = self.heights[k], self.heights[k + 1] - self.heights[k]
        x = start + rise * z**3 * (10.0 - 15.0 * z + 6.0 * z**2)
        xdot = rise * 30.0 * z**2 * (1.0 - z) ** 2 / self.piece
        return max(x, 0.0), xdot, rise * 60.0 * z * (1.0 - z) * (1.0 - 2.0 * z) / self.piece**2


class ExplicitFollower:
    """ExplicitTwisting with its reference reset at each sample to the one that is given."""

    x_ref = xdot_ref = float("nan")

    def __init__(self, mu1: float, mu2: float, *, h: float, e: float) -> None:
        self.law, self.h = ExplicitTwisting(mu1, mu2, h=h, e=e), h

    def step(self, x: float, xdot: float, force: float, force_ref: float) -> float:
        """Give the control for the next period; behind the wall is taken as on it."""
        return self.law.step(max(x, 0.0), xdot, force, force_ref)

    def step_to(
        self,
        x: float,
        xdot: float,
        force: float,
        now: tuple[float, float, float],
        after: tuple[float, float, float],
        acceleration: float,
    ) -> float:
        """Give it for a reference that is now here and after the period there."""
        self.law.reset(*now[:2])
        self.x_ref, self.xdot_ref = after[:2]
        return self.step(x, xdot, force, acceleration)
