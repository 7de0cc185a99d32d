r"""Five figures for a lecture on impacts: what a Zeno point is, and what a forced ball does.

Positions of balls with three restitutions; the phase plane; the same motion in the coordinates
``(s, v)``, in which it does not jump; the time of rest over the restitution; the bifurcation
diagram of a ball on a vibrating table. In brackets: closed forms.

Run as ``python examples/lecture_figures.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

GRAVITY, HEIGHT = 9.81, 1.0
RESTITUTIONS = (0.3, 0.5, 0.7)


def dropped(e: float) -> zivi.Trajectory:
    """Drop a ball."""
    return zivi.simulate(zivi.ImpactSystem(-GRAVITY, e=e), (0, 3), (HEIGHT, 0))


def zeno_time(e: float) -> float:
    """Sum the geometric series of the flights."""
    return math.sqrt(2 * HEIGHT / GRAVITY) * (1 + e) / (1 - e)


def rest_times(restitutions: np.ndarray) -> np.ndarray:
    """Compute the times of rest of many balls, as a batch."""
    ball = zivi.ImpactSystem(-GRAVITY, e=0.5)
    parameters = {"e": restitutions}
    return zivi.simulate_batch(ball, (0, 20), (HEIGHT, 0), parameters=parameters).rest_time


def table(gamma: float, e: float = 0.5) -> zivi.ImpactSystem:
    """Give a ball above a table that vibrates with gamma g, seen from the table."""
    return zivi.ImpactSystem(
        zivi.LinearForce(gravity=1.0, amplitude=gamma, phase=-math.pi / 2), e=e
    )


def doubling(e: float = 0.5) -> tuple[float, float]:
    """Where the orbit of one impact a period doubles its period: followed, and in closed form."""
    orbit = zivi.periodic_orbit(table(1.3, e), [(0.6, 2.1)])
    found = zivi.continue_orbit(orbit, "amplitude", (1.2, 1.7)).of_kind("period_doubling")[0].value
    one, two = math.pi * (1 - e) / (1 + e), 2 * (1 + e**2) / (1 + e) ** 2
    return found, math.hypot(one, two)


def main(path: str | None) -> None:
    """Print beside what is expected, and draw if a path is given."""
    for e in RESTITUTIONS:
        print(f"e = {e}: at rest from {dropped(e).rest_time:.12f} s ({zeno_time(e):.12f})")
    grid = np.linspace(0.05, 0.85, 81)
    worst = np.abs(rest_times(grid) - [zeno_time(e) for e in grid]).max()
    print(f"largest difference of 81 times of rest: {worst:.0e} s")
    found, exact = doubling()
    print(f"period doubling at {found:.9f} ({exact:.9f})")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the five figures."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplot_mosaic("AABBCC;DDDEEE", layout="constrained", figsize=(10.0, 6.0))
    colors = (zivi.plot.BLUE, zivi.plot.ORANGE, "0.4")
    for e, color in zip(RESTITUTIONS, colors, strict=True):
        sol = dropped(e)
        zivi.plot.position(sol, axes["A"], color=color, lw=1.0, label=f"e = {e}")
    axes["A"].legend()
    axes["A"].set_title("positions")
    sol = dropped(0.7)
    zivi.plot.phase_plane(sol, axes["B"], coordinates="physical").set_title("phase plane")
    zivi.plot.lifted(sol, axes["C"]).set_title("unfolded at the wall")
    grid = np.linspace(0.05, 0.85, 81)
    axes["D"].plot(grid, rest_times(grid), ".", ms=4, color=zivi.plot.BLUE)
    axes["D"].plot(grid, [zeno_time(e) for e in grid], color="0.5", lw=0.8)
    axes["D"].set(xlabel="restitution $e$ (1)", ylabel="time of rest (s)", title="Zeno time")
    gammas = np.linspace(1.2, 1.7, 150)
    diagram = zivi.bifurcation_diagram(table(1.3), "amplitude", gammas, starts=(0.3, 1.9))
    zivi.plot.diagram(diagram, ax=axes["E"], ms=1.0).set_title("a shaken ball doubles its period")
    axes["E"].axvline(doubling()[1], color="0.5", lw=0.8)
    figure.suptitle("Five figures on the bouncing ball")
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
