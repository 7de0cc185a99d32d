"""Exits of the interpreter while runs go on in daemon threads: how the processes end.

``python benchmarks/exits.py [N] [PYTHON ...]`` lets N processes (500) of each interpreter
(this one) end after a random time; it ends with 1 if one aborted.
"""

from __future__ import annotations

import collections
import random
import subprocess
import sys

PROGRAM = """
import random, threading, time, zivi
system = zivi.ImpactSystem(lambda t, x, xdot: -9.81 + 1e-3 * x, e=0.5)
begun = threading.Event()
def work():
    begun.set()
    while True:
        zivi.simulate(system, (0, 2), (1, 0), zivi.ThetaGamma(h={h}))
for _ in range({threads}):
    threading.Thread(target=work, daemon=True).start()
begun.wait()
time.sleep({pause})
"""


def main(count: int, pythons: list[str]) -> int:
    """Let interpreters end, and count how."""
    wrong = 0
    for python in pythons:
        drawn, ends = random.Random(1), collections.Counter()
        for _ in range(count):
            program = PROGRAM.format(
                h=10 ** drawn.uniform(-7, -3),
                threads=drawn.choice((1, 2, 4)),
                pause=drawn.uniform(0.0, 0.05),
            )
            done = subprocess.run([python, "-c", program], capture_output=True, check=False)
            ends[done.returncode, done.stderr[-80:]] += 1
        print(python, dict(ends), flush=True)
        wrong += sum(number for (code, _), number in ends.items() if code)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(int((*sys.argv[1:], "500")[0]), sys.argv[2:] or [sys.executable]))
