r"""The woodpecker toy: it slides down its pole by impacts and dry friction.

A sleeve with a bird at a spring, at a pole. The sleeve jams above or below, sticks, slips; the bird
pecks. Three contacts with friction: the beak, and the two edges of the sleeve. In brackets: the
state after 0.3 s by a computation with 26 digits, and a published limit cycle, found by iteration.

Run as ``python examples/mechanics_woodpecker.py [out.png]``.
"""

import sys

import numpy as np

import zivi

LENGTHS = {"r0": 0.0025, "rm": 0.0031, "hm": 0.0058, "lm": 0.01, "lg": 0.015}
NUMBERS = {"ms": 0.0045, "mm": 0.0003, "js": 7e-7, "jm": 5e-9, "c": 0.0056, "g": 9.81}
BEAK = {"hs": 0.02, "ls": 0.0201}
START = ([0.0, -0.1034482758620689655, -0.2788], [-0.3411, 0.0, -7.4583])


def woodpecker(mu: float = 0.3) -> zivi.MechanicalSystem:
    """Give the toy: height, angle of the sleeve, angle of the bird."""
    p = NUMBERS | LENGTHS | BEAK
    ms, mm, lm, lg = p["ms"], p["mm"], p["lm"], p["lg"]
    mass = [
        [ms + mm, ms * lm, ms * lg],
        [ms * lm, p["jm"] + ms * lm**2, ms * lm * lg],
        [ms * lg, ms * lm * lg, p["js"] + ms * lg**2],
    ]

    def force(t: float, q: np.ndarray, qdot: np.ndarray) -> list[float]:
        twist = p["c"] * (q[1] - q[2])
        weight = ms * p["g"]
        return [-(ms + mm) * p["g"], -twist - weight * lm, twist - weight * lg]

    edge, rim = p["rm"] - p["r0"], [1.0, p["rm"], 0.0]
    beak = lm + lg - p["ls"] - p["r0"]
    along = [1.0, lm, lg - p["ls"]]
    gaps = [
        zivi.LinearGap([0, 0, -p["hs"]], beak, name="beak", tangent=along, mu=mu),
        zivi.LinearGap([0, p["hm"], 0], edge, name="lower edge", tangent=rim, mu=mu),
        zivi.LinearGap([0, -p["hm"], 0], edge, name="upper edge", tangent=rim, mu=mu),
    ]
    return zivi.MechanicalSystem(
        mass=mass,
        force=force,
        gaps=gaps,
        e=[0.5, 0.0, 0.0],
        coordinates=["height", "sleeve", "bird"],
    )


def run(end: float = 0.3, rtol: float = 1e-10) -> zivi.MechanicalTrajectory:
    """Let the toy start with a jammed sleeve."""
    method = zivi.SwitchedRK(rtol=rtol, atol=rtol)
    return zivi.simulate(woodpecker(), (0, end), START, method)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = run(4.0, 1e-9)
    pecks = sol.resolved_impacts[sol.resolved_impacts["gap"] == 0]
    period = float(pecks["t"][-1] - pecks["t"][-2])
    drop = float(sol(pecks["t"][-2])[0, 0] - sol(pecks["t"][-1])[0, 0])
    print(repr(sol))
    print(f"after 0.3 s at the height {sol(0.3)[0, 0]:.9f} m ({HEIGHT:.9f})")
    print(f"a peck every {period:.5f} s ({PERIOD:.5f})")
    print(f"{drop:.4f} m lower each time ({DROP:.4f})")
    if path is not None:
        draw(path, run())


HEIGHT, PERIOD, DROP = -0.0413274160834, 0.14598, 0.0194


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the first two turns."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(2, 2, layout="constrained", figsize=(9.6, 5.2))
    fine = sol.resample(n=4001)
    axes[0, 0].plot(fine.t, fine.q[:, 0])
    axes[0, 0].set(xlabel="time $t$ (s)", ylabel="height (m)")
    axes[0, 1].plot(fine.t, fine.q[:, 1], label="sleeve")
    axes[0, 1].plot(fine.t, fine.q[:, 2], label="bird")
    axes[0, 1].set(xlabel="time $t$ (s)", ylabel="angles (rad)")
    axes[0, 1].legend()
    zivi.plot.modes(sol, axes[1, 0])
    zivi.plot.configuration(sol, axes[1, 1], over=("bird", "sleeve"))
    axes[1, 1].set(xlabel="bird (rad)", ylabel="sleeve (rad)")
    figure.suptitle("The woodpecker toy over two periods")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
