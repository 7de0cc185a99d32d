r"""Three balls on top of each other on a vibrating floor: a tower that falls together and leaves.

The floor moves as ``A sin(omega t)``. The balls bounce to rest on it and on each other, many gaps
at once. Then the tower moves with the floor until the floor falls faster than a free body: ``A
omega^2 sin(omega t) = g``. At this instant all the forces in the tower vanish together, the
lowest gap alone opens, and the tower flies closed, without forces in it, until it lands and is
hit as a whole. In brackets: the time of leaving by this formula; the accumulation by a
computation with 26 digits.

Run as ``python examples/mechanics_tower.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

A, OMEGA, G = 0.12, 11.0, 9.81
MASSES = (2.0, 1.0, 0.7)
ON_THE_FLOOR = 1.01835161569581


def tower(e: tuple[float, float, float] = (0.3, 0.2, 0.3)) -> zivi.MechanicalSystem:
    """Give the three balls above the floor."""
    floor = zivi.HarmonicWall(A, OMEGA, phase=-math.pi / 2)  # A sin(omega t)
    return zivi.MechanicalSystem(
        mass=np.diag(MASSES),
        force=-G * np.array(MASSES),
        gaps=[
            zivi.LinearGap([1, 0, 0], motion=floor, name="floor"),
            zivi.LinearGap([-1, 1, 0], name="1-2"),
            zivi.LinearGap([0, -1, 1], name="2-3"),
        ],
        e=e,
        coordinates=["ball 1", "ball 2", "ball 3"],
    )


def fall(end: float = 2.0) -> zivi.MechanicalTrajectory:
    """Let the balls fall from three heights."""
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-10)
    return zivi.simulate(tower(), (0, end), ([0.2, 0.5, 0.9], [0.0, 0.0, 0.0]), method)


def leaves(n: int) -> float:
    """Give the n-th time at which the floor falls away from a free body."""
    return (math.asin(G / (A * OMEGA**2)) + 2 * math.pi * n) / OMEGA


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = fall()
    print(repr(sol))
    for n, t in enumerate(sol.liftoffs["t"], start=1):
        print(f"the tower leaves the floor: {t:.9f} s ({leaves(n):.9f})")
    second = sol.zeno[sol.zeno["gap"] == 0][1]
    print(f"it has come to rest on it: {second['t']:.9f} s ({ON_THE_FLOOR:.9f})")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the heights of the balls, and the forces below them."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (top, bottom) = plt.subplots(2, 1, layout="constrained", figsize=(9.6, 5), sharex=True)
    t = np.linspace(0, sol.t[-1], 1000)
    top.plot(t, A * np.sin(OMEGA * t), color="0.5", label="floor")
    zivi.plot.coordinates(sol, top)
    top.set(xlabel="", ylabel="heights (m)")
    zivi.plot.reactions(sol, bottom)
    bottom.set(xlabel="time $t$ (s)", ylabel="forces (N)")
    figure.suptitle("A tower of balls on a vibrating floor")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
