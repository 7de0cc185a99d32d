r"""A ball is thrown across a slope with spin: it bounces, slides, and rolls down.

The friction at the contact acts in two directions, against the slip

    W = (x' - r omega_y, y' + r omega_x)

Impacts turn it, and so does the slope while the ball slides. For a homogeneous ball the impacts,
the slip after the last of infinitely many of them and its end are known in closed form: the
numbers in brackets are sums of these with 60 digits.

Run as ``python examples/mechanics_ball_on_slope.py [out.png]``.
"""

import sys

import numpy as np

import zivi

R, M, G, SLOPE, MU, E = 0.2, 1.3, 9.81, 0.1, 0.08, 0.7
REST, STOP, PLACE = 1.1471249062993586, 1.6771829851717349, (9.76706721529984, 4.30827381729272)

FLOOR = zivi.LinearGap(
    [0, 0, 1, 0, 0, 0],
    tangent=[[1, 0, 0, 0, -R, 0], [0, 1, 0, R, 0, 0]],
    mu=MU,
    name="slope",
)
BALL = zivi.MechanicalSystem(
    mass=np.diag([M] * 3 + [0.4 * M * R**2] * 3),
    force=[M * G * np.sin(SLOPE), 0, -M * G * np.cos(SLOPE), 0, 0, 0],
    gaps=[FLOOR],
    e=E,
    coordinates=["x", "y", "z", "turn_x", "turn_y", "turn_z"],
)


def throw() -> zivi.MechanicalTrajectory:
    """Throw it from a height of 0.2 m, with spin."""
    start = [0, 0, 0.2, 0, 0, 0], [1.0, 2.0, 0.0, 10.0, 5.0, 1.0]
    return zivi.simulate(BALL, (0, 4), start, zivi.SwitchedRK(rtol=1e-10, atol=1e-10))


def main(path: str | None) -> None:
    """Throw the ball, print beside what is expected, and draw if a path is given."""
    sol = throw()
    stops = sol.transitions[sol.transitions["after"] == 0]
    print(repr(sol))
    print(f"stays on the slope from {sol.zeno['t'][0]:.13f} s ({REST:.13f})")
    print(f"rolls from {stops['t'][0]:.9f} s ({STOP:.9f})")
    print(f"is at ({sol.q[-1, 0]:.8f}, {sol.q[-1, 1]:.8f}) m after 4 s {PLACE}")
    print(f"slip while it rolls: {np.abs(sol.slips[-1]).max()} m/s")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the path on the slope, the slip speed, and its direction."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(10.4, 3.2))
    fine = sol.resample(n=1601)
    axes[0].plot(fine.q[:, 1], -fine.q[:, 0])
    axes[0].set(xlabel="$y$ (m)", ylabel="down the slope, $-x$ (m)")
    speed, until = np.hypot(*fine.slips.T), fine.t < 2.0
    axes[1].plot(fine.t[until], speed[until])
    axes[1].set(xlabel="time $t$ (s)", ylabel="slip speed (m/s)")
    slips = until & (speed > 0)
    angle = np.degrees(np.arctan2(*fine.slips[slips].T[::-1]))
    axes[2].plot(fine.t[slips], angle, ".", ms=2)
    axes[2].axhline(0, color="0.6", lw=0.8)
    axes[2].set(xlabel="time $t$ (s)", ylabel="direction of slip (degrees)")
    figure.suptitle("A spinning ball thrown across a slope: path, slip speed, slip direction")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
