r"""Bifurcation diagram of an oscillator that hits a wall, over the frequency of its excitation.

    x'' = -x - 2 zeta x' + cos(omega t),    x >= 0

with the wall at the equilibrium. Section: the speed after the last impacts of runs from several
starts, for each frequency. A free flight takes nearly half a natural period whatever its speed, so
there are resonances near omega = 2 k, where it hits once in k periods, and chaos between them.

The orbit that hits once in ``P = 2 pi k/omega`` is known in closed form. Let ``S``, ``S'`` be the
forced motion without a wall at the impact, and ``(c, h)``, ``(c', h')`` position and velocity after
P of the free motion from a unit position and from a unit velocity. It starts with u, so

    S + c (0 - S) + h (u - S') = 0        S' + c' (0 - S) + h' (u - S') = -u/e

give S/u and S'/u, and ``S^2 + (S'/omega)^2 = 1/|1 - omega^2 + 2 i zeta omega|^2`` gives u. A
difference of the state grows in a period by the free motion and then, at the impact, by

    dx -> -e dx        dx' -> -e dx' - (f+ + e f-)/v- dx

with the forces before and after it and the speed v- of the impact: the orbit is stable while both
multipliers of the product are within the unit circle. Its branch in the diagram must end there.

One impact a period is stable from 1.230 to 2.659, in two from 3.338 to 4.645.

Run as ``python examples/gallery_oscillator_bifurcation.py [out.png]``.
"""

import cmath
import functools
import math
import sys

import numpy as np

import zivi

ZETA, E = 0.05, 0.8
ENLARGED = 2.55, 3.45
"""Frequencies that are looked at more closely."""
FREQUENCIES = np.union1d(np.linspace(1.2, 6.0, 481), np.linspace(*ENLARGED, 361))
START = 1.0, 0.0
BESIDE = 1.001
"""Factor from the state on the periodic orbit to the other start."""
T_END, KEPT = 600.0, 60
"""End of the runs (s), impacts of each that are drawn."""
METHOD = zivi.SwitchedRK(rtol=1e-9)
ALONE = 1e-5
"""A run hits with one speed if its last impacts differ by less (m/s)."""


def oscillator(omega: float) -> zivi.ImpactSystem:
    """Oscillator of unit mass and stiffness under a unit excitation."""
    force = zivi.LinearForce(stiffness=1.0, damping=2 * ZETA, amplitude=1.0, omega=omega)
    return zivi.ImpactSystem(force, e=E)


def free_motion(t: float | np.ndarray) -> np.ndarray:
    """Position and velocity after `t` (rows) from a unit position and a unit velocity (columns)."""
    natural = math.sqrt(1 - ZETA**2)
    decay, c, s = np.exp(-ZETA * t), np.cos(natural * t), np.sin(natural * t) / natural
    return decay * np.array([[c + ZETA * s, s], [-s, c - ZETA * s]])


def orbit(omega: float, k: int = 1) -> tuple[float, float]:
    """Time (s) and speed after the impact (m/s) of the orbit that hits once in k periods."""
    flow = free_motion(2 * math.pi * k / omega)
    forced = np.linalg.solve(np.eye(2) - flow, -flow[:, 1] - np.array([0.0, 1 / E]))
    response = 1 / (1 - omega**2 + 2j * ZETA * omega)
    turn = complex(forced[0], -forced[1] / omega)  # is response * exp(i omega t) / u
    speed = abs(response) / abs(turn)
    return cmath.phase(turn / response) % (2 * math.pi) / omega, speed


def multipliers(omega: float, k: int = 1) -> np.ndarray:
    """Growth of small differences from impact to impact of that orbit."""
    t, speed = orbit(omega, k)
    after, before = (math.cos(omega * t) - 2 * ZETA * v for v in (speed, -speed / E))
    jump = np.array([[-E, 0.0], [-(after + E * before) * E / speed, -E]])
    return np.linalg.eigvals(jump @ free_motion(2 * math.pi * k / omega))


def along(omega: float, k: int, tau: float | np.ndarray) -> np.ndarray:
    """Position and velocity of that orbit at times after its impact."""
    t, speed = orbit(omega, k)
    forced = cmath.exp(1j * omega * t) / (1 - omega**2 + 2j * ZETA * omega)
    turn = forced * np.exp(1j * omega * tau)
    first, second = np.moveaxis(free_motion(tau), 1, 0)
    own = -forced.real * first + (speed - (1j * omega * forced).real) * second
    return own + np.array([turn.real, (1j * omega * turn).real])


