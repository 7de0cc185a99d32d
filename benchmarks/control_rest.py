"""Control at rest under noise: how often it changes, and what a dead zone or an observer costs.

A mass rests on the wall, its velocity is measured with noise: changes of the control in a run, and
those after its first second, without anything, with a dead zone (`quiet`) of 4 and 5 standard
deviations, and behind an observer of position and velocity, or of the position. Then the mean time
to exact rest from 0.5 m of ten runs each.

Run as ``python benchmarks/control_rest.py [ticks]``: 1000000 ticks take a minute.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import zivi

F, H = -9.81, 1e-3
KINDS = {"tracker": zivi.TwistingTracker, "regulator": zivi.TwistingRegulator}
WAYS = {
    "nothing": 0.0,
    "quiet = 4 sigma": 4.0,
    "quiet = 5 sigma": 5.0,
    "observer": None,
    "of x": True,
}
"""Standard deviations of the dead zone, or an observer, of positions only or not."""


def run(
    kind: str, way: float | bool | None, sigma: float, ticks: int, *, e: float = 0.5,
    start: tuple[float, float] = (0.0, 0.0), seed: int = 1, zone: float = 0.0,
) -> zivi.ClosedLoop:  # fmt: skip
    """Hold the mass at the wall, or bring it there."""
    noise, observer = (1e-4, sigma), None
    if way is None or way is True:
        observer = zivi.ImpactObserver(e, H, noise=noise, position_only=way is True, dmax=5)
    else:
        zone = way
    controller: Any = KINDS[kind](30, 17, h=H, e=e, quiet=zone * sigma)
    return zivi.simulate_closed_loop(
        zivi.ImpactSystem(F, e=e), controller, (0, ticks * H), start, noise=noise, seed=seed,
        force_model=F, observer=observer, dense_output=False,
    )  # fmt: skip


def changes(found: zivi.ClosedLoop) -> tuple[int, int]:
    """Count the changes of the control, and those after the first second."""
    changed = np.flatnonzero(np.diff(found.u))
    return len(changed), int(np.count_nonzero(changed > 1 / H))


def until_rest(e: float, way: float | bool | None, sigma: float, zone: float = 0.0) -> float:
    """Return the mean time to exact rest, infinite if one of ten runs has none in 10 s."""
    runs = [
        run("tracker", way, sigma, 10_000, e=e, start=(0.5, 0.0), seed=seed, zone=zone)
        for seed in range(10)
    ]
    return float(np.mean([np.inf if it.rest_time is None else it.rest_time for it in runs]))


def main(ticks: int = 1_000_000) -> None:
    """Print both tables."""
    for kind in KINDS:
        for sigma in (0.01, 0.1):
            for name, way in WAYS.items():
                n, late = changes(run(kind, way, sigma, ticks))
                print(f"{kind}, {sigma:g} m/s, {name:16} {n} changes, {late} later", flush=True)
    for e in (0.5, 0.95, 0.98):
        for sigma in (0.01, 0.1):
            times = [until_rest(e, way, sigma) for way in WAYS.values()]
            both = until_rest(e, None, sigma, 5.0)
            told = ", ".join(f"{t:.2f} ({name})" for t, name in zip(times, WAYS, strict=True))
            print(
                f"e = {e}, {sigma:g} m/s: {told}, {both:.2f} (observer, quiet = 5 sigma)",
                flush=True,
            )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
