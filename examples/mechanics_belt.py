r"""A mass at a spring on a belt: it sticks, slips, sticks, until the belt is too fast.

``x'' = -x - c x' - L Sign(x' - v)``, static friction 1.2, in slip L = 0.8. The mass sticks to the
belt, exactly, until the spring pulls with 1.2; then it slips back, and the belt catches it again.
The first slip without damping, in brackets, follows from ``x - 0.8 = 0.4 cos s + 0.2 sin s``: it
ends after ``2 pi - 2 atan 2``. With damping the mass does not reach the speed of a fast belt any
more: where, in brackets, follows from the damped oscillation by hand.

Run as ``python examples/mechanics_belt.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

SLIP, STATIC, DAMPING = 0.8, 1.2, 0.1


def system(speed: float, damping: float) -> zivi.MechanicalSystem:
    """Give the mass on a belt of some speed."""
    belt = zivi.DryFriction(limit=SLIP, static=STATIC, velocity=speed, name="belt")
    return zivi.MechanicalSystem(
        mass=1.0,
        force=lambda t, q, qdot: -q - damping * qdot,
        friction=[belt],
        coordinates=["x"],
    )


def run(speed: float, damping: float = 0.0, end: float = 30.0) -> zivi.MechanicalTrajectory:
    """Let the mass start at rest on the belt."""
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-10)
    return zivi.simulate(system(speed, damping), (0, end), ([0.0], [speed]), method)


def sticks_again(speed: float) -> bool:
    """Whether the belt catches the mass after its first slip."""
    return len(run(speed, DAMPING, STATIC / speed + 12).stick) > 1


def fastest() -> float:
    """Bisect for the speed at which the mass slips for good."""
    low, high = 0.05, 2.0
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (middle, high) if sticks_again(middle) else (low, middle)
    return (low + high) / 2


def by_hand() -> float:
    """Find the same from the largest speed of the damped oscillation."""
    omega, decay = math.sqrt(1 - DAMPING**2 / 4), DAMPING / 2

    def excess(v: float) -> float:
        a = STATIC - DAMPING * v - SLIP
        b = (v + decay * a) / omega
        s = np.linspace(math.pi / omega, 2 * math.pi / omega, 200_001)
        x = np.exp(-decay * s) * (a * np.cos(omega * s) + b * np.sin(omega * s))
        y = np.exp(-decay * s) * (b * np.cos(omega * s) - a * np.sin(omega * s))
        return float(np.max(omega * y - decay * x)) - v

    low, high = 0.05, 2.0
    while high - low > 1e-9:
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return low


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = run(0.2)
    slips, ends = sol.transitions["t"][1:3]
    length = 2 * math.pi - 2 * math.atan(2.0)
    print(repr(sol))
    print(f"slips at {slips:.9f} s ({STATIC / 0.2:.9f})")
    print(f"for {ends - slips:.7f} s ({length:.7f})")
    print(f"with damping up to the belt speed {fastest():.5f} ({by_hand():.5f})")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw stick and slip in time and in the phase plane, and what becomes of it over the speed."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(2, 2, layout="constrained", figsize=(9.6, 5.2))
    zivi.plot.coordinates(sol, axes[0, 0], units="m").set_title("belt speed 0.2 m/s, no damping")
    zivi.plot.modes(sol, axes[1, 0]).set_title("stick and slip: $w$ is the speed on the belt")
    zivi.plot.configuration(sol, axes[0, 1], units="m").set_title("the same in the phase plane")
    for speed in np.linspace(0.05, 0.8, 16):
        late = run(float(speed), DAMPING, 100.0).resample(np.linspace(70, 100, 301)).q
        ends = [late.min(), late.max()]
        axes[1, 1].plot([speed, speed], ends, ".", color=zivi.plot.BLUE, ms=3)
    axes[1, 1].axvline(by_hand(), color="0.6", lw=0.8)
    axes[1, 1].set(
        xlabel="belt speed $v$ (m/s)",
        ylabel="extremes of $x$ (m)",
        title="damped: stick-slip up to 0.44 m/s",
    )
    figure.suptitle("A mass on a belt")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
