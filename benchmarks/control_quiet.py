"""Quiet tracking: horizon, shift and observer against the tracker as it is, over random loops.

Restitution .1 to .95, gains 25 to 80, ratio .5 to .75, an unknown force (constant, sine or step, up
to half of its bound), an ``e`` that is believed wrong by up to 5 % in 30 % of the loops; three
noises. For each setting: rms error between 0.6 T and T - 0.05 s (T: the reference's Zeno time),
median and 90 % quantile; total variation of the control a second; loops at exact rest.

Run as ``python benchmarks/control_quiet.py [loops]``: 150 loops take some minutes.
"""

import math
import sys
import warnings
from typing import Any

import numpy as np

import zivi

F, H = -9.81, 1e-3
NOISES = ((0.0, 0.0), (1e-5, 1e-3), (1e-4, 1e-2))
SETTINGS: dict[str, dict[str, Any]] = {
    "the paper's law": {"landing": False},
    "landing": {},
    "shift, N = 3": {"shift": True, "horizon": 3},
    "shift, N = 5": {"shift": True, "horizon": 5},
    "observer, N = 1": {"shift": True, "observer": False},
    "observer, N = 3": {"shift": True, "horizon": 3, "observer": False},
    "observer, N = 5": {"shift": True, "horizon": 5, "observer": False},
    "positions only, N = 3": {"shift": True, "horizon": 3, "observer": True},
}


def draw(seed: int) -> dict[str, Any]:
    """Draw a loop."""
    rng = np.random.default_rng(seed)
    e, mu1 = rng.uniform(0.1, 0.95), rng.uniform(25, 80)
    mu2 = mu1 * rng.uniform(0.5, 0.75)
    bound = 2 * e / (1 + e) * min(mu2, mu1 - mu2)
    size = rng.uniform(0, 0.5) * bound * rng.choice([-1, 1])
    kind, omega, phase = rng.integers(3), 2 * np.pi * rng.uniform(0.5, 3), rng.uniform(0, 6)
    believed = e * (1 + rng.uniform(-0.05, 0.05)) if rng.random() < 0.3 else e
    x, v = rng.uniform(0.5, 2), rng.uniform(-2, 2)
    contact = math.sqrt(v * v - 2 * F * x)
    zeno = (v + contact) / -F + 2 * e * contact / (-F * (1 - e))
    true: Any = F + size
    if kind == 1:
        true = zivi.LinearForce(gravity=-F, amplitude=size, omega=omega, phase=phase)
    elif kind == 2:
        true = _step(0.5 * zeno, size)
    start = (x + rng.uniform(-0.2, 0.2), v + rng.uniform(-0.5, 0.5))
    return {
        "e": e, "gains": (mu1, mu2), "true": true, "believed": min(believed, 0.99),
        "reference": (x, v), "start": start, "zeno": zeno, "seed": seed, "size": abs(size),
    }  # fmt: skip


def _step(when: float, size: float) -> Any:
    return lambda t, x, v: F + (size if t > when else 0.0)


def run(loop: dict[str, Any], noise: tuple[float, float], settings: dict[str, Any]) -> list[float]:
    """Return the rms error, the variation a second, and whether it rests."""
    given = dict(settings)
    observer = None
    if "observer" in given:
        # the observer's noise is at least what rounds the model
        observer = zivi.ImpactObserver(
            loop["believed"], H, noise=(max(noise[0], 1e-6), max(noise[1], 1e-4)), q_d=1e-3,
            se=0.03, dmax=2 * loop["size"] + 1, position_only=given.pop("observer"),
        )  # fmt: skip
    tracker = zivi.TwistingTracker(*loop["gains"], h=H, e=loop["believed"], **given)
    found = zivi.simulate_closed_loop(
        zivi.ImpactSystem(loop["true"], e=loop["e"]), tracker, (0, loop["zeno"] + 3),
        (abs(loop["start"][0]), loop["start"][1]), y_ref0=loop["reference"], force_ref=F,
        force_model=F, noise=noise, seed=loop["seed"], observer=observer, dense_output=False,
    )  # fmt: skip
    part = (found.t > 0.6 * loop["zeno"]) & (found.t < loop["zeno"] - 0.05)
    seconds = np.count_nonzero(part) * H
    rms = math.sqrt(np.mean(found.error[part] ** 2))
    variation = np.abs(np.diff(found.u[part])).sum() / seconds
    return [rms, variation, float(found.rest_time is not None)]


def main(loops: int = 150) -> None:
    """Print the table."""
    warnings.simplefilter("ignore", zivi.ModelWarning)
    draws = [loop for seed in range(3 * loops) if 0.5 < (loop := draw(seed))["zeno"] < 8][:loops]
    for noise in NOISES:
        print(f"noise {noise[0]:g} m, {noise[1]:g} m/s, {len(draws)} loops")
        for name, settings in SETTINGS.items():
            rms, variation, rest = np.transpose([run(loop, noise, settings) for loop in draws])
            middle, most = np.quantile(rms, (0.5, 0.9))
            print(
                f"  {name:22} rms {middle:.1e}, {most:.1e}   TV {np.median(variation):6.0f} /s"
                f"   at rest {int(rest.sum())}"
            )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
