"""Closed forms of motions with impacts, event by event: nothing of zivi is used."""

import math


class Ball:
    """Flight times, Zeno point and state of a ball thrown from ``x0`` with velocity ``xdot0``."""

    def __init__(self, x0, xdot0, *, e, g=9.81):
        self.x0, self.xdot0, self.e, self.g = x0, xdot0, e, g
        self.speed = math.sqrt(xdot0**2 + 2 * g * x0)
        self.first = (xdot0 + self.speed) / g
        self.zeno = self.first + 2 * e * self.speed / (g * (1 - e))

    @classmethod
    def of_kappa(cls, x0, xdot0, *, kappa, g=9.81):
        return cls(x0, xdot0, e=(1 - kappa) / (1 + kappa), g=g)

    def impact(self, n):
        """Time and speed before impact ``n`` (0 is the first)."""
        fade = (1 - self.e**n) / (1 - self.e)
        return self.first + 2 * self.e * self.speed * fade / self.g, self.speed * self.e**n

    @property
    def apex(self):
        return self.xdot0 / self.g

    def impacts_until(self, t):
        n = 0
        while n < 1000 and self.impact(n)[0] < t < self.zeno:
            n += 1
        return n

    def state(self, t):
        """Distance and velocity at ``t``."""
        if t >= self.zeno:
            return 0.0, 0.0
        if t < self.first:
            return self.x0 + self.xdot0 * t - 0.5 * self.g * t**2, self.xdot0 - self.g * t
        n = self.impacts_until(t)
        start, before = self.impact(n - 1)
        up, tau = self.e * before, t - start
        return up * tau - 0.5 * self.g * tau**2, up - self.g * tau


def rest_then_lift(t, *, g, c):
    """Distance at ``t`` of a mass at rest on the wall under ``f = -g + c t`` (from ``t = g/c``)."""
    return c * max(t - g / c, 0.0) ** 3 / 6


def bouncing_oscillator(t, *, e, x0, damping_ratio=0.0):
    """Distance at ``t`` of ``x'' = -x - 2 z x'``, released at ``x0``, the wall at its equilibrium.

    All flights last ``pi/w`` and the wall is met infinitely often, but never at a finite time.
    """
    z = damping_ratio
    w = math.sqrt(1 - z * z)
    first = (math.pi - math.acos(z)) / w  # the free solution's first zero after its maximum at 0
    if t < first:
        return x0 * math.exp(-z * t) * (math.cos(w * t) + z / w * math.sin(w * t))
    down = math.exp(-z * first) * (-math.sin(w * first)) / w * x0
    n = int((t - first) // (math.pi / w))
    start = first + n * math.pi / w
    up = e * abs(down) * (e * math.exp(-z * math.pi / w)) ** n
    tau = t - start
    return up / w * math.exp(-z * tau) * math.sin(w * tau)
