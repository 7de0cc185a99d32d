"""Random runs, chaotic or not, and their errors against flights that are exact, or nearly so."""

import dataclasses
from random import Random

import numpy as np

import zivi

FAMILIES = ("table", "oscillator", "ball", "mechanism")
PRECISE = {"rtol": 1e-13, "atol": 1e-15}


@dataclasses.dataclass(frozen=True)
class Problem:
    family: str
    force: object
    e: float
    span: tuple
    state: tuple
    method: zivi.SwitchedRK

    @classmethod
    def random(cls, random, family):
        rtol = 10 ** random.uniform(-9, -4)
        method = zivi.SwitchedRK(rtol=rtol, atol=rtol * 1e-3, flights="rk")
        if family == "table":
            amplitude, phase = random.uniform(1.5, 6), random.uniform(0, 6)
            force = zivi.LinearForce(gravity=1, amplitude=amplitude, phase=phase)
            e, end = random.uniform(0.4, 0.95), random.choice([30, 100, 200])
        elif family == "ball":  # nothing of it grows
            drag = random.uniform(0, 0.5)

            def force(t, x, xdot):
                return -9.81 - drag * xdot

            e, end = random.uniform(0, 0.95), random.choice([3, 10])
        else:
            force = zivi.LinearForce(
                stiffness=1,
                damping=random.choice([0, 0.1]),
                amplitude=1,
                omega=random.uniform(1.5, 5),
                gravity=random.uniform(-0.5, 0.5),
            )
            e, end = random.uniform(0.5, 1), random.choice([30, 100])
        state = (random.uniform(0.1, 2), random.uniform(-1, 1))
        return cls(family, force, e, (0, end), state, method)

    def run(self):
        if self.family != "mechanism":
            return zivi.simulate(self.system, self.span, self.state, self.method)
        k, c, g, a, omega, _ = dataclasses.astuple(self.force)[:6]

        def force(t, q, qdot):
            return -k * q - c * qdot - g + a * np.cos(omega * t)

        system = zivi.MechanicalSystem(mass=1.0, force=force, gaps=[zivi.LinearGap([1])], e=self.e)
        start = tuple([it] for it in self.state)
        return zivi.simulate(system, self.span, start, self.method)

    @property
    def system(self):
        return zivi.ImpactSystem(self.force, e=self.e)

    def errors(self, sol):
        """Give times and errors of the position there, in relative tolerances of the largest."""
        flights = "rk" if callable(self.force) else "series"
        method = zivi.SwitchedRK(**PRECISE, flights=flights)
        exact = zivi.simulate(self.system, self.span, self.state, method)
        times = np.linspace(*self.span, 3001)
        x = exact(times)[0]
        off = np.abs(np.ravel(sol(times)[0]) - x)
        return times, off / (self.method.rtol * np.abs(x).max())


def problems(number, seed):
    """Draw problems, the families by turns."""
    random = Random(seed)
    for k in range(number):
        yield Problem.random(random, FAMILIES[k % len(FAMILIES)])
