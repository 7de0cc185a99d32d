r"""A blade that hits a stop with its tip: 20 modes, 500 frequencies.

Torsion of a blade that is clamped at its root: ``omega_k = (2 k - 1) omega_1`` with modes of
``sqrt 2`` at the tip and damping ratios of 1 %, a harmonic force and a stop at the tip. In
brackets: without the stop, the sum of the modes' responses; with it, its first root from rest.

Run as ``python examples/mechanics_blade.py [out.png]``.
"""

import sys
from typing import Any

import numpy as np

import zivi

MODES, DAMPING, FORCE, STOP, E = 20, 0.01, 1.0, 0.05, 0.6
FREQUENCIES = 2 * np.pi * (2 * np.arange(MODES) + 1.0)
TIP = np.sqrt(2.0) * (-1.0) ** np.arange(MODES)
PERIODS = 4


def system(omega: float, *, stop: bool = True) -> zivi.LinearSystem:
    """Give the blade from its modal data at the tip."""
    gaps = [zivi.LinearGap([-1.0], STOP, name="stop")] if stop else []
    force = zivi.Harmonic([FORCE], omega=omega)
    return zivi.LinearSystem.modal(
        FREQUENCIES, DAMPING, TIP[None], excitation=force, gaps=gaps, e=E
    )


def run(omega: float, periods: float = PERIODS, **more: Any) -> zivi.MechanicalTrajectory:
    """Start the blade from rest; more is for `zivi.simulate` but the stop."""
    blade = system(omega, stop=bool(more.pop("stop", True)))
    rest = np.zeros(MODES)
    return zivi.simulate(blade, (0, periods * 2 * np.pi / omega), (rest, rest), **more)


def tip(t: np.ndarray, omega: float) -> np.ndarray:
    """Sum the modes of the blade without a stop, from rest."""
    response = TIP * FORCE / (FREQUENCIES**2 - omega**2 + 2j * DAMPING * FREQUENCIES * omega)
    root = FREQUENCIES * (-DAMPING + 1j * np.sqrt(1 - DAMPING**2))
    # eta = Re(H e^(i w t) + c e^(root t)) with eta(0) = eta'(0) = 0
    rate = np.real(1j * omega * response)
    c = -response.real + 1j * (rate - root.real * response.real) / root.imag
    t = np.atleast_1d(t)[:, None]
    return np.real(response * np.exp(1j * omega * t) + c * np.exp(root * t)) @ TIP


def first_root(omega: float) -> float:
    """Find when the tip reaches the stop for the first time."""
    t = np.linspace(0, 20 * np.pi / omega, 200_001)
    k = int(np.argmax(tip(t, omega) > STOP))
    low, high = t[k - 1], t[k]
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if tip(middle, omega)[0] < STOP else (low, middle)
    return float(low)


def sweep(omegas: np.ndarray) -> zivi.MechanicalBatch:
    """Run all frequencies from rest, on all processors."""
    rest = np.zeros(MODES)
    return zivi.simulate_batch(
        system(5.0).at(omega=omegas), (0, PERIODS * 2 * np.pi / omegas.min()), (rest, rest)
    )


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    omega = 0.95 * FREQUENCIES[0]
    hit = run(omega)
    free = run(omega, 4.25, stop=False)
    print(repr(hit))
    print(f"first impact at {hit.impacts['t'][0]:.10f} s ({first_root(omega):.10f})")
    found, expected = abs(TIP @ free.q[-1]), abs(tip(free.t[-1], omega)[0])
    print(f"the tip without a stop {found:.10f} ({expected:.10f})")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the tip beside that without a stop, and the impacts over the frequency."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.6))
    omega = 0.95 * FREQUENCIES[0]
    t = np.linspace(0, 12 * 2 * np.pi / omega, 4001)
    axes[0].plot(t, tip(t, omega), color="0.7", lw=0.8, label="without the stop")
    axes[0].plot(t, run(omega, 12, t_eval=t).q @ TIP, color=zivi.plot.BLUE, label="tip")
    axes[0].axhline(STOP, color="0.3", lw=0.8)
    axes[0].set(xlabel="time (s)", ylabel="displacement of the tip (m)")
    axes[0].legend(loc="upper left", bbox_to_anchor=(1, 1))
    omegas = np.linspace(0.6, 1.6, 500) * FREQUENCIES[0]
    batch = sweep(omegas)
    duration = PERIODS * 2 * np.pi / omegas.min()
    per_period = batch.n_impacts / (duration * omegas / (2 * np.pi))
    axes[1].plot(omegas / FREQUENCIES[0], per_period, ".", ms=1.5, color=zivi.plot.BLUE)
    axes[1].set(xlabel=r"$\omega/\omega_1$", ylabel="impacts per period of the force")
    axes[1].set_yscale("symlog", linthresh=1)
    figure.suptitle("A blade with a stop: tip at resonance, impacts over the frequency")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
