"""Random chains and stacks of bodies: runs that fail, and how far ends are from a reference.

    python benchmarks/random_chains.py [chains] [seed]

The reference (tests/chains.py) follows every impact; where a change of its start by 1e-8 moves its
end by more than 1e-5, or slower impacts made plastic do, the end is not compared.
"""

import sys
from collections import Counter
from pathlib import Path
from random import Random

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from chains import Chain, Followed
from test_mechanics_chains import check


def ends(chain):
    """Give the end by the reference: as it is, moved, and with slow impacts made plastic."""
    for slow, nudge in ((1e-9, 0.0), (1e-9, 1e-8), (1e-7, 0.0)):
        run = Followed(chain, slow, nudge)
        yield np.concatenate([run.q, run.v]) if run.until(chain.end) else None


def main(chains=5000, seed=1):
    random, count = Random(seed), Counter()
    for number in range(chains):
        chain = Chain.random(random)
        try:
            sol = check(chain)
        except AssertionError as wrong:
            count["wrong"] += 1
            print(f"{number}: {wrong}")
            continue
        exact, *others = ends(chain)
        if exact is None or any(o is None or abs(o - exact).max() > 1e-5 for o in others):
            count["not compared"] += 1
            continue
        far = abs(np.concatenate([sol.q[-1], sol.qdot[-1]]) - exact).max()
        count["within 1e-4" if far < 1e-4 else "elsewhere"] += 1
        if far >= 1e-4:
            print(f"{number}: {far:.2g} from the reference")
    print(dict(count))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
