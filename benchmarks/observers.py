"""Observers of a bouncing mass from positions alone, with an unknown constant force.

zivi's impact observer; a Kalman filter that knows no impacts, with the same gate and restarts; the
homogeneous differentiator of Levant (orders 0 to 2, L = 20), on the exact map with its resets and
without; and the salted Kalman filter of hybrid-tools 0.1.0, where that is installed
(``pip install hybrid-tools==0.1.0``). Median over the draws of the rms error of velocity and
unknown force in the second half of the run, in which the mass bounces, and the median time from
which the velocity stays within 0.05 m/s.

Run as ``python benchmarks/observers.py [draws [noise ...]]``: 40 draws take some minutes, with the
salted filter, which integrates every period numerically, some more for each noise.
"""

import math
import sys
from collections.abc import Sequence

import numpy as np

import zivi
from observers_salted import salted_kalman

F, H, DMAX, Q_D = -9.81, 1e-3, 5.0, 1e-3
CASES = ((0.6, 0.6), (0.9, 0.9), (0.6, 0.63))
"""The plant's restitution and the one believed."""
NOISE = (1e-5, 1e-4, 1e-3)
LEVANT, GAIN = (1.1, 2.12, 2.0), 20.0


def draw(e: float, seed: int) -> tuple[zivi.Trajectory, float]:
    """Draw a mass that bounces until the end, under an unknown force."""
    rng = np.random.default_rng(seed)
    d, x, v = rng.uniform(-3, 3), rng.uniform(1, 5), rng.uniform(-3, 3)
    plant = zivi.ImpactSystem(F + d, e=e)
    end = min(4.0, 0.8 * zivi.simulate(plant, (0, 60), (x, v)).rest_time)
    return zivi.simulate(plant, (0, end), (x, v), t_eval=np.arange(0, end, H)), d


def kalman_without_impacts(x: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Flights alone; the fifth measurement in a row beyond 5 sigma restarts it."""
    a = np.array([[1, H, H * H / 2], [0, 1, H], [0, 0, 1]])
    z, p, beyond = np.array([x[0], 0, 0]), np.diag([sigma**2, 25, DMAX**2]), 0
    out = np.empty((len(x), 3))
    for k, measured in enumerate(x):
        if k:
            z, p = a @ z + F * np.array([H * H / 2, H, 0]), a @ p @ a.T
            p += np.diag([1e-18, 1e-14, Q_D])
        variance, innovation = p[0, 0] + sigma**2, measured - z[0]
        if innovation**2 <= 25 * variance:
            gain, beyond = p[:, 0] / variance, 0
            z, p = z + gain * innovation, p - np.outer(gain, p[0])
            z[2] = np.clip(z[2], -DMAX, DMAX)
        elif (beyond := beyond + 1) == 5:
            z, p, beyond = (
                np.array([measured, z[1], z[2]]),
                np.diag([4 * sigma**2, 25, DMAX**2 / 4]),
                0,
            )
        out[k] = z
    return out[:, 1], out[:, 2]


def moved(x: float, v: float, a: float, e: float | None) -> tuple[float, float]:
    """Give the state a period later, through impacts if there is an ``e``."""
    left = H
    for _ in range(20):
        end = x + v * left + a * left * left / 2
        if e is None or end >= 0 or a >= 0:
            return end, v + a * left
        speed = math.sqrt(max(v * v - 2 * a * x, 0.0))
        t = (v + speed) / -a
        if t > left:
            return max(end, 0.0), v + a * left
        x, v, left = 0.0, e * speed, left - t
    return 0.0, 0.0


def differentiator(x: np.ndarray, e: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Levant's, of position, velocity and unknown force."""
    z0, z1, z2 = x[0], 0.0, 0.0
    out = np.empty((len(x), 2))
    for k, measured in enumerate(x):
        if k:
            z0, z1 = moved(z0, z1, F + z2, e)
        off = measured - z0
        size, sign = abs(off), math.copysign(1.0, off)
        z0 += H * LEVANT[2] * GAIN ** (1 / 3) * size ** (2 / 3) * sign
        z1 += H * LEVANT[1] * GAIN ** (2 / 3) * size ** (1 / 3) * sign
        z2 = min(max(z2 + H * LEVANT[0] * GAIN * sign, -DMAX), DMAX)
        out[k] = z1, z2
    return out[:, 0], out[:, 1]


def compare(e: float, believed: float, sigma: float, draws: int) -> dict[str, tuple[float, ...]]:
    """Medians of the rms errors and of the time until the velocity is known."""
    found: dict[str, list[tuple[float, ...]]] = {}
    se = 0.03 if e != believed else 0.0
    for seed in range(draws):
        sol, d = draw(e, seed)
        x = sol.x + sigma * np.random.default_rng(seed).standard_normal(len(sol.t))
        it = zivi.ImpactObserver(
            believed, H, noise=sigma, q_d=Q_D, se=se, dmax=DMAX, position_only=True
        )
        seen = it.observe(sol.t, x, force=F)
        estimates = {
            "impact observer": (seen.xdot, seen.d),
            "differentiator with resets": differentiator(x, believed),
            "Kalman without impacts": kalman_without_impacts(x, sigma),
            "differentiator without": differentiator(x, None),
        }
        if salted_kalman is not None:
            estimates["salted Kalman (hybrid-tools)"] = salted_kalman(x, believed, sigma)
        late = sol.t > 0.5 * sol.t[-1]
        for name, (xdot, unknown) in estimates.items():
            off = np.abs(xdot - sol.xdot)
            wrong = np.flatnonzero(off > 0.05)
            known = sol.t[wrong[-1]] if len(wrong) else 0.0
            rms = (np.sqrt(np.mean(error[late] ** 2)) for error in (off, unknown - d))
            found.setdefault(name, []).append((*rms, known))
    return {name: tuple(np.median(rows, axis=0)) for name, rows in found.items()}


def main(draws: int = 40, noises: Sequence[float] = NOISE) -> None:
    """Print the table."""
    if salted_kalman is None:
        print("hybrid-tools is not installed: without its salted Kalman filter")
    for e, believed in CASES:
        for sigma in noises:
            print(f"e = {e}, believed {believed}, noise {sigma:g} m")
            for name, (xdot, d, known) in compare(e, believed, sigma, draws).items():
                print(f"  {name:28} x' {xdot:.1e}  d {d:.2f}  known from {known:.3f} s", flush=True)


if __name__ == "__main__":
    main(int((sys.argv[1:2] or [40])[0]), [float(word) for word in sys.argv[2:]] or NOISE)