def exists(omega: float, k: int) -> bool:
    """Whether that orbit stays off the wall between its impacts."""
    times = np.linspace(0, 2 * math.pi * k / omega, 400)
    return bool(along(omega, k, times)[0, 1:-1].min() > 0)


def is_stable(omega: float, k: int) -> bool:
    """Whether it exists and attracts."""
    return exists(omega, k) and bool(np.abs(multipliers(omega, k)).max() < 1)


def window(k: int) -> tuple[float, float]:
    """Frequencies between which the orbit that hits once in k periods is stable, around 2 k."""

    def end(inside: float, outside: float) -> float:
        for _ in range(30):
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if is_stable(middle, k) else (inside, middle)
        return inside

    return end(2.0 * k, 2.0 * k - 0.95), end(2.0 * k, 2.0 * k + 1.0)


def nearest(omega: float) -> int:
    """Periods of the orbit that resonates nearest to this frequency."""
    return max(1, round(omega / 2))


@functools.cache
def diagram() -> np.ndarray:
    """Speeds after the last impacts (m/s): frequency, start, impact."""
    runs = []
    for omega in FREQUENCIES:
        k = nearest(omega)
        x, xdot = along(omega, k, -orbit(omega, k)[0] % (2 * math.pi * k / omega))
        runs += [(oscillator(omega), START), (oscillator(omega), (BESIDE * max(x, 0), xdot))]
    systems, starts = zip(*runs, strict=True)
    batch = zivi.simulate_batch(systems, (0, T_END), starts, method=METHOD, save="events")
    speeds = [run["impacts"]["xdot_after"][-KEPT:] for run in batch.events]
    return np.reshape(speeds, (len(FREQUENCIES), -1, KEPT))


def branch(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies around 2 k at which the start beside the orbit hits with one speed, and that."""
    speeds = diagram()[:, 1]
    around = np.array([nearest(omega) == k for omega in FREQUENCIES])
    chosen = around & (np.ptp(speeds, axis=1) < ALONE)
    return FREQUENCIES[chosen], speeds[chosen, -1]


def main(path: str | None = None) -> None:
    """Compare the branches with the closed form, and draw if a path is given."""
    for k in (1, 2):
        omegas, speeds = branch(k)
        expected = np.array([orbit(omega, k)[1] for omega in omegas])
        low, high = window(k)
        print(
            f"one impact in {k} period(s): from {omegas[0]:.4f} to {omegas[-1]:.4f}, stable from "
            f"{low:.4f} to {high:.4f}; the speeds of {len(omegas)} frequencies are within "
            f"{np.abs(speeds - expected).max():.1e} m/s of the closed form"
        )
    omegas, speeds = branch(1)
    at = int(np.argmin(np.abs(omegas - 2.2)))
    print(f"omega = 2.2: {speeds[at]:.9f} m/s ({orbit(2.2)[1]:.9f})")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the diagram, and the closed form over it."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (whole, part) = plt.subplots(2, 1, layout="constrained", figsize=(9.6, 7.2))
    over = np.repeat(FREQUENCIES, 2 * KEPT)
    curves = []
    for k in (1, 2, 3):
        low, high = window(k)
        for start, end, style in (2 * k - 0.9, low, ":"), (low, high, "-"), (high, 2 * k + 1, ":"):
            omegas = [omega for omega in np.linspace(start, end, 200) if exists(omega, k)]
            curves.append((omegas, [orbit(omega, k)[1] for omega in omegas], style))
    for ax in (whole, part):
        dots = {"ms": 1.5, "mew": 0, "color": zivi.plot.BLUE, "rasterized": True}
        ax.plot(over, diagram().ravel(), ".", **dots)
        for omegas, speeds, style in curves:
            ax.plot(omegas, speeds, style, color=zivi.plot.ORANGE, lw=2.2, alpha=0.7, zorder=1)
    for style, kind in ("-", "stable"), (":", "unstable"):
        whole.plot([], [], style, color=zivi.plot.ORANGE, label=f"closed form, {kind}")
    whole.plot([], [], ".", color=zivi.plot.BLUE, label="simulated")
    figure.legend(loc="outside upper center", ncols=3)
    for ax in (whole, part):
        ax.set_ylabel("speed after an impact (m/s)")
    whole.set(xlim=(1.2, 6.0), ylim=(0, 3.3))
    part.set(xlim=ENLARGED, ylim=(0, 0.72))
    part.set_xlabel(r"frequency $\omega$ of the excitation (rad/s)")
    whole.set_title("An impact oscillator: one impact in 1, 2, 3 periods")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
