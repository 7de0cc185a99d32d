r"""A slider-crank: a closed chain whose crank turns as prescribed.

Crank, rod and slider are a tree; ``Connect`` closes the chain at the pin of the slider, ``Drive``
prescribes the angle of the crank. The slider is at ``x = r cos th + l cos ph`` with
``sin ph = -(r/l) sin th``. Then the drive is released: crank and flywheel go on with their energy.
In brackets: closed forms, and the energy at the release.

Run as ``python examples/mechanics_slider_crank.py [out.png]``.
"""

import sys

import numpy as np

import zivi
from zivi.mechanics import Body, Connect, Drive

R, L, OMEGA, T = 0.1, 0.25, 30.0, 0.5
METHOD = zivi.SwitchedRK(rtol=1e-11, atol=1e-11)


def system(*constraints: Drive) -> zivi.Tree:
    """Return the linkage in a horizontal plane."""
    bodies = [
        Body("crank", mass=0.5, com=[R / 2, 0, 0], inertia=0.02),
        Body("rod", "crank", position=[R, 0, 0], mass=0.4, com=[L / 2, 0, 0], inertia=0.002),
        Body("slider", kind="slide", axis=[1, 0, 0], mass=0.8),
    ]
    pin = Connect("rod", "slider", point=[L, 0, 0], other_point=[0, 0, 0], name="pin")
    return zivi.Tree(bodies, constraints=[pin, *constraints])


def place(th: float) -> float:
    """Return the place of the slider at a crank angle (m)."""
    return R * float(np.cos(th)) + L * float(np.sqrt(1 - (R / L * np.sin(th)) ** 2))


def energy(tree: zivi.Tree, q: np.ndarray, qdot: np.ndarray) -> float:
    """Return the kinetic energy (J)."""
    return float(0.5 * qdot @ tree.at(0.0, q, qdot).mass @ qdot)


def run() -> tuple[zivi.MechanicalTrajectory, zivi.MechanicalTrajectory]:
    """Drive the crank, then release it."""
    driven, free = system(Drive("crank", f"{OMEGA}*t")), system()
    start = zivi.consistent(driven, [0.0, 0.0, R + L])
    first = zivi.simulate(driven, (0, T), start, METHOD)
    second = zivi.simulate(free, (T, 2 * T), (first.q[-1], first.qdot[-1]), METHOD)
    return first, second


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    driven, free = run()
    print(repr(driven))
    print(f"slider at {driven.q[-1, 2]:.15f} m ({place(OMEGA * T):.15f})")
    torque = driven.constraint_forces[:, driven.equality_names.index("crank.drive")]
    print(f"torque of the drive up to {np.abs(torque).max():.6f} N m")
    tree = system()
    left, kept = (energy(tree, free.q[k], free.qdot[k]) for k in (-1, 0))
    print(f"energy after the release {left:.9f} J ({kept:.9f})")
    off = [abs(place(q[0]) - q[2]) for q in free.q]
    print(f"the chain opens by less than 1e-15 m: {max(off) < 1e-15}")
    if path is not None:
        draw(path, driven, free)


def draw(path: str, driven: zivi.MechanicalTrajectory, free: zivi.MechanicalTrajectory) -> None:
    """Draw slider, speed of the crank and torque of the drive over time."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    # between the steps, too
    driven, free = (sol.resample(np.linspace(sol.t[0], sol.t[-1], 401)) for sol in (driven, free))
    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(3, 1, layout="constrained", figsize=(8, 5.6), sharex=True)
    for sol, colour in ((driven, zivi.plot.BLUE), (free, zivi.plot.ORANGE)):
        axes[0].plot(sol.t, sol.q[:, 2], color=colour)
        axes[1].plot(sol.t, sol.qdot[:, 0], color=colour)
    row = driven.equality_names.index("crank.drive")
    axes[2].plot(driven.t, driven.constraint_forces[:, row], color=zivi.plot.BLUE)
    for ax, label in zip(axes, ("slider (m)", "crank (rad/s)", "torque (N m)"), strict=True):
        ax.set_ylabel(label)
        ax.axvline(T, color="0.6", lw=0.8)
    axes[0].set_title("a slider-crank: driven with 30 rad/s, then released")
    axes[2].set_xlabel("time (s)")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
