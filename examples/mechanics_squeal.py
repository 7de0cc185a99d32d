r"""A brake that squeals: friction couples two masses, and they flutter.

A pad moves along the disc (x), a mass behind it across (y); y relieves the contact, whose friction
is ``mu (N - K y)``. That makes the stiffness matrix unsymmetric,

    x'' + C x' + K11 x - (KC - mu K) y = mu N        y'' + C y' + K22 y - KC x = 0

and from some ``mu`` on the steady sliding flutters, until the pad sticks to the disc in every
period. In brackets: growth and frequency, an eigenvalue; and that ``mu``, where ``s^2 + C s`` is an
eigenvalue of minus the stiffness matrix with ``Re s = 0``.

Run as ``python examples/mechanics_squeal.py [out.png]``.
"""

import sys

import numpy as np

import zivi

K11, K22, KC, K, C, LOAD, SPEED = 1.0, 1.4, 0.3, 1.6, 0.05, 20.0, 1.0


BRAKE = zivi.symbolic.system(
    "x y",
    T="(xdot**2 + ydot**2)/2",
    V="K11*x**2/2 + K22*y**2/2 - KC*x*y",
    Q=["-C*xdot", "-C*ydot"],
    friction={"disc": ("xdot - v", "mu*(N - K*y)")},
    parameters={"K11": K11, "K22": K22, "KC": KC, "K": K, "C": C, "N": LOAD, "v": SPEED, "mu": 0.3},
)


def stiffness(mu: float) -> np.ndarray:
    """Give the matrix of the small motions while the pad slides."""
    return np.array([[K11, mu * K - KC], [-KC, K22]])


def run(mu: float, end: float) -> zivi.MechanicalTrajectory:
    """Disturb the steady sliding a little."""
    steady = np.linalg.solve(stiffness(mu), [mu * LOAD, 0])
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-10)
    start = steady + np.array([1e-2, 0]), [0, 0]
    return zivi.simulate(BRAKE.replace(mu=mu), (0, end), start, method)


def modes(mu: float) -> tuple[np.ndarray, np.ndarray]:
    """Give the eigenvalues of the small motions, and their left eigenvectors."""
    one = np.eye(2)
    return np.linalg.eig(np.block([[0 * one, one], [-stiffness(mu), -C * one]]).T)


def flutter(mu: float, sol: zivi.MechanicalTrajectory, t: float) -> tuple[complex, complex]:
    """Measure growth rate and frequency, and give the eigenvalue."""
    values, left = modes(mu)
    k = int(np.argmax(np.real(values) + 1e-6 * np.imag(values)))
    steady = np.concatenate([np.linalg.solve(stiffness(mu), [mu * LOAD, 0]), [0, 0]])
    begin, later = ((sol(at).ravel() - steady) @ left[:, k] for at in (0.0, t))
    return complex(np.log(later / begin) / t), complex(values[k])


def critical() -> float:
    """Give where ``s = i omega``: the matrix has the eigenvalues ``omega^2 +- i C omega``."""
    mean, half = (K11 + K22) / 2, (K22 - K11) / 2
    return (KC + (half**2 + C**2 * mean) / KC) / K


def grows(mu: float) -> bool:
    """Whether a small disturbance is larger after a while."""
    return flutter(mu, run(mu, 2.0), 2.0)[0].real > 0


def least_friction() -> float:
    """Bisect for the coefficient from which on the brake squeals."""
    low, high = 0.1, 0.4
    while high - low > 1e-7:
        middle = (low + high) / 2
        low, high = (low, middle) if grows(middle) else (middle, high)
    return high


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = run(0.3, 300.0)
    found, expected = flutter(0.3, sol, 2.0)
    print(repr(sol))
    print(f"grows by {found.real:.7f} 1/s ({expected.real:.7f})")
    print(f"with {found.imag:.7f} rad/s ({expected.imag:.7f})")
    print(f"squeals from mu = {least_friction():.6f} ({critical():.6f})")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the growth, the orbit it ends in, and its size over the coefficient of friction."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(10.4, 3.2))
    fine = sol.resample(n=6001)
    axes[0].plot(fine.t, fine.q[:, 0], lw=0.7)
    axes[0].set(xlabel="time $t$ (1)", ylabel="displacement $x$ (1)")
    axes[1].plot(fine.q[-800:, 0], fine.qdot[-800:, 0])
    axes[1].set(xlabel="displacement $x$ (1)", ylabel=r"velocity $\dot{x}$ (1)")
    for mu in np.linspace(0.2, 0.4, 11):
        late = run(mu, 300.0).resample(np.linspace(270, 300, 301)).q[:, 0]
        axes[2].plot(mu, np.ptp(late), ".", color=zivi.plot.BLUE)
    axes[2].axvline(critical(), color="0.6", lw=0.8)
    axes[2].set(xlabel=r"friction $\mu$ (1)", ylabel="peak-to-peak amplitude of $x$ (1)")
    figure.suptitle("A brake that squeals: growth, limit cycle, amplitude over the friction")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
