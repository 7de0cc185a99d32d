r"""A tripod slides and spins on a floor until friction stops it.

Each foot has Coulomb friction in two directions. Its load is a third of the weight, so that the
velocity ``v = (x', y', theta')`` obeys

    diag(m, m, I) v' = -(mu m g/3) sum_k B_k^T W_k/|W_k|,      W_k = B_k(theta) v

One foot sticks first; its slip turns ever faster while it stops. Then the tripod turns
about this foot, uniformly slowed, and stops. The numbers in brackets are from these
equations: DOP853 of SciPy up to a slip of 1e-9 m/s, then the closed form.

Run as ``python examples/mechanics_tripod.py [out.png]``.
"""

import sys

import numpy as np

import zivi

ANGLES = 0.3 + 2 * np.pi / 3 * np.arange(3)
PLACES = [(f"cos(theta + {a!r})", f"sin(theta + {a!r})") for a in ANGLES.tolist()]
FIRST, LAST, ENERGY = 5.20670450877420, 6.03065633281650, 1.42

TRIPOD = zivi.symbolic.system(
    "x y z tilt_x tilt_y theta",
    T="(xdot**2 + ydot**2 + zdot**2 + 0.5*tilt_xdot**2 + 0.5*tilt_ydot**2 + 0.8*thetadot**2)/2",
    V="z",
    gaps={f"foot{k}": f"z + {y}*tilt_x - {x}*tilt_y" for k, (x, y) in enumerate(PLACES)},
    slips={
        f"foot{k}": [f"xdot - {y}*thetadot", f"ydot + {x}*thetadot"]
        for k, (x, y) in enumerate(PLACES)
    },
    mu=dict.fromkeys(["foot0", "foot1", "foot2"], 0.3),
)


def slide() -> zivi.MechanicalTrajectory:
    """Push it with 1.02 m/s, spinning with 1.5 rad/s."""
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

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(10.4, 3.2))
    fine = sol.resample(n=1601)
    for k, angle in enumerate(ANGLES):
        turned = fine.q[:, 5] + angle
        axes[0].plot(fine.q[:, 0] + np.cos(turned), fine.q[:, 1] + np.sin(turned))
        slip = fine.slips[:, 2 * k : 2 * k + 2]
        speed = np.hypot(*slip.T)
        axes[1].plot(fine.t, speed, label=f"foot {k}")
        angle = np.degrees(np.unwrap(np.arctan2(slip[speed > 0, 1], slip[speed > 0, 0])))
        axes[2].plot(fine.t[speed > 0], angle)
    axes[0].set(xlabel="$x$ (m)", ylabel="$y$ (m)", aspect="equal")
    axes[1].set(xlabel="time $t$ (s)", ylabel="slip speed (m/s)")
    axes[1].legend()
    axes[2].set(xlabel="time $t$ (s)", ylabel="direction of slip (degrees)")
    figure.suptitle("A tripod: paths of its feet, slip speeds, slip directions")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
