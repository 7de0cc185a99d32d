r"""A ball falls into an obtuse wedge: accumulations of impacts that accumulate themselves.

The two walls make an inner angle of 123 degrees. Their normals have the cosine ``c = cos 1 =
0.54``, and since it is positive, an impact on one wall lifts the ball off the other: it never
rests on a wall for good. It bounces to rest on wall 1, slides, hits wall 0, bounces to rest
there, hits wall 1, and so on. A bounce to rest keeps of the motion along the other wall's normal
the share c, so the times between accumulations shrink by ``c^2 = cos^2(1) = 0.2919266`` a pair.
zivi measures the ratio and extrapolates to the corner. In brackets: a computation with 26 digits
that followed 50 accumulations.

Run as ``python examples/mechanics_wedge.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

A1, A2 = 0.6, 0.4
CORNER = 1.41098795529705


def wedge(e: tuple[float, float] = (0.3, 0.2)) -> zivi.MechanicalSystem:
    """Give the ball between the two walls."""
    return zivi.MechanicalSystem(
        mass=np.eye(2),
        force=lambda t, q, qdot: (-0.1 * qdot[0], -9.81 - 0.1 * qdot[1]),
        gaps=[
            zivi.LinearGap([math.sin(A1), math.cos(A1)], name="left"),
            zivi.LinearGap([-math.sin(A2), math.cos(A2)], name="right"),
        ],
        e=e,
        coordinates=["x", "y"],
    )


def run(rtol: float = 1e-11) -> zivi.MechanicalTrajectory:
    """Let the ball fall."""
    method = zivi.SwitchedRK(rtol=rtol, atol=rtol)
    return zivi.simulate(wedge(), (0, 4), ([0.2, 0.6], [0.3, 0.0]), method)


def ratio(sol: zivi.MechanicalTrajectory) -> float:
    """Measure how the times between accumulations shrink from pair to pair."""
    times = sol.zeno["t"][14:19:2]
    return float((times[2] - times[1]) / (times[1] - times[0]))


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = run()
    print(repr(sol))
    print(f"in the corner from {sol.corners['t'][0]:.9f} s ({CORNER:.9f})")
    print(f"a pair of accumulations shrinks by {ratio(sol):.5f} ({math.cos(1.0) ** 2:.5f})")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the path, and how the accumulations approach the corner."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (left, right) = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.6))
    x = np.array([-0.5, 0.0, 0.6])
    left.fill_between(x, np.where(x < 0, -math.tan(A1) * x, math.tan(A2) * x), -0.1, color="0.85")
    zivi.plot.configuration(sol, left, lw=0.8)
    left.set(xlabel="$x$ (m)", ylabel="$y$ (m)", aspect="equal", ylim=(-0.1, 0.65))
    before = sol.corners["t"][0] - sol.zeno["t"]
    for gap, name in enumerate(sol.gap_names):
        on = (sol.zeno["gap"] == gap) & (before > 0)
        right.semilogy(np.flatnonzero(on), before[on], "o", label=name)
    right.set(xlabel="number of the accumulation", ylabel="time to the corner (s)")
    right.legend()
    figure.suptitle("A ball in a wedge: path, and accumulations up to the corner")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
