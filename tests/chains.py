"""Random chains and stacks of bodies on a line, and a simulation of them that follows every impact.

The forces are constant, so between events positions and gaps are parabolas whose roots are known.
Contact forces and impulses are least squares with ``z >= 0``: nothing of zivi is used.
"""

import dataclasses
import math
from random import Random

import numpy as np
from scipy.optimize import nnls

import zivi

TOGETHER = 1e-13
MOST = 20_000


@dataclasses.dataclass(frozen=True)
class Chain:
    """Bodies on a line, with the gaps ``normals @ q + offsets``."""

    mass: np.ndarray
    force: np.ndarray
    normals: np.ndarray
    offsets: np.ndarray
    e: np.ndarray
    start: tuple[np.ndarray, np.ndarray]
    end: float = 2.0

    @classmethod
    def random(cls, random: Random) -> "Chain":
        """With up to six bodies between walls or on a floor, some of which touch."""
        n = random.randint(2, 6)
        stack = random.random() < 0.4
        mass = np.array([10 ** random.uniform(-1, 1) for _ in range(n)])
        walls = (
            (True, False) if stack else random.choice([(True, True), (True, False), (False, True)])
        )
        unit = np.eye(n)
        rows = [unit[i + 1] - unit[i] for i in range(n - 1)]
        spaces = [random.choice([0.0, random.uniform(0, 0.3)]) for _ in range(n + 1)]
        q = np.cumsum(spaces[:n])
        offsets = [0.0] * (n - 1)
        if walls[0]:
            rows.append(unit[0])
            offsets.append(0.0)
        if walls[1]:
            rows.append(-unit[-1])
            # no more than n gaps close
            offsets.append(float(q[-1] + max(spaces[n], 0.1)))
        if stack:
            force = -9.81 * mass
        else:
            common = random.choice([0.0, random.uniform(-2, 2)])
            force = np.array([common + random.choice([0.0, random.uniform(-2, 2)]) for _ in q])
        together = random.random() < 0.4
        v = [random.choice([0.0, random.uniform(-2, 2)]) for _ in q]
        v = np.full(n, random.uniform(-2, 2)) if together else np.array(v)
        m = len(rows)
        law = random.choice(["plastic", "small", "any", "each", "elastic"])
        e = {
            "plastic": lambda: [0.0] * m,
            "small": lambda: [random.uniform(0, 0.05)] * m,
            "any": lambda: [random.uniform(0, 1)] * m,
            "each": lambda: [random.choice([0, 1, random.uniform(0, 1)]) for _ in rows],
            "elastic": lambda: [1.0] * m,
        }[law]()
        return cls(mass, force, np.array(rows), np.array(offsets), np.array(e, float), (q, v))

    def system(self) -> zivi.MechanicalSystem:
        rows = zip(self.normals, self.offsets, strict=True)
        gaps = [zivi.LinearGap(normal, float(offset)) for normal, offset in rows]
        return zivi.MechanicalSystem(mass=np.diag(self.mass), force=self.force, gaps=gaps, e=self.e)

    def simulate(self, **settings):
        method = zivi.SwitchedRK(**settings)
        return zivi.simulate(self.system(), (0, self.end), self.start, method, dense_output=True)

    def energy(self, q, v):
        """Kinetic energy and that of the constant forces."""
        return 0.5 * (self.mass * v * v).sum(axis=-1) - (self.force * q).sum(axis=-1)


def complementary(d, q):
    """``0 <= z  perp  d z + q >= 0`` as the least ``z' d z / 2 + q' z``."""
    if len(q) == 0:
        return np.zeros(0)
    low = np.linalg.cholesky(d)
    size = abs(q).max()
    if size == 0.0:
        return np.zeros(len(q))
    return nnls(low.T, -np.linalg.solve(low, q / size), maxiter=1000)[0] * size


class Followed:
    """A run from event to event.

    Impacts slower than `slow` are plastic; gaps and speeds below `near` are zero when others hit.
    """

    def __init__(self, chain: Chain, slow: float = 1e-10, near=0.0):
        self.chain, self.slow, self.near = chain, slow, near
        q, v = chain.start
        self.t, self.q, self.v = 0.0, q.copy(), v.copy()
        self.g = chain.normals @ q + chain.offsets
        self.g[abs(self.g) < 1e-14] = 0.0
        self.rate = chain.normals @ self.v
        self.rate[abs(self.rate) < 1e-14] = 0.0
        self.mobility = chain.normals.T / chain.mass[:, None]
        self.d = chain.normals @ self.mobility
        self.impacts = 0

    def touching(self):
        return (self.g == 0.0) & (self.rate == 0.0)

    def acceleration(self):
        """With the forces of contacts; those that stay closed."""
        chain, at = self.chain, np.flatnonzero(self.touching())
        free = chain.force / chain.mass
        z = complementary(self.d[np.ix_(at, at)], chain.normals[at] @ free)
        a = free + self.mobility[:, at] @ z
        gap = chain.normals @ a
        closed = np.zeros(len(self.g), bool)
        stay = (z > 0) | (abs(gap[at]) < 1e-12)
        closed[at[stay]] = True
        gap[closed] = 0.0
        return a, gap, closed

    def strike(self, hit):
        chain = self.chain
        self.g[abs(self.g) < self.near] = 0.0
        self.rate[abs(self.rate) < self.near] = 0.0
        at = np.flatnonzero(hit | self.touching())
        before = np.where(hit, self.rate, 0.0)[at]
        e = np.where(abs(before) < self.slow, 0.0, chain.e[at])
        z = complementary(self.d[np.ix_(at, at)], (1 + e) * before)
        self.v += self.mobility[:, at] @ z
        after = self.rate + self.d[:, at] @ z
        after[at] = np.where(z > 0, -e * before, np.maximum(after[at], -e * before))
        after[at[abs(after[at]) < 1e-15]] = 0.0
        self.rate = after
        self.impacts += 1

    def until(self, end: float, most: int = MOST) -> bool:
        """Whether that time is reached with so many impacts."""
        while self.impacts < most:
            hit = (self.g <= 0.0) & (self.rate < 0.0)
            if hit.any():
                self.strike(hit)
                continue
            a, gap, closed = self.acceleration()
            times = np.array(
                [
                    math.inf if closed[i] else flight(self.g[i], self.rate[i], gap[i])
                    for i in range(len(gap))
                ]
            )
            h = min(times.min(initial=math.inf), end - self.t)
            self.q += h * (self.v + 0.5 * h * a)
            self.v += h * a
            self.g += h * (self.rate + 0.5 * h * gap)
            self.rate += h * gap
            self.g[times <= h * (1 + TOGETHER)] = 0.0
            self.g[closed], self.rate[closed] = 0.0, 0.0
            self.t += h
            if self.t >= end:
                return True
        return False


def flight(g, v, a):
    """When ``g + v t + a t^2/2`` falls to zero."""
    if g == 0.0 and v == 0.0:
        return 0.0 if a < 0 else math.inf
    root = v * v - 2 * a * g
    if v > 0:
        return (v + math.sqrt(root)) / -a if a < 0 else math.inf
    return 2 * g / (math.sqrt(root) - v) if root > 0 else math.inf
