r"""Two storeys that pound against each other in an earthquake, from matrices and an accelerogram.

``M q'' + C q' + K q = -M 1 a(t)`` relative to the ground, with ``a`` given at 100 Hz and linear
between, and the gap ``d + x2 - x1 >= 0`` between the floors. In brackets: exponentials of matrices
between the times of the accelerogram, with a bisection for each impact.

Run as ``python examples/mechanics_pounding.py [out.png]``.
"""

import sys
from typing import Any

import numpy as np

import zivi

M = np.diag([4.0e5, 2.5e5])
K = np.diag([4.0e5 * (2 * np.pi / 1.1) ** 2, 2.5e5 * (2 * np.pi / 0.5) ** 2])
C = np.diag([2 * 0.03 * np.sqrt(K[0, 0] * M[0, 0]), 2 * 0.03 * np.sqrt(K[1, 1] * M[1, 1])])
CLEAR, E, END, RATE = 0.04, 0.65, 20.0, 100
NORMAL = np.array([-1.0, 1.0])


def accelerogram() -> tuple[np.ndarray, np.ndarray]:
    """Give times and accelerations of the ground: waves of given phases under an envelope."""
    t = np.arange(0, END + 0.5 / RATE, 1 / RATE)
    omega = 2 * np.pi * np.linspace(0.4, 8.0, 39)
    phases = 2.4 * np.arange(39) ** 2
    a = np.cos(np.outer(t, omega) + phases) @ (1 / (1 + (omega / 12) ** 2))
    return t, 0.45 * (t / 4 * np.exp(1 - t / 4)) * a


def system() -> zivi.LinearSystem:
    """Give the two storeys."""
    t, a = accelerogram()
    shaken = zivi.Table(t, np.outer(a, -M @ np.ones(2)))
    gap = zivi.LinearGap(NORMAL, CLEAR, name="gap")
    return zivi.LinearSystem(M, C, K, excitation=shaken, gaps=[gap], e=E, coordinates=["x1", "x2"])


def run(**more: Any) -> zivi.MechanicalTrajectory:
    """Shake them, from rest."""
    return zivi.simulate(system(), (0, END), ([0.0, 0.0], [0.0, 0.0]), **more)


def by_exponentials() -> tuple[list[float], np.ndarray]:
    """Give times of impacts and last displacements, of ``y = (q, q', a, a')``."""
    from scipy.linalg import expm

    t, a = accelerogram()
    inverse, parts = np.linalg.inv(M), 8
    flow = np.zeros((6, 6))
    flow[:2, 2:4], flow[2:4, :2], flow[2:4, 2:4] = np.eye(2), -inverse @ K, -inverse @ C
    flow[2:4, 4], flow[4, 5] = -1.0, 1.0
    y, hits, h = np.zeros(6), [], 1 / RATE / parts
    whole, kick = expm(flow * h), inverse @ NORMAL / (NORMAL @ inverse @ NORMAL)
    for k in range(len(t) - 1):
        y[4:] = a[k], (a[k + 1] - a[k]) * RATE
        for part in range(parts):
            ahead, now = whole @ y, t[k] + part * h
            left = h
            while NORMAL @ ahead[:2] + CLEAR < 0:
                low, high = 0.0, left
                for _ in range(60):
                    middle = (low + high) / 2
                    inside = NORMAL @ (expm(flow * middle) @ y)[:2] + CLEAR < 0
                    low, high = (low, middle) if inside else (middle, high)
                y = expm(flow * low) @ y
                now, left = now + low, left - low
                hits.append(now)
                y[2:4] -= (1 + E) * (NORMAL @ y[2:4]) * kick
                ahead = expm(flow * left) @ y
            y = ahead
    return hits, y[:2]


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = run()
    hits, last = by_exponentials()
    print(repr(sol))
    print(f"{len(sol.impacts)} impacts, expected: {len(hits)}")
    print(f"the first at {sol.impacts['t'][0]:.9f} s ({hits[0]:.9f})")
    print(f"the last at {sol.impacts['t'][-1]:.8f} s ({hits[-1]:.8f})")
    print(f"floors at the end {abs(sol.q[-1] - last).max():.1e} m from the expected places")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the accelerogram, the floors, and the speeds of the impacts."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    t = np.linspace(0, END, 4001)
    sol = run(t_eval=t)
    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(3, 1, sharex=True, layout="constrained", figsize=(9.6, 5.6))
    axes[0].plot(*accelerogram(), lw=0.7, color="0.4")
    axes[0].set_ylabel("ground (m/s$^2$)")
    axes[1].plot(t, sol.q[:, 0], label="$x_1$", color=zivi.plot.BLUE)
    axes[1].plot(t, sol.q[:, 1] + CLEAR, label="$x_2 + d$", color=zivi.plot.ORANGE)
    axes[1].set_ylabel("floors (m)")
    axes[1].legend(loc="upper left", bbox_to_anchor=(1, 1))
    axes[2].stem(sol.impacts["t"], -sol.impacts["speed_before"], markerfmt=".", basefmt=" ")
    axes[2].set(xlabel="time (s)", ylabel="impacts (m/s)", xlim=(0, END))
    figure.suptitle("Two storeys that pound: ground, floors, speeds of the impacts")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
