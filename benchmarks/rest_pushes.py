"""Pushes on masses and mechanical systems at rest: how many SwitchedRK overlooks.

    python benchmarks/rest_pushes.py [problems] [seed]

Pushes of at least 3 % of the span on a pull with a ripple of 1e-8 to 1e-2 m/s^2, at random
(tests/rest_pushes.py): how many lift-offs are missed or wrong, and the evaluations of a run.
"""

import statistics
import sys
from collections import defaultdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from rest_pushes import problems


def main(number=2000, seed=1):
    errors, calls = defaultdict(list), defaultdict(list)
    for problem in problems(number, seed):
        error, sol = problem.error()
        errors[problem.system].append(error)
        calls[problem.system].append(sol.nfev)
        if not error < 1e-6:
            print(f"off by {error:.2g} of the span: {problem}")
    for system, of in errors.items():
        wrong = sum(not error < 1e-6 for error in of)
        median = statistics.median(calls[system])
        print(f"{system:18} {len(of):5}, overlooked or wrong {wrong:4}, evaluations {median:.0f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
