"""References of mechanical systems with impacts: tests/data/mechanical_references.json.

Nothing is shared with zivi: own Lagrange equations (SymPy), the extrapolated midpoint rule (Gragg,
Bulirsch, Stoer) with 45 digits, and every impact is followed until its speed is 1e-19, without
any extrapolation of accumulations. It takes minutes:

    python tests/brute_force [--digits 45] [NAME ...]
"""

import argparse
import json
import sys
from pathlib import Path

from cases import CASES
from motion import Run
from mpmath import mp

TARGET = Path(__file__).parents[2] / "tests" / "data" / "mechanical_references.json"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--digits", type=int, default=45)
    parser.add_argument("--to", type=Path, default=TARGET)
    asked = parser.parse_args()
    mp.dps = asked.digits
    known = json.loads(asked.to.read_text()) if asked.to.exists() else {}
    for name in asked.names or CASES:
        run = Run(CASES[name])
        run.go()
        known[name] = CASES[name] | run.result()
        told = [(e[0], e[1][:12], e[2]) for e in run.events if e[0] != "impact"]
        sys.stderr.write(f"{name}: {run.impacts} impacts {told}\n")
        asked.to.write_text(json.dumps(known, indent=1) + "\n")


if __name__ == "__main__":
    main()
