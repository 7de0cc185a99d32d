"""Newton's iteration on orbits from guesses near a grazing, and what a step of it costs.

Three oscillators at a wall (closed form in ``tests/oscillator.py``). The guess is the orbit with
the impact speed u0 = 0.3, 0.1, 0.03 m/s, the parameter that of the orbit with a part 0.9 to 0 of
it: 63 starts, of which those with the part 0 are at the grazing itself. A step is compared, in
evaluations of the force and of its Jacobian, with a simulation of the orbit with the derivatives by
its initial state.

    python benchmarks/orbit_starts.py
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

import zivi
from zivi.orbits.equations import evaluate
from zivi.orbits.flows import PRECISE

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oscillator import Oscillator

OSCILLATORS = [Oscillator(0.05, 0.9, 0.8), Oscillator(0.02, 1.2, 0.7), Oscillator(0.05, 2.8, 0.8)]
SPEEDS = (0.3, 0.1, 0.03)
PARTS = np.linspace(0.9, 0.0, 7)


def start(oscillator: Oscillator, u0: float, part: float) -> tuple[float, int]:
    """Give how far the orbit that is found is from the closed form, and the steps of it."""
    u = part * u0
    t, amplitude = oscillator.orbit(u)
    guess = [(oscillator.orbit(u0)[0], u0)]
    orbit = zivi.periodic_orbit(oscillator.system(amplitude), guess, 1)
    if orbit.status is zivi.OrbitStatus.NOT_CONVERGED:
        return math.inf, orbit.iterations
    turn = (orbit.impacts["t"][0] - t) / oscillator.period
    apart = abs(turn - round(turn)) * oscillator.period
    return apart + abs(float(orbit.impacts["u"][0]) - u), orbit.iterations


class Counter:
    """The force of an oscillator, which counts its evaluations and those of its Jacobian."""

    def __init__(self, force: zivi.LinearForce) -> None:
        self.force, self.calls = force, 0

    def __call__(self, t: float, x: float, xdot: float, a: float) -> float:
        """Evaluate."""
        self.calls += 1
        of = self.force
        pull = of.stiffness * x + of.damping * xdot + of.gravity
        return a * math.cos(of.omega * t + of.phase) - pull

    def jacobian(self, t: float, x: float, xdot: float, a: float) -> tuple[float, ...]:
        """Differentiate by time, state and amplitude."""
        self.calls += 1
        of = self.force
        angle = of.omega * t + of.phase
        return -a * of.omega * math.sin(angle), -of.stiffness, -of.damping, math.cos(angle)


def cost(oscillator: Oscillator, u: float) -> tuple[int, int]:
    """Give the evaluations of a step of Newton's iteration, and of a run with its derivatives."""
    t, amplitude = oscillator.orbit(u)
    force = oscillator.system(amplitude).force
    counter = Counter(force)
    counted = zivi.ParametricForce(counter, {"a": force.amplitude}, counter.jacobian)
    system = zivi.ImpactSystem(counted, e=oscillator.e)
    orbit = zivi.periodic_orbit(system, [(t, u)], 1, period=oscillator.period)
    counter.calls = 0
    evaluate(orbit._frame, orbit._y)
    step, counter.calls = counter.calls, 0
    middle = t + 0.5 * oscillator.period
    state = orbit.trajectory(middle)
    counter.calls = 0
    zivi.sensitivity(
        system, (middle, middle + oscillator.period), state, method=PRECISE, dense_output=False
    )
    return step, counter.calls


def main() -> None:
    """Print the table."""
    found, most, worst = 0, 0, 0.0
    for oscillator in OSCILLATORS:
        ends = [start(oscillator, u0, part) for u0 in SPEEDS for part in PARTS]
        found += sum(error < 1e-9 for error, _ in ends)
        most = max(most, *(steps for _, steps in ends))
        worst = max(worst, *(error for error, _ in ends))
    total = len(OSCILLATORS) * len(SPEEDS) * len(PARTS)
    print(f"{found} of {total} starts, at most {most} steps, worst error {worst:.1e}")
    for oscillator in OSCILLATORS:
        for u in SPEEDS:
            step, run = cost(oscillator, u)
            print(f"u {u:g}: a step {step} evaluations, a run with derivatives {run}")


if __name__ == "__main__":
    main()
