r"""The stick-slip cycle of a mass on a belt, over the speed of the belt, and where it ends.

``x'' = -x - c x' - L Sign(x' - v)``, static limit 1.2, limit in slip ``L = 0.8``. The mass sticks
until the spring has the static limit, slips back, and sticks again when its speed is that of the
belt. Without damping, with ``a = 0.4``, the difference of the limits, the cycle has the period

    2 a/v + 2 pi - 2 atan(a/v)

at every speed. With damping the slip has lost too much on a fast belt: the cycle ends where the
speed of the mass only just reaches that of the belt. One branch follows the cycle to that event,
``slip_grazing``, whose speed is found again from the formula of the slip. In brackets: the period
and the speed of these formulas.

Run as ``python examples/mechanics_stick_slip.py [out.png]``.
"""

import math
import sys

import numpy as np
from scipy.optimize import fsolve

import zivi

SLIP, STATIC, SPEED = 0.8, 1.2, 0.2
DAMPINGS = (0.02, 0.05, 0.1)


def mass(damping: float, speed: float = SPEED) -> zivi.LinearSystem:
    """Give the mass on its belt."""
    belt = zivi.DryFriction(limit=SLIP, static=STATIC, velocity=speed, name="belt")
    return zivi.LinearSystem(1.0, damping, 1.0, friction=[belt], coordinates=["x"])


def cycle(damping: float) -> zivi.MechanicalOrbit:
    """Let the mass go on the belt, and find what it settles on."""
    system = mass(damping)
    run = zivi.simulate(system, (0, 80), ([0.0], [SPEED]))
    return zivi.periodic_orbit(system, run, period="free")


def branch(damping: float) -> zivi.MechanicalBranch:
    """Follow the cycle over the speed of the belt."""
    return zivi.continue_orbit(cycle(damping), "belt.velocity", (0.05, 2.0), step=0.05)


def fastest(damping: float, guess: tuple[float, float]) -> float:
    """Give the speed at which the slip only just reaches the belt, by the formula of the slip."""
    omega = math.sqrt(1.0 - damping**2 / 4)

    def touches(unknown: np.ndarray) -> list[float]:
        v, t = unknown
        start = complex(STATIC - SLIP - damping * v, 0.0)
        start += 1j * (v + damping * start.real / 2) / omega
        # x - L = Re(start* e^(mu t)), with the derivatives
        mu = complex(-damping / 2, omega)
        own = start.conjugate() * np.exp(mu * t)
        return [(mu * own).real - v, (mu**2 * own).real]

    return float(fsolve(touches, guess, xtol=1e-13)[0])


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    orbit, a = cycle(0.0), STATIC - SLIP
    exact = 2 * a / SPEED + 2 * math.pi - 2 * math.atan(a / SPEED)
    print(repr(orbit))
    print(f"without damping its period is {orbit.period:.9f} s ({exact:.9f})")
    branches = [branch(damping) for damping in DAMPINGS]
    for damping, it in zip(DAMPINGS, branches, strict=True):
        (end,) = it.of_kind("slip_grazing")
        slips = end.orbit.segments[~end.orbit.segments["contacts"][:, 0]]
        formula = fastest(damping, (end.value, float((slips["t1"] - slips["t0"])[0])))
        print(f"c = {damping}: it ends at {end.value:.9f} m/s ({formula:.9f})")
    if path is not None:
        draw(path, branches)


def draw(path: str, branches: list[zivi.MechanicalBranch]) -> None:
    """Draw cycles of one branch, and the periods of all over the speed."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 4.0))
    middle = branches[1]
    for value in (0.1, 0.2, 0.4, middle.events[-1].value):
        orbit = middle.orbits[int(np.argmin(np.abs(middle.values - value)))]
        run = orbit.trajectory
        states = run.resample(np.linspace(run.t[0], run.t[-1], 800))
        axes[0].plot(states.q[:, 0], states.qdot[:, 0], lw=1.0, label=f"v = {value:.3f} m/s")
    axes[0].set(xlabel="$x$ (m)", ylabel="$x'$ (m/s)", title=f"cycles with c = {DAMPINGS[1]}")
    axes[0].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    for damping, it in zip(DAMPINGS, branches, strict=True):
        periods = [orbit.period for orbit in it.orbits]
        (line,) = axes[1].plot(it.values, periods, lw=1.2, label=f"c = {damping}")
        axes[1].plot(it.values[-1], periods[-1], "o", ms=4, color=line.get_color())
    axes[1].set(
        xlabel="belt speed (m/s)",
        ylabel="period (s)",
        title="period of the cycle",
    )
    axes[1].legend(fontsize=8)
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
