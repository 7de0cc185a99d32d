"""Features of the force within the tail of an accumulation: how many SwitchedRK overlooks.

    python benchmarks/tail_features.py [problems] [seed]

Steps, pulses and switched-on harmonics at a random place of the tail that a run without them skips,
0.2 to 5 of its arcs wide, against the motion arc by arc (tests/arc_by_arc.py).
"""

import sys
from collections import Counter
from pathlib import Path
from random import Random

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from test_tail_features import Problem


def main(problems=2000, seed=1):
    random, count, wrong = Random(seed), Counter(), Counter()
    for number in range(problems):
        problem = Problem.random(random, number)
        group = ("documented as seen" if problem.is_seen else "not", problem.kind)
        error, flights = problem.error()
        count[group] += 1
        if error > 30 + 30 * flights:
            wrong[group] += 1
            if problem.is_seen:
                print(f"wrong by {error:.3g} tolerances ({flights:.3g}): {problem}")
    for group, n in sorted(count.items()):
        print(f"{group[0]:20} {group[1]:14} {n:5}, wrong by more than 30 tolerances {wrong[group]}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
