"""Campaign of `zivi.fit`: starts in wide boxes, coverage of intervals, missed bounces.

Run as ``python benchmarks/fits.py ball|masses|table|belt|bounces|coverage [number]``. A start
succeeds if its cost is within 0.1 % of the least cost of all.
"""

import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import zivi

FINE = zivi.SwitchedRK(rtol=1e-11, atol=1e-13)


class Problem(NamedTuple):
    """A system with true parameters, the boxes of its starts, and how it is measured."""

    system: Any
    truth: dict[str, float]
    boxes: dict[str, tuple[float, float]]
    y0: Callable[[dict[str, float]], Any]
    times: np.ndarray
    sigma: float
    of: str = "x"

    def at(self, values: dict[str, float]) -> Any:
        """Give the system with other values."""
        return self.system.replace(**{k: v for k, v in values.items() if k != "x0"})

    def data(self, generator: np.random.Generator) -> zivi.Record:
        """Measure the true run."""
        span = (0.0, float(self.times[-1]))
        run = zivi.simulate(self.at(self.truth), span, self.y0(self.truth), FINE)
        exact = run(self.times)[0] if isinstance(run, zivi.simulation.Trajectory) else None
        exact = run(self.times)[0][:, 0] if exact is None else exact
        noise = self.sigma * generator.standard_normal(len(self.times))
        return zivi.Record(self.times, exact + noise, self.sigma, of=self.of)

    def draw(self, generator: np.random.Generator) -> dict[str, float]:
        """Draw a start in the boxes."""
        return {name: float(generator.uniform(*box)) for name, box in self.boxes.items()}

    def fit(self, data: Any, values: dict[str, float], starts: int, seed: int = 0) -> zivi.Fit:
        """Fit from values."""
        names, y0 = tuple(self.boxes), self.y0(values)
        system, bounds = self.at(values), self.boxes
        return zivi.fit(system, data, names, y0=y0, bounds=bounds, starts=starts, seed=seed)


def ball() -> Problem:
    """Give a ball with drag, filmed."""
    return Problem(
        zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, damping=0.15), e=0.72),
        {"x0": 0.8, "e": 0.72, "damping": 0.15, "gravity": 9.81},
        {"x0": (0.2, 2.5), "e": (0.1, 0.97), "damping": (0.0, 1.5), "gravity": (4.0, 20.0)},
        lambda values: (values["x0"], 0.0),
        np.linspace(0.0, 3.0, 81)[1:],
        2e-3,
    )


def masses() -> Problem:
    """Give two masses of which the second hits a stop and the first is measured."""

    def build(k1: float, k12: float, d: float) -> zivi.LinearSystem:
        K = [[k1 + k12, -k12], [-k12, k12]]
        stop = zivi.LinearGap([0.0, -1.0], d, name="stop")
        return zivi.LinearSystem(np.eye(2), None, K, gaps=[stop], e=0.6, coordinates=["x", "y"])

    return Problem(
        zivi.ParametricSystem(build, {"k1": 10.0, "k12": 20.0, "d": 0.1}),
        {"k1": 10.0, "k12": 20.0, "e": 0.6, "d": 0.1},
        {"k1": (1.0, 40.0), "k12": (1.0, 60.0), "e": (0.1, 0.97), "d": (0.02, 0.3)},
        lambda values: ([0.0, 0.0], [1.0, 0.0]),
        np.linspace(0.0, 6.0, 101)[1:],
        2e-3,
    )


def table() -> Problem:
    """Give a ball on a moving table, of which the distance is measured."""
    wall = zivi.HarmonicWall(amplitude=0.02, omega=20.0, phase=1.0)
    return Problem(
        zivi.ImpactSystem(zivi.LinearForce(gravity=9.81), e=0.7, wall=wall),
        {"x0": 0.3, "e": 0.7, "wall.amplitude": 0.02, "wall.phase": 1.0},
        {
            "x0": (0.1, 1.0),
            "e": (0.2, 0.95),
            "wall.amplitude": (0, 0.06),
            "wall.phase": (-3.2, 3.2),
        },
        lambda values: (values["x0"], 0.0),
        np.linspace(0.0, 2.0, 81)[1:],
        1e-3,
    )


