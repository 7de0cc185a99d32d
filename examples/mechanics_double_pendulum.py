r"""A double pendulum whose tip hits a wall, and stays at it between two accumulations of impacts.

In the absolute angles a, b of its two arms, with ``c = m2 l1 l2 cos(a - b)``,

    T = (m1 + m2) l1^2 a'^2/2 + m2 l2^2 b'^2/2 + c a' b'
    V = -(m1 + m2) g l1 cos a - m2 g l2 cos b

and the wall is ``l1 sin a + l2 sin b + d >= 0``. The energies are all that is written here: SymPy
derives the equations and they are compiled. In brackets: a computation with 26 digits, in which
the accumulations were followed impact by impact.

Run as ``python examples/mechanics_double_pendulum.py [out.png]``. ``film("out.gif")`` writes a
film.
"""

import sys

import numpy as np

import zivi

ZENO = (3.37257287288386, 4.44643536588633)
LIFT_OFF = (3.79761474268971, 5.01798584567830)
L1, L2, D = 1.0, 0.7, -0.2


def pendulum(e: float = 0.4) -> zivi.MechanicalSystem:
    """Derive and compile the pendulum."""
    return zivi.symbolic.system(
        "a b",
        T="(m1 + m2)*l1**2*adot**2/2 + m2*l2**2*bdot**2/2 + m2*l1*l2*adot*bdot*cos(a - b)",
        V="-(m1 + m2)*g*l1*cos(a) - m2*g*l2*cos(b)",
        Q=["-cd*adot", "-cd*bdot"],
        gaps={"wall": "l1*sin(a) + l2*sin(b) + d"},
        parameters={"m1": 1.0, "m2": 0.8, "l1": L1, "l2": L2, "g": 9.81, "cd": 0.02, "d": D},
        e=e,
    )


def swing(rtol: float = 1e-10) -> zivi.MechanicalTrajectory:
    """Release the pendulum at rest."""
    method = zivi.SwitchedRK(rtol=rtol, atol=rtol)
    return zivi.simulate(pendulum(), (0, 5.2), ([0.5, 0.9], [0.0, 0.0]), method)


def arms(t: float, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Give the points of the two arms."""
    a, b = q
    x = np.cumsum([0, L1 * np.sin(a), L2 * np.sin(b)])
    y = np.cumsum([0, -L1 * np.cos(a), -L2 * np.cos(b)])
    return [(x, y)]


def film(path: str) -> None:
    """Write the motion as a film."""
    wall = ([-D, -D], [-1.9, 0.3])
    frames = zivi.plot.animate(swing(), bodies=arms, walls=lambda t, q: [wall], fps=12)
    frames.save(path, writer="pillow", dpi=60)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = swing()
    print(repr(sol))
    for found, expected in zip(sol.zeno["t"], ZENO, strict=False):
        print(f"the tip comes to rest at the wall: {found:.9f} s ({expected:.9f})")
    for found, expected in zip(sol.liftoffs["t"], LIFT_OFF, strict=False):
        print(f"and leaves it: {found:.9f} s ({expected:.9f})")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the motion as a series of pictures, the gap and the force of the wall."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (left, middle, right) = plt.subplots(
        1, 3, layout="constrained", figsize=(10.5, 3.4), width_ratios=(1, 1.6, 1.6)
    )
    times = np.linspace(0, sol.t[-1], 801)
    ends = np.array([arms(t, sol(t)[0])[0] for t in times])
    for x, y in ends[::100]:
        left.plot(x, y, color="0.8", lw=0.8)
    left.plot(ends[:, 0, -1], ends[:, 1, -1], color=zivi.plot.BLUE, lw=1.0)
    left.plot([-D, -D], [-1.75, -1.3], color="0.3", lw=3)
    left.set(aspect="equal", xlabel="$x$ (m)", ylabel="$y$ (m)")
    left.set_title("the tip (blue) and its wall")
    zivi.plot.gaps(sol, middle)
    middle.set(ylabel="distance of the tip (m)", xlabel="time $t$ (s)")
    zivi.plot.reactions(sol, right)
    right.set(ylabel="force of the wall (N)", xlabel="time $t$ (s)")
    figure.suptitle("A double pendulum against a wall")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
