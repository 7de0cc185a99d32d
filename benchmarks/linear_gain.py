"""Exact flights of linear systems beside the embedded pair: time of the processor, and the batch.

    python benchmarks/linear_gain.py [N] [frequencies]

60 s of a chain of N masses (20) between springs, first frequency 1 Hz, damping 2 %, whose last
one is shaken between two stops: the best of some runs, and what the pair takes at 1e-6 and 1e-10.
With a number of frequencies also a batch of them, from .5 to 3.1 Hz, in one thread.
"""

import sys
import time

import numpy as np

import zivi

HERTZ = (0.8, 1.7, 3.1)


def chain(
    n: int, hertz: float, load: float = 1.0, offset: float = 1.0, stiffness: float = 1.0
) -> zivi.LinearSystem:
    """Return the chain, driven at a frequency; with numbers that are so many times as large."""
    spring = (2 * np.pi) ** 2 / (2 - 2 * np.cos(np.pi / 2 / (n + 0.5)))
    K = spring * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    K[-1, -1] = spring
    last = np.eye(n)[-1]
    sides = {"right": -last, "left": last}
    gaps = [zivi.LinearGap(side, 0.02 * offset, name=name) for name, side in sides.items()]
    drive = zivi.Harmonic(30 * load * last, 2 * np.pi * hertz)
    C = 0.04 / (2 * np.pi) * K
    return zivi.LinearSystem(np.eye(n), C, stiffness * K, excitation=drive, gaps=gaps, e=0.6)


def milliseconds(system: zivi.LinearSystem, method: zivi.SwitchedRK, runs: int) -> float:
    """Return the time of the processor of one run of 60 s, the best of some."""
    rest, best = np.zeros(len(system.M)), np.inf
    for _ in range(runs):
        began = time.process_time()
        zivi.simulate(system, (0, 60), (rest, rest), method, t_eval=[60.0], dense_output=False)
        best = min(best, time.process_time() - began)
    return 1e3 * best


def batch(n: int, frequencies: int) -> float:
    """Return the seconds of the processor that a batch of frequencies takes."""
    systems = [chain(n, hertz) for hertz in np.linspace(0.5, 3.1, frequencies)]
    rest = np.zeros(n)
    began = time.process_time()
    zivi.simulate_batch(systems, (0, 60), (rest, rest), threads=1)
    return time.process_time() - began


def main(n: int, frequencies: int) -> None:
    """Print the table."""
    for hertz in HERTZ:
        system = chain(n, hertz)
        exact = milliseconds(system, zivi.SwitchedRK(rtol=1e-6), 5)
        told = [f"{n} masses, {hertz} Hz: exact {exact:.1f} ms"]
        for rtol in (1e-6, 1e-10):
            pair = zivi.SwitchedRK(rtol=rtol, atol=rtol, flights="rk")
            took = milliseconds(system, pair, 1)
            told.append(f"pair at {rtol:.0e} {took:.0f} ms, {took / exact:.0f} times")
        print("; ".join(told), flush=True)
    if frequencies:
        print(f"{frequencies} frequencies as a batch: {batch(n, frequencies):.1f} s")


if __name__ == "__main__":
    main(*(int(sys.argv[k]) if len(sys.argv) > k else (20, 0)[k - 1] for k in (1, 2)))
