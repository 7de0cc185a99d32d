r"""A block that is tilted and let go: it rocks, or its foot slides away.

With enough friction it turns about its foot. In brackets: the speed of that from the energy, what
the impact of the other foot leaves of it, ``1 - 3/2 sin^2 alpha`` after Housner (both feet without
restitution, no slip), and the coefficient of friction that holds the foot in the beginning.

Run as ``python examples/mechanics_rocking.py [out.png]``.
"""

import math
import sys

import zivi

G, B, H, TILT = 9.81, 0.3, 0.9, 0.15
R, ALPHA = math.hypot(B, H), math.atan2(B, H)

BLOCK = zivi.symbolic.system(
    "x y th",
    T="(xdot**2 + ydot**2)/2 + (b**2 + h**2)*thdot**2/6",
    V="g*y",
    gaps={"left": "y - b*sin(th) - h*cos(th)", "right": "y + b*sin(th) - h*cos(th)"},
    slips={
        "left": "xdot + (h*cos(th) + b*sin(th))*thdot",
        "right": "xdot + (h*cos(th) - b*sin(th))*thdot",
    },
    mu={"left": "mu", "right": "mu"},
    parameters={"b": B, "h": H, "g": G, "mu": 0.5},
)


def run(mu: float, end: float = 6.0) -> zivi.MechanicalTrajectory:
    """Let the block go on its left foot."""
    y = B * math.sin(TILT) + H * math.cos(TILT)
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-10)
    return zivi.simulate(BLOCK.replace(mu=mu), (0, end), ([0, y, TILT], [0, 0, 0]), method)


def least_friction() -> float:
    """Bisect for the coefficient with which the foot sticks at first."""
    low, high = 0.0, 1.0
    while high - low > 1e-9:
        middle = (low + high) / 2
        sticks = run(middle, 1e-3).modes[0, 0] == 0
        low, high = (low, middle) if sticks else (middle, high)
    return high


def by_hand() -> float:
    """Give the same: friction over pressure of the foot, for the turn about it."""
    x, y = R * math.sin(ALPHA - TILT), R * math.cos(ALPHA - TILT)
    turn = -G * x / (4 / 3 * R**2)
    return abs(y * turn) / (G + x * turn)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = run(0.5)
    first = sol.resolved_impacts["t"][0]
    before, after = (sol(first + dt)[1, -1] for dt in (-1e-9, 1e-9))
    speed = math.sqrt(1.5 * G / R * (math.cos(ALPHA - TILT) - math.cos(ALPHA)))
    print(repr(sol))
    print(f"turns with {-before:.6f} rad/s ({speed:.6f})")
    print(f"keeps {after / before:.6f} of it ({1 - 1.5 * math.sin(ALPHA) ** 2:.6f})")
    print(f"does not slide away from mu = {least_friction():.7f} ({by_hand():.7f})")
    if path is not None:
        draw(path, sol, run(0.15))


def draw(path: str, rocks: zivi.MechanicalTrajectory, slides: zivi.MechanicalTrajectory) -> None:
    """Draw angles and positions with much and with little friction, and what the feet do."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(2, 2, layout="constrained", figsize=(9.6, 5.2))
    for sol, name in ((rocks, r"$\mu = 0.5$"), (slides, r"$\mu = 0.15$")):
        fine = sol.resample(n=2001)
        axes[0, 0].plot(fine.t, fine.q[:, 2], label=name)
        axes[0, 1].plot(fine.t, fine.q[:, 0], label=name)
    axes[0, 0].set(xlabel="time $t$ (s)", ylabel="angle (rad)")
    axes[0, 1].set(xlabel="time $t$ (s)", ylabel="$x$ (m)")
    axes[0, 1].legend()
    zivi.plot.modes(rocks, axes[1, 0])
    zivi.plot.modes(slides, axes[1, 1])
    figure.suptitle("A block that rocks (blue) or slides away (orange)")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
