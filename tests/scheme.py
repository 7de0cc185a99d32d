"""The theta-gamma step written out in NumPy: what every step of a run must satisfy.

    v+ = v + h ls f / R      s+ = s + h R (theta v+ + (1 - theta) v)      R = 1 - kappa ls lv
    ls in sgn(s_gamma)       lv in sgn(v_gamma)       z_gamma = gamma z+ + (1 - gamma) z

`z in N_[-1,1](l)` is `l in sgn(z)`; its natural map is ``max(l - 1, min(l + 1, -z))``.
"""

import numpy as np


class Steps:
    """All steps of a trajectory: starts, ends, and what the scheme says about them."""

    def __init__(self, sol, system, *, theta=1.0, gamma=1.0):
        self.theta, self.gamma = theta, gamma
        self.t, self.h = sol.t[:-1], np.diff(sol.t)
        self.s0, self.v0 = sol.transformed.s[:-1], sol.transformed.v[:-1]
        self.s1, self.v1 = sol.transformed.s[1:], sol.transformed.v[1:]
        self.ls, self.lv = sol.transformed.lambda_s[1:], sol.transformed.lambda_v[1:]
        self.r = 1 - system.kappa * self.ls * self.lv
        self.f = np.array([float(system.force(*point)) for point in self.points()])

    def mean(self, weight, new, old):
        return weight * new + (1 - weight) * old

    def points(self):
        """Where the force is sampled: ``t + theta h, |s_theta|, R ls v_theta``."""
        x = np.abs(self.mean(self.theta, self.s1, self.s0))
        xdot = self.r * self.ls * self.mean(self.theta, self.v1, self.v0)
        return zip((self.t + self.theta * self.h).tolist(), x.tolist(), xdot.tolist(), strict=True)

    def scales(self):
        """Sizes of the terms of the two rows."""
        size_s = np.abs(self.s0) + self.h * self.r * np.maximum(np.abs(self.v0), np.abs(self.v1))
        size_v = np.abs(self.v0) + np.abs(self.v1) + self.h * np.abs(self.f) / self.r
        return np.maximum(size_s, 1e-300), np.maximum(size_v, 1e-300)

    def update_errors(self):
        """Defects of the two update equations, absolute."""
        v = self.v0 + self.h * self.ls * self.f / self.r
        s = self.s0 + self.h * self.r * self.mean(self.theta, self.v1, self.v0)
        return np.abs(self.s1 - s), np.abs(self.v1 - v)

    def natural_residual(self):
        """The natural map of both signs, rows relative to the size of their terms."""
        size_s, size_v = self.scales()
        row_s = self.mean(self.gamma, self.s1, self.s0) / size_s
        row_v = self.mean(self.gamma, self.v1, self.v0) / size_v
        return np.maximum(_natural(self.ls, row_s), _natural(self.lv, row_v))


def _natural(multiplier, z):
    return np.abs(np.maximum(multiplier - 1, np.minimum(multiplier + 1, -z)))


def fitted_order(steps, errors):
    """The slope of log error over log h, by least squares."""
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


def jittered(h, n=7):
    """Step sizes within a factor 1.2 of ``h``: a single one may be lucky."""
    return [h * 1.2 ** (2 * ((0.5 + k * 0.6180339887498949) % 1) - 1) for k in range(n)]
