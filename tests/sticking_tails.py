"""A point mass that bounces on a floor with Coulomb's friction, arc by arc: the closed form."""

import math
from dataclasses import dataclass

import numpy as np

import zivi


@dataclass
class Bouncing:
    """Its mass, force, friction, restitution and start; and a slider that stays in contact."""

    m: float
    force: tuple
    mu: float
    e: float
    x: tuple
    v: tuple
    slider: str
    """"none", or what slows down a second mass: "joint" or "floor"."""
    transform: np.ndarray
    """Its coordinates are ``solve(transform, places)``."""

    @classmethod
    def drawn(cls, rng, slider):
        m, g = 10 ** rng.uniform(-2, 2), 10 ** rng.uniform(-1, 2)
        mu, e, h = rng.uniform(0.05, 1.2), rng.uniform(0.1, 0.9), 10 ** rng.uniform(-2, 0) * g
        force = (0.9 * mu * m * g * rng.uniform(-1, 1), -m * g)
        swift = rng.choice([0.0, math.sqrt(2 * g * h)])
        n = 2 + (slider != "none")
        transform = np.eye(n)
        while (skew := rng.uniform(-1, 1, (n, n))) is not None:
            if np.linalg.cond(skew) < 30:
                transform = skew * 10 ** rng.uniform(-2, 2)
                break
        x, v = (rng.uniform(-1, 1) * h, h), (swift * rng.uniform(-1, 1), 0.0)
        return cls(m, force, mu, e, x, v, slider, transform)

    @property
    def g(self):
        return -self.force[1] / self.m

    def arcs(self):
        """Rows ``t, x, y, x', y', work`` at the start and after each impact, and the Zeno time."""
        a, (x, y), (w, u) = self.force[0] / self.m, self.x, self.v
        t, work, rows = 0.0, 0.0, []
        while not rows or u > 1e-17 * self.g:
            rows.append((t, x, y, w, u, work))
            h = (u + math.sqrt(u * u + 2 * self.g * y)) / self.g
            t, x, y = t + h, x + h * (w + h * a / 2), 0.0
            before, u = w + h * a, self.e * (self.g * h - u)
            held = self.mu * (1 + self.e) * u / self.e
            w = 0.0 if abs(before) <= held else before - math.copysign(held, before)
            work += self.m * (before * before - w * w) / 2
        return np.array(rows), t

    def at(self, t):
        """Places, speeds and the work of friction before the Zeno time."""
        rows, zeno = self.arcs()
        row = rows[np.searchsorted(rows[:, 0], t, side="right") - 1]
        h, a = t - row[:, 0], np.array(self.force) / self.m
        v = row[:, 3:5] + h[:, None] * a
        x, work = row[:, 1:3] + h[:, None] * (row[:, 3:5] + h[:, None] * a / 2), row[:, 5]
        if self.slider != "none":
            # it slows down by as much as stops it at twice the Zeno time
            slow = self.mu * self.g
            z = 2 * zeno * slow * t - slow * t * t / 2
            x, v = np.column_stack([x, z]), np.column_stack([v, slow * (2 * zeno - t)])
            work = work + self.m * slow * z
        if self.slider == "floor":
            x, v = (np.insert(it, 3, 0.0, axis=1) for it in (x, v))
        return (*(np.linalg.solve(self.transform, it.T).T for it in (x, v)), work)

    def system(self):
        """The same for zivi."""
        if self.slider == "floor" and len(self.transform) == 3:
            wide = np.eye(4) * np.abs(self.transform).max()
            wide[:3, :3] = self.transform
            wide[3, :3] = self.transform[0]
            self.transform = wide
        rows, held = self.transform, self.mu * self.m * self.g
        gaps = [zivi.LinearGap(rows[1], tangent=rows[0], mu=self.mu)]
        force, friction = list(self.force), []
        if self.slider == "joint":
            force, friction = [*force, 0.0], [zivi.DryFriction(rows[2], limit=held)]
        if self.slider == "floor":
            force = [*force, 0.0, -self.m * self.g]
            gaps.append(zivi.LinearGap(rows[3], tangent=rows[2], mu=self.mu))
        return zivi.MechanicalSystem(
            mass=self.m * rows.T @ rows,
            force=rows.T @ np.array(force),
            gaps=gaps,
            friction=friction,
            e=[self.e, 0.0][: len(gaps)],
        )

    def run(self, tol, parts):
        """The run through its Zeno point, and these parts of the time between."""
        system, (rows, zeno) = self.system(), self.arcs()
        (q, *_), (_, w, _) = self.at(np.zeros(1)), self.at(np.zeros(1))
        size = np.abs(q).max()
        method = zivi.SwitchedRK(rtol=tol, atol=(tol * size, tol * size / zeno))
        sol = zivi.simulate(system, (0, 1.1 * zeno), (q[0], w[0]), method)
        end = min(zeno, sol.zeno["t"][0])
        last = sol.resolved_impacts["t"][sol.resolved_impacts["t"] < end].max()
        t = last + parts * (end - last)
        # what is a rounding from an impact is before or after it
        near = np.abs(t[:, None] - rows[:, 0]).min(axis=1)
        return sol, t[near > 1e-13 * zeno], size, zeno