def belt() -> Problem:
    """Give a mass at a spring on a belt with dry friction."""
    truth = {"k": 1.0, "L": 0.8, "Ls": 1.2, "v": 0.2}
    system = zivi.symbolic.system(
        "x",
        T="xdot**2/2",
        V="k*x**2/2",
        friction={"belt": ("xdot - v", "L", "Ls")},
        parameters=truth,
    )
    return Problem(
        system,
        truth,
        {"k": (0.3, 3.0), "L": (0.2, 2.0), "Ls": (0.2, 3.0), "v": (0.05, 0.6)},
        lambda values: ([0.0], [0.0]),
        np.linspace(0.0, 30.0, 101)[1:],
        1e-2,
    )


PROBLEMS = {"ball": ball, "masses": masses, "table": table, "belt": belt}
STARTS = {"ball": 1, "masses": 1, "table": 10, "belt": 10}


def starts(name: str, number: int) -> None:
    """Fit one data set from starts in the box, and count how many find its optimum."""
    problem, generator = PROBLEMS[name](), np.random.default_rng(1)
    data = problem.data(generator)
    best = problem.fit(data, problem.truth, 1)
    print(best, flush=True)
    costs, runs = [], []
    for k in range(number):
        values = problem.draw(generator)
        if name == "belt":
            values["Ls"] = max(values["Ls"], values["L"])
        try:
            found = problem.fit(data, values, STARTS[name], seed=k)
        except ValueError as error:
            costs.append(np.inf)
            print(k, error, flush=True)
            continue
        costs.append(found.cost)
        runs.append(found.evaluations)
        if k % 10 == 9:
            print(f"{k + 1} fits", flush=True)
        if found.cost > best.cost * 1.001:
            print(k, found.cost, found.values, flush=True)
    good = np.count_nonzero(np.array(costs) <= best.cost * 1.001 + 1e-6)
    print(f"{name}: {good} of {number}, {np.mean(runs):.0f} evaluations each", flush=True)


def coverage(name: str, number: int) -> None:
    """Count how many 95 % intervals contain the truth."""
    problem, hits = PROBLEMS[name](), []
    for k in range(number):
        data = problem.data(np.random.default_rng([2, k]))
        found = problem.fit(data, problem.truth, 1)
        ends = found.interval(0.95)
        hits.append([low <= problem.truth[it] <= high for it, (low, high) in ends.items()])
        if (k + 1) % 100 == 0 or k + 1 == number:
            parts = dict(zip(problem.boxes, 100.0 * np.mean(hits, axis=0), strict=True))
            print(f"coverage of {name} over {k + 1}: {parts}", flush=True)


def bounces(number: int) -> None:
    """Fit bounce times of which 2 of 12 are missing and one is spurious."""
    ball = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, damping=0.2), e=0.6)
    truth = ball.replace(e=0.78, damping=0.05)
    exact = zivi.simulate(truth, (0, 4), (1, 0), FINE).impacts["t"][:12]
    names, good, hits = ("e", "damping"), 0, []
    for k in range(number):
        generator = np.random.default_rng([3, k])
        times = exact + 1e-3 * generator.standard_normal(12)
        part = np.delete(times, generator.choice(12, 2, replace=False))
        part = np.sort([*part, generator.uniform(0.0, times[-1])])
        whole = zivi.fit(truth, zivi.Bounces(times, 1e-3), names, y0=(1, 0), starts=1)
        found = zivi.fit(ball, zivi.Bounces(part, 1e-3), names, y0=(1, 0))
        ends = whole.interval(0.95)
        hits.append([ends["e"][0] <= 0.78 <= ends["e"][1]])
        off = np.abs(found.x - whole.x) / whole.deviations
        good += bool(np.all(off < 3.0))
        if np.any(off >= 3.0):
            print(k, off, found, flush=True)
    print(f"bounces: {good} of {number}; coverage of e {100 * np.mean(hits):.1f}", flush=True)


def main(name: str, number: int) -> None:
    """Run a part of the campaign."""
    started = time.perf_counter()
    if name == "bounces":
        bounces(number)
    elif name == "coverage":
        for it in ("ball", "masses"):
            coverage(it, number)
    elif name.startswith("coverage_"):
        coverage(name.partition("_")[2], number)
    else:
        starts(name, number)
    print(f"{time.perf_counter() - started:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 100)
