"""Error of the unknown force that the observer sees, against the variance it is given.

Tracking a bouncing reference at e = 0.5 with shift, a horizon of three periods and an observer of
the full state, under an unknown force of amplitude 1.5 m/s^2: constant, a sine of 1 and of 5 Hz, a
step. Median over the loops of the rms error of ``d`` from 0.3 s until 0.05 s before the
reference's Zeno time, for each ``q_d``, at noises of (1e-5 m, 1e-3 m/s) / (1e-4 m, 1e-2 m/s).

Run as ``python benchmarks/observer_disturbance.py [loops]``: 10 loops take some seconds.
"""

import math
import sys
from typing import Any

import numpy as np

import zivi

F, H, E, SIZE = -9.81, 1e-3, 0.5, 1.5
NOISES = ((1e-5, 1e-3), (1e-4, 1e-2))
VARIANCES = (1e-5, 1e-4, 1e-3, 1e-2)
REFERENCE = (1.5, 2.0)
CONTACT = math.sqrt(REFERENCE[1] ** 2 - 2 * F * REFERENCE[0])
ZENO = (REFERENCE[1] + CONTACT + 2 * E * CONTACT / (1 - E)) / -F


def forces(seed: int) -> dict[str, Any]:
    """Draw the true forces: phase, sign and time of the step differ from loop to loop."""
    rng = np.random.default_rng(seed)
    sign, phase = rng.choice([-1, 1]), rng.uniform(0, 2 * np.pi)
    when = rng.uniform(0.4, 0.6) * ZENO
    sine = {
        f"sine {f} Hz": zivi.LinearForce(
            gravity=-F, amplitude=SIZE, omega=2 * np.pi * f, phase=phase
        )
        for f in (1, 5)
    }
    step = {"step": lambda t, x, xdot: F + sign * SIZE * (t > when)}
    return {"constant": F + sign * SIZE} | sine | step


def error(force: Any, noise: tuple[float, float], q_d: float, seed: int) -> float:
    """Rms error of the unknown force while the reference bounces."""
    observer = zivi.ImpactObserver(E, H, noise=noise, q_d=q_d, dmax=5)
    tracker = zivi.TwistingTracker(30, 17, h=H, e=E, shift=True, horizon=3)
    found = zivi.simulate_closed_loop(
        zivi.ImpactSystem(force, e=E), tracker, (0, ZENO), (REFERENCE[0] + 0.1, REFERENCE[1]),
        y_ref0=REFERENCE, force_ref=F, force_model=F, noise=noise, seed=seed,
        observer=observer, dense_output=False,
    )  # fmt: skip
    part = (found.t[:-1] > 0.3) & (found.t[:-1] < ZENO - 0.05)
    acts = force if callable(force) else lambda t, x, xdot: force
    true = np.array([acts(t, 0.0, 0.0) - F for t in found.t[:-1][part]])
    return math.sqrt(np.mean((found.d_est[: len(part)][part] - true) ** 2))


def main(loops: int = 10) -> None:
    """Print the table."""
    for q_d in VARIANCES:
        row = []
        for kind in forces(0):
            medians = [
                np.median([error(forces(seed)[kind], noise, q_d, seed) for seed in range(loops)])
                for noise in NOISES
            ]
            row.append(f"{kind} " + "/".join(f"{median:.3f}" for median in medians))
        print(f"q_d = {q_d:g}:  " + "   ".join(row), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
