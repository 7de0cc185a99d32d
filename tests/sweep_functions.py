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
    """Note a point, which takes a time; those from 300 on wait while a file holds them."""
    logged(log, x)
    time.sleep(pause)
    while x >= 300 and os.path.exists(f"{log}.hold"):
        time.sleep(0.01)
    return 2.0 * x


class Stop(BaseException):
    """Cannot be read back from its pickle: it lacks the second argument."""

    def __init__(self, where, why):
        super().__init__(f"{why} at {where}")


def stopping(x, kind, log):
    """End the study at point 20."""
    logged(log, x)
    if x == 20:
        raise KeyboardInterrupt if kind == "Ctrl-C" else Stop(x, "enough")
    return 2.0 * x


def stopping_many(x, kind, log):
    logged(log, len(x))
    if 20 in x:
        raise KeyboardInterrupt if kind == "Ctrl-C" else Stop(20, "enough")
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


def cheap_many(x, y, seed, log=None):
    """What `cheap` does with arrays: numbers, an array, random draws, events, a few failures."""
    if log is not None:
        logged(log, len(x))
    many = np.flatnonzero(x % 3)
    hits = np.repeat(many, (x[many] % 3).astype(int))
    failed = np.where((x == 7) & (y < 0.05), "nothing here", "")
    values = {"area": x * y, "pair": np.column_stack([x, -y]), "luck": seed % 2**32}
    return {**values, "message": failed}, {"point": hits, "t": y[hits], "k": x[hits].astype(int)}


def many_noted(x, log, pause=0.0):
    """Note the points of each call, which takes a time for each of them."""
    logged(log, len(x))
    time.sleep(pause * len(x))
    return 2.0 * x


def picky(x):
    """Raise for all points if there is a bad one among them."""
    if np.any(x % 10 == 3):
        raise ValueError(f"bad: {x[x % 10 == 3][0]}")
    return {"half": x / 2, "table": np.outer(x, [1.0, 2.0])}


def deadly_many(x):
    if np.any(x == 37):
        os.kill(os.getpid(), signal.SIGKILL)
    return x
