r"""Newton's cradle, and what Newton's law of impact says of it.

Three equal balls, the first comes with velocity 1. If the other two touch, all three are hit at
once, and the law ``g'+ = -e g'-`` for every gap with an impulse gives for e = 1

    -1/3, 2/3, 2/3

with the energy and the momentum kept: a solution, but not what the toy shows. If the balls are
apart by any small distance, the impacts come one after another and the last ball takes it all: 0,
0, 1. Steel balls are between the two, nearer to the second: their contacts are elastic and take
time. So the motion does not depend continuously on the distance.

Then a cradle with e = 1/2, its balls on pendulums and pressed together: they end up swinging as
one. In brackets: the law by hand, and the time of the last accumulation computed with 26 digits.

Run as ``python examples/mechanics_cradle.py [out.png]``.
"""

import sys

import numpy as np

import zivi

TOGETHER = 3.08692630715448
GAPS = [zivi.LinearGap([-1, 1, 0], name="1-2"), zivi.LinearGap([0, -1, 1], name="2-3")]


def line(e: float = 1.0) -> zivi.MechanicalSystem:
    """Give three free balls in a row."""
    return zivi.MechanicalSystem(mass=np.eye(3), force=np.zeros(3), gaps=GAPS, e=e)


def cradle(e: float = 0.5, preload: float = 0.1, omega: float = 2.0) -> zivi.MechanicalSystem:
    """Give three balls on pendulums that hang nearer to each other than the balls are wide."""
    rest = -preload * np.arange(3)
    return zivi.MechanicalSystem(
        mass=np.eye(3),
        force=lambda t, q, qdot: -(omega**2) * (q - rest),
        gaps=GAPS,
        e=e,
        coordinates=["ball 1", "ball 2", "ball 3"],
    )


def hit(distance: float, e: float = 1.0) -> zivi.MechanicalTrajectory:
    """Let the first ball hit the others, which are apart by a distance."""
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-12)
    start = [-0.5, 0.0, distance], [1.0, 0.0, 0.0]
    return zivi.simulate(line(e), (0, 1), start, method)


def swing() -> zivi.MechanicalTrajectory:
    """Let the first ball of the cradle go."""
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-10)
    return zivi.simulate(cradle(), (0, 8), ([-0.5, -0.15, -0.15], [0.0, 0.0, 0.0]), method)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    for distance, law in ((0.0, (-1 / 3, 2 / 3, 2 / 3)), (1e-6, (0.0, 0.0, 1.0))):
        sol = hit(distance)
        print(f"apart by {distance:g} m, e = 1")
        for number, (found, expected) in enumerate(zip(sol.qdot[-1], law, strict=True), start=1):
            print(f"  velocity of ball {number}: {abs(found):.9f} ({abs(expected):.9f})")
    sol = swing()
    print(repr(sol))
    print(f"the balls of the cradle swing as one from {sol.zeno['t'][0]:.9f} s ({TOGETHER:.9f})")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the positions of the balls, and the forces between them."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (left, right) = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.4))
    zivi.plot.coordinates(sol, left)
    left.set(xlabel="time $t$ (s)", ylabel="positions (m)")
    zivi.plot.reactions(sol, right)
    right.set(xlabel="time $t$ (s)", ylabel="forces between the balls (N)")
    figure.suptitle("Newton's cradle: positions and contact forces")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
