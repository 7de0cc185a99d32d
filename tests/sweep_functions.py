"""Functions that worker processes of the tests can import."""

import os
import signal
import time
from pathlib import Path

import numpy as np

SPIKE = np.dtype([("t", "f8"), ("k", "i8")])


def logged(log, *what):
    """Append one line to a file that many processes may write to."""
    descriptor = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    try:
        os.write(descriptor, (" ".join(map(str, what)) + "\n").encode())
    finally:
        os.close(descriptor)


def lines(log):
    return Path(log).read_text().split("\n")[:-1] if Path(log).exists() else []


def product(x, y):
    return x * y


def cheap(x, y, rng):
    """Numbers, an array, random draws, events, and a few points that fail."""
    if x == 7 and y < 0.05:
        raise ValueError(f"nothing at {x:g}, {y:.3f}")
    spikes = np.empty(int(x) % 3, SPIKE)
    spikes["t"] = y + np.arange(len(spikes))
    spikes["k"] = int(x)
    return {"area": x * y, "pair": np.array([x, -y]), "luck": rng.random()}, spikes


def noted(x, log, pause=0.0):
    logged(log, x)
    time.sleep(pause)
    return 2.0 * x


def deadly_once(x, mark, log):
    """Kill the process that computes point 37, the first time."""
    logged(log, x)
    if x == 37 and not os.path.exists(mark):
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def deadly(x, where=37):
    if x == where:
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def both_seeds(x, seed, rng):
    return {"seed": seed % 2**32, "draw": rng.random()}


def flaky(x, mark):
    """Fail where x is 3 until a file is there."""
    if x == 3 and not os.path.exists(mark):
        raise RuntimeError("not yet")
    return x
