"""Accumulations of impacts, flight by flight: their closed forms."""

import math
from dataclasses import dataclass

import numpy as np

import zivi


@dataclass
class Bouncing:
    """A point mass that bounces on a floor with Coulomb's friction.

    Its mass, force, friction, restitution and start; and a slider that stays in contact."""

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


@dataclass
class Coupled:
    """A linear system above a plane, by the power series of each flight.

    Mass, drag and stiffness couple the gap with all coordinates; those of the library are bent,
    ``x = q + bend q[0]^2/2``.
    """

    mass: np.ndarray
    drag: np.ndarray
    stiffness: np.ndarray
    load: np.ndarray
    rows: np.ndarray
    """Normal and tangent."""
    mu: float
    e: float
    x: np.ndarray
    v: np.ndarray
    bend: np.ndarray

    @classmethod
    def drawn(cls, rng, rough, bent):
        """Draw one that comes to rest."""
        n = int(rng.integers(2, 5))
        T, a = 10 ** rng.uniform(-1, 1), 10 ** rng.uniform(-1, 1)
        square = lambda: rng.uniform(-1, 1, (n, n))  # noqa: E731
        mass = (it := square()) @ it.T + 0.3 * np.eye(n)
        drag = (it := square()) @ it.T * 10 ** rng.uniform(-1.5, 0) / T
        stiffness = (it := square()) @ it.T * 10 ** rng.uniform(-1.5, 0) / T**2
        normal, tangent = rows = rng.uniform(-1, 1, (2, n))
        if rng.random() < 0.3:
            drag, stiffness = drag + 0.3 * (it := square() / T) - 0.3 * it.T, 0 * stiffness
        inverse = np.linalg.inv(mass)
        # the gap falls from h with the acceleration a
        load = mass @ rng.uniform(-a, a, n)
        load -= normal * (normal @ inverse @ load + a) / (normal @ inverse @ normal)
        h = 10 ** rng.uniform(-1.5, -0.5) * a * T**2
        x, v = rng.uniform(-h, h, n), rng.uniform(-1, 1, n) * a * T
        x += normal * (h - normal @ x) / (normal @ normal)
        v -= normal * (normal @ v) / (normal @ normal)
        # away from Painleve's paradox
        most = 0.6 * (normal @ inverse @ normal) / abs(normal @ inverse @ tangent)
        mu = min(10 ** rng.uniform(-1.5, 0.3), most) if rough else 0.0
        bend = np.zeros(n)
        if bent:
            bend[1:] = rng.uniform(-0.2, 0.2, n - 1) / h
        it = cls(mass, drag, stiffness, load, rows, mu, rng.uniform(0.1, 0.9), x, v, bend)
        return it if it.flights() else cls.drawn(rng, rough, bent)

    def flights(self, terms=48, most=3000):
        """Give ``t``, series and the work of friction so far of each flight, and the Zeno time."""
        n, inverse = len(self.x), np.linalg.inv(self.mass)
        field = np.zeros((2 * n + 1, 2 * n + 1))
        field[:n, n : 2 * n] = np.eye(n)
        field[n : 2 * n, :n] = -inverse @ self.stiffness
        field[n : 2 * n, n : 2 * n] = -inverse @ self.drag
        field[n : 2 * n, -1] = inverse @ self.load
        powers = [np.eye(2 * n + 1)]
        for k in range(1, terms):
            powers.append(field @ powers[-1] / k)
        d = self.rows @ inverse @ self.rows.T
        y, t, u, work, found = np.concatenate([self.x, self.v, [1.0]]), 0.0, 0.0, 0.0, []
        while len(found) < most:
            series = np.array(powers) @ y
            gap = series[:, :n] @ self.rows[0]
            if gap[2] >= 0:
                return None
            # where the gap, after an impact the gap divided by the time, vanishes
            height = np.polynomial.Polynomial(gap[1:] if found else gap)
            slope, h = height.deriv(), (-u / gap[2] if found else math.sqrt(-gap[0] / gap[2]))
            for _ in range(60):
                step = height(h) / slope(h)
                h -= step
                if abs(step) < 1e-15 * h:
                    break
            # the force may take the mass off its wall: there is no root then
            lands = abs(height(h)) < 1e-12 * np.abs(height(np.linspace(0, h, 30))).max()
            whole = lands and 0 < h * np.abs(field[:-1, :-1]).max() < 4
            if not whole or (height(np.linspace(0, 0.99, 30) * h) <= 0).any():
                return None
            found.append((t, series, work))
            t += h
            y = h ** np.arange(terms) @ series
            v = y[n : 2 * n]
            u, w = self.rows @ v
            if u > -1e-15 * np.abs(v).max():
                return found, t
            impulse = self.impulse(d, u, w)
            v += inverse @ (impulse @ self.rows)
            work -= impulse[1] * (w + self.rows[1] @ v) / 2
            u *= -self.e
        return None

    def impulse(self, d, u, w):
        """Give the impulses of Newton's law with Coulomb's friction."""
        if self.mu == 0:
            return np.array([-(1 + self.e) * u / d[0, 0], 0.0])
        stuck = np.linalg.solve(d, [-(1 + self.e) * u, -w])
        if abs(stuck[1]) <= self.mu * stuck[0]:
            return stuck
        cones = [np.array([1.0, -self.mu * sign]) for sign in (-1, 1)]
        along = [-(1 + self.e) * u / (d[0] @ cone) * cone for cone in cones]
        (one,) = (
            it for it, sign in zip(along, (-1, 1), strict=True) if sign * (w + d[1] @ it) >= 0
        )
        return one

    def at(self, flights, t):
        """Places, speeds and the work of friction before the Zeno time."""
        starts, n = np.array([it[0] for it in flights]), len(self.x)
        rows = np.searchsorted(starts, t, side="right") - 1
        series = np.array([flights[row][1][:, : 2 * n] for row in rows])
        powers = (t - starts[rows])[:, None] ** np.arange(series.shape[1])
        y = np.einsum("tk,tkc->tc", powers, series)
        x, v = y[:, :n], y[:, n:]
        q, w = x - x[:, :1] ** 2 / 2 * self.bend, v - x[:, :1] * v[:, :1] * self.bend
        return q, w, np.array([flights[row][2] for row in rows])

    def system(self):
        """The same for zivi."""
        n, bend, (normal, tangent) = len(self.x), self.bend, self.rows
        if not bend.any() and self.mu == 0:
            return zivi.LinearSystem(
                *(self.mass, self.drag, self.stiffness),
                excitation=self.load,
                gaps=[zivi.LinearGap(normal)],
                e=self.e,
            )

        def turn(q):
            return np.eye(n) + q[0] * np.outer(bend, np.eye(n)[0])

        def force(t, q, w):
            it, inertia = turn(q), self.mass @ bend * w[0] ** 2
            x = q + q[0] ** 2 / 2 * bend
            return it.T @ (self.load - self.drag @ it @ w - self.stiffness @ x - inertia)

        friction = {
            "tangent": lambda t, q: tangent @ turn(q),
            "tangent_curvature": lambda t, q, w: tangent @ bend * w[0] ** 2,
            "mu": self.mu,
        }
        gap = zivi.Gap(
            lambda t, q: normal @ (q + q[0] ** 2 / 2 * bend),
            lambda t, q: normal @ turn(q),
            lambda t, q, w: normal @ bend * w[0] ** 2,
            **(friction if self.mu else {}),
        )
        mass = lambda t, q: turn(q).T @ self.mass @ turn(q)  # noqa: E731
        return zivi.MechanicalSystem(mass=mass, force=force, gaps=[gap], e=self.e)

    def errors(self, tol, parts):
        """Run it through its Zeno point: the largest errors between, in tolerances.

        At parts of the skipped time that are no nearer to an impact than errors of its time.
        """
        flights, zeno = self.flights()
        q, w, _ = self.at(flights, np.linspace(0, zeno, 50, endpoint=False))
        size, fast = np.abs(q).max(), np.abs(w).max()
        method = zivi.SwitchedRK(rtol=tol, atol=(tol * size, tol * fast))
        sol = zivi.simulate(self.system(), (0, 1.02 * zeno), (q[0], w[0]), method)
        end = min(zeno, sol.zeno["t"][0])
        last = sol.resolved_impacts["t"][sol.resolved_impacts["t"] < end].max()
        t = last + parts * (end - last)
        t = t[np.abs(t[:, None] - [it[0] for it in flights]).min(axis=1) > 20 * tol * zeno]
        found, (q, w, work) = sol.resample(t), self.at(flights, t)
        off = [np.abs(found.q - q).max() / size, np.abs(found.qdot - w).max() / fast]
        if self.mu:
            off.append(np.abs(found.dissipated - work).max() / work.max())
        return np.array(off) / tol
