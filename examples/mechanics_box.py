r"""A box on the floor, pulled harder and harder; and a ladder that is about to slip.

Both feet of the box stick: four conditions for three coordinates. The motion is determined, the
forces are not, and the box stands until no forces within the limits of friction hold it. In
brackets: the time from the balance of forces, ``0.3 * 9.81/2`` with both coefficients 0.3, and
``3.924/1.84`` with 0.3 and 0.5, since the pull loads the front foot. A uniform ladder between floor
and wall stands if ``tan th >= (1 - mu mu_w)/(2 mu)``.

Run as ``python examples/mechanics_box.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

HALF_WIDTH, HALF_HEIGHT = 0.5, 0.4


def foot(side: int, mu: float, name: str) -> zivi.Gap:
    """Give a corner of the box above the floor; side is -1 or 1."""
    b, h = side * HALF_WIDTH, -HALF_HEIGHT

    def arm(angle: float) -> tuple[float, float]:
        s, c = math.sin(angle), math.cos(angle)
        return b * c - h * s, b * s + h * c

    return zivi.Gap(
        lambda t, q: q[1] + arm(q[2])[1],
        lambda t, q: [0.0, 1.0, arm(q[2])[0]],
        lambda t, q, qdot: -arm(q[2])[1] * qdot[2] ** 2,
        name=name,
        tangent=lambda t, q: [1.0, 0.0, -arm(q[2])[1]],
        tangent_curvature=lambda t, q, qdot: -arm(q[2])[0] * qdot[2] ** 2,
        mu=mu,
    )


def pulled(rear: float, front: float) -> zivi.MechanicalTrajectory:
    """Pull a box of 1 kg at its centre by 2 N more each second."""
    inertia = (HALF_WIDTH**2 + HALF_HEIGHT**2) / 3
    system = zivi.MechanicalSystem(
        mass=np.diag([1.0, 1.0, inertia]),
        force=lambda t, q, qdot: [2 * t, -9.81, 0.0],
        gaps=[foot(-1, rear, "rear"), foot(1, front, "front")],
        coordinates=["x", "y", "angle"],
    )
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-10)
    return zivi.simulate(system, (0, 3), ([0, HALF_HEIGHT, 0], [0, 0, 0]), method)


def ladder(angle: float, mu: float = 0.5, mu_wall: float = 0.3) -> zivi.MechanicalTrajectory:
    """Lean a uniform ladder of 2 m against a wall on the right."""
    ladder = zivi.symbolic.system(
        "x y th",
        T="(xdot**2 + ydot**2)/2 + thdot**2/6",
        V="g*y",
        gaps={"floor": "y - sin(th)", "wall": "-x - cos(th)"},
        slips={"floor": "xdot + sin(th)*thdot", "wall": "ydot + cos(th)*thdot"},
        mu={"floor": "mu", "wall": "mu_wall"},
        parameters={"g": 9.81, "mu": mu, "mu_wall": mu_wall},
    )
    start = [-math.cos(angle), math.sin(angle), angle]
    return zivi.simulate(ladder, (0, 0.3), (start, [0, 0, 0]))


def least_angle() -> float:
    """Bisect for the angle at which the ladder slips."""
    low, high = 0.5, 1.0
    while high - low > 1e-9:
        middle = (low + high) / 2
        stands = ladder(middle).modes[-1, 0] == 0
        low, high = (low, middle) if stands else (middle, high)
    return high


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    first, second = pulled(0.3, 0.3), pulled(0.3, 0.5)
    print(repr(first))
    print(f"slips at {first.stick['t_end'][0]:.9f} s ({0.3 * 9.81 / 2:.9f})")
    print(f"with another front foot at {second.stick['t_end'][0]:.9f} s ({3.924 / 1.84:.9f})")
    expected = math.atan((1 - 0.5 * 0.3) / (2 * 0.5))
    print(f"the ladder stands from {least_angle():.7f} rad ({expected:.7f})")
    if path is not None:
        draw(path, second)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the speed of the box, the forces of its feet, and when they stick."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(10.4, 3.2))
    fine = sol.resample(n=601)
    axes[0].plot(fine.t, fine.qdot[:, 0])
    axes[0].set(xlabel="time $t$ (s)", ylabel="speed (m/s)")
    for c, name in enumerate(sol.channel_names):
        axes[1].plot(fine.t, fine.reactions[:, c], label=f"normal, {name}")
        axes[1].plot(fine.t, fine.friction_forces[:, c], "--", label=f"friction, {name}")
    axes[1].set(xlabel="time $t$ (s)", ylabel="forces (N)")
    axes[1].legend(fontsize=7)
    zivi.plot.modes(sol, axes[2])
    figure.suptitle("A box pulled with a growing force")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
