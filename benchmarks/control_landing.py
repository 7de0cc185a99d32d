"""Exact rest of the tracker in a sampled loop: its landing and the paper's law, run by run.

Starts with ``x`` from 0 to 2 m and ``x'`` from -4 to 4 m/s, the reference at rest or coming to
rest; then five pairs of gains, three periods, six restitutions, twenty starts each, in the
time of the settling formula; then delays.

Run as ``python benchmarks/control_landing.py``: some seconds.
"""

import math

import numpy as np

import zivi

F = -9.81
RESTITUTIONS = (0.05, 0.1, 0.2, 0.3, 1 / 3, 0.38, 0.4, 0.45, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
GAINS = ((30, 17), (60, 34), (20, 10), (30, 28), (30, 3))
PERIODS = (1e-2, 1e-3, 1e-4)


def starts(n: int, seed: int) -> np.ndarray:
    """States anywhere near the wall."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(0, 2, n), rng.uniform(-4, 4, n)])


def accelerations(mu1: float, mu2: float, e: float) -> tuple[float, float]:
    """Return ``U`` and ``D``."""
    return 2 * e * (mu1 + mu2) / (1 + e), 2 * (mu1 - mu2) / (1 + e)


def settling(x: float, v: float, mu1: float, mu2: float, e: float) -> float:
    """Time until rest under continuous control: D while falling, U while rising."""
    up, down = accelerations(mu1, mu2, e)
    t, height, fall = 0.0, x, -v
    if v > 0:
        t, height, fall = v / up, x + v**2 / (2 * up), 0.0
    contact = math.sqrt(fall**2 + 2 * down * height)
    t += (contact - fall) / down
    ratio = e * math.sqrt(down / up)
    return t + e * contact * (1 / up + 1 / math.sqrt(up * down)) / (1 - ratio)


def rests(batch: zivi.ClosedLoopBatch, h: float) -> np.ndarray:
    """Tell which runs are at exact rest at the end."""
    return (batch.x == 0) & (batch.xdot == 0) & (batch.rest_time <= batch.t - h)


def by_restitution(n: int = 50) -> list[tuple[float, bool, int, float, int]]:
    """Count runs at rest with a reference at rest, their median time, and with one that bounces."""
    rows = []
    for e in RESTITUTIONS:
        plant, y0 = zivi.ImpactSystem(F, e=e), starts(n, 1)
        # a drop that rests at 1 s: sqrt(2 x/g) (1 + e)/(1 - e)
        drop = (9.81 / 2) * ((1 - e) / (1 + e)) ** 2
        for landing in (False, True):
            it = zivi.TwistingTracker(30, 17, h=1e-3, e=e, landing=landing)
            found = [
                zivi.simulate_closed_loop_batch(plant, it, (0, 4), y0, y_ref0=start, force_ref=F)
                for start in ((0, 0), (drop, 0))
            ]
            counts = [int(np.count_nonzero(rests(batch, 1e-3))) for batch in found]
            rows.append((e, landing, counts[0], float(np.nanmedian(found[0].rest_time)), counts[1]))
    return rows


def in_time(n: int = 20, *, landing: bool = True) -> tuple[int, int]:
    """Count runs that rest within the settling time and what sampling adds, of how many."""
    at_rest = runs = 0
    for mu1, mu2 in GAINS:
        for h in PERIODS:
            for e in (0.1, 0.3, 0.5, 0.7, 0.9, 0.95):
                up, down = accelerations(mu1, mu2, e)
                y0 = starts(n, 2)
                slow = max(settling(*y, mu1, mu2, e) for y in y0)
                end = slow + 3 * h * (2 / (1 - e)) * max(1, up / down) + 10 * h
                it = zivi.TwistingTracker(mu1, mu2, h=h, e=e, landing=landing)
                batch = zivi.simulate_closed_loop_batch(
                    zivi.ImpactSystem(F, e=e), it, (0, end), y0, y_ref0=(0, 0), force_ref=F
                )
                at_rest += int(np.count_nonzero(rests(batch, h)))
                runs += n
    return at_rest, runs


def with_delay(n: int = 20) -> list[tuple[float, int, list[int]]]:
    """Count runs at rest after 6 s for ``ahead = 1``, ``1 + delay``, and for the paper's law."""
    rows = []
    for e in (0.3, 0.5, 0.8, 0.9, 0.95):
        for delay in (1, 2, 5, 10):
            counts = []
            for settings in ({"ahead": 1}, {"ahead": 1 + delay}, {"landing": False}):
                it = zivi.TwistingTracker(30, 17, h=1e-3, e=e, **settings)
                batch = zivi.simulate_closed_loop_batch(
                    zivi.ImpactSystem(F, e=e), it, (0, 6), starts(n, 3),
                    y_ref0=(0, 0), force_ref=F, delay=delay,
                )  # fmt: skip
                counts.append(int(np.count_nonzero(rests(batch, 1e-3))))
            rows.append((e, delay, counts))
    return rows


def main() -> None:
    """Print what is found."""
    print("e, landing, reference at rest: of 50, median time (s), bouncing: of 50")
    for e, landing, still, time, bouncing in by_restitution():
        print(f"{e:.3f} {landing!s:5} {still:3d} {time:.3f} {bouncing:3d}")
    for landing in (True, False):
        print(
            "landing" if landing else "paper's law",
            "in time: {} of {}".format(*in_time(landing=landing)),
        )
    print("e, delay: of 20 with ahead = 1, with 1 + delay, with the paper's law")
    for e, delay, counts in with_delay():
        print(f"{e:.2f} {delay:2d}", *counts)


if __name__ == "__main__":
    main()
