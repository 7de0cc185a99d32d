r"""A pair of gears from its matrices: when it begins to rattle, and how.

Two wheels with backlash, a torque ``T0 + T1 cos(omega t)`` on the first one and drag on both. While
the teeth are in contact the force between them is

    lambda = c2 W + T1 |c2 + i omega J2| / |c1 + c2 + i omega (J1 + J2)| cos(omega t + phase)

with the mean speed ``W = T0/(c1 + c2)``: they part once T1 exceeds ``T1*`` for which it vanishes.
In brackets: that amplitude; when they part and hit again, from the wheels' own exponentials; and
the mean torque that the second wheel takes.

Run as ``python examples/mechanics_gear.py [out.png]``.
"""

import sys
from typing import Any

import numpy as np
from scipy.optimize import brentq

import zivi

J, C = np.array([0.02, 0.05]), np.array([0.05, 0.15])
T0, OMEGA, BACKLASH, E = 4.0, 2 * np.pi * 25, 2e-3, 0.4
SPEED = T0 / C.sum()
OF_FORCE = (C[1] + 1j * OMEGA * J[1]) / (C.sum() + 1j * OMEGA * J.sum())
THRESHOLD = C[1] * SPEED / abs(OF_FORCE)


def gear(amplitude: float) -> zivi.LinearSystem:
    """Give both wheels."""
    torque = zivi.Harmonic([amplitude, 0.0], omega=OMEGA)
    half = BACKLASH / 2
    gaps = [
        zivi.LinearGap([-1.0, 1.0], half, name="front"),
        zivi.LinearGap([1.0, -1.0], half, name="back"),
    ]
    parts = (np.array([T0, 0.0]), torque)
    return zivi.LinearSystem(
        np.diag(J), np.diag(C), np.zeros((2, 2)), excitation=parts, gaps=gaps, e=E
    )


def together(amplitude: float) -> tuple[np.ndarray, np.ndarray]:
    """Give where the wheels are at 0, in contact for ever before: the front teeth touch."""
    v = amplitude / (C.sum() + 1j * OMEGA * J.sum())
    return np.array([BACKLASH / 2, 0.0]), np.full(2, SPEED + v.real)


def run(amplitude: float, periods: float, **more: Any) -> zivi.MechanicalTrajectory:
    """Go on from there."""
    end = periods * 2 * np.pi / OMEGA
    return zivi.simulate(gear(amplitude), (0, end), together(amplitude), **more)


def by_exponentials(amplitude: float) -> tuple[float, float]:
    """Give when the teeth part for the first time, and when they hit again."""
    force = amplitude * OF_FORCE
    parts = (np.arccos(-C[1] * SPEED / abs(force)) - np.angle(force)) / OMEGA
    v = amplitude / (C.sum() + 1j * OMEGA * J.sum())
    speed = SPEED + (v * np.exp(1j * OMEGA * parts)).real

    def turned(t: float, wheel: int) -> float:
        """Give the angle of a free wheel since the teeth parted."""
        rate, mean = C[wheel] / J[wheel], (T0 if wheel == 0 else 0.0) / C[wheel]
        wave = (amplitude if wheel == 0 else 0.0) / (C[wheel] + 1j * OMEGA * J[wheel])
        at, start = (wave * np.exp(1j * OMEGA * s) for s in (t, parts))
        free = (speed - mean - start.real) * -np.expm1(-rate * (t - parts)) / rate
        return mean * (t - parts) + ((at - start) / (1j * OMEGA)).real + free

    def apart(t: float) -> float:
        return turned(t, 0) - turned(t, 1)

    grid = parts + np.linspace(1e-3, 2, 20_000) * 2 * np.pi / OMEGA
    values = np.array([apart(t) for t in grid])
    over = np.flatnonzero((values > 0) | (values < -BACKLASH))[0]
    wall = 0.0 if values[over] > 0 else -BACKLASH
    hits = brentq(lambda t: apart(t) - wall, grid[over - 1], grid[over], xtol=1e-15, rtol=1e-15)
    return parts, hits


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    below, above = 0.999_999 * THRESHOLD, 1.000_001 * THRESHOLD
    first = [len(run(amplitude, 3).liftoffs) for amplitude in (below, above)]
    print(f"lift-offs just below and above {THRESHOLD:.6f} N m: {first[0]}, {first[1] > 0}")
    low, high = 0.9 * THRESHOLD, 1.1 * THRESHOLD
    for _ in range(28):
        middle = (low + high) / 2
        low, high = (low, middle) if len(run(middle, 2).liftoffs) else (middle, high)
    print(f"the teeth part from {high:.7f} N m on ({THRESHOLD:.7f})")
    amplitude = 2.5 * THRESHOLD
    sol, (parts, hits) = run(amplitude, 200), by_exponentials(amplitude)
    print(repr(sol))
    print(f"at 2.5 times that they part at {1e3 * sol.liftoffs['t'][0]:.9f} ms ({1e3 * parts:.9f})")
    print(f"and hit at {1e3 * sol.impacts['t'][0]:.9f} ms ({1e3 * hits:.9f})")
    # d(J1 w1 + J2 w2)/dt = T - c1 w1 - c2 w2, over the run
    gained = J @ (sol.qdot[-1] - sol.qdot[0]) + C @ (sol.q[-1] - sol.q[0])
    given = T0 * sol.t[-1] + amplitude * np.sin(OMEGA * sol.t[-1]) / OMEGA
    print(f"mean torque that both take {gained / sol.t[-1]:.7f} N m ({given / sol.t[-1]:.7f})")
    if path is not None:
        draw(path, amplitude)


def draw(path: str, amplitude: float) -> None:
    """Draw the play between the teeth, and how hard they hit over the amplitude."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.6))
    t = np.linspace(0, 12, 4001) * 2 * np.pi / OMEGA
    sol = run(amplitude, 12, t_eval=t)
    axes[0].plot(1e3 * t, 1e3 * (sol.q[:, 0] - sol.q[:, 1]), color=zivi.plot.BLUE)
    for side in (-1, 1):
        axes[0].axhline(side * 1e3 * BACKLASH / 2, color="0.6", lw=0.8)
    axes[0].set(xlabel="time (ms)", ylabel="play between the teeth (mrad)")
    for ratio in np.linspace(0.8, 4, 130):
        impacts = run(ratio * THRESHOLD, 60).resolved_impacts
        late = impacts[impacts["t"] > 40 * 2 * np.pi / OMEGA]
        late = late[late["impulse"] > 1e-4]
        x = np.full(len(late), ratio)
        axes[1].plot(x, late["impulse"], ".", ms=1.2, color=zivi.plot.BLUE)
    axes[1].set(xlabel="amplitude of the torque / T1*", ylabel="impulses of impacts (N m s)")
    figure.suptitle("A pair of gears: play, and impulses over the torque")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
