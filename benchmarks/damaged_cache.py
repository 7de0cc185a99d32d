"""Damage to the cache of compiled models: cuts, flips and zeros, each met by a process of its own.

``python benchmarks/damaged_cache.py [N] [SEED]`` does N of them (1000) and counts how the processes
end; it ends with 1 if one got a signal, raised, or computed something else.
"""

from __future__ import annotations

import ctypes
import os
import random
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from zivi.base import machine_code as native

SOURCE = """\
int model(double t, double *q, double *w, double *out, void *parameters)
{ (void)parameters; out[0] = 3.0*t + q[0] - w[0]; return 0; }
"""


def cut(content: bytearray, drawn: random.Random) -> bytearray:
    """Leave the beginning."""
    return content[: drawn.randrange(len(content))]


def flipped(content: bytearray, drawn: random.Random) -> bytearray:
    """Change some bits."""
    for _ in range(drawn.choice((1, 1, 10, 1000))):
        content[drawn.randrange(len(content))] ^= 1 << drawn.randrange(8)
    return content


def zeroed(content: bytearray, drawn: random.Random) -> bytearray:
    """Put zeros in a part."""
    start = drawn.randrange(len(content))
    end = drawn.randrange(start, len(content)) + 1
    content[start:end] = bytes(end - start)
    return content


DAMAGE: tuple[Callable[[bytearray, random.Random], bytearray], ...] = (cut, flipped, zeroed)


def used() -> int:
    """Load the model as a process does that finds the cache; 0 if it computes what it should."""
    doubles = ctypes.c_double * 1
    out = doubles()
    native._known.clear()
    model = native.compile_model({"c": SOURCE, "numba": ""}, "c").function
    model(2.0, doubles(5.0), doubles(1.0), out, None)
    return int(out[0] != 10.0)


def apart(work: Callable[[], int]) -> int:
    """Do some work in a process of its own; give how it ended."""
    child = os.fork()
    if child == 0:
        try:
            os._exit(work())
        except BaseException as error:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
        os._exit(9)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def damaged(count: int, seed: int) -> dict[int, int]:
    """Damage the cache again and again; count how the processes end that use it."""
    drawn, ends = random.Random(seed), {}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["ZIVI_CACHE"] = folder
        assert apart(used) == 0
        for _ in range(count):
            file = drawn.choice(sorted(Path(folder).iterdir()))
            content = drawn.choice(DAMAGE)(bytearray(file.read_bytes()), drawn)
            file.write_bytes(content)
            end = apart(used)
            ends[end] = ends.get(end, 0) + 1
    return ends


if __name__ == "__main__":
    words = [int(word) for word in sys.argv[1:]]
    found = damaged(*(words + [1000, 1][len(words) :]))
    print(f"ends of processes: {found}")
    sys.exit(int(set(found) != {0}))
