r"""A kicked rotor between two stops, and Chirikov's standard map.

A rotor turns freely between elastic stops at 0 and pi. Once a second a kick changes its velocity by
``K sin(theta)``. Each impact reflects the rotor: unfolded to a full turn, its states after the
kicks are the points of the standard map,

    p' = p + K sin(phi),    phi' = phi + p'

with islands in a sea of chaos for K = 0.9. The program prints how far the simulation is from the
map. With stops that take a tenth of the velocity, all of these motions spiral into rest at the
upper stop.

Run as ``python examples/mechanics_kicked_rotor.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

STRENGTH, KICKS = 0.9, 100
METHOD = zivi.SwitchedRK(rtol=1e-11, atol=1e-11)
ANGLES = np.linspace(0.05, 3.05, 16)


def rotor(e: float) -> zivi.MechanicalSystem:
    """Build the rotor between its stops."""
    stops = [
        zivi.LinearGap([1.0], name="lower"),
        zivi.LinearGap([-1.0], math.pi, name="upper"),
    ]
    return zivi.MechanicalSystem(mass=1.0, force=[0.0], gaps=stops, e=e, coordinates=["theta"])


def kicked(e: float, kicks: int) -> zivi.MechanicalBatch:
    """Start rotors at rest at several angles, and sample them half a second after each kick."""
    kick = zivi.Kick(every=1.0, start=1.0, dv=lambda t, q, v: STRENGTH * np.sin(q))
    times = np.arange(1, kicks + 1) + 0.5
    start = ANGLES[:, None], np.zeros((len(ANGLES), 1))
    return zivi.simulate_batch(
        rotor(e), (0.0, times[-1]), start, method=METHOD, t_eval=times, kicks=kick
    )


def standard_map(kicks: int) -> np.ndarray:
    """Iterate the map, and fold it between the stops: angles half a second after each kick."""
    phi, p = ANGLES.copy(), np.zeros_like(ANGLES)
    rows = []
    for _ in range(kicks):
        p = p + STRENGTH * np.sin(phi)
        half = np.remainder(phi + p / 2 + math.pi, 2 * math.pi) - math.pi
        rows.append(np.abs(half))
        phi = phi + p
    return np.array(rows).T


def main(path: str | None) -> None:
    """Compare with the map, count impacts, and draw if a path is given."""
    batch = kicked(1.0, 20)
    error = np.abs(batch.sample_q[:, :, 0] - standard_map(20)).max()
    print(batch)
    print(f"20 kicks: {batch.n_impacts.sum()} impacts, at most {error:.0e} rad from the map")
    for start, found, expected in zip(
        ANGLES, batch.sample_q[:, -1, 0], standard_map(20)[:, -1], strict=True
    ):
        print(f"from {start:.2f} rad: angle {found:.9f} rad ({expected:.9f})")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the states after the kicks, between elastic stops and others."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.0, 3.6), sharey=True)
    for axis, e in zip(axes, (1.0, 0.9), strict=True):
        batch = kicked(e, KICKS)
        for angle, speed in zip(batch.sample_q[:, :, 0], batch.sample_qdot[:, :, 0], strict=True):
            axis.plot(angle, speed, ".", ms=1.8)
        axis.set(xlabel=r"angle $\theta$ (rad)", title=f"stops with e = {e}", xlim=(0, math.pi))
    axes[0].set_ylabel("angular velocity (rad/s)")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
