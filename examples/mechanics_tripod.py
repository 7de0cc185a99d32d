r"""A tripod slides and spins on a floor until friction stops it.

Each foot has Coulomb friction in two directions. The load is shared equally, so that the velocity
``(x', y', omega)`` obeys

    diag(m, m, I) v' = -(mu m g/3) sum_k B_k^T W_k/|W_k|,      W_k = B_k v

One foot sticks first, with a direction that turns ever faster while it stops; then the tripod turns
about it, uniformly slowed, and stops. The numbers in brackets are those of the three equations,
solved by DOP853 of SciPy up to 1e-9 m/s before each stop.

Run as ``python examples/mechanics_tripod.py [out.png]``.
"""

import sys

import numpy as np

import zivi

M, INERTIA, G, MU = 1.0, 0.8, 1.0, 0.3
ANGLES = 0.3 + 2 * np.pi / 3 * np.arange(3)
FEET = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
ENERGY = 0.5 * (M * (1.0**2 + 0.2**2) + INERTIA * 1.5**2)
FIRST, LAST = 0.0, 0.0

TRIPOD = zivi.MechanicalSystem(
    mass=np.diag([M, M, M, 0.5, 0.5, INERTIA]),
    force=[0, 0, -M * G, 0, 0, 0],
    gaps=[
        zivi.LinearGap(
            [0, 0, 1, b, -a, 0],
            tangent=[[1, 0, 0, 0, 0, -b], [0, 1, 0, 0, 0, a]],
            mu=MU,
            name=f"foot{k}",
        )
        for k, (a, b) in enumerate(FEET)
    ],
    coordinates=["x", "y", "z", "turn_x", "turn_y", "turn_z"],
)


def slide() -> zivi.MechanicalTrajectory:
    """Push it with 1.02 m/s and a spin of 1.5 rad/s."""
    start = np.zeros(6), [1.0, 0.2, 0, 0, 0, 1.5]
    return zivi.simulate(TRIPOD, (0, 8), start, zivi.SwitchedRK(rtol=1e-10, atol=1e-10))


def main(path: str | None) -> None:
    """Let it slide, print beside what is expected, and draw if a path is given."""
    sol = slide()
    stops = sol.transitions[sol.transitions["after"] == 0]
    print(repr(sol))
    print(f"a foot sticks from {stops['t'][0]:.9f} s ({FIRST:.9f})")
    print(f"all stick from {stops['t'][-1]:.9f} s ({LAST:.9f})")
    print(f"dissipated: {sol.dissipated[-1]:.12f} J of {ENERGY} J")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the paths of the feet, their slip speeds, and the directions of slip."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(10.4, 3.2))
    fine = sol.resample(n=1601)
    for k, (a, b) in enumerate(FEET):
        # for small angles of the linear model the feet would not turn with the body
        place = fine.q[:, :2] + np.outer(fine.q[:, 5], [-b, a]) + [a, b]
        axes[0].plot(*place.T, label=f"foot {k}")
        slip = fine.slips[:, 2 * k : 2 * k + 2]
        speed = np.hypot(*slip.T)
        axes[1].plot(fine.t, speed)
        angle = np.degrees(np.unwrap(np.arctan2(slip[speed > 0, 1], slip[speed > 0, 0])))
        axes[2].plot(fine.t[speed > 0], angle)
    axes[0].set(xlabel="$x$ (m)", ylabel="$y$ (m)", aspect="equal")
    axes[0].legend()
    axes[1].set(xlabel="time $t$ (s)", ylabel="slip speed (m/s)")
    axes[2].set(xlabel="time $t$ (s)", ylabel="direction of slip (degrees)")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
