r"""A four-bar linkage: a crank that turns uniformly swings a rocker.

Crank, coupler and rocker are a tree; ``Connect`` closes the chain at the tip of the rocker, and
``Drive`` turns the crank. The angle of the rocker is Freudenstein's, and the torque of the drive is
that of the energies as functions of the crank's angle alone,

    tau = 1/2 omega^2 dI/dtheta + dV/dtheta      with T = 1/2 I(theta) omega^2

Run as ``python examples/mechanics_four_bar.py [out.png]``.
"""

import sys

import numpy as np

import zivi
from zivi.mechanics import Body, Connect, Drive

GROUND, CRANK, COUPLER, ROCKER, G = 0.4, 0.1, 0.35, 0.25, 9.81
OMEGA, START, T = 8.0, 0.4, 1.7
MASSES = {"crank": 0.3, "coupler": 0.8, "rocker": 0.6}
LENGTHS = {"crank": CRANK, "coupler": COUPLER, "rocker": ROCKER}


def linkage() -> zivi.Tree:
    """Return the linkage in the plane of x and y, of slender bars."""

    def bar(name: str, parent: str | None, place: float) -> Body:
        m, length = MASSES[name], LENGTHS[name]
        com, inertia = [length / 2, 0, 0], m * length**2 / 12
        return Body(name, parent, position=[place, 0, 0], mass=m, com=com, inertia=inertia)

    bars = [bar("crank", None, 0.0), bar("coupler", "crank", CRANK), bar("rocker", None, GROUND)]
    pin = Connect("coupler", "rocker", point=[COUPLER, 0, 0], other_point=[ROCKER, 0, 0])
    drive = Drive("crank", f"{START} + {OMEGA}*t")
    return zivi.Tree(bars, constraints=[pin, drive], gravity=[0, -G, 0])


def angles(theta: complex) -> tuple[complex, complex]:
    """Return the angles of coupler and rocker to the ground, with the tip above."""
    x, y = GROUND - CRANK * np.cos(theta), -CRANK * np.sin(theta)
    c = (x * x + y * y + ROCKER**2 - COUPLER**2) / (-2 * ROCKER)
    # x cos(rocker) + y sin(rocker) = c
    k = np.sqrt(x * x + y * y - c * c)
    rocker = np.arctan((y * c + x * k) / (x * c - y * k)) + np.pi
    coupler = np.arctan((y + ROCKER * np.sin(rocker)) / (x + ROCKER * np.cos(rocker)))
    return coupler, rocker


def energies(theta: complex) -> tuple[complex, complex]:
    """Return the inertia about the crank's axis (kg m^2) and the potential energy (J)."""
    coupler, rocker = angles(theta)
    # rates for a rate of one of the crank, from the closed chain
    sine = np.sin(rocker - coupler)
    b = CRANK * np.sin(theta - rocker) / (COUPLER * sine)
    c = CRANK * np.sin(theta - coupler) / (ROCKER * sine)
    m1, m2, m3 = MASSES.values()
    along = CRANK**2 + CRANK * COUPLER * b * np.cos(theta - coupler)
    inertia = m1 * CRANK**2 / 3 + m2 * (along + COUPLER**2 * b * b / 3) + m3 * (ROCKER * c) ** 2 / 3
    height = (m1 / 2 + m2) * CRANK * np.sin(theta) + m2 * COUPLER * np.sin(coupler) / 2
    return inertia, G * (height + m3 * ROCKER * np.sin(rocker) / 2)


def torque(theta: float) -> float:
    """Return the torque of the drive by complex steps (N m)."""
    inertia, potential = energies(theta + 1e-30j)
    return float((0.5 * OMEGA**2 * inertia + potential).imag / 1e-30)


def run() -> zivi.MechanicalTrajectory:
    """Turn the crank for more than two rounds."""
    tree = linkage()
    guess = [START, *(float(it.real) for it in angles(START))]
    start = zivi.consistent(tree, [START, guess[1] - START, guess[2]])
    return zivi.simulate(tree, (0, T), start, zivi.SwitchedRK(rtol=1e-11, atol=1e-11))


def main(path: str | None) -> None:
    """Turn the crank, print beside what is expected, and draw if a path is given."""
    sol = run()
    print(repr(sol))
    row = sol.equality_names.index("crank.drive")
    for t in (0.6, 1.7):
        at, theta = sol.resample([t]), START + OMEGA * t
        rocker = float(angles(theta)[1].real)
        print(f"after {t} s the rocker is at {at.q[0, 2]:.9f} rad ({rocker:.9f})")
        found = at.constraint_forces[0, row]
        print(f"the torque of the drive is {found:.8f} N m ({torque(theta):.8f})")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the linkage with the path of a point of the coupler, the rocker and the torque."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(10.4, 3.2))
    fine = sol.resample(n=801)
    theta, coupler = fine.q[:, 0], fine.q[:, 0] + fine.q[:, 1]
    crank = CRANK * np.array([np.cos(theta), np.sin(theta)])
    tip = crank + COUPLER * np.array([np.cos(coupler), np.sin(coupler)])
    for k in range(0, 400, 57):
        chain = np.array([[0, 0], crank[:, k], tip[:, k], [GROUND, 0]])
        axes[0].plot(*chain.T, color="0.75", lw=1)
    point = crank + np.array(
        [
            COUPLER / 2 * np.cos(coupler) - 0.1 * np.sin(coupler),
            COUPLER / 2 * np.sin(coupler) + 0.1 * np.cos(coupler),
        ]
    )
    axes[0].plot(*point)
    axes[0].set(xlabel="$x$ (m)", ylabel="$y$ (m)", aspect="equal")
    axes[1].plot(fine.t, np.degrees(fine.q[:, 2]))
    axes[1].set(xlabel="time $t$ (s)", ylabel="rocker (degrees)")
    axes[2].plot(fine.t, fine.constraint_forces[:, fine.equality_names.index("crank.drive")])
    axes[2].set(xlabel="time $t$ (s)", ylabel="torque of the drive (N m)")
    figure.suptitle("A four-bar linkage: path of a point of the coupler, rocker, torque")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
