r"""A motor with inductance that drives an arm against a stop.

``J q'' = k i - c q'`` and ``L i' = U - R i - k q'``: the current is a first-order state, the
velocity of a coordinate of mass 1 that the stop does not touch. It is continuous through the
impacts, which accumulate, and settles at ``U/R`` while the arm presses on the stop with ``k U/R``.
In brackets: the first impacts by the exponential of the matrix, and the stalled motor by hand.

Run as ``python examples/mechanics_motor.py [out.png]``.
"""

import sys

import numpy as np

import zivi

J, C, K, U, R, L = 0.01, 0.002, 0.1, 6.0, 2.0, 0.05
STOP, E = 1.0, 0.5


def system() -> zivi.MechanicalSystem:
    """Return the motor: angle, integral of the current; their velocities are speed and current."""
    return zivi.MechanicalSystem(
        mass=np.diag([J, 1.0]),
        force=lambda t, q, w: np.array([K * w[1] - C * w[0], (U - R * w[1] - K * w[0]) / L]),
        gaps=[zivi.LinearGap([-1.0, 0.0], STOP, name="stop")],
        e=E,
        coordinates=["angle", "charge"],
    )


def run() -> zivi.MechanicalTrajectory:
    """Switch the voltage on."""
    method = zivi.SwitchedRK(rtol=1e-11, atol=1e-12)
    return zivi.simulate(system(), (0, 2), ([0.0, 0.0], [0.0, 0.0]), method)


def by_hand(count: int) -> list[float]:
    """Find the first impacts from eigenvalues and vectors, by bisection."""
    a = np.array([[0, 1, 0], [0, -C / J, K / J], [0, -K / L, -R / L]])
    values, vectors = np.linalg.eig(a.astype(complex))
    # the constant voltage as a motion: y = drift (0: angle grows), shifted by a steady speed
    omega = U * K / (R * C + K * K)
    steady = np.array([0.0, omega, C * omega / K])
    y, t, found = np.zeros(3), 0.0, []
    for _ in range(count):
        weights = np.linalg.solve(vectors, (y - steady).astype(complex))

        def state(s: float, weights: np.ndarray = weights) -> np.ndarray:
            moved = np.real(vectors @ (weights * np.exp(values * s)))
            return np.asarray(moved + steady + np.array([omega * s, 0.0, 0.0]))

        grid = np.linspace(0, 1, 20001)[1:]
        k = next(k for k, s in enumerate(grid) if state(s)[0] > STOP)
        low, high = (grid[k - 1] if k else 0.0), grid[k]
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (low, middle) if state(middle)[0] > STOP else (middle, high)
        t, y = t + low, state(low)
        y[0], y[1] = STOP, -E * y[1]
        found.append(t)
    return found


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = run()
    print(repr(sol))
    for i, (t, known) in enumerate(zip(sol.impacts["t"], by_hand(3), strict=False)):
        print(f"impact {i + 1} at {t:.10f} s ({known:.10f})")
    print(f"rests on the stop from {sol.zeno['t'][0]:.8f} s on")
    print(f"current {sol.qdot[-1, 1]:.9f} A ({U / R:.9f})")
    print(f"torque on the stop {sol.reactions[-1, 0]:.9f} N m ({K * U / R:.9f})")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw angle, current and the torque on the stop."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    t = np.linspace(0, 2, 2001)
    dense = sol.resample(t)
    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(3, 1, layout="constrained", figsize=(8, 5.6), sharex=True)
    axes[0].plot(t, dense.q[:, 0], color=zivi.plot.BLUE)
    axes[0].axhline(STOP, color="0.6", lw=0.8)
    axes[1].plot(t, dense.qdot[:, 1], color=zivi.plot.BLUE)
    axes[1].axhline(U / R, color="0.6", lw=0.8)
    axes[2].plot(t, dense.reactions[:, 0], color=zivi.plot.BLUE)
    labels = ("angle (rad)", "current (A)", "torque (N m)")
    for ax, label in zip(axes, labels, strict=True):
        ax.set_ylabel(label)
    axes[0].set_title("a motor with inductance against a stop, $e = 0.5$; its torque on the stop")
    axes[2].set_xlabel("time (s)")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
