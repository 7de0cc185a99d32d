r"""An optimal throw: the number of impacts is enumerated, their times and speeds are the unknowns.

A ball at height 1 m, at rest, shall be back there at rest after 1.5 s with the least effort
``J = int u(t)^2 dt``, ``x'' = -g + u``; at the floor it loses speed, ``x'+ = -0.7 x'-``. Gradient
methods with a free sequence of impacts stop at optima with another number of impacts. With the
sequence given the problem is small and smooth: each flight between fixed states has a closed form,

    J = 12 d^2/T^3 - 12 d w/T^2 + 4 w^2/T

for a flight of duration T that ends a distance d and a velocity w away from the free flight, and
u is linear in time. The unknowns are the durations and the speeds at the impacts. Runs of zivi
under the optimal controls confirm the states. In brackets: largest error of a state before an
impact or at the end.

Run as ``python examples/optimal_throw.py [out.png]``.
"""

import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

import zivi

G, E, HEIGHT, DURATION = 9.81, 0.7, 1.0, 1.5


class Flight(NamedTuple):
    """A flight: its start (s), duration (s), states at both ends (m, m/s)."""

    start: float
    duration: float
    before: tuple[float, float]
    after: tuple[float, float]

    def deviations(self) -> tuple[float, float]:
        """Return distance and velocity at the end relative to the free flight."""
        (x, v), T = self.before, self.duration
        return self.after[0] - (x + v * T - G * T**2 / 2), self.after[1] - (v - G * T)

    def effort(self) -> float:
        """Return the least effort."""
        (d, w), T = self.deviations(), self.duration
        return 12 * d**2 / T**3 - 12 * d * w / T**2 + 4 * w**2 / T

    def control(self, t: float) -> float:
        """Return the optimal control, linear in time."""
        (d, w), T, s = self.deviations(), self.duration, t - self.start
        return (6 * d / T**2 - 2 * w / T) + (6 * w / T**2 - 12 * d / T**3) * s


def flights(p: NDArray[np.float64], impacts: int) -> list[Flight]:
    """Return the flights for durations and speeds at the impacts."""
    durations = [*p[:impacts], DURATION - float(np.sum(p[:impacts]))]
    arrivals = [*((0.0, -float(speed)) for speed in p[impacts:]), (HEIGHT, 0.0)]
    found, start, state = [], 0.0, (HEIGHT, 0.0)
    for length, after in zip(durations, arrivals, strict=True):
        found.append(Flight(start, float(length), state, after))
        start, state = start + float(length), (0.0, -E * after[1])
    return found


def solve(impacts: int) -> list[Flight]:
    """Minimise the effort for a number of impacts."""
    if impacts == 0:
        return flights(np.zeros(0), 0)

    def effort(p: NDArray[np.float64]) -> float:
        lengths = [*p[:impacts], DURATION - np.sum(p[:impacts])]
        if min(lengths) <= 1e-3:
            return 1e6
        return sum(it.effort() for it in flights(p, impacts))

    length = DURATION / (impacts + 1)
    p = np.array([length] * impacts + [4.4] * impacts)
    exact = {"xatol": 1e-11, "fatol": 1e-12, "maxiter": 20_000, "maxfev": 20_000}
    for _ in range(3):
        p = minimize(effort, p, method="Nelder-Mead", options=exact).x
    return flights(p, impacts)


def motion(part: Flight) -> zivi.Trajectory:
    """Simulate a flight under the optimal control, up to a nanosecond before the impact."""
    ball = zivi.ImpactSystem(lambda t, x, v: part.control(t) - G, e=E)
    span = (part.start, part.start + part.duration - 1e-9)
    return zivi.simulate(ball, span, part.before, zivi.SwitchedRK(rtol=1e-11, atol=1e-13))


def arrival(parts: list[Flight]) -> float:
    """Return the largest error of a state at the end of a flight."""
    runs = [(motion(part), part) for part in parts]
    ends = [(run.x[-1] - it.after[0], run.xdot[-1] - it.after[1]) for run, it in runs]
    return float(np.max(np.abs(ends)))


def main(path: str | None) -> None:
    """Solve for zero to two impacts, print efforts and errors, and draw if a path is given."""
    found = {n: solve(n) for n in range(3)}
    for n, parts in found.items():
        effort = sum(it.effort() for it in parts)
        print(f"{n} impacts: effort {effort:.8f} m^2/s^3 ({arrival(parts):.0e})")
    if path is not None:
        draw(path, found)


def draw(path: str, found: dict[int, list[Flight]]) -> None:
    """Draw heights and controls."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (top, bottom) = plt.subplots(
        2, 1, layout="constrained", figsize=(7.2, 4.8), sharex=True
    )
    colours = (zivi.plot.GREEN, zivi.plot.ORANGE, zivi.plot.BLUE)
    for (n, parts), colour in zip(found.items(), colours, strict=True):
        runs = [motion(part) for part in parts]
        times = [np.linspace(run.t[0], run.t[-1], 80) for run in runs]
        heights = [run(t)[0] for run, t in zip(runs, times, strict=True)]
        forces = [[it.control(s) for s in t] for it, t in zip(parts, times, strict=True)]
        label = f"{n} impacts, effort {sum(it.effort() for it in parts):.2f}"
        top.plot(np.concatenate(times), np.concatenate(heights), color=colour, label=label)
        bottom.plot(np.concatenate(times), np.concatenate(forces), color=colour)
    top.set(ylabel="height (m)")
    bottom.set(xlabel="time $t$ (s)", ylabel="control (m/s²)")
    top.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
