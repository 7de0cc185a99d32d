"""A rimless wheel that walks down a slope: eight legs, plastic impacts, Coulomb friction.

Coordinates are the place of the hub along and above the slope, and the angle of the wheel. Each leg
has a gap and a slip speed. In brackets: the steady angular velocity, at which the energy of the
descent balances the loss of a step (McGeer, 1990).

Run as ``python examples/mechanics_rimless_wheel.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

LEGS, ALPHA = 8, math.pi / 8
J, L, G, SLOPE, MU = 0.1, 1.0, 9.81, 0.12, 2.0


def wheel() -> zivi.MechanicalSystem:
    """Derive and compile the wheel, of 1 kg."""
    feet = {f"foot{k}": f"th + {2 * ALPHA * k}" for k in range(LEGS)}
    return zivi.symbolic.system(
        "x y th",
        T="(xdot**2 + ydot**2 + J*thdot**2)/2",
        V="g*(y*cos(slope) - x*sin(slope))",
        gaps={name: f"y - l*cos({angle})" for name, angle in feet.items()},
        slips={name: f"xdot - l*cos({angle})*thdot" for name, angle in feet.items()},
        mu=dict.fromkeys(feet, "mu"),
        parameters={"J": J, "l": L, "g": G, "slope": SLOPE, "mu": MU},
        e=0.0,
    )


def walk(end: float = 12.0) -> zivi.MechanicalTrajectory:
    """Start on foot 0 with 1 rad/s."""
    q0 = [math.sin(-ALPHA), math.cos(ALPHA), -ALPHA]
    qdot0 = [math.cos(ALPHA), math.sin(ALPHA), 1.0]
    return zivi.simulate(wheel(), (0, end), (q0, qdot0))


ETA = (J + L**2 * math.cos(2 * ALPHA)) / (J + L**2)
"""Part of the angular velocity that a step keeps: the angular momentum about the new foot stays."""


def steady() -> float:
    """Return the steady angular velocity after a step (rad/s)."""
    gain = 4 * G * L * math.sin(ALPHA) * math.sin(SLOPE) / (J + L**2)
    return ETA * math.sqrt(gain / (1 - ETA**2))


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = walk()
    times = sol.impacts["t"]
    speeds = [sol(t)[1][2] for t in times]
    before = sol(times[-1] - 1e-9)[1][2]
    print(f"a step keeps {speeds[-1] / before:.6f} of the angular velocity ({ETA:.6f})")
    print(f"{len(speeds)} steps; after the last one {speeds[-1]:.4f} rad/s ({steady():.4f})")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the wheel at some instants, its angular velocity, and the normal forces of its feet."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (top, left, right) = plt.subplots(
        3, 1, layout="constrained", figsize=(8.4, 6.4), height_ratios=(2, 2, 2)
    )
    for t in np.linspace(0, 3.0, 4):
        x, y, th = sol(t)[0]
        for k in range(LEGS):
            angle = th + 2 * ALPHA * k
            foot = x - L * math.sin(angle), y - L * math.cos(angle)
            top.plot(*zip((x, y), foot, strict=True), color=zivi.plot.BLUE, lw=1.0)
    top.axhline(0, color="0.3", lw=1.5)
    top.set(aspect="equal", xlabel="along the slope (m)", ylabel="above (m)")
    fine = sol.resample(np.linspace(0, 6.0, 3001))
    left.plot(fine.t, fine.qdot[:, 2])
    left.axhline(steady(), color="0.5", lw=0.8, ls="--")
    left.set(xlabel="time $t$ (s)", ylabel=r"angular velocity (rad/s)")
    for force in fine.reactions.T:  # each foot in a colour of its own
        right.plot(fine.t, np.where(force > 0, force, np.nan))
    right.set(xlabel="time $t$ (s)", ylabel="normal forces (N)", ylim=(0, None))
    figure.suptitle("A rimless wheel walks down a slope (dashed: steady speed after a step)")
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
