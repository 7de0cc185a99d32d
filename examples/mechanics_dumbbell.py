r"""A bar falls on the floor: flat, and nearly flat.

Both ends of a bar hit the floor, ``y +- l sin(theta) >= 0``. Dropped flat from the height H it
bounces like a ball, with the well-known time of rest

    t = (1 + e)/(1 - e) sqrt(2 H/g)

Tilted by any small angle one end hits first, the bar turns and the other end is hit harder: it
comes to rest much earlier, and no smaller tilt brings back the first answer. A rigid bar does not
depend continuously on its tilt; a real one decides by how stiff its ends are. zivi computes both
and flags what the answer hangs on. In brackets: the formula, and the limit of small tilts from
another program.

Run as ``python examples/mechanics_dumbbell.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

HALF, HEIGHT, G, E = 0.5, 0.5, 9.81, 0.5
TILTED = 0.685957


def bar(e: float = E) -> zivi.MechanicalSystem:
    """Derive and compile a bar of length 1 m and mass 1 kg."""
    return zivi.symbolic.system(
        "y theta",
        T="m*ydot**2/2 + J*thetadot**2/2",
        V="m*g*y",
        gaps={"right": "y + l*sin(theta)", "left": "y - l*sin(theta)"},
        parameters={"m": 1.0, "J": 1 / 12, "g": G, "l": HALF},
        e=e,
    )


def drop(tilt: float, height: float = HEIGHT, end: float = 1.2) -> zivi.MechanicalTrajectory:
    """Let the bar fall with a tilt (rad)."""
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-10)
    return zivi.simulate(bar(), (0, end), ([height, tilt], [0.0, 0.0]), method)


def rests(sol: zivi.MechanicalTrajectory) -> float:
    """Give the time from which both ends stay on the floor."""
    return float(max(np.concatenate([sol.zeno["t"], sol.corners["t"]])))


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    flat = drop(0.0)
    formula = (1 + E) / (1 - E) * math.sqrt(2 * HEIGHT / G)
    print(f"flat: at rest from {rests(flat):.9f} s ({formula:.9f}), flags: {told(flat)}")
    for tilt, expected in ((1e-10, f" ({TILTED:.6f})"), (1e-3, ""), (0.1, "")):
        sol = drop(tilt)
        print(f"tilted by {tilt:g}: at rest from {rests(sol):.6f} s{expected}, flags: {told(sol)}")
    if path is not None:
        draw(path, flat)


def told(sol: zivi.MechanicalTrajectory) -> str:
    """Say which flags a run has."""
    return ", ".join(sorted(set(sol.flags["kind"]))) or "none"


def draw(path: str, flat: zivi.MechanicalTrajectory) -> None:
    """Draw the height of the bar for three tilts."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (left, right) = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.4))
    for tilt in (0.0, 1e-6, 0.1):
        sol = flat if tilt == 0.0 else drop(tilt)
        t = np.linspace(0, sol.t[-1], 2000)
        left.plot(t, sol(t)[0, :, 0], label=f"tilt {tilt:g}")
    left.set(xlabel="time $t$ (s)", ylabel="height of the centre (m)", title="tilts in rad")
    left.legend(loc="upper left", bbox_to_anchor=(1, 1))
    zivi.plot.gaps(drop(0.1), right)
    right.set(xlabel="time $t$ (s)", ylabel="heights of the ends (m)", title="tilt 0.1 rad")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
