r"""A ball is thrown with backspin: it bounces, slides on a curve, turns back and rolls.

The ball is a free body in space above a plane. A homogeneous ball that touches a plane keeps the
moment about the point of contact, in impacts, in slip and while rolling: from its start alone

    v = v_0 - 2/7 (v_0 - r n x omega_0)

is the velocity of rolling, whatever friction and restitution are; the spin about the normal stays.

Run as ``python examples/mechanics_backspin.py [out.png]``.
"""

import sys

import numpy as np

import zivi
from zivi.mechanics import Ball, Body, Contact, Plane

R, MASS = 0.11, 0.45
BODY = Body("ball", kind="free", mass=MASS, inertia=0.4 * MASS * R**2)
SYSTEM = zivi.Tree(
    [BODY],
    contacts=[Contact("ball", "floor", mu=0.2, e=0.6)],
    shapes={"ball": Ball(R), "floor": Plane((0, 0, 1))},
)
SPEED, SPIN = np.array([3.0, 0.0, 0.0]), np.array([45.0, -60.0, 20.0])
ROLLING = SPEED - 2 / 7 * (SPEED + np.cross(SPIN, [0, 0, -R]))


def throw() -> zivi.MechanicalTrajectory:
    """Throw it from a height of half a metre."""
    start = [0, 0, 0.5 + R, 1, 0, 0, 0], [*SPEED, *SPIN]
    return zivi.simulate(SYSTEM, (0, 6), start, zivi.SwitchedRK(rtol=1e-11, atol=1e-11))


def main(path: str | None) -> None:
    """Throw the ball, print beside what is expected, and draw if a path is given."""
    sol = throw()
    rolls = sol.transitions["t"][sol.transitions["after"] == 0][-1]
    print(repr(sol))
    print(f"stays on the floor from {sol.zeno['t'][0]:.9f} s, rolls from {rolls:.9f} s")
    told = ", ".join(f"{a:.9f} ({b:.9f})" for a, b in zip(sol.qvel[-1], ROLLING[:2], strict=False))
    print(f"rolls with the velocity {told} m/s")
    turns = axes_of(sol)[-1] @ sol.qvel[-1, 3:]
    print(f"spins about the normal with {turns[2]:.9f} ({SPIN[2]:.9f}) 1/s")
    if path is not None:
        draw(path, sol)


def axes_of(sol: zivi.MechanicalTrajectory) -> np.ndarray:
    """Return the axes of the ball at the samples, as columns of matrices."""
    _, p = sol.pose("ball")
    w, v = p[:, :1, None], p[:, 1:]
    cross = np.cross(np.eye(3)[None], v[:, None, :])
    cross = -np.swapaxes(cross, 1, 2)
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the path with a mark on the ball, and slip speed and velocity over time."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure = plt.figure(layout="constrained", figsize=(10.4, 3.6))
    axes = figure.add_subplot(1, 2, 1, projection="3d")
    fine = sol.resample(n=1201)
    place, _ = fine.pose("ball")
    mark = place + R * axes_of(fine)[:, :, 0]
    axes.plot(*place.T, lw=1.2, label="centre")
    axes.plot(*mark.T, lw=0.4, color="0.5", label="a point of the surface")
    axes.set(xlabel="$x$ (m)", ylabel="$y$ (m)", zlabel="$z$ (m)", zticks=[0.2, 0.4, 0.6])
    axes.set_box_aspect((3, 3, 1), zoom=1.1)
    axes.legend(loc="upper left", fontsize=8)
    over = figure.add_subplot(1, 2, 2)
    over.plot(fine.t, np.hypot(*fine.slips.T), label="slip speed")
    for k, name in enumerate("xy"):
        line = over.plot(fine.t, fine.qvel[:, k], label=f"$v_{name}$")[0]
        over.axhline(ROLLING[k], color=line.get_color(), lw=0.6, ls="--")
    over.set(xlabel="time $t$ (s)", ylabel="speed (m/s)")
    over.legend(fontsize=8)
    figure.suptitle("A ball with backspin turns back (dashed: velocity of rolling)")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
