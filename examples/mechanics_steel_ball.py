r"""A steel ball on a steel plate, whose restitution falls with the speed of the impact.

Impacts at more than the speed of yield dent the plate. For a ball of radius R and mass m and a
plate of yield stress Y, with the contact modulus E* = E/(2 (1 - nu^2)), Johnson gives

    e(v) = 3.8 (Y/E*)^(1/2) (m v^2/(2 Y R^3))^(-1/8),

which falls as v^(-1/4). The ball of a mild steel (Y = 300 MPa, E = 210 GPa) is dropped from 2 m
with this coefficient as a table of 16 speeds, linear between them. In brackets: the sums of the
scalar recursion ``v -> e(v) v``, which below the first speed of the table are a geometric series.
The same law as a power has speeds in closed form, ``c^4 (v/c^4)^(3/4)^n`` with c = e(1 m/s).

K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985.

Run as ``python examples/mechanics_steel_ball.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

G, HEIGHT = 9.81, 2.0
YIELD, MODULUS, DENSITY = 3e8, 210e9 / (2 * (1 - 0.3**2)), 7800.0
SPEEDS = np.geomspace(0.25, 10.0, 16)
METHOD = zivi.SwitchedRK(rtol=1e-11, atol=1e-12)


def restitution(v: float | np.ndarray) -> float | np.ndarray:
    """Return Johnson's coefficient; the radius cancels for a full ball."""
    energy = 2 * math.pi / 3 * DENSITY * v**2 / YIELD
    return 3.8 * math.sqrt(YIELD / MODULUS) * energy**-0.125


TABLE = zivi.RestitutionTable(SPEEDS, restitution(SPEEDS))


def drop(e: float | zivi.ImpactLaw, until: float) -> zivi.MechanicalTrajectory:
    """Drop the ball."""
    plate = zivi.LinearGap([1.0], name="plate")
    ball = zivi.MechanicalSystem(mass=1.0, force=[-G], gaps=[plate], e=e, coordinates=["height"])
    return zivi.simulate(ball, (0, until), ([HEIGHT], [0.0]), METHOD)


def rest_time() -> float:
    """Sum the times of flight of the recursion."""
    v = math.sqrt(2 * G * HEIGHT)
    t = v / G
    while v >= SPEEDS[0]:
        v *= float(np.interp(v, SPEEDS, TABLE.e))
        t += 2 * v / G
    slow = float(TABLE.e[0])
    return t + 2 * v / G * slow / (1 - slow)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = drop(TABLE, 6.0)
    print(repr(sol))
    print(f"at rest {sol.zeno['t'][0]:.8f} s ({rest_time():.8f})")
    first = math.sqrt(2 * G * HEIGHT)
    power = zivi.SpeedDependentImpact(e0=float(restitution(1.0)), v0=1.0, k=0.25)
    speeds = drop(power, 2.0).impacts["speed_after"][:4]
    limit = float(restitution(1.0)) ** 4
    closed = [limit * (first / limit) ** (0.75**n) for n in range(1, 5)]
    for n, (found, expected) in enumerate(zip(speeds, closed, strict=True), 1):
        print(f"speed after impact {n}: {found:.8f} m/s ({expected:.8f})")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the coefficient with the impacts of the run, and the height beside a constant one."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.0, 3.2), width_ratios=(1, 2))
    v = np.geomspace(0.2, 10.0, 200)
    axes[0].loglog(v, restitution(v), "k:", label="Johnson")
    axes[0].loglog(TABLE.v, TABLE.e, "C0.-", lw=0.8, label="table")
    speed = np.abs(sol.impacts["speed_before"])
    hits = sol.impacts[speed >= SPEEDS[0]]
    ratio = np.abs(hits["speed_after"] / hits["speed_before"])
    axes[0].loglog(np.abs(hits["speed_before"]), ratio, "C1o", mfc="none", label="run")
    ticks = (0.4, 0.6, 0.8, 1.0)
    axes[0].set_yticks(ticks, [str(it) for it in ticks])
    axes[0].minorticks_off()
    axes[0].set(xlabel="speed $v$ (m/s)", ylabel="restitution $e$", ylim=(0.33, 1.05))
    axes[0].legend(fontsize=8)
    t = np.linspace(0, 2.2, 2001)
    constant = float(TABLE.after([math.sqrt(2 * G * HEIGHT)])[0]) / math.sqrt(2 * G * HEIGHT)
    for e, label, style in ((TABLE, "table", "C0"), (constant, f"$e = {constant:.3f}$", "C1--")):
        axes[1].plot(t, drop(e, 4.0).resample(t).q[:, 0], style, lw=1.0, label=label)
    axes[1].set(xlabel="time $t$ (s)", ylabel="height (m)", ylim=(0, HEIGHT))
    axes[1].legend(fontsize=8)
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
