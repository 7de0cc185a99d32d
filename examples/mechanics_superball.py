r"""A superball is thrown under a table and comes back.

The ball bounces off the floor, off the underside of the table and off the floor again. A superball
gives back the slip of its surface, ``w+ = -w-``, and its normal speed: each bounce is a linear map
of ``(v, r omega)``,

    floor  1/7 [[3, 4], [10, -3]]      table  1/7 [[3, -4], [-10, -3]]

A ball thrown without spin comes back with ``-333/343`` of its speed (R. L. Garwin, American Journal
of Physics 37, 1969). In brackets: these maps, with the parabolas between the bounces.

Run as ``python examples/mechanics_superball.py [out.png]``.
"""

import sys

import numpy as np

import zivi

R, G, SPEED, DROP = 0.02, 9.81, 2.0, -3.5
PLACE, TABLE, T = (-0.2, 0.3), 0.6, 0.55


def throw(e_t: float) -> zivi.MechanicalTrajectory:
    """Throw the ball of 0.1 kg downwards and forwards, beside the table."""
    floor = zivi.LinearGap([0, 1, 0], -R, name="floor", tangent=[1, 0, -R], mu=5.0, e_t=e_t)
    under = zivi.LinearGap([0, -1, 0], TABLE - R, name="table", tangent=[1, 0, R], mu=5.0, e_t=e_t)
    ball = zivi.MechanicalSystem(
        mass=0.1 * np.diag([1.0, 1.0, 0.4 * R**2]),
        force=[0.0, -0.1 * G, 0.0],
        gaps=[floor, under],
        e=1.0,
        coordinates=["x", "y", "turn"],
    )
    method = zivi.SwitchedRK(rtol=1e-11, atol=1e-11)
    return zivi.simulate(ball, (0, T), ([*PLACE, 0], [SPEED, DROP, 0]), method)


def bounces() -> tuple[list[float], np.ndarray, float]:
    """Return the times of three bounces, ``(v, r omega)`` after them and where the last is."""
    floor, table = np.array([[3, 4], [10, -3]]) / 7, np.array([[3, -4], [-10, -3]]) / 7
    low, rise = PLACE[1] - R, TABLE - 2 * R
    down = float(np.hypot(DROP, np.sqrt(2 * G * low)))
    up = float(np.sqrt(down**2 - 2 * G * rise))
    times = [(down + DROP) / G]
    times += [times[0] + (down - up) / G, times[0] + 2 * (down - up) / G]
    v, x, last = np.array([SPEED, 0.0]), PLACE[0], 0.0
    for t, bounce in zip(times, (floor, table, floor), strict=True):
        x += v[0] * (t - last)
        v, last = bounce @ v, t
    return times, v, x


def main(path: str | None) -> None:
    """Throw the ball, print beside what is expected, and draw if a path is given."""
    sol = throw(1.0)
    print(repr(sol))
    times, after, place = bounces()
    for found, t in zip(sol.impacts["t"], times, strict=False):
        print(f"bounces at {found:.10f} s ({t:.10f})")
    back, _, spin = sol.qdot[-1]
    print(f"comes back with {-back:.10f} m/s ({333 / 343 * SPEED:.10f})")
    print(f"and spins backwards with {-spin:.8f} rad/s ({-after[1] / R:.8f})")
    print(f"the last bounce is {-sol(times[2])[0][0]:.10f} m before the edge ({-place:.10f})")
    if path is not None:
        draw(path, sol, throw(0.0))


def draw(path: str, *runs: zivi.MechanicalTrajectory) -> None:
    """Draw the paths of a superball and of a ball that keeps no slip, and their speeds."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.6))
    for sol, name in zip(runs, ("superball, $e_t = 1$", "$e_t = 0$"), strict=True):
        fine = sol.resample(n=1801)
        axes[0].plot(fine.q[:, 0], fine.q[:, 1], lw=1.2, label=name)
        axes[1].plot(fine.t, fine.qdot[:, 0], lw=1.2, label=name)
    axes[0].plot([0.0, 0.6], [TABLE, TABLE], color="0.4", lw=3)
    axes[0].axhline(0, color="0.4", lw=3)
    axes[0].set(xlabel="$x$ (m)", ylabel="$y$ (m)", aspect="equal")
    axes[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    axes[1].set(xlabel="time $t$ (s)", ylabel="horizontal speed (m/s)")
    figure.suptitle("A superball under a table")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
