"""What is kept of a run: its counts in the open, every bit of the rest in a digest.

``python -m golden.trace --write`` (from ``tests``) makes the file anew: only for a change that is
meant to change results, and then the differences are looked at one by one.
"""

import argparse
import hashlib
import math
from operator import attrgetter
from pathlib import Path

import numpy as np

import zivi
from golden.cases import GROUPS

FILE = Path(__file__).with_name("traces.txt")

OPEN = ("status", "nfev", "n_steps", "n_rejected")
"""Fields that a line shows."""
RUN = "t x xdot s v lambda_s lambda_v residual impacts zeno_times liftoff_times rest_time"
LOOP = "t x xdot x_ref xdot_ref u signs tick_status impacts zeno_times liftoff_times rest_time"
BATCH = "t x xdot rest_time first_impact last_impact hardest_impact n_impacts n_zeno n_liftoffs"
SAVED = "x_max speed_max events sample_t sample_x sample_xdot"
FIELDS = {
    zivi.Trajectory: f"{RUN} failed_steps t_events y_events".split(),
    zivi.ClosedLoop: LOOP.split(),
    zivi.Batch: f"{BATCH} {SAVED}".split(),
}
"""What is digested: fields that a result gains later change nothing here."""
COMPUTED = {
    "impacts": "resolved_impacts",
    "n_impacts": "n_resolved",
    "last_impact": "last_resolved",
    "s": "transformed.s",
    "v": "transformed.v",
    "lambda_s": "transformed.lambda_s",
    "lambda_v": "transformed.lambda_v",
}
"""What now has the values that were there under the name that is digested."""
EVENTS = {
    "impacts": "resolved_impacts",
    "zeno_times": "zeno_times",
    "liftoff_times": "liftoff_times",
}
"""The same for the events of a run of a batch."""


def libm() -> str:
    """A digest of the C library's functions: their last bits differ between libraries."""
    points = [0.1 + 0.37 * k for k in range(400)]
    functions = (math.sin, math.cos, math.exp, math.log, math.sqrt, math.cbrt)
    values = [f(p) for f in functions for p in points] + [p**0.37 for p in points]
    return hashlib.sha256(np.array(values).tobytes()).hexdigest()[:16]


def absorb(digest: "hashlib._Hash", value: object) -> None:
    if isinstance(value, list | tuple):
        digest.update(f"[{len(value)}".encode())
        for item in value:
            absorb(digest, item)
    elif isinstance(value, dict):
        absorb(digest, sorted(value.items()))
    elif isinstance(value, np.ndarray) and value.dtype.names:
        for name in value.dtype.names:
            absorb(digest, value[name])
    elif value is None or isinstance(value, str):
        digest.update(str(value).encode())
    elif isinstance(value, np.ndarray) and value.dtype.kind == "U":
        digest.update(str(value.tolist()).encode())
    else:
        array = np.array(value, dtype=float)  # one NaN is like another
        array[np.isnan(array)] = np.nan
        digest.update(str(array.shape).encode() + array.tobytes())


def trace(result: object) -> str:
    """Give the line of a result."""
    digest = hashlib.sha256()
    for name in FIELDS[type(result)]:
        digest.update(name.encode())
        value = attrgetter(COMPUTED.get(name, name))(result)
        if name == "events" and value is not None:
            value = [{key: it[now] for key, now in EVENTS.items()} for it in value]
        absorb(digest, value)
    if isinstance(result, zivi.Trajectory):
        absorb(digest, _between(result))
    shown = []
    for name in OPEN:
        value = np.asarray(getattr(result, name, 0), dtype=np.int64)
        shown.append(str(int(value.sum())))
    shown.append(_final(result))
    return " ".join((*shown, digest.hexdigest()[:20]))


def _between(sol: zivi.Trajectory) -> np.ndarray | None:
    """``sol(t)`` at times that are no samples."""
    if len(sol.t) < 2 or not sol._path.dense:
        return None
    return sol(np.linspace(sol.t[0], sol.t[-1], 23))


def _final(result: object) -> str:
    x = np.asarray(result.x).ravel()
    return f"{float(x[-1]):.9g}" if len(x) else "-"


def read() -> tuple[str, dict[str, str]]:
    """Give the library the traces were made with, and them by name."""
    first, *lines = FILE.read_text().splitlines()
    return first.split()[-1], dict(line.split(" | ") for line in lines)


def write() -> None:
    """Make the file."""
    lines = [f"# status, nfev, steps, rejected, last x, digest; libm {libm()}"]
    for group in GROUPS.values():
        lines += [f"{name} | {trace(run())}" for name, run in group()]
    FILE.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", required=True, help="make the file anew")
    parser.parse_args()
    write()
