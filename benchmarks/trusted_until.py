"""How many runs `trusted_until` tells of that left the motion, and how many that did not.

    python benchmarks/trusted_until.py [runs] [seed]

Random tables, oscillators, balls with drag and mechanisms (tests/chaotic_runs.py), at tolerances
from 1e-9 to 1e-4, against exact flights: runs with an error of more than 1000 rtol, or less than
100.
"""

import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from chaotic_runs import FAMILIES, problems


def main(number=400, seed=1):
    count = Counter()
    for problem in problems(number, seed):
        sol = problem.run()
        times, errors = problem.errors(sol)
        told = sol.trusted_until < sol.t[-1]
        kind = "far" if errors.max() > 1e3 else "near" if errors.max() < 100 else "between"
        count[problem.family, kind] += 1
        count[problem.family, kind, told] += 1
        if kind == "far":
            left = times[errors > 1e3][0]
            count[problem.family, "late"] += sol.trusted_until >= left
    for family in FAMILIES:
        far, near, between = (
            f"{count[family, kind, True]} of {count[family, kind]}"
            for kind in ("far", "near", "between")
        )
        late = count[family, "late"]
        print(f"{family:10} told: far {far} ({late} too late), near {near}, between {between}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
