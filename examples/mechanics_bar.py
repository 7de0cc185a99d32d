r"""An elastic bar dropped on a floor: 100 finite elements, 101 coordinates.

Steel, length 1 m, linear elements with consistent masses, dropped from 0.05 mm at 0.1 m/s,
``e = 0`` at the lowest node, as in the examples of Siconos. In brackets: the parabola of the fall,
and sums of the modes of the bar that is held at its end up to where it lets go.

Run as ``python examples/mechanics_bar.py [out.png]``.
"""

import sys

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

import zivi

YOUNG, SECTION, LENGTH, DENSITY, GRAVITY = 210e9, 3.14e-4, 1.0, 7800.0, 9.81
ELEMENTS, HEIGHT, SPEED, END = 100, 5e-5, -0.1, 1.5e-3


def matrices(elements: int = ELEMENTS) -> tuple[np.ndarray, np.ndarray]:
    """Give mass and stiffness."""
    size = LENGTH / elements
    diagonal = np.ones(elements + 1)
    diagonal[[0, -1]] = 0.5
    beside = np.eye(elements + 1, k=1) + np.eye(elements + 1, k=-1)
    mass = DENSITY * SECTION * size / 6 * (4 * np.diag(diagonal) + beside)
    stiffness = YOUNG * SECTION / size * (2 * np.diag(diagonal) - beside)
    return mass, stiffness


def bar(elements: int = ELEMENTS) -> zivi.LinearSystem:
    """Give the bar above the floor."""
    mass, stiffness = matrices(elements)
    weight = -GRAVITY * mass @ np.ones(elements + 1)
    floor = zivi.LinearGap(np.eye(elements + 1)[0], 0.0, name="floor")
    return zivi.LinearSystem(mass, None, stiffness, excitation=weight, gaps=[floor], e=0.0)


def run(end: float = END) -> zivi.MechanicalTrajectory:
    """Drop it."""
    ones = np.ones(ELEMENTS + 1)
    return zivi.simulate(bar(), (0, end), (HEIGHT * ones, SPEED * ones))


def by_modes(end: float = END) -> tuple[float, float, np.ndarray]:
    """Give when it lands and lifts off, and where it is at the end, by modes."""
    mass, stiffness = matrices()
    n = len(mass)
    fall = (SPEED + np.sqrt(SPEED**2 + 2 * GRAVITY * HEIGHT)) / GRAVITY
    # the mass of the first node stops: the others move on under the rigid constraint
    held = slice(1, None)
    m, k = mass[held, held], stiffness[held, held]
    squares, shapes = eigh(m, k)
    omega = 1 / np.sqrt(squares)
    shapes = shapes * omega  # of modal masses of one
    before = np.full(n, SPEED - GRAVITY * fall)
    speed = before[held] + np.linalg.solve(m, mass[held, 0] * before[0])
    load = -GRAVITY * (mass @ np.ones(n))[held]
    static = np.linalg.solve(k, load)
    amplitude, rate = -shapes.T @ m @ static, shapes.T @ m @ speed

    def held_at(s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        cos, sin = np.cos(omega * s), np.sin(omega * s)
        eta = amplitude * cos + rate / omega * sin
        slope = rate * cos - amplitude * omega * sin
        return static + shapes @ eta, shapes @ slope, shapes @ (-(omega**2) * eta)

    def force(s: float) -> float:
        q, _, acceleration = held_at(s)
        weight = GRAVITY * (mass @ np.ones(n))[0]
        return float(mass[0, held] @ acceleration + stiffness[0, held] @ q + weight)

    grid = np.linspace(2e-6, 6e-4, 6000)
    k_last = int(np.argmax([force(s) < 0 for s in grid]))
    lasts = brentq(force, grid[k_last - 1], grid[k_last], xtol=1e-18, rtol=1e-15)
    q, qdot, _ = held_at(lasts)
    squares, shapes = eigh(stiffness, mass)
    omega, s = np.sqrt(np.abs(squares)), end - fall - lasts
    eta, slope = (shapes.T @ mass @ np.concatenate([[0.0], it]) for it in (q, qdot))
    turning = omega > 1.0  # the first mode is the rigid motion
    safe = np.where(turning, omega, 1.0)
    free = np.where(turning, eta * np.cos(omega * s) + slope / safe * np.sin(omega * s), 0.0)
    free = np.where(turning, free, eta + slope * s)
    return fall, fall + lasts, shapes @ free - GRAVITY * s**2 / 2


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = run()
    lands, leaves, end = by_modes()
    print(repr(sol))
    print(f"it lands at {1e3 * sol.impacts['t'][0]:.10f} ms ({1e3 * lands:.10f})")
    print(f"and lifts off at {1e3 * sol.liftoffs['t'][0]:.9f} ms ({1e3 * leaves:.9f})")
    wave = 2 * LENGTH / np.sqrt(YOUNG / DENSITY)
    print(f"in contact for {1e3 * (leaves - lands):.5f} ms; a wave takes {1e3 * wave:.5f} ms")
    print(f"its lower end at the end {1e6 * sol.q[-1, 0]:.7f} um ({1e6 * end[0]:.7f})")
    print(f"its upper end {1e6 * sol.q[-1, -1]:.7f} um ({1e6 * end[-1]:.7f})")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw both ends, and the contact force."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    ones, t = np.ones(ELEMENTS + 1), np.linspace(0, END, 1501)
    sol = zivi.simulate(bar(), (0, END), (HEIGHT * ones, SPEED * ones), t_eval=t)
    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.6))
    axes[0].plot(1e3 * t, 1e6 * sol.q[:, -1], color="0.6", label="upper end")
    axes[0].plot(1e3 * t, 1e6 * sol.q[:, 0], color=zivi.plot.BLUE, label="lower end")
    axes[0].set(xlabel="time (ms)", ylabel="displacement (µm)")
    axes[0].legend()
    impedance = SECTION * np.sqrt(YOUNG * DENSITY)
    axes[1].plot(1e3 * t, 1e-3 * sol.reactions[:, 0], color=zivi.plot.BLUE, lw=0.9)
    axes[1].axhline(1e-3 * impedance * abs(sol.impacts["speed_before"][0]), color="0.6", lw=0.8)
    axes[1].set(xlabel="time (ms)", ylabel="force on the floor (kN)")
    figure.suptitle("An elastic bar dropped on a floor (grey: impedance times speed)")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
