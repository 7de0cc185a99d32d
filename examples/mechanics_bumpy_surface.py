r"""A cart on a bumpy surface: where it leaves the crest, and where it lands.

A point slides without friction on ``y = A sin(k x)`` from a valley with the velocity u0. On the
surface its energy is kept, ``(1 + y'(x)^2) u^2/2 + g y(x) = E`` with ``u = x'``, and it leaves
where the surface falls away faster than it: ``-y''(x) u^2 = g``. So the point of departure is the
root of one equation, its time an integral over x, and the landing the root of a parabola against
the sine: three numbers that need no simulation (in brackets). Then it bounces to rest on the next
slope and slides on.

Run as ``python examples/mechanics_bumpy_surface.py [out.png]``.
"""

import math
import sys
from collections.abc import Callable

import numpy as np

import zivi

A, K, G = 0.25, 2.0, 9.81
START, SPEED, E, END = -math.pi / (2 * K), 4.8, 0.3, 3.0


def cart() -> zivi.MechanicalSystem:
    """Give the point above the surface, with derivatives by hand."""
    surface = zivi.Gap(
        lambda t, q: q[1] - A * math.sin(K * q[0]),
        lambda t, q: (-A * K * math.cos(K * q[0]), 1.0),
        lambda t, q, qdot: A * K**2 * math.sin(K * q[0]) * qdot[0] ** 2,
        name="surface",
    )
    return zivi.MechanicalSystem(
        mass=np.eye(2), force=[0.0, -G], gaps=[surface], e=E, coordinates=["x", "y"]
    )


def run(rtol: float = 1e-10) -> zivi.MechanicalTrajectory:
    """Let the cart go in the valley."""
    method = zivi.SwitchedRK(rtol=rtol, atol=rtol)
    return zivi.simulate(cart(), (0, END), ([START, -A], [SPEED, 0.0]), method)


def bisect(function: Callable[[float], float], low: float, high: float) -> float:
    """Give the root between two points where the signs differ."""
    sign = function(low) > 0
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if (function(middle) > 0) is sign else (low, middle)
    return (low + high) / 2


def squared(x: float) -> float:
    """Give u^2 at x from the energy."""
    energy = SPEED**2 / 2 - G * A
    return 2 * (energy - G * A * math.sin(K * x)) / (1 + (A * K * math.cos(K * x)) ** 2)


def departure() -> tuple[float, float]:
    """Give time and place at which the cart leaves the crest."""
    x = bisect(lambda x: A * K**2 * math.sin(K * x) * squared(x) - G, 0.0, math.pi / (2 * K))
    nodes, weights = np.polynomial.legendre.leggauss(60)
    points = START + (x - START) * (nodes + 1) / 2
    slowness = [1 / math.sqrt(squared(point)) for point in points]
    return float(weights @ slowness) * (x - START) / 2, x


def landing() -> float:
    """Give the time of the first impact."""
    t, x = departure()
    u = math.sqrt(squared(x))
    y, v = A * math.sin(K * x), A * K * math.cos(K * x) * u

    def gap(s: float) -> float:
        return y + v * s - G * s**2 / 2 - A * math.sin(K * (x + u * s))

    return t + bisect(gap, 0.2, 1.0)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = run()
    print(repr(sol))
    t, x = departure()
    leaves = sol.liftoffs["t"][0]
    print(f"leaves the crest after {leaves:.9f} s ({t:.9f})")
    print(f"at x = {sol(leaves)[0, 0]:.9f} m ({x:.9f})")
    hits = sol.impacts["t"][sol.impacts["t"] > leaves]
    print(f"first impact after {hits[0]:.9f} s ({landing():.9f})")
    print(f"on the surface again, sliding, from {sol.zeno['t'][-1]:.9f} s")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the path above the surface, and the force of the surface."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (top, bottom) = plt.subplots(2, 1, layout="constrained", figsize=(9.6, 4.6))
    dense = sol.resample(n=2000)
    x = np.linspace(dense.q[0, 0], dense.q[-1, 0], 1000)
    top.fill_between(x, A * np.sin(K * x), -0.5, color="0.85")
    top.plot(*dense.q.T, color=zivi.plot.BLUE)
    top.set(xlabel="$x$ (m)", ylabel="$y$ (m)", aspect="equal", ylim=(-0.4, 0.7))
    zivi.plot.reactions(sol, bottom)
    bottom.set(xlabel="time $t$ (s)", ylabel="force of the surface (N)")
    figure.suptitle("A cart on a bumpy surface: path and contact force")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
