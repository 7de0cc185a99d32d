r"""Two storeys at resonance, and a loose mass in the upper one that takes their energy.

An impact damper has no spring: a mass that slides freely between two walls of the storey and takes
energy by hitting them. Which clearance damps best? Two storeys from their matrices, shaken in the
first natural frequency, and a mass of a tenth with the clearance ``d`` on either side. In brackets:
the amplitude without it from the matrices; its first impact from the modes; what impacts took, from
the balance of energy.

The building keeps 8 % of its resonance with the best of 60 clearances.

Run as ``python examples/mechanics_damper.py [out.png]``.
"""

import itertools
import sys

import numpy as np

import zivi

MASS, LOOSE, STIFFNESS, RATIO, FORCE, E = 1.0, 0.1, 100.0, 0.01, 1.0, 0.6
K2 = STIFFNESS * np.array([[2.0, -1.0], [-1.0, 1.0]])
OMEGA = float(np.sqrt(np.linalg.eigvalsh(K2 / MASS)[0]))
C2 = 2 * RATIO / OMEGA * K2
PERIOD = 2 * np.pi / OMEGA
SPAN = (0.0, 120 * PERIOD)
REST = (np.zeros(3), np.zeros(3))


def damped(d: float) -> zivi.LinearSystem:
    """Give both storeys and the loose mass with the clearance d."""
    K, C = np.zeros((3, 3)), np.zeros((3, 3))
    K[:2, :2], C[:2, :2] = K2, C2
    return zivi.LinearSystem(
        np.diag([MASS, MASS, LOOSE]),
        C,
        K,
        excitation=zivi.Harmonic([FORCE, 0.0, 0.0], omega=OMEGA),
        gaps=[
            zivi.LinearGap([0, -1, 1], d, name="left"),
            zivi.LinearGap([0, 1, -1], d, name="right"),
        ],
        e=E,
        coordinates=["first", "second", "loose"],
    )


def amplitude() -> np.ndarray:
    """Amplitudes of the storeys without the loose mass, from the matrices."""
    dynamic = K2 - OMEGA**2 * MASS * np.eye(2) + 1j * OMEGA * C2
    return np.abs(np.linalg.solve(dynamic, [FORCE, 0.0]))


def storey(t: np.ndarray) -> np.ndarray:
    """Motion of the upper storey from rest, by modes, while the loose mass rests."""
    values, shapes = np.linalg.eigh(K2 / MASS)
    w = np.sqrt(values)
    zeta = RATIO * w / OMEGA
    push = shapes[0] * FORCE / MASS
    steady = push / (w**2 - OMEGA**2 + 2j * zeta * w * OMEGA)
    root = w * (-zeta + 1j * np.sqrt(1 - zeta**2))
    rate = np.real(1j * OMEGA * steady)
    free = -steady.real + 1j * (rate - root.real * steady.real) / root.imag
    t = np.atleast_1d(t)[:, None]
    return np.real(steady * np.exp(1j * OMEGA * t) + free * np.exp(root * t)) @ shapes[1]


def first_impact(d: float) -> float:
    """Find when the upper storey has moved by d, by bisection."""
    t = np.linspace(0, 20 * PERIOD, 200_001)
    k = int(np.argmax(np.abs(storey(t)) > d))
    low, high = float(t[k - 1]), float(t[k])
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if abs(storey(np.array([middle]))[0]) < d else (low, middle)
    return low


def taken(sol: zivi.MechanicalTrajectory) -> tuple[float, float]:
    """Energy that impacts took: by their speeds, and by the balance of all the rest."""
    reduced = 1 / (1 / MASS + 1 / LOOSE)
    before, after = sol.impacts["speed_before"], sol.impacts["speed_after"]
    lost = float(np.sum(reduced * (before**2 - after**2)) / 2)
    ends = np.unique(np.concatenate([[sol.t[0], sol.t[-1]], sol.impacts["t"]]))
    nodes, weights = np.polynomial.legendre.leggauss(20)
    work = viscous = 0.0
    for a, b in itertools.pairwise(ends):
        parts = max(1, int(np.ceil((b - a) / (PERIOD / 4))))
        edges = np.linspace(a, b, parts + 1)
        for low, high in itertools.pairwise(edges):
            t = (low + high) / 2 + (high - low) / 2 * nodes
            v = sol(t)[1][:, :2]
            work += (high - low) / 2 * np.sum(weights * FORCE * np.cos(OMEGA * t) * v[:, 0])
            viscous += (high - low) / 2 * np.sum(weights * np.einsum("ki,ij,kj->k", v, C2, v))
    q, v = sol.q[-1], sol.qdot[-1]
    stored = MASS * (v[:2] @ v[:2]) / 2 + LOOSE * v[2] ** 2 / 2 + q[:2] @ K2 @ q[:2] / 2
    return lost, float(work - viscous - stored)


def sweep(clearances: np.ndarray) -> np.ndarray:
    """Root mean squares of the upper storey late in the run, one for each clearance."""
    t = np.linspace(80 * PERIOD, 120 * PERIOD, 1601)
    batch = zivi.simulate_batch([damped(d) for d in clearances], SPAN, REST, t_eval=t)
    assert batch.sample_q is not None
    return np.sqrt(np.mean(batch.sample_q[:, :, 1] ** 2, axis=1))


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    free = zivi.simulate(damped(10.0), (0, 400 * PERIOD), REST)
    t = np.linspace(399 * PERIOD, 400 * PERIOD, 2001)
    still = amplitude()[1]
    print(f"amplitude without impacts {np.abs(free(t)[0][:, 1]).max():.5f} ({still:.5f})")
    sol = zivi.simulate(damped(0.05), (0, 30 * PERIOD), REST, slowest=1e-9)
    print(f"first impact at {sol.impacts['t'][0]:.9f} s ({first_impact(0.05):.9f})")
    lost, balance = taken(sol)
    print(f"impacts took {lost:.8f} J ({balance:.8f})")
    clearances = np.geomspace(0.01, 1.0, 60)
    ratio = sweep(clearances) / (still / np.sqrt(2))
    best = int(np.argmin(ratio))
    print(f"best clearance: {clearances[best]:.3f} m leaves {100 * ratio[best]:.0f} % of it")
    if path is not None:
        draw(path, clearances, ratio)


def draw(path: str, clearances: np.ndarray, ratio: np.ndarray) -> None:
    """Draw the upper storey with and without the loose mass, and what each clearance leaves."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.6))
    t = np.linspace(0, 60 * PERIOD, 6001)
    best = float(clearances[np.argmin(ratio)])
    for d, color, label in ((10.0, "0.7", "without"), (best, zivi.plot.BLUE, "best clearance")):
        sol = zivi.simulate(damped(d), (0, t[-1]), REST)
        axes[0].plot(t / PERIOD, sol(t)[0][:, 1], color=color, lw=0.8, label=label)
    axes[0].set(xlabel="periods of the force", ylabel="upper storey (m)")
    axes[0].legend(loc="upper left", bbox_to_anchor=(1, 1))
    axes[1].semilogx(clearances, ratio, ".-", color=zivi.plot.BLUE)
    axes[1].axhline(1.0, color="0.7", lw=0.8)
    axes[1].set(xlabel="clearance (m)", ylabel="rms relative to no impacts (1)", ylim=(0, 1.1))
    figure.suptitle("An impact damper in a building")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
