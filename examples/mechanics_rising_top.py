r"""A top whose tip is a small ball rises: it slides on the table, and friction turns it upright.

The top is a free body in space; it touches the table with a ball of radius rho about the origin of
its frame, and its centre of mass is at the height h above it, along its axis zeta. Whatever force
acts at the point of contact, Jellett's integral

    J = L . (h zeta + rho z)

stays as it is, with the spin L about the centre of mass and the vertical z: neither sliding nor
rolling nor small hops change it.

Run as ``python examples/mechanics_rising_top.py [out.png]``.
"""

import sys

import numpy as np

import zivi
from zivi.mechanics import Ball, Body, Contact, Plane

RHO, H, MASS, MU = 0.004, 0.02, 0.03, 0.05
AXIAL = 0.6 * MASS * 0.015**2
ACROSS = MASS * (0.015**2 / 4 + 0.01**2 / 3)
TOP = Body("top", kind="free", mass=MASS, com=[0, 0, H], inertia=[ACROSS, ACROSS, AXIAL])
SYSTEM = zivi.Tree(
    [TOP],
    contacts=[Contact("top", "table", mu=MU)],
    shapes={"top": Ball(RHO), "table": Plane((0, 0, 1))},
)
SPIN, TILT = 250.0, 0.35


def spin() -> zivi.MechanicalTrajectory:
    """Release it with the spin about its axis, which is tilted; its centre of mass is at rest."""
    turn = [np.cos(TILT / 2), np.sin(TILT / 2), 0.0, 0.0]
    axis = np.array([0.0, -np.sin(TILT), np.cos(TILT)])
    velocity = np.cross(SPIN * axis, -H * axis)
    start = [0, 0, RHO, *turn], [*velocity, 0, 0, SPIN]
    return zivi.simulate(SYSTEM, (0, 1.5), start, zivi.SwitchedRK(rtol=1e-8, atol=1e-10))


def axis_of(sol: zivi.MechanicalTrajectory) -> np.ndarray:
    """Return the axis of the top at the samples, of shape (k, 3)."""
    w, x, y, z = sol.pose("top")[1].T
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)


def jellett(sol: zivi.MechanicalTrajectory) -> np.ndarray:
    """Return Jellett's integral at the samples."""
    w, x, y, z = sol.pose("top")[1].T
    # the vertical in axes of the top
    vertical = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)
    spin = sol.qvel[:, 3:] * np.array([ACROSS, ACROSS, AXIAL])
    return np.sum(spin * (np.array([0.0, 0.0, H]) + RHO * vertical), axis=1)


def main(path: str | None) -> None:
    """Let it spin, print how it rises, and draw if a path is given."""
    sol = spin()
    angle = np.degrees(np.arccos(axis_of(sol)[:, 2]))
    known = jellett(sol)
    print(repr(sol))
    print(f"tilt: {angle[0]:.3f} degrees at first, {angle[-1]:.3f} at the end")
    for t in (0.5, 1.0, 1.5):
        k = int(np.searchsorted(sol.t, t))
        print(
            f"Jellett's integral at {sol.t[k]:.1f} s: "
            f"{1e6 * known[k]:.7f} ({1e6 * known[0]:.7f}) mg m^3/s"
        )
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the tilt, the slip speed, and where the axis points to."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(10.4, 3.2))
    fine = sol.resample(n=3001)
    axis = axis_of(fine)
    axes[0].plot(fine.t, np.degrees(np.arccos(axis[:, 2])), lw=0.8)
    axes[0].set(xlabel="time $t$ (s)", ylabel="tilt (degrees)", ylim=(0, None))
    axes[1].plot(fine.t, np.hypot(*fine.slips.T), lw=0.8)
    axes[1].set(xlabel="time $t$ (s)", ylabel="slip speed (m/s)")
    axes[2].plot(axis[:, 0], axis[:, 1], lw=0.6)
    axes[2].set(xlabel=r"axis $\zeta_x$ (1)", ylabel=r"axis $\zeta_y$ (1)", aspect="equal")
    figure.suptitle("A top that rises: tilt, slip speed, path of its axis")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
