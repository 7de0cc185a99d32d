r"""A ball that is thrown with spin, and a superball.

It bounces, slides, and rolls at the end. Friction acts in the floor, so the angular momentum about
a point of the floor is kept: whatever the impacts were, the ball rolls with ``(5 v + 2 r spin)/7``,
in brackets; with enough backspin it comes back. A superball gives back what its surface slips:
``w+ = -e_t w-``, by an impulse of ``2/7 (1 + e_t) w-``. In brackets: its speed and spin after that.

Run as ``python examples/mechanics_spin.py [out.png]``.
"""

import sys

import numpy as np

import zivi

R, G = 0.1, 9.81


def throw(
    speed: float, spin: float, mu: float = 0.2, e: float = 0.6, e_t: float = 0.0
) -> zivi.MechanicalTrajectory:
    """Throw a ball of 1 kg from a height of 1 m; the spin is forwards."""
    floor = zivi.LinearGap([0, 1, 0], -R, name="floor", tangent=[1, 0, -R], mu=mu, e_t=e_t)
    ball = zivi.MechanicalSystem(
        mass=np.diag([1.0, 1.0, 0.4 * R**2]),
        force=[0.0, -G, 0.0],
        gaps=[floor],
        e=e,
        coordinates=["x", "y", "turn"],
    )
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-10)
    return zivi.simulate(ball, (0, 4), ([0, 1 + R, 0], [speed, 0, spin]), method)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    v, spin = 2.0, -90.0
    back = throw(v, spin)
    print(repr(back))
    print(f"rolls back with {-back.qdot[-1, 0]:.7f} m/s ({-(5 * v + 2 * R * spin) / 7:.7f})")
    superball = throw(v, 0.0, mu=2.0, e=0.9, e_t=0.9)
    first, second = superball.resolved_impacts["t"][:2]
    after = superball((first + second) / 2)[1]
    impulse = 2 / 7 * 1.9 * v
    print(f"a superball keeps {after[0]:.7f} m/s ({v - impulse:.7f})")
    print(f"and spins with {after[2]:.7f} rad/s ({2.5 * impulse / R:.7f})")
    if path is not None:
        draw(path, back, throw(v, 0.0), superball)


def draw(path: str, *runs: zivi.MechanicalTrajectory) -> None:
    """Draw the paths, the slip speeds, and when the first ball slides and rolls."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(10.4, 3.2))
    for sol, name in zip(runs, ("backspin", "no spin", "superball"), strict=True):
        fine = sol.resample(n=2001)
        axes[0].plot(fine.q[:, 0], fine.q[:, 1], lw=0.9, label=name)
        axes[1].plot(fine.t, fine.slips[:, 0], lw=0.9)
    axes[0].set(xlabel="$x$ (m)", ylabel="$y$ (m)")
    axes[0].legend()
    axes[1].set(xlabel="time $t$ (s)", ylabel="slip speed (m/s)")
    zivi.plot.modes(runs[0], axes[2])
    figure.suptitle("Balls with spin: paths, slip speeds, stick of the ball with backspin")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
