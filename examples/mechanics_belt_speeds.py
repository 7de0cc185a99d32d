r"""What becomes of a shaken mass on a belt, over the speed of the belt.

``x'' = -x - c x' + A cos(omega t) - L Sign(x' - v)``, static friction 1.2, in slip
``L = 0.8``. On a slow belt the mass sticks and slips, periodic or not: its states once a period of
the force are a few points, or many. On a fast one it slides for good, friction is a constant force,
and the motion harmonic. In brackets: where that begins, the largest speed of the harmonic motion,
``A omega/sqrt((1 - omega^2)^2 + c^2 omega^2)``, and how far it goes. From rest the mass may go on
to stick and slip above that speed.

Run as ``python examples/mechanics_belt_speeds.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

DAMPING, SHAKE, OMEGA, SLIP, STATIC = 0.05, 0.5, 1.7, 0.8, 1.2
PERIOD = 2 * math.pi / OMEGA
RESPONSE = SHAKE / complex(1 - OMEGA**2, DAMPING * OMEGA)


MASS = zivi.symbolic.system(
    "x",
    T="xdot**2/2",
    V="x**2/2",
    Q=["A*cos(omega*t) - c*xdot"],
    friction={"belt": ("xdot - v", "slip", "static")},
    parameters={
        "A": SHAKE,
        "omega": OMEGA,
        "c": DAMPING,
        "slip": SLIP,
        "static": STATIC,
        "v": 1.0,
    },
)


def run(
    speed: float, end: float, start: tuple[float, float] = (0.0, 0.0)
) -> zivi.MechanicalTrajectory:
    """Let the mass go, by default at rest."""
    method = zivi.SwitchedRK(rtol=1e-8, atol=1e-8)
    return zivi.simulate(MASS.replace(v=speed), (0, end), ([start[0]], [start[1]]), method)


def slides(speed: float) -> bool:
    """Whether the harmonic motion never has the speed of the belt."""
    start = SLIP + RESPONSE.real, (1j * OMEGA * RESPONSE).real
    return len(run(speed, PERIOD, start).transitions) == 1


def slowest() -> float:
    """Bisect for the speed of the belt from which on the mass slides for good."""
    low, high = 0.1, 2.0
    while high - low > 1e-9:
        middle = (low + high) / 2
        low, high = (low, middle) if slides(middle) else (middle, high)
    return high


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    late = run(0.6, 160 * PERIOD)
    largest = late.resample(np.linspace(159 * PERIOD, 160 * PERIOD, 2001)).q.max()
    print(repr(late))
    print(f"slides for good from {slowest():.6f} m/s ({OMEGA * abs(RESPONSE):.6f})")
    print(f"and goes up to {largest:.5f} m ({SLIP + abs(RESPONSE):.5f})")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw states once a period, late in the motion, over the speed; and two of the motions."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplot_mosaic("aab\naac", layout="constrained", figsize=(9.6, 4.4))
    for speed in np.linspace(0.02, 0.6, 30):
        late = run(float(speed), 100 * PERIOD)(PERIOD * np.arange(60, 101))[0, :, 0]
        axes["a"].plot(np.full(41, speed), late, ".", color=zivi.plot.BLUE, ms=1.5)
    axes["a"].axvline(OMEGA * abs(RESPONSE), color="0.6", lw=0.8)
    axes["a"].set(xlabel="belt speed $v$ (m/s)", ylabel="$x$ once a period (m)")
    for name, speed in (("b", 0.2), ("c", 0.3)):
        part = run(speed, 100 * PERIOD).resample(np.linspace(80, 100, 3001) * PERIOD)
        axes[name].plot(part.q[:, 0], part.qdot[:, 0], lw=0.6)
        axes[name].set(xlabel="$x$ (m)", ylabel=r"$\dot x$ (m/s)", title=f"$v$ = {speed} m/s")
    figure.suptitle("A shaken mass on a belt: periodic, or not")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
