r"""A block falls on its two corners, without friction: a tall one and a wide one.

The corners are at ``(-b, -h)`` and ``(b, -h)`` from the centre of the block, at the height y and
turned by theta: two gaps, ``y - h cos theta +- b sin theta >= 0``. Their kinetic cosine is the
number that matters,

    c = (1/m - b^2/J)/(1/m + b^2/J)

A tall block has ``c > 0``: an impact on one corner lifts the other, so both bounce infinitely
often, in nested accumulations that end in a finite time. A wide one has ``c < 0``: a corner that
rests stays down when the other falls. In brackets: a computation with 26 digits, and c by hand.

This is not Housner's block: there friction keeps the corner from sliding, and the block turns
about it. See ``examples/rocking_block.py`` for that one, as a mass above a wall.

Run as ``python examples/mechanics_block.py [out.png]``; ``film("out.gif")`` writes a film.
"""

import sys

import numpy as np

import zivi

REST = 0.30001242600944
B, H, J = 0.5, 1.0, 5 / 12


def block(b: float = B, h: float = H, e: float = 0.3) -> zivi.MechanicalSystem:
    """Derive and compile the block; its width and height remain parameters."""
    return zivi.symbolic.system(
        "y theta",
        T="m*ydot**2/2 + J*thetadot**2/2",
        V="m*g*y",
        gaps={
            "left": "y - h*cos(theta) + b*sin(theta)",
            "right": "y - h*cos(theta) - b*sin(theta)",
        },
        parameters={"m": 1.0, "J": J, "g": 9.81, "h": h, "b": b},
        e=e,
    )


def drop(
    system: zivi.MechanicalSystem, y: float = 1.05, end: float = 1.0
) -> zivi.MechanicalTrajectory:
    """Let a block fall, tilted by 0.1 rad."""
    method = zivi.SwitchedRK(rtol=1e-11, atol=1e-11)
    return zivi.simulate(system, (0, end), ([y, 0.1], [0.0, 0.0]), method)


def cosine(system: zivi.MechanicalSystem, q: tuple[float, float]) -> float:
    """Give the kinetic cosine of the two corners."""
    here = system.at(0.0, q, [0.0, 0.0])
    d = here.gradients @ np.linalg.solve(here.mass, here.gradients.T)
    return float(d[0, 1] / np.sqrt(d[0, 0] * d[1, 1]))


def film(path: str) -> None:
    """Write the fall of the wide block as a film, five times slower."""
    b, h = 1.0, 0.5
    sol = drop(block(b, h), y=1.0, end=0.9)

    def outline(t: float, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        (y, theta), x = q, b * np.array([-1, 1, 1, -1, -1])
        z = h * np.array([-1, -1, 1, 1, -1])
        c, s = np.cos(theta), np.sin(theta)
        return [(c * x - s * z, y + s * x + c * z)]

    floor = ([-1.6, 1.6], [0, 0])
    frames = zivi.plot.animate(sol, bodies=outline, walls=lambda t, q: [floor], speed=0.2, fps=12)
    frames.save(path, writer="pillow", dpi=60)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    tall = block()
    sol = drop(tall)
    print(repr(sol))
    by_hand = (1 - B**2 / J) / (1 + B**2 / J)
    print(f"kinetic cosine of the tall block: {cosine(tall, (H, 0.0)):.9f} ({by_hand:.9f})")
    print(f"the tall block rests on both corners from {sol.corners['t'][0]:.9f} s ({REST:.9f})")
    wide = block(b=1.0, h=0.5)
    by_hand = (1 - 1 / J) / (1 + 1 / J)
    print(f"kinetic cosine of the wide block: {abs(cosine(wide, (0.5, 0.0))):.9f} ({-by_hand:.9f})")
    other = drop(wide, y=0.65, end=1.5)
    print(repr(other))
    if path is not None:
        draw(path, sol, other)


def draw(path: str, tall: zivi.MechanicalTrajectory, wide: zivi.MechanicalTrajectory) -> None:
    """Draw the heights of the corners of both blocks."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.4))
    for ax, sol, name in zip(axes, (tall, wide), ("tall", "wide"), strict=True):
        zivi.plot.gaps(sol, ax)
        ax.set(xlabel="time $t$ (s)", ylabel="height of the corners (m)", title=f"a {name} block")
    axes[0].set(xlim=(0, 0.4))
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
