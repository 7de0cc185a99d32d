"""Pushes on something at rest: random problems, and when each must lift off."""

import dataclasses
import math
from random import Random

import numpy as np
from scipy.optimize import brentq

import zivi

SHAPES = ("step", "ramp", "wave")
SYSTEMS = ("mass", "mass after a drop", "one coordinate", "sliding", "two gaps", "stack")


@dataclasses.dataclass(frozen=True)
class Push:
    """A force up to `size`, from `start` on, for the time `length`."""

    shape: str
    start: float
    length: float
    size: float

    def at(self, t):
        part = (t - self.start) / self.length
        if not 0 < part < 1:
            return 0.0
        if self.shape == "step":
            return self.size
        if self.shape == "ramp":
            return self.size * min(1.0, 8 * part, 8 * (1 - part))
        return self.size * math.sin(math.pi * part)


@dataclasses.dataclass(frozen=True)
class Problem:
    """A pull with a ripple, and some pushes."""

    system: str
    span: tuple
    pull: float
    ripple: float
    omega: float
    pushes: tuple

    @classmethod
    def random(cls, random, system):
        length = 10 ** random.uniform(-0.5, 1.5)
        start = random.choice([0.0, random.uniform(-5, 50)])
        pull = 9.81 * 10 ** random.uniform(-0.5, 0.5)
        pushes = []
        for _ in range(random.choice([1, 1, 1, 2, 3])):
            long = random.choice([0.03, 0.03, 0.06, 0.15]) * random.uniform(1, 2) * length
            # after a drop it rests from 1/7 of the span on
            at = start + random.uniform(0.16 * length, length - long)
            size = pull * random.uniform(1.3, 4)
            pushes.append(Push(random.choice(SHAPES), at, long, size))
        ripple = 10 ** random.uniform(-8, -2)
        omega = 2 * math.pi * 10 ** random.uniform(-0.3, 2) / length
        span = (start, start + length)
        return cls(system, span, pull, ripple, omega, tuple(pushes))

    def force(self, t):
        pushed = sum(push.at(t) for push in self.pushes)
        return self.ripple * math.sin(self.omega * t) - self.pull + pushed

    def lift_off(self):
        """Find the first time at which the force is positive, by brute force."""
        edges = sorted(
            push.start + part * push.length for push in self.pushes for part in (0, 1 / 8, 7 / 8, 1)
        )
        for a, b in zip(edges, [*edges[1:], self.span[1]], strict=True):
            inside = (b - a) * 1e-9
            times = np.linspace(a + inside, b - inside, 400)
            values = np.array([self.force(t) for t in times])
            if values.max() <= 0:
                continue
            first = int(np.argmax(values > 0))
            if first == 0:
                return float(a)
            return float(brentq(self.force, times[first - 1], times[first], xtol=1e-14))
        return None

    def run(self, **settings):
        """Simulate: the lift-offs, and the run."""
        t0 = self.span[0]
        method = zivi.SwitchedRK(**settings)
        if self.system.startswith("mass"):
            height = 0.0
            if self.system == "mass after a drop":  # at rest after 3 times the fall, for e = .5
                height = 0.5 * self.pull * ((self.span[1] - t0) / 21) ** 2
            system = zivi.ImpactSystem(lambda t, x, v: self.force(t), e=0.5)
            sol = zivi.simulate(system, self.span, (height, 0), method)
            return sol.liftoff_times, sol
        system, start = self.mechanical()
        sol = zivi.simulate(system, self.span, start, method)
        return sol.liftoffs["t"], sol

    def mechanical(self):
        def floor(*normal):
            return zivi.LinearGap(normal)

        if self.system == "one coordinate":
            others, mass, gaps = (), 2.0, [floor(1)]
        elif self.system == "sliding":  # on a floor without friction
            others, mass, gaps = (0.3,), 1.0, [floor(0, 1)]
        elif self.system == "two gaps":
            others, mass, gaps = (-3.0,), 1.0, [floor(1, 0), floor(0, 1)]
        else:  # the upper of two, that lie on one another, is pushed
            others, mass, gaps = (-self.pull,), 1.0, [floor(1, 0), floor(-1, 1)]

        def force(t, q, qdot):
            return [*others, mass * self.force(t)]

        n = len(gaps[0].normal)
        system = zivi.MechanicalSystem(mass=mass * np.eye(n), force=force, gaps=gaps, e=0.5)
        return system, (np.zeros(n), np.zeros(n))

    def error(self, **settings):
        """Compare the first lift-off with its time, in parts of the span; infinite without one."""
        found, sol = self.run(**settings)
        exact = self.lift_off()
        if not len(found) or not sol.success:
            return math.inf, sol
        return abs(found[0] - exact) / (self.span[1] - self.span[0]), sol


def problems(number, seed):
    """Draw problems, the systems by turns."""
    random = Random(seed)
    for k in range(number):
        yield Problem.random(random, SYSTEMS[k % len(SYSTEMS)])
